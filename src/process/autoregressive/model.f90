!> Autoregressive processes: coefficients, reflection coefficients and autocovariance (Sec. 2.3).
!>
!> Eq. (39): z_n = b0 w_n - sum a_q z_(n-q). The reflection coefficient kappa_m is the last
!> coefficient of the best predictor of order m. All poles lie inside the unit circle if, and only
!> if, all kappa_m lie in (-1, 1).
module process_autoregressive_model
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: coefficients_of, reflection_of, innovation_std, step_up, autocovariance_of

contains

   !> Coefficients a_q from the reflection coefficients, order by order (Levinson).
   pure function coefficients_of(kappa) result(a)
      real(wp), intent(in) :: kappa(:)   !! kappa_m, m = 1..order
      real(wp) :: a(size(kappa))         !! a_q, q = 1..order
      integer :: m

      do m = 1, size(kappa)
         call step_up(a, m, kappa(m))
      end do
   end function coefficients_of

   !> Raises the best predictor by one order (Levinson).
   pure subroutine step_up(a, order, kappa)
      real(wp), intent(inout) :: a(:)   !! its first order - 1 entries in, order out
      integer, intent(in) :: order      !! new order
      real(wp), intent(in) :: kappa     !! reflection coefficient of the new order

      a(:order - 1) = a(:order - 1) + kappa*a(order - 1:1:-1)
      a(order) = kappa
   end subroutine step_up

   !> Reflection coefficients from a_q, from the highest order down. Those below one that is not in
   !> (-1, 1), for which the process is not stationary, are 0.
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

   !> Scale b0 of the innovations: b0^2 = std^2 prod(1 - kappa^2).
   pure real(wp) function innovation_std(kappa, std) result(b0)
      real(wp), intent(in) :: kappa(:)
      real(wp), intent(in) :: std   !! sigma_Z

      b0 = std*sqrt(product((1.0_wp - kappa)*(1.0_wp + kappa)))
   end function innovation_std

   !> K(m)/K(0), m = 0..n_lags, from reflection coefficients: Eq. (41) solved order by order.
   pure function autocovariance_of(kappa, n_lags) result(correlation)
      real(wp), intent(in) :: kappa(:)
      integer, intent(in) :: n_lags
      real(wp) :: correlation(0:n_lags)
      real(wp) :: a(size(kappa)), error_variance
      integer :: first, last, m, order

      order = size(kappa)
      correlation(0) = 1.0_wp
      error_variance = 1.0_wp
      do m = 1, min(order, n_lags)
         correlation(m) = -kappa(m)*error_variance &
                          - dot_product(a(:m - 1), correlation(m - 1:1:-1))
         call step_up(a, m, kappa(m))
         error_variance = error_variance*(1.0_wp - kappa(m)**2)
      end do
      ! adds K(m) to all lags it contributes to, which is faster than a dot_product for each lag
      correlation(order + 1:) = 0.0_wp
      do m = 1, n_lags - 1
         first = max(m, order) + 1
         last = min(m + order, n_lags)
         correlation(first:last) = correlation(first:last) - correlation(m)*a(first - m:last - m)
      end do
   end function autocovariance_of

end module process_autoregressive_model
