!> &chain: the chain of oscillators held by Jenkins elements; defaults are those of Sec. 3.
module config_groups_chain
   use config_text_value_table, only: about, between, entry_type, not_negative, positive, &
      visitor_type
   use core_kinds, only: wp
   use structure_sizes, only: most_dofs
   implicit none(type, external)
   private
   public :: chain_group

   !> Every list: one value, or one per dof.
   type :: chain_group
      integer :: n_dof = 5
      real(wp), allocatable :: mass(:)
      real(wp), allocatable :: coupling_stiffness(:)
      real(wp), allocatable :: contact_stiffness(:)
      real(wp), allocatable :: normal_load(:)
      real(wp), allocatable :: friction(:)
      real(wp), allocatable :: damping_ratio(:)
   contains
      procedure :: visit
   end type chain_group

contains

   subroutine visit(self, visitor)
      class(chain_group), intent(inout) :: self
      class(visitor_type), intent(inout) :: visitor
      type(entry_type) :: entry

      entry = about('n_dof', 'number of masses; the first is next to the wall', &
                    rule=between(1.0_wp, real(most_dofs, wp)))
      entry%default = 'length of the longest list, else 5'
      call visitor%visit(self%n_dof, entry)
      entry = about('mass', 'one value, or one per dof', 'kg', positive())
      call visit_list(self%mass, [1.0_wp])
      entry = about('coupling_stiffness', &
                    'of the springs between the masses; the first goes to the wall', 'N/m', &
                    not_negative())
      call visit_list(self%coupling_stiffness, [25.0_wp])
      entry = about('contact_stiffness', 'of the springs of the Jenkins elements', 'N/m', &
                    positive())
      call visit_list(self%contact_stiffness, [50.0_wp])
      entry = about('normal_load', 'on the sliders', 'N', not_negative())
      call visit_list(self%normal_load, [10.0_wp])
      entry = about('friction', 'friction coefficients of the deterministic cases', &
                    rule=not_negative())
      entry%default = 'the mean that all &process share'
      call visit_list(self%friction, [real(wp) ::])
      entry = about('damping_ratio', 'of critical, for each mode of the stuck chain', &
                    rule=not_negative())
      call visit_list(self%damping_ratio, [0.005_wp])

   contains

      !> Visits a list with a value for each dof, or one for all.
      subroutine visit_list(list, default)
         real(wp), allocatable, intent(inout) :: list(:)
         real(wp), intent(in) :: default(:)

         entry%per_dof = self%n_dof
         call visitor%visit(list, entry, default=default)
      end subroutine visit_list

   end subroutine visit

end module config_groups_chain
