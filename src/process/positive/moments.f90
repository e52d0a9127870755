!> Moments, correlation lengths and entropy of a simulated positive process, with standard errors.
!>
!> Control variates reduce the error of each average over batches: a linear companion process, whose
!> moments are known, shares most of its noise.
module process_positive_moments
   use core_kinds, only: wp
   use process_model, only: process_moments
   use process_positive_truncated_normal, only: lanes
   implicit none(type, external)
   private
   public :: batch_averages, new_batches, positive_moments, estimate_moments, &
             error_of_residual, error_of_runs, estimate_autocovariance, estimate_products
   public :: add_products, n_acceptance_sums

   !> sums of alpha, 1/alpha, ln alpha and c phi(c)/(2 alpha), alpha the acceptance probability
   integer, parameter :: n_acceptance_sums = 4

   !> Averages over the batches of a run. Rows of `x` and `y`: d_n, then d_n d_(n-m) for m =
   !> 0..n_single, then the sums over m = n_single+1..n_lags of d_n d_(n-m) and of m d_n d_(n-m),
   !> whose cost does not depend on the number of lags.
   type :: batch_averages
      real(wp) :: centre = 0.0_wp                !! d = x - centre
      integer :: n_lags = 0                      !! largest lag of the sums
      integer :: n_single = 0                    !! largest lag with an average of its own
      real(wp), allocatable :: x(:, :)           !! (-1:n_single + 2, batch)
      !> (-1:n_single + 2, batch) the same averages of the companion, whose moments are known
      real(wp), allocatable :: y(:, :)
      real(wp), allocatable :: acceptance(:, :)  !! (n_acceptance_sums, batch)
   end type batch_averages

   !> Estimates and standard errors, in units of b0, with the entropy of x/std (sequential law).
   type, extends(process_moments) :: positive_moments
      real(wp) :: ratio = 0.0_wp, ratio_error = 0.0_wp   !! std/mean
      !> (batch, 5) deviations of the batches less what the controls explain: mean, ratio, L0, L1,
      !> entropy
      real(wp), allocatable :: residuals(:, :)
   end type positive_moments

   !> Control variates: orthonormal combinations of the companion's averages.
   type :: control_type
      private
      real(wp), allocatable :: direction(:, :)   !! (batch, control), centred, orthonormal
      !> (control) average over the batches less the known mean
      real(wp), allocatable :: excess(:)
   contains
      procedure :: correct
      procedure :: standard_error
   end type control_type

   real(wp), parameter :: half_log_two_pi_e = 0.5_wp + 0.91893853320467274_wp

