!> Root of an increasing function of one variable; the caller supplies one value at a time.
module numerics_root_search
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: root_search

   !> Steps that double until the root is enclosed, then regula falsi that keeps its bracket.
   type :: root_search
      real(wp) :: step = 1.0_wp                              !! the first one, while not enclosed
      real(wp) :: low = -huge(1.0_wp), high = huge(1.0_wp)   !! bounds of the root
      real(wp), private :: low_value = -huge(1.0_wp), high_value = huge(1.0_wp)
      integer, private :: side = 0                           !! side of the last value
   contains
      procedure :: advance
   end type root_search

contains

   !> Takes the value at x and moves x to the next point.
   pure subroutine advance(self, x, value)
      class(root_search), intent(inout) :: self
      real(wp), intent(inout) :: x
      real(wp), intent(in) :: value
      integer :: side

      side = merge(1, -1, value > 0.0_wp)
      if (side == 1) then   ! an end that stays twice is made to count less (Anderson, Bjorck)
         if (self%side == side) self%low_value = self%low_value*weight_left(value, self%high_value)
         self%high = x
         self%high_value = value
      else
         if (self%side == side) self%high_value = self%high_value*weight_left(value, self%low_value)
         self%low = x
         self%low_value = value
      end if
      if (self%low > -huge(1.0_wp) .and. self%high < huge(1.0_wp)) then
         self%side = side
         x = (self%low*self%high_value - self%high*self%low_value) &
             /(self%high_value - self%low_value)
         x = max(self%low, min(self%high, x))
      else
         x = x - side*self%step
         self%step = 2.0_wp*self%step
      end if
   end subroutine advance

   elemental function weight_left(value, before) result(weight)
      real(wp), intent(in) :: value, before
      real(wp) :: weight

      weight = 1.0_wp - value/before
      if (.not. weight > 0.0_wp) weight = 0.5_wp
   end function weight_left

end module numerics_root_search
