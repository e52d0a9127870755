!> The paper's chain of oscillators, each held by a Jenkins joint (Sec. 3, Fig. 7, Table 1), as a
!> structure.
!>
!> Coupling spring i connects mass i to mass i - 1, spring 1 connects mass 1 to the wall. Joint i
!> holds mass i to the ground.
module structure_chain
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use structure_model, only: build_structure, damping_type, part_names, structure_type, too_large
   implicit none(type, external)
   private
   public :: build_chain

contains

   !> Assembles the chain, forced at its last mass. Arrays have an entry for each mass,
   !> damping_ratio for each mode with all joints stuck.
   subroutine build_chain(mass, coupling_stiffness, contact_stiffness, normal_load, damping_ratio, &
                          structure, error)
      real(wp), intent(in) :: mass(:)                 !! [kg], positive
      real(wp), intent(in) :: coupling_stiffness(:)   !! [N/m]; the first goes to the wall
      real(wp), intent(in) :: contact_stiffness(:)    !! [N/m], positive
      real(wp), intent(in) :: normal_load(:)          !! N [N]
      real(wp), intent(in) :: damping_ratio(:)        !! zeta (mode), not negative
      type(structure_type), intent(out) :: structure
      type(error_type), allocatable, intent(out) :: error
      integer :: i, n

      n = size(mass)
      if (any([size(coupling_stiffness), size(contact_stiffness), size(normal_load), &
               size(damping_ratio)] /= n)) then
         call raise(error, exit_bad_input, 'chain: every property needs one value per dof ('// &
                    to_text(n)//')')
         return
      end if
      if (too_large(n, n) /= '') then
         call raise(error, exit_bad_input, 'chain%n_dof = '//to_text(n)//': '//too_large(n, n))
         return
      end if
      structure%joint_stiffness = contact_stiffness
      structure%normal_load = normal_load
      structure%friction_point = [(i, i=1, n)]
      allocate (structure%joint_friction(n), structure%load(n, 1), structure%mass(n, n), &
                structure%stiffness(n, n), structure%direction(n, n), source=0.0_wp)
      structure%load(n, 1) = 1.0_wp
      do i = 1, n
         structure%mass(i, i) = mass(i)
         structure%direction(i, i) = 1.0_wp
         structure%stiffness(i, i) = coupling_stiffness(i)
         if (i == n) exit
         structure%stiffness(i, i) = structure%stiffness(i, i) + coupling_stiffness(i + 1)
         structure%stiffness(i, i + 1) = -coupling_stiffness(i + 1)
         structure%stiffness(i + 1, i) = -coupling_stiffness(i + 1)
      end do

      call build_structure(damping_type(ratio=damping_ratio), &
                           part_names('chain%mass', 'chain%coupling_stiffness', &
                                      'chain%damping_ratio'), structure, error)
   end subroutine build_chain

end module structure_chain
