!> State of a block of samples during a march, and the interface of the two marchers.
module dynamics_response
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: block_state, march_work, marcher_type, slip_account, transition_list, start_block, &
             stored_energy

   !> Stick-slip transitions of one sample, in time order.
   type :: transition_list
      integer :: n = 0
      real(wp), allocatable :: time(:)   !! [s]
      integer, allocatable :: joint(:)
      integer, allocatable :: kind(:)    !! +1 or -1: slip starts in that direction; 0: slip ends
   contains
      procedure :: append
   end type transition_list

   !> Account of the slip of one joint in one sample.
   type :: slip_account
      integer :: direction = 0                 !! of the present slip, +1 or -1; stuck: 0
      !> [s], [m] total of the slips counted so far; the distance is the sum of |change of w.x|
      !> during slip, and mu N times the distance is dissipated
      real(wp) :: slip_time = 0.0_wp, slip_distance = 0.0_wp
      !> [s], [m] time and w.x up to which the present slip is counted
      real(wp) :: slip_since = 0.0_wp, slip_from = 0.0_wp
      integer(long) :: slip_starts = 0_long, stick_starts = 0_long
   end type slip_account

   !> State of samples that are marched side by side. Results of a sample do not depend on the other
   !> samples of its block.
   type :: block_state
      integer :: n_dof = 0
      integer :: n_joints = 0
      integer :: n_samples = 0
      integer(long) :: step = 0                         !! number of steps marched
      real(wp), allocatable :: displacement(:, :)       !! x (dof, sample) [m]
      real(wp), allocatable :: velocity(:, :)           !! (dof, sample) [m/s]
      !> (item, sample) internal state, from which the exact march that stored it continues with the
      !> same bits; another march must not continue
      real(wp), allocatable :: internal(:, :)
      real(wp), allocatable :: slider(:, :)             !! z (joint, sample) [m]; force k (w.x - z)
      real(wp), allocatable :: slip_limit(:, :)         !! mu N (joint, sample) [N]
      type(slip_account), allocatable :: account(:, :)  !! (joint, sample)
      logical :: keeps_ledger = .false.                 !! True if work is computed
      real(wp), allocatable :: work_input(:)            !! work of the forces (sample) [J]
      real(wp), allocatable :: work_viscous(:)          !! work of the dampers (sample) [J]
      logical :: keeps_transitions = .false.
      type(transition_list), allocatable :: transitions(:)   !! (sample)
   end type block_state

   !> Cost of a march: multiplications of one sample in a step ((11) of docs/exact_march.md).
   type :: march_work
      real(wp) :: step = huge(1.0_wp)      !! cost of a step without transitions
      integer :: lanes = 1                 !! samples that cost as much as one
      real(wp) :: transition = 0.0_wp      !! cost of a transition
      real(wp) :: restart_share = 0.0_wp   !! share of transitions that start all series again
      integer :: n_parts = 1               !! parts of a step
   contains
      procedure :: with_transitions
   end type march_work

   !> A time integration method, prepared for one structure and one time step.
   type, abstract :: marcher_type
      type(structure_type) :: structure
      real(wp) :: dt = 0.0_wp       !! [s]
      type(march_work) :: work
   contains
      procedure(advance_block), deferred :: advance
   end type marcher_type

   abstract interface
      !> Marches a block by as many steps as the force has intervals. Records displacements after
      !> each `every`-th step, counted from the start of the march.
      subroutine advance_block(self, state, force, every, displacement, velocity, error)
         import :: block_state, error_type, marcher_type, wp
         class(marcher_type), intent(inout) :: self
         type(block_state), intent(inout) :: state
         !> (step, force) [N] of all samples, or (step, force and sample); linear between steps
         real(wp), intent(in) :: force(0:, :)
         integer, intent(in) :: every
         !> (record, dof, sample) [m]; size 0: nothing is recorded
         real(wp), intent(out) :: displacement(:, :, :)
         real(wp), intent(out), optional :: velocity(:, :, :)   !! (record, dof, sample) [m/s]
         type(error_type), allocatable, intent(out) :: error
      end subroutine advance_block
   end interface

