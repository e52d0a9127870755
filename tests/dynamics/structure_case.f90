!> The reference cases of tests/reference/structures: a structure, its force, and the exact response.
module structure_case
   use core_complaints, only: complaint_list
   use core_kinds, only: wp
   use core_table, only: read_table, table_type
   use structure_files, only: read_structure, structure_paths
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: structure_case_type, read_structure_case, structure_case_names

   character(13), parameter :: structure_case_names(7) = [character(13) :: 'nlvib07_three', &
      'nlvib08_beam', 's1_chain5', 's3_iwan6', 's4_between', 's6_dense8', 's8_extreme_mu']
   character(*), parameter :: folder = 'reference/structures/'   !! as seen from tests/

   !> One case. Arrays over joints and dofs are those of the structure.
   type :: structure_case_type
      type(structure_type) :: structure            !! joint_friction is that of the case
      real(wp) :: dt
      integer :: n_steps
      integer :: stride                            !! steps between snapshots
      real(wp), allocatable :: friction(:, :)      !! (joint, 1)
      real(wp), allocatable :: force(:, :)         !! (0:n_steps, force)
      real(wp), allocatable :: snapshot(:, :)      !! x (dof, 1..) at stride, 2 stride, ...
      real(wp), allocatable :: rms(:)              !! (dof) about zero, of all steps [m]
      real(wp), allocatable :: frequencies_stuck(:), frequencies_slip(:)   !! (mode) [Hz]
      real(wp), allocatable :: slip_fraction(:)    !! (joint)
      integer, allocatable :: slip_starts(:), stick_starts(:)   !! (joint)
      real(wp), allocatable :: displacement(:), velocity(:)     !! (dof) at the end
      integer, allocatable :: direction(:)         !! (joint) at the end: 0 stuck, +-1 slips so
      real(wp), allocatable :: joint_force(:)      !! (joint) at the end [N]
      real(wp), allocatable :: time(:)             !! (transition) all of them [s]
      integer, allocatable :: joint(:), kind(:)    !! (transition)
   end type structure_case_type

contains

   !> Reads one of structure_case_names.
   subroutine read_structure_case(name, case)
      character(*), intent(in) :: name
      type(structure_case_type), intent(out) :: case
      type(complaint_list) :: complaints
      type(structure_paths) :: paths
      type(table_type) :: events, force, x
      real(wp), allocatable :: damping_ratio(:)
      real(wp) :: rayleigh(2)
      character(:), allocatable :: path
      integer :: n_dof, n_joints, unit

      path = folder//trim(name)//'/'
      open (newunit=unit, file=path//'case.txt', status='old', action='read')
      read (unit, *)
      read (unit, *) n_dof, n_joints, case%n_steps, case%stride
      read (unit, *)
      read (unit, *) case%dt, rayleigh
      damping_ratio = [0.0_wp]
      read (unit, *)
      read (unit, *) damping_ratio
      call read_reals(unit, n_dof, case%frequencies_stuck)
      call read_reals(unit, n_dof, case%frequencies_slip)
      call read_reals(unit, n_joints, case%slip_fraction)
      call read_integers(unit, n_joints, case%slip_starts)
      call read_integers(unit, n_joints, case%stick_starts)
      call read_reals(unit, n_dof, case%rms)
      call read_reals(unit, n_dof, case%displacement)
      call read_reals(unit, n_dof, case%velocity)
      call read_integers(unit, n_joints, case%direction)
      call read_reals(unit, n_joints, case%joint_force)
      close (unit)

      paths%mass = path//'M.mtx'
      paths%stiffness = path//'K.mtx'
      paths%damping = path//'C.mtx'
      paths%joints = path//'joints.txt'
      paths%directions = path//'W.mtx'
      paths%load = path//'load.txt'
      call drop_if_missing(paths%damping)
      call drop_if_missing(paths%directions)
      call read_structure(paths, rayleigh, damping_ratio, 0, case%structure, complaints)
      call read_table(path//'force.txt', 1, 1, force, complaints)
      call read_table(path//'x.txt', n_dof + 1, n_dof + 1, x, complaints)
      call read_table(path//'events.txt', 3, 3, events, complaints)
      if (complaints%n > 0) error stop complaints%text
      case%friction = reshape(case%structure%joint_friction, [n_joints, 1])
      allocate (case%force(0:case%n_steps, 1))
      case%force(:, 1) = force%value(1, :)
      case%snapshot = x%value(2:, 2:)
      case%time = events%value(1, :)
      case%joint = nint(events%value(2, :))
      case%kind = nint(events%value(3, :))
   end subroutine read_structure_case

   subroutine drop_if_missing(path)
      character(:), allocatable, intent(inout) :: path
      logical :: exists

      inquire (file=path, exist=exists)
      if (.not. exists) path = ''
   end subroutine drop_if_missing

   subroutine read_reals(unit, n, values)
      integer, intent(in) :: unit, n
      real(wp), allocatable, intent(out) :: values(:)

      allocate (values(n))
      read (unit, *)
      read (unit, *) values
   end subroutine read_reals

   subroutine read_integers(unit, n, values)
      integer, intent(in) :: unit, n
      integer, allocatable, intent(out) :: values(:)

      allocate (values(n))
      read (unit, *)
      read (unit, *) values
   end subroutine read_integers

end module structure_case