contains

   !> Batches whose averages are 0.
   pure type(batch_averages) function new_batches(n_lags, n_single, n_batches) result(batches)
      integer, intent(in) :: n_lags, n_single, n_batches

      batches = batch_averages(n_lags=n_lags, n_single=n_single)
      allocate (batches%x(-1:n_single + 2, n_batches), source=0.0_wp)
      allocate (batches%y(-1:n_single + 2, n_batches), source=0.0_wp)
      allocate (batches%acceptance(n_acceptance_sums, n_batches), source=0.0_wp)
   end function new_batches

   !> Adds the rows of `batch_averages` summed over a block of steps, for all lanes.
   pure subroutine add_products(history, n_steps, n_single, n_lags, d, sums)
      integer, intent(in) :: history, n_steps, n_single, n_lags   !! history: at least n_lags
      real(wp), intent(in) :: d(lanes, 1 - history:n_steps)
      real(wp), intent(inout) :: sums(lanes, -1:n_single + 2)
      real(wp) :: t1(lanes), t2(lanes), t3(lanes), t4(lanes)
      integer :: first, lane, m(4), n

      t1 = 0.0_wp
      do n = 1, n_steps
         t1 = t1 + d(:, n)
      end do
      sums(:, -1) = sums(:, -1) + t1
      do first = 0, n_single, 4   ! four lags at a time: the sums stay in registers
         m = min(first + [0, 1, 2, 3], n_single)
         t1 = 0.0_wp
         t2 = 0.0_wp
         t3 = 0.0_wp
         t4 = 0.0_wp
         do n = 1, n_steps
            !$omp simd
            do lane = 1, lanes
               t1(lane) = t1(lane) + d(lane, n)*d(lane, n - m(1))
               t2(lane) = t2(lane) + d(lane, n)*d(lane, n - m(2))
               t3(lane) = t3(lane) + d(lane, n)*d(lane, n - m(3))
               t4(lane) = t4(lane) + d(lane, n)*d(lane, n - m(4))
            end do
         end do
         sums(:, first) = sums(:, first) + t1
         if (m(2) > m(1)) sums(:, m(2)) = sums(:, m(2)) + t2
         if (m(3) > m(2)) sums(:, m(3)) = sums(:, m(3)) + t3
         if (m(4) > m(3)) sums(:, m(4)) = sums(:, m(4)) + t4
      end do
      if (n_lags > n_single) call add_far_products(history, n_steps, n_single + 1, n_lags, d, &
                                                   sums(:, n_single + 1), sums(:, n_single + 2))
   end subroutine add_products

   !> Adds the products of lags `first` to `last`, by moving sums over the past.
   pure subroutine add_far_products(history, n_steps, first, last, d, plain, weighted)
      integer, intent(in) :: history, n_steps, first, last
      real(wp), intent(in) :: d(lanes, 1 - history:n_steps)
      real(wp), intent(inout) :: plain(lanes), weighted(lanes)   !! sums with weights 1 and m
      real(wp) :: past(lanes), weighted_past(lanes)   ! sums of d_(n-m), of m d_(n-m)
      integer :: lane, m, n

      past = 0.0_wp
      weighted_past = 0.0_wp
      do m = first, last
         past = past + d(:, 1 - m)
         weighted_past = weighted_past + m*d(:, 1 - m)
      end do
      do n = 1, n_steps
         !$omp simd
         do lane = 1, lanes
            plain(lane) = plain(lane) + d(lane, n)*past(lane)
            weighted(lane) = weighted(lane) + d(lane, n)*weighted_past(lane)
            weighted_past(lane) = weighted_past(lane) + past(lane) &
                                  + first*d(lane, n + 1 - first) - (last + 1)*d(lane, n - last)
            past(lane) = past(lane) + d(lane, n + 1 - first) - d(lane, n - last)
         end do
      end do
   end subroutine add_far_products

   !> Moments, lengths, entropy and acceptances. Sums beyond the last lag are the companion's; lags
   !> without a row of their own count with a positive sign. Where rounding hides the variance the
   !> std is 0, and nothing else is known.
   pure function estimate_moments(batches, companion, order, tail_l0, tail_moment, signs) &
      result(moments)
      type(batch_averages), intent(in) :: batches
      !> autocovariance of y, m = 0..n_lags; sums are cut at its last lag if that is below n_single
      real(wp), intent(in) :: companion(0:)
      !> number of lags that are controls of their own, those that the coefficients move
      integer, intent(in) :: order
      real(wp), intent(in) :: tail_l0          !! sum of |rho(m)| beyond n_lags
      real(wp), intent(in) :: tail_moment      !! sum of m |rho(m)| beyond n_lags
      real(wp), intent(in) :: signs(0:)        !! signs of K(m), as many as of the companion
      type(positive_moments) :: moments
      type(control_type) :: control
      real(wp), allocatable :: weights(:, :)   ! (0:last, 3) of rows: K(0), sum |K|, sum m |K|
      real(wp), allocatable :: known(:)        ! (0:last) rows of the companion
      real(wp), allocatable :: n_products(:)   ! (0:last) number of products of a row
      real(wp), dimension(size(batches%x, 2), 3) :: residual
      real(wp), dimension(size(batches%x, 2)) :: centre_residual, work
      real(wp) :: k(3), n, offset
      integer :: i, last

      call arrange_rows(batches, companion, signs, weights, known, n_products)
      last = size(known) - 1
      control = controls_of(batches, known, weights, order)

      ! controls correct the averages before mean**2 is subtracted: their errors would add a bias
      call control%correct(batches%x(-1, :), offset, centre_residual)
      do i = 1, 3
         call control%correct(matmul(weights(:, i), batches%x(0:last, :)), k(i), residual(:, i))
         n = dot_product(weights(:, i), n_products)
         k(i) = k(i) - n*offset**2
         residual(:, i) = residual(:, i) - n*2.0_wp*offset*centre_residual
      end do
      if (.not. k(1) > 0.0_wp) return
      moments%mean = batches%centre + offset
      allocate (moments%residuals(size(work), 5))
      moments%residuals(:, 1) = centre_residual
      moments%mean_error = control%standard_error(centre_residual)
      moments%std = sqrt(k(1))
      moments%std_error = control%standard_error(0.5_wp*residual(:, 1)/moments%std)
      moments%ratio = moments%std/moments%mean
      moments%residuals(:, 2) = moments%ratio*(0.5_wp*residual(:, 1)/k(1) &
                                               - centre_residual/moments%mean)
      moments%ratio_error = control%standard_error(moments%residuals(:, 2))
      moments%l0 = k(2)/k(1) + tail_l0
      moments%residuals(:, 3) = (residual(:, 2) - k(2)/k(1)*residual(:, 1))/k(1)
      moments%l0_error = control%standard_error(moments%residuals(:, 3))
      moments%l1 = (k(3)/k(1) + tail_moment)/(1.0_wp + moments%l0)
      work = residual(:, 3) - k(3)/(k(1) + k(2))*(residual(:, 1) + residual(:, 2))
      moments%residuals(:, 4) = work/(k(1) + k(2))
      moments%l1_error = control%standard_error(moments%residuals(:, 4))

      call control%correct(batches%acceptance(3, :) - batches%acceptance(4, :), &
                           moments%entropy, work)
      moments%entropy = moments%entropy + half_log_two_pi_e - log(moments%std)
      moments%residuals(:, 5) = work - 0.5_wp*residual(:, 1)/k(1)
      moments%entropy_error = control%standard_error(moments%residuals(:, 5))
      if (.not. any(batches%acceptance(2, :) > 0.0_wp)) return   ! exact law
      call control%correct(batches%acceptance(1, :), moments%acceptance_mean, work)
      moments%acceptance_ratio = size(work)/sum(batches%acceptance(2, :))
      call control%correct(batches%acceptance(3, :), moments%acceptance_geometric, work)
      moments%acceptance_geometric = exp(moments%acceptance_geometric)
   end function estimate_moments

   !> Computes weights and known values of the rows of the batches, to the companion's last lag.
   pure subroutine arrange_rows(batches, companion, signs, weights, known, n_products)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:), signs(0:)
      real(wp), allocatable, intent(out) :: weights(:, :), known(:), n_products(:)
      integer :: last, m, n, n_lags

      n_lags = ubound(companion, 1)
      n = min(n_lags, batches%n_single)
      last = merge(n + 2, n, n_lags > n)
      allocate (weights(0:last, 3), known(0:last), n_products(0:last), source=0.0_wp)
      weights(0, 1) = 1.0_wp
      weights(1:n, 2) = signs(1:n)
      weights(1:n, 3) = [(m*signs(m), m=1, n)]
      known(:n) = companion(:n)
      n_products(:n) = 1.0_wp
      if (last == n) return
      weights(last - 1, 2) = 1.0_wp
      weights(last, 3) = 1.0_wp
      known(last - 1:) = [sum(companion(n + 1:)), sum([(m*companion(m), m=n + 1, n_lags)])]
      n_products(last - 1:) = real([n_lags - n, sum([(m, m=n + 1, n_lags)])], wp)
   end subroutine arrange_rows

   !> Estimates E sum w_m d_n d_(n-m), and its standard error.
   pure subroutine estimate_products(batches, companion, weights, value, standard_error)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:)   !! autocovariance of y, m = 0..n_lags
      real(wp), intent(in) :: weights(0:)     !! w_m, m = 0..n_lags
      real(wp), intent(out) :: value, standard_error
      type(control_type) :: control
      real(wp) :: residual(size(batches%x, 2))

      control = controls_of(batches, companion, reshape(weights, [size(weights), 1]), 1)
      call control%correct(matmul(weights, batches%x(0:ubound(weights, 1), :)), value, residual)
      standard_error = control%standard_error(residual)
   end subroutine estimate_products

   !> Controls: the companion's mean, the weighted sums of its lags, and its first lags.
   pure type(control_type) function controls_of(batches, companion, weights, order) result(control)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:), weights(:, :)   !! (row), (row, sum)
      integer, intent(in) :: order
      real(wp) :: deviations(size(batches%y, 2), 1 + size(weights, 2) + order)
      integer :: i, m, n

      n = size(weights, 2)
      deviations(:, 1) = batches%y(-1, :)
      do i = 1, n
         deviations(:, 1 + i) = matmul(weights(:, i), batches%y(0:size(weights, 1) - 1, :)) &
                                - dot_product(weights(:, i), companion(:size(weights, 1) - 1))
      end do
      do m = 1, order
         deviations(:, 1 + n + m) = batches%y(m, :) - companion(m)
      end do
      control = new_control(deviations)
   end function controls_of

   !> Estimates K(m), m = 0..last, and standard errors. Controls are the companion's mean, variance
   !> and the same lag.
   pure subroutine estimate_autocovariance(batches, companion, last, autocovariance, &
                                           standard_error, residuals)
      type(batch_averages), intent(in) :: batches
      real(wp), intent(in) :: companion(0:)
      integer, intent(in) :: last
      real(wp), allocatable, intent(out) :: autocovariance(:)             !! (0:last)
      real(wp), allocatable, intent(out), optional :: standard_error(:)   !! (0:last)
      !> (batch, 0:last) deviations of the batches less what the controls explain
      real(wp), intent(out), optional :: residuals(:, 0:)
      type(control_type) :: control
      real(wp), dimension(size(batches%x, 2)) :: centre_residual, residual
      real(wp) :: deviations(size(residual), 3), offset
      integer :: m

      allocate (autocovariance(0:last))
      if (present(standard_error)) allocate (standard_error(0:last))
      do m = 0, last
         deviations(:, 1) = batches%y(-1, :)
         deviations(:, 2) = batches%y(0, :) - companion(0)
         deviations(:, 3) = batches%y(m, :) - companion(m)
         control = new_control(deviations)
         call control%correct(batches%x(-1, :), offset, centre_residual)
         call control%correct(batches%x(m, :), autocovariance(m), residual)
         autocovariance(m) = autocovariance(m) - offset**2
         residual = residual - 2.0_wp*offset*centre_residual
         if (present(standard_error)) standard_error(m) = control%standard_error(residual)
         if (present(residuals)) residuals(:, m) = residual
      end do
   end subroutine estimate_autocovariance

   !> Orthonormal controls from batch averages less their known means.
   pure type(control_type) function new_control(deviations) result(control)
      real(wp), intent(in) :: deviations(:, :)   !! (batch, control)
      real(wp) :: direction(size(deviations, 1), size(deviations, 2)), excess(size(deviations, 2))
      real(wp) :: norm, overlap
      integer :: i, j, n, pass

      n = 0   ! independent ones
      do j = 1, size(excess)
         associate (column => direction(:, n + 1), mean => excess(n + 1))
            mean = sum(deviations(:, j))/size(column)
            column = deviations(:, j) - mean
            norm = norm2(column)
            if (.not. norm > 0.0_wp) cycle
            column = column/norm
            mean = mean/norm
            do pass = 1, 2
               do i = 1, n
                  overlap = dot_product(direction(:, i), column)
                  column = column - overlap*direction(:, i)
                  mean = mean - overlap*excess(i)
               end do
            end do
            norm = norm2(column)
            if (norm < 1.0e-8_wp) cycle   ! depends on the others
            column = column/norm
            mean = mean/norm
         end associate
         n = n + 1
      end do
      control = control_type(direction(:, :n), excess(:n))
   end function new_control

   !> Computes the average over the batches less the error that the controls explain, and the
   !> residuals of the batches. Exact for a quantity that is linear in the controls.
   pure subroutine correct(self, series, average, residual)
      class(control_type), intent(in) :: self
      real(wp), intent(in) :: series(:)   !! (batch)
      real(wp), intent(out) :: average
      real(wp), intent(out) :: residual(:)    !! (batch) of mean 0
      real(wp) :: share
      integer :: j

      average = sum(series)/size(series)
      residual = series - average
      do j = 1, size(self%excess)
         share = dot_product(self%direction(:, j), residual)
         residual = residual - share*self%direction(:, j)
         average = average - share*self%excess(j)
      end do
   end subroutine correct

   !> Standard error of an average that controls correct.
   pure real(wp) function standard_error(self, residual) result(error)
      class(control_type), intent(in) :: self
      real(wp), intent(in) :: residual(:)     !! (batch)
      real(wp) :: n

      n = size(residual)
      error = error_of_residual(residual)*sqrt(n/(n - size(self%excess)))
   end function standard_error

   !> Standard error of an average, from the residuals of its batches. Batch i belongs to the run
   !> modulo(i - 1, lanes); runs are independent, batches of one run need not be.
   pure real(wp) function error_of_residual(residual) result(error)
      real(wp), intent(in) :: residual(:)     !! (batch)
      real(wp) :: runs(lanes)

      runs = sum(reshape(residual, [lanes, size(residual)/lanes]), dim=2)/size(residual)
      error = error_of_runs(runs)
   end function error_of_residual

   !> Standard error of a sum over independent runs.
   pure real(wp) function error_of_runs(runs) result(error)
      real(wp), intent(in) :: runs(lanes)   !! terms of the sum

      error = sqrt(sum(runs**2)*lanes/(lanes - 1.0_wp))
   end function error_of_runs

end module process_positive_moments
