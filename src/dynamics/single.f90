!> Steps with one transition, eight at a time: located on the path that its mass took, and what it
!> changes for all masses added to the step that was taken as if there were none.
!>
!> The path is the polynomial of degree 5 with the displacement, velocity and acceleration of both
!> ends of the step, which the equation of motion gives: it is off by (rate h)^6/46080 of the
!> amplitude. From the transition on, the new regime differs from the old one by a force on that
!> mass that is known, the contact force it no longer feels (or feels again): phi(t) = +-(h^2 k/m)
!> (x(t) - x(tau)) of the old path. The answer at the end of the step is sum_m A^m b psi_m with
!> psi_m the (m+1)-fold integral of phi.
module dynamics_single
   use core_kinds, only: wp
   use dynamics_propagator, only: width
   use dynamics_quiet, only: add_further_masses, at_anchor, at_direction, at_reach, at_shift, &
                             at_slack, at_slider, at_state, sample_size, take_step
   implicit none(type, external)
   private
   public :: lanes, single_batch, path_error, read_path, locate, step_across

   integer, parameter :: lanes = 8
   integer, parameter :: degree = 5

   !> One transition in each lane; mass 0: none, the lane carries harmless numbers.
   type :: single_batch
      integer :: mass(lanes) = 0
      real(wp) :: is_stick(lanes) = 0.0_wp          !! 1: a slip that ends, 0: one that starts
      real(wp) :: sense(lanes) = 1.0_wp             !! +1 or -1: way of the slip
      real(wp) :: limit(lanes) = 0.0_wp             !! of x when a slip starts [m]
      real(wp) :: gain(lanes) = 0.0_wp              !! +h^2 k/m when a slip starts, - when it ends
      real(wp) :: ends(lanes, 6) = 0.0_wp           !! x, u, acceleration before and after the step
      real(wp) :: path(lanes, 0:degree) = 0.0_wp    !! x of the mass
      real(wp) :: tau(lanes) = 0.0_wp               !! of the transition [steps]
      real(wp) :: is_located(lanes) = 0.0_wp        !! 1: to rounding, and it is the first one
      real(wp) :: x(lanes) = 0.0_wp, u(lanes) = 0.0_wp   !! there, coming from before
      real(wp) :: psi(lanes, 0:width - 1) = 0.0_wp
   end type single_batch

