!> &structure: a structure from files, held by Jenkins joints.
module config_groups_structure
   use config_text_value_table, only: about, not_negative, visitor_type
   use core_kinds, only: wp
   implicit none(type, external)
   private
   public :: structure_group

   !> Paths as in the scene: beside it, or in the current directory.
   type :: structure_group
      character(:), allocatable :: mass_matrix
      character(:), allocatable :: stiffness_matrix
      character(:), allocatable :: damping_matrix
      real(wp), allocatable :: rayleigh(:)
      real(wp), allocatable :: damping_ratio(:)
      character(:), allocatable :: joints
      character(:), allocatable :: directions
      character(:), allocatable :: load
   contains
      procedure :: visit
   end type structure_group

contains

   subroutine visit(self, visitor)
      class(structure_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor

      ! which file holds a matrix changes nothing: its values are in the fingerprint
      call visitor%visit_text(self%mass_matrix, about('mass_matrix', &
         'M: a Matrix Market file, real or integer', 'kg', shapes_samples=.false.))
      call visitor%visit_text(self%stiffness_matrix, about('stiffness_matrix', &
         'K without the joints: a Matrix Market file', 'N/m', shapes_samples=.false.))
      call visitor%visit_text(self%damping_matrix, about('damping_matrix', &
         'C: a Matrix Market file; or one of the next two', 'N s/m', shapes_samples=.false.))
      call visitor%visit(self%rayleigh, about('rayleigh', &
         'alpha [1/s], beta [s]: C = alpha M + beta K', rule=not_negative(), length=2), &
         default=[0.0_wp, 0.0_wp])
      call visitor%visit(self%damping_ratio, about('damping_ratio', &
         'of critical, one or one per mode with all joints stuck', rule=not_negative()), &
         default=[0.005_wp])
      call visitor%visit_text(self%joints, about('joints', &
         'a line each: dof_a dof_b stiffness normal_load friction '// &
         '[friction_point]; dof_b 0: ground', shapes_samples=.false.))
      call visitor%visit_text(self%directions, about('directions', &
         'W (dofs x joints), Matrix Market; then joints has no dofs', shapes_samples=.false.))
      call visitor%visit_text(self%load, about('load', &
         'factor of each dof, one a line, a column a force; none: 1 at excitation%dof, or '// &
         'with base at all dofs', &
         shapes_samples=.false.))
   end subroutine visit

end module config_groups_structure
