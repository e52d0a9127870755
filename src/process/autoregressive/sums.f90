!> Correlation lengths of an autoregressive process, summed to infinity, and their derivatives: Eqs.
!> (8), (9) and (41).
!>
!> Sums of K(m) with its sign are closed forms in the reflection coefficients. With R_0 = 1 and
!>    R_m = R_(m-1) (1 - kappa_m)/(1 + kappa_m),
!>    1 + 2 sum rho(m) = R_M,    2 sum m rho(m) = R_M sum_(m<M) sinh(ln R_M - ln R_m):
!> the step-up recursion of the predictor at frequency 0, and its derivative. If the largest pole is
!> real and positive, only finitely many K(m) are negative, and only these are summed. Otherwise
!> |K(m)| is summed until Cauchy's estimate bounds the remainder.
!>
!> Derivatives are with respect to atanh(kappa_m): of the closed forms, and of sums over lags by the
!> adjoint of Levinson's recursion, at the cost of two evaluations.
module process_autoregressive_sums
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_elementary, only: exp_minus_one
   use numerics_roots, only: find_polynomial_roots
   use process_autoregressive_model, only: autocovariance_of, coefficients_of, innovation_std, &
                                           step_up
   use process_correlation, only: correlation_length
   implicit none(type, external)
   private
   public :: correlation_sums, sum_correlation, positive_sums, log_spectral_ratios
   public :: lag_sum_gradient, positive_gradient

   !> Correlation lengths of a process, and whether K(m) >= 0.
   type :: correlation_sums
      real(wp) :: l0 = 0.0_wp                 !! Eq. (8) [lags]
      real(wp) :: l1 = 0.0_wp                 !! Eq. (9) [lags]
      logical :: is_nonnegative = .false.     !! K(m) >= 0, or (-1)^m K(m) >= 0, at all lags
   end type correlation_sums

   real(wp), parameter :: largest_remainder = 1.0e-18_wp     !! upper limit of the rest of the sum
   integer, parameter :: max_lags = 20000000           !! lags of a sum: some seconds
   integer, parameter :: n_circles = 31                !! circles in Cauchy's estimate

