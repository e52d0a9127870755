!> A structure with Jenkins joints: M x'' + C x' + K x + sum_j w_j r_j = b F(t).
!>
!> Joint j acts along its direction w_j. Stuck, it is a spring, r_j = k_j (w_j.x - z_j), whose
!> slider stands at z_j; slipping, it carries r_j = +-mu_j N_j. With all joints stuck, or all
!> slipping, the structure is linear. The friction coefficients mu belong to a sample, not to it.
module structure_model
   use core_error, only: error_type
   use core_kinds, only: wp
   use numerics_lapack, only: solve_symmetric_eigenproblem
   implicit none(type, external)
   private
   public :: structure_type, find_modes, modal_damping

   !> One structure. Matrices are full; has_lumped_mass says that M is diagonal.
   type :: structure_type
      integer :: n_dof = 0, n_joints = 0, n_forces = 1
      integer :: n_points = 0                        !! of the process: largest friction_point
      real(wp), allocatable :: mass(:, :)            !! M (dof, dof) [kg]
      real(wp), allocatable :: stiffness(:, :)       !! K without the joints (dof, dof) [N/m]
      real(wp), allocatable :: damping(:, :)         !! C (dof, dof) [N s/m]; kept while joints slip
      real(wp), allocatable :: direction(:, :)       !! w_j (dof, joint)
      real(wp), allocatable :: joint_stiffness(:)    !! k_j (joint) [N/m]
      real(wp), allocatable :: normal_load(:)        !! N_j (joint) [N]
      real(wp), allocatable :: joint_friction(:)     !! mu_j (joint) of deterministic cases
      integer, allocatable :: friction_point(:)      !! (joint) point of the process that gives mu_j
      real(wp), allocatable :: load(:, :)            !! b (dof, force)
      real(wp), allocatable :: damping_ratio(:)      !! (mode), all joints stuck; size 0: not modal
      real(wp), allocatable :: frequencies_stuck(:)  !! (mode) [Hz], ascending
      real(wp), allocatable :: frequencies_slip(:)   !! (mode) [Hz], ascending
   contains
      procedure :: has_lumped_mass
      procedure :: lumped_mass
      procedure :: stuck_stiffness
   end type structure_type

contains

   !> True if M is diagonal.
   pure logical function has_lumped_mass(self)
      class(structure_type), intent(in) :: self
      integer :: i, j

      has_lumped_mass = .false.
      do j = 1, self%n_dof
         do i = 1, self%n_dof
            if (i /= j .and. self%mass(i, j) /= 0.0_wp) return
         end do
      end do
      has_lumped_mass = .true.
   end function has_lumped_mass

   !> Diagonal of M (dof) [kg].
   pure function lumped_mass(self) result(mass)
      class(structure_type), intent(in) :: self
      real(wp) :: mass(self%n_dof)
      integer :: i

      mass = [(self%mass(i, i), i=1, self%n_dof)]
   end function lumped_mass

   !> K + sum k_j w_j w_j' over the stuck joints (dof, dof) [N/m].
   pure function stuck_stiffness(self, is_stuck) result(k)
      class(structure_type), intent(in) :: self
      logical, intent(in) :: is_stuck(:)   !! (joint)
      real(wp) :: k(self%n_dof, self%n_dof)
      integer :: i, j

      k = self%stiffness
      do j = 1, self%n_joints
         if (.not. is_stuck(j)) cycle
         do i = 1, self%n_dof
            if (self%direction(i, j) == 0.0_wp) cycle
            k(:, i) = k(:, i) + self%joint_stiffness(j)*self%direction(i, j)*self%direction(:, j)
         end do
      end do
   end function stuck_stiffness

   !> Natural frequencies [Hz], ascending, and mass-normalized modes (dof, mode).
   subroutine find_modes(stiffness, mass, frequencies, modes, error)
      real(wp), intent(in) :: stiffness(:, :), mass(:, :)   !! (dof, dof) [N/m], [kg]
      real(wp), allocatable, intent(out) :: frequencies(:), modes(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      real(wp), allocatable :: eigenvalues(:)

      call solve_symmetric_eigenproblem(stiffness, mass, eigenvalues, modes, error)
      if (allocated(error)) return
      frequencies = sqrt(max(eigenvalues, 0.0_wp))/two_pi   ! a free body's zero may be -1e-17
   end subroutine find_modes

   !> C = M Phi diag(2 zeta omega) Phi' M (dof, dof) [N s/m].
   pure function modal_damping(mass, modes, ratio, frequencies) result(damping)
      real(wp), intent(in) :: mass(:, :), modes(:, :)      !! (dof, dof) [kg]; (dof, mode)
      real(wp), intent(in) :: ratio(:), frequencies(:)     !! zeta (mode), (mode) [Hz]
      real(wp) :: damping(size(mass, 1), size(mass, 1))
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      real(wp) :: momentum(size(mass, 1), size(modes, 2))
      integer :: i, j, r

      momentum = matmul(mass, modes)
      damping = 0.0_wp
      do r = 1, size(modes, 2)
         do j = 1, size(mass, 1)
            do i = 1, size(mass, 1)
               damping(i, j) = damping(i, j) + 2.0_wp*ratio(r)*two_pi*frequencies(r)* &
                               momentum(i, r)*momentum(j, r)
            end do
         end do
      end do
   end function modal_damping

end module structure_model
