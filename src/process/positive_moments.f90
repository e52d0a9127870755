!> What a sampled positive process says of itself: moments, lengths, entropy, with their standard
!> errors.
module process_positive_moments
   use core_kinds, only: wp
   use process_control_variates, only: control_type, new_control
   use process_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: batch_averages, new_batches, positive_moments, estimate_moments, &
      estimate_autocovariance
   public :: add_products, n_acceptance_sums

   !> alpha, 1/alpha, ln alpha, c phi(c)/(2 alpha), density at 0
   integer, parameter :: n_acceptance_sums = 5

   !> Averages over independent stretches of a run; `x` and `y` hold d, then d_n d_(n-m) for m =
   !> 0..n_lags.
   type :: batch_averages
      real(wp) :: centre = 0.0_wp                !! d = x - centre
      real(wp), allocatable :: x(:, :)           !! (-1:n_lags, batch)
      !> (-1:n_lags, batch) of a companion of known moments
      real(wp), allocatable :: y(:, :)
      real(wp), allocatable :: acceptance(:, :)  !! (n_acceptance_sums, batch)
   end type batch_averages

   !> Estimates and standard errors, in units of b0.
   type :: positive_moments
      real(wp) :: mean = 0.0_wp, mean_error = 0.0_wp
      real(wp) :: std = 0.0_wp, std_error = 0.0_wp
      real(wp) :: ratio = 0.0_wp, ratio_error = 0.0_wp   !! std/mean
      real(wp) :: l0 = 0.0_wp, l0_error = 0.0_wp         !! infinite sums
      real(wp) :: l1 = 0.0_wp, l1_error = 0.0_wp
      real(wp) :: entropy = 0.0_wp, entropy_error = 0.0_wp   !! of x/std; sequential law only
      real(wp) :: at_zero = 0.0_wp, at_zero_error = 0.0_wp   !! density p_X(0)
      real(wp) :: acceptance_ratio = 1.0_wp, acceptance_mean = 1.0_wp, acceptance_geometric = 1.0_wp
   end type positive_moments

   real(wp), parameter :: half_log_two_pi_e = 0.5_wp + 0.91893853320467274_wp

