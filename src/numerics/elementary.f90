!> Elementary functions near zero, where the plain formula loses all digits.
module numerics_elementary
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: exp_minus_one, log_cosh, log_one_plus

contains

   !> exp(x) - 1.
   elemental function exp_minus_one(x) result(value)
      real(wp), intent(in) :: x
      real(wp) :: value

      value = 2.0_wp*exp(0.5_wp*x)*sinh(0.5_wp*x)
   end function exp_minus_one

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

   !> ln cosh x; no overflow where cosh x has one.
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
