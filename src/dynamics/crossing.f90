!> Stretches of one or two steps with transitions of different masses, many stretches side by side:
!> each transition is located on the path that its mass took, and what it changes for all masses is
!> added to the state that was reached as if it were not there.
!>
!> The path is the polynomial of degree 5 with the displacement, velocity and acceleration of both
!> ends of the stretch, which the equation of motion gives: it is off by (rate h)^6/46080 of the
!> amplitude, h the stretch. Where the force bends in the middle, the path of the forced mass has a
!> known third power more from there on. From the transition on, the new regime differs from the
!> old one by a force on that mass that is known, the contact force it no longer feels (or feels
!> again): phi(t) = +-(k/m) (x(t) - x(tau)) of the old path. The answer at the end of the stretch is
!> sum_m A^m b psi_m with psi_m the (m+1)-fold integral of phi.
!>
!> The path of a mass that switches after another one bends where that one did only in its fourth
!> derivative, by damping, and is still that polynomial to the same accuracy.
module dynamics_crossing
   use core_kinds, only: wp
   use dynamics_propagator, only: width
   use dynamics_quiet, only: at_anchor, at_direction, at_reach, at_slider, at_state, sample_size
   implicit none(type, external)
   private
   public :: capacity, crossing_batch, new_batch, path_error, read_mass, locate, step_across

   integer, parameter :: capacity = 32          !! stretches side by side
   integer, parameter :: lanes = 8              !! of a vector
   integer, parameter :: degree = 5

   !> Transitions to be located, one in each lane; arrays (lane).
   type :: crossing_batch
      integer :: n = 0             !! lanes in use
      integer :: terms = width     !! of the sum over A^m b psi_m
      integer :: iterations = 3    !! to the time of a transition
      real(wp) :: last_step = 0.0_wp   !! that the last of them may be [stretches]
      ! the mass before the stretch, after it, and its contact
      real(wp), dimension(capacity) :: x0 = 0.0_wp, u0 = 0.0_wp, pull0 = 0.0_wp
      real(wp), dimension(capacity) :: x1 = 0.0_wp, u1 = 0.0_wp, pull1 = 0.0_wp
      real(wp), dimension(capacity) :: slider = 0.0_wp, reach = 0.0_wp, direction = 0.0_wp
      real(wp), dimension(capacity) :: contact = 0.0_wp     !! h^2 k/m
      real(wp), dimension(capacity) :: kink = 0.0_wp        !! bend of the force that acts on it
      real(wp), dimension(capacity) :: span = 1.0_wp        !! length of the stretch [steps]
      ! what has been found
      real(wp), dimension(capacity) :: is_stick = 0.0_wp    !! 1: a slip ends, 0: one starts
      real(wp), dimension(capacity) :: sense = 1.0_wp       !! +1 or -1: way of the slip
      real(wp), dimension(capacity) :: is_located = 0.0_wp  !! 1: well, and it is the first one
      real(wp), dimension(capacity) :: tau = 0.0_wp         !! when [stretches]
      real(wp), dimension(capacity) :: x = 0.0_wp, u = 0.0_wp   !! there, velocity per stretch
      real(wp) :: psi(capacity, 0:width - 1) = 0.0_wp
   end type crossing_batch

