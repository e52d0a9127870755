!> Estimate of a process from measured values: mean, std, correlation lengths, order and errors.
!>
!> The process is that of the largest likelihood. The same estimates from its realizations, at the
!> same points, give the errors and the distributions of the two statistics by which the fit is
!> tested.
module process_estimate
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_memory, only: can_allocate
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: brief, counted, size_text, to_text
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: mean_of => mean, standard_deviation
   use process_fit, only: fit_process
   use process_likelihood, only: correlate, fit_columns, fit_type, list_trials, n_lags_tested, &
                                 piece_group, trial_type
   use process_model, only: process_model_type, process_moments, process_request
   use process_realization, only: draw_chains, n_chains_of
   implicit none(type, external)
   private
   public :: measured_record, process_estimate_type, estimate_process

   integer, parameter :: longest_piece = 128   !! points of a correlation matrix
   integer, parameter :: fewest_values = 8
   integer, parameter :: n_replicates = 199    !! realizations: p-values in steps of 1/200
   !> `gain` of independent values: 95 % of a chi-squared law, as a trial has a length and an order
   real(wp), parameter :: chance_gain = 5.99_wp

   !> Values at consecutive points along one line; NaN where there is none.
   type :: measured_record
      real(wp), allocatable :: value(:)   !! (point) [unit of X]
   end type measured_record

   !> Estimates of mean, std and lengths with standard errors. Ranges contain 95 % of the estimates
   !> from realizations.
   type, extends(process_moments) :: process_estimate_type
      integer :: n_values = 0, n_records = 0, n_gaps = 0
      integer :: n_points = 0                   !! points of the longest record, with gaps
      type(process_request) :: request          !! request for the estimated process
      type(process_model_type) :: model         !! solved
      !> why there is no process of the best trial; not allocated: there is one
      character(:), allocatable :: refusal
      real(wp) :: std_of_record_means = 0.0_wp   !! std of the means of the records, if several
      real(wp) :: l0_range(2) = 0.0_wp, l1_range(2) = 0.0_wp   !! [lags]
      real(wp) :: longest = 0.0_wp              !! largest L0 of the trials of this order [lags]
      !> correlation of the values, from lag 1; NaN without pairs of them
      real(wp) :: correlation(n_lags_tested) = 0.0_wp
      real(wp) :: expected(n_lags_tested) = 0.0_wp      !! correlation of the process, from lag 1
      real(wp) :: p_correlation = 1.0_wp   !! p-value of the misfit of the correlation
      real(wp) :: p_marginal = 1.0_wp      !! p-value of the distance from a normal law
   end type process_estimate_type

