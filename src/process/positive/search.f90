!> Search for a positive process of order 2 or more on simulated values, by continuation of maxima
!> of the entropy in std/mean.
!>
!> One branch begins at the process without sign constraint, the solution at small std/mean. Its
!> unknowns are atanh(kappa_m). Many maxima lie at 1 + sum a_q = prod(1 + kappa_m) = 0, where only
!> the negative field keeps values finite: one of the unknowns then grows without bound. By the
!> direct method the unknowns are a factor of the symbol and the s_m of the lags where K(m) = 0.
!>
!> On the other branch K(m) alternates. It begins at order 1, which every order contains. A Gaussian
!> process need not have such K(m): the unknowns are the a_q (sequential law) or the row of G (exact
!> law), which may be indefinite.
module process_positive_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream
   use core_text, only: rounded_text, to_text
   use numerics_constrained_maximum, only: maximum_result
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_request
   use process_positive_family, only: by_coefficients, by_precision, by_symbol, by_reflection
   use process_positive_first_order, only: find_limit, match_branch
   use process_positive_kernel, only: first_order_law
   use process_positive_objective, only: new_objective, sampled_objective
   use process_positive_problem, only: new_problem, sampled_problem
   use process_positive_signs, only: match_signs, has_decayed, find_maximum, has_assumed_signs
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: follow_from_order_1, follow_unconstrained

   integer, parameter :: search_steps = 128   !! steps of a batch
   real(wp), parameter :: inside = 0.97_wp    !! std/mean of a start over the limit of order 1

