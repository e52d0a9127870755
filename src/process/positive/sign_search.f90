!> Finds the signs s_m of the largest entropy for a positive process by the direct method (Sec.
!> 2.4.2).
!>
!> The Gaussian process has the largest entropy of all whose K(m) have given signs. Sequences of
!> signs are solved in the descending order of that bound, until it excludes the rest. A sequence
!> and its mirror image have the same bound and are two processes.
module process_positive_sign_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_sorting, only: sort_order
   use process_correlation, only: constraint_weights, zero_correlation
   use process_direct_constraint, only: constraint_of, length_constraint
   use process_direct_fit, only: fit_unconstrained, integer_signs, list_solutions, mirror_image, &
                                 canonical_image
   use process_direct_sign_search, only: count_sequences, max_listed, search_structured, &
                                         sequence_signs
   use process_direct_sign_sequence, only: sequence_solution, solve_sequence
   use process_model, only: process_model_type, process_request
   use process_positive_objective, only: sampled_objective
   use process_positive_search, only: follow_unconstrained
   implicit none(type, external)
   private
   public :: multipliers_of, search_signs

   real(wp), parameter :: negligible = 1.0e-4_wp       !! difference of sampled entropies [nat]
   integer(long), parameter :: most_sequences = 1024   !! tried sequences, without mirror images

