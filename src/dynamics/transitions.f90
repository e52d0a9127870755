!> The transitions found in stretches side by side: which mass may be next, what has been found, and
!> whether it can be all.
module dynamics_transitions
   use core_kinds, only: wp
   use dynamics_course, only: course_type
   use dynamics_crossing, only: capacity, crossing_batch
   use dynamics_propagator, only: stride_of
   use dynamics_registers, only: whole_registers
   use dynamics_walker, only: walker_type
   implicit none(type, external)
   private
   public :: most_transitions, found_transitions, first_suspect, keep_transition, check_regimes

   integer, parameter :: most_transitions = 3   !! in a stretch
   integer, parameter :: most_found = capacity*most_transitions

   !> Those of one stretch in time order, those of others between them; arrays (transition).
   type :: found_transitions
      integer :: n = 0
      integer, dimension(most_found) :: stretch = 0, mass = 0
      real(wp), dimension(most_found) :: time = 0.0_wp       !! in its stretch [stretches]
      real(wp), dimension(most_found) :: x = 0.0_wp, u = 0.0_wp   !! there [m], [m/stretch]
      real(wp), dimension(most_found) :: sense = 1.0_wp      !! +1 or -1: way of the slip
      real(wp), dimension(most_found) :: is_stick = 0.0_wp   !! 1: the slip ends, 0: it starts
      ! at the end of the stretch
      real(wp), dimension(most_found), private :: end_x = 0.0_wp, end_u = 0.0_wp
      real(wp), dimension(most_found), private :: reach = 0.0_wp, bend = 0.0_wp
   end type found_transitions

contains

   !> Of the masses that may have a transition that which would be the first by a straight line
   !> from end to end.
   pure function first_suspect(walker) result(first)
      type(walker_type), intent(in) :: walker   !! with at least one
      integer :: first
      integer :: i, others
      real(wp) :: least, share

      first = 1 + trailz(walker%suspects)
      others = iand(walker%suspects, walker%suspects - 1)
      if (others == 0) return
      least = share_left(walker, first)
      do while (others /= 0)
         i = 1 + trailz(others)
         others = iand(others, others - 1)
         share = share_left(walker, i)
         first = merge(i, first, share < least)
         least = min(share, least)
      end do
   end function first_suspect

   !> Of half the change of a mass's guard what is left at the end: it grows with the time at which
   !> a straight line crosses zero.
   pure function share_left(walker, i) result(share)
      type(walker_type), intent(in) :: walker
      integer, intent(in) :: i
      real(wp) :: share
      real(wp) :: after, before

      associate (x => walker%x, u => walker%u, way => walker%direction(i), now => walker%place)
         before = merge(way*u(i, now), walker%reach(i) - abs(x(i, now) - walker%slider(i)), &
                        abs(way) > 0.5_wp)
         after = merge(way*u(i, 1 - now), walker%reach(i) - abs(x(i, 1 - now) - walker%slider(i)), &
                       abs(way) > 0.5_wp)
      end associate
      share = after/max(0.5_wp*abs(before) + 0.5_wp*abs(after), tiny(1.0_wp))
   end function share_left

   !> Notes the transition of mass i that a lane has found.
   pure subroutine keep_transition(batch, lane, stretch, i, found)
      type(crossing_batch), intent(in) :: batch
      integer, intent(in) :: lane, stretch, i
      type(found_transitions), intent(inout) :: found

      associate (n => found%n)
         n = n + 1
         found%stretch(n) = stretch
         found%mass(n) = i
         found%time(n) = batch%tau(lane)
         found%x(n) = batch%x(lane)
         found%u(n) = batch%u(lane)
         found%sense(n) = batch%sense(lane)
         found%is_stick(n) = batch%is_stick(lane)
      end associate
   end subroutine keep_transition

   !> Closes the stretches of which a mass does not keep its new regime to the end for certain: a
   !> slip whose velocity stays clear of zero, a stick that does not come as far as its other limit
   !> (it moves back all the way, as the velocity that fell through zero falls all the way).
   pure subroutine check_regimes(course, list, walker, found, is_open)
      type(course_type), intent(in) :: course
      integer, intent(in) :: list(capacity)      !! samples of the stretches
      type(walker_type), intent(in) :: walker(*)
      type(found_transitions), intent(inout) :: found
      logical, intent(inout) :: is_open(capacity)
      real(wp) :: clear(most_found)
      integer :: t

      do t = 1, found%n
         associate (i => found%mass(t), w => list(found%stretch(t)))
            found%end_x(t) = walker(w)%x(i, 1 - walker(w)%place)
            found%end_u(t) = stride_of(walker(w)%level)*walker(w)%u(i, 1 - walker(w)%place)
            found%reach(t) = walker(w)%reach(i)
            found%bend(t) = course%bend(walker(w)%position, walker(w)%level)
         end associate
      end do
      !$omp simd
      do t = 1, whole_registers(found%n)
         block
            real(wp) :: clear_of_limit, clear_of_zero, rest, run
            rest = 1.0_wp - found%time(t)
            run = found%end_x(t) - found%x(t)
            clear_of_zero = rest*min(found%sense(t)*found%u(t), found%sense(t)*found%end_u(t)) - &
                            0.125_wp*found%bend(t) - &
                            abs((found%u(t) + found%end_u(t))*rest - 2.0_wp*run)
            clear_of_limit = found%reach(t) - abs(run)
            clear(t) = merge(clear_of_limit, clear_of_zero, found%is_stick(t) > 0.5_wp)
         end block
      end do
      do t = 1, found%n
         if (.not. clear(t) > 0.0_wp) is_open(found%stretch(t)) = .false.
      end do
   end subroutine check_regimes

end module dynamics_transitions
