!> Positive processes of higher order by continuation from order 1, which every order contains: with
!> K(m) >= 0 beyond the end of the unconstrained optimum's shape, and with K(m) whose sign changes
!> with every lag.
!>
!> With K(m) >= 0 the unknowns are atanh(kappa_m): 1 + sum a_q is the product of 1 + kappa_m, and
!> a maximum at 0, where the field alone holds values back, is approached as one of them grows.
!>
!> No Gaussian process need have alternating K(m): the sequential law is searched in its a_q, Eq.
!> (25) in the row of G, which may be indefinite; positive values alone keep both finite. A maximum
!> often lies where the law is about to lose that: where every other value could just grow. There
!> one coefficient follows from the others.
module process_positive_branches
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream
   use core_text, only: rounded_text, to_text
   use numerics_constrained_maximum, only: maximize, search_result, solve_along
   use process_model, only: process_request
   use process_positive_family, only: by_coefficients, by_precision, free, &
                                      parameter_family
   use process_positive_first_order, only: find_limit, match_branch
   use process_positive_kernel, only: first_order_law
   use process_positive_moments, only: positive_moments
   use process_positive_objective, only: new_objective, sampled_objective
   use process_positive_problem, only: new_problem, sampled_problem
   use process_positive_signs, only: compare_signs
   implicit none(type, external)
   private
   public :: adopt_signs, climb, search_branches, sharpen

   integer, parameter :: shape_steps = 128      !! of a batch during the search
   integer, parameter :: zero_steps = 1024      !! of a batch where some K(m) = 0
   integer, parameter :: sharp_steps = 2048     !! of a batch where few have not been enough
   integer, parameter :: max_iterations = 40    !! of a search
   real(wp), parameter, public :: branch_difference = 1.0e-5_wp   !! step of a difference
   real(wp), parameter :: acceptable = 1.0e-3_wp   !! gradient of the entropy left
   real(wp), parameter :: least_step = 0.004_wp    !! relative, of std/mean towards a limit

