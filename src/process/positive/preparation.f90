!> From a request to a law that can be sampled: its targets, and the linear companion whose noise is
!> its own.
module process_positive_preparation
   use core_error, only: error_type, exit_bad_input, exit_no_solution, raise
   use core_kinds, only: wp
   use core_random, only: stream_type
   use core_text, only: to_text
   use process_autoregressive_fit, only: describe_ar, optimal_reflection
   use process_autoregressive_model, only: autocovariance_of, coefficients_of, innovation_std, &
      reflection_of
   use process_autoregressive_spectral_factor, only: symbol_of_process
   use process_autoregressive_sums, only: correlation_sums, sum_correlation
   use process_direct_fit, only: fit_direct
   use process_model, only: process_model_type, process_request
   use process_positive_law, only: exact_law, n_batches, positive_law, sequential_law
   use process_positive_moments, only: new_batches
   use process_positive_numbers, only: new_shared_numbers
   use process_positive_sequential, only: memory_of
   use process_positive_truncated_normal, only: fit_truncated_normal
   implicit none(type, external)
   private
   public :: prepare_law

contains

   !> The law of a request or, by the sampler's name, the other one, with targets, a first guess of
   !> mu, and a companion: the unconstrained process of the wanted length.
   subroutine prepare_law(request, sampler, stream, law, kappa, error)
      type(process_request), intent(in) :: request
      character(*), intent(in) :: sampler
      type(stream_type), intent(in) :: stream
      class(positive_law), allocatable, intent(out) :: law
      real(wp), allocatable, intent(out) :: kappa(:)   !! of the companion
      type(error_type), allocatable, intent(out) :: error
      type(process_model_type) :: unconstrained
      type(correlation_sums) :: sums
      real(wp), allocatable :: g(:), rho(:)
      real(wp) :: b0, mu, sigma
      integer :: m, n_single

      select case (sampler)
      case ('sequential')
         allocate (sequential_law :: law)
         law%max_lags = 4000
      case ('exact')
         allocate (exact_law :: law)
         law%power = 2
         law%max_lags = 600
         law%longest = 10.0_wp*(1.0_wp + 1.0e-9_wp)   ! sweeps grow with its square
      case default
         call raise(error, exit_bad_input, "sampler = '"//sampler// &
                    "': must be 'sequential' or 'exact'")
         return
      end select
      call fit_truncated_normal(request%mean, request%std, mu, sigma, error)
      if (allocated(error) .and. request%mean > 0.0_wp .and. request%correlation_length > 0.0_wp) &
         call raise(error, exit_no_solution, 'positive process with std/mean = '// &
                    to_text(request%std/request%mean)//': K(m) >= 0 needs std < mean')
      if (allocated(error)) return
      call solve_unconstrained(request, unconstrained, error)
      if (allocated(error)) return
      kappa = reflection_of(unconstrained%a)
      law%companion = unconstrained%a
      if (request%method == 'direct') then
         g = symbol_of_process(unconstrained%a, 1.0_wp)
         law%symbol = g(2:)/g(1)
         law%cut = request%order
      end if
      call sum_correlation(kappa, sums, error)
      if (allocated(error)) return
      law%correlation = request%correlation
      law%wanted_ratio = request%std/request%mean
      law%wanted_length = request%correlation_length
      law%wanted_l0 = sums%l0
      law%n_lags = max(size(kappa), memory_of(unconstrained%poles, 1.0e-4_wp))
      if (law%n_lags > law%max_lags .or. law%wanted_l0 > law%longest) then
         call raise(error, exit_no_solution, 'positive process ('//sampler//' law) with '// &
                    request%correlation//' = '//to_text(request%correlation_length)// &
                    ', order = '//to_text(request%order)//': '//to_text(law%n_lags)// &
                    ' lags count; the sequential law is sampled to 4000 of them, the exact one '// &
                    'to 600 and to L0 = 10; order 1 is solved without sampling')
         return
      end if
      rho = autocovariance_of(kappa, law%n_lags)
      law%tail_l0 = sums%l0 - sum(abs(rho(2:)))
      law%tail_moment = sums%l1*(1.0_wp + sums%l0) - sum([(m*abs(rho(m + 1)), m=1, law%n_lags)])
      allocate (law%companion_autocovariance(0:law%n_lags))
      law%companion_autocovariance(:) = rho/innovation_std(kappa, 1.0_wp)**2
      ! a first guess: the univariate law, with the innovations of the companion
      b0 = sigma*innovation_std(kappa, 1.0_wp)
      law%coordinate = mu/b0*(1.0_wp + sum(law%companion))**law%power
      law%centre = request%mean/b0
      law%memory = ceiling(1.5_wp*memory_of(unconstrained%poles, 1.0e-9_wp))
      law%numbers = new_shared_numbers(stream)
      n_single = max(request%order, law%cut)
      if (any(rho(n_single + 2:) < 0.0_wp)) n_single = law%n_lags
      law%batches = new_batches(law%n_lags, min(n_single, law%n_lags), n_batches)
   end subroutine prepare_law

   !> The process without sign constraint, by the request's method.
   subroutine solve_unconstrained(request, model, error)
      type(process_request), intent(in) :: request
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      type(process_request) :: unsigned
      real(wp), allocatable :: kappa(:)

      if (request%method == 'direct') then
         unsigned = request
         unsigned%positive = .false.
         call fit_direct(unsigned, model)
         if (.not. model%is_solved) call raise(error, exit_no_solution, model%reason)
      else
         call optimal_reflection(request%correlation, request%correlation_length, request%order, &
                                 kappa, error)
         if (allocated(error)) return
         call describe_ar(coefficients_of(kappa), 1.0_wp, model, error)
      end if
   end subroutine solve_unconstrained

end module process_positive_preparation