contains

   !> Sums |K(m)| and m |K(m)| over all lags, K(0) = 1. Fails if more than `max_lags` lags are
   !> needed: with poles near the circle, of which the largest is not real.
   subroutine sum_correlation(kappa, sums, error)
      real(wp), intent(in) :: kappa(:)   !! all inside (-1, 1)
      type(correlation_sums), intent(out) :: sums
      type(error_type), allocatable, intent(out) :: error
      complex(wp), allocatable :: poles(:)
      real(wp) :: canonical_image(size(kappa)), n_certain, n_negligible
      integer :: order

      order = findloc(abs(kappa) > 0.0_wp, .true., dim=1, back=.true.)   ! 0: white noise
      sums%is_nonnegative = .true.
      if (order == 0) return
      canonical_image = kappa
      call find_polynomial_roots(coefficients_of(canonical_image(:order)), poles, error)
      if (allocated(error)) return
      if (poles(1)%re < 0.0_wp .and. .not. abs(poles(1)%im) > 0.0_wp) then
         canonical_image(1::2) = -kappa(1::2)   ! (-1)^m K(m) has the same sums
         poles = -poles
      end if
      n_certain = first_lag_of_one_sign(canonical_image(:order), poles)
      n_negligible = first_negligible_lag(canonical_image(:order), poles)
      if (.not. min(n_certain, n_negligible) < max_lags) then
         call raise(error, exit_no_solution, 'correlation length of an autoregressive process '// &
                    'of order '//to_text(order)//' with largest pole '//to_text(abs(poles(1)))// &
                    ': more than '//to_text(max_lags)//' lags count')
         return
      end if
      call sum_lags(canonical_image(:order), ceiling(min(n_certain, n_negligible)), &
                    n_certain <= n_negligible, sums)
   end subroutine sum_correlation

   !> ln R_m, m = 0..order; R_m is the spectral density of order m at frequency 0 over the variance.
   pure function log_spectral_ratios(kappa) result(log_r)
      real(wp), intent(in) :: kappa(:)
      real(wp) :: log_r(0:size(kappa))
      integer :: m

      log_r(0) = 0.0_wp
      do m = 1, size(kappa)
         log_r(m) = log_r(m - 1) - 2.0_wp*atanh(kappa(m))
      end do
   end function log_spectral_ratios

   !> Correlation lengths of a process with K(m) >= 0 at every lag, by the closed forms.
   pure type(correlation_sums) function positive_sums(kappa) result(sums)
      real(wp), intent(in) :: kappa(:)
      real(wp) :: log_r(0:size(kappa))

      log_r = log_spectral_ratios(kappa)
      associate (last => log_r(size(kappa)))
         sums%is_nonnegative = .true.
         sums%l0 = 0.5_wp*exp_minus_one(last)
         sums%l1 = 0.5_wp*exp(last)*sum(sinh(last - log_r(:size(kappa) - 1)))/(1.0_wp + sums%l0)
      end associate
   end function positive_sums

   !> Sums |K(m)| lag by lag, or with `is_closed` adds negative K(m) to the closed forms.
   pure subroutine sum_lags(kappa, n_lags, is_closed, sums)
      real(wp), intent(in) :: kappa(:)
      integer, intent(in) :: n_lags
      logical, intent(in) :: is_closed   !! all K(m) >= 0 beyond these lags
      type(correlation_sums), intent(out) :: sums
      real(wp) :: moment, negative
      real(wp), allocatable :: rho(:)
      integer :: m

      allocate (rho(0:max(n_lags, size(kappa))))
      rho(:) = autocovariance_of(kappa, ubound(rho, 1))
      negative = -sum(rho, rho < 0.0_wp)
      if (is_closed) then
         sums = positive_sums(kappa)
         moment = sums%l1*(1.0_wp + sums%l0) &
                  - 2.0_wp*sum([(min(m*rho(m), 0.0_wp), m=1, ubound(rho, 1))])
         sums%l0 = sums%l0 + 2.0_wp*negative
         sums%l1 = moment/(1.0_wp + sums%l0)
      else
         sums%l0 = correlation_length('L0', rho)
         sums%l1 = correlation_length('L1', rho)
         ! or the negative part of (-1)^m K(m); K(m) = 0 has either sign by rounding
         negative = min(negative, sum(max(rho(1::2), 0.0_wp)) - sum(min(rho(2::2), 0.0_wp)))
      end if
      sums%is_nonnegative = negative <= 100*epsilon(1.0_wp)*sums%l0
   end subroutine sum_lags

   !> Lag from which K(m) > 0: the residue of the largest pole, if it is real and positive, exceeds
   !> Cauchy's estimate of all others on a circle between it and them. Huge if there is none.
   pure real(wp) function first_lag_of_one_sign(kappa, poles) result(lag)
      real(wp), intent(in) :: kappa(:)
      complex(wp), intent(in) :: poles(:)   !! poles by descending modulus
      real(wp) :: inner, largest, log_residue, radius
      integer :: i

      lag = huge(1.0_wp)
      largest = poles(1)%re
      if (abs(poles(1)%im) > 0.0_wp .or. largest <= 0.0_wp .or. largest >= 1.0_wp) return
      inner = 1.0e-8_wp*largest
      if (size(poles) > 1) inner = max(inner, abs(poles(2)))
      if (.not. inner < largest) return
      log_residue = 2.0_wp*log(innovation_std(kappa, 1.0_wp)) &
                    - sum(log(abs(1.0_wp - poles(2:)/largest))) &
                    - sum(log(abs(1.0_wp - poles*largest)))
      do i = 1, n_circles
         radius = inner*(largest/inner)**(i/(n_circles + 1.0_wp))
         if (.not. (radius > inner .and. radius < largest)) cycle
         lag = min(lag, (log_bound(kappa, poles, radius) - log_residue)/log(largest/radius))
      end do
      lag = max(lag, 0.0_wp)
   end function first_lag_of_one_sign

   !> Lag from which the sum of m |rho(m)| is below `largest_remainder`. Huge if a pole is on the
   !> circle.
   pure real(wp) function first_negligible_lag(kappa, poles) result(lag)
      real(wp), intent(in) :: kappa(:)
      complex(wp), intent(in) :: poles(:)
      real(wp) :: bound, n, radius
      integer :: i, pass

      lag = huge(1.0_wp)
      if (.not. abs(poles(1)) < 1.0_wp) return
      do i = 1, n_circles
         radius = abs(poles(1))**(i/(n_circles + 1.0_wp))
         if (.not. (radius > abs(poles(1)) .and. radius < 1.0_wp)) cycle
         bound = log_bound(kappa, poles, radius) - log(largest_remainder)
         n = 0.0_wp
         do pass = 1, 4   ! sum_(m>=n) m r^m = r^n (n/(1-r) + r/(1-r)^2); the logarithm moves little
            n = (bound + log(n/(1.0_wp - radius) + radius/(1.0_wp - radius)**2))/(-log(radius))
            n = max(n, 0.0_wp)
         end do
         lag = min(lag, n)
      end do
   end function first_negligible_lag

   !> ln of a bound of |b0^2/(A(1/z) A(z))| on |z| = radius. Times radius**m it bounds |rho(m)|, or
   !> the part of it by the poles inside this circle.
   pure real(wp) function log_bound(kappa, poles, radius) result(bound)
      real(wp), intent(in) :: kappa(:), radius
      complex(wp), intent(in) :: poles(:)

      bound = 2.0_wp*log(innovation_std(kappa, 1.0_wp)) &
              - sum(log(abs(1.0_wp - abs(poles)/radius))) - sum(log(1.0_wp - abs(poles)*radius))
   end function log_bound

   !> Gradients of L0 (row 1) and L1 (row 2) in atanh(kappa), if K(m) >= 0 at every lag.
   pure function positive_gradient(kappa) result(gradient)
      real(wp), intent(in) :: kappa(:)   !! kappa_m, m = 1..order
      real(wp) :: gradient(2, size(kappa))
      type(correlation_sums) :: sums
      real(wp) :: log_r(0:size(kappa)), moment, v(0:size(kappa) - 1)
      integer :: j, order

      order = size(kappa)
      sums = positive_sums(kappa)
      log_r = log_spectral_ratios(kappa)
      v = log_r(order) - log_r(:order - 1)
      moment = sum(sinh(v))
      do j = 1, order
         moment = moment + cosh(v(j - 1))
         gradient(:, j) = -exp(log_r(order))*[1.0_wp, (moment - sums%l1)/(1.0_wp + sums%l0)]
      end do
   end function positive_gradient

   !> Gradient of sum weights(m) rho(m) in atanh(kappa).
   pure function lag_sum_gradient(kappa, rho, weights) result(gradient)
      real(wp), intent(in) :: kappa(:)
      real(wp), intent(in) :: rho(0:)       !! K(m)/K(0) of this process, to the order at least
      real(wp), intent(in) :: weights(:)    !! lags m = 1..
      real(wp) :: gradient(size(kappa))
      real(wp) :: a(size(kappa), 0:size(kappa))      ! (q, order): predictors of all orders
      real(wp) :: a_bar(size(kappa))                 ! _bar: derivative of the sum
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

end module process_autoregressive_sums