contains

   !> Searches by continuation from order 1, after a search in the unconstrained optimum's shape has
   !> failed: the maximum with K(m) >= 0 or, with branch = 'any' and where that has ended, the
   !> alternating one. Where some K(m) have changed their sign on the way, that of the larger
   !> entropy. Not by the direct method, whose orders do not contain each other.
   subroutine search_branches(request, seed, law, error)
      type(process_request), intent(in) :: request   !! of order 2 or more
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(inout) :: law   !! that has failed; its effort is counted on
      type(error_type), allocatable, intent(inout) :: error   !! of that search; or none
      type(error_type), allocatable :: failure
      type(sampled_objective) :: trial
      character(:), allocatable :: message
      integer :: branch

      if (request%method == 'direct' .or. request%correlation == 'both' .or. &
          error%exit_code /= exit_no_solution .or. .not. request%mean > 0.0_wp) return
      message = error%message
      trial%effort = law%effort
      trial%most_effort = law%most_effort
      do branch = 1, merge(2, 1, request%branch == 'any')
         if (branch == 1 .and. request%std >= request%mean) cycle
         call continue_first_order(request, seed, branch == 2, trial, failure)
         law%effort = trial%effort
         if (.not. allocated(failure)) then
            if (.not. allocated(error)) then
               if (relative_entropy(trial) < relative_entropy(law)) return
            end if
            law = trial
            if (allocated(error)) deallocate (error)
            if (branch == 2 .or. all(law%signs > 0.0_wp)) return
         else
            if (failure%message == message) return
            if (index(message, failure%message) == 0) message = message//'; '//failure%message
         end if
         if (law%is_exhausted()) exit
      end do
      if (allocated(error)) call raise(error, exit_no_solution, message)
   end subroutine search_branches

   !> Entropy of x/std at the point of the last evaluation.
   function relative_entropy(law) result(entropy)
      type(sampled_objective), intent(inout) :: law
      real(wp) :: entropy
      real(wp) :: unused

      call law%find_entropy(entropy, unused)
      entropy = entropy - log(law%last%moments%std)
   end function relative_entropy

   !> Finds the maximum of one branch; fails with the std/mean at which it ends.
   subroutine continue_first_order(request, seed, is_alternating, law, error)
      type(process_request), intent(in) :: request   !! of order 2 or more
      integer(long), intent(in) :: seed
      logical, intent(in) :: is_alternating
      type(sampled_objective), intent(inout) :: law   !! at first its effort and bound alone
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: inside = 0.97_wp   ! of the limit of order 1, beyond it
      real(wp), allocatable :: autocovariance(:), signs(:)
      integer, allocatable :: lags(:)
      type(process_request) :: one
      type(first_order_law) :: first
      character(:), allocatable :: reason, signs_wanted
      real(wp) :: decay, limit, reached, wanted
      integer :: attempt, highest, pass
      logical :: is_at_rest
      integer, parameter :: max_passes = 4

      wanted = request%std/request%mean
      one = request
      one%order = 1
      call find_limit(one, is_alternating, limit, error)
      if (allocated(error)) return
      one%std = request%mean*merge(wanted, inside*limit, wanted < limit)
      limit = 0.0_wp
      call match_branch(one, is_alternating, first, error)
      if (allocated(error)) return
      do attempt = 1, 2
         call rise_to_order(request, seed, first, merge(1, request%order, attempt == 1), law, &
                            highest, error)
         if (allocated(error)) return
         call climb(law, one%std/request%mean, wanted, reached)
         limit = max(limit, reached)
         if (law%found%is_converged .or. attempt == 2 .or. .not. is_alternating .or. &
             law%is_exhausted()) exit
      end do
      decay = first%memory
      is_at_rest = .true.
      do pass = 1, max_passes
         if (law%found%is_converged) then
            call adopt_signs(law, autocovariance)
            is_at_rest = law%found%is_converged
         end if
         if (.not. law%found%is_converged) exit
         if (.not. is_alternating .or. fades(law%signs*autocovariance)) return
         if (pass == max_passes) exit
         decay = sqrt(decay)   ! lags of twice the memory
         signs = law%signs
         lags = law%zeros
         call begin_law(request, seed, decay, wanted, law, error)
         if (allocated(error)) return
         law%signs(:size(signs) - 1) = signs
         call law%hold_at_zero(lags)
         call law%settle()
         call find_maximum(law)
      end do
      signs_wanted = trim(merge('alternating K(m)', 'K(m) >= 0       ', is_alternating))
      if (law%is_exhausted()) then
         reason = 'the search was given up at its bound of values'
      else if (.not. is_at_rest) then
         reason = 'the signs of K(m) do not come to rest'
      else if (limit >= wanted) then
         reason = 'K(m) does not fade within '//to_text(law%problem%n_lags)//' lags'
      else if (limit > 0.0_wp) then
         reason = signs_wanted//' ends at std/mean = '//to_text(floor(1.0e3_wp*limit)/1.0e3_wp)
      else
         reason = signs_wanted//' at std/mean = '//rounded_text(one%std/one%mean, 6)// &
                  ' was found to order '//to_text(highest)//' only'
      end if
      call raise(error, exit_no_solution, 'followed from order 1, '//reason)
   end subroutine continue_first_order

   !> Raises the law of order 1 by maxima of order 2, 4, 8, .. to a start in the wanted order.
   subroutine rise_to_order(request, seed, first, most_faces, law, highest, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(first_order_law), intent(in) :: first
      integer, intent(in) :: most_faces   !! see `parameter_family`
      type(sampled_objective), intent(inout) :: law
      integer, intent(out) :: highest   !! order whose maximum was found
      type(error_type), allocatable, intent(out) :: error
      type(process_request) :: lower
      type(parameter_family) :: family
      type(positive_moments) :: moments
      type(search_result) :: found
      real(wp), allocatable :: start(:)
      integer :: n

      found = law%found   ! that an earlier search in the wanted order left is of use there
      law%found = search_result()
      lower = request
      lower%order = 1
      highest = 1
      law%family%kind = free
      law%family%most_faces = most_faces
      law%family%faces = [integer ::]
      law%point = [-atanh(first%r), asinh(first%field)]
      if (first%r < 0.0_wp) then
         law%family%kind = merge(by_precision, by_coefficients, request%sampler == 'exact')
         law%point(1) = -first%r
      end if
      law%last%moments%mean = first%mean
      law%last%moments%std = first%std
      do
         lower%order = min(2*lower%order, request%order)
         call begin_law(lower, seed, merge(first%memory, 0.0_wp, first%r < 0.0_wp), &
                        first%std/first%mean, law, error)
         if (allocated(error)) return
         n = size(law%point)
         law%point = [law%point(:n - 1), &
                      spread(0.0_wp, 1, lower%order + 1 - size(law%family%faces) - n), law%point(n)]
         call law%settle()
         if (lower%order == request%order) exit
         start = law%point
         family = law%family
         moments = law%last%moments
         call find_maximum(law)
         if (law%found%is_converged) then
            highest = lower%order
         else
            law%point = start
            law%family = family
            law%last%moments = moments
         end if
      end do
      law%found = found
   end subroutine rise_to_order

   !> Begins the law of a request in the family of another one, to be simulated from its moments;
   !> its effort is counted on.
   subroutine begin_law(request, seed, decay, ratio, law, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      real(wp), intent(in) :: decay     !! of K(m), where it alternates; else 0
      real(wp), intent(in) :: ratio     !! wanted std/mean
      type(sampled_objective), intent(inout) :: law
      type(error_type), allocatable, intent(out) :: error
      type(sampled_objective) :: before
      type(sampled_problem) :: problem

      call new_problem(request, new_stream(seed, label_of('positive process'), 0), problem, error, &
                       decay)
      if (allocated(error)) return
      problem%ratio = ratio
      before = law
      call new_objective(problem, law)
      law%point = before%point
      law%found = before%found
      law%effort = before%effort
      law%most_effort = before%most_effort
      law%family = before%family
      law%last%moments = before%last%moments
      law%n_steps = shape_steps
   end subroutine begin_law

   !> Climbs by maxima at larger and larger std/mean, from that of the start to the wanted one. In a
   !> given shape steps grow until one fails. Where maxima end before, the last is not converged.
   subroutine climb(law, start, wanted, limit)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(in) :: start, wanted
      real(wp), intent(out) :: limit   !! the largest std/mean that was met
      type(search_result) :: before
      real(wp), allocatable :: reached(:)
      real(wp) :: growth, step
      integer, allocatable :: faces(:)

      law%problem%ratio = start
      limit = 0.0_wp
      step = 0.04_wp   ! relative
      growth = merge(2.0_wp, 1.0_wp, law%family%has_given_shape())
      do
         reached = law%point
         faces = law%family%faces
         before = law%found
         call find_maximum(law)
         if (law%found%is_converged) then
            limit = law%problem%ratio
            if (limit >= wanted) return
            call law%settle()
            step = growth*step
         else
            law%point = reached
            law%family%faces = faces
            growth = 1.0_wp
            step = 0.5_wp*step
            if (step < least_step .or. .not. limit > 0.0_wp .or. law%is_exhausted()) return
            law%found = before
         end if
         law%problem%ratio = min(wanted, limit*(1.0_wp + step))
      end do
   end subroutine climb

   !> Finds the maximum in the interior, or on the faces that the search runs into. In a given shape
   !> it is, once one has been found, the point nearby that meets the targets.
   subroutine find_maximum(law)
      type(sampled_objective), intent(inout) :: law   !! begun with its metric, where that fits
      real(wp), parameter :: near = 0.05_wp
      real(wp), allocatable :: room(:)
      integer, parameter :: max_steps = 8
      real(wp), parameter :: farthest = 0.5_wp   ! beyond, it may be one of another branch
      real(wp), allocatable :: start(:)
      integer :: i, p

      if (law%family%has_given_shape() .and. allocated(law%found%jacobian)) then
         start = law%point
         call solve_along(law, acceptable, max_steps)
         law%found%is_converged = law%found%violation <= acceptable .and. &
                                  norm2(law%point - start) <= farthest
         return
      end if
      do
         call maximize(law, branch_difference, acceptable, max_iterations)
         if (law%found%is_converged .or. law%family%has_given_shape() .or. &
             law%family%kind == free .or. law%is_exhausted() .or. &
             size(law%family%faces) == law%family%most_faces .or. &
             size(law%point) <= law%n_constraints) return
         room = law%family%room(law%point)
         associate (faces => law%family%faces)
            room(faces) = huge(near)
            p = minloc(room, 1)
            if (room(p) > near) return
            i = count(faces < p)
         end associate
         law%point = [law%point(:p - i - 1), law%point(p - i + 1:)]
         law%family%faces = [law%family%faces(:i), p, law%family%faces(i + 1:)]
      end do
   end subroutine find_maximum

   !> Adopts the signs that K(m) have at the maximum and finds the maximum with them; not converged
   !> where they do not come to rest. Where K(m) >= 0 is wanted, or K(m) has the other sign with
   !> either one, K(m) = 0 is a constraint, as long as its multiplier does not pull K(m) to a side
   !> that is allowed.
   subroutine adopt_signs(law, autocovariance)
      type(sampled_objective), intent(inout) :: law
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags)
      integer, parameter :: max_passes = 12
      integer, parameter :: surer = 16   ! times as many steps tell the signs
      real(wp), allocatable :: pulls(:), reached(:), state(:)
      integer, allocatable :: lags(:)
      logical, allocatable :: is_held(:), is_wrong(:)
      integer :: n_steps, pass
      logical :: is_inside

      n_steps = law%n_steps
      allocate (is_held(size(law%signs)), source=law%problem%request%branch == 'nonnegative')
      do pass = 1, max_passes
         call compare_signs(law, surer*n_steps, autocovariance, is_wrong, is_inside, state)
         law%found%is_converged = is_inside
         if (.not. is_inside) return
         law%n_steps = n_steps
         is_wrong(law%zeros + 1) = .false.
         pulls = pulls_of(law, law%found%multipliers)
         lags = pack(law%zeros, abs(pulls) <= acceptable)
         if (any(is_wrong .and. is_held)) &   ! the others may follow
            lags = [lags, minloc(law%signs*autocovariance, 1, is_wrong .and. is_held) - 1]
         if (.not. (any(is_wrong) .or. any(abs(pulls) > acceptable))) exit
         law%found%is_converged = pass < max_passes
         if (.not. law%found%is_converged) return
         law%signs(law%zeros) = merge(sign(1.0_wp, pulls), law%signs(law%zeros), &
                                      abs(pulls) > acceptable)
         where (is_wrong .and. .not. is_held) law%signs = -law%signs
         is_held = is_held .or. is_wrong
         if (size(lags) > 0) law%n_steps = max(n_steps, zero_steps)
         reached = law%point
         do
            call law%hold_at_zero(lags)
            call law%keep_lags(merge(law%problem%n_single, law%problem%n_lags, &
                                     all(law%signs > 0.0_wp)))
            call find_maximum(law)
            if (law%found%is_converged .or. size(lags) < 2) exit
            lags = lags(size(lags):)   ! the newest alone
            law%point = reached
         end do
         if (.not. law%found%is_converged) return
      end do
      if (all(law%signs > 0.0_wp)) call law%keep_lags(law%problem%n_single)
   end subroutine adopt_signs

   !> Gain of entropy as a K(m)/K(0) that is held at 0 grows to an allowed side, with the sign of
   !> that side; 0: none. With w the gain by the targets as |K(m)|/K(0) grows, and T that by
   !> K(m)/K(0) and the targets together, it is s T - w on the side of s.
   function pulls_of(law, multipliers) result(pulls)
      type(sampled_objective), intent(in) :: law
      real(wp), intent(in) :: multipliers(:)   !! of ratio, length or lengths, zeros
      real(wp) :: pulls(size(law%zeros))
      real(wp) :: lengths(2), total, weight
      integer :: i, m, n_targets

      n_targets = law%n_constraints - size(law%zeros)
      associate (moments => law%last%moments, request => law%problem%request)
         lengths = 0.0_wp   ! multipliers of L0 and L1
         lengths(merge(2, 1, request%correlation == 'L1')) = &
            multipliers(2)/request%correlation_length
         if (n_targets == 3) lengths(2) = multipliers(3)/request%second_length
         do i = 1, size(pulls)
            m = law%zeros(i)
            weight = lengths(1) + lengths(2)*(m - moments%l1)/(1.0_wp + moments%l0)
            total = law%signs(m)*weight + multipliers(n_targets + i)
            pulls(i) = max(total - weight, 0.0_wp)
            if (-total - weight > pulls(i) .and. request%branch /= 'nonnegative') &
               pulls(i) = total + weight
         end do
      end associate
   end function pulls_of

   !> Finds the maximum on more simulated values than before, with the signs that K(m) have there.
   subroutine sharpen(law)
      type(sampled_objective), intent(inout) :: law
      real(wp), parameter :: allowance = 2.0e9_wp   ! see `most_effort`
      real(wp), allocatable :: unused(:)
      real(wp) :: bound

      bound = law%most_effort
      law%most_effort = law%effort + allowance
      law%n_steps = sharp_steps
      call law%settle()
      call find_maximum(law)
      if (law%found%is_converged) call adopt_signs(law, unused)
      law%most_effort = bound
   end subroutine sharpen

   !> True if hardly anything is left of K(m) at the last lags.
   pure function fades(k) result(is_so)
      real(wp), intent(in) :: k(0:)
      logical :: is_so

      associate (n => ubound(k, 1))
         is_so = abs(sum(k(n - n/5:))) <= 5.0e-3_wp*sum(k(1:))
      end associate
   end function fades

end module process_positive_branches
