!> Transitions of eight suspects at a time: which of them have one, when, whether it is plain, and
!> what it adds to the end of the part.
!>
!> A suspect is clear if its guard has no zero in the part. It has one plain transition if its guard
!> falls or is concave all the way and is negative at the end, and the new guard keeps clear of
!> zero. Everything else is involved: that sample is marched again one transition after another.
!> Conditions are numbers, positive where they hold, so that the loop over the group is one of
!> vector operations. Numbers in brackets are the formulas of docs/exact_march.md.
module dynamics_exact_transitions
   use core_kinds, only: wp
   use dynamics_exact_guard_zeros, only: first_transition, no_crossing
   use dynamics_exact_joint_paths, only: joint_paths, layer_reach, layer_side, layer_slider, &
                                         layer_spring, width
   use dynamics_exact_series, only: most_degree
   implicit none(type, external)
   private
   public :: transition_group, examine, find_next, take_answer, take_suspects
   public :: group_size, n_near, clear, plain, involved, fall, last_integral

   integer, parameter :: group_size = 8
   integer, parameter :: n_near = 4   !! powers by which others follow a joint (7)
   integer, parameter :: last_integral = 7   !! s of I_s (M10): a register of them from 0
   integer, private :: k_, s_   ! of the constructor that follows
   !> k!/(k + s)!
   real(wp), parameter :: fall(most_degree, 0:last_integral) = reshape( &
                          [((gamma(k_ + 1.0_wp)/gamma(k_ + s_ + 1.0_wp), k_=1, most_degree), &
                            s_=0, last_integral)], [most_degree, last_integral + 1])
   integer, parameter :: clear = 0, plain = 1, involved = 2   !! verdicts

   !> Suspects 1 .. n of a group; the other entries are of no account. Innermost loops run over the
   !> group, so that they are vector operations.
   type :: transition_group
      integer :: n = 0
      integer, dimension(group_size) :: suspect, lane, joint, row, verdict   !! suspect: of the list
      real(wp), dimension(group_size) :: time       !! tau, from the start of the part [parts]
      real(wp), dimension(group_size) :: side = 0.0_wp   !! of the slip that ends; 0: it starts
      real(wp), dimension(group_size) :: way        !! direction of the slip that starts or ends
      real(wp), dimension(group_size) :: place      !! w.x at the transition [m]
      !> what the transition adds to the end of the joint's path and velocity (6), and the sums A_1
      !> .. A_4 for those around it and for their velocities (7)
      real(wp) :: ends(group_size, 2 + 2*n_near)
      ! of the joint and its row, before the transition
      real(wp), dimension(group_size), private :: slider = 0.0_wp, reach = 0.0_wp
      real(wp), dimension(group_size), private :: spring = 0.0_wp, stiffness = 0.0_wp
      real(wp), private :: own(group_size, n_near) = 0.0_wp
      !> where positive: a bound of the guard; a guard with a plain zero
      real(wp), dimension(group_size) :: is_clear, is_plain
      !> from tau on, after shift_path
      real(wp) :: path(group_size, 0:most_degree) = 0.0_wp
      real(wp) :: answer(group_size, 3:most_degree)            !! d of (6)
   end type transition_group

