!> Both correlation lengths of an autoregressive process, summed to infinity: Eqs. (8), (9), (41),
!> and their derivatives.
!>
!> The signed sums are closed forms in the reflection coefficients. With R_0 = 1 and
!>    R_m = R_(m-1) (1 - kappa_m)/(1 + kappa_m),
!>    1 + 2 sum rho(m) = R_M,    2 sum m rho(m) = R_M sum_(m<M) sinh(ln R_M - ln R_m):
!> the step-up recursion of the predictor, and its derivative, taken at frequency 0. Where one
!> positive pole outlives all others only finitely many lags are negative, and only they are left to
!> add. Otherwise the moduli are summed until Cauchy's estimate bounds what is left.
!>
!> Derivatives are with respect to atanh(kappa_m). Closed forms are differentiated as such; sums
!> over lags backwards, lag by lag and order by order (the adjoint of Levinson's recursion), at the
!> cost of two marches.
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

   !> Infinite sums of one process.
   type :: correlation_sums
      real(wp) :: l0 = 0.0_wp                 !! Eq. (8) [lags]
      real(wp) :: l1 = 0.0_wp                 !! Eq. (9) [lags]
      logical :: is_nonnegative = .false.     !! K(m) >= 0 at every lag, or its mirror image is
   end type correlation_sums

   real(wp), parameter :: remainder = 1.0e-18_wp     !! of sum m |rho(m)|, left out at most
   integer, parameter :: max_lags = 20000000
   integer, parameter :: n_radii = 31                !! circles tried for Cauchy's estimate

contains

   !> Adds up |K(m)| and m |K(m)| over all lags, K(0) = 1. Fails where more than `most_lags` lags
   !> count: poles near the circle, without one real pole that outlives the others.
   subroutine sum_correlation(kappa, sums, error, most_lags)
      real(wp), intent(in) :: kappa(:)   !! all inside (-1, 1)
      type(correlation_sums), intent(out) :: sums
      type(error_type), allocatable, intent(out) :: error
      integer, optional, intent(in) :: most_lags   !! `max_lags` when absent: some seconds
      complex(wp), allocatable :: poles(:)
      real(wp) :: folded(size(kappa)), n_certain, n_negligible
      integer :: limit, order

      limit = max_lags
      if (present(most_lags)) limit = most_lags
      order = size(kappa)
      do while (order > 0)   ! a vanishing last coefficient is a lower order
         if (abs(kappa(order)) > 0.0_wp) exit
         order = order - 1
      end do
      sums%is_nonnegative = .true.
      if (order == 0) return
      folded = kappa
      call find_polynomial_roots(coefficients_of(folded(:order)), poles, error)
      if (allocated(error)) return
      if (poles(1)%re < 0.0_wp .and. .not. abs(poles(1)%im) > 0.0_wp) then
         folded(1::2) = -kappa(1::2)   ! (-1)^m K(m) has the same sums
         poles = -poles
      end if
      n_certain = first_lag_of_one_sign(folded(:order), poles)
      n_negligible = first_negligible_lag(folded(:order), poles)
      if (.not. min(n_certain, n_negligible) < limit) then
         call raise(error, exit_no_solution, 'correlation length of an autoregressive process '// &
                    'of order '//to_text(order)//' with largest pole '//to_text(abs(poles(1)))// &
                    ': more than '//to_text(limit)//' lags count')
         return
      end if
      call march(folded(:order), ceiling(min(n_certain, n_negligible)), n_certain <= n_negligible, &
                 sums)
   end subroutine sum_correlation

   !> ln R_m, m = 0..order: R_m is the spectral density at frequency 0 over the variance, order m.
   pure function log_spectral_ratios(kappa) result(log_r)
      real(wp), intent(in) :: kappa(:)
      real(wp) :: log_r(0:size(kappa))
      integer :: m

      log_r(0) = 0.0_wp
      do m = 1, size(kappa)
         log_r(m) = log_r(m - 1) - 2.0_wp*atanh(kappa(m))
      end do
   end function log_spectral_ratios

   !> Sums of a process that is known to have K(m) >= 0 at every lag: closed forms.
   pure function positive_sums(kappa) result(sums)
      real(wp), intent(in) :: kappa(:)
      type(correlation_sums) :: sums
      real(wp) :: log_r(0:size(kappa))

      log_r = log_spectral_ratios(kappa)
      associate (last => log_r(size(kappa)))
         sums%is_nonnegative = .true.
         sums%l0 = 0.5_wp*exp_minus_one(last)
         sums%l1 = 0.5_wp*exp(last)*sum(sinh(last - log_r(:size(kappa) - 1)))/(1.0_wp + sums%l0)
      end associate
   end function positive_sums

   !> Adds the lags one by one: all moduli, or the negative ones beside the closed forms.
   pure subroutine march(kappa, n_lags, is_closed, sums)
      real(wp), intent(in) :: kappa(:)
      integer, intent(in) :: n_lags
      logical, intent(in) :: is_closed   !! no lag after these is negative
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
         ! or what of (-1)^m K(m) is negative: rounding leaves signs to lags that are zero
         negative = min(negative, sum(max(rho(1::2), 0.0_wp)) - sum(min(rho(2::2), 0.0_wp)))
      end if
      sums%is_nonnegative = negative <= 100*epsilon(1.0_wp)*sums%l0
   end subroutine march

   !> A lag from which K > 0 for sure: the residue of the largest pole, when it is real and
   !> positive, against Cauchy's estimate of all the others on a circle between it and them. Huge
   !> when there is none.
   pure function first_lag_of_one_sign(kappa, poles) result(lag)
      real(wp), intent(in) :: kappa(:)
      complex(wp), intent(in) :: poles(:)   !! by descending modulus
      real(wp) :: lag
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
      do i = 1, n_radii
         radius = inner*(largest/inner)**(i/(n_radii + 1.0_wp))
         if (.not. (radius > inner .and. radius < largest)) cycle
         lag = min(lag, (log_bound(kappa, poles, radius) - log_residue)/log(largest/radius))
      end do
      lag = max(lag, 0.0_wp)
   end function first_lag_of_one_sign

   !> A lag from which the sum of m |rho(m)| is below `remainder`. Huge when poles touch the circle.
   pure function first_negligible_lag(kappa, poles) result(lag)
      real(wp), intent(in) :: kappa(:)
      complex(wp), intent(in) :: poles(:)
      real(wp) :: lag
      real(wp) :: bound, n, radius
      integer :: i, pass

      lag = huge(1.0_wp)
      if (.not. abs(poles(1)) < 1.0_wp) return
      do i = 1, n_radii
         radius = abs(poles(1))**(i/(n_radii + 1.0_wp))
         if (.not. (radius > abs(poles(1)) .and. radius < 1.0_wp)) cycle
         bound = log_bound(kappa, poles, radius) - log(remainder)
         n = 0.0_wp
         do pass = 1, 4   ! sum_(m>=n) m r^m = r^n (n/(1-r) + r/(1-r)^2); the logarithm moves little
            n = (bound + log(n/(1.0_wp - radius) + radius/(1.0_wp - radius)**2))/(-log(radius))
            n = max(n, 0.0_wp)
         end do
         lag = min(lag, n)
      end do
   end function first_negligible_lag

   !> ln of a bound of |b0^2/(A(1/z) A(z))| on |z| = radius: |rho(m)| (without the poles outside, if
   !> any) stays below it times radius**m.
   pure function log_bound(kappa, poles, radius) result(bound)
      real(wp), intent(in) :: kappa(:), radius
      complex(wp), intent(in) :: poles(:)
      real(wp) :: bound

      bound = 2.0_wp*log(innovation_std(kappa, 1.0_wp)) &
              - sum(log(abs(1.0_wp - abs(poles)/radius))) - sum(log(1.0_wp - abs(poles)*radius))
   end function log_bound

   !> Gradients in atanh(kappa) of L0 and L1 where K(m) >= 0 at every lag, one a row.
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

end module process_autoregressive_sums
