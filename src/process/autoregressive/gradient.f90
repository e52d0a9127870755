!> How the infinite correlation lengths change with the reflection coefficients.
!>
!> Derivatives are with respect to x_m = atanh(kappa_m). The lags that `sum_correlation` marched
!> through are differentiated backwards, lag by lag and order by order (the adjoint of Levinson's
!> recursion), at the cost of two marches; closed forms are differentiated as such.
module process_autoregressive_gradient
   use core_kinds, only: wp
   use process_autoregressive_model, only: autocovariance_of, step_up
   use process_autoregressive_sums, only: correlation_sums, log_spectral_ratios, mirror
   implicit none(type, external)
   private
   public :: lag_sum_gradient, length_gradient

contains

   !> Gradient of L0 or L1. Where a K(m) is zero the length has a kink, and this is one side's
   !! slope.
   pure function length_gradient(correlation, kappa, sums) result(gradient)
      character(*), intent(in) :: correlation      !! 'L0' or 'L1'
      real(wp), intent(in) :: kappa(:)             !! kappa_m, m = 1..order
      type(correlation_sums), intent(in) :: sums   !! of this very process
      real(wp) :: gradient(size(kappa))            !! d length/d atanh(kappa_m)
      real(wp) :: constant, folded(size(kappa)), slope
      real(wp), allocatable :: rho(:)

      ! d L0 = sum d|rho|,  d L1 = sum (m - L1) d|rho|/(1 + L0)
      constant = 1.0_wp
      slope = 0.0_wp
      if (correlation == 'L1') then
         constant = -sums%l1/(1.0_wp + sums%l0)
         slope = 1.0_wp/(1.0_wp + sums%l0)
      end if
      folded = kappa
      if (sums%is_mirrored) folded = mirror(kappa)
      allocate (rho(0:max(sums%n_lags, size(kappa))))
      rho(:) = autocovariance_of(folded, ubound(rho, 1))
      gradient = lag_sum_gradient(folded, rho, weights_of(rho(1:), sums%is_closed, constant, slope))
      if (sums%is_closed) gradient = gradient + closed_gradient(folded, constant, slope)
      if (sums%is_mirrored) gradient = mirror(gradient)
   end function length_gradient

   !> Gradient in atanh(kappa) of sum (constant + slope m) rho(m), signed and infinite.
   pure function closed_gradient(kappa, constant, slope) result(gradient)
      real(wp), intent(in) :: kappa(:), constant, slope
      real(wp) :: gradient(size(kappa))
      real(wp) :: log_r(0:size(kappa)), moment, v(0:size(kappa) - 1)
      integer :: j, order

      order = size(kappa)
      log_r = log_spectral_ratios(kappa)
      v = log_r(order) - log_r(:order - 1)
      moment = sum(sinh(v))
      do j = 1, order
         moment = moment + cosh(v(j - 1))
         gradient(j) = -exp(log_r(order))*(constant + slope*moment)
      end do
   end function closed_gradient

   !> Weights of rho(m), m = 1.., in sum (constant + slope m) |rho(m)| or in what the negative ones
   !! add to closed forms.
   pure function weights_of(rho, is_closed, constant, slope) result(weights)
      real(wp), intent(in) :: rho(:), constant, slope
      logical, intent(in) :: is_closed
      real(wp) :: weights(size(rho))
      integer :: m

      weights = [(constant + slope*m, m=1, size(rho))]
      if (is_closed) then
         weights = merge(-2.0_wp*weights, 0.0_wp, rho < 0.0_wp)
      else
         weights = merge(-weights, weights, rho < 0.0_wp)
      end if
   end function weights_of

   !> Gradient in atanh(kappa) of sum weights(m) rho(m).
   pure function lag_sum_gradient(kappa, rho, weights) result(gradient)
      real(wp), intent(in) :: kappa(:)
      real(wp), intent(in) :: rho(0:)       !! K(m)/K(0) of this very process, to the order at least
      real(wp), intent(in) :: weights(:)    !! m = 1.. of as many lags
      real(wp) :: gradient(size(kappa))
      real(wp) :: a(size(kappa), 0:size(kappa))      ! (q, order): predictors of all orders
      real(wp) :: a_bar(size(kappa))                 ! _bar: the sum's derivative by it
      real(wp) :: variance(0:size(kappa)), variance_bar
      real(wp), allocatable :: rho_bar(:)
      integer :: m, order, q

      order = size(kappa)
      a = 0.0_wp
      variance(0) = 1.0_wp
      do m = 1, order
         a(:, m) = a(:, m - 1)
         call step_up(a(:, m), m, kappa(m))
         variance(m) = variance(m - 1)*(1.0_wp - kappa(m)**2)
      end do
      allocate (rho_bar(0:size(weights)), source=[0.0_wp, weights])
      a_bar = 0.0_wp
      do m = size(weights), order + 1, -1
         do q = 1, order
            a_bar(q) = a_bar(q) - rho_bar(m)*rho(m - q)
            rho_bar(m - q) = rho_bar(m - q) - rho_bar(m)*a(q, order)
         end do
      end do
      variance_bar = 0.0_wp
      do m = order, 1, -1
         gradient(m) = a_bar(m) + dot_product(a_bar(:m - 1), a(m - 1:1:-1, m - 1)) &
                       - 2*kappa(m)*variance(m - 1)*variance_bar - variance(m - 1)*rho_bar(m)
         a_bar(:m - 1) = a_bar(:m - 1) + kappa(m)*a_bar(m - 1:1:-1) - rho_bar(m)*rho(m - 1:1:-1)
         variance_bar = variance_bar*(1.0_wp - kappa(m)**2) - kappa(m)*rho_bar(m)
         rho_bar(m - 1:1:-1) = rho_bar(m - 1:1:-1) - rho_bar(m)*a(:m - 1, m - 1)
      end do
      gradient = gradient*(1.0_wp - kappa)*(1.0_wp + kappa)
   end function lag_sum_gradient

end module process_autoregressive_gradient
