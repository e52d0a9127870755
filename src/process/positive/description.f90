!> Describes a fitted positive process in the unit of X, and the process of the other law with the
!> same parameters.
module process_positive_description
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_roots, only: find_polynomial_roots
   use process_correlation, only: correlation_length
   use process_entropy, only: gaussian_entropy
   use process_model, only: process_model_type, process_request
   use process_positive_objective, only: sampled_objective
   use process_positive_moments, only: estimate_autocovariance
   use process_positive_problem, only: is_out_of_reach
   use process_positive_refinement, only: error_of_runs, shape_spread
   use process_positive_sequential, only: memory_of
   use process_positive_signs, only: require_signs
   use process_positive_truncated_normal, only: lanes, log_sqrt_two_pi
   implicit none(type, external)
   private
   public :: compare_laws, describe_far_from_zero, describe_sampled, outline_sampled

contains

   !> Describes as a positive process the one without sign constraint whose values are hardly ever
   !> negative: both laws are its own, and every value is accepted.
   subroutine describe_far_from_zero(request, model)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(inout) :: model   !! solved
      real(wp), parameter :: zero = 1.0e-9_wp   ! of K(m)/K(0)

      model%request = request
      model%memory = ceiling(1.5_wp*memory_of(abs(model%poles(1)), 1.0e-9_wp))
      associate (k => model%autocovariance(1:), variance => model%autocovariance(0))
         model%branch = branch_of(merge(-1.0_wp, 1.0_wp, k < -zero*variance))
      end associate
      model%other_mean = model%mean
      model%other_std = model%std
      model%other_l0 = model%l0
      model%other_entropy = model%entropy
   end subroutine describe_far_from_zero

   !> Describes the last evaluation in the unit of X: parameters of realizations, moments, entropy.
   subroutine outline_sampled(law, model)
      type(sampled_objective), intent(inout) :: law
      type(process_model_type), intent(inout) :: model

      model%request = law%problem%request
      model%order = model%request%order
      model%std = model%request%std
      model%b0 = model%std/law%last%moments%std
      associate (last => law%last)
         if (allocated(last%a)) then
            model%a = last%a
            model%mu = model%b0*last%coordinate &
                       /(1.0_wp + sum(last%a))**merge(2, 1, law%problem%is_exact)
         else
            allocate (model%a(0), model%g(0:model%order))
            model%g(:) = last%g/model%b0**2
            model%mu = model%b0*last%coordinate/(last%g(0) + 2.0_wp*sum(last%g(1:)))
         end if
      end associate
      model%l0 = law%last%moments%l0
      model%l0_error = law%last%moments%l0_error
      model%l1 = law%last%moments%l1
      model%l1_error = law%last%moments%l1_error
      model%mean = model%b0*law%last%moments%mean
      model%mean_error = model%b0*law%last%moments%mean_error
      model%std_error = model%b0*law%last%moments%std_error
      model%memory = law%problem%memory
      model%branch = branch_of(law%signs(1:))
      call law%find_entropy(model%entropy, model%entropy_error)
      model%entropy = model%entropy + log(model%b0)
      model%entropy_bound = gaussian_entropy(model%std)
      call note_acceptances(law, model)
   end subroutine outline_sampled

   !> Name of the signs of K(m), m = 1..
   pure function branch_of(signs) result(branch)
      real(wp), intent(in) :: signs(:)
      character(:), allocatable :: branch

      branch = 'mixed'
      if (all(signs > 0.0_wp)) branch = 'nonnegative'
      if (all(signs(::2) < 0.0_wp) .and. all(signs(2::2) > 0.0_wp)) branch = 'alternating'
   end function branch_of

   !> Describes the solution in the unit of X.
   subroutine describe_sampled(law, spread, model, error)
      type(sampled_objective), intent(inout) :: law
      type(shape_spread), intent(in) :: spread
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: by_shape(2)
      integer :: m

      call outline_sampled(law, model)
      by_shape = spread%length_errors()
      model%l0_error = hypot(model%l0_error, by_shape(1))
      model%l1_error = hypot(model%l1_error, by_shape(2))
      model%entropy_error = error_of_maximum(law)
      if (allocated(law%last%a)) then
         call find_polynomial_roots(model%a, model%poles, error)
         if (allocated(error)) return
      else
         allocate (model%poles(0))
      end if
      call describe_lags(law, spread, model, error)
      if (allocated(error)) return
      m = min(model%order, law%problem%n_lags)
      model%l0_cut = correlation_length('L0', model%autocovariance(0:m))
      model%l1_cut = correlation_length('L1', model%autocovariance(0:m))
   end subroutine describe_sampled

   !> Standard error of the largest entropy under the wanted ratio and length: that of this law's
   !> entropy, and that its ratio and length are the wanted ones on the sample only. Both come from
   !> the same runs.
   function error_of_maximum(law) result(standard_error)
      type(sampled_objective), intent(in) :: law   !! its entropy was found
      real(wp) :: standard_error
      real(wp), allocatable :: rest(:)

      associate (from => law%last%moments%rests, moments => law%last%moments)
         rest = from(:, 5)
         if (law%problem%is_exact) &
            rest = -0.5_wp*law%last%coordinate*from(:, 1) - from(:, 2)/moments%ratio &
                   - from(:, 1)/moments%mean
      end associate
      associate (multipliers => law%found%multipliers)   ! gain of x/std by the constraints
         rest = rest - matmul(law%rests(:, :size(multipliers)), multipliers)
      end associate
      rest = sum(reshape(rest, [lanes, size(rest)/lanes]), dim=2)/size(rest)
      standard_error = norm2([law%psi_error, error_of_runs(reshape(rest, [lanes, 1]))])
   end function error_of_maximum

   !> Estimates the autocovariance lag by lag, on as many values as the number of lags allows. Fails
   !> where a K(m) clearly has not the sign by which the length was summed.
   subroutine describe_lags(law, spread, model, error)
      type(sampled_objective), intent(in) :: law
      type(shape_spread), intent(in) :: spread
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      integer, parameter :: affordable = 3000000   ! lags times steps of a batch: about a second
      type(sampled_objective) :: longer
      real(wp), allocatable :: state(:)
      logical :: is_inside

      longer = law
      longer%n_steps = min(law%n_steps, max(affordable/law%problem%n_lags, 512))
      call longer%keep_lags(law%problem%n_lags)
      call longer%evaluate(longer%point, state, is_inside)
      call estimate_autocovariance(longer%last%batches, law%known, law%problem%n_lags, &
                                   model%autocovariance, model%autocovariance_error)
      call require_signs(law, model%autocovariance, model%autocovariance_error, error)
      if (allocated(error)) return
      model%autocovariance(:) = model%b0**2*model%autocovariance
      model%autocovariance_error(:) = &
         model%b0**2*hypot(model%autocovariance_error, &
                           law%last%moments%std**2*spread%correlation_errors(law%problem%n_lags))
   end subroutine describe_lags

   !> Describes the process of the same a_q, b0 and mu under the other law, and the acceptances of
   !> both. The exact law is left out where it remembers more than its fits carry or forgets a start
   !> in too many sweeps, either where its mu is beyond what is sampled. Not for a law that is given
   !> by G alone.
   subroutine compare_laws(law, model)
      type(sampled_objective), intent(in) :: law
      type(process_model_type), intent(inout) :: model
      integer, parameter :: moment_steps = 1024, entropy_steps = 256   ! of a batch
      integer, parameter :: most_sweeps = 10000   ! of a burn-in: some seconds
      type(sampled_objective) :: other
      real(wp), allocatable :: state(:)
      real(wp) :: coordinate, unused
      logical :: is_inside

      other = law
      other%problem%is_exact = .not. law%problem%is_exact
      if (is_out_of_reach(other%problem)) return   ! not known
      coordinate = model%mu/model%b0*(1.0_wp + sum(model%a))**merge(2, 1, other%problem%is_exact)
      other%point(size(other%point)) = asinh(coordinate)
      other%n_steps = moment_steps
      other%last%moments%std = 0.0_wp   ! nothing is known yet
      call other%settle()
      if (other%problem%is_exact .and. other%n_burn_in > most_sweeps) return
      call other%evaluate(other%point, state, is_inside)
      if (.not. is_inside) return
      other%n_steps = entropy_steps
      call other%find_entropy(model%other_entropy, unused)
      model%other_entropy = model%other_entropy + log(model%b0)
      model%other_mean = model%b0*other%last%moments%mean
      model%other_std = model%b0*other%last%moments%std
      model%other_l0 = other%last%moments%l0
      call note_acceptances(other, model)
   end subroutine compare_laws

   !> Notes Lambda of the exact law, or the three acceptances of one-at-a-time rejection.
   subroutine note_acceptances(law, model)
      type(sampled_objective), intent(in) :: law   !! its entropy was found
      type(process_model_type), intent(inout) :: model

      if (.not. law%problem%is_exact) then
         model%acceptance_ratio = law%last%moments%acceptance_ratio
         model%acceptance_mean = law%last%moments%acceptance_mean
         model%acceptance_geometric = law%last%moments%acceptance_geometric
      else if (.not. (allocated(model%g) .or. law%problem%decay > 0.0_wp)) then
         model%lambda = exp(max(law%psi - log_sqrt_two_pi &
                                - 0.5_wp*law%last%coordinate*model%mu/model%b0, log(tiny(1.0_wp))))
         model%lambda_error = model%lambda*law%psi_error
      end if
   end subroutine note_acceptances

end module process_positive_description
