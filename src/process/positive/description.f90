!> Results of a fitted positive process in the unit of X, and moments of the other law with the same
!> parameters.
module process_positive_description
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_roots, only: find_polynomial_roots
   use process_correlation, only: correlation_length, zero_correlation
   use process_model, only: process_model_type, process_request, take_law, take_other_law
   use process_positive_moments, only: error_of_residual
   use process_positive_objective, only: sampled_objective
   use process_positive_problem, only: is_out_of_reach
   use process_positive_refinement, only: shape_uncertainty
   use process_positive_sequential, only: memory_of
   use process_positive_signs, only: require_signs
   implicit none(type, external)
   private
   public :: compare_laws, describe_far_from_zero, describe_solution, describe_evaluation

contains

   !> Describes the process without sign constraint as a positive one, if its mean is so large that
   !> no value is negative: both laws are then the same, and every value is accepted.
   subroutine describe_far_from_zero(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(inout) :: model   !! solved

      model%request = request
      model%memory = ceiling(1.5_wp*memory_of(abs(model%poles(1)), 1.0e-9_wp))
      associate (k => model%autocovariance(1:), variance => model%autocovariance(0))
         model%branch = branch_of(merge(-1.0_wp, 1.0_wp, k < -zero_correlation*variance))
      end associate
      model%other = model%process_moments
   end subroutine describe_far_from_zero

   !> Describes the last evaluation in the unit of X: parameters, moments, entropy.
   subroutine describe_evaluation(search, model)
      type(sampled_objective), intent(inout) :: search
      type(process_model_type), intent(inout) :: model

      model%request = search%problem%request
      model%order = model%request%order
      call search%find_entropy()
      call take_law(search%last%moments, model%request%std, model)
      associate (last => search%last)
         if (allocated(last%a)) then
            model%a = last%a
            model%mu = model%b0*last%field &
                       /(1.0_wp + sum(last%a))**merge(2, 1, search%problem%is_exact)
         else
            allocate (model%a(0), model%g(0:model%order))
            model%g(:) = last%g/model%b0**2
            model%mu = model%b0*last%field/(last%g(0) + 2.0_wp*sum(last%g(1:)))
         end if
      end associate
      model%memory = search%problem%memory
      model%branch = branch_of(search%signs(1:))
   end subroutine describe_evaluation

   !> Name of the branch with these signs of K(m), m = 1..
   pure function branch_of(signs) result(branch)
      real(wp), intent(in) :: signs(:)
      character(:), allocatable :: branch

      branch = 'mixed'
      if (all(signs > 0.0_wp)) branch = 'nonnegative'
      if (all(signs(::2) < 0.0_wp) .and. all(signs(2::2) > 0.0_wp)) branch = 'alternating'
   end function branch_of

   !> Describes the solution in the unit of X. Fails where a K(m) has not the assumed sign.
   subroutine describe_solution(search, uncertainty, model, error)
      type(sampled_objective), intent(inout) :: search
      type(shape_uncertainty), intent(in) :: uncertainty
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: by_shape(2)
      integer :: m

      call describe_lags(search, uncertainty, model, error)
      if (allocated(error)) return
      call describe_evaluation(search, model)
      by_shape = uncertainty%length_errors()
      model%l0_error = hypot(model%l0_error, by_shape(1))
      model%l1_error = hypot(model%l1_error, by_shape(2))
      model%entropy_error = error_of_maximum(search)
      if (allocated(search%last%a)) then
         call find_polynomial_roots(model%a, model%poles, error)
         if (allocated(error)) return
      else
         allocate (model%poles(0))
      end if
      m = min(model%order, search%problem%n_lags)
      model%l0_cut = correlation_length('L0', model%autocovariance(0:m))
      model%l1_cut = correlation_length('L1', model%autocovariance(0:m))
   end subroutine describe_solution

   !> Standard error of the largest entropy [nat]: that of the law's entropy, and of its ratio and
   !> length, which are the wanted ones on the simulated values only. Both come from the same runs.
   real(wp) function error_of_maximum(search) result(standard_error)
      type(sampled_objective), intent(in) :: search   !! its entropy was found
      real(wp), allocatable :: residual(:)

      associate (from => search%last%moments%residuals, moments => search%last%moments)
         residual = from(:, 5)
         if (search%problem%is_exact) &
            residual = -0.5_wp*search%last%field*from(:, 1) - from(:, 2)/moments%ratio &
                       - from(:, 1)/moments%mean
      end associate
      associate (multipliers => search%found%multipliers)   ! gain of x/std by the constraints
         residual = residual - matmul(search%residuals(:, :size(multipliers)), multipliers)
      end associate
      standard_error = norm2([search%psi_error, error_of_residual(residual)])
   end function error_of_maximum

   !> Estimates the autocovariance lag by lag, on as many values as the number of lags allows. Fails
   !> where a K(m) has not the assumed sign.
   subroutine describe_lags(search, uncertainty, model, error)
      type(sampled_objective), intent(in) :: search
      type(shape_uncertainty), intent(in) :: uncertainty
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: affordable = 3000000   ! lags times steps of a batch: about a second
      type(sampled_objective) :: longer
      real(wp), allocatable :: state(:)
      real(wp) :: b0
      logical :: is_inside

      longer = search
      if (search%last%batches%n_single < search%problem%n_lags) then
         longer%n_steps = min(search%n_steps, max(affordable/search%problem%n_lags, 512))
         call longer%set_single_lags(search%problem%n_lags)
         call longer%evaluate(longer%point, state, is_inside)
      end if
      call longer%estimate_lags(search%problem%n_lags, model%autocovariance, &
                                model%autocovariance_error)
      call require_signs(search, model%autocovariance, model%autocovariance_error, error)
      if (allocated(error)) return
      b0 = search%problem%request%std/search%last%moments%std
      model%autocovariance(:) = b0**2*model%autocovariance
      model%autocovariance_error(:) = &
         b0**2*hypot(model%autocovariance_error, search%last%moments%std**2 &
                     *uncertainty%correlation_errors(search%problem%n_lags))
   end subroutine describe_lags

   !> Describes the process of the same a_q, b0 and mu under the other law, and the acceptances of
   !> both. Leaves it out where the exact law has too many lags or a too long burn-in, or where mu
   !> is outside the domain. Needs a_q: not for a law that is given by G.
   subroutine compare_laws(search, model)
      type(sampled_objective), intent(in) :: search
      type(process_model_type), intent(inout) :: model
      integer, parameter :: moment_steps = 1024, entropy_steps = 256   ! steps of a batch
      integer, parameter :: most_sweeps = 10000   ! sweeps of a burn-in: some seconds
      type(sampled_objective) :: other
      real(wp), allocatable :: state(:)
      real(wp) :: field
      logical :: is_inside

      other = search
      other%problem%is_exact = .not. search%problem%is_exact
      if (is_out_of_reach(other%problem)) return   ! not known
      field = model%mu/model%b0*(1.0_wp + sum(model%a))**merge(2, 1, other%problem%is_exact)
      other%point(size(other%point)) = asinh(field)
      other%n_steps = moment_steps
      other%last%moments%std = 0.0_wp   ! nothing is known yet
      call other%set_burn_in()
      if (other%problem%is_exact .and. other%n_burn_in > most_sweeps) return
      call other%evaluate(other%point, state, is_inside)
      if (.not. is_inside) return
      other%n_steps = entropy_steps
      call other%find_entropy()
      call take_other_law(other%last%moments, model)
   end subroutine compare_laws

end module process_positive_description
