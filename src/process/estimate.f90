!> The process that explains measured values: mean, std, correlation lengths and order, with errors.
!>
!> Candidates are the autoregressive maximum-entropy processes on a grid of L0 and order. Each has a
!> correlation matrix S of the measured points (gaps are points that are not there), and the
!> restricted likelihood of the values y, with the generalized least squares mean m and
!> sigma^2 = (y - m)' S^-1 (y - m)/(n - 1), is
!>
!>    -2 ln L = (n - 1) ln sigma^2 + ln det S + ln 1' S^-1 1.                                  (1)
!>
!> The best candidate of each order is refined by a parabola through its neighbours in ln L0. Errors
!> are those of the same estimates from realizations of the fitted process, measured at the same
!> points; so are the distributions of the two statistics that test the fit.
module process_estimate
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use core_text, only: brief, counted, to_text
   use numerics_lapack, only: solve_positive_definite
   use numerics_sorting, only: sort_order
   use numerics_statistics, only: mean_of => mean, standard_deviation
   use process_autoregressive_fit, only: optimal_reflection
   use process_autoregressive_model, only: autocovariance_of
   use process_autoregressive_sums, only: correlation_sums, sum_correlation
   use process_fit, only: fit_process
   use process_model, only: process_model_type, process_request
   use process_realization, only: draw_points
   implicit none(type, external)
   private
   public :: measured_record, process_estimate_type, estimate_process

   integer, parameter :: orders(*) = [1, 2, 3, 5, 7, 10]      !! of the candidates
   integer, parameter :: lengths_per_decade = 12              !! of the candidates' L0
   real(wp), parameter :: shortest = 0.02_wp, longest = 20.0_wp   !! candidate L0 [lags]
   integer, parameter :: longest_piece = 128   !! points whose correlation matrix is formed at once
   integer, parameter :: fewest_values = 8
   integer, parameter :: lags_tested = 8       !! of the test of the correlation
   integer, parameter :: n_replicates = 199    !! behind the errors; p in steps of 1/200

   !> Values at consecutive points along one line; not a number: a gap.
   type :: measured_record
      real(wp), allocatable :: value(:)   !! (point) [unit of X]
   end type measured_record

   !> Estimates. Errors are standard errors; ranges hold 95 % of the realizations' estimates.
   type :: process_estimate_type
      integer :: n_values = 0, n_records = 0, n_gaps = 0
      integer :: n_points = 0                   !! of the longest record, gaps among them
      type(process_request) :: request          !! the process that explains the values
      type(process_model_type) :: model         !! solved
      real(wp) :: mean = 0.0_wp, mean_error = 0.0_wp
      real(wp) :: std = 0.0_wp, std_error = 0.0_wp
      real(wp) :: std_of_lines = 0.0_wp         !! of the means of two records or more
      real(wp) :: l0 = 0.0_wp, l0_error = 0.0_wp, l0_range(2) = 0.0_wp   !! [lags]
      real(wp) :: longest = 0.0_wp              !! L0 of the candidates of its order [lags]
      real(wp) :: l1 = 0.0_wp, l1_error = 0.0_wp, l1_range(2) = 0.0_wp   !! [lags]
      real(wp) :: correlation(lags_tested) = 0.0_wp   !! of the values, lags 1.. [1]
      real(wp) :: expected(lags_tested) = 0.0_wp      !! of the process [1]
      real(wp) :: p_correlation = 1.0_wp   !! share of realizations with a larger misfit
      real(wp) :: p_marginal = 1.0_wp      !! likewise, of the distribution of the values
   end type process_estimate_type

   !> Consecutive points of one record that are taken together.
   type :: piece_type
      integer, allocatable :: point(:)   !! (value) along the record
      integer, allocatable :: row(:)     !! (value) in the columns of values
   end type piece_type

   !> One candidate; those of one order stand in the order of their L0.
   type :: candidate_type
      integer :: order = 0
      real(wp) :: l0 = 0.0_wp, l1 = 0.0_wp
      real(wp), allocatable :: correlation(:)   !! K(m)/K(0), m = 0..
   end type candidate_type

   !> Estimates of many columns of values (column).
   type :: fit_type
      real(wp), allocatable :: mean(:), std(:), l0(:), l1(:)
      integer, allocatable :: order(:)
      real(wp), allocatable :: misfit(:)     !! of innovations (Box and Pierce, 1970)
      real(wp), allocatable :: distance(:)   !! of the distribution: A^2
   end type fit_type

