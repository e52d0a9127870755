!> Autoregressive processes: coefficients, reflection coefficients, autocovariance, poles (Sec.
!> 2.3).
!>
!> Eq. (39): z_n = b0 w_n - sum a_q z_(n-q). The reflection coefficient kappa_m is the last
!> coefficient of the best predictor of order m; all in (-1, 1) is the same as all poles inside the
!> unit circle.
module process_ar_model
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_roots, only: find_polynomial_roots
   implicit none(type, external)
   private
   public :: coefficients_of, reflection_of, innovation_std, step_up
   public :: autocovariance_of, yule_walker_autocovariance, yule_walker_coefficients, find_poles

contains

   !> a_q from the reflection coefficients, upwards through the orders (Levinson).
   pure function coefficients_of(kappa) result(a)
      real(wp), intent(in) :: kappa(:)   !! kappa_m, m = 1..order
      real(wp) :: a(size(kappa))         !! a_q, q = 1..order
      integer :: m

      do m = 1, size(kappa)
         call step_up(a, m, kappa(m))
      end do
   end function coefficients_of

   !> The best predictor of one order more (Levinson).
   pure subroutine step_up(a, order, kappa)
      real(wp), intent(inout) :: a(:)   !! its first order - 1 entries in, order out
      integer, intent(in) :: order      !! the new one
      real(wp), intent(in) :: kappa     !! its reflection coefficient

      a(:order - 1) = a(:order - 1) + kappa*a(order - 1:1:-1)
      a(order) = kappa
   end subroutine step_up

   !> Reflection coefficients from a_q, downwards. The first that is not inside (-1, 1) ends it: the
   !! process is not stationary, and the lower ones stay zero.
   pure function reflection_of(a) result(kappa)
      real(wp), intent(in) :: a(:)
      real(wp) :: kappa(size(a))
      real(wp) :: lower(size(a))
      integer :: m

      lower = a
      kappa = 0.0_wp
      do m = size(a), 1, -1
         kappa(m) = lower(m)
         if (.not. abs(kappa(m)) < 1.0_wp) return
         lower(:m - 1) = (lower(:m - 1) - kappa(m)*lower(m - 1:1:-1))/(1.0_wp - kappa(m)**2)
      end do
   end function reflection_of

   !> b0 of the process with standard deviation `std`: b0^2 = std^2 prod(1 - kappa^2).
   pure function innovation_std(kappa, std) result(b0)
      real(wp), intent(in) :: kappa(:)
      real(wp), intent(in) :: std   !! sigma_Z
      real(wp) :: b0

      b0 = std*sqrt(product((1.0_wp - kappa)*(1.0_wp + kappa)))
   end function innovation_std

   !> K(m)/K(0), m = 0..n_lags, from reflection coefficients: Eq. (41) solved order by order.
   pure function autocovariance_of(kappa, n_lags) result(correlation)
      real(wp), intent(in) :: kappa(:)
      integer, intent(in) :: n_lags
      real(wp) :: correlation(0:n_lags)
      real(wp) :: a(size(kappa)), error_variance
      integer :: m, order

      order = size(kappa)
      correlation(0) = 1.0_wp
      error_variance = 1.0_wp
      do m = 1, min(order, n_lags)
         correlation(m) = -kappa(m)*error_variance &
                          - dot_product(a(:m - 1), correlation(m - 1:1:-1))
         call step_up(a, m, kappa(m))
         error_variance = error_variance*(1.0_wp - kappa(m)**2)
      end do
      do m = order + 1, n_lags
         correlation(m) = -dot_product(a, correlation(m - 1:m - order:-1))
      end do
   end function autocovariance_of

   !> Eq. (41) forwards: K(m), m = 0..n_lags. Fails where the process is not stationary.
   pure subroutine yule_walker_autocovariance(a, b0, n_lags, autocovariance, error)
      real(wp), intent(in) :: a(:), b0
      integer, intent(in) :: n_lags
      real(wp), allocatable, intent(out) :: autocovariance(:)   !! (0:n_lags) [unit of Z squared]
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: kappa(size(a))
      integer :: m

      kappa = reflection_of(a)
      do m = 1, size(a)
         if (.not. abs(kappa(m)) < 1.0_wp) then
            call raise(error, exit_bad_input, 'autoregressive process of order '// &
                       to_text(size(a))//': reflection coefficient '//to_text(m)//' = '// &
                       to_text(kappa(m))//': must lie inside (-1, 1), or it is not stationary')
            return
         end if
      end do
      allocate (autocovariance(0:n_lags))
      autocovariance(:) = (b0/innovation_std(kappa, 1.0_wp))**2*autocovariance_of(kappa, n_lags)
   end subroutine yule_walker_autocovariance

   !> Eq. (41) backwards: a_q and b0 from K(0..order). Fails where K is not positive definite.
   pure subroutine yule_walker_coefficients(autocovariance, order, a, b0, error)
      real(wp), intent(in) :: autocovariance(0:)   !! at least to lag `order`
      integer, intent(in) :: order
      real(wp), allocatable, intent(out) :: a(:)
      real(wp), intent(out) :: b0
      type(error_type), allocatable, intent(out) :: error
      real(wp) :: kappa, variance
      integer :: m

      allocate (a(order))
      variance = autocovariance(0)
      b0 = 0.0_wp
      do m = 1, order
         if (variance > 0.0_wp) then
            kappa = -(autocovariance(m) &
                      + dot_product(a(:m - 1), autocovariance(m - 1:1:-1)))/variance
         else
            kappa = 1.0_wp
         end if
         call step_up(a, m, kappa)
         variance = variance*(1.0_wp - kappa)*(1.0_wp + kappa)
      end do
      if (variance > 0.0_wp) then
         b0 = sqrt(variance)
      else
         call raise(error, exit_bad_input, 'autocovariance to lag '//to_text(order)// &
                    ': must be positive definite')
      end if
   end subroutine yule_walker_coefficients

   !> Poles of Eq. (40), by descending modulus.
   subroutine find_poles(a, poles, error)
      real(wp), intent(in) :: a(:)
      complex(wp), allocatable, intent(out) :: poles(:)   !! (order)
      type(error_type), allocatable, intent(out) :: error

      call find_polynomial_roots(a, poles, error)
   end subroutine find_poles

end module process_ar_model
