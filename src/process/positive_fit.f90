!> The positive process of given mean, std and correlation length with the largest entropy (Sec. 2.4.1),
!> for the law of one-at-a-time rejection.
!>
!> Its moments have no closed form. They are averages over simulated values, the same random numbers at
!> every trial, so that what is solved is a smooth problem; its answer differs from the true one by the
!> standard errors that are handed back.
module process_positive_fit
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: long, wp
   use core_random, only: label_of, new_stream, stream_type
   use numerics_constrained_maximum, only: maximize, objective_type, search_result, solve_along
   use process_ar_fit, only: describe_ar, optimal_reflection
   use process_ar_model, only: autocovariance_of, coefficients_of, innovation_std
   use process_ar_sums, only: correlation_sums, sum_correlation
   use process_correlation, only: correlation_length_l0, correlation_length_l1
   use process_entropy, only: white_noise_entropy
   use process_model, only: process_model_type, process_request
   use process_positive_moments, only: batch_averages, estimate_autocovariance, estimate_moments, &
      new_batches, positive_moments
   use process_positive_sequential, only: memory_of, sample_sequential
   use process_truncated_normal, only: fit_truncated_normal, lanes
   implicit none(type, external)
   private
   public :: fit_positive

   integer, parameter :: n_batches = 16*lanes
   integer, parameter :: shape_steps = 512     !! of a batch while the shape is sought
   integer, parameter :: final_steps = 8192    !! of a batch of the final solution
   integer, parameter :: max_lags = 2000
   real(wp), parameter :: matched = 1.0e-9_wp      !! relative, of ratio and length on the simulated values
   real(wp), parameter :: stationary = 1.0e-3_wp   !! largest gradient left of the flat entropy

   !> The sampled problem; points are atanh(kappa_m), m = 1..order, and mu over the Gaussian's std.
   type, extends(objective_type) :: sampled_law
      character(:), allocatable :: correlation
      real(wp) :: wanted_ratio = 0.0_wp              !! std/mean
      real(wp) :: wanted_length = 0.0_wp
      real(wp), allocatable :: shape(:)              !! allocated: points are (factor of this shape, mu/std)
      real(wp), allocatable :: companion(:)          !! coefficients of the linear companion
      real(wp), allocatable :: companion_autocovariance(:)   !! (0:n_lags), unit innovations
      real(wp) :: tail_l0 = 0.0_wp, tail_moment = 0.0_wp     !! of the companion's sums, beyond n_lags
      integer :: n_burn_in = 0
      integer :: n_steps = 0
      type(stream_type) :: stream
      type(batch_averages) :: batches                !! of the last evaluation
      type(positive_moments) :: moments
   contains
      procedure :: evaluate => evaluate_sampled
   end type sampled_law

