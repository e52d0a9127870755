!> First zero of a guard on a power series, for one joint.
!>
!> A stuck joint watches its distance to both limits, a slipping one its velocity (dynamics_joint).
!> Either guard is a polynomial c(0) + c(1) t + ... that is not negative until the transition.
module dynamics_exact_guard_zeros
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: first_crossing, first_transition, no_crossing

   real(wp), parameter :: no_crossing = huge(1.0_wp)   !! "later than any time"

contains

   !> The first time in [0, last] at which one mass must change its regime, or no_crossing.
   pure function first_transition(path, direction, slider, reach, last) result(time)
      real(wp), intent(in) :: path(0:)    !! Taylor coefficients of its displacement
      real(wp), intent(in) :: direction   !! 0: stuck, +1 or -1: slipping that way
      real(wp), intent(in) :: slider
      real(wp), intent(in) :: reach       !! mu N/k: extension at which the contact slips
      real(wp), intent(in) :: last
      real(wp) :: time
      real(wp) :: guard(0:size(path) - 1)
      integer :: k

      if (abs(direction) > 0.0_wp) then
         do k = 1, size(path) - 1
            guard(k - 1) = direction*k*path(k)
         end do
         time = first_crossing(guard(:size(path) - 2), last)
      else
         guard = -path
         guard(0) = reach - (path(0) - slider)
         time = first_crossing(guard, last)
         guard = path
         guard(0) = reach + (path(0) - slider)
         time = min(time, first_crossing(guard, last))
      end if
   end function first_transition

   !> The first time in [0, last] after which the polynomial is negative, or no_crossing.
   !>
   !> A value c(0) <= 0 belongs to the transition just handled (rounding, or an exact zero after a
   !> mass has stuck): the first derivative that is not zero says where the guard goes, and that
   !> zero at the start is divided out, so it is not found again.
   pure function first_crossing(c, last) result(time)
      real(wp), intent(in) :: c(0:)
      real(wp), intent(in) :: last
      real(wp) :: time
      real(wp) :: bend
      integer :: first, k

      time = no_crossing
      first = 0
      if (.not. c(0) > 0.0_wp) then
         do first = 1, ubound(c, 1)
            if (abs(c(first)) > 0.0_wp) exit
         end do
         if (first > ubound(c, 1)) return
         if (c(first) < 0.0_wp) time = 0.0_wp
         if (c(first) < 0.0_wp) return
      end if

      bend = 0.0_wp
      do k = ubound(c, 1), first + 2, -1
         bend = (bend + (k - first)*(k - first - 1)*abs(c(k)))*merge(last, 1.0_wp, k > first + 2)
      end do
      time = creep(c(first:), bend, last)
   end function first_crossing

   !> The first zero by steps that cannot pass one.
   !>
   !> Over [t, last] the polynomial lies above the parabola through its value and slope at t whose
   !> second derivative is the bound `bend`; the zero of that parabola is the next t. The iterates
   !> close in on a simple zero quadratically and always from the same side, step over a minimum
   !> that stays positive, and skip neither a graze nor a pair of crossings.
   pure function creep(c, bend, last) result(time)
      real(wp), intent(in) :: c(0:)
      real(wp), intent(in) :: bend   !! bound of |second derivative| over [0, last]
      real(wp), intent(in) :: last
      real(wp) :: time
      integer, parameter :: max_steps = 10000   ! some 6 for a crossing, 100 for the nearest graze
      real(wp), parameter :: least_step = epsilon(1.0_wp)
      real(wp) :: value, slope, root, above, below, step
      integer :: k, iteration

      time = 0.0_wp
      do iteration = 1, max_steps
         value = 0.0_wp
         slope = 0.0_wp
         do k = ubound(c, 1), 0, -1
            slope = slope*time + value
            value = value*time + c(k)
         end do
         if (.not. value > 0.0_wp) return
         root = sqrt(slope**2 + 2.0_wp*bend*value)
         if (slope > 0.0_wp) then   ! two forms of one zero, each without cancellation
            above = slope + root
            below = bend
         else
            above = 2.0_wp*value
            below = root - slope
         end if
         if (above >= below*(last - time)) then
            time = no_crossing
            return
         end if
         step = above/below
         time = time + step
         if (step < least_step) return
      end do
   end function creep

end module dynamics_exact_guard_zeros
