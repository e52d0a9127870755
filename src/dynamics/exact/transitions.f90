!> Transitions of eight candidates at a time: which of them have one, when, and what it adds to the
!> values at the end of the part.
!>
!> A candidate is clear if its guard has no zero in the part. Its transition is plain if the guard
!> falls or is concave over the whole part and is negative at the end, and if the new guard has no
!> zero in the rest of the part. All others are irregular: their transitions are found one after
!> another. Conditions are real numbers, positive if they hold, so that loops over a group are
!> vector operations. Numbers in brackets are the formulas of docs/exact_march.md, with M of
!> docs/modal_march.md.
module dynamics_exact_transitions
   use core_kinds, only: wp
   use dynamics_exact_guard_zeros, only: first_transition, no_zero
   use dynamics_exact_joint_paths, only: joint_paths, regime_reach, regime_side, regime_slider, &
                                         regime_spring, width
   use dynamics_exact_series, only: most_degree
   implicit none(type, external)
   private
   public :: transition_group, examine, find_next, apply_response, load_candidates
   public :: group_size, n_response_sums, clear, plain, irregular, integral, last_integral

   integer, parameter :: group_size = 8
   integer, parameter :: n_response_sums = 4   !! sums A_1 .. A_4 by which other dofs respond (7)
   integer, parameter :: last_integral = 7   !! s of the last I_s (M10): eight fill a register
   integer, private :: k_, s_   ! indices of the constructor
   !> k!/(k + s)!: the s-fold integral of t^k is k!/(k + s)! t^(k + s)
   real(wp), parameter :: integral(most_degree, 0:last_integral) = reshape( &
                          [((gamma(k_ + 1.0_wp)/gamma(k_ + s_ + 1.0_wp), k_=1, most_degree), &
                            s_=0, last_integral)], [most_degree, last_integral + 1])
   integer, parameter :: clear = 0, plain = 1, irregular = 2   !! outcomes

   !> Candidates 1 .. n of a group; entries beyond n have no meaning.
   type :: transition_group
      integer :: n = 0
      integer, dimension(group_size) :: candidate   !! see joint_paths
      integer, dimension(group_size) :: lane, joint, row, outcome
      real(wp), dimension(group_size) :: time       !! tau, from the start of the part [parts]
      real(wp), dimension(group_size) :: side = 0.0_wp   !! direction of slip before; 0: stuck
      real(wp), dimension(group_size) :: direction  !! direction of the slip that starts or ends
      real(wp), dimension(group_size) :: place      !! w.x at the transition [m]
      !> Changes of the joint's path and velocity at the end (6), then A_1 and its rate, .., A_4
      !> and its rate (7)
      real(wp) :: ends(group_size, 2 + 2*n_response_sums)
      ! regime of the joint, stiffness and N_1 .. N_4 of its row, before the transition
      real(wp), dimension(group_size), private :: slider = 0.0_wp, reach = 0.0_wp
      real(wp), dimension(group_size), private :: spring = 0.0_wp, stiffness = 0.0_wp
      real(wp), private :: own(group_size, n_response_sums) = 0.0_wp
      real(wp), dimension(group_size) :: clear_margin   !! positive: lower bound of the guard
      real(wp), dimension(group_size) :: plain_margin   !! positive: the guard has one plain zero
      !> Powers of the path, in time from tau on after shift_path
      real(wp) :: path(group_size, 0:most_degree) = 0.0_wp
      real(wp) :: response(group_size, 3:most_degree)   !! powers d_3 .. of (6)
   end type transition_group