contains

   !> Error that the path of degree 5 leaves in a displacement, relative to its amplitude.
   pure function path_error(rate_step) result(error)
      real(wp), intent(in) :: rate_step   !! rate times the length of the stretch
      real(wp) :: error

      error = rate_step**2*rate_step**6/46080.0_wp   ! the force that sets in carries (rate h)^2
   end function path_error

   !> An empty batch whose sums and iterations keep a tolerance, relative to the amplitude.
   pure function new_batch(rate_step, tolerance) result(batch)
      real(wp), intent(in) :: rate_step   !! rate times the length of the longest stretch
      real(wp), intent(in) :: tolerance
      type(crossing_batch) :: batch
      real(wp) :: rest
      integer :: m

      rest = 0.5_wp*rate_step
      do m = 1, width - 1   ! what the sum leaves out: (rate h)^(m + 1)/(m + 2)!
         rest = rest*rate_step/(m + 2)
         if (rest <= tolerance) exit
      end do
      batch%terms = m
      ! an iteration leaves some (rate h)^2/6 times the cube of its step, and the force that sets in
      ! carries (rate h)^2 more
      batch%last_step = min(0.1_wp, 0.5_wp*(6.0_wp*tolerance/rate_step**4)**(1.0_wp/3.0_wp))
      batch%iterations = merge(2, 3, batch%last_step > rate_step**2)
   end function new_batch

   !> Reads mass i of a sample into a lane.
   pure subroutine read_mass(batch, l, i, stride, pull, contact, load, kink, place, sample)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: l, i, stride, place
      real(wp), intent(in) :: pull(width, 2, width)
      real(wp), intent(in) :: contact   !! h^2 k/m
      real(wp), intent(in) :: load(2)   !! h^2 f/m at both ends, 0 if the force acts on another mass
      real(wp), intent(in) :: kink      !! and its bend
      real(wp), intent(in) :: sample(width, sample_size)
      real(wp) :: back(width, 2)
      integer :: j, x0, x1

      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      !$omp simd
      do j = 1, width
         back(j, 1) = pull(j, 1, i)*sample(j, x0) + pull(j, 2, i)*sample(j, x0 + 1)
         back(j, 2) = pull(j, 1, i)*sample(j, x1) + pull(j, 2, i)*sample(j, x1 + 1)
      end do
      batch%x0(l) = sample(i, x0)
      batch%u0(l) = sample(i, x0 + 1)
      batch%pull0(l) = load(1) + contact*sample(i, at_anchor) - total(back(:, 1))
      batch%x1(l) = sample(i, x1)
      batch%u1(l) = sample(i, x1 + 1)
      batch%pull1(l) = load(2) + contact*sample(i, at_anchor) - total(back(:, 2))
      batch%slider(l) = sample(i, at_slider)
      batch%reach(l) = sample(i, at_reach)
      batch%direction(l) = sample(i, at_direction)
      batch%contact(l) = contact
      batch%kink(l) = kink
      batch%span(l) = stride
   end subroutine read_mass

   !> The sum in pairs, none of which waits for another.
   pure function total(x)
      real(wp), intent(in) :: x(width)
      real(wp) :: total

      total = ((x(1) + x(2)) + (x(3) + x(4))) + ((x(5) + x(6)) + (x(7) + x(8)))
   end function total

   !> Finds the transition of the mass that each lane has read, if it shows at the stretch's end,
   !> and integrates the force that sets in. Lanes beyond those in use, to whole vectors, repeat
   !> what they had.
   !>
   !> The guard, positive at first and negative at the end, has but one zero if it falls all the way
   !> or is concave all the way; the zeros of its own parabolas, from one to the next, then close in
   !> on it with order three.
   pure subroutine locate(batch)
      type(crossing_batch), intent(inout) :: batch
      real(wp), dimension(capacity) :: bend, cube, gain, square, step
      real(wp), dimension(capacity, 0:degree) :: guard, path
      integer :: iteration, k, l, n

      n = whole_vectors(batch%n)
      call join_ends(batch, n, path, bend, guard, cube, square, gain)
      batch%tau(:n) = 0.0_wp
      do iteration = 1, batch%iterations
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
               late = max(t - 0.5_wp, 0.0_wp)
               value = value + (cube(l)*late + square(l))*late**2
               slope = slope + (3.0_wp*cube(l)*late + 2.0_wp*square(l))*late
               half_bend = half_bend + 3.0_wp*cube(l)*late + &
                           merge(square(l), 0.0_wp, late > 0.0_wp)
               root = sqrt(max(slope**2 - 4.0_wp*half_bend*value, 0.0_wp))
               step(l) = 2.0_wp*value/(root - slope)
               batch%tau(l) = t + step(l)
            end block
         end do
      end do
      !$omp simd
      do l = 1, n
         block
            real(wp) :: falling, concave, ok
            falling = 0.0_wp
            concave = 0.0_wp
            !GCC$ unroll 3
            do k = 3, degree
               falling = falling + k*abs(guard(l, k))
               concave = concave + k*(k - 1)*abs(guard(l, k))
            end do
            falling = falling + max(guard(l, 1), guard(l, 1) + 2.0_wp*guard(l, 2)) + &
                      0.75_wp*abs(cube(l)) + abs(square(l))
            concave = concave + 2.0_wp*guard(l, 2) + 3.0_wp*abs(cube(l)) + 2.0_wp*abs(square(l))
            ! a velocity must fall all the way: then the mass moves back when it has stuck
            concave = merge(concave, 1.0_wp, batch%is_stick(l) < 0.5_wp)
            ok = merge(batch%is_located(l), 0.0_wp, min(falling, concave) < 0.0_wp)
            ok = merge(ok, 0.0_wp, guard(l, 0) > 0.0_wp)
            ok = merge(ok, 0.0_wp, abs(step(l)) < batch%last_step)
            ok = merge(ok, 0.0_wp, batch%tau(l) > 0.0_wp)
            batch%is_located(l) = merge(ok, 0.0_wp, batch%tau(l) < 1.0_wp)
         end block
      end do
      call integrate_force(batch, n, path, bend, gain)
   end subroutine locate

   !> The path between the ends, and the guard along it, positive at first: what a stuck mass has
   !> left to its limit, or the velocity of a slipping one. is_located is 1 where it is crossed at
   !> the end; where it is not, the guard is a harmless 1 - 2 t.
   pure subroutine join_ends(batch, n, path, bend, guard, cube, square, gain)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n
      real(wp), dimension(capacity, 0:degree), intent(out) :: path, guard
      real(wp), intent(out) :: bend(capacity)                 !! of (t - 1/2)^3 in the path
      real(wp), dimension(capacity), intent(out) :: cube, square   !! of the same in the guard
      real(wp), intent(out) :: gain(capacity) !! +h^2 k/m when a slip starts, - when it ends
      integer :: l

      !$omp simd
      do l = 1, n
         block
            real(wp) :: a0, a1, crosses, da, du, dx, extension, held, limit, sense, slips, span, &
               stick, u0
            stick = min(1.0_wp, abs(batch%direction(l)))
            extension = batch%x1(l) - batch%slider(l)
            ! past the limit, but not by so long a run that it might have touched the other side
            ! first; or turned back
            slips = min(abs(extension) - batch%reach(l), &
                        batch%reach(l) - abs(batch%x1(l) - batch%x0(l)))
            crosses = merge(-batch%direction(l)*batch%u1(l), slips, stick > 0.5_wp)
            sense = merge(batch%direction(l), sign(1.0_wp, extension), stick > 0.5_wp)
            limit = batch%slider(l) + sense*min(batch%reach(l), abs(extension))
            held = (1.0_wp - stick)*batch%contact(l)
            span = batch%span(l)
            bend(l) = 4.0_wp/3.0_wp*batch%kink(l)   ! (2 h)^3 df/(6 h m)
            cube(l) = -(1.0_wp - stick)*sense*bend(l)
            square(l) = 3.0_wp*stick*sense*bend(l)
            gain(l) = (1.0_wp - 2.0_wp*stick)*batch%contact(l)
            batch%is_stick(l) = stick
            batch%sense(l) = sense

            u0 = span*batch%u0(l)
            a0 = span**2*(batch%pull0(l) - held*batch%x0(l))
            a1 = span**2*(batch%pull1(l) - held*batch%x1(l))
            dx = (batch%x1(l) - batch%x0(l)) - u0 - 0.5_wp*a0 - 0.125_wp*bend(l)
            du = (span*batch%u1(l) - u0) - a0 - 0.75_wp*bend(l)
            da = a1 - a0 - 3.0_wp*bend(l)
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
         end block
      end do
   end subroutine join_ends

   !> psi_m = gain/m! times the integral of (1 - t)^m (x(t) - x(tau)) over the rest of the stretch,
   !> by Gauss and Legendre; also x and u at tau.
   pure subroutine integrate_force(batch, n, path, bend, gain)
      type(crossing_batch), intent(inout) :: batch
      integer, intent(in) :: n
      real(wp), intent(in) :: path(capacity, 0:degree), bend(capacity), gain(capacity)
      integer, parameter :: nodes = 4   ! exact to power 7
      real(wp), parameter :: node(0:nodes) = [0.0_wp, 0.069431844202973714_wp, &
         0.33000947820757187_wp, 0.66999052179242813_wp, 0.93056815579702629_wp]
      real(wp), parameter :: weight(nodes) = [0.17392742256872693_wp, 0.32607257743127307_wp, &
                                              0.32607257743127307_wp, 0.17392742256872693_wp]
      real(wp) :: x(capacity, 0:nodes), part(capacity, nodes), rest(capacity, nodes)
      integer :: g, k, l, m

      do g = 0, nodes
         !$omp simd
         do l = 1, n
            block
               real(wp) :: late, t, value, slope
               t = batch%tau(l) + node(g)*(1.0_wp - batch%tau(l))
               value = path(l, degree)
               slope = 0.0_wp
               !GCC$ unroll 5
               do k = degree - 1, 0, -1
                  slope = slope*t + value
                  value = value*t + path(l, k)
               end do
               late = max(t - 0.5_wp, 0.0_wp)
               x(l, g) = value + bend(l)*late**3
               batch%u(l) = merge(batch%u(l), slope + 3.0_wp*bend(l)*late**2, g > 0)
            end block
         end do
      end do
      batch%x(:n) = x(:n, 0)
      do g = 1, nodes
         !$omp simd
         do l = 1, n
            block
               real(wp) :: left
               left = batch%span(l)*(1.0_wp - batch%tau(l))
               rest(l, g) = left*(1.0_wp - node(g))
               part(l, g) = gain(l)*weight(g)*left*(x(l, g) - x(l, 0))
            end block
         end do
      end do
      do m = 0, batch%terms - 1
         !$omp simd
         do l = 1, n
            batch%psi(l, m) = (part(l, 1) + part(l, 2)) + (part(l, 3) + part(l, 4))
            part(l, 1) = part(l, 1)*rest(l, 1)*(1.0_wp/(m + 1))
            part(l, 2) = part(l, 2)*rest(l, 2)*(1.0_wp/(m + 1))
            part(l, 3) = part(l, 3)*rest(l, 3)*(1.0_wp/(m + 1))
            part(l, 4) = part(l, 4)*rest(l, 4)*(1.0_wp/(m + 1))
         end do
      end do
   end subroutine integrate_force

   !> Adds the effect of the transition of a lane, of mass i, to the state that was reached without
   !> it.
   pure subroutine step_across(batch, l, i, kick, place, sample)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: l, i, place
      real(wp), intent(in) :: kick(width, 2, 0:width - 1, width)     !! of the new pattern
      real(wp), intent(inout) :: sample(width, sample_size)
      real(wp) :: x(width), u(width)
      integer :: j, m, x1

      x1 = at_state + 2 - 2*place
      x = sample(:, x1)
      u = sample(:, x1 + 1)
      do m = 0, batch%terms - 1
         !$omp simd
         do j = 1, width
            x(j) = x(j) + batch%psi(l, m)*kick(j, 1, m, i)
            u(j) = u(j) + batch%psi(l, m)*kick(j, 2, m, i)
         end do
      end do
      sample(:, x1) = x
      sample(:, x1 + 1) = u
   end subroutine step_across

   !> n, padded to whole vectors.
   pure integer function whole_vectors(n)
      integer, intent(in) :: n

      whole_vectors = lanes*((n + lanes - 1)/lanes)
   end function whole_vectors

end module dynamics_crossing
