!> The law of Eq. (25) on positive values, in an infinite domain: sampled by redrawing one value at
!> a time, given its neighbours on both sides (Gibbs), on rings much longer than the memory.
!>
!> The redrawn value is truncated normal; all values move monotonically and by less than their
!> neighbours do, so that two rings driven by the same numbers approach each other at a rate known
!> beforehand: the number of sweeps that forgets the start is computed, not guessed. Everything is
!> in units of b0.
!>
!> Normalizing constant and entropy come by integration over the strength of the correlation. With z
!> = x/b0 the density is exp(- z'Gz/2 + field sum z)/Z, and psi is ln Z per point. Where all entries
!> of G off its diagonal are multiplied by t, psi is known at t = 0, and its derivative is
!> - sum G_k E[z_i z_(i+k)]: averages sampled at Gauss nodes give psi at t = 1. No law on the way is
!> more correlated than the last one.
module process_positive_exact
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_quadrature, only: gauss_legendre
   use process_autoregressive_spectral_factor, only: equivalent_process, reciprocal_of_process, &
      symbol_of_process
   use process_positive_moments, only: add_products, batch_averages, estimate_products, new_batches
   use process_positive_truncated_normal, only: draw_truncated_lanes, lanes, log_acceptance, &
      log_sqrt_two_pi, truncated_variance
   implicit none(type, external)
   private
   public :: sweeps_to_forget, sample_exact, draw_window
   public :: log_partition, entropy_of_exact_law

   real(wp), parameter :: between_nodes = 1.0e-6_wp   !! error of the integration at L0 = 10

   !> Rings of values side by side, one per lane; or one ring wound over all lanes.
   type :: ring_type
      integer :: length = 0              !! values per lane
      integer :: history = 0             !! values that are kept before them too
      logical :: is_wound = .false.      !! the next lane continues where this one ends
      real(wp) :: field = 0.0_wp         !! mu (G_0 + 2 sum G_m)
      real(wp) :: centre = 0.0_wp        !! start of every value, near the mean
      real(wp), allocatable :: g(:)      !! (0:order) precision of the law, Eq. (25)
      real(wp), allocatable :: d(:, :)   !! (lane, 1-history:length+order) x - centre
      !> (0:order) precision of the linear companion; unallocated: none
      real(wp), allocatable :: h(:)
      real(wp), allocatable :: y(:, :)   !! as d
      real(wp), allocatable :: u(:)      !! numbers of a sweep
   end type ring_type

contains

   !> Sweeps after which a start has lost all but `tolerance` of its weight: the rate of the
   !> Gaussian law of this variance and length, the smallest over the mean of 1/(power spectral
   !> density).
   pure function sweeps_to_forget(strength, l0, tolerance) result(n)
      real(wp), intent(in) :: strength   !! G_0 K(0)
      real(wp), intent(in) :: l0         !! [lags]
      real(wp), intent(in) :: tolerance
      integer :: n
      real(wp) :: smallest

      smallest = 1.0_wp/(max(1.0_wp, strength)*(1.0_wp + 2.0_wp*l0))
      n = max(ceiling(log(tolerance)/log((1.0_wp - min(smallest, 0.999_wp))/(1.0_wp + smallest))), &
              4)
   end function sweeps_to_forget

   !> Samples averages over batches, a lane over a stretch of sweeps each; rows as in the sequential
   !> law, without acceptance sums.
   subroutine sample_exact(g, field, companion, centre, ring_length, n_burn_in, n_sweeps, stream, &
                           batches)
      real(wp), intent(in) :: g(0:)          !! row of G, lags 0..order
      real(wp), intent(in) :: field          !! mu (G_0 + 2 sum G_m)
      !> coefficients of the linear companion, unit innovations
      real(wp), intent(in) :: companion(:)
      real(wp), intent(in) :: centre         !! start, near the mean
      integer, intent(in) :: ring_length     !! much longer than the memory, and than all lags
      integer, intent(in) :: n_burn_in       !! sweeps
      integer, intent(in) :: n_sweeps        !! of a batch
      type(stream_type), intent(inout) :: stream
      type(batch_averages), intent(inout) :: batches   !! allocated; a multiple of `lanes` batches
      type(ring_type) :: ring
      real(wp) :: sums(lanes, -1:batches%n_single + 2, 2)
      integer :: first, last, stretch, sweep

      batches%centre = centre
      ring = new_ring(g, field, centre, ring_length, max(batches%n_lags, ubound(g, 1)), .false.)
      ring%h = symbol_of_process(companion, 1.0_wp)
      ring%y = ring%d
      do sweep = 1, n_burn_in
         call redraw(ring, stream)
      end do
      do stretch = 1, size(batches%x, 2)/lanes
         sums = 0.0_wp
         do sweep = 1, n_sweeps
            call redraw(ring, stream)
            call add_products(ring%history, ring%length, batches%n_single, batches%n_lags, ring%d, &
                              sums(:, :, 1))
            call add_products(ring%history, ring%length, batches%n_single, batches%n_lags, ring%y, &
                              sums(:, :, 2))
         end do
         first = (stretch - 1)*lanes + 1
         last = stretch*lanes
         batches%x(:, first:last) = transpose(sums(:, :, 1))/(n_sweeps*ring%length)
         batches%y(:, first:last) = transpose(sums(:, :, 2))/(n_sweeps*ring%length)
      end do
   end subroutine sample_exact

   !> Draws consecutive values of one stationary run, from a ring that has forgotten its start and
   !> is longer than they are by margins beyond the memory.
   subroutine draw_window(g, field, start, margin, n_sweeps, stream, values)
      real(wp), intent(in) :: g(0:), field  !! see `sample_exact`
      real(wp), intent(in) :: start         !! near the mean
      integer, intent(in) :: margin         !! steps beyond which nothing is felt
      integer, intent(in) :: n_sweeps
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      type(ring_type) :: ring
      integer :: n, sweep

      ring = new_ring(g, field, start, max((size(values) + 2*margin + lanes - 1)/lanes, size(g)), &
                      ubound(g, 1), .true.)
      do sweep = 1, n_sweeps
         call redraw(ring, stream)
      end do
      do n = 1, size(values)
         values(n) = start + ring%d((n - 1)/ring%length + 1, modulo(n - 1, ring%length) + 1)
      end do
   end subroutine draw_window

   pure function new_ring(g, field, centre, length, history, is_wound) result(ring)
      real(wp), intent(in) :: g(0:), field, centre
      integer, intent(in) :: length, history
      logical, intent(in) :: is_wound
      type(ring_type) :: ring

      ring%length = length
      ring%history = history
      ring%is_wound = is_wound
      ring%field = field
      ring%centre = centre
      ring%g = g
      allocate (ring%d(lanes, 1 - history:length + ubound(g, 1)), source=0.0_wp)
      allocate (ring%u(lanes*length))
   end function new_ring

   !> Redraws every value given its neighbours: one sweep. Places as far apart as a lane is long do
   !> not see each other, so that all lanes move at once.
   subroutine redraw(ring, stream)
      type(ring_type), intent(inout) :: ring
      type(stream_type), intent(inout) :: stream

      call stream%uniforms(ring%u)
      ! a companion that is not allocated is absent
      call redraw_lanes(ring%history, ring%is_wound, ring%field, ring%centre, ring%g, ring%u, &
                        ring%d, ring%h, ring%y)
   end subroutine redraw

   pure subroutine redraw_lanes(history, is_wound, field, centre, g, u, d, h, y)
      integer, intent(in) :: history
      logical, intent(in) :: is_wound
      real(wp), intent(in) :: field, centre
      real(wp), intent(in), contiguous :: g(0:), u(:)
      real(wp), intent(inout) :: d(lanes, 1 - history:size(u)/lanes + size(g) - 1)
      real(wp), intent(in), optional :: h(0:size(g) - 1)
      real(wp), intent(inout), optional :: y(lanes, 1 - history:size(u)/lanes + size(g) - 1)
      real(wp) :: c(lanes), drawn(lanes), factor(lanes), hazard(lanes), pull, scale
      integer :: i, length, order

      length = size(u)/lanes
      order = ubound(g, 1)
      scale = 1.0_wp/sqrt(g(0))
      pull = field - 2.0_wp*centre*sum(g(1:))
      do i = 1, length
         c = scale*(pull - neighbours(order, g, d(:, i - order:i + order)))
         call draw_truncated_lanes(c, u(lanes*(i - 1) + 1:lanes*i), drawn, hazard, factor)
         call place(length, order, history, is_wound, i, scale*drawn - centre, d)
         if (.not. present(y)) cycle
         drawn = (drawn - c - hazard)/sqrt(truncated_variance(c, hazard))
         call place(length, order, history, is_wound, i, &
                    drawn/sqrt(h(0)) - neighbours(order, h, y(:, i - order:i + order))/h(0), y)
      end do
   end subroutine redraw_lanes

   !> Sum of G_k (x_(i+k) + x_(i-k)).
   pure function neighbours(order, g, x) result(total)
      integer, intent(in) :: order
      real(wp), intent(in) :: g(0:order), x(lanes, -order:order)
      real(wp) :: total(lanes)
      integer :: k, lane

      total = 0.0_wp
      do k = 1, order
         !$omp simd
         do lane = 1, lanes
            total(lane) = total(lane) + g(k)*(x(lane, k) + x(lane, -k))
         end do
      end do
   end function neighbours

   !> Stores a value, and its copy beyond the other end of the ring.
   pure subroutine place(length, order, history, is_wound, i, value, x)
      integer, intent(in) :: length, order, history, i
      logical, intent(in) :: is_wound
      real(wp), intent(in) :: value(lanes)
      real(wp), intent(inout) :: x(lanes, 1 - history:length + order)

      x(:, i) = value
      if (i <= order) x(:, length + i) = merge(cshift(value, 1), value, is_wound)
      if (i > length - history) x(:, i - length) = merge(cshift(value, -1), value, is_wound)
   end subroutine place

   !> Computes psi, and its standard error. A start is forgotten at the rate 1 - t (1 - gap): the
   !> sooner, the weaker the correlation.
   subroutine log_partition(g, field, ring_length, n_burn_in, n_sweeps, stream, psi, standard_error)
      real(wp), intent(in) :: g(0:), field  !! see `sample_exact`
      integer, intent(in) :: ring_length
      integer, intent(in) :: n_burn_in, n_sweeps   !! sweeps at t = 1, and sweeps of a batch
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: psi, standard_error
      integer, parameter :: n_nodes = 16
      real(wp), parameter :: wanted = 5.76_wp   ! ln(1e5)/2, of a start as in `sweeps_to_forget`
      real(wp) :: error, gap, mu, nodes(n_nodes), slope, symbol(0:ubound(g, 1)), t(n_nodes), &
         variance, weights(n_nodes)
      integer :: i

      mu = max(field, 0.0_wp)/(g(0) + 2.0_wp*sum(g(1:)))
      psi = log_sqrt_two_pi - 0.5_wp*log(g(0))
      if (field > 0.0_wp) then
         psi = psi + 0.5_wp*mu*field + log_acceptance(mu*sqrt(g(0)))
      else
         psi = psi + 0.5_wp*field**2/g(0) + log_acceptance(field/sqrt(g(0)))
      end if
      variance = 0.0_wp
      ! t = u (2 - u): denser towards t = 1, where a long correlation grows fast
      call gauss_legendre(0.0_wp, 1.0_wp, nodes, weights)
      t = nodes*(2.0_wp - nodes)
      weights = weights*2.0_wp*(1.0_wp - nodes)/t
      gap = min(1.0_wp, wanted/n_burn_in)
      do i = 1, n_nodes
         symbol = g*t(i)
         symbol(0) = g(0)
         call sample_slope(symbol, mu, min(field, 0.0_wp), ring_length, &
                           ceiling(wanted/(1.0_wp - t(i)*(1.0_wp - gap))), n_sweeps, &
                           stream, slope, error)
         psi = psi + weights(i)*slope
         variance = variance + (weights(i)*error)**2
      end do
      standard_error = norm2([sqrt(variance), between_nodes])
   end subroutine log_partition

   !> Estimates - sum G_k E[(z_i - mu)(z_(i+k) - mu)], k > 0, under the law of this G, centred on
   !> mu. Where G is indefinite its companion is that of a G of weaker correlation.
   subroutine sample_slope(g, mu, field, ring_length, n_burn_in, n_sweeps, stream, slope, &
                           standard_error)
      real(wp), intent(in) :: g(0:)
      real(wp), intent(in) :: mu             !! not negative
      real(wp), intent(in) :: field          !! a further one, not positive
      integer, intent(in) :: ring_length, n_burn_in, n_sweeps
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: slope, standard_error
      integer, parameter :: n_batches = 8*lanes
      type(batch_averages) :: batches
      real(wp), allocatable :: a(:)
      real(wp), dimension(0:ubound(g, 1)) :: companion, weaker, weights
      real(wp) :: b0
      integer :: order
      logical :: is_positive

      order = ubound(g, 1)
      weaker = g
      do
         call equivalent_process(weaker, a, b0, is_positive)
         if (is_positive) exit
         deallocate (a)
         weaker(1:) = 0.8_wp*weaker(1:)
      end do
      call reciprocal_of_process(a, 1.0_wp, companion, is_positive)
      batches = new_batches(order, order, n_batches)
      call sample_exact(g, mu*(g(0) + 2.0_wp*sum(g(1:))) + field, a, mu, ring_length, n_burn_in, &
                        n_sweeps, stream, batches)
      weights = -g
      weights(0) = 0.0_wp
      call estimate_products(batches, companion, weights, slope, standard_error)
   end subroutine sample_slope

   !> Entropy per point of x/b0, by E[x_i (G (x - mu))_i] = 1: Eq. (43) with its factor 1/2.
   elemental function entropy_of_exact_law(psi, field, mean) result(entropy)
      real(wp), intent(in) :: psi, field
      real(wp), intent(in) :: mean   !! E[x]/b0
      real(wp) :: entropy

      entropy = psi + 0.5_wp - 0.5_wp*field*mean
   end function entropy_of_exact_law

end module process_positive_exact