contains

   !> Finds transitions and outcomes of the candidates first .. last of a part, at most eight.
   pure subroutine examine(paths, first, last, group)
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: first, last
      type(transition_group), intent(inout) :: group

      associate (list => paths%candidate(first:last))
         select case (paths%degree)   ! a constant degree unrolls the loops over powers
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

   !> See examine.
   pure subroutine solve(degree, paths, list, group)
      integer, value :: degree
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: list(:)
      type(transition_group), intent(inout) :: group

      call load_candidates(degree, paths, list, group)
      call find_zero(degree, group)
      call shift_path(degree, group%time, group)
      call respond(degree, group)
      call judge(degree, group)
   end subroutine solve

   !> Finds the first candidate's next transition after the time of the group, and the response.
   pure subroutine find_next(degree, group, is_found)
      integer, intent(in) :: degree
      type(transition_group), intent(inout) :: group
      logical, intent(out) :: is_found
      real(wp) :: span

      span = first_transition(group%path(1, :degree), group%side(1), group%slider(1), &
                              group%reach(1), 1.0_wp - group%time(1))
      is_found = span < no_zero
      if (.not. is_found) return
      group%time = group%time(1) + span
      call shift_path(degree, spread(span, 1, group_size), group)
      call respond(degree, group)
   end subroutine find_next

   !> Adds the response to the path of the first candidate, whose joint has switched. If it has
   !> stuck, its extension is exactly the reach.
   pure subroutine apply_response(paths, group)
      type(joint_paths), intent(in) :: paths
      type(transition_group), intent(inout) :: group

      call load_regime(paths, 1, group)
      group%path(:, 3:paths%degree) = group%path(:, 3:paths%degree) &
                                      + group%response(:, 3:paths%degree)
      if (abs(group%side(1)) > 0.0_wp) return
      group%path(:, 0) = group%slider + group%direction*group%reach
   end subroutine apply_response

   !> Copies lanes, joints, paths and regimes of the candidates, one candidate after another: in
   !> vector operations, the addresses would take longer than the copies.
   pure subroutine load_candidates(degree, paths, list, group)
      integer, value :: degree
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: list(:)   !! section of paths%candidate
      type(transition_group), intent(inout) :: group
      integer :: e, k

      group%n = size(list)
      !GCC$ novector
      do e = 1, group%n
         group%candidate(e) = list(e)
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
         call load_regime(paths, e, group)
      end do
      group%time = 0.0_wp
   end subroutine load_candidates

   !> Copies the regime of a candidate's joint, and stiffness and N_1 .. N_4 of its row.
   pure subroutine load_regime(paths, e, group)
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: e
      type(transition_group), intent(inout) :: group

      associate (l => group%lane(e), j => group%joint(e), row => group%row(e))
         group%slider(e) = paths%regime(l, j, regime_slider)
         group%reach(e) = paths%regime(l, j, regime_reach)
         group%side(e) = paths%regime(l, j, regime_side)
         group%spring(e) = paths%regime(l, j, regime_spring)
         group%own(e, :) = paths%responses%own(:, row)
         group%stiffness(e) = paths%stiffness(l, row)
      end associate
   end subroutine load_regime

   !> Finds the zero of the guard, by two steps of Halley's method from the zero of its parabola.
   pure subroutine find_zero(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), parameter :: last_step = 1.0e-5_wp   ! at most: its cube is below rounding
      real(wp) :: g(group_size, 0:most_degree)
      real(wp), dimension(group_size) :: concave, curve, falling, finish, least, moving, other, &
                                         rest, sense, slope, step, t, turn, value
      integer :: halley, k

      associate (c => group%path, side => group%side, reach => group%reach)
         ! the guard: velocity along the slip, or distance to the limit that is nearer at the end
         value = c(:, degree)
         slope = degree*c(:, degree)
         !GCC$ unroll 8
         do k = degree - 1, 1, -1
            value = value + c(:, k)
            slope = slope + k*c(:, k)
         end do
         moving = abs(side)
         value = value + (c(:, 0) - group%slider)
         sense = merge(side, sign(1.0_wp, value), moving > 0.0_wp)
         finish = merge(sense*slope, reach - sense*value, moving > 0.0_wp)
         g(:, 0) = merge(sense*c(:, 1), reach - sense*(c(:, 0) - group%slider), moving > 0.0_wp)
         g(:, degree) = merge(0.0_wp, -sense*c(:, degree), moving > 0.0_wp)
         rest = 0.0_wp
         falling = 0.0_wp
         concave = 0.0_wp
         !GCC$ unroll 8
         do k = 1, degree - 1
            g(:, k) = sense*merge((k + 1)*c(:, k + 1), -c(:, k), moving > 0.0_wp)
         end do
         !GCC$ unroll 8
         do k = 3, degree
            rest = rest + abs(g(:, k))
            falling = falling + k*abs(g(:, k))
            concave = concave + (k*(k - 1))*abs(g(:, k))
         end do

         ! least values over the part: the parabola's, less the absolute values of the higher powers
         turn = -g(:, 1)/merge(2.0_wp*g(:, 2), 1.0_wp, abs(g(:, 2)) > 1.0e-100_wp)
         turn = min(max(turn, 0.0_wp), 1.0_wp)
         turn = g(:, 0) + turn*(g(:, 1) + turn*g(:, 2))
         other = g(:, 0) + (g(:, 1) + g(:, 2))
         least = min(min(g(:, 0), turn), other) - rest
         other = max(max(g(:, 0), turn), other) + rest
         other = merge(1.0_wp, 2.0_wp*reach - other, moving > 0.0_wp)
         group%clear_margin = min(least, other)
         falling = -(g(:, 1) + max(2.0_wp*g(:, 2), 0.0_wp) + falling)
         concave = -(2.0_wp*g(:, 2) + concave)
         group%plain_margin = min(min(-finish, g(:, 0)), min(other, max(falling, concave)))
         turn = sqrt(max(g(:, 1)**2 - 4.0_wp*g(:, 2)*g(:, 0), 0.0_wp)) - g(:, 1)
         turn = 2.0_wp*g(:, 0)/merge(turn, 1.0_wp, turn > 0.0_wp)
         t = min(max(turn, 0.0_wp), 1.0_wp)
         do halley = 1, 2
            value = g(:, degree)
            slope = 0.0_wp
            curve = 0.0_wp
            !GCC$ unroll 8
            do k = degree - 1, 0, -1
               curve = curve*t + slope   ! half the second derivative
               slope = slope*t + value
               value = value*t + g(:, k)
            end do
            turn = slope**2 - value*curve
            step = value*slope/merge(turn, 1.0_wp, abs(turn) > tiny(1.0_wp))
            step = min(max(step, -1.0_wp), 1.0_wp)
            t = t - step
         end do
         group%plain_margin = min(min(group%plain_margin, last_step - abs(step)), &
                                  min(t, 1.0_wp - t))
         group%time = merge(t, 0.5_wp, group%plain_margin > 0.0_wp)
      end associate
   end subroutine find_zero

   !> Expands the paths about their transitions. A joint that sticks has no velocity from then on.
   pure subroutine shift_path(degree, span, group)
      integer, value :: degree
      real(wp), intent(in) :: span(group_size)   !! [parts]
      type(transition_group), intent(inout) :: group
      integer :: k, m

      !GCC$ unroll 8
      do m = 0, degree - 1
         !GCC$ unroll 8
         do k = degree - 1, m, -1
            group%path(:, k) = group%path(:, k) + span*group%path(:, k + 1)
         end do
      end do
      associate (moving => abs(group%side))
         group%direction = merge(1.0_wp, -1.0_wp, group%path(:, 1) >= 0.0_wp)
         group%direction = merge(group%side, group%direction, moving > 0.0_wp)
         group%path(:, 1) = merge(0.0_wp, group%path(:, 1), moving > 0.0_wp)
         group%place = group%path(:, 0)
      end associate
   end subroutine shift_path

   !> Finds the responses of the joints' own rows (6), and what they add to values at the end (7).
   pure subroutine respond(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), dimension(group_size) :: first, jump, place, power, r, velocity
      integer :: k, s

      associate (c => group%path, d => group%response)
         r = 1.0_wp - group%time
         first = r**2
         jump = merge(-group%spring, group%spring, abs(group%side) > 0.0_wp)
         group%own(:, 2) = group%own(:, 2) - (group%stiffness - jump)
         d(:, 3) = jump*c(:, 1)*(1.0_wp/6.0_wp)
         !GCC$ unroll 8
         do k = 4, degree
            d(:, k) = jump*c(:, k - 2)*(1.0_wp/(k*(k - 1)))
            do s = 1, min(n_response_sums, degree - 4, k - 3)   ! others are below its error
               d(:, k) = d(:, k) + group%own(:, s)*d(:, k - s)*integral(k - s, s)
            end do
         end do
         power = first
         place = 0.0_wp
         velocity = 0.0_wp
         !GCC$ unroll 8
         do k = 3, degree
            velocity = velocity + k*(d(:, k)*power)
            power = power*r
            place = place + d(:, k)*power
         end do
         group%ends(:, 1) = place
         group%ends(:, 2) = velocity
         !GCC$ unroll 4
         do s = 1, n_response_sums
            first = first*r
            power = first
            place = 0.0_wp
            velocity = 0.0_wp
            !GCC$ unroll 8
            do k = 3, merge(degree - s, 0, s <= degree - 4)
               velocity = velocity + d(:, k)*power*integral(k, s - 1)
               power = power*r
               place = place + d(:, k)*power*integral(k, s)
            end do
            group%ends(:, 2*s + 1) = place
            group%ends(:, 2*s + 2) = velocity
         end do
      end associate
   end subroutine respond

   !> Finds the outcomes. A transition is plain only if the new guard has no zero to the end: a slip
   !> keeps its direction; a joint that has stuck moves back, by less than 2 mu N/k.
   pure subroutine judge(degree, group)
      integer, value :: degree
      type(transition_group), intent(inout) :: group
      real(wp), dimension(group_size) :: inwards, onwards, outcome, power, r, tail, turn
      integer :: k

      associate (c => group%path)
         r = 1.0_wp - group%time
         power = r
         tail = 0.0_wp
         turn = 0.0_wp
         !GCC$ unroll 8
         do k = 3, degree
            tail = tail + power*abs(c(:, k) + group%response(:, k))
            power = power*r
            turn = turn + k*power*abs(c(:, k) + group%response(:, k))
         end do
         inwards = min(-group%direction*c(:, 2), 2.0_wp*group%reach - abs(c(:, 2))) - tail
         onwards = group%direction*c(:, 1) - turn &
                   + min(0.0_wp, 2.0_wp*group%direction*c(:, 2)*r)
         inwards = min(group%plain_margin, merge(inwards, onwards, abs(group%side) > 0.0_wp))
         outcome = merge(real(plain, wp), real(irregular, wp), inwards > 0.0_wp)
         outcome = merge(real(clear, wp), outcome, group%clear_margin > 0.0_wp)
      end associate
      group%outcome = nint(outcome)
   end subroutine judge

end module dynamics_exact_transitions