contains

   !> Empty batches.
   pure function new_batches(n_lags, n_batches) result(batches)
      integer, intent(in) :: n_lags, n_batches
      type(batch_averages) :: batches

      allocate (batches%x(-1:n_lags, n_batches), source=0.0_wp)
      allocate (batches%y(-1:n_lags, n_batches), source=0.0_wp)
      allocate (batches%acceptance(n_acceptance_sums, n_batches), source=0.0_wp)
   end function new_batches

   !> Adds d_n and d_n d_(n-m) over a block of steps of all lanes.
   pure subroutine add_products(history, n_steps, n_lags, d, sums)
      integer, intent(in) :: history, n_steps, n_lags
      real(wp), intent(in) :: d(lanes, 1 - history:n_steps)
      real(wp), intent(inout) :: sums(lanes, -1:n_lags)
      real(wp) :: t1(lanes), t2(lanes), t3(lanes), t4(lanes)
      integer :: lane, m, n

      t1 = 0.0_wp
      do n = 1, n_steps
         t1 = t1 + d(:, n)
      end do
      sums(:, -1) = sums(:, -1) + t1
      do m = 0, n_lags - 3, 4   ! four lags at a time: the sums stay in registers
         t1 = 0.0_wp
         t2 = 0.0_wp
         t3 = 0.0_wp
         t4 = 0.0_wp
         do n = 1, n_steps
            !$omp simd
            do lane = 1, lanes
               t1(lane) = t1(lane) + d(lane, n)*d(lane, n - m)
               t2(lane) = t2(lane) + d(lane, n)*d(lane, n - m - 1)
               t3(lane) = t3(lane) + d(lane, n)*d(lane, n - m - 2)
               t4(lane) = t4(lane) + d(lane, n)*d(lane, n - m - 3)
            end do
         end do
         sums(:, m) = sums(:, m) + t1
         sums(:, m + 1) = sums(:, m + 1) + t2
         sums(:, m + 2) = sums(:, m + 2) + t3
         sums(:, m + 3) = sums(:, m + 3) + t4
      end do
      do m = 4*((n_lags + 1)/4), n_lags
         do n = 1, n_steps
            sums(:, m) = sums(:, m) + d(:, n)*d(:, n - m)
         end do
      end do
   end subroutine add_products

   !> Everything but the autocovariance lag by lag. Signs of K(m), and what lies beyond the last
   !> lag, are taken from the companion.
   pure function estimate_moments(batches, companion, order, tail_l0, tail_moment) result(moments)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:)    !! autocovariance of y, m = 0..n_lags
      !> lags that are controls of their own: coefficients move them
      integer, intent(in) :: order
      real(wp), intent(in) :: tail_l0          !! sum of |rho(m)| beyond n_lags
      real(wp), intent(in) :: tail_moment      !! sum of m |rho(m)| beyond n_lags
      type(positive_moments) :: moments
      type(control_type) :: control
      real(wp), dimension(size(batches%x, 2)) :: d, k0, length, moment, work
      real(wp) :: deviations(size(d), 4 + order), sign_of(size(companion) - 1), &
         lag(size(companion) - 1)
      real(wp) :: average(4), centred, k0_mean, sum0, sum1, unused
      integer :: last, m, n

      n = size(d)
      last = ubound(companion, 1)
      sign_of = sign(1.0_wp, companion(1:))
      lag = [(real(m, wp), m=1, last)]
      deviations(:, 1) = batches%y(-1, :)
      deviations(:, 2) = batches%y(0, :) - companion(0)
      deviations(:, 3) = matmul(sign_of, batches%y(1:last, :)) - sum(abs(companion(1:)))
      deviations(:, 4) = matmul(sign_of*lag, batches%y(1:last, :)) - sum(lag*abs(companion(1:)))
      do m = 1, order
         deviations(:, 4 + m) = batches%y(m, :) - companion(m)
      end do
      control = new_control(deviations, lanes)

      ! first-order influences of a batch on mean, K(0), sum |K|, sum m |K|
      centred = sum(batches%x(-1, :))/n
      d = batches%x(-1, :) - centred
      k0 = batches%x(0, :) - centred**2 - 2.0_wp*centred*d
      length = matmul(sign_of, batches%x(1:last, :)) - sum(sign_of)*(centred**2 + 2.0_wp*centred*d)
      moment = matmul(sign_of*lag, batches%x(1:last, :)) &
               - sum(sign_of*lag)*(centred**2 + 2.0_wp*centred*d)
      average = [sum(d), sum(k0), sum(length), sum(moment)]/n
      k0_mean = average(2)
      sum0 = average(3)
      sum1 = average(4)

      moments%mean = batches%centre + centred
      call control%correct(d, moments%mean, moments%mean_error)
      moments%std = sqrt(k0_mean)
      call control%correct(0.5_wp*k0/moments%std, moments%std, moments%std_error)
      moments%ratio = sqrt(k0_mean)/(batches%centre + centred)
      work = moments%ratio*(0.5_wp*k0/k0_mean - d/(batches%centre + centred))
      call control%correct(work, moments%ratio, moments%ratio_error)
      moments%l0 = sum0/k0_mean
      work = (length - moments%l0*k0)/k0_mean
      call control%correct(work, moments%l0, moments%l0_error)
      moments%l0 = moments%l0 + tail_l0
      moments%l1 = sum1/(k0_mean + sum0)
      work = (moment - moments%l1*(k0 + length))/(k0_mean + sum0)
      call control%correct(work, moments%l1, moments%l1_error)
      moments%l1 = (moments%l1*(1.0_wp + sum0/k0_mean) + tail_moment)/(1.0_wp + moments%l0)

      work = batches%acceptance(3, :) - batches%acceptance(4, :)
      moments%entropy = half_log_two_pi_e + sum(work)/n - 0.5_wp*log(k0_mean)
      work = work - 0.5_wp*k0/k0_mean
      call control%correct(work, moments%entropy, moments%entropy_error)
      moments%at_zero = sum(batches%acceptance(5, :))/n
      call control%correct(batches%acceptance(5, :), moments%at_zero, moments%at_zero_error)
      moments%acceptance_mean = sum(batches%acceptance(1, :))/n
      call control%correct(batches%acceptance(1, :), moments%acceptance_mean, unused)
      if (any(batches%acceptance(2, :) > 0.0_wp)) &
         moments%acceptance_ratio = n/sum(batches%acceptance(2, :))
      work = sum(batches%acceptance(3, :))/n
      moments%acceptance_geometric = exp(work(1))
   end function estimate_moments

   !> K(m), m = 0..last, and standard errors; each lag with its own lag of the companion as a
   !> control.
   pure subroutine estimate_autocovariance(batches, companion, last, autocovariance, standard_error)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:)
      integer, intent(in) :: last
      real(wp), allocatable, intent(out) :: autocovariance(:), standard_error(:)   !! (0:last)
      type(control_type) :: control
      real(wp) :: centred, d(size(batches%x, 2)), deviations(size(d), 3), influence(size(d))
      integer :: m, n

      n = size(d)
      allocate (autocovariance(0:last), standard_error(0:last))
      centred = sum(batches%x(-1, :))/n
      d = batches%x(-1, :) - centred
      do m = 0, last
         deviations(:, 1) = batches%y(-1, :)
         deviations(:, 2) = batches%y(0, :) - companion(0)
         deviations(:, 3) = batches%y(m, :) - companion(m)
         control = new_control(deviations, lanes)
         influence = batches%x(m, :) - centred**2 - 2.0_wp*centred*d
         autocovariance(m) = sum(influence)/n
         call control%correct(influence, autocovariance(m), standard_error(m))
      end do
   end subroutine estimate_autocovariance

end module process_positive_moments
