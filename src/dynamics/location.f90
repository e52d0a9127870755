!> Where on its path each mass of a batch has its transition, and what the change of its regime
!> amounts to from there on (dynamics_crossing).
module dynamics_location
   use core_kinds, only: wp
   use dynamics_crossing, only: capacity, crossing_batch, kinks, kink_time
   use dynamics_propagator, only: width
   use dynamics_registers, only: whole_registers
   implicit none(type, external)
   private
   public :: locate

   integer, parameter :: degree = 5   !! of a path

contains

   !> Finds the transition of the mass that each lane has read, if it shows at the stretch's end,
   !> and integrates the force that sets in. Lanes beyond those in use, to whole vectors, repeat
   !> what they had.
   !>
   !> The guard, positive at first and negative at the end, has but one zero if it falls all the way
   !> or is concave all the way. From the zero of its chord, the zeros of its own parabolas close in
   !> on it with order three: two of them are near enough, but for rare cases that say so.
   pure subroutine locate(batch)
      type(crossing_batch), intent(inout) :: batch
      real(wp), dimension(capacity) :: gain, step
      real(wp), dimension(capacity, 0:degree) :: guard, path
      real(wp), dimension(capacity, kinks) :: cube, square
      integer, parameter :: iterations = 2
      integer :: iteration, k, l, n

      n = whole_registers(batch%n)
      call join_ends(batch, n, path, guard, cube, square, gain)
      call find_clear(batch, n, path)
      do iteration = 1, iterations
         !$omp simd
         do l = 1, n
            block
               real(wp) :: value, slope, half_bend, late, root, t
               t = batch%tau(l)
               value = guard(l, degree)
               slope = 0.0_wp
               half_bend = 0.0_wp
               !GCC$ unroll 5
               do k = degree - 1, 0, -1
                  half_bend = half_bend*t + slope
                  slope = slope*t + value
                  value = value*t + guard(l, k)
               end do
               !GCC$ unroll 3
               do k = 1, kinks
                  late = max(t - kink_time(k), 0.0_wp)
                  value = value + (cube(l, k)*late + square(l, k))*late**2
                  slope = slope + (3.0_wp*cube(l, k)*late + 2.0_wp*square(l, k))*late
                  half_bend = half_bend + 3.0_wp*cube(l, k)*late + &
                              merge(square(l, k), 0.0_wp, late > 0.0_wp)
               end do
               root = sqrt(max(slope**2 - 4.0_wp*half_bend*value, 0.0_wp))
               step(l) = 2.0_wp*value/(root - slope)
               batch%tau(l) = t + step(l)
            end block
         end do
      end do
      !$omp simd
      do l = 1, n
         block
            real(wp) :: falling, concave, ok, run
            falling = 0.0_wp
            concave = 0.0_wp
            !GCC$ unroll 3
            do k = 3, degree
               falling = falling + k*abs(guard(l, k))
               concave = concave + k*(k - 1)*abs(guard(l, k))
            end do
            falling = falling + max(guard(l, 1), guard(l, 1) + 2.0_wp*guard(l, 2))
            concave = concave + 2.0_wp*guard(l, 2)
            !GCC$ unroll 3
            do k = 1, kinks
               falling = falling + (3.0_wp*(1.0_wp - kink_time(k))*abs(cube(l, k)) + &
                                    2.0_wp*abs(square(l, k)))*(1.0_wp - kink_time(k))
               concave = concave + 6.0_wp*(1.0_wp - kink_time(k))*abs(cube(l, k)) + &
                         2.0_wp*abs(square(l, k))
            end do
            ! a velocity must fall all the way: then the mass moves back when it has stuck; a mass
            ! that turns on its way must not run so far that it might touch its other limit first
            run = merge(abs(batch%x1(l) - batch%x0(l)), batch%reach(l), batch%is_stick(l) < 0.5_wp)
            concave = merge(concave, 1.0_wp, run < batch%reach(l))
            ok = merge(batch%is_located(l), 0.0_wp, min(falling, concave) < 0.0_wp)
            ok = merge(ok, 0.0_wp, guard(l, 0) > 0.0_wp)
            ok = merge(ok, 0.0_wp, abs(step(l)) < batch%last_step)
            ok = merge(ok, 0.0_wp, batch%tau(l) > 0.0_wp)
            batch%is_located(l) = merge(ok, 0.0_wp, batch%tau(l) < 1.0_wp)
         end block
      end do
      call integrate_force(batch, n, gain, path)
   end subroutine locate

   !> The path between the ends, and the guard along it, positive at first: what a stuck mass has
   !> left to its limit, or the velocity of a slipping one. is_located is 1 where it is crossed at
   !> the end; where it is not, the guard is a harmless 1 - 2 t.
   pure subroutine join_ends(batch, n, path, guard, cube, square, gain)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n
      real(wp), dimension(capacity, 0:degree), intent(out) :: path, guard
      real(wp), dimension(capacity, kinks), intent(out) :: cube, square   !! of t - kink_time in it
      real(wp), intent(out) :: gain(capacity) !! +h^2 k/m when a slip starts, - when it ends
      integer :: k, l

      !$omp simd
      do l = 1, n
         block
            real(wp) :: a0, a1, crosses, da, du, dx, extension, held, limit, sense, slips, span, &
               stick, u0
            stick = min(1.0_wp, abs(batch%direction(l)))
            extension = batch%x1(l) - batch%slider(l)
            slips = abs(extension) - batch%reach(l)
            crosses = merge(-batch%direction(l)*batch%u1(l), slips, stick > 0.5_wp)
            sense = merge(batch%direction(l), sign(1.0_wp, extension), stick > 0.5_wp)
            limit = batch%slider(l) + sense*min(batch%reach(l), abs(extension))
            held = (1.0_wp - stick)*batch%contact(l)
            span = batch%span(l)
            gain(l) = (1.0_wp - 2.0_wp*stick)*batch%contact(l)
            batch%is_stick(l) = stick
            batch%sense(l) = sense

            u0 = span*batch%u0(l)
            a0 = span**2*(batch%pull0(l) - held*batch%x0(l))
            a1 = span**2*(batch%pull1(l) - held*batch%x1(l))
            dx = (batch%x1(l) - batch%x0(l)) - u0 - 0.5_wp*a0
            du = (span*batch%u1(l) - u0) - a0
            da = a1 - a0
            !GCC$ unroll 3
            do k = 1, kinks
               dx = dx - (1.0_wp - kink_time(k))**3*batch%bend(l, k)
               du = du - 3.0_wp*(1.0_wp - kink_time(k))**2*batch%bend(l, k)
               da = da - 6.0_wp*(1.0_wp - kink_time(k))*batch%bend(l, k)
               cube(l, k) = -(1.0_wp - stick)*sense*batch%bend(l, k)
               square(l, k) = 3.0_wp*stick*sense*batch%bend(l, k)
            end do
            path(l, 0) = batch%x0(l)
            path(l, 1) = u0
            path(l, 2) = 0.5_wp*a0
            path(l, 3) = 10.0_wp*dx - 4.0_wp*du + 0.5_wp*da
            path(l, 4) = -15.0_wp*dx + 7.0_wp*du - da
            path(l, 5) = 6.0_wp*dx - 3.0_wp*du + 0.5_wp*da

            guard(l, 0) = sense*merge(path(l, 1), limit - path(l, 0), stick > 0.5_wp)
            guard(l, 1) = sense*merge(2.0_wp*path(l, 2), -path(l, 1), stick > 0.5_wp)
            guard(l, 2) = sense*merge(3.0_wp*path(l, 3), -path(l, 2), stick > 0.5_wp)
            guard(l, 3) = sense*merge(4.0_wp*path(l, 4), -path(l, 3), stick > 0.5_wp)
            guard(l, 4) = sense*merge(5.0_wp*path(l, 5), -path(l, 4), stick > 0.5_wp)
            guard(l, 5) = sense*merge(0.0_wp, -path(l, 5), stick > 0.5_wp)
            batch%is_located(l) = merge(1.0_wp, 0.0_wp, crosses > 0.0_wp)
            guard(l, 0) = merge(guard(l, 0), 1.0_wp, crosses > 0.0_wp)
            guard(l, 1) = merge(guard(l, 1), -2.0_wp, crosses > 0.0_wp)
            batch%tau(l) = merge(guard(l, 0)/(guard(l, 0) + crosses), 0.5_wp, crosses > 0.0_wp)
         end block
      end do
   end subroutine join_ends

   !> Where the guard has no zero for certain: displacement from the slider, or velocity, lies
   !> between the least and the largest of the polynomial's Bernstein coefficients, but for its
   !> kinks and for what the polynomial leaves out: (rate h)^6/46080 of the reach, its slope 4 times
   !> that.
   pure subroutine find_clear(batch, n, path)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n
      real(wp), intent(in) :: path(capacity, 0:degree)
      integer :: k, l

      !$omp simd
      do l = 1, n
         block
            real(wp) :: b0, b1, b2, b3, b4, b5, kink_u, kink_x, left_out, slack, speed, way
            left_out = (batch%rate_step*batch%span(l))**6/46080.0_wp*batch%reach(l)
            kink_x = 0.0_wp
            kink_u = 0.0_wp
            !GCC$ unroll 3
            do k = 1, kinks
               kink_x = kink_x + (1.0_wp - kink_time(k))**3*abs(batch%bend(l, k))
               kink_u = kink_u + 3.0_wp*(1.0_wp - kink_time(k))**2*abs(batch%bend(l, k))
            end do
            b0 = path(l, 0) - batch%slider(l)
            b1 = b0 + 0.2_wp*path(l, 1)
            b2 = b0 + 0.4_wp*path(l, 1) + 0.1_wp*path(l, 2)
            b3 = b0 + 0.6_wp*path(l, 1) + 0.3_wp*path(l, 2) + 0.1_wp*path(l, 3)
            b4 = b0 + 0.8_wp*path(l, 1) + 0.6_wp*path(l, 2) + 0.4_wp*path(l, 3) + 0.2_wp*path(l, 4)
            b5 = b0 + path(l, 1) + path(l, 2) + path(l, 3) + path(l, 4) + path(l, 5)
            slack = batch%reach(l) - left_out - kink_x - &
                    max(max(abs(b0), abs(b1), abs(b2)), max(abs(b3), abs(b4), abs(b5)))
            way = batch%direction(l)   ! the slope's coefficients are 5 times the differences
            speed = 5.0_wp*min(min(way*(b1 - b0), way*(b2 - b1), way*(b3 - b2)), &
                               min(way*(b4 - b3), way*(b5 - b4))) - 4.0_wp*left_out - kink_u
            slack = merge(speed, slack, batch%is_stick(l) > 0.5_wp)
            batch%is_clear(l) = merge(1.0_wp, 0.0_wp, slack > 0.0_wp)
         end block
      end do
   end subroutine find_clear

   !> psi_m = gain/m! times the integral of (1 - t)^m (x(t) - x(tau)) over the rest of the stretch:
   !> a power k of the path from tau on gives k!/(k + m + 1)! of the rest's (k + m + 1)th power.
   !> Kinks before tau belong to that path, those after it add 6 gain bend (1 - t)^(m + 4)/(m + 4)!,
   !> t the time of the kink. Also x and u at tau.
   pure subroutine integrate_force(batch, n, gain, path)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n
      real(wp), intent(in) :: gain(capacity)
      real(wp), intent(inout) :: path(capacity, 0:degree)
      integer :: j, k, l, m
      real(wp), parameter :: weight(degree, 0:width) = reshape( &
         [((gamma(k + 1.0_wp)/gamma(k + m + 2.0_wp), k=1, degree), m=0, width)], &
         [degree, width + 1])
      real(wp), parameter :: late_weight(kinks, 0:width) = reshape( &
         [((6.0_wp*(1.0_wp - kink_time(k))**(m + 4)/gamma(m + 5.0_wp), k=1, kinks), &
           m=0, width)], [kinks, width + 1])
      real(wp) :: late(capacity, kinks), rest(capacity), rests(capacity), spans(capacity)

      !$omp simd
      do l = 1, n
         block
            real(wp) :: bend, power
            !GCC$ unroll 3
            do k = 1, kinks
               bend = merge(batch%bend(l, k), 0.0_wp, batch%tau(l) >= kink_time(k))
               path(l, 0) = path(l, 0) - bend*kink_time(k)**3
               path(l, 1) = path(l, 1) + 3.0_wp*bend*kink_time(k)**2
               path(l, 2) = path(l, 2) - 3.0_wp*bend*kink_time(k)
               path(l, 3) = path(l, 3) + bend
               late(l, k) = batch%bend(l, k) - bend
            end do
            !GCC$ unroll 5
            do j = 0, degree - 1   ! to powers of the time since tau
               !GCC$ unroll 5
               do k = degree - 1, j, -1
                  path(l, k) = path(l, k) + batch%tau(l)*path(l, k + 1)
               end do
            end do
            batch%x(l) = path(l, 0)
            batch%u(l) = path(l, 1)
            rest(l) = 1.0_wp - batch%tau(l)
            power = 1.0_wp
            !GCC$ unroll 5
            do k = 1, degree
               power = power*rest(l)
               path(l, k) = path(l, k)*power
            end do
            rests(l) = rest(l)
            spans(l) = gain(l)*batch%span(l)
         end block
      end do
      do m = 0, batch%terms - 1
         !$omp simd
         do l = 1, n
            batch%psi(l, m) = spans(l)* &
               (rests(l)*((weight(1, m)*path(l, 1) + weight(2, m)*path(l, 2)) + &
                          (weight(3, m)*path(l, 3) + weight(4, m)*path(l, 4) + &
                           weight(5, m)*path(l, 5))) + &
                (late_weight(1, m)*late(l, 1) + late_weight(2, m)*late(l, 2) + &
                 late_weight(3, m)*late(l, 3)))
            rests(l) = rests(l)*rest(l)
            spans(l) = spans(l)*batch%span(l)
         end do
      end do
   end subroutine integrate_force

end module dynamics_location
