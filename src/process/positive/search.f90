!> The search for a positive process of higher order, on simulated values: maxima are followed in
!> std/mean along a branch of processes.
!>
!> One branch begins with the process without sign constraint, the solution where std/mean is small.
!> Its unknowns are atanh(kappa_m): 1 + sum a_q is the product of 1 + kappa_m, and a maximum at 0,
!> where the field alone holds values back, is approached as one of them grows. By the direct method
!> they are the factor of the symbol and the s_m of the lags where K(m) = 0.
!>
!> On the other one the sign of K(m) changes with every lag. It begins at order 1, which every order
!> contains. No Gaussian process need have such K(m): the sequential law is searched in its a_q, Eq.
!> (25) in the row of G, which may be indefinite; positive values alone keep both finite.
module process_positive_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream
   use core_text, only: rounded_text, to_text
   use numerics_constrained_maximum, only: search_result
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_request
   use process_positive_family, only: by_coefficients, by_precision, by_symbol, free
   use process_positive_first_order, only: find_limit, match_branch
   use process_positive_kernel, only: first_order_law
   use process_positive_objective, only: new_objective, sampled_objective
   use process_positive_problem, only: new_problem, sampled_problem
   use process_positive_signs, only: adopt_signs, fades, find_maximum, has_wanted_signs
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: follow_alternating, follow_unconstrained

   integer, parameter :: search_steps = 128   !! of a batch
   real(wp), parameter :: inside = 0.97_wp    !! start of a climb from order 1, over its limit

