!> The force that a march is under, and where it bends.
module dynamics_course
   use core_kinds, only: wp
   use dynamics_propagator, only: levels, stride_of
   implicit none(type, external)
   private
   public :: course_type, new_course

   !> Values at steps, linear between them; one sample's behind the other's where each has its own.
   !> A position counts from 0 through all of them.
   type :: course_type
      integer :: n_values = 0
      real(wp), allocatable :: force(:)     !! (0:) [N]; zeros follow, a longest stride of them
      !> The kink of the force at a position: by how much it changes the third derivative of the
      !> forced mass, per step cubed [m]
      real(wp), allocatable :: kink(:)      !! (0:)
      !> The sum of their magnitudes within a stretch from a position, per stretch cubed [m]
      real(wp), allocatable :: bend(:, :)   !! (0:, level)
   end type course_type

contains

   !> Stretches that have not their whole length left bend nowhere: none is marched.
   pure function new_course(force, scale) result(course)
      real(wp), intent(in) :: force(:, :)   !! (step, 1 or sample) [N]
      real(wp), intent(in) :: scale         !! h^2/m of the forced mass [m/N]
      type(course_type) :: course
      integer :: k, last, level, n

      n = size(force)
      course%n_values = n
      allocate (course%force(0:n - 1 + stride_of(levels)), source=0.0_wp)
      course%force(:n - 1) = reshape(force, [n])
      allocate (course%kink(0:n - 1), course%bend(0:n - 1, levels), source=0.0_wp)
      associate (f => course%force)
         course%kink(1:n - 2) = scale*((f(:n - 3) - f(1:n - 2)) + (f(2:n - 1) - f(1:n - 2)))
      end associate
      do level = 1, levels
         last = n - 1 - stride_of(level)
         do k = 1, stride_of(level) - 1
            course%bend(:last, level) = course%bend(:last, level) + &
                                        stride_of(level)**3*abs(course%kink(k:last + k))
         end do
      end do
   end function new_course

end module dynamics_course
