!> The chain of oscillators, each held by a Jenkins element (Sec. 3, Fig. 7, Table 1).
!>
!> Mass i hangs on its neighbours by the coupling springs, spring 1 goes to the wall, and the last
!> mass is free at its far side. To the ground each is held by a Jenkins element: the contact spring
!> in series with a slider that carries at most mu N. All sliders stuck, or all slipping, the chain
!> is linear.
module dynamics_chain
   use core_error, only: error_type, exit_bad_input, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use numerics_lapack, only: solve_symmetric_eigenproblem
   implicit none(type, external)
   private
   public :: chain_type, build_chain

   !> One chain; the friction coefficients are not part of it, they belong to a sample.
   type :: chain_type
      integer :: n_dof = 0
      real(wp), allocatable :: mass(:)                !! (dof) [kg]
      real(wp), allocatable :: contact_stiffness(:)   !! (dof) of the Jenkins springs [N/m]
      real(wp), allocatable :: normal_load(:)         !! (dof) N [N]
      real(wp), allocatable :: coupling(:, :)         !! (dof, dof) stiffness, all slipping [N/m]
      real(wp), allocatable :: damping(:, :)          !! (dof, dof) C, modal, stuck chain [N s/m]
      real(wp), allocatable :: damping_ratio(:)       !! (mode) of the stuck chain
      real(wp), allocatable :: frequencies_stuck(:)   !! (mode) [Hz], Table 1
      real(wp), allocatable :: frequencies_slip(:)    !! (mode) [Hz], Table 1
   contains
      procedure :: stiffness
   end type chain_type

contains

   !> Assembles the chain. Arrays have one entry per dof; damping_ratio one per mode, stuck.
   subroutine build_chain(mass, coupling_stiffness, contact_stiffness, normal_load, damping_ratio, &
                          chain, error)
      real(wp), intent(in) :: mass(:)                 !! [kg], positive
      real(wp), intent(in) :: coupling_stiffness(:)   !! [N/m]; the first goes to the wall
      real(wp), intent(in) :: contact_stiffness(:)    !! [N/m], positive
      real(wp), intent(in) :: normal_load(:)          !! N [N]
      real(wp), intent(in) :: damping_ratio(:)        !! fraction of critical, not negative
      type(chain_type), intent(out) :: chain
      type(error_type), allocatable, intent(out) :: error
      real(wp), allocatable :: modes(:, :), mass_matrix(:, :), unused(:, :)
      integer :: i, n

      n = size(mass)
      if (any([size(coupling_stiffness), size(contact_stiffness), size(normal_load), &
               size(damping_ratio)] /= n)) then
         call raise(error, exit_bad_input, 'chain: every property needs one value per dof ('// &
                    to_text(n)//')')
         return
      end if
      chain%n_dof = n
      chain%mass = mass
      chain%contact_stiffness = contact_stiffness
      chain%normal_load = normal_load
      chain%damping_ratio = damping_ratio

      allocate (chain%coupling(n, n), mass_matrix(n, n), source=0.0_wp)
      do i = 1, n
         mass_matrix(i, i) = mass(i)
         chain%coupling(i, i) = coupling_stiffness(i)
         if (i == n) exit
         chain%coupling(i, i) = chain%coupling(i, i) + coupling_stiffness(i + 1)
         chain%coupling(i, i + 1) = -coupling_stiffness(i + 1)
         chain%coupling(i + 1, i) = -coupling_stiffness(i + 1)
      end do

      call find_frequencies(chain%coupling, mass_matrix, chain%frequencies_slip, unused, error)
      if (allocated(error)) return
      call find_frequencies(chain%stiffness([(.true., i=1, n)]), mass_matrix, &
                            chain%frequencies_stuck, modes, error)
      if (allocated(error)) return
      chain%damping = modal_damping(mass, modes, damping_ratio, chain%frequencies_stuck)
   end subroutine build_chain

   !> Tangent stiffness [N/m] with the given sliders stuck.
   pure function stiffness(self, is_stuck) result(k)
      class(chain_type), intent(in) :: self
      logical, intent(in) :: is_stuck(:)   !! (dof)
      real(wp) :: k(self%n_dof, self%n_dof)
      integer :: i

      k = self%coupling
      do i = 1, self%n_dof
         if (is_stuck(i)) k(i, i) = k(i, i) + self%contact_stiffness(i)
      end do
   end function stiffness

   !> Natural frequencies [Hz], ascending, and mass-normalized modes (dof, mode).
   subroutine find_frequencies(stiffness, mass_matrix, frequencies, modes, error)
      real(wp), intent(in) :: stiffness(:, :), mass_matrix(:, :)
      real(wp), allocatable, intent(out) :: frequencies(:), modes(:, :)
      type(error_type), allocatable, intent(out) :: error
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      real(wp), allocatable :: eigenvalues(:)

      call solve_symmetric_eigenproblem(stiffness, mass_matrix, eigenvalues, modes, error)
      if (allocated(error)) return
      frequencies = sqrt(max(eigenvalues, 0.0_wp))/two_pi   ! a free body's zero may be -1e-17
   end subroutine find_frequencies

   !> C = M Phi diag(2 zeta omega) Phi' M [N s/m]: it stays while sliders slip.
   pure function modal_damping(mass, modes, ratio, frequencies) result(damping)
      real(wp), intent(in) :: mass(:), modes(:, :), ratio(:), frequencies(:)
      real(wp) :: damping(size(mass), size(mass))
      real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
      integer :: i, j, r

      damping = 0.0_wp
      do r = 1, size(mass)
         do j = 1, size(mass)
            do i = 1, size(mass)
               damping(i, j) = damping(i, j) + 2.0_wp*ratio(r)*two_pi*frequencies(r)* &
                               mass(i)*modes(i, r)*modes(j, r)*mass(j)
            end do
         end do
      end do
   end function modal_damping

end module dynamics_chain