contains

   !> Judges the suspects first .. last of a part, at most eight.
   pure subroutine examine(paths, first, last, group)
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: first, last
      type(transition_group), intent(inout) :: group

      associate (list => paths%suspect(first:last))
         select case (paths%degree)   ! a constant degree makes loops over powers straight
         case (6)
            call solve(6, paths, list, group)
         case (7)
            call solve(7, paths, list, group)
         case (8)
            call solve(8, paths, list, group)
         case default
            call solve(paths%degree, paths, list, group)
         end select
      end associate
   end subroutine examine

   pure subroutine solve(degree, paths, list, group)
      integer, value :: degree
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: list(:)
      type(transition_group), intent(inout) :: group

      call take_suspects(degree, paths, list, group)
      call find_zero(degree, group)
      call shift_path(degree, group%time, group)
      call respond(degree, group)
      call judge(degree, group)
   end subroutine solve

   !> Finds the next transition of the first suspect after the time of the group, one after another,
   !> with its answer.
   pure subroutine find_next(degree, group, is_found)
      integer, intent(in) :: degree
      type(transition_group), intent(inout) :: group
      logical, intent(out) :: is_found
      real(wp) :: span

      span = first_transition(group%path(1, :degree), group%side(1), group%slider(1), &
                              group%reach(1), 1.0_wp - group%time(1))
      is_found = span < no_crossing
      if (.not. is_found) return
      group%time = group%time(1) + span
      call shift_path(degree, spread(span, 1, group_size), group)
      call respond(degree, group)
   end subroutine find_next

   !> Lets the first suspect go on after its transition by its answer, from its limit where it
   !> stuck.
   pure subroutine take_answer(paths, group)
      type(joint_paths), intent(in) :: paths
      type(transition_group), intent(inout) :: group

      call take_regimes(paths, group)
      group%path(:, 3:paths%degree) = group%path(:, 3:paths%degree) &
                                      + group%answer(:, 3:paths%degree)
      if (abs(group%side(1)) > 0.0_wp) return
      group%path(:, 0) = group%slider + group%way*group%reach
   end subroutine take_answer

   !> Takes over lanes, joints, paths and regimes of the suspects.
   pure subroutine take_suspects(degree, paths, list, group)
      integer, value :: degree
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: list(:)   !! of paths%suspect
      type(transition_group), intent(inout) :: group
      integer :: e, k

      group%n = size(list)
      do e = 1, group%n
         group%suspect(e) = list(e)
         group%lane(e) = 1 + iand(list(e) - 1, width - 1)
         group%joint(e) = 1 + (list(e) - 1)/width
         group%row(e) = paths%row(group%joint(e))
         associate (x => paths%x, l => group%lane(e), row => group%row(e))
            group%path(e, 0) = x(l, row, paths%layer(0))
            group%path(e, 1) = x(l, row, paths%layer(1))
            do k = 2, degree
               group%path(e, k) = x(l, row, k)
            end do
         end associate
      end do
      call take_regimes(paths, group)
      group%time = 0.0_wp
   end subroutine take_suspects

   pure subroutine take_regimes(paths, group)
      type(joint_paths), intent(in) :: paths
      type(transition_group), intent(inout) :: group
      integer :: e

      do e = 1, group%n
         associate (l => group%lane(e), j => group%joint(e), row => group%row(e))
            group%slider(e) = paths%regime(l, j, layer_slider)
            group%reach(e) = paths%regime(l, j, layer_reach)
            group%side(e) = paths%regime(l, j, layer_side)
            group%spring(e) = paths%regime(l, j, layer_spring)
            group%own(e, :) = paths%answers%own(:, row)
            group%stiffness(e) = paths%stiffness(l, row)
         end associate
      end do
   end subroutine take_regimes

   !> Finds the zero of the guard: that of its parabola, then two steps of Halley.
   pure subroutine find_zero(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), parameter :: last_step = 1.0e-5_wp   ! its cube is below rounding
      real(wp) :: g(group_size, 0:most_degree)
      real(wp), dimension(group_size) :: bend, curve, fall, finish, rest, sense, slope, step, t, &
                                         value
      real(wp) :: least, moving, other, turn
      integer :: e, halley, k

      associate (c => group%path, side => group%side, reach => group%reach)
         ! the guard: velocity along the slip, or distance to the limit that is nearer at the end
         value = c(:, degree)
         slope = degree*c(:, degree)
         do k = degree - 1, 1, -1
            !$omp simd
            do e = 1, group_size
               value(e) = value(e) + c(e, k)
               slope(e) = slope(e) + k*c(e, k)
            end do
         end do
         !$omp simd
         do e = 1, group_size
            moving = abs(side(e))
            value(e) = value(e) + (c(e, 0) - group%slider(e))
            sense(e) = merge(side(e), sign(1.0_wp, value(e)), moving > 0.0_wp)
            finish(e) = merge(sense(e)*slope(e), reach(e) - sense(e)*value(e), moving > 0.0_wp)
            g(e, 0) = merge(sense(e)*c(e, 1), reach(e) - sense(e)*(c(e, 0) - group%slider(e)), &
                            moving > 0.0_wp)
            g(e, degree) = merge(0.0_wp, -sense(e)*c(e, degree), moving > 0.0_wp)
            rest(e) = 0.0_wp
            fall(e) = 0.0_wp
            bend(e) = 0.0_wp
         end do
         do k = 1, degree - 1
            !$omp simd
            do e = 1, group_size
               g(e, k) = sense(e)*merge((k + 1)*c(e, k + 1), -c(e, k), abs(side(e)) > 0.0_wp)
            end do
         end do
         do k = 3, degree
            !$omp simd
            do e = 1, group_size
               rest(e) = rest(e) + abs(g(e, k))
               fall(e) = fall(e) + k*abs(g(e, k))
               bend(e) = bend(e) + (k*(k - 1))*abs(g(e, k))
            end do
         end do

         ! least values over the part: the parabola's, less the absolute values of the higher powers
         !$omp simd
         do e = 1, group_size
            moving = abs(side(e))
            turn = -g(e, 1)/merge(2.0_wp*g(e, 2), 1.0_wp, abs(g(e, 2)) > 1.0e-100_wp)
            turn = min(max(turn, 0.0_wp), 1.0_wp)
            turn = g(e, 0) + turn*(g(e, 1) + turn*g(e, 2))
            other = g(e, 0) + (g(e, 1) + g(e, 2))
            least = min(min(g(e, 0), turn), other) - rest(e)
            other = max(max(g(e, 0), turn), other) + rest(e)
            other = merge(1.0_wp, 2.0_wp*reach(e) - other, moving > 0.0_wp)
            group%is_clear(e) = min(least, other)
            fall(e) = -(g(e, 1) + max(2.0_wp*g(e, 2), 0.0_wp) + fall(e))
            bend(e) = -(2.0_wp*g(e, 2) + bend(e))
            group%is_plain(e) = min(min(-finish(e), g(e, 0)), min(other, max(fall(e), bend(e))))
            turn = sqrt(max(g(e, 1)**2 - 4.0_wp*g(e, 2)*g(e, 0), 0.0_wp)) - g(e, 1)
            turn = 2.0_wp*g(e, 0)/merge(turn, 1.0_wp, turn > 0.0_wp)
            t(e) = min(max(turn, 0.0_wp), 1.0_wp)
         end do
         do halley = 1, 2
            value = g(:, degree)
            slope = 0.0_wp
            curve = 0.0_wp
            do k = degree - 1, 0, -1
               !$omp simd
               do e = 1, group_size
                  curve(e) = curve(e)*t(e) + slope(e)   ! half the second derivative
                  slope(e) = slope(e)*t(e) + value(e)
                  value(e) = value(e)*t(e) + g(e, k)
               end do
            end do
            !$omp simd
            do e = 1, group_size
               turn = slope(e)**2 - value(e)*curve(e)
               step(e) = value(e)*slope(e)/merge(turn, 1.0_wp, abs(turn) > tiny(1.0_wp))
               step(e) = min(max(step(e), -1.0_wp), 1.0_wp)
               t(e) = t(e) - step(e)
            end do
         end do
         !$omp simd
         do e = 1, group_size
            group%is_plain(e) = min(min(group%is_plain(e), last_step - abs(step(e))), &
                                    min(t(e), 1.0_wp - t(e)))
            group%time(e) = merge(t(e), 0.5_wp, group%is_plain(e) > 0.0_wp)
         end do
      end associate
   end subroutine find_zero

   !> Expands a path about the transition; at rest where it sticks.
   pure subroutine shift_path(degree, span, group)
      integer, value :: degree
      real(wp), intent(in) :: span(group_size)   !! [parts]
      type(transition_group), intent(inout) :: group
      integer :: e, k, m

      do m = 0, degree - 1
         do k = degree - 1, m, -1
            !$omp simd
            do e = 1, group_size
               group%path(e, k) = group%path(e, k) + span(e)*group%path(e, k + 1)
            end do
         end do
      end do
      !$omp simd
      do e = 1, group_size
         associate (moving => abs(group%side(e)))
            group%way(e) = merge(1.0_wp, -1.0_wp, group%path(e, 1) >= 0.0_wp)
            group%way(e) = merge(group%side(e), group%way(e), moving > 0.0_wp)
            group%path(e, 1) = merge(0.0_wp, group%path(e, 1), moving > 0.0_wp)
            group%place(e) = group%path(e, 0)
         end associate
      end do
   end subroutine shift_path

   !> Finds the answer of the joint (6), and what it adds to the ends of all (7).
   pure subroutine respond(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), dimension(group_size) :: first, jump, power, r
      integer :: e, k, s

      associate (c => group%path, d => group%answer)
         !$omp simd
         do e = 1, group_size
            r(e) = 1.0_wp - group%time(e)
            power(e) = r(e)**2
            jump(e) = merge(-group%spring(e), group%spring(e), abs(group%side(e)) > 0.0_wp)
            group%own(e, 2) = group%own(e, 2) - (group%stiffness(e) - jump(e))
            d(e, 3) = jump(e)*c(e, 1)*(1.0_wp/6.0_wp)
            group%ends(e, 1) = 0.0_wp
            group%ends(e, 2) = 0.0_wp
         end do
         do k = 4, degree
            !$omp simd
            do e = 1, group_size
               d(e, k) = jump(e)*c(e, k - 2)*(1.0_wp/(k*(k - 1)))
            end do
            do s = 1, min(n_near, degree - 4, k - 3)   ! the rest is below the error of the degree
               !$omp simd
               do e = 1, group_size
                  d(e, k) = d(e, k) + group%own(e, s)*d(e, k - s)*fall(k - s, s)
               end do
            end do
         end do
         do k = 3, degree
            !$omp simd
            do e = 1, group_size
               group%ends(e, 2) = group%ends(e, 2) + k*(d(e, k)*power(e))
               power(e) = power(e)*r(e)
               group%ends(e, 1) = group%ends(e, 1) + d(e, k)*power(e)
            end do
         end do
         group%ends(:, 3:) = 0.0_wp
         first = r**2
         do s = 1, min(n_near, degree - 4)
            !$omp simd
            do e = 1, group_size
               first(e) = first(e)*r(e)
               power(e) = first(e)
            end do
            do k = 3, degree - s
               !$omp simd
               do e = 1, group_size
                  group%ends(e, 2*s + 2) = group%ends(e, 2*s + 2) &
                                           + d(e, k)*power(e)*fall(k, s - 1)
                  power(e) = power(e)*r(e)
                  group%ends(e, 2*s + 1) = group%ends(e, 2*s + 1) + d(e, k)*power(e)*fall(k, s)
               end do
            end do
         end do
      end associate
   end subroutine respond

   !> Finds the verdicts: the new guard must keep clear of zero to the end. A slip goes on; a joint
   !> that has stuck goes inwards, and not as far as its other limit.
   pure subroutine judge(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), dimension(group_size) :: power, r, tail, turn, verdict
      real(wp) :: inwards, onwards
      integer :: e, k

      associate (c => group%path)
         r = 1.0_wp - group%time
         power = r
         tail = 0.0_wp
         turn = 0.0_wp
         do k = 3, degree
            !$omp simd
            do e = 1, group_size
               tail(e) = tail(e) + power(e)*abs(c(e, k) + group%answer(e, k))
               power(e) = power(e)*r(e)
               turn(e) = turn(e) + k*power(e)*abs(c(e, k) + group%answer(e, k))
            end do
         end do
         !$omp simd
         do e = 1, group_size
            inwards = min(-group%way(e)*c(e, 2), 2.0_wp*group%reach(e) - abs(c(e, 2))) - tail(e)
            onwards = group%way(e)*c(e, 1) - turn(e) &
                      + min(0.0_wp, 2.0_wp*group%way(e)*c(e, 2)*r(e))
            inwards = min(group%is_plain(e), merge(inwards, onwards, abs(group%side(e)) > 0.0_wp))
            verdict(e) = merge(real(plain, wp), real(involved, wp), inwards > 0.0_wp)
            verdict(e) = merge(real(clear, wp), verdict(e), group%is_clear(e) > 0.0_wp)
         end do
      end associate
      group%verdict = nint(verdict)
   end subroutine judge

end module dynamics_exact_transitions
