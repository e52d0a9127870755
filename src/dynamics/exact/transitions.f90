!> Transitions of eight suspects at a time: which of them have one, when, and whether it is plain.
!>
!> A suspect is clear if its guard has no zero in the part. It has one plain transition if its guard
!> falls or is concave all the way and is negative at the end, and the new guard keeps clear of
!> zero. Everything else is involved: that sample is marched again one transition after another.
!> Conditions are numbers, positive where they hold, so that loops over the group are vector
!> operations.
module dynamics_exact_transitions
   use core_kinds, only: wp
   use dynamics_exact_joint_paths, only: joint_paths, layer_reach, layer_side, layer_slider, &
                                         layer_spring, width
   use dynamics_exact_series, only: most_degree
   implicit none(type, external)
   private
   public :: transition_group, locate, judge, group_size, plain, involved

   integer, parameter :: group_size = 8
   integer, parameter :: clear = 0, plain = 1, involved = 2   !! verdicts

   !> Suspects 1 .. n of a group; the other entries repeat the last one.
   type :: transition_group
      integer :: n = 0
      integer :: lane(group_size), joint(group_size), verdict(group_size)
      logical :: has_response(group_size)   !! False: the base system can only `redo` that joint
      real(wp), dimension(group_size) :: time       !! tau, from the start of the part [parts]
      real(wp), dimension(group_size) :: side       !! direction of the slip that ends; 0: it starts
      real(wp), dimension(group_size) :: way        !! direction of the slip that starts or ends
      real(wp), dimension(group_size) :: reach      !! mu N/k [m]
      !> weight of the spring in its row's equation that the new regime adds to the right-hand side
      real(wp), dimension(group_size) :: jump
      !> path before the transition in powers of t - tau; velocity 0 where it sticks
      real(wp) :: path(group_size, 0:most_degree)
      !> what the new regime adds to it, powers 3 .. P (6): the base system fills it
      real(wp) :: response(group_size, 3:most_degree)
      real(wp) :: ends(group_size, 6)   !! of the response, for the base system
      real(wp), dimension(group_size), private :: is_plain, is_clear   !! where positive
   end type transition_group

