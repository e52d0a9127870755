!> Simulates the law of Eq. (25) on positive values in an infinite domain: values of a ring, much
!> longer than the memory, are redrawn one at a time given their neighbours (Gibbs).
!>
!> A redrawn value is truncated normal and moves by less than its neighbours do. Two rings with the
!> same random numbers therefore approach each other at a known rate, which gives the number of
!> sweeps that forgets the start. Everything is in units of b0.
!>
!> Thermodynamic integration gives the normalizing constant and the entropy. With z = x/b0 the
!> density is exp(- z'Gz/2 + field sum z)/Z, and psi is ln Z per point. If the entries of G off its
!> diagonal are multiplied by t, psi is known at t = 0 and has the derivative
!> - sum G_k E[z_i z_(i+k)], which is sampled at Gauss nodes up to t = 1.
module process_positive_exact
   use core_kinds, only: wp
   use core_random, only: stream_type
   use numerics_quadrature, only: gauss_legendre
   use process_autoregressive_spectral_factor, only: equivalent_process, reciprocal_of_process, &
                                                     symbol_of_process
   use process_positive_moments, only: add_products, batch_averages, estimate_products, new_batches
   use process_positive_truncated_normal, only: draw_truncated_lanes, lanes, log_acceptance, &
                                                log_sqrt_two_pi, reciprocal_std
   implicit none(type, external)
   private
   public :: sweeps_to_forget, sample_exact, draw_window
   public :: log_partition

   real(wp), parameter :: between_nodes = 1.0e-6_wp   !! error of the integration at L0 = 10

   !> Rings of values, one per lane, or one ring wound over all lanes.
   type :: ring_type
      integer :: length = 0              !! values per lane
      integer :: history = 0             !! copies of values that are kept before the first one
      logical :: is_wound = .false.      !! true: one ring, which the next lane continues
      real(wp) :: field = 0.0_wp         !! mu (G_0 + 2 sum G_m)
      real(wp) :: centre = 0.0_wp        !! start of every value, near the mean
      real(wp), allocatable :: g(:)      !! (0:order) row of the precision matrix G, Eq. (25)
      real(wp), allocatable :: d(:, :)   !! (lane, 1-history:length+order) x - centre
      real(wp), allocatable :: h(:)      !! (0:order) G of the companion; not allocated: none
      real(wp), allocatable :: y(:, :)   !! values of the companion, as d
      real(wp), allocatable :: u(:)      !! random numbers of a sweep
   end type ring_type

contains

   !> Sweeps after which the weight of a start is below `tolerance`, at the rate of the Gaussian law
   !> of this variance and length: the smallest over the mean of 1/(power spectral density).
   pure integer function sweeps_to_forget(strength, l0, tolerance) result(n)
      real(wp), intent(in) :: strength   !! G_0 K(0)
      real(wp), intent(in) :: l0         !! [lags]
      real(wp), intent(in) :: tolerance
      real(wp) :: smallest

      smallest = 1.0_wp/(max(1.0_wp, strength)*(1.0_wp + 2.0_wp*l0))
      n = max(ceiling(log(tolerance)/log((1.0_wp - min(smallest, 0.999_wp))/(1.0_wp + smallest))), &
              4)
   end function sweeps_to_forget

   !> Simulates rings and averages over batches, each one lane over part of the sweeps; without
   !> acceptance sums.
   subroutine sample_exact(g, field, companion, centre, ring_length, n_burn_in, n_sweeps, stream, &
                           batches)
      real(wp), intent(in) :: g(0:)          !! row of G, lags 0..order
      real(wp), intent(in) :: field          !! mu (G_0 + 2 sum G_m)
      !> coefficients of the linear companion, unit innovations
      real(wp), intent(in) :: companion(:)
      real(wp), intent(in) :: centre         !! start, near the mean
      integer, intent(in) :: ring_length     !! much longer than the memory, and than all lags
      integer, intent(in) :: n_burn_in       !! sweeps before the first batch
      integer, intent(in) :: n_sweeps        !! sweeps of a batch
      type(stream_type), intent(inout) :: stream
      type(batch_averages), intent(inout) :: batches   !! allocated; a multiple of `lanes` batches
      type(ring_type) :: ring
      real(wp) :: sums(lanes, -1:batches%n_single + 2, 2)
      integer :: last, stretch, sweep

      batches%centre = centre
      ring = new_ring(g, field, centre, ring_length, max(batches%n_lags, ubound(g, 1)), .false.)
      allocate (ring%h(0:size(companion)), source=symbol_of_process(companion, 1.0_wp))
      ring%y = ring%d
      do sweep = 1, n_burn_in
         call redraw_ring(ring, stream)
      end do
      do stretch = 1, size(batches%x, 2)/lanes
         sums = 0.0_wp
         do sweep = 1, n_sweeps
            call redraw_ring(ring, stream)
            call add_products(ring%history, ring%length, batches%n_single, batches%n_lags, ring%d, &
                              sums(:, :, 1))
            call add_products(ring%history, ring%length, batches%n_single, batches%n_lags, ring%y, &
                              sums(:, :, 2))
         end do
         last = stretch*lanes
         batches%x(:, last - lanes + 1:last) = transpose(sums(:, :, 1))/(n_sweeps*ring%length)
         batches%y(:, last - lanes + 1:last) = transpose(sums(:, :, 2))/(n_sweeps*ring%length)
      end do
   end subroutine sample_exact

   !> Draws consecutive values of one stationary run from a ring that has forgotten its start, with
   !> margins longer than the memory.
   subroutine draw_window(g, field, start, margin, n_sweeps, stream, values)
      real(wp), intent(in) :: g(0:), field  !! see `sample_exact`
      real(wp), intent(in) :: start         !! near the mean
      integer, intent(in) :: margin         !! steps after which correlation is negligible
      integer, intent(in) :: n_sweeps
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: values(:)
      type(ring_type) :: ring
      integer :: n, sweep

      ring = new_ring(g, field, start, max((size(values) + 2*margin + lanes - 1)/lanes, size(g)), &
                      ubound(g, 1), .true.)
      do sweep = 1, n_sweeps
         call redraw_ring(ring, stream)
      end do
      do n = 1, size(values)
         values(n) = start + ring%d((n - 1)/ring%length + 1, modulo(n - 1, ring%length) + 1)
      end do
   end subroutine draw_window

   pure type(ring_type) function new_ring(g, field, centre, length, history, is_wound) result(ring)
      real(wp), intent(in) :: g(0:), field, centre
      integer, intent(in) :: length, history
      logical, intent(in) :: is_wound

      ring = ring_type(length, history, is_wound, field, centre)
      allocate (ring%g(0:ubound(g, 1)), source=g)
      allocate (ring%d(lanes, 1 - history:length + ubound(g, 1)), source=0.0_wp)
      allocate (ring%u(lanes*length))
   end function new_ring

   !> Redraws every value given its neighbours: one sweep. All lanes move at once, because places a
   !> lane apart are no neighbours.
   subroutine redraw_ring(ring, stream)
      type(ring_type), intent(inout) :: ring
      type(stream_type), intent(inout) :: stream
      real(wp) :: c(lanes), drawn(lanes), factor(lanes), hazard(lanes), pull, scale
      integer :: i, order

      call stream%uniforms(ring%u)
      order = ubound(ring%g, 1)
      associate (length => ring%length, history => ring%history, g => ring%g)
         scale = 1.0_wp/sqrt(g(0))
         pull = ring%field - 2.0_wp*ring%centre*sum(g(1:))
         do i = 1, length
            c = scale*(pull - neighbour_sum(order, g, ring%d(:, i - order:i + order)))
            call draw_truncated_lanes(c, ring%u(lanes*(i - 1) + 1:lanes*i), drawn, hazard, factor)
            call store_value(length, order, history, ring%is_wound, i, scale*drawn - ring%centre, &
                             ring%d)
            if (.not. allocated(ring%y)) cycle
            drawn = (drawn - c - hazard)*reciprocal_std(c, hazard)
            drawn = drawn/sqrt(ring%h(0)) - neighbour_sum(order, ring%h, &
                                                          ring%y(:, i - order:i + order))/ring%h(0)
            call store_value(length, order, history, ring%is_wound, i, drawn, ring%y)
         end do
      end associate
   end subroutine redraw_ring

   !> Sum of G_k (x_(i+k) + x_(i-k)).
   pure function neighbour_sum(order, g, x) result(total)
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
   end function neighbour_sum

   !> Stores a value, and its copies beyond the ends of the ring.
   pure subroutine store_value(length, order, history, is_wound, i, value, x)
      integer, intent(in) :: length, order, history, i
      logical, intent(in) :: is_wound
      real(wp), intent(in) :: value(lanes)
      real(wp), intent(inout) :: x(lanes, 1 - history:length + order)

      x(:, i) = value
      if (i <= order) x(:, length + i) = merge(cshift(value, 1), value, is_wound)
      if (i > length - history) x(:, i - length) = merge(cshift(value, -1), value, is_wound)
   end subroutine store_value

   !> Computes psi, and its standard error. A start is forgotten at the rate 1 - t (1 - gap).
   subroutine log_partition(g, field, ring_length, n_burn_in, n_sweeps, stream, psi, standard_error)
      real(wp), intent(in) :: g(0:), field  !! see `sample_exact`
      integer, intent(in) :: ring_length
      integer, intent(in) :: n_burn_in, n_sweeps   !! sweeps at t = 1, and sweeps of a batch
      type(stream_type), intent(inout) :: stream
      real(wp), intent(out) :: psi, standard_error
      integer, parameter :: n_nodes = 16
      real(wp), parameter :: wanted = 5.76_wp   ! ln(1e5)/2: tolerance of the burn-in
      real(wp) :: error, gap, mu, nodes(n_nodes), row(0:ubound(g, 1)), slope, t(n_nodes), &
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
         row = g*t(i)
         row(0) = g(0)
         call sample_slope(ceiling(wanted/(1.0_wp - t(i)*(1.0_wp - gap))), slope, error)
         psi = psi + weights(i)*slope
         variance = variance + (weights(i)*error)**2
      end do
      standard_error = norm2([sqrt(variance), between_nodes])

   contains

      !> Estimates - sum G_k E[(z_i - mu)(z_(i+k) - mu)], k > 0, under the law of `row`. If its G is
      !> indefinite the companion is that of a weaker correlation.
      subroutine sample_slope(n_sweeps_before, slope, error)
         integer, intent(in) :: n_sweeps_before
         real(wp), intent(out) :: slope, error   !! slope and its standard error
         integer, parameter :: n_batches = 8*lanes
         type(batch_averages) :: batches
         real(wp), allocatable :: a(:)
         real(wp), dimension(0:ubound(g, 1)) :: companion, weaker
         real(wp) :: b0
         logical :: is_positive

         weaker = row
         do
            call equivalent_process(weaker, a, b0, is_positive)
            if (is_positive) exit
            deallocate (a)
            weaker(1:) = 0.8_wp*weaker(1:)
         end do
         call reciprocal_of_process(a, 1.0_wp, companion, is_positive)
         batches = new_batches(size(a), size(a), n_batches)
         call sample_exact(row, mu*(row(0) + 2.0_wp*sum(row(1:))) + min(field, 0.0_wp), a, mu, &
                           ring_length, n_sweeps_before, n_sweeps, stream, batches)
         call estimate_products(batches, companion, [0.0_wp, -row(1:)], slope, error)
      end subroutine sample_slope

   end subroutine log_partition

end module process_positive_exact