contains

   !> Finds the maximum on the branch of the unconstrained process, from there at once, by
   !> continuation from a lower std/mean, or from order 1. Fails if none is found. With both lengths
   !> K(m) >= 0 is tried first: if signs may turn, some often turn at each pass and do not settle.
   subroutine follow_unconstrained(request, seed, search, error, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: search   !! in: its effort and bound
      type(error_type), allocatable, intent(out) :: error
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      integer, parameter :: most_halvings = 3
      real(wp), parameter :: steepest = 0.9_wp   ! largest std/mean of a start
      type(error_type), allocatable :: failure
      real(wp) :: effort, farther(2), limit(2), ratio
      integer :: i
      logical :: is_limited

      ratio = request%std/request%mean
      is_limited = .true.
      if (present(sequence)) is_limited = all(sequence%s >= 0.0_wp)   ! else std may exceed the mean
      if (is_limited .and. ratio >= 1.0_wp) then
         call raise(error, exit_no_solution, 'positive process with std/mean = '// &
                    rounded_text(ratio, 6)//': K(m) >= 0 needs std < mean')
         return
      end if
      call begin_search(request, seed, search, error, sequence=sequence)
      if (allocated(error)) return
      do i = 0, most_halvings
         call start_at(min(0.5_wp**i*ratio, steepest))
         if (allocated(error)) return
         call follow_targets(search, [0.5_wp**i*ratio, search%problem%l1], limit)
         if (search%is_exhausted()) exit
         ! a solution far from the start may belong to another branch
         if (limit(1) > 0.0_wp .and. (i > 0 .or. search%family%is_near_start(search%point))) exit
      end do
      if (request%correlation == 'both' .and. all(search%signs > 0.0_wp)) &
         search%problem%request%branch = 'nonnegative'
      if (search%found%is_converged) then
         if (i > 0 .or. search%family%kind == by_symbol .or. .not. has_assumed_signs(search)) &
            call settle_signs()
      end if
      if (search%found%is_converged) return
      if (search%family%kind == by_reflection) then
         effort = search%effort
         search%effort = 0.0_wp
         call follow_from_order_1(request, seed, .false., search, farther, failure)
         if (.not. allocated(failure)) return
         if (farther(1) > limit(1)) limit = farther
         search%effort = max(effort, search%effort)   ! exhausted if one of the two searches was
      end if
      call refuse(search, 'the branch of the unconstrained process', limit, error)

   contains

      !> Starts at the unconstrained process, with the field of independent values of this std/mean.
      subroutine start_at(ratio_there)
         real(wp), intent(in) :: ratio_there
         real(wp) :: b0, mu, sigma

         call fit_truncated_normal(request%mean, ratio_there*request%mean, mu, sigma, error)
         if (allocated(error)) return
         associate (problem => search%problem)
            b0 = sigma/sqrt(problem%autocovariance(0))   ! a guess, with the companion's innovations
            search%point = [search%family%start, asinh(mu/b0*(1.0_wp + sum(problem%companion)) &
                                                       **merge(2, 1, problem%is_exact))]
         end associate
         search%found = maximum_result()
         search%last%moments%std = 0.0_wp   ! not known yet
         search%centre = request%mean/b0
         call search%set_burn_in()
      end subroutine start_at

      !> Finds the maximum with the signs of its K(m), on the wanted branch if there is none on that
      !> of K(m) >= 0.
      subroutine settle_signs()
         type(sampled_objective) :: before

         before = search
         call match_signs(search)
         if (search%found%is_converged .or. search%problem%request%branch == request%branch) return
         before%effort = search%effort
         search = before
         search%problem%request%branch = request%branch
         call match_signs(search)
      end subroutine settle_signs

   end subroutine follow_unconstrained

   !> Finds the maximum on one of the branches, by continuation from order 1, which every order
   !> contains: from the wanted std/mean or from just below the limit of order 1. These maxima can
   !> continue where those from the unconstrained process end, or where their signs keep turning.
   subroutine follow_from_order_1(request, seed, is_alternating, search, limit, error)
      type(process_request), intent(in) :: request    !! request of order 2 or more
      integer(long), intent(in) :: seed
      logical, intent(in) :: is_alternating
      type(sampled_objective), intent(inout) :: search   !! in: its effort and bound
      real(wp), intent(out) :: limit(2)                  !! see `follow_targets`
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_passes = 4
      ! steps of a batch with both lengths, else L1 is lost in noise: K(m) >= 0, alternating
      integer, parameter :: finer_steps(2) = [1024, 4096]
      type(process_request) :: one
      type(first_order_law) :: first
      real(wp) :: decay, limit_of_order_1
      integer :: n_steps, pass

      limit = 0.0_wp
      n_steps = search_steps
      one = request
      one%order = 1
      if (request%correlation == 'both') then
         one%correlation = 'L0'   ! its L1 is another
         n_steps = finer_steps(merge(2, 1, is_alternating))
      end if
      call find_limit(one, is_alternating, limit_of_order_1, error)
      if (allocated(error)) return
      one%std = min(request%std, inside*limit_of_order_1*request%mean)
      decay = 0.0_wp
      do pass = 1, max_passes + 1
         call match_branch(one, is_alternating, first, error)
         if (allocated(error)) return
         decay = max(decay, first%memory)
         call begin_search(request, seed, search, error, decay)
         if (allocated(error)) return
         if (is_alternating) &
            search%family%kind = merge(by_precision, by_coefficients, search%problem%is_exact)
         search%point = [search%family%point_of_order_1(first%r, request%order), asinh(first%field)]
         search%last%moments%mean = first%mean
         search%last%moments%std = first%std
         search%n_steps = n_steps
         call search%set_burn_in()
         call follow_targets(search, [one%std/request%mean, first%l1], limit)
         if (.not. (limit(1) > 0.0_wp .or. search%is_exhausted()) .and. pass < max_passes) then
            one%std = 0.8_wp*one%std   ! start at a lower std/mean
            cycle
         end if
         if (search%found%is_converged) call match_signs(search)
         if (.not. search%found%is_converged) exit
         if (.not. is_alternating) return
         if (has_decayed(search)) return
         decay = sqrt(decay)   ! twice as many lags
      end do
      call refuse(search, 'alternating K(m)', limit, error)
   end subroutine follow_from_order_1

   !> Begins the search for a request; keeps its effort and bound.
   subroutine begin_search(request, seed, search, error, decay, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: search
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: decay                     !! see `new_problem`
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      type(sampled_problem) :: problem
      real(wp) :: effort(2)

      call new_problem(request, new_stream(seed, label_of('positive process'), 0), problem, error, &
                       decay, sequence)
      if (allocated(error)) return
      effort = [search%effort, search%max_effort]
      call new_objective(problem, search)
      search%effort = effort(1)
      search%max_effort = effort(2)
      search%n_steps = search_steps
   end subroutine begin_search

   !> Continues the maximum from the std/mean and L1 of the start to the wanted ones; L1 counts if
   !> both lengths are imposed. Steps grow until one fails and shrink from there on. Not converged
   !> if maxima end before the wanted targets.
   subroutine follow_targets(search, start, limit)
      type(sampled_objective), intent(inout) :: search
      real(wp), intent(in) :: start(2)    !! std/mean, L1
      real(wp), intent(out) :: limit(2)   !! those of the last maximum; 0: none was found
      real(wp), parameter :: first_step = 0.08_wp, least_step = 0.004_wp   ! relative
      type(maximum_result) :: before
      real(wp), allocatable :: reached(:)
      real(wp) :: distance, growth, step, targets(2), wanted(2)
      real(wp) :: done, tried   ! shares of the way

      associate (problem => search%problem)
         wanted = [problem%ratio, problem%request%second_length]
         distance = abs(wanted(1)/start(1) - 1.0_wp)
         if (problem%request%correlation == 'both') &
            distance = max(distance, abs(wanted(2)/start(2) - 1.0_wp))
         limit = 0.0_wp
         done = 0.0_wp
         tried = merge(0.0_wp, 1.0_wp, distance > 0.0_wp)
         step = first_step/max(distance, first_step)
         growth = 2.0_wp
         do
            targets = (1.0_wp - tried)*start + tried*wanted
            problem%ratio = targets(1)
            problem%request%second_length = targets(2)
            reached = search%point
            before = search%found
            call find_maximum(search)
            if (search%found%is_converged) then
               limit = targets
               done = tried
               if (done >= 1.0_wp) exit
               call search%set_burn_in()
               step = max(growth*step, least_step/distance)
            else
               search%point = reached
               if (.not. limit(1) > 0.0_wp) exit
               growth = 0.5_wp
               step = 0.5_wp*min(step, tried - done)
               if (step*distance < least_step .or. search%is_exhausted()) exit
               search%found = before
            end if
            tried = min(1.0_wp, done + step)
         end do
         problem%ratio = wanted(1)
         problem%request%second_length = wanted(2)
      end associate
   end subroutine follow_targets

   !> Raises the error of a search: where the branch ends, or why it was given up.
   subroutine refuse(search, branch, limit, error)
      type(sampled_objective), intent(in) :: search
      character(*), intent(in) :: branch
      real(wp), intent(in) :: limit(2)   !! see `follow_targets`
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: reason

      if (search%is_exhausted()) then
         reason = 'the search was given up after '//to_text(nint(1.0e-6_wp*search%effort))// &
                  ' million simulated values, its bound'
         if (search%problem%decay > 0.0_wp) &
            reason = reason//' (where the memory grows without bound along this branch, no '// &
                     'process has the largest entropy: ask for less std/mean or length)'
      else if (.not. limit(1) > 0.0_wp) then
         reason = 'nothing was found on '//branch
      else if (any(abs(limit - [search%problem%ratio, search%problem%request%second_length]) &
                   > 0.0_wp)) then
         reason = branch//' ends at std/mean = '//to_text(floor(1.0e3_wp*limit(1))/1.0e3_wp)
         if (search%problem%request%correlation == 'both') &
            reason = reason//', L1 = '//rounded_text(limit(2), 4)
         if (search%family%kind == by_symbol) reason = reason//' with positive symbols'
      else if (search%found%is_converged) then
         reason = 'K(m) does not fade within '//to_text(search%problem%n_lags)//' lags'
      else
         reason = 'the signs of K(m) do not come to rest'
      end if
      if (.not. search%problem%decay > 0.0_wp) &   ! else the error of the first branch has the name
         reason = search%problem%name//': '//reason
      call raise(error, exit_no_solution, reason)
   end subroutine refuse

end module process_positive_search