contains

   !> Estimates the process of the records, a positive one if no value is negative. If there is no
   !> process of the best trial, the trials are those of order 1, then only white noise, which takes
   !> the std of `within_exponential`. If its correlation may be chance, order 1 is tried before its
   !> order, whose search can take half a minute. Fails if `check_values` does, or if no process has
   !> the estimates.
   subroutine estimate_process(records, seed, estimate, error)
      type(measured_record), intent(in) :: records(:)
      integer(long), intent(in) :: seed   !! seed of the realizations
      type(process_estimate_type), intent(out) :: estimate
      type(error_type), allocatable, intent(out) :: error
      type(piece_group), allocatable :: groups(:)
      type(trial_type), allocatable :: trials(:)   ! the first is white noise, of order 1
      type(fit_type), allocatable :: fits(:), refits(:)   ! (column)
      real(wp), allocatable :: values(:, :), realizations(:, :)   ! (value, column)
      integer :: i

      call collect_values(records, values, groups, estimate)
      call check_values(records, values(:, 1), error)
      if (allocated(error)) return
      call list_trials(size(values, 1), maxval([(maxval(groups(i)%point), i=1, size(groups))]), &
                       trials)
      do
         call fit_columns(values, groups, trials, fits, error)
         if (allocated(error)) return
         estimate%process_moments = fits(1)%process_moments
         estimate%longest = maxval(trials%l0, mask=trials%order == fits(1)%order)
         estimate%request = process_request(correlation_length=estimate%l0, &
                                            order=merge(1, fits(1)%order, &
                                                        fits(1)%gain < chance_gain), &
                                            mean=estimate%mean, std=estimate%std, &
                                            positive=all(values >= 0.0_wp), &
                                            branch='nonnegative')   ! as the trials
         if (size(trials) == 1 .and. estimate%request%positive) &
            estimate%request%std = within_exponential(estimate)
         call fit_process(estimate%request, seed, estimate%model)
         if (estimate%model%is_solved .and. estimate%request%order < fits(1)%order) then
            estimate%request%order = fits(1)%order
            call fit_process(estimate%request, seed, estimate%model)
         end if
         if (estimate%model%is_solved) then
            estimate%request%order = estimate%model%order   ! a lower one if none of it was found
            exit
         end if
         if (.not. allocated(estimate%refusal)) &
            estimate%refusal = 'no process of order '//to_text(estimate%request%order)// &
                               ' has the estimates (mean '//brief(estimate%mean)//', std '// &
                               brief(estimate%std)//', L0 '//brief(estimate%l0)//'): '// &
                               estimate%model%reason
         if (size(trials) == 1) then
            call raise(error, exit_no_solution, estimate%refusal)
            return
         end if
         trials = trials(:merge(count(trials%order == 1), 1, trials(size(trials))%order > 1))
      end do
      allocate (realizations(size(values, 1), n_replicates))
      call draw_realizations(records, estimate%model, seed, realizations)
      call fit_columns(realizations, groups, trials, refits, error)
      if (allocated(error)) return
      call find_errors(values(:, 1), groups, fits(1), refits, estimate)
   end subroutine estimate_process

   !> Std of independent positive values: the measured one, at most 0.98 of the mean if chance
   !> explains the excess. The likeliest law is the exponential one if std >= mean; from there on no
   !> positive process has K(m) >= 0. A rounded group keeps a ratio of 0.98 below 1. The std/mean of
   !> n exponential values has the standard error 1/sqrt(n).
   pure real(wp) function within_exponential(estimate) result(std)
      type(process_estimate_type), intent(in) :: estimate
      real(wp), parameter :: largest_ratio = 0.98_wp

      std = estimate%std
      if (std < estimate%mean*(1.0_wp + 3.0_wp/sqrt(real(estimate%n_values, wp)))) &
         std = min(std, largest_ratio*estimate%mean)
   end function within_exponential

   !> Collects the values of all records in one column, and their points in groups of pieces.
   subroutine collect_values(records, values, groups, estimate)
      type(measured_record), intent(in) :: records(:)
      real(wp), allocatable, intent(out) :: values(:, :)   !! (value, 1)
      type(piece_group), allocatable, intent(out) :: groups(:)
      type(process_estimate_type), intent(inout) :: estimate
      real(wp) :: means(size(records))
      integer, allocatable :: measured(:)
      integer :: first, i, k, last, n, n_means

      estimate%n_records = size(records)
      estimate%n_points = maxval([(size(records(i)%value), i=1, size(records))])
      estimate%n_gaps = sum([(count(ieee_is_nan(records(i)%value)), i=1, size(records))])
      estimate%n_values = sum([(size(records(i)%value), i=1, size(records))]) - estimate%n_gaps
      allocate (groups(0), values(estimate%n_values, 1))
      n = 0
      n_means = 0
      do i = 1, size(records)
         associate (value => records(i)%value)
            measured = pack([(k, k=1, size(value))], mask=.not. ieee_is_nan(value))
         end associate
         if (size(measured) == 0) cycle
         do first = 1, size(measured), longest_piece
            last = min(first + longest_piece - 1, size(measured))
            call add_piece(measured(first:last) - measured(first), n + first - 1, groups)
         end do
         values(n + 1:n + size(measured), 1) = records(i)%value(measured)
         n = n + size(measured)
         n_means = n_means + 1
         means(n_means) = mean_of(records(i)%value(measured))
      end do
      if (n_means > 1) estimate%std_of_record_means = standard_deviation(means(:n_means))
   end subroutine collect_values

   !> Adds a piece to the group with the same points, or to a new group.
   pure subroutine add_piece(point, row, groups)
      integer, intent(in) :: point(:), row   !! as in piece_group
      type(piece_group), allocatable, intent(inout) :: groups(:)
      type(piece_group) :: new
      integer :: i

      do i = 1, size(groups)
         if (size(groups(i)%point) /= size(point)) cycle
         if (any(groups(i)%point /= point)) cycle
         groups(i)%row = [groups(i)%row, row]
         return
      end do
      new%point = point
      new%row = [row]
      groups = [groups, new]
   end subroutine add_piece

   !> Fails if there are too few values, if all are equal, if their realizations exceed the memory,
   !> or if the first number of each record, or all numbers of the only one, are an index: at least
   !> six with equal steps.
   subroutine check_values(records, values, error)
      type(measured_record), intent(in) :: records(:)
      real(wp), intent(in) :: values(:)   !! those of all records, without gaps
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: rounding = 1.0e-3_wp   ! of times with few digits, over their step
      real(wp), allocatable :: column(:)
      real(wp) :: bytes   ! of the realizations, and at most half as many of their chains
      integer :: i, n

      bytes = 1.5_wp*8.0_wp*size(values)*n_replicates
      column = values
      if (size(records) > 1) column = [(records(i)%value(1), i=1, size(records))]
      column = pack(column, mask=.not. ieee_is_nan(column))
      n = size(column)
      if (size(values) < fewest_values) then
         call raise(error, exit_bad_input, counted(size(values), 'value', 'values')// &
                    ': an estimate needs '//to_text(fewest_values))
      else if (.not. maxval(values) > minval(values)) then
         call raise(error, exit_bad_input, 'all values are '//to_text(values(1))// &
                    ': they must scatter')
      else if (.not. can_allocate(bytes)) then
         call raise(error, exit_bad_input, counted(size(values), 'value', 'values')// &
                    ': their realizations take '//size_text(bytes)//', which the system does '// &
                    'not give: leave values out')
      else if (n >= 6) then
         if (all(abs(column(3:) - 2.0_wp*column(2:n - 1) + column(:n - 2)) &
                 < rounding*abs(column(2) - column(1)))) &
            call raise(error, exit_bad_input, 'the numbers '//to_text(column(1))//', '// &
                       to_text(column(2))//', '//to_text(column(3))//', ... are an index, not '// &
                       'measured values: leave them out')
      end if
   end subroutine check_values

   !> Draws realizations of the process at the measured points. A chain of draw_chains has a long
   !> burn-in, so each one serves as many records as there are chains; every realization takes
   !> each of these records from another chain. Neighbours on a chain belong to two realizations,
   !> which the gap between them leaves nearly independent.
   subroutine draw_realizations(records, model, seed, realizations)
      type(measured_record), intent(in) :: records(:)
      type(process_model_type), intent(in) :: model
      integer(long), intent(in) :: seed
      real(wp), intent(out) :: realizations(:, :)   !! (value, realization)
      type(stream_type) :: stream
      real(wp), allocatable :: chains(:, :)   ! (chain, point)
      integer :: first, gap, i, j, k, last, n, n_chains, p, point

      n_chains = n_chains_of(model)
      gap = merge(ceiling(2.0_wp*model%l0), 0, n_chains > 1)   ! between records on a chain
      do k = 0, size(realizations, 2) - 1, n_chains
         stream = new_stream(seed, label_of('estimate'), k + 1)
         n = 0
         do first = 1, size(records), n_chains
            last = min(first + n_chains - 1, size(records))
            allocate (chains(n_chains, sum([(size(records(i)%value) + gap, i=first, last)])))
            call draw_chains(model, stream, chains)
            point = 0
            do i = first, last
               associate (value => records(i)%value)
                  do p = 1, size(value)
                     if (ieee_is_nan(value(p))) cycle
                     n = n + 1
                     do j = 1, min(n_chains, size(realizations, 2) - k)
                        realizations(n, k + j) = chains(1 + modulo(i + j, n_chains), point + p)
                     end do
                  end do
                  point = point + size(value) + gap
               end associate
            end do
            deallocate (chains)
         end do
      end do
   end subroutine draw_realizations

   !> Computes errors, ranges and p-values by the estimates from realizations.
   subroutine find_errors(values, groups, fit, refits, estimate)
      real(wp), intent(in) :: values(:)
      type(piece_group), intent(in) :: groups(:)
      type(fit_type), intent(in) :: fit         !! fit to the values
      type(fit_type), intent(in) :: refits(:)   !! fits to the realizations
      type(process_estimate_type), intent(inout) :: estimate
      real(wp), dimension(n_lags_tested) :: products, squares
      integer :: n_kept, unused(n_lags_tested)

      estimate%mean_error = standard_deviation(refits%mean)
      estimate%std_error = standard_deviation(refits%std)
      estimate%l0_error = standard_deviation(refits%l0)
      estimate%l1_error = standard_deviation(refits%l1)
      estimate%l0_range = inner_range(refits%l0)
      estimate%l1_range = inner_range(refits%l1)
      estimate%p_correlation = p_value(refits%misfit, fit%misfit)
      estimate%p_marginal = p_value(refits%distance, fit%distance)
      call correlate(values - mean_of(values), groups, products, squares, unused)
      estimate%correlation = ieee_value(1.0_wp, ieee_quiet_nan)
      where (squares > 0.0_wp) estimate%correlation = products/squares   ! 1 at most, of any pairs
      n_kept = min(n_lags_tested, ubound(estimate%model%autocovariance, 1))   ! 0 beyond
      estimate%expected(:n_kept) = estimate%model%autocovariance(1:n_kept) &
                                   /estimate%model%autocovariance(0)
   end subroutine find_errors

   !> Range of the inner 95 % of the values.
   pure function inner_range(values) result(range)
      real(wp), intent(in) :: values(:)
      real(wp) :: range(2)
      integer :: order(size(values)), n

      n = size(values)
      order = sort_order(values)
      range = values(order([nint(0.025_wp*(n + 1)), nint(0.975_wp*(n + 1))]))
   end function inner_range

   !> p-value of a statistic by its values in realizations, (1 + number above)/(1 + number).
   pure real(wp) function p_value(values, limit)
      real(wp), intent(in) :: values(:), limit

      p_value = (1.0_wp + count(values >= limit))/(1.0_wp + size(values))
   end function p_value

end module process_estimate
