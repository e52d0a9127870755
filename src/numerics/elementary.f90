!> Elementary functions without loss of digits near zero, and the exponential of many values at
!> once.
module numerics_elementary
   use core_kinds, only: long, wp
   implicit none(type, external)
   private
   public :: exp_minus_one, exponentiate, log_cosh, log_one_plus

contains

   !> exp(x) - 1.
   elemental function exp_minus_one(x) result(value)
      real(wp), intent(in) :: x
      real(wp) :: value

      value = 2.0_wp*exp(0.5_wp*x)*sinh(0.5_wp*x)
   end function exp_minus_one

   !> Replaces values by their exponentials, in vector operations, accurate to two units in the last
   !> place. Values beyond +-700 are set to +-700. exp(x) = 2^k exp(r), |r| = |x - k ln 2| <=
   !> ln(2)/2, with the Taylor series to r^13, whose remainder is below 1e-17.
   pure subroutine exponentiate(values)
      real(wp), intent(inout) :: values(:)
      real(wp), parameter :: largest = 700.0_wp   ! exp(-largest) is a normal number
      real(wp), parameter :: ln2_high = 0.693147180369123816490_wp, &
                             ln2_low = 1.90821492927058770002e-10_wp   ! ln 2 in two parts
      integer :: i
      real(wp), parameter :: c(2:13) = 1.0_wp/[(gamma(i + 1.0_wp), i=2, 13)]   ! 1/i!
      integer, parameter :: exponent_bias = 1023, fraction_bits = 52
      real(wp) :: r, series, x
      integer :: k, m

      !$omp simd
      do m = 1, size(values)
         x = max(-largest, min(values(m), largest))
         k = int(x/(ln2_high + ln2_low) + sign(0.5_wp, x))
         r = (x - k*ln2_high) - k*ln2_low
         series = c(10) + r*(c(11) + r*(c(12) + r*c(13)))
         series = c(6) + r*(c(7) + r*(c(8) + r*(c(9) + r*series)))
         series = 1.0_wp + r*(1.0_wp + r*(c(2) + r*(c(3) + r*(c(4) + r*(c(5) + r*series)))))
         values(m) = series*transfer(shiftl(int(exponent_bias + k, long), fraction_bits), series)
      end do
   end subroutine exponentiate

   !> ln(1 + x).
   elemental function log_one_plus(x) result(value)
      real(wp), intent(in) :: x   !! above -1
      real(wp) :: value

      if (x < 0.5_wp) then
         value = 2.0_wp*atanh(x/(2.0_wp + x))
      else
         value = log(1.0_wp + x)
      end if
   end function log_one_plus

   !> ln cosh x, without the overflow of cosh x.
   elemental function log_cosh(x) result(value)
      real(wp), intent(in) :: x
      real(wp) :: value
      real(wp), parameter :: log_two = log(2.0_wp)

      if (abs(x) < 1.0_wp) then
         value = 0.5_wp*log_one_plus(sinh(x)**2)
      else
         value = abs(x) - log_two + log_one_plus(exp(-2.0_wp*abs(x)))
      end if
   end function log_cosh

end module numerics_elementary
