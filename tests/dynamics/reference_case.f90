!> The reference histories of tests/reference/dynamics: force, parameters, and the response.
module reference_case
   use core_error, only: error_type
   use core_kinds, only: wp
   use structure_chain, only: build_chain
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: reference_type, read_reference, paper_chain, reference_names

   character(13), parameter :: reference_names(6) = [character(13) :: 'p1_low', 'p2_high', &
      'p3_low_mu067', 'p4_high_mu100', 'p5_stuck', 'p6_mu0']
   integer, parameter :: n_dof = 5
   character(*), parameter :: folder = 'reference/dynamics/'   !! as seen from tests/

   type :: reference_type
      type(structure_type) :: chain
      real(wp) :: dt
      integer :: n_steps
      integer :: stride                          !! steps between snapshots
      real(wp) :: friction(n_dof)
      real(wp) :: slip_fraction(n_dof)
      integer :: slip_starts(n_dof), stick_starts(n_dof)
      real(wp) :: rms(n_dof)                     !! rms of the displacement [m]
      real(wp) :: displacement(n_dof), velocity(n_dof)   !! at the end
      integer :: direction(n_dof)                !! at the end
      real(wp), allocatable :: time(:)           !! times of the first transitions [s]
      integer, allocatable :: dof(:), kind(:)    !! dofs and kinds of the first transitions
      real(wp), allocatable :: force(:, :)       !! (0:n_steps, 1)
      real(wp), allocatable :: snapshot(:, :)    !! displacement (dof, 1..) at stride, 2 stride, ...
   end type reference_type

contains

   subroutine read_reference(name, case)
      character(*), intent(in) :: name
      type(reference_type), intent(out) :: case
      real(wp) :: mass, coupling, contact, load, damping, at_start(n_dof)
      integer :: unit, i, n, step

      open (newunit=unit, file=folder//trim(name)//'_reference.txt', status='old', action='read')
      call skip(2)
      read (unit, *) case%dt, case%n_steps, case%stride
      call skip(1)
      read (unit, *) mass, coupling, contact, load, damping
      call skip(1)
      read (unit, *) case%friction
      call skip(1)
      read (unit, *) case%slip_fraction
      call skip(1)
      read (unit, *) case%slip_starts
      call skip(1)
      read (unit, *) case%stick_starts
      call skip(1)
      read (unit, *) case%rms
      call skip(1)
      read (unit, *) case%displacement
      call skip(1)
      read (unit, *) case%velocity
      call skip(1)
      read (unit, *) case%direction
      call skip(1)
      read (unit, *) n
      allocate (case%time(n), case%dof(n), case%kind(n))
      do i = 1, n
         read (unit, *) case%time(i), case%dof(i), case%kind(i)
      end do
      close (unit)
      call paper_chain(mass, coupling, contact, load, damping, n_dof, case%chain)

      allocate (case%force(0:case%n_steps, 1), case%snapshot(n_dof, case%n_steps/case%stride))
      open (newunit=unit, file=folder//trim(name)//'_force.txt', status='old', action='read')
      call skip(1)
      read (unit, *) case%force
      close (unit)
      open (newunit=unit, file=folder//trim(name)//'_x.txt', status='old', action='read')
      call skip(1)
      read (unit, *) step, at_start
      do i = 1, case%n_steps/case%stride
         read (unit, *) step, case%snapshot(:, i)
      end do
      close (unit)

   contains

      subroutine skip(lines)
         integer, intent(in) :: lines
         integer :: line

         do line = 1, lines
            read (unit, *)
         end do
      end subroutine skip

   end subroutine read_reference

   !> The chain of Sec. 3 with equal oscillators, of any length.
   subroutine paper_chain(mass, coupling, contact, load, damping, n, chain)
      real(wp), intent(in) :: mass, coupling, contact, load, damping
      integer, intent(in) :: n
      type(structure_type), intent(out) :: chain
      type(error_type), allocatable :: error

      call build_chain(spread(mass, 1, n), spread(coupling, 1, n), spread(contact, 1, n), &
                       spread(load, 1, n), spread(damping, 1, n), chain, error)
      if (allocated(error)) error stop 'paper_chain: the chain was refused'
   end subroutine paper_chain

end module reference_case