contains

   !> Finds the signs of the largest entropy, and notes in the model how many sequences were tried;
   !> `all_signs` solves and lists every one. Without a solution the error is that of the first
   !> sequence.
   subroutine search_signs(request, seed, search, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: search   !! on entry its bound of effort alone
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: others = 15.0_wp   ! effort of all other sequences over the first's
      real(wp), parameter :: certain = 4.0_wp   ! standard errors
      type(sequence_solution), allocatable :: sequences(:), solutions(:)
      type(sequence_solution) :: solution
      type(sampled_objective) :: trial
      type(error_type), allocatable :: failure
      character(:), allocatable :: reason
      integer, allocatable :: ranking(:)   ! solutions by descending entropy
      real(wp) :: best, effort
      integer :: i
      logical :: is_excluded, is_first, is_whole

      call list_sequences(request, sequences, is_whole, error)
      if (allocated(error)) return
      allocate (solutions(size(sequences)))
      best = -huge(best)
      effort = search%max_effort
      is_excluded = .false.
      is_first = .true.
      do i = 1, size(sequences)
         is_excluded = sequences(i)%entropy + log(request%std) < best + negligible
         if ((is_excluded .or. .not. effort > 0.0_wp) .and. .not. request%all_signs) exit
         call solve_signs(request, seed, sequences(i), effort, trial, solution, failure)
         effort = merge(others*trial%effort, effort - trial%effort, is_first)
         is_first = is_first .and. .not. trial%effort > 0.0_wp   ! some fail without a search
         if (is_first .or. request%all_signs) effort = trial%max_effort
         model%n_examined = i
         if (i == 1 .and. allocated(failure)) error = failure
         if (allocated(failure)) cycle
         model%n_consistent = model%n_consistent + 1
         solutions(model%n_consistent) = solution
         if (solution%entropy <= &
             best + max(negligible, certain*trial%last%moments%entropy_error)) cycle
         best = solution%entropy
         search = trial
      end do
      model%search = 'structured'
      if (is_whole .and. is_excluded) model%search = 'all sequences, some excluded by a bound'
      if (is_whole .and. i > size(sequences)) model%search = 'all sequences'
      if (model%n_consistent == 0) then
         if (model%n_examined == 1) return
         reason = 'more than '//to_text(2*int(most_sequences))   ! mirror images count
         if (is_whole) reason = to_text(size(sequences))
         reason = error%message//'; of '//reason//' sequences of signs '// &
                  to_text(model%n_examined)//' were tried without success'
         if (is_whole .and. i <= size(sequences)) &
            reason = reason//', the bound of the search; all_signs = .true. tries all'
         call raise(error, exit_no_solution, reason)
         return
      end if
      if (allocated(error)) deallocate (error)
      ranking = sort_order(-solutions(:model%n_consistent)%entropy)
      solutions = solutions(ranking(:min(size(ranking), max_listed)))
      call list_solutions(solutions, model)
   end subroutine search_signs

   !> Lists the Gaussian solutions of all sequences of signs by descending entropy, each followed by
   !> its mirror image; only that of the largest entropy, if there are too many sequences.
   subroutine list_sequences(request, sequences, is_complete, error)
      type(process_request), intent(in) :: request
      type(sequence_solution), allocatable, intent(out) :: sequences(:)
      logical, intent(out) :: is_complete
      type(error_type), allocatable, intent(out) :: error
      type(length_constraint) :: constraint
      type(process_model_type) :: unconstrained
      type(sequence_solution), allocatable :: found(:)
      integer, allocatable :: order(:)
      integer :: i, n

      call fit_unconstrained(request, unconstrained, error)   ! fails if no process has the length
      if (allocated(error)) return
      constraint = constraint_of(request)
      is_complete = count_sequences(constraint) <= most_sequences
      n = merge(int(min(count_sequences(constraint), most_sequences)), 1, is_complete)
      allocate (found(n))
      if (is_complete) then
         do i = 1, n
            call solve_sequence(constraint, sequence_signs(constraint, i - 1_long), found(i))
         end do
      else
         call search_structured(constraint, found(1))
      end if
      order = sort_order(-found%entropy)
      order = pack(order, [(found(order(i))%is_feasible, i=1, n)])
      allocate (sequences(2*size(order)))
      do i = 1, size(order)
         sequences(2*i - 1) = canonical_image(found(order(i)))
         sequences(2*i) = mirror_image(sequences(2*i - 1))
      end do
      if (request%branch == 'nonnegative') &
         sequences = sequences(pack([(i, i=1, size(sequences))], &
                                    [(all(sequences(i)%correlation >= -zero_correlation), &
                                      i=1, size(sequences))]))
      if (size(sequences) == 0) &
         call raise(error, exit_no_solution, 'direct method: no signs with K(m) >= 0 have '// &
                    trim(request%correlation)//' = '//to_text(request%correlation_length))
   end subroutine list_sequences

   !> Finds the positive process of a sequence. Fails if a K(m) has another sign.
   subroutine solve_signs(request, seed, sequence, effort, search, solution, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sequence_solution), intent(in) :: sequence
      real(wp), intent(in) :: effort   !! see `max_effort` of the search
      type(sampled_objective), intent(out) :: search
      type(sequence_solution), intent(out) :: solution   !! of the positive law
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: entropy_steps = 1024   ! steps of a batch
      real(wp) :: unused

      search%max_effort = effort
      call follow_unconstrained(request, seed, search, error, sequence)
      if (allocated(error)) return
      call multipliers_of(search, request%std/search%last%moments%std, solution, unused)
      if (request%branch == 'nonnegative' .and. any(integer_signs(solution%s) < 0)) &
         call raise(error, exit_no_solution, search%problem%name//': some K(m) are negative')
      search%n_steps = entropy_steps
      call search%find_entropy()
      ! less the entropy that errors of the targets on these values give
      solution%entropy = search%last%moments%entropy + log(request%std) &
                         - dot_product(search%found%multipliers, &
                                       search%state(:search%n_constraints))
   end subroutine solve_signs

   !> Computes signs and multipliers of Eq. (30) from the matrix G: G_0 = 2 lambda_3 + 2 lambda_2
   !> a_0, G_m = lambda_2 a_m s_m.
   subroutine multipliers_of(search, b0, solution, residual)
      type(sampled_objective), intent(in) :: search   !! search of the direct method
      real(wp), intent(in) :: b0                   !! [unit of X]
      type(sequence_solution), intent(out) :: solution
      !> largest residual of G over G_0, and of s_m K(m) >= 0 (|s_m| < 1: K(m) = 0) over K(0)
      real(wp), intent(out) :: residual
      real(wp), allocatable :: k(:)
      real(wp), dimension(0:size(search%family%s)) :: g, weights
      real(wp) :: lambda_2, s(size(search%family%s))
      integer :: m, signs(size(s))

      s = search%family%signs_at(search%point)
      g = search%last%g/b0**2
      associate (request => search%problem%request)
         weights = constraint_weights(request%correlation, request%correlation_length, ubound(g, 1))
      end associate
      signs = integer_signs(s)   ! 0 where |s_m| < 1
      solution%s = s
      m = maxloc(abs(weights(1:)), 1, signs /= 0)
      lambda_2 = g(m)/(weights(m)*s(m))
      solution%lambda_3 = 0.5_wp*g(0) - lambda_2*weights(0)
      solution%delta = lambda_2/solution%lambda_3
      call search%estimate_lags(size(s), k)
      residual = max(maxval(abs(g(1:) - lambda_2*weights(1:)*s))/g(0), &
                     maxval(merge(max(-s*k(1:), 0.0_wp), abs(k(1:)), signs /= 0)/k(0), &
                            abs(weights(1:)) > 0.0_wp))
   end subroutine multipliers_of

end module process_positive_sign_search
