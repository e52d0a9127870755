!> First zero of the guard of one joint whose path is a power series.
!>
!> The guard of a stuck joint is its distance to either limit, that of a slipping one its velocity
!> (dynamics_joint). Both are polynomials c(0) + c(1) t + ... that are not negative until the
!> transition.
module dynamics_exact_guard_zeros
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: first_zero, first_transition, no_zero

   real(wp), parameter :: no_zero = huge(1.0_wp)   !! time of the zero if there is none

contains

   !> First time in [0, last] at which a joint switches between stick and slip, or no_zero.
   pure function first_transition(path, direction, slider, reach, last) result(time)
      real(wp), intent(in) :: path(0:)    !! Taylor coefficients of w.x
      real(wp), intent(in) :: direction   !! direction of slip, +1 or -1; 0: stuck
      real(wp), intent(in) :: slider      !! z
      real(wp), intent(in) :: reach       !! mu N/k: extension at which the joint slips
      real(wp), intent(in) :: last
      real(wp) :: time
      real(wp) :: guard(0:size(path) - 1)
      integer :: k

      if (abs(direction) > 0.0_wp) then
         do k = 1, size(path) - 1
            guard(k - 1) = direction*k*path(k)
         end do
         time = first_zero(guard(:size(path) - 2), last)
      else
         guard = -path
         guard(0) = reach - (path(0) - slider)
         time = first_zero(guard, last)
         guard = path
         guard(0) = reach + (path(0) - slider)
         time = min(time, first_zero(guard, last))
      end if
   end function first_transition

   !> First time in [0, last] after which the polynomial is negative, or no_zero.
   !>
   !> A value c(0) <= 0 belongs to the transition that has just been made (by rounding, or exactly
   !> zero after a joint has stuck). The sign of the first derivative that is not zero then says
   !> whether the guard rises, and that zero at the start is divided out.
   pure function first_zero(c, last) result(time)
      real(wp), intent(in) :: c(0:)
      real(wp), intent(in) :: last
      real(wp) :: time
      real(wp) :: bend
      integer :: first, k

      time = no_zero
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
      time = approach_zero(c(first:), bend, last)
   end function first_zero

   !> First zero of a polynomial, or no_zero, by steps that cannot pass one.
   !>
   !> Over [t, last] the polynomial lies above the parabola with its value and slope at t and the
   !> second derivative -bend. The zero of that parabola is the next t. The iterates converge to a
   !> simple zero quadratically, from below. They pass a minimum that is positive, but neither a
   !> double zero nor a pair of zeros.
   pure function approach_zero(c, bend, last) result(time)
      real(wp), intent(in) :: c(0:)
      real(wp), intent(in) :: bend   !! bound of |second derivative| over [0, last]
      real(wp), intent(in) :: last
      real(wp) :: time
      integer, parameter :: max_steps = 10000   ! takes some 6 for a simple zero, 100 for a double
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
         if (slope > 0.0_wp) then   ! two forms of the same zero, each without cancellation
            above = slope + root
            below = bend
         else
            above = 2.0_wp*value
            below = root - slope
         end if
         if (above >= below*(last - time)) then
            time = no_zero
            return
         end if
         step = above/below
         time = time + step
         if (step < least_step) return
      end do
   end function approach_zero

end module dynamics_exact_guard_zeros