contains

   !> Solves the request or says why not: `model%is_solved`, `model%reason`.
   subroutine fit_positive(request, seed, model)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(process_model_type), intent(out) :: model
      type(sampled_law) :: law
      type(search_result) :: found
      type(error_type), allocatable :: error
      real(wp), allocatable :: point(:)
      real(wp) :: violation

      model%request = request
      call prepare(request, seed, law, point, error)
      if (.not. allocated(error)) then
         call find_shape(law, point, found)
         law%n_steps = final_steps
         call solve_along(law, point, found%jacobian, found%metric, matched, 20, violation)
         call describe(request, law, point, model, error)
         model%optimality = found%residual
         model%is_solved = found%is_converged .and. violation <= matched
      end if
      if (allocated(error)) then
         model%is_solved = .false.
         model%reason = error%message
      end if
   end subroutine fit_positive

   !> The sampled problem and a first guess: the unconstrained optimum and the univariate law.
   subroutine prepare(request, seed, law, point, error)
      type(process_request), intent(in) :: request
      integer(long), intent(in) :: seed
      type(sampled_law), intent(out) :: law
      real(wp), allocatable, intent(out) :: point(:)
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: unconstrained
      type(correlation_sums) :: sums
      real(wp), allocatable :: kappa(:)
      real(wp) :: mu, sigma
      integer :: m, n_lags

      if (request%sampler /= 'sequential') then
         call raise(error, exit_bad_input, "sampler = '"//request%sampler//"': must be 'sequential'")
         return
      end if
      call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      if (allocated(error)) return
      call optimal_reflection(request%correlation, request%correlation_length, request%order, kappa, error)
      if (allocated(error)) return
      law%companion = coefficients_of(kappa)
      call describe_ar(law%companion, 1.0_wp, unconstrained, error)
      if (allocated(error)) return
      call sum_correlation(kappa, sums, error)
      if (allocated(error)) return
      law%correlation = request%correlation
      law%wanted_ratio = request%std/request%mean
      law%wanted_length = request%correlation_length
      n_lags = min(max(request%order, memory_of(unconstrained%poles, 1.0e-4_wp)), max_lags)
      allocate (law%companion_autocovariance(0:n_lags))
      law%companion_autocovariance(:) = autocovariance_of(kappa, n_lags)/innovation_std(kappa, 1.0_wp)**2
      associate (k => law%companion_autocovariance)
         law%tail_l0 = sums%l0 - sum(abs(k(1:)))/k(0)
         law%tail_moment = sums%l1*(1.0_wp + sums%l0) - sum([(m*abs(k(m)), m=1, n_lags)])/k(0)
      end associate
      law%n_burn_in = 3*memory_of(unconstrained%poles, 1.0e-9_wp)
      law%stream = new_stream(seed, label_of('positive_fit'), 0)
      law%batches = new_batches(n_lags, n_batches)
      point = [atanh(kappa), mu/sigma]
   end subroutine prepare

   !> First the unconstrained optimum of another length, then every coefficient free.
   subroutine find_shape(law, point, found)
      type(sampled_law), intent(inout) :: law
      real(wp), intent(inout) :: point(:)
      type(search_result), intent(out) :: found
      real(wp) :: reduced(2)
      integer :: order

      order = size(point) - 1
      law%n_steps = shape_steps
      law%shape = point(:order)
      reduced = [1.0_wp, point(order + 1)]
      call maximize(law, reduced, 2, 1.0e-4_wp, 1.0e-7_wp, 40, found)
      point = [reduced(1)*law%shape, reduced(2)]
      deallocate (law%shape)
      if (found%violation <= 1.0e-7_wp) call maximize(law, point, 2, 1.0e-4_wp, stationary, 40, found)
   end subroutine find_shape

   !> Entropy of x/std, and how far ratio and length are from what is wanted, relative.
   subroutine evaluate_sampled(self, point, value, constraints, is_inside)
      class(sampled_law), intent(inout) :: self
      real(wp), intent(in) :: point(:)
      real(wp), intent(out) :: value
      real(wp), intent(out) :: constraints(:)
      logical, intent(out) :: is_inside
      type(stream_type) :: stream
      real(wp), allocatable :: kappa(:)
      real(wp) :: centre, location, length

      if (allocated(self%shape)) then
         kappa = tanh(point(1)*self%shape)
      else
         kappa = tanh(point(:size(point) - 1))
      end if
      value = 0.0_wp
      constraints = 0.0_wp
      is_inside = all(abs(kappa) < 0.999_wp)
      if (.not. is_inside) return
      location = point(size(point))/innovation_std(kappa, 1.0_wp)
      centre = max(location, 0.5_wp)
      stream = self%stream
      call sample_sequential(coefficients_of(kappa), location, self%companion, centre, self%n_burn_in, &
                             ubound(self%companion_autocovariance, 1), self%n_steps, stream, self%batches)
      self%moments = estimate_moments(self%batches, self%companion_autocovariance, self%tail_l0, self%tail_moment)
      length = merge(self%moments%l0, self%moments%l1, self%correlation == 'L0')
      value = self%moments%entropy
      constraints = [self%moments%ratio/self%wanted_ratio - 1.0_wp, length/self%wanted_length - 1.0_wp]
   end subroutine evaluate_sampled

   !> What was found, in the unit of X.
   subroutine describe(request, law, point, model, error)
      type(process_request), intent(in) :: request
      type(sampled_law), intent(in) :: law
      real(wp), intent(in) :: point(:)
      type(process_model_type), intent(inout) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: gaussian
      real(wp), allocatable :: kappa(:)
      real(wp) :: b0
      integer :: m

      kappa = tanh(point(:size(point) - 1))
      b0 = request%std/law%moments%std
      call describe_ar(coefficients_of(kappa), b0, gaussian, error)
      if (allocated(error)) return
      model%order = request%order
      model%a = gaussian%a
      model%b0 = b0
      model%mu = b0*point(size(point))/innovation_std(kappa, 1.0_wp)
      model%poles = gaussian%poles
      call estimate_autocovariance(law%batches, law%companion_autocovariance, model%autocovariance, &
                                   model%autocovariance_error)
      model%autocovariance(:) = b0**2*model%autocovariance
      model%autocovariance_error(:) = b0**2*model%autocovariance_error
      model%l0 = law%moments%l0
      model%l0_error = law%moments%l0_error
      model%l1 = law%moments%l1
      model%l1_error = law%moments%l1_error
      associate (k => model%autocovariance)
         m = min(request%order, ubound(k, 1))
         model%l0_cut = correlation_length_l0(k(0:m))
         model%l1_cut = correlation_length_l1(k(0:m))
      end associate
      model%mean = b0*law%moments%mean
      model%mean_error = b0*law%moments%mean_error
      model%std = request%std
      model%std_error = b0*law%moments%std_error
      model%entropy = law%moments%entropy + log(request%std)
      model%entropy_error = law%moments%entropy_error
      model%entropy_bound = white_noise_entropy(request%std)
      model%acceptance_ratio = law%moments%acceptance_ratio
      model%acceptance_mean = law%moments%acceptance_mean
      model%acceptance_geometric = law%moments%acceptance_geometric
   end subroutine describe

end module process_positive_fit
