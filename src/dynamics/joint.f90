!> The law of a Jenkins joint, and the count of its slip, for both marchers.
!>
!> A stuck joint is a spring, r = k (w.x - z), with its slider at z. It slips when its guard
!> mu N/k - |w.x - z| becomes negative, and then carries r = d mu N, d the sign of w.v. It sticks
!> when its guard d w.v becomes negative, with its slider where r = d mu N exactly, so that the
!> force does not drift. The marchers evaluate these guards for many samples at a time.
module dynamics_joint
   use core_kinds, only: wp
   use dynamics_response, only: block_state, slip_account
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: add_frictionless_slip, count_open_slips, enter_transition, slider_at, slip_direction

contains

   !> Direction of a slip that starts, +1 or -1: that of the velocity, whose sign is right even if
   !> rounding has carried |w.x - z| past the reach.
   elemental function slip_direction(velocity) result(direction)
      real(wp), intent(in) :: velocity   !! w.v [m/s]
      integer :: direction

      direction = merge(1, -1, velocity >= 0.0_wp)
   end function slip_direction

   !> Slider of a joint that slips, or has just stuck: z = w.x - d mu N/k [m].
   elemental function slider_at(place, direction, reach) result(slider)
      real(wp), intent(in) :: place       !! w.x [m]
      integer, intent(in) :: direction    !! d, +1 or -1
      real(wp), intent(in) :: reach       !! mu N/k [m]
      real(wp) :: slider

      slider = place - direction*reach
   end function slider_at

   !> Enters a transition into the state of a sample: a slip starts in a direction, or ends
   !> (direction 0). Without branches, as both are equally likely.
   pure subroutine enter_transition(state, joint, sample, time, place, direction)
      type(block_state), intent(inout) :: state
      integer, intent(in) :: joint, sample
      real(wp), intent(in) :: time        !! [s]
      real(wp), intent(in) :: place       !! w.x [m]
      integer, intent(in) :: direction    !! +1 or -1; 0: it sticks
      integer :: starts

      starts = abs(direction)
      associate (account => state%account(joint, sample))
         call count_slip(account, time, place, 1.0_wp - starts)
         account%direction = direction
         account%slip_starts = account%slip_starts + starts
         account%stick_starts = account%stick_starts + (1 - starts)
      end associate
      if (state%keeps_transitions) call state%transitions(sample)%append(time, joint, direction)
   end subroutine enter_transition

   !> Counts the present slips up to now, before slip times and distances are read.
   pure subroutine count_open_slips(structure, time, state)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: time   !! [s]
      type(block_state), intent(inout) :: state
      integer :: j, w

      do w = 1, state%n_samples
         do j = 1, state%n_joints
            if (state%account(j, w)%direction == 0) cycle
            call count_slip(state%account(j, w), time, dot_product(structure%direction(:, j), &
                                                                   state%displacement(:, w)), &
                            1.0_wp)
         end do
      end do
   end subroutine count_open_slips

   !> Adds the way of a joint without friction over a step: that of the cubic through w.x and w.v at
   !> both ends, which turns back at most twice.
   pure subroutine add_frictionless_slip(place, speed, account)
      real(wp), intent(in) :: place      !! w.x at the end of the step [m]
      real(wp), intent(in) :: speed(2)   !! w.v at its ends [m/step]
      type(slip_account), intent(inout) :: account
      real(wp) :: bend, curve, q, rise, turn(2)   ! w.v = speed(1) + 2 bend t + 3 curve t^2
      real(wp) :: t(2)   ! times of the turns; 0 or 1 without them

      rise = place - account%slip_from
      bend = 3.0_wp*rise - 2.0_wp*speed(1) - speed(2)
      curve = speed(1) + speed(2) - 2.0_wp*rise
      q = bend**2 - 3.0_wp*curve*speed(1)
      turn = rise
      if (q > 0.0_wp) then
         q = -bend - sign(sqrt(q), bend)   ! the zeros of w.v are speed(1)/q and q/(3 curve)
         t = 1.0_wp
         if (abs(speed(1)) < abs(q)) t(1) = max(0.0_wp, speed(1)/q)
         if (abs(q) < 3.0_wp*abs(curve)) t(2) = max(0.0_wp, q/(3.0_wp*curve))
         if (t(1) > t(2)) t = t([2, 1])
         turn = t*(speed(1) + t*(bend + t*curve))
      end if
      account%slip_distance = account%slip_distance &
                              + (abs(turn(1)) + abs(turn(2) - turn(1)) + abs(rise - turn(2)))
      account%slip_from = place
   end subroutine add_frictionless_slip

   !> Counts a slip from its start, or from when it was last counted, to now. A joint slips in one
   !> direction in between, so that |change of w.x| is the distance.
   pure subroutine count_slip(account, time, place, share)
      type(slip_account), intent(inout) :: account
      real(wp), intent(in) :: time    !! [s]
      real(wp), intent(in) :: place   !! w.x [m]
      real(wp), intent(in) :: share   !! 1; 0 if the joint has been stuck until now

      account%slip_time = account%slip_time + share*(time - account%slip_since)
      account%slip_distance = account%slip_distance + share*abs(place - account%slip_from)
      account%slip_since = time
      account%slip_from = place
   end subroutine count_slip

end module dynamics_joint
