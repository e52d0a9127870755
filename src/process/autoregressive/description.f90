!> Properties of an autoregressive process by its coefficients: poles, autocovariance, correlation
!> lengths and entropy (Sec. 2.3).
module process_autoregressive_description
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_roots, only: find_polynomial_roots
   use process_autoregressive_model, only: autocovariance_of, innovation_std, &
                                           reflection_of
   use process_autoregressive_sums, only: correlation_sums, sum_correlation
   use process_correlation, only: correlation_length
   use process_model, only: gaussian_entropy, process_model_type
   implicit none(type, external)
   private
   public :: describe_ar

   integer, parameter :: max_stored_lags = 4096

contains

   !> Fills the model of the stationary process with a_q and b0. Stores K(m) until the largest pole
   !> leaves 1e-6 of K(0), but at most `max_stored_lags` lags. Fails if the poles are not found or
   !> the lengths need too many lags.
   subroutine describe_ar(a, b0, model, error, known_sums)
      real(wp), intent(in) :: a(:)   !! a_q, q = 1..order; stationary
      real(wp), intent(in) :: b0     !! [unit of X]
      type(process_model_type), intent(out) :: model
      type(error_type), allocatable, intent(out) :: error
      type(correlation_sums), intent(in), optional :: known_sums   !! computed if absent
      real(wp), parameter :: smallest_stored = 1.0e-6_wp   !! least |pole|^m
      type(correlation_sums) :: sums
      real(wp) :: kappa(size(a))
      integer :: n_lags

      kappa = reflection_of(a)
      if (present(known_sums)) then
         sums = known_sums
      else
         call sum_correlation(kappa, sums, error)
         if (allocated(error)) return
      end if
      call find_polynomial_roots(a, model%poles, error)
      if (allocated(error)) return
      model%order = size(a)
      model%a = a
      model%b0 = b0
      model%std = b0/innovation_std(kappa, 1.0_wp)
      n_lags = size(a)
      if (any(abs(model%poles) > 0.0_wp)) &
         n_lags = max(n_lags, ceiling(min(real(max_stored_lags, wp), &
                                          log(smallest_stored)/log(abs(model%poles(1))))))
      allocate (model%autocovariance(0:n_lags), model%autocovariance_error(0:n_lags), source=0.0_wp)
      model%autocovariance(:) = model%std**2*autocovariance_of(kappa, n_lags)
      model%l0 = sums%l0
      model%l1 = sums%l1
      model%l0_cut = correlation_length('L0', model%autocovariance(:size(a)))
      model%l1_cut = correlation_length('L1', model%autocovariance(:size(a)))
      model%entropy = gaussian_entropy(b0)
      model%entropy_bound = gaussian_entropy(model%std)
   end subroutine describe_ar

end module process_autoregressive_description