contains

   !> Multiplications of a sample in a step with transitions (11). n_samples is the size of the
   !> block; without it all lanes have a sample.
   elemental real(wp) function with_transitions(self, transitions, n_samples) result(work)
      class(march_work), intent(in) :: self
      real(wp), intent(in) :: transitions
      integer, intent(in), optional :: n_samples
      real(wp) :: m   ! transitions of a sample in a part that start all series again

      m = self%restart_share*transitions/self%n_parts
      work = self%step*(1.0_wp + min(2.0_wp*self%lanes*m, 2.0_wp + m + 2.5_wp*sqrt(m)))
      if (present(n_samples)) &
         work = work*self%lanes*((n_samples + self%lanes - 1)/self%lanes)/n_samples
      work = work + self%transition*transitions
   end function with_transitions

   !> Initializes a block at rest, with sliders at zero and all joints stuck; a joint with mu N = 0
   !> slips from the start. keeps_ledger and keeps_transitions of the state stay.
   pure subroutine start_block(structure, friction, state)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: friction(:, :)   !! mu_S = mu_D (joint, sample), not negative
      type(block_state), intent(inout) :: state
      integer :: m, n, w

      n = structure%n_dof
      m = structure%n_joints
      w = size(friction, 2)
      state = block_state(n_dof=n, n_joints=m, n_samples=w, keeps_ledger=state%keeps_ledger, &
                          keeps_transitions=state%keeps_transitions)
      allocate (state%slip_limit(m, w), source=friction*spread(structure%normal_load, 2, w))
      allocate (state%account(m, w))
      state%account%direction = merge(0, 1, state%slip_limit > 0.0_wp)
      allocate (state%displacement(n, w), state%velocity(n, w), state%slider(m, w), source=0.0_wp)
      allocate (state%work_input(w), state%work_viscous(w), source=0.0_wp)
      allocate (state%transitions(w))
   end subroutine start_block

   !> Kinetic energy and strain energy of the structure and of its joints, per sample [J].
   pure function stored_energy(structure, state) result(energy)
      type(structure_type), intent(in) :: structure
      type(block_state), intent(in) :: state
      real(wp) :: energy(state%n_samples)
      integer :: w

      do w = 1, state%n_samples
         associate (x => state%displacement(:, w), v => state%velocity(:, w), &
                    extension => matmul(state%displacement(:, w), structure%direction) &
                    - state%slider(:, w))
            energy(w) = 0.5_wp*(dot_product(v, matmul(structure%mass, v)) &
                                + dot_product(x, matmul(structure%stiffness, x)) &
                                + sum(structure%joint_stiffness*extension**2))
         end associate
      end do
   end function stored_energy

   !> Inserts a transition into the list, by its time, then by its joint.
   pure subroutine append(self, time, joint, kind)
      class(transition_list), intent(inout) :: self
      real(wp), intent(in) :: time
      integer, intent(in) :: joint, kind
      integer :: i

      if (.not. allocated(self%time)) allocate (self%time(64), self%joint(64), self%kind(64))
      if (self%n == size(self%time)) then
         self%time = [self%time, self%time]   ! twice the capacity
         self%joint = [self%joint, self%joint]
         self%kind = [self%kind, self%kind]
      end if
      self%n = self%n + 1
      do i = self%n, 2, -1   ! transitions of a step may come in any order
         if (self%time(i - 1) < time .or. &
             self%time(i - 1) <= time .and. self%joint(i - 1) <= joint) exit
         self%time(i) = self%time(i - 1)
         self%joint(i) = self%joint(i - 1)
         self%kind(i) = self%kind(i - 1)
      end do
      self%time(i) = time
      self%joint(i) = joint
      self%kind(i) = kind
   end subroutine append

end module dynamics_response
