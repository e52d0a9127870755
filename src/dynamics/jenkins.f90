!> One Jenkins element: a spring in series with a slider (Sec. 3), led along a given displacement.
module dynamics_jenkins
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: jenkins_force

contains

   !> Its force [N] at each displacement of a history that begins unstrained. Exact for a motion
   !> that is monotonic between the given points, however few: the slider gives way just as far as
   !> keeps the spring at its limit.
   pure function jenkins_force(stiffness, slip_limit, displacement) result(force)
      real(wp), intent(in) :: stiffness         !! of the spring [N/m]
      real(wp), intent(in) :: slip_limit        !! mu N [N], not negative
      real(wp), intent(in) :: displacement(:)   !! (point) [m]
      real(wp) :: force(size(displacement))
      integer :: i

      if (size(force) == 0) return
      force(1) = 0.0_wp
      do i = 2, size(force)
         force(i) = force(i - 1) + stiffness*(displacement(i) - displacement(i - 1))
         force(i) = max(-slip_limit, min(slip_limit, force(i)))
      end do
   end function jenkins_force

end module dynamics_jenkins