contains

   !> Error that the path of degree 5 leaves in a displacement, relative to its amplitude.
   pure function path_error(rate_step) result(error)
      real(wp), intent(in) :: rate_step   !! rate times h
      real(wp) :: error

      error = rate_step**2*rate_step**6/46080.0_wp   ! the force that sets in carries (rate h)^2
   end function path_error

   !> Reads the transition of one sample into a lane, when there is but one and it shows at the
   !> step's end.
   pure subroutine read_path(batch, l, n, pull, contact, load, place, sample)
      type(single_batch), intent(inout) :: batch
      integer, intent(in) :: l, n, place
      real(wp), intent(in) :: pull(width, 2, width), contact(width)   !! contact: h^2 k/m
      real(wp), intent(in) :: load(width, 0:1)                        !! h^2 f/m at both ends
      real(wp), intent(in) :: sample(width, sample_size)
      real(wp) :: crosses, extension, held, run, slips, stick
      integer :: i, j, suspects, x0, x1

      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      suspects = 0
      i = 1
      do j = 1, n
         suspects = suspects + merge(1, 0, sample(j, at_slack) < 0.0_wp)
         i = merge(j, i, sample(j, at_slack) < 0.0_wp)
      end do
      extension = sample(i, x1) - sample(i, at_slider)
      run = sample(i, x1) - sample(i, x0)
      stick = min(1.0_wp, abs(sample(i, at_direction)))
      ! past the limit, but not by so long a run that it might have touched the other side first; or
      ! turned back
      slips = min(abs(extension) - sample(i, at_reach), sample(i, at_reach) - abs(run))
      crosses = merge(-sample(i, at_direction)*sample(i, x1 + 1), slips, stick > 0.5_wp)
      batch%mass(l) = merge(i, 0, suspects == 1 .and. crosses > 0.0_wp)
      batch%is_stick(l) = stick
      batch%sense(l) = merge(sample(i, at_direction), sign(1.0_wp, extension), stick > 0.5_wp)
      batch%gain(l) = (1.0_wp - 2.0_wp*stick)*contact(i)
      held = (1.0_wp - stick)*contact(i)
      batch%limit(l) = sample(i, at_slider) + &
                       batch%sense(l)*min(sample(i, at_reach), abs(extension))
      batch%ends(l, 1:2) = sample(i, x0:x0 + 1)
      batch%ends(l, 3) = load(i, 0) + contact(i)*sample(i, at_anchor) - held*sample(i, x0) - &
                         sum(pull(:, 1, i)*sample(:, x0) + pull(:, 2, i)*sample(:, x0 + 1))
      batch%ends(l, 4:5) = sample(i, x1:x1 + 1)
      batch%ends(l, 6) = load(i, 1) + contact(i)*sample(i, at_anchor) - held*sample(i, x1) - &
                         sum(pull(:, 1, i)*sample(:, x1) + pull(:, 2, i)*sample(:, x1 + 1))
   end subroutine read_path

   !> Finds every lane's transition and integrates the force that sets in.
   !>
   !> The guard, positive at first and negative at the end, has but one zero if it falls all the way
   !> or is concave all the way; the zeros of its own parabolas, from one to the next, then close in
   !> on it with order three.
   pure subroutine locate(batch)
      type(single_batch), intent(inout) :: batch
      integer, parameter :: iterations = 3            ! errors 1, (rate h)^2/6, and of its cube
      real(wp), parameter :: last_step = 1.0e-5_wp    ! at most
      real(wp) :: guard(lanes, 0:degree), step(lanes)
      integer :: iteration, k, l

      call join_ends(batch)
      call put_guard(batch, guard)
      batch%tau = 0.0_wp
      do iteration = 1, iterations
         !$omp simd
         do l = 1, lanes
            block
               real(wp) :: value, slope, half_bend, root, t
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
               root = sqrt(max(slope**2 - 4.0_wp*half_bend*value, 0.0_wp))
               step(l) = 2.0_wp*value/(root - slope)
               batch%tau(l) = t + step(l)
            end block
         end do
      end do
      !$omp simd
      do l = 1, lanes
         block
            real(wp) :: falling, concave, ok
            falling = 0.0_wp
            concave = 0.0_wp
            !GCC$ unroll 3
            do k = 3, degree
               falling = falling + k*abs(guard(l, k))
               concave = concave + k*(k - 1)*abs(guard(l, k))
            end do
            falling = falling + max(guard(l, 1), guard(l, 1) + 2.0_wp*guard(l, 2))
            concave = concave + 2.0_wp*guard(l, 2)
            ! a velocity must fall all the way: then the mass moves back when it has stuck
            concave = merge(concave, 1.0_wp, batch%is_stick(l) < 0.5_wp)
            ok = merge(1.0_wp, 0.0_wp, min(falling, concave) < 0.0_wp)
            ok = merge(ok, 0.0_wp, guard(l, 0) > 0.0_wp)
            ok = merge(ok, 0.0_wp, abs(step(l)) < last_step)
            ok = merge(ok, 0.0_wp, batch%tau(l) > 0.0_wp)
            batch%is_located(l) = merge(ok, 0.0_wp, batch%tau(l) < 1.0_wp)
         end block
      end do
      call integrate_force(batch)
   end subroutine locate

   !> The path between the ends.
   pure subroutine join_ends(batch)
      type(single_batch), intent(inout) :: batch
      integer :: l

      !$omp simd
      do l = 1, lanes
         block
            real(wp) :: dx, du, da
            dx = (batch%ends(l, 4) - batch%ends(l, 1)) - batch%ends(l, 2) - 0.5_wp*batch%ends(l, 3)
            du = (batch%ends(l, 5) - batch%ends(l, 2)) - batch%ends(l, 3)
            da = batch%ends(l, 6) - batch%ends(l, 3)
            batch%path(l, 0) = batch%ends(l, 1)
            batch%path(l, 1) = batch%ends(l, 2)
            batch%path(l, 2) = 0.5_wp*batch%ends(l, 3)
            batch%path(l, 3) = 10.0_wp*dx - 4.0_wp*du + 0.5_wp*da
            batch%path(l, 4) = -15.0_wp*dx + 7.0_wp*du - da
            batch%path(l, 5) = 6.0_wp*dx - 3.0_wp*du + 0.5_wp*da
         end block
      end do
   end subroutine join_ends

   !> What a stuck mass has left to its limit, or the velocity of a slipping one.
   pure subroutine put_guard(batch, guard)
      type(single_batch), intent(in) :: batch
      real(wp), intent(out) :: guard(lanes, 0:degree)
      integer :: k, l

      do k = 0, degree - 1
         !$omp simd
         do l = 1, lanes
            guard(l, k) = batch%sense(l)*merge((k + 1)*batch%path(l, k + 1), -batch%path(l, k), &
                                               batch%is_stick(l) > 0.5_wp)
         end do
      end do
      !$omp simd
      do l = 1, lanes
         guard(l, degree) = -batch%sense(l)*batch%path(l, degree)*(1.0_wp - batch%is_stick(l))
         guard(l, 0) = guard(l, 0) + batch%sense(l)*batch%limit(l)*(1.0_wp - batch%is_stick(l))
      end do
      where (batch%mass == 0)   ! harmless: the guard 1 - 2 tau
         guard(:, 0) = 1.0_wp
         guard(:, 1) = -2.0_wp
      end where
   end subroutine put_guard

   !> psi_m = gain/m! times the integral of (1 - t)^m (x(t) - x(tau)) over the rest of the step, by
   !> Gauss and Legendre; also x and u at tau.
   pure subroutine integrate_force(batch)
      type(single_batch), intent(inout) :: batch
      integer, parameter :: nodes = 4   ! exact to power 7
      real(wp), parameter :: node(0:nodes) = [0.0_wp, 0.069431844202973714_wp, &
         0.33000947820757187_wp, 0.66999052179242813_wp, 0.93056815579702629_wp]
      real(wp), parameter :: weight(nodes) = [0.17392742256872693_wp, 0.32607257743127307_wp, &
                                              0.32607257743127307_wp, 0.17392742256872693_wp]
      real(wp) :: x(lanes, 0:nodes)
      integer :: g, k, l, m

      do g = 0, nodes
         !$omp simd
         do l = 1, lanes
            block
               real(wp) :: t, value, slope
               t = batch%tau(l) + node(g)*(1.0_wp - batch%tau(l))
               value = batch%path(l, degree)
               slope = 0.0_wp
               !GCC$ unroll 5
               do k = degree - 1, 0, -1
                  slope = slope*t + value
                  value = value*t + batch%path(l, k)
               end do
               x(l, g) = value
               batch%u(l) = merge(batch%u(l), slope, g > 0)
            end block
         end do
      end do
      batch%x = x(:, 0)
      batch%psi = 0.0_wp
      do g = 1, nodes
         !$omp simd
         do l = 1, lanes
            block
               real(wp) :: part, rest
               rest = (1.0_wp - batch%tau(l))*(1.0_wp - node(g))
               part = batch%gain(l)*weight(g)*(1.0_wp - batch%tau(l))*(x(l, g) - x(l, 0))
               batch%psi(l, 0) = batch%psi(l, 0) + part
               !GCC$ unroll 7
               do m = 1, width - 1
                  part = part*(rest*(1.0_wp/m))
                  batch%psi(l, m) = batch%psi(l, m) + part
               end do
            end block
         end do
      end do
   end subroutine integrate_force

   !> Takes the step of a lane once more, with the effect of its transition added to what the
   !> anchors add; tells whether nothing else may have happened in the step, before or after it.
   pure subroutine step_across(batch, l, n, table, kick, force, floor, place, sample, is_clean)
      type(single_batch), intent(in) :: batch
      integer, intent(in) :: l, n, place
      real(wp), intent(in) :: table(width, 2, 2*width + 2)           !! of the old pattern
      real(wp), intent(in) :: kick(width, 2, 0:width - 1, width)     !! of the new pattern
      real(wp), intent(in) :: force(0:1), floor
      real(wp), intent(inout) :: sample(width, sample_size)
      logical, intent(out) :: is_clean
      real(wp) :: start(width, 2)
      integer :: i, j, m, x0, x1

      i = batch%mass(l)
      x0 = at_state + 2*place
      x1 = at_state + 2 - 2*place
      start = sample(:, at_shift:at_shift + 1)
      do m = 0, width - 1
         !$omp simd
         do j = 1, width
            start(j, 1) = start(j, 1) + batch%psi(l, m)*kick(j, 1, m, i)
            start(j, 2) = start(j, 2) + batch%psi(l, m)*kick(j, 2, m, i)
         end do
      end do
      call add_further_masses(n, table, sample(:, x0), sample(:, x0 + 1), start)
      call take_step(table, force, floor, place, start, sample)
      sample(i, at_slack) = 0.0_wp
      is_clean = .not. any(sample(:, at_slack) < 0.0_wp)
      if (is_clean) is_clean = stays(batch, l, sample(i, x1), sample(i, x1 + 1), &
                                     sample(i, at_reach))
   end subroutine step_across

   !> Whether the mass keeps its new regime to the end of the step, at x and u: a slip whose
   !> velocity stays clear of zero, or a stick that does not come as far as its other limit (it
   !> moves back all the way, as the velocity that fell through zero falls all the way).
   pure function stays(batch, l, x, u, limit)
      type(single_batch), intent(in) :: batch
      integer, intent(in) :: l
      real(wp), intent(in) :: x, u, limit
      logical :: stays
      real(wp) :: clear_of_zero, rest

      rest = 1.0_wp - batch%tau(l)
      clear_of_zero = rest*min(batch%sense(l)*batch%u(l), batch%sense(l)*u) - &
                      abs((batch%u(l) + u)*rest - 2.0_wp*(x - batch%x(l)))
      stays = merge(limit - abs(x - batch%x(l)), clear_of_zero, batch%is_stick(l) > 0.5_wp) > 0.0_wp
   end function stays

end module dynamics_single