contains

   !> Looks for the zero of the guard of each suspect of the list.
   pure subroutine locate(paths, list, group)
      type(joint_paths), intent(in) :: paths
      integer, intent(in) :: list(:)   !! at most eight; see finish_part
      type(transition_group), intent(inout) :: group
      real(wp) :: c(group_size, 0:most_degree), slider(group_size), spring(group_size)
      integer :: e, k, row

      group%n = size(list)
      do e = 1, group_size
         associate (entry => list(min(e, size(list))) - 1)
            group%lane(e) = 1 + iand(entry, width - 1)
            group%joint(e) = 1 + entry/width
         end associate
         associate (l => group%lane(e), j => group%joint(e))
            row = paths%row(j)
            do k = 0, paths%degree
               c(e, k) = paths%x(l, row, paths%layer(k))
            end do
            slider(e) = paths%regime(l, j, layer_slider)
            group%reach(e) = paths%regime(l, j, layer_reach)
            group%side(e) = paths%regime(l, j, layer_side)
            spring(e) = paths%regime(l, j, layer_spring)
         end associate
      end do
      call find_zero(paths%degree, c, slider, group)
      do e = 1, group_size
         group%jump(e) = merge(-spring(e), spring(e), abs(group%side(e)) > 0.0_wp)
      end do
      call shift(paths%degree, c, group)
   end subroutine locate

   !> Zero of the guard: that of its parabola, then three steps of Newton.
   pure subroutine find_zero(degree, c, slider, group)
      integer, intent(in) :: degree
      real(wp), intent(in) :: c(group_size, 0:most_degree), slider(group_size)
      type(transition_group), intent(inout) :: group
      real(wp), parameter :: last_step = 1.0e-7_wp   ! its square is below rounding
      real(wp) :: g(group_size, 0:most_degree)
      real(wp), dimension(group_size) :: bend, fall, finish, rest, sense, slope, step, t, value
      real(wp) :: least, other, moving, turn
      integer :: e, k, newton

      ! the guard: velocity along the slip, or distance to the limit that is nearer at the end
      value = c(:, degree)
      slope = degree*c(:, degree)
      do k = degree - 1, 1, -1
         do e = 1, group_size
            value(e) = value(e) + c(e, k)
            slope(e) = slope(e) + k*c(e, k)
         end do
      end do
      do e = 1, group_size
         moving = abs(group%side(e))
         value(e) = value(e) + (c(e, 0) - slider(e))
         sense(e) = merge(group%side(e), sign(1.0_wp, value(e)), moving > 0.0_wp)
         finish(e) = merge(sense(e)*slope(e), group%reach(e) - sense(e)*value(e), moving > 0.0_wp)
         g(e, 0) = merge(sense(e)*c(e, 1), group%reach(e) - sense(e)*(c(e, 0) - slider(e)), &
                         moving > 0.0_wp)
         g(e, degree) = merge(0.0_wp, -sense(e)*c(e, degree), moving > 0.0_wp)
      end do
      do k = 1, degree - 1
         do e = 1, group_size
            g(e, k) = sense(e)*merge((k + 1)*c(e, k + 1), -c(e, k), abs(group%side(e)) > 0.0_wp)
         end do
      end do
      rest = 0.0_wp
      fall = 0.0_wp
      bend = 0.0_wp
      do k = 3, degree
         do e = 1, group_size
            rest(e) = rest(e) + abs(g(e, k))
            fall(e) = fall(e) + k*abs(g(e, k))
            bend(e) = bend(e) + k*(k - 1)*abs(g(e, k))
         end do
      end do
      do e = 1, group_size
         moving = abs(group%side(e))
         ! least values over the part: the parabola's, less the absolute values of the higher powers
         turn = min(max(-g(e, 1)/merge(2.0_wp*g(e, 2), 1.0_wp, g(e, 2) > 1.0e-100_wp), 0.0_wp), &
                    1.0_wp)
         least = min(g(e, 0), g(e, 0) + turn*(g(e, 1) + turn*g(e, 2))) - rest(e)
         least = min(least, g(e, 0) + g(e, 1) + g(e, 2) - rest(e))
         turn = min(max(-g(e, 1)/merge(2.0_wp*g(e, 2), -1.0_wp, g(e, 2) < -1.0e-100_wp), 0.0_wp), &
                    1.0_wp)
         other = max(g(e, 0), g(e, 0) + g(e, 1) + g(e, 2), &
                     g(e, 0) + turn*(g(e, 1) + turn*g(e, 2)))
         other = merge(1.0_wp, 2.0_wp*group%reach(e) - other - rest(e), moving > 0.0_wp)
         group%is_clear(e) = min(least, other)
         group%is_plain(e) = min(-finish(e), g(e, 0), other, &
                                 max(-(g(e, 1) + max(2.0_wp*g(e, 2), 0.0_wp) + fall(e)), &
                                     -(2.0_wp*g(e, 2) + bend(e))))
         step(e) = sqrt(max(g(e, 1)**2 - 4.0_wp*g(e, 2)*g(e, 0), 0.0_wp)) - g(e, 1)
         t(e) = 2.0_wp*g(e, 0)/merge(step(e), 1.0_wp, step(e) > 0.0_wp)
         t(e) = min(max(t(e), 0.0_wp), 1.0_wp)
      end do
      do newton = 1, 3
         value = g(:, degree)
         slope = 0.0_wp
         do k = degree - 1, 0, -1
            do e = 1, group_size
               slope(e) = slope(e)*t(e) + value(e)
               value(e) = value(e)*t(e) + g(e, k)
            end do
         end do
         do e = 1, group_size
            step(e) = value(e)/merge(slope(e), -1.0_wp, abs(slope(e)) > tiny(1.0_wp))
            step(e) = min(max(step(e), -1.0_wp), 1.0_wp)
            t(e) = t(e) - step(e)
         end do
      end do
      do e = 1, group_size
         group%is_plain(e) = min(group%is_plain(e), last_step - abs(step(e)), t(e), 1.0_wp - t(e))
         group%time(e) = merge(t(e), 0.5_wp, group%is_plain(e) > 0.0_wp)
      end do
   end subroutine find_zero

   !> Path about the transition.
   pure subroutine shift(degree, c, group)
      integer, intent(in) :: degree
      real(wp), intent(in) :: c(group_size, 0:most_degree)
      type(transition_group), intent(inout) :: group
      integer :: e, k, m

      group%path(:, 0:degree) = c(:, 0:degree)
      do m = 0, degree - 1
         do k = degree - 1, m, -1
            do e = 1, group_size
               group%path(e, k) = group%path(e, k) + group%time(e)*group%path(e, k + 1)
            end do
         end do
      end do
      do e = 1, group_size
         group%way(e) = merge(group%side(e), merge(1.0_wp, -1.0_wp, group%path(e, 1) >= 0.0_wp), &
                              abs(group%side(e)) > 0.0_wp)
         group%path(e, 1) = merge(0.0_wp, group%path(e, 1), abs(group%side(e)) > 0.0_wp)
      end do
   end subroutine shift

   !> Verdicts, once the response is known: the new guard must keep clear of zero to the end. A slip
   !> goes on; a joint that has stuck goes inwards, and not as far as its other limit.
   pure subroutine judge(degree, group)
      integer, intent(in) :: degree
      type(transition_group), intent(inout) :: group
      real(wp), dimension(group_size) :: power, tail, turn
      real(wp) :: inwards, onwards
      integer :: e, k

      power = 1.0_wp - group%time
      tail = 0.0_wp
      turn = 0.0_wp
      do k = 3, degree
         do e = 1, group_size
            tail(e) = tail(e) + power(e)*abs(group%path(e, k) + group%response(e, k))
            turn(e) = turn(e) + power(e)*(1.0_wp - group%time(e))*k &
                      *abs(group%path(e, k) + group%response(e, k))
            power(e) = power(e)*(1.0_wp - group%time(e))
         end do
      end do
      do e = 1, group_size
         inwards = min(-group%way(e)*group%path(e, 2), &
                       2.0_wp*group%reach(e) - abs(group%path(e, 2))) - tail(e)
         onwards = group%way(e)*group%path(e, 1) - turn(e) &
                   + min(0.0_wp, 2.0_wp*group%way(e)*group%path(e, 2)*(1.0_wp - group%time(e)))
         group%is_plain(e) = min(group%is_plain(e), merge(inwards, onwards, &
                                                          abs(group%side(e)) > 0.0_wp))
         group%verdict(e) = merge(clear, merge(plain, involved, group%is_plain(e) > 0.0_wp), &
                                  group%is_clear(e) > 0.0_wp)
      end do
      where (group%verdict == plain .and. .not. group%has_response) group%verdict = involved
   end subroutine judge

end module dynamics_exact_transitions
