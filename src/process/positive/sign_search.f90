!> The direct method of positive processes (Sec. 2.4.2): which signs s_m make the entropy largest.
!>
!> The Gaussian process has the largest entropy of all whose K(m) have given signs, positive or not:
!> sequences are solved in the order of that bound, until it excludes the rest. A sequence and its
!> mirror image have the same bound and are two processes.
module process_positive_sign_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_text, only: to_text
   use numerics_sorting, only: sort_order
   use process_direct_constraint, only: constraint_of, length_constraint
   use process_direct_fit, only: mirror_image, mirrored
   use process_direct_sign_search, only: count_sequences, max_listed, search_structured, &
                                         sequence_signs
   use process_direct_sign_sequence, only: sequence_solution, solve_sequence
   use process_model, only: process_model_type, process_request
   use process_positive_objective, only: sampled_objective
   use process_positive_problem, only: solve_unconstrained
   use process_positive_search, only: approach
   use process_positive_signs, only: adopt_far_signs, multipliers_of, settle_signs, &
                                     signs_solution
   implicit none(type, external)
   private
   public :: search_signs

   real(wp), parameter :: negligible = 1.0e-4_wp   !! of entropies, which are sampled [nat]

   integer(long), parameter :: most_sequences = 1024   !! but for mirror images, that are all tried

   !> Solution for one sequence.
   type :: sign_trial
      type(sampled_objective) :: law
      type(signs_solution) :: solution
      real(wp) :: entropy_error = 0.0_wp   !! of its entropy, standard error [nat]
   end type sign_trial

contains

   !> Finds the signs of the largest entropy, with the search's own account in the model;
   !> `all_signs` solves and lists every sequence. Without a solution the error is that of the first
   !> sequence.
   subroutine search_signs(request, seed, law, model, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(out) :: law
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: others = 15.0_wp   ! effort of all other sequences, of the first's
      real(wp), parameter :: certain = 4.0_wp   ! standard errors
      type(sequence_solution), allocatable :: sequences(:)
      type(signs_solution), allocatable :: solutions(:)
      type(sign_trial) :: trial
      type(error_type), allocatable :: failure
      character(:), allocatable :: reason
      integer, allocatable :: ranking(:)   ! of the solutions, by descending entropy
      real(wp) :: best, effort
      integer :: i
      logical :: is_excluded, is_whole

      call list_sequences(request, sequences, is_whole, error)
      if (allocated(error)) return
      allocate (solutions(size(sequences)))
      best = -huge(best)
      effort = law%most_effort
      is_excluded = .false.
      do i = 1, size(sequences)
         is_excluded = sequences(i)%entropy + log(request%std) < best + negligible
         if ((is_excluded .or. .not. effort > 0.0_wp) .and. .not. request%all_signs) exit
         call solve_signs(request, seed, sequences(i), effort, trial, failure)
         if (i == 1) effort = others*trial%law%effort
         if (i > 1) effort = effort - trial%law%effort
         if (request%all_signs) effort = trial%law%most_effort
         model%n_examined = i
         if (i == 1 .and. allocated(failure)) error = failure
         if (allocated(failure)) cycle
         model%n_consistent = model%n_consistent + 1
         solutions(model%n_consistent) = trial%solution
         if (trial%solution%entropy <= best + max(negligible, certain*trial%entropy_error)) cycle
         best = trial%solution%entropy
         law = trial%law
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
      ranking = ranking(:min(size(ranking), max_listed))
      model%solutions_signs = reshape([(solutions(ranking(i))%signs, i=1, size(ranking))], &
                                      [request%order, size(ranking)])
      model%solutions_delta = solutions(ranking)%delta
      model%solutions_lambda_3 = solutions(ranking)%lambda_3
      model%solutions_entropy = solutions(ranking)%entropy
   end subroutine search_signs

   !> Lists the Gaussian solutions of all sequences of signs by descending entropy, each with its
   !> mirror image after it; of too many, that of the largest entropy alone.
   subroutine list_sequences(request, sequences, is_complete, error)
      type(process_request), intent(in) :: request
      type(sequence_solution), allocatable, intent(out) :: sequences(:)
      logical, intent(out) :: is_complete
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: zero = 1.0e-9_wp   ! of K(m)/K(0)
      type(length_constraint) :: constraint
      type(process_model_type) :: unconstrained
      type(sequence_solution), allocatable :: found(:)
      integer, allocatable :: order(:)
      integer :: i, n

      call solve_unconstrained(request, unconstrained, error)   ! refuses what no process has
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
         sequences(2*i - 1) = mirrored(found(order(i)))
         sequences(2*i) = mirror_image(sequences(2*i - 1))
      end do
      if (request%branch == 'nonnegative') &
         sequences = sequences(pack([(i, i=1, size(sequences))], &
                                    [(all(sequences(i)%correlation >= -zero), &
                                      i=1, size(sequences))]))
      if (size(sequences) == 0) &
         call raise(error, exit_no_solution, 'direct method: no signs with K(m) >= 0 have '// &
                    trim(request%correlation)//' = '//to_text(request%correlation_length))
   end subroutine list_sequences

   !> Solves for the positive process of a sequence. Fails where a K(m) has another sign.
   subroutine solve_signs(request, seed, sequence, effort, trial, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sequence_solution), intent(in) :: sequence
      real(wp), intent(in) :: effort   !! see `approach`
      type(sign_trial), intent(out) :: trial
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: entropy_steps = 1024   ! of a batch
      real(wp), allocatable :: state(:)
      real(wp) :: b0, unused

      call approach(request, seed, trial%law, error, effort, sequence)
      if (.not. allocated(error)) call settle_signs(trial%law, error)
      if (allocated(error)) return
      b0 = request%std/trial%law%last%moments%std
      call multipliers_of(trial%law, b0, trial%solution, unused)
      call adopt_far_signs(trial%law, state, error)
      if (allocated(error)) return
      if (request%branch == 'nonnegative' .and. any(trial%solution%signs < 0)) &
         call raise(error, exit_no_solution, trial%law%problem%name// &
                    ': some K(m) are negative')
      b0 = request%std/trial%law%last%moments%std
      trial%law%n_steps = entropy_steps
      call trial%law%find_entropy(trial%solution%entropy, trial%entropy_error)
      ! that of x/std, less what it gains by the targets' errors on these values
      trial%solution%entropy = trial%solution%entropy + log(b0) &
                               - dot_product(trial%law%found%multipliers, &
                                             state(:trial%law%n_constraints))
   end subroutine solve_signs

end module process_positive_sign_search
