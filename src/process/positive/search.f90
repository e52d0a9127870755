!> The search for a positive process of higher order, on simulated values: first the shape of the
!> unconstrained optimum, then every coefficient free.
!>
!> Where that shape is not found at once it is followed from a smaller std/mean on, with the wanted
!> length: coefficients grow and mu falls, towards a limit of std/mean that is reached as mu runs
!> away to minus infinity (without correlation it is the exponential law's, 1).
module process_positive_search
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream
   use core_text, only: rounded_text, to_text
   use numerics_constrained_maximum, only: maximize, search_result
   use process_direct_sign_sequence, only: sequence_solution
   use process_model, only: process_request
   use process_positive_branches, only: adopt_signs, climb
   use process_positive_family, only: free
   use process_positive_objective, only: new_objective, sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   use process_positive_problem, only: new_problem, sampled_problem
   use process_positive_refinement, only: refine, shape_spread
   use process_positive_signs, only: require_signs
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: approach, find_shape

   integer, parameter :: search_steps = 128    !! of a batch
   real(wp), parameter :: farthest = 0.7_wp    !! ln factor, without following the family
   real(wp), parameter :: close_enough = 1.0e-5_wp  !! relative, of ratio and length on the way
   !> gradient of the entropy left: wanted, accepted, and over its largest component
   real(wp), parameter :: wanted = 1.0e-4_wp, acceptable = 1.0e-3_wp, stationary = 0.02_wp
   integer, parameter :: max_iterations = 60        !! of the search for the shape

contains

   !> Finds the unconstrained optimum of another length that has the targets under the law, on few
   !> simulated values: the point is (ln factor, coordinate). Fails where that family ends before.
   subroutine approach(request, seed, law, error, most_effort, sequence)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_objective), intent(out) :: law
      type(error_type), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: most_effort   !! see `sampled_objective`
      type(sequence_solution), intent(in), optional :: sequence   !! see `new_problem`
      real(wp), parameter :: steep = 0.9_wp   ! std/mean of a start
      integer, parameter :: most_halvings = 3
      character(:), allocatable :: reason
      type(sampled_problem) :: problem
      type(search_result) :: far
      real(wp) :: far_point(2), limit, ratio
      real(wp), allocatable :: unused(:)
      integer :: i
      logical :: is_inside

      ratio = request%std/request%mean
      call begin(ratio)
      if (allocated(error)) return
      call maximize(law, 1.0e-4_wp, close_enough, 12)
      ! far from the unconstrained optimum another branch may have the targets too: it is taken only
      ! where the family that is followed from there ends before them
      if (law%found%violation > close_enough .or. law%point(1) > farthest) then
         far = law%found
         far_point = law%point
         do i = 1, most_halvings
            call begin(0.5_wp**i*ratio)
            law%found = search_result()
            call climb(law, 0.5_wp**i*ratio, ratio, limit)
            if (limit > 0.0_wp .or. law%is_exhausted()) exit
         end do
         law%problem%ratio = ratio
         if (limit >= ratio) then
            call maximize(law, 1.0e-4_wp, close_enough, 20)
         else if (far%violation <= close_enough) then
            call begin(ratio)
            law%point = far_point
            law%found = far
            call law%evaluate(law%point, unused, is_inside)
         else if (.not. law%is_exhausted()) then
            reason = ': nothing was found with the shape of the unconstrained optimum'
            if (limit > 0.0_wp) &
               reason = ': with the shape of the unconstrained optimum std/mean ends at '// &
                        to_text(floor(1.0e3_wp*limit)/1.0e3_wp)
            call raise(error, exit_no_solution, law%problem%name//reason)
            return
         end if
      end if
      law%found%is_converged = law%found%violation <= close_enough
      call require_converged(law, error)

   contains

      !> Begins at the unconstrained optimum, with the field of independent values of a std/mean.
      subroutine begin(ratio_there)
         real(wp), intent(in) :: ratio_there
         real(wp) :: b0, mu, sigma, std

         std = ratio_there*request%mean
         if (present(sequence)) then   ! std may exceed the mean
            if (any(sequence%s < 0.0_wp)) std = min(std, steep*request%mean)
         end if
         call fit_truncated_normal(request%mean, std, mu, sigma, error)
         if (allocated(error) .and. request%mean > 0.0_wp) &
            call raise(error, exit_no_solution, 'positive process with std/mean = '// &
                       rounded_text(ratio, 6)//': K(m) >= 0 needs std < mean')
         if (allocated(error)) return
         if (.not. allocated(law%point)) then
            call new_problem(request, new_stream(seed, label_of('positive process'), 0), problem, &
                             error, sequence=sequence)
            if (allocated(error)) return
            call new_objective(problem, law)
            if (present(most_effort)) law%most_effort = most_effort
            law%n_steps = search_steps
         end if
         b0 = sigma/sqrt(problem%autocovariance(0))   ! a guess, with the companion's innovations
         law%point = [0.0_wp, &
                      asinh(mu/b0*(1.0_wp + sum(problem%companion))**merge(2, 1, problem%is_exact))]
         law%last%moments%std = 0.0_wp   ! nothing is known yet
         law%centre = request%mean/b0
         call law%settle()
      end subroutine begin

   end subroutine approach

   !> Finds the maximum with every coefficient free.
   subroutine find_shape(law, spread, error)
      type(sampled_objective), intent(inout) :: law
      type(shape_spread), intent(out) :: spread
      type(error_type), allocatable, intent(out) :: error

      law%n_steps = search_steps
      if (law%problem%request%correlation == 'both') law%n_constraints = 3   ! a shape has room
      associate (factor => exp(law%point(1)), is_near => law%point(1) <= farthest)
         law%family%factor = merge(factor, 1.0_wp, is_near)
         law%point = [factor/law%family%factor*law%family%direction, law%point(2)]
      end associate
      law%family%kind = free
      call free_shape(law, spread, error)
      if (.not. allocated(error)) call require_converged(law, error)
   end subroutine find_shape

   !> Finds the maximum from a point with every coefficient free. Where correlation is so weak that
   !> the entropy does not feel its shape above the noise of the sample, the shape of the
   !> unconstrained optimum is kept, with the residual it leaves.
   subroutine free_shape(law, spread, error)
      type(sampled_objective), intent(inout) :: law
      type(shape_spread), intent(out) :: spread
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: weak = 0.02_wp, feeble = 0.001_wp   !! largest reflection coefficient
      real(wp), allocatable :: autocovariance(:), standard_error(:)
      real(wp) :: family(size(law%point)), step, strength
      integer :: order
      logical :: is_free

      order = size(family) - 1
      family = law%point
      call law%settle()
      strength = maxval(abs(tanh(family(:order))))
      step = min(1.0e-5_wp, 0.01_wp*strength)
      is_free = strength > feeble
      if (is_free) then
         call maximize(law, step, min(wanted, stationary*strength), max_iterations)
         law%found%is_converged = max(law%found%violation, law%found%residual) &
                                  <= min(acceptable, stationary*strength)
         is_free = law%found%is_converged .or. strength > weak
      end if
      if (is_free .and. law%found%is_converged) then
         call estimate_autocovariance(law%last%batches, law%known, order, &
                                      autocovariance, standard_error)
         if (strength > weak) then
            call require_signs(law, autocovariance, standard_error, error)
         else
            is_free = all(autocovariance*sign(1.0_wp, law%known(0:order)) > -4.0_wp*standard_error)
         end if
         if (allocated(error)) then
            deallocate (error)
            call adopt_signs(law, autocovariance)
            if (.not. law%found%is_converged) return
         end if
      end if
      if (.not. is_free) then
         law%point = family
         law%found = search_result()
         call maximize(law, step, huge(1.0_wp), 1)
      else if (law%found%is_converged) then
         call refine(law, step, spread)
      end if
   end subroutine free_shape

   subroutine require_converged(law, error)
      type(sampled_objective), intent(in) :: law
      type(error_type), allocatable, intent(out) :: error

      if (law%found%is_converged) return
      if (law%is_exhausted()) then
         call raise(error, exit_no_solution, law%problem%name// &
                    ': the search was given up after '//to_text(nint(1.0e-6_wp*law%effort))// &
                    ' million simulated values, its bound')
      else
         call raise(error, exit_no_solution, law%problem%name//': the search ended '// &
                    to_text(law%found%violation)//' (relative) from its targets, with '// &
                    to_text(law%found%residual)//' of the gradient left')
      end if
   end subroutine require_converged

end module process_positive_search