contains

   !> Estimates the process behind the records. Values that are all positive get a positive process.
   !> Fails where there are too few values, where they do not scatter, or where no process has the
   !> estimates.
   subroutine estimate_process(records, seed, estimate, error)
      type(measured_record), intent(in) :: records(:)
      integer(long), intent(in) :: seed   !! of the realizations
      type(process_estimate_type), intent(out) :: estimate
      type(error_type), allocatable, intent(out) :: error
      type(piece_type), allocatable :: pieces(:)
      type(candidate_type), allocatable :: candidates(:)
      type(fit_type) :: found, again
      real(wp), allocatable :: values(:, :), copies(:, :)   ! (value, column)

      call take_values(records, values, pieces, estimate)
      call check_values(values(:, 1), error)
      if (allocated(error)) return
      call list_candidates(size(values, 1), longest_span(pieces), candidates, error)
      if (allocated(error)) return
      call fit_columns(values, pieces, candidates, found, error)
      if (allocated(error)) return
      estimate%longest = maxval(candidates%l0, mask=candidates%order == found%order(1))

      estimate%mean = found%mean(1)
      estimate%std = found%std(1)
      estimate%l0 = found%l0(1)
      estimate%l1 = found%l1(1)
      estimate%request%correlation_length = estimate%l0
      estimate%request%order = found%order(1)
      estimate%request%mean = estimate%mean
      estimate%request%std = estimate%std
      estimate%request%positive = all(values > 0.0_wp)
      estimate%request%branch = 'nonnegative'   ! as the candidates
      call fit_process(estimate%request, seed, estimate%model)
      if (.not. estimate%model%is_solved) then
         call raise(error, exit_no_solution, 'no process has the estimates (mean '// &
                    brief(estimate%mean)//', std '//brief(estimate%std)//', L0 '// &
                    brief(estimate%l0)//'): '//estimate%model%reason)
         return
      end if
      allocate (copies(size(values, 1), n_replicates))
      call draw_copies(records, estimate%model, seed, copies)
      call fit_columns(copies, pieces, candidates, again, error)
      if (allocated(error)) return
      call judge(values(:, 1), pieces, found, again, estimate)
   end subroutine estimate_process

   !> Collects the values of all records in one column, and the points where they stand.
   subroutine take_values(records, values, pieces, estimate)
      type(measured_record), intent(in) :: records(:)
      real(wp), allocatable, intent(out) :: values(:, :)   !! (value, 1)
      type(piece_type), allocatable, intent(out) :: pieces(:)
      type(process_estimate_type), intent(inout) :: estimate
      type(piece_type) :: piece
      real(wp), allocatable :: column(:), means(:)
      integer, allocatable :: there(:)
      integer :: first, i, k, last

      allocate (pieces(0), column(0), means(0))
      do i = 1, size(records)
         associate (value => records(i)%value)
            there = pack([(k, k=1, size(value))], mask=.not. ieee_is_nan(value))
            estimate%n_gaps = estimate%n_gaps + size(value) - size(there)
            estimate%n_points = max(estimate%n_points, size(value))
         end associate
         do first = 1, size(there), longest_piece
            last = min(first + longest_piece - 1, size(there))
            piece%point = there(first:last)
            piece%row = [(size(column) + k, k=first, last)]
            pieces = [pieces, piece]
         end do
         column = [column, records(i)%value(there)]
         if (size(there) > 0) means = [means, mean_of(records(i)%value(there))]
      end do
      if (size(means) > 1) estimate%std_of_lines = standard_deviation(means)
      estimate%n_records = size(records)
      estimate%n_values = size(column)
      values = reshape(column, [size(column), 1])
   end subroutine take_values

   pure subroutine check_values(values, error)
      real(wp), intent(in) :: values(:)
      type(error_type), allocatable, intent(out) :: error

      if (size(values) < fewest_values) then
         call raise(error, exit_bad_input, counted(size(values), 'value', 'values')// &
                    ': an estimate needs '//to_text(fewest_values))
      else if (.not. maxval(values) > minval(values)) then
         call raise(error, exit_bad_input, 'all values are '//to_text(values(1))// &
                    ': they must scatter')
      end if
   end subroutine check_values

   !> Largest distance of two points of one piece, and the tested lags at least.
   pure integer function longest_span(pieces)
      type(piece_type), intent(in) :: pieces(:)
      integer :: i

      longest_span = lags_tested
      do i = 1, size(pieces)
         associate (point => pieces(i)%point)
            longest_span = max(longest_span, point(size(point)) - point(1))
         end associate
      end do
   end function longest_span

   !> Lists white noise, then every order with L0 from the shortest to the longest. L1 is a third of
   !> the number of values at most: a longer correlation is hardly told from another mean.
   subroutine list_candidates(n_values, n_lags, candidates, error)
      integer, intent(in) :: n_values, n_lags
      type(candidate_type), allocatable, intent(out) :: candidates(:)
      type(error_type), allocatable, intent(out) :: error
      type(candidate_type) :: candidate
      type(correlation_sums) :: sums
      real(wp), allocatable :: kappa(:)
      integer :: i, k

      candidate%order = 1
      allocate (candidate%correlation(0:n_lags), source=0.0_wp)
      candidate%correlation(0) = 1.0_wp
      candidates = [candidate]
      do i = 1, size(orders)
         candidate%order = orders(i)
         do k = 0, nint(lengths_per_decade*log10(longest/shortest))
            candidate%l0 = shortest*10.0_wp**(real(k, wp)/lengths_per_decade)
            call optimal_reflection(process_request(correlation_length=candidate%l0, &
                                                    order=candidate%order), kappa, error)
            if (.not. allocated(error)) call sum_correlation(kappa, sums, error)
            if (allocated(error)) return
            candidate%l1 = sums%l1
            if (candidate%l1 > n_values/3.0_wp) exit
            candidate%correlation(:) = autocovariance_of(kappa, n_lags)
            candidates = [candidates, candidate]
         end do
      end do
   end subroutine list_candidates

   !> Finds the best candidate of each column, Eq. (1), and the statistics of its tests.
   subroutine fit_columns(values, pieces, candidates, fit, error)
      real(wp), intent(in) :: values(:, :)   !! (value, column)
      type(piece_type), intent(in) :: pieces(:)
      type(candidate_type), intent(in) :: candidates(:)
      type(fit_type), intent(out) :: fit
      type(error_type), allocatable, intent(out) :: error
      real(wp), dimension(size(candidates), size(values, 2)) :: badness, mean, variance
      real(wp) :: correlation(lags_tested), residuals(size(values, 1))
      integer :: best, c, column, n, n_pairs(lags_tested)

      n = size(values, 2)
      do c = 1, size(candidates)
         call weigh_candidate(values, pieces, candidates(c)%correlation, badness(c, :), &
                              mean(c, :), variance(c, :), error)
         if (allocated(error)) return
      end do
      allocate (fit%mean(n), fit%std(n), fit%l0(n), fit%l1(n), fit%order(n), fit%misfit(n), &
                fit%distance(n))
      do column = 1, n
         best = minloc(badness(:, column), 1)
         fit%order(column) = candidates(best)%order
         fit%mean(column) = mean(best, column)
         fit%std(column) = sqrt(variance(best, column))
         call refine(candidates, best, badness(:, column), fit%l0(column), fit%l1(column))
         residuals = (values(:, column) - fit%mean(column))/fit%std(column)
         fit%distance(column) = anderson_darling(residuals)
         call whiten(pieces, candidates(best)%correlation, residuals, error)
         if (allocated(error)) return
         call correlate(residuals, pieces, correlation, n_pairs)
         fit%misfit(column) = sum(n_pairs*correlation**2)
      end do
   end subroutine fit_columns

   !> Computes -2 ln L of Eq. (1) for each column, with the mean and the variance that belong to it.
   subroutine weigh_candidate(values, pieces, correlation, badness, mean, variance, error)
      real(wp), intent(in) :: values(:, :)       !! (value, column)
      type(piece_type), intent(in) :: pieces(:)
      real(wp), intent(in) :: correlation(0:)    !! K(m)/K(0)
      real(wp), intent(out) :: badness(:), mean(:), variance(:)   !! (column)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: s(:, :), solved(:, :)
      real(wp) :: ones, ln_det, products(size(mean)), squares(size(mean)), origin
      integer :: i, k, n

      n = size(values, 2)
      origin = values(1, 1)   ! near the mean: squares keep their digits
      ones = 0.0_wp
      ln_det = 0.0_wp
      products = 0.0_wp
      squares = 0.0_wp
      do i = 1, size(pieces)
         associate (point => pieces(i)%point, y => values(pieces(i)%row, :) - origin)
            s = correlation_matrix(point, correlation)
            allocate (solved(size(point), n + 1))
            solved(:, :n) = y
            solved(:, n + 1) = 1.0_wp
            call solve_positive_definite(s, solved, error)   ! leaves its Cholesky factor in s
            if (allocated(error)) return
            ln_det = ln_det + 2.0_wp*sum([(log(s(k, k)), k=1, size(point))])
            ones = ones + sum(solved(:, n + 1))
            products = products + sum(solved(:, :n), 1)
            squares = squares + sum(y*solved(:, :n), 1)
            deallocate (s, solved)
         end associate
      end do
      mean = origin + products/ones
      variance = (squares - products**2/ones)/(size(values, 1) - 1)
      badness = (size(values, 1) - 1)*log(variance) + ln_det + log(ones)
   end subroutine weigh_candidate

   !> S (point, point): correlations of the process at the points of a piece.
   pure function correlation_matrix(point, correlation) result(s)
      integer, intent(in) :: point(:)
      real(wp), intent(in) :: correlation(0:)   !! K(m)/K(0)
      real(wp) :: s(size(point), size(point))
      integer :: j

      do j = 1, size(point)
         s(:, j) = correlation(abs(point - point(j)))
      end do
   end function correlation_matrix

   !> Turns standardized values x into innovations L^-1 x, S = L L': uncorrelated, of variance 1,
   !> where the process explains the values.
   subroutine whiten(pieces, correlation, x, error)
      type(piece_type), intent(in) :: pieces(:)
      real(wp), intent(in) :: correlation(0:)   !! K(m)/K(0)
      real(wp), intent(inout) :: x(:)           !! (value)
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: s(:, :), solved(:, :)
      integer :: i, j

      do i = 1, size(pieces)
         associate (point => pieces(i)%point, row => pieces(i)%row)
            s = correlation_matrix(point, correlation)
            solved = reshape(x(row), [size(point), 1])
            call solve_positive_definite(s, solved, error)   ! leaves its Cholesky factor in s
            if (allocated(error)) return
            x(row) = [(dot_product(s(j:, j), solved(j:, 1)), j=1, size(point))]   ! L' S^-1 x
         end associate
      end do
   end subroutine whiten

   !> Refines L0 and L1 by a parabola through the best candidate and its neighbours of the same
   !> order; at an end of the grid they are those of the best itself.
   pure subroutine refine(candidates, best, badness, l0, l1)
      type(candidate_type), intent(in) :: candidates(:)
      integer, intent(in) :: best
      real(wp), intent(in) :: badness(:)
      real(wp), intent(out) :: l0, l1
      real(wp) :: below, above, shift
      integer :: neighbour

      l0 = candidates(best)%l0
      l1 = candidates(best)%l1
      if (best < 3 .or. best == size(candidates)) return
      if (candidates(best - 1)%order /= candidates(best + 1)%order) return
      below = badness(best - 1) - badness(best)
      above = badness(best + 1) - badness(best)
      if (.not. below + above > 0.0_wp) return
      shift = 0.5_wp*(below - above)/(below + above)
      neighbour = best + merge(1, -1, shift > 0.0_wp)
      l0 = l0*(candidates(neighbour)%l0/l0)**abs(shift)
      l1 = l1*(candidates(neighbour)%l1/l1)**abs(shift)
   end subroutine refine

   !> Correlates standardized values that many points apart, lags 1 to lags_tested: mean products,
   !> zero without pairs.
   pure subroutine correlate(x, pieces, correlation, n_pairs)
      real(wp), intent(in) :: x(:)   !! (value)
      type(piece_type), intent(in) :: pieces(:)
      real(wp), intent(out) :: correlation(lags_tested)
      integer, intent(out) :: n_pairs(lags_tested)
      integer :: i, j, k, lag

      correlation = 0.0_wp
      n_pairs = 0
      do i = 1, size(pieces)
         associate (point => pieces(i)%point, row => pieces(i)%row)
            do j = 1, size(point)
               do k = j + 1, size(point)
                  lag = point(k) - point(j)
                  if (lag > lags_tested) exit
                  correlation(lag) = correlation(lag) + x(row(j))*x(row(k))
                  n_pairs(lag) = n_pairs(lag) + 1
               end do
            end do
         end associate
      end do
      correlation = correlation/max(n_pairs, 1)
   end subroutine correlate

   !> Distance of the values from a standard normal law: A^2 of Anderson and Darling (1952).
   pure function anderson_darling(x) result(distance)
      real(wp), intent(in) :: x(:)   !! (value) standardized
      real(wp) :: distance
      real(wp) :: below(size(x)), above(size(x))   ! ln of the probabilities below and above
      integer :: i, n

      n = size(x)
      associate (ascending => x(sort_order(x)))
         below = log(max(0.5_wp*erfc(-ascending/sqrt(2.0_wp)), tiny(1.0_wp)))
         above = log(max(0.5_wp*erfc(ascending/sqrt(2.0_wp)), tiny(1.0_wp)))
      end associate
      distance = -n - sum([((2*i - 1)*(below(i) + above(n + 1 - i)), i=1, n)])/n
   end function anderson_darling

   !> Draws realizations of the process at the points that were measured (value, realization).
   subroutine draw_copies(records, model, seed, copies)
      type(measured_record), intent(in) :: records(:)
      type(process_model_type), intent(in) :: model
      integer(long), intent(in) :: seed
      real(wp), intent(out) :: copies(:, :)
      type(stream_type) :: stream
      real(wp), allocatable :: line(:)
      integer :: i, k, n

      do k = 1, size(copies, 2)
         stream = new_stream(seed, label_of('estimate'), k)
         n = 0
         do i = 1, size(records)
            line = records(i)%value
            call draw_points(model, stream, line)
            line = pack(line, mask=.not. ieee_is_nan(records(i)%value))
            copies(n + 1:n + size(line), k) = line
            n = n + size(line)
         end do
      end do
   end subroutine draw_copies

   !> Computes errors, ranges and p-values from the same estimates of the realizations.
   subroutine judge(values, pieces, found, again, estimate)
      real(wp), intent(in) :: values(:)
      type(piece_type), intent(in) :: pieces(:)
      type(fit_type), intent(in) :: found, again
      type(process_estimate_type), intent(inout) :: estimate
      integer :: n_kept, unused(lags_tested)

      estimate%mean_error = standard_deviation(again%mean)
      estimate%std_error = standard_deviation(again%std)
      estimate%l0_error = standard_deviation(again%l0)
      estimate%l1_error = standard_deviation(again%l1)
      estimate%l0_range = range_of(again%l0)
      estimate%l1_range = range_of(again%l1)
      estimate%p_correlation = share_above(again%misfit, found%misfit(1))
      estimate%p_marginal = share_above(again%distance, found%distance(1))
      call correlate((values - mean_of(values))/standard_deviation(values), pieces, &
                     estimate%correlation, unused)
      n_kept = min(lags_tested, ubound(estimate%model%autocovariance, 1))   ! zero beyond
      estimate%expected(:n_kept) = estimate%model%autocovariance(1:n_kept) &
                                   /estimate%model%autocovariance(0)
   end subroutine judge

   !> The inner 95 % of the values.
   pure function range_of(values) result(range)
      real(wp), intent(in) :: values(:)
      real(wp) :: range(2)
      integer :: order(size(values)), n

      n = size(values)
      order = sort_order(values)
      range = values(order([nint(0.025_wp*(n + 1)), nint(0.975_wp*(n + 1))]))
   end function range_of

   !> (1 + number above)/(1 + number of values): a p-value that is never zero.
   pure real(wp) function share_above(values, limit)
      real(wp), intent(in) :: values(:), limit

      share_above = (1.0_wp + count(values >= limit))/(1.0_wp + size(values))
   end function share_above

end module process_estimate
