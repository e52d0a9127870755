!> How large a structure may be: its matrices are full, so memory is the limit.
module structure_sizes
   use core_kinds, only: wp
   use core_text, only: to_text
   implicit none(type, external)
   private
   public :: memory_of_matrices, most_dofs, too_large

   !> LAPACK counts its workspace, 2 n^2 + 6 n + 1 numbers of an eigenproblem, by a default integer
   integer, parameter :: most_dofs = 32766
   real(wp), parameter :: word = 8.0_wp      !! bytes of a number

contains

   !> Bytes of the matrices of a structure and of its march: 8 of (dof, dof) and of (dof, joint).
   elemental function memory_of_matrices(n_dof, n_joints) result(bytes)
      integer, intent(in) :: n_dof, n_joints
      real(wp) :: bytes

      bytes = 8.0_wp*word*n_dof*(real(n_dof, wp) + n_joints)
   end function memory_of_matrices

   !> Rule of a structure for which the system does not give the memory.
   pure function too_large(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(:), allocatable :: text

      text = 'its matrices take '//to_text(nint(bytes/1.0e6_wp))//' MB, which the system does '// &
             'not give: reduce the model (python -m entroslip.structure import --modes)'
   end function too_large

end module structure_sizes
