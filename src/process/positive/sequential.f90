!> Simulates the law of one-at-a-time rejection (Sec. 2.4) in many chains side by side.
!>
!> A value redrawn until it is positive has the truncated conditional law, so one draw by its
!> inverse distribution function replaces the rejection, and the acceptance probability of each step
!> has a closed form. Everything is in units of b0.
module process_positive_sequential
   use core_alignment, only: aligned_memory
   use core_kinds, only: long, wp
   use core_random, only: stream_type
   use process_positive_moments, only: add_products, batch_averages, n_acceptance_sums
   use process_positive_truncated_normal, only: add_logarithms, draw_truncated, &
      draw_truncated_lanes, lanes, reciprocal_std, scale_below, smallest_of
   implicit none(type, external)
   private
   public :: memory_of, march_chains, sample_sequential

   integer, parameter :: block_steps = 128   !! steps that are marched at once
   integer, parameter :: product_steps = 8   !! steps that share a logarithm and a division

contains

   !> Simulates a stationary run and averages over its batches, each one lane over part of the time.
   !>
   !> The linear companion y is driven by the innovations of x, scaled to unit variance: its second
   !> moments are those of its coefficients, whatever the law of x, and it shares most noise with x.
   !> All sums are 0 if x grows without bound, because there is no process.
   subroutine sample_sequential(a, offset, companion, centre, n_burn_in, n_steps, stream, batches)
      real(wp), intent(in) :: a(:)           !! a_q, Eq. (39)
      real(wp), intent(in) :: offset         !! conditional mean after zeros: mu (1 + sum a_q)/b0
      real(wp), intent(in) :: companion(:)   !! coefficients of y, as many as of x; unit innovations
      real(wp), intent(in) :: centre         !! start of every chain, near the mean [b0]
      integer, intent(in) :: n_burn_in       !! steps until the run is stationary
      integer, intent(in) :: n_steps         !! steps of a batch, rounded up to whole blocks
      type(stream_type), intent(inout) :: stream
      type(batch_averages), intent(inout) :: batches   !! allocated; a multiple of `lanes` batches
      real(wp), parameter :: far = 1.0e6_wp   ! values over the mean that grow without bound
      type(aligned_memory), target :: memory
      real(wp), pointer, contiguous :: values(:, :, :)   ! (lane, step, 1: x - centre, 2: y)
      real(wp), allocatable :: sums(:, :, :)
      real(wp) :: acceptance(lanes, n_acceptance_sums)
      integer :: block, history, i, last, n, stretch

      history = max(batches%n_lags, size(a))
      allocate (sums(lanes, -1:batches%n_single + 2, 2))
      call memory%reserve(2_long*lanes*(history + block_steps))
      call memory%assign_planes([lanes, history + block_steps, 2], values)
      batches%centre = centre
      do stretch = 0, size(batches%acceptance, 2)/lanes   ! 0: the burn-in
         sums = 0.0_wp
         acceptance = 0.0_wp
         do block = 1, (merge(n_steps, n_burn_in, stretch > 0) + block_steps - 1)/block_steps
            call march_block(a, offset, companion, centre, history, stream, values(:, :, 1), &
                             values(:, :, 2), acceptance)
            if (any(values(:, history + block_steps, 1) > far*centre)) then
               batches%x = 0.0_wp
               return
            end if
            if (stretch == 0) cycle
            do i = 1, 2
               call add_products(history, block_steps, batches%n_single, batches%n_lags, &
                                 values(:, :, i), sums(:, :, i))
            end do
         end do
         if (stretch == 0) cycle
         n = (block - 1)*block_steps
         last = stretch*lanes
         batches%x(:, last - lanes + 1:last) = transpose(sums(:, :, 1))/n
         batches%y(:, last - lanes + 1:last) = transpose(sums(:, :, 2))/n
         batches%acceptance(:, last - lanes + 1:last) = transpose(acceptance)/n
      end do
   end subroutine sample_sequential

   !> Marches all lanes by one block of steps, after those of the last block.
   subroutine march_block(a, offset, companion, centre, history, stream, d, y, acceptance)
      real(wp), intent(in) :: a(:), offset, companion(:), centre
      integer, intent(in) :: history
      type(stream_type), intent(inout) :: stream
      real(wp), intent(inout) :: d(lanes, 1 - history:block_steps), &
                                 y(lanes, 1 - history:block_steps)
      real(wp), intent(inout) :: acceptance(lanes, n_acceptance_sums)
      real(wp) :: u(lanes*block_steps)
      real(wp), dimension(lanes) :: alpha, c, factor, hazard, x
      real(wp), dimension(lanes) :: product, reciprocals   ! of factors; sum of 1/factor, times it
      integer :: lane, n, q

      d(:, 1 - history:0) = d(:, block_steps + 1 - history:block_steps)
      y(:, 1 - history:0) = y(:, block_steps + 1 - history:block_steps)
      call stream%uniforms(u)
      reciprocals = 0.0_wp
      product = 1.0_wp
      do n = 1, block_steps
         c = offset - sum(a)*centre
         do q = 1, size(a)
            !$omp simd
            do lane = 1, lanes
               c(lane) = c(lane) - a(q)*d(lane, n - q)
            end do
         end do
         call draw_truncated_lanes(c, u(lanes*(n - 1) + 1:lanes*n), x, hazard, factor)
         d(:, n) = x - centre
         y(:, n) = (x - c - hazard)*reciprocal_std(c, hazard)
         do q = 1, size(a)
            !$omp simd
            do lane = 1, lanes
               y(lane, n) = y(lane, n) - companion(q)*y(lane, n - q)
            end do
         end do
         acceptance(:, 1) = acceptance(:, 1) + factor
         reciprocals = reciprocals*factor + product
         product = product*factor
         acceptance(:, 4) = acceptance(:, 4) + 0.5_wp*c*hazard
         if (smallest_of(c) < 0.0_wp) then   ! what these sums lack where factor /= alpha
            alpha = factor
            call scale_below(c, alpha, acceptance(:, 3))
            acceptance(:, 1) = acceptance(:, 1) + (alpha - factor)
            acceptance(:, 2) = acceptance(:, 2) + (1.0_wp/alpha - 1.0_wp/factor)
         end if
         if (modulo(n, product_steps) /= 0) cycle
         acceptance(:, 2) = acceptance(:, 2) + reciprocals/product
         call add_logarithms(product, acceptance(:, 3))
         reciprocals = 0.0_wp
         product = 1.0_wp
      end do
   end subroutine march_block

   !> Draws consecutive values of independent chains side by side, after their burn-in [b0]. The
   !> first values do not depend on the number of steps.
   subroutine march_chains(a, offset, start, n_burn_in, stream, values)
      real(wp), intent(in) :: a(:), offset
      real(wp), intent(in) :: start           !! each chain's past, near the mean [b0]
      integer, intent(in) :: n_burn_in
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:, :)   !! (chain, step): fastest for `lanes` chains
      real(wp), allocatable :: u(:), x(:, :)
      real(wp), dimension(size(values, 1)) :: c, factor, hazard
      integer :: n, n_steps, q

      n_steps = n_burn_in + size(values, 2)
      allocate (u(size(c)*n_steps), x(size(c), 1 - size(a):n_steps))
      call stream%uniforms(u)
      x(:, :0) = start
      do n = 1, n_steps
         c = offset
         do q = 1, size(a)
            c = c - a(q)*x(:, n - q)
         end do
         associate (now => u(size(c)*(n - 1) + 1:size(c)*n))
            if (size(c) == lanes) then
               call draw_truncated_lanes(c, now, x(:, n), hazard, factor)
            else
               call draw_truncated(c, now, x(:, n), hazard, factor)
            end if
         end associate
      end do
      values = x(:, n_burn_in + 1:)
   end subroutine march_chains

   !> Steps after which the correlation has decayed to a tolerance. The largest pole of the Gaussian
   !> process is a safe measure, because truncation shortens the memory.
   pure integer function memory_of(decay, tolerance) result(steps)
      real(wp), intent(in) :: decay   !! modulus of the largest pole, or |K(m + 1)/K(m)|
      real(wp), intent(in) :: tolerance

      steps = ceiling(log(tolerance)/log(min(max(decay, 1.0e-3_wp), 1.0_wp - 1.0e-6_wp)))
   end function memory_of

end module process_positive_sequential
