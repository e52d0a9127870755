!> The search for a positive process of higher order, on simulated values: first the shape of the
!> unconstrained optimum, then every coefficient free.
!>
!> Coefficients of that shape are made stronger and stronger, mu always such that the length is the
!> wanted one: std/mean grows towards a limit, reached as mu runs away to minus infinity (without
!> correlation it is the exponential law's, 1).
module process_positive_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream
   use core_text, only: rounded_text, to_text
   use numerics_constrained_maximum, only: maximize, search_result
   use numerics_root_search, only: new_root_search, root_search
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_request
   use process_positive_branches, only: adopt_signs
   use process_positive_family, only: by_symbol, free, law_estimate
   use process_positive_objective, only: new_objective, sampled_objective
   use process_positive_moments, only: estimate_autocovariance, positive_moments
   use process_positive_problem, only: new_problem, sampled_problem
   use process_positive_refinement, only: refine, shape_spread
   use process_positive_signs, only: require_signs
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: approach, find_shape

   integer, parameter :: quick_steps = 128     !! of a batch on the way to a first solution
   integer, parameter :: limit_steps = 1024    !! of a batch where std/mean may end
   integer, parameter :: shape_steps = 128     !! of a batch while the shape is sought
   real(wp), parameter :: farthest = 0.7_wp    !! ln factor, without following the family
   real(wp), parameter :: close_enough = 1.0e-5_wp  !! relative, of ratio and length on the way
   !> gradient of the entropy left: wanted, accepted, and over its largest component
   real(wp), parameter :: wanted = 1.0e-4_wp, acceptable = 1.0e-3_wp, stationary = 0.02_wp
   integer, parameter :: max_iterations = 60        !! of the search for the shape

   !> relative, of the wanted length along the family
   real(wp), parameter :: length_tolerance = 1.0e-3_wp

contains

   !> Finds the unconstrained optimum of another length that has the targets under the law, on few
   !> simulated values: `point` is (ln factor, coordinate). Fails where that family ends before.
   subroutine approach(request, seed, law, point, found, error, most_effort, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(out) :: law
      real(wp), allocatable, intent(out) :: point(:)
      type(search_result), intent(out) :: found
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: most_effort   !! see `sampled_objective`
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      real(wp), parameter :: steep = 0.9_wp   ! std/mean of a start
      character(:), allocatable :: reason
      type(sampled_problem) :: problem
      real(wp), allocatable :: state(:)
      real(wp) :: b0, centre, coordinate, far_point(2), limit, mu, sigma, std
      logical :: is_inside, is_reached
      type(search_result) :: far

      std = request%std
      if (has_negative(sequence)) std = min(std, steep*request%mean)   ! it may exceed the mean
      call fit_truncated_normal(request%mean, std, mu, sigma, error)
      if (allocated(error) .and. request%mean > 0.0_wp) &
         call raise(error, exit_no_solution, 'positive process with std/mean = '// &
                    rounded_text(std/request%mean, 6)//': K(m) >= 0 needs std < mean')
      if (allocated(error)) return
      call new_problem(request, request%sampler, new_stream(seed, label_of('positive process'), &
                                                            0), problem, error, sequence=sequence)
      if (allocated(error)) return
      b0 = sigma/sqrt(problem%autocovariance(0))   ! a guess, with the companion's innovations
      coordinate = mu/b0*(1.0_wp + sum(problem%companion))**merge(2, 1, problem%is_exact)
      centre = request%mean/b0
      call new_objective(problem, law)
      if (present(most_effort)) law%most_effort = most_effort
      law%centre = centre
      point = [0.0_wp, asinh(coordinate)]
      law%n_steps = quick_steps
      call law%settle(point)
      call maximize(law, point, law%n_constraints, 1.0e-4_wp, close_enough, 12, found)
      ! far from the unconstrained optimum another branch may have the targets too: it is taken only
      ! where the family that is followed from there ends before them
      if (found%violation > close_enough .or. point(1) > farthest) then
         far = found
         far_point = point
         point = [0.0_wp, asinh(coordinate)]
         law%n_steps = limit_steps
         call follow_family(law, point, limit, is_reached)
         if (is_reached) then
            call maximize(law, point, law%n_constraints, 1.0e-4_wp, close_enough, 20, found)
         else if (far%violation <= close_enough) then
            point = far_point
            found = far
            law%centre = centre   ! where the family's end has left it, chains begin far off
            law%n_steps = quick_steps
            call law%evaluate(point, state, is_inside)
         else if (.not. law%is_exhausted()) then
            reason = ': nothing was found with the shape of the unconstrained optimum'
            if (limit > 0.0_wp) &
               reason = ': with the shape of the unconstrained optimum std/mean ends at '// &
                        to_text(floor(1.0e3_wp*limit)/1.0e3_wp)
            call raise(error, exit_no_solution, problem%name//reason)
            return
         end if
      end if
      found%is_converged = found%violation <= close_enough
      call require_converged(law, found, error)
   end subroutine approach

   pure logical function has_negative(sequence)
      type(sequence_solution), intent(in), optional :: sequence

      has_negative = .false.
      if (present(sequence)) has_negative = any(sequence%s < 0.0_wp)
   end function has_negative

   !> Finds the maximum with every coefficient free. The direct method's form is that of the maximum
   !> already.
   subroutine find_shape(law, point, found, error, spread)
      type(sampled_objective), intent(inout) :: law
      real(wp), allocatable, intent(inout) :: point(:)
      type(search_result), intent(inout) :: found
      type(error_type), allocatable, intent(out) :: error
      type(shape_spread), intent(out), optional :: spread   !! wanted where the shape is to be used
      logical :: is_near

      law%n_steps = shape_steps
      if (law%family%kind == by_symbol) return
      is_near = point(1) <= farthest
      if (law%problem%correlation == 'both') law%n_constraints = 3   ! a shape of its own has room
      law%family%factor = merge(exp(point(1)), 1.0_wp, is_near)
      point = [exp(point(1))/law%family%factor*law%family%direction, point(2)]
      law%family%kind = free
      call free_shape(law, point, found, error, spread)
      if (.not. allocated(error)) call require_converged(law, found, error)
   end subroutine find_shape

   !> Finds the maximum from a point with every coefficient free. Where correlation is so weak that
   !> the entropy does not feel its shape above the noise of the sample, the shape of the
   !> unconstrained optimum is kept, with the residual it leaves.
   subroutine free_shape(law, point, found, error, spread)
      type(sampled_objective), intent(inout) :: law
      real(wp), allocatable, intent(inout) :: point(:)
      type(search_result), intent(out) :: found
      type(error_type), allocatable, intent(out) :: error
      type(shape_spread), intent(out), optional :: spread
      real(wp), parameter :: weak = 0.02_wp, feeble = 0.001_wp   !! largest reflection coefficient
      real(wp), allocatable :: autocovariance(:), standard_error(:)
      real(wp) :: family(size(point)), step, strength
      integer :: order
      logical :: is_free

      order = size(point) - 1
      family = point
      call law%settle(point)
      strength = maxval(abs(tanh(point(:order))))
      step = min(1.0e-5_wp, 0.01_wp*strength)
      is_free = strength > feeble
      if (is_free) then
         call maximize(law, point, law%n_constraints, step, min(wanted, stationary*strength), &
                       max_iterations, found)
         found%is_converged = max(found%violation, found%residual) &
                              <= min(acceptable, stationary*strength)
      end if
      if (is_free .and. found%is_converged) then
         call estimate_autocovariance(law%last%batches, law%known, order, &
                                      autocovariance, standard_error)
         if (strength > weak) call require_signs(law, autocovariance, standard_error, error)
         if (allocated(error)) then
            deallocate (error)
            call adopt_signs(law, point, found, autocovariance)
            if (.not. found%is_converged) return
         end if
      end if
      if (is_free .and. strength <= weak) then
         call estimate_autocovariance(law%last%batches, law%known, order, &
                                      autocovariance, standard_error)
         associate (companion => law%known(0:order))
            is_free = found%is_converged .and. &
                      all(autocovariance*sign(1.0_wp, companion) > -4.0_wp*standard_error)
         end associate
      end if
      if (.not. is_free) then
         point = family
         call maximize(law, point, law%n_constraints, step, huge(1.0_wp), 1, found)
      else if (found%is_converged .and. present(spread)) then
         call refine(law, step, point, found, spread)
      end if
   end subroutine free_shape

   subroutine require_converged(law, found, error)
      type(sampled_objective), intent(in) :: law
      type(search_result), intent(in) :: found
      type(error_type), allocatable, intent(out) :: error

      if (found%is_converged) return
      if (law%is_exhausted()) then
         call raise(error, exit_no_solution, law%problem%name// &
                    ': the search was given up after '//to_text(nint(1.0e-6_wp*law%effort))// &
                    ' million simulated values, its bound')
      else
         call raise(error, exit_no_solution, law%problem%name//': the search ended '// &
                    to_text(found%violation)//' (relative) from its targets, with '// &
                    to_text(found%residual)//' of the gradient left')
      end if
   end subroutine require_converged

   !> Follows the family until it has the wanted ratio: `point` (ln factor, coordinate) is then near
   !> the solution. Where it ends before, `limit` is the largest std/mean met, less its error; it
   !> begins where the sample's noise leaves a mu for the wanted length.
   subroutine follow_family(law, point, limit, is_reached)
      type(sampled_objective), intent(inout) :: law   !! with a shape
      real(wp), intent(inout) :: point(2)
      real(wp), intent(out) :: limit
      logical, intent(out) :: is_reached
      integer, parameter :: max_doublings = 7
      real(wp), parameter :: certainly = 3.0_wp   ! standard errors
      real(wp), parameter :: nearest = 1.0e-3_wp
      type(law_estimate) :: there
      real(wp) :: inner(2), outer(2), ratio
      integer :: i
      logical :: has_begun, is_found, is_process

      limit = 0.0_wp
      has_begun = .false.
      is_reached = .false.
      point(1) = log(1.02_wp)
      there%g = law%last%g
      outer = point
      do i = 1, max_doublings
         inner = outer
         if (i > 1) outer(1) = 2.0_wp*outer(1)
         if (.not. has_begun) outer(2) = point(2)
         do   ! a symbol that grows ends where it touches zero
            call law%family%unfold(outer, there, is_process)
            if (is_process .or. outer(1) - inner(1) <= nearest) exit
            outer(1) = 0.5_wp*(inner(1) + outer(1))
         end do
         call match_length(law, outer, ratio, is_found)
         if (.not. is_found .and. .not. has_begun) cycle
         if (.not. is_found) exit
         is_reached = ratio >= law%problem%ratio
         if (is_reached .or. ratio < limit) exit   ! it grows to its limit, or has a maximum
         limit = ratio - certainly*law%last%moments%ratio_error
         has_begun = .true.
      end do
      if (.not. is_reached) return
      do i = 1, merge(6, 0, has_begun)   ! halve the stretch in which the ratio is passed
         point = 0.5_wp*(inner + outer)
         call match_length(law, point, ratio, is_found)
         if (ratio >= law%problem%ratio .or. .not. is_found) then
            outer = point
         else
            inner = point
         end if
      end do
      point = outer
   end subroutine follow_family

   !> Finds the coordinate that gives the wanted length at this factor, and std/mean there. The
   !> length grows with mu, up to that of the Gaussian. Where there is none the moments stay those
   !> of before, from which the next chains start.
   subroutine match_length(law, point, ratio, is_found)
      type(sampled_objective), intent(inout) :: law
      real(wp), intent(inout) :: point(2)
      real(wp), intent(out) :: ratio
      logical, intent(out) :: is_found
      integer, parameter :: max_steps = 20
      type(root_search) :: search
      type(positive_moments) :: before
      real(wp), allocatable :: state(:)
      logical :: is_inside
      integer :: i

      before = law%last%moments
      call law%settle(point)
      search = new_root_search(0.25_wp)
      ratio = 0.0_wp
      do i = 1, max_steps
         call law%evaluate(point, state, is_inside)
         if (.not. is_inside) exit
         ratio = law%last%moments%ratio
         is_found = abs(state(2)) <= length_tolerance
         if (is_found) return
         call search%advance(point(2), state(2))
      end do
      is_found = .false.
      law%last%moments = before
   end subroutine match_length

end module process_positive_search