contains

   !> Follows the branch of the unconstrained process to the wanted std/mean, at once or by a climb.
   !> Fails where it ends before. Where both lengths are imposed and K(m) would change its sign,
   !> K(m) >= 0 is sought first: signs that may turn are seldom at rest.
   subroutine follow_unconstrained(request, seed, law, error, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: law   !! at first its effort and bound alone
      type(error_type), allocatable, intent(out) :: error
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      integer, parameter :: most_halvings = 3
      real(wp), parameter :: steep = 0.9_wp   ! std/mean of a start
      type(sampled_objective) :: before
      real(wp) :: limit, ratio
      integer :: i
      logical :: is_limited

      ratio = request%std/request%mean
      is_limited = .true.
      if (present(sequence)) is_limited = all(sequence%s >= 0.0_wp)   ! else std may exceed the mean
      if (is_limited .and. ratio >= 1.0_wp .and. request%mean > 0.0_wp) then
         call raise(error, exit_no_solution, 'positive process with std/mean = '// &
                    rounded_text(ratio, 6)//': K(m) >= 0 needs std < mean')
         return
      end if
      call begin(request, seed, law, error, sequence=sequence)
      if (allocated(error)) return
      do i = 0, most_halvings
         call start_at(min(0.5_wp**i*ratio, steep))
         if (allocated(error)) return
         call climb(law, 0.5_wp**i*ratio, ratio, limit)
         if (law%is_exhausted()) exit
         ! far from the start another branch may have the targets too
         if (limit > 0.0_wp .and. (i > 0 .or. law%family%is_near(law%point))) exit
      end do
      if (.not. law%found%is_converged .and. law%family%kind == free .and. &
          request%correlation /= 'both') call climb_from_order_1()
      if (request%correlation == 'both' .and. all(law%signs > 0.0_wp)) &
         law%problem%request%branch = 'nonnegative'
      if (law%found%is_converged) then
         if (law%problem%request%branch /= request%branch) before = law
         if (i > 0 .or. law%family%kind == by_symbol .or. .not. has_wanted_signs(law)) &
            call adopt_signs(law)
         if (.not. law%found%is_converged .and. law%problem%request%branch /= request%branch) then
            before%effort = law%effort
            law = before
            law%problem%request%branch = request%branch
            call adopt_signs(law)
         end if
      end if
      if (.not. law%found%is_converged) &
         call refuse(law, 'the branch of the unconstrained process', limit, error)

   contains

      !> Starts at the unconstrained process, with the field of independent values of a std/mean.
      subroutine start_at(ratio_there)
         real(wp), intent(in) :: ratio_there
         real(wp) :: b0, mu, sigma

         call fit_truncated_normal(request%mean, ratio_there*request%mean, mu, sigma, error)
         if (allocated(error)) return
         associate (problem => law%problem)
            b0 = sigma/sqrt(problem%autocovariance(0))   ! a guess, with the companion's innovations
            law%point = [law%family%start, asinh(mu/b0*(1.0_wp + sum(problem%companion)) &
                                                 **merge(2, 1, problem%is_exact))]
         end associate
         law%found = search_result()
         law%last%moments%std = 0.0_wp   ! nothing is known yet
         law%centre = request%mean/b0
         call law%settle()
      end subroutine start_at

      !> Climbs once more, with an effort of its own, from the process of order 1 of the wanted
      !> std/mean or just below its limit. The first climb may have followed maxima that end before
      !> others do.
      subroutine climb_from_order_1()
         type(process_request) :: one
         type(first_order_law) :: first
         type(error_type), allocatable :: failure
         real(wp) :: farther

         one = request
         one%order = 1
         call find_limit(one, .false., farther, failure)
         if (.not. allocated(failure)) then
            one%std = min(ratio, inside*farther)*request%mean
            call match_branch(one, .false., first, failure)
         end if
         if (allocated(failure)) return
         law%effort = 0.0_wp
         law%found = search_result()
         call start_from_order_1(law, first)
         call climb(law, one%std/request%mean, ratio, farther)
         limit = max(limit, farther)
      end subroutine climb_from_order_1

   end subroutine follow_unconstrained

   !> Follows the branch of alternating K(m) from order 1 to the wanted order and std/mean. Fails
   !> with the std/mean at which it ends.
   subroutine follow_alternating(request, seed, law, error)
      type(process_request), intent(in) :: request    !! of order 2 or more
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: law   !! at first its effort and bound alone
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: max_passes = 4
      type(process_request) :: one
      type(first_order_law) :: first
      real(wp) :: decay, limit
      integer :: pass

      one = request
      one%order = 1
      call find_limit(one, .true., limit, error)
      if (allocated(error)) return
      one%std = min(request%std, inside*limit*request%mean)
      decay = 0.0_wp
      do pass = 1, max_passes
         call match_branch(one, .true., first, error)
         if (allocated(error)) return
         decay = max(decay, first%memory)
         call begin(request, seed, law, error, decay)
         if (allocated(error)) return
         law%family%kind = merge(by_precision, by_coefficients, law%problem%is_exact)
         call start_from_order_1(law, first)
         call climb(law, one%std/request%mean, request%std/request%mean, limit)
         if (.not. limit > 0.0_wp .and. .not. law%is_exhausted()) then
            one%std = 0.8_wp*one%std   ! a climb from further below
            cycle
         end if
         if (law%found%is_converged) call adopt_signs(law)
         if (.not. law%found%is_converged) exit
         if (fades(law)) return
         decay = sqrt(decay)   ! lags of twice the memory
      end do
      call refuse(law, 'alternating K(m)', limit, error)
   end subroutine follow_alternating

   !> Starts at a process of order 1, which every order contains.
   subroutine start_from_order_1(law, first)
      type(sampled_objective), intent(inout) :: law   !! of any family but that of a symbol
      type(first_order_law), intent(in) :: first
      real(wp) :: first_unknown

      first_unknown = asinh(-first%r)
      if (law%family%kind == free) first_unknown = atanh(-first%r)
      law%point = [first_unknown, spread(0.0_wp, 1, law%problem%request%order - 1), &
                   asinh(first%field)]
      law%last%moments%mean = first%mean
      law%last%moments%std = first%std
      call law%settle()
   end subroutine start_from_order_1

   !> Begins the search for a request; its effort is counted on.
   subroutine begin(request, seed, law, error, decay, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: decay                     !! see `new_problem`
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      type(sampled_problem) :: problem
      real(wp) :: effort(2)

      call new_problem(request, new_stream(seed, label_of('positive process'), 0), problem, error, &
                       decay, sequence)
      if (allocated(error)) return
      effort = [law%effort, law%most_effort]
      call new_objective(problem, law)
      law%effort = effort(1)
      law%most_effort = effort(2)
      law%n_steps = search_steps
   end subroutine begin

   !> Climbs by maxima at larger and larger std/mean, from that of the start to the wanted one, by
   !> steps that grow until one fails and shrink from there on. Where maxima end before, the last is
   !> not converged.
   subroutine climb(law, start, wanted, limit)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(in) :: start, wanted
      real(wp), intent(out) :: limit   !! the largest std/mean that was met; 0: none
      real(wp), parameter :: first_step = 0.08_wp, least_step = 0.004_wp   ! relative
      type(search_result) :: before
      real(wp), allocatable :: reached(:)
      integer, allocatable :: faces(:)
      real(wp) :: growth, step

      law%problem%ratio = start
      limit = 0.0_wp
      step = first_step
      growth = 2.0_wp
      do
         reached = law%point
         faces = law%family%faces
         before = law%found
         call find_maximum(law)
         if (law%found%is_converged) then
            limit = law%problem%ratio
            if (limit >= wanted) return
            call law%settle()
            step = max(growth*step, least_step)
         else
            law%point = reached
            law%family%faces = faces
            if (.not. limit > 0.0_wp) exit
            growth = 0.5_wp
            step = 0.5_wp*min(step, law%problem%ratio/limit - 1.0_wp)
            if (step < least_step .or. law%is_exhausted()) exit
            law%found = before
         end if
         law%problem%ratio = min(wanted, limit*(1.0_wp + step))
      end do
      law%problem%ratio = wanted
   end subroutine climb

   !> Says where a branch ends, as far as it was followed.
   subroutine refuse(law, branch, limit, error)
      type(sampled_objective), intent(in) :: law
      character(*), intent(in) :: branch
      real(wp), intent(in) :: limit   !! see `climb`
      type(error_type), allocatable, intent(out) :: error
      character(:), allocatable :: reason

      if (law%is_exhausted()) then
         reason = 'the search was given up after '//to_text(nint(1.0e-6_wp*law%effort))// &
                  ' million simulated values, its bound'
      else if (.not. limit > 0.0_wp) then
         reason = 'nothing was found on '//branch
      else if (limit < law%problem%ratio) then
         reason = branch//' ends at std/mean = '//to_text(floor(1.0e3_wp*limit)/1.0e3_wp)
         if (law%family%kind == by_symbol) reason = reason//' with positive symbols'
      else if (law%found%is_converged) then
         reason = 'K(m) does not fade within '//to_text(law%problem%n_lags)//' lags'
      else
         reason = 'the signs of K(m) do not come to rest'
      end if
      if (.not. law%problem%decay > 0.0_wp) &   ! else the first branch has said it
         reason = law%problem%name//': '//reason
      call raise(error, exit_no_solution, reason)
   end subroutine refuse

end module process_positive_search
