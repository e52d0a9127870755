!> State of a block of samples, and the interface of the marchers that advance it.
module dynamics_response
   use core_error, only: error_type
   use core_kinds, only: long, wp
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: block_state, march_work, marcher_type, transition_list, start_block, stored_energy

   !> Stick-slip transitions of one sample, in time order.
   type :: transition_list
      integer :: n = 0
      real(wp), allocatable :: time(:)   !! [s]; valid to n
      integer, allocatable :: joint(:)
      integer, allocatable :: kind(:)    !! +1, -1: slip starts in that direction; 0: sticks
   contains
      procedure :: append
   end type transition_list

   !> Samples marched together under one case. No result depends on who shares the block.
   type :: block_state
      integer :: n_dof = 0
      integer :: n_joints = 0
      integer :: n_samples = 0
      integer(long) :: step = 0                         !! steps done
      real(wp), allocatable :: displacement(:, :)       !! x (dof, sample) [m]
      real(wp), allocatable :: velocity(:, :)           !! (dof, sample) [m/s]
      !> (item, sample) numbers from which a marcher goes on bit for bit, as it left them after so
      !> many steps with parts of such a length [s]; see base_system of the exact march
      real(wp), allocatable :: kept(:, :)
      integer(long) :: kept_step = -1
      real(wp) :: kept_h = 0.0_wp
      real(wp), allocatable :: slider(:, :)             !! z (joint, sample) [m]; force k (w.x - z)
      integer, allocatable :: direction(:, :)           !! (joint, sample) 0: stuck, +-1: slips so
      real(wp), allocatable :: slip_limit(:, :)         !! mu N (joint, sample) [N]
      !> (joint, sample) [s], [m]: slips that have ended or been closed (close_account); the
      !> distance is the sum of |change of w.x| while slipping, so mu N times it is dissipated
      real(wp), allocatable :: slip_time(:, :), slip_distance(:, :)
      !> (joint, sample) [s], [m]: time and place w.x from which a slip under way is to be counted
      real(wp), allocatable :: slip_since(:, :), slip_from(:, :)
      integer(long), allocatable :: slip_starts(:, :)   !! (joint, sample)
      integer(long), allocatable :: stick_starts(:, :)  !! (joint, sample)
      logical :: keeps_ledger = .false.
      real(wp), allocatable :: work_input(:)            !! (sample) [J]; kept when keeps_ledger
      real(wp), allocatable :: work_viscous(:)          !! (sample) [J]
      logical :: keeps_transitions = .false.
      type(transition_list), allocatable :: transitions(:)   !! (sample)
   end type block_state

   !> Counted work of a march: multiplications of one sample in a step, where 32 are marched side by
   !> side ((11) of docs/exact_march.md). A sample alone, or in scattered places, counts more.
   type :: march_work
      real(wp) :: step = huge(1.0_wp)     !! without transitions
      integer :: lanes = 1                !! samples that are marched in one, be they there or not
      real(wp) :: transition = 0.0_wp     !! more for each transition
      real(wp) :: share_anew = 0.0_wp     !! of the transitions, that begin all series anew
      integer :: n_parts = 1              !! of the step
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
      !> Marches a block on by as many steps as the force has intervals. Recorded are the
      !> displacements after each `every`-th step, counted from the start of the march.
      subroutine advance_block(self, state, force, every, displacement, velocity, error)
         import :: block_state, error_type, marcher_type, wp
         class(marcher_type), intent(inout) :: self
         type(block_state), intent(inout) :: state
         !> (step, column) [N], linear in between: a column a force, or n_forces for each sample
         real(wp), intent(in) :: force(0:, :)
         integer, intent(in) :: every
         real(wp), intent(out) :: displacement(:, :, :)   !! (record, dof, sample) [m]; or size 0
         real(wp), intent(out), optional :: velocity(:, :, :)   !! (record, dof, sample) [m/s]
         type(error_type), allocatable, intent(out) :: error
      end subroutine advance_block
   end interface

contains

   !> Multiplications of a sample in a step with so many transitions, in a block of so many samples
   !> (if not given, of whole lanes).
   elemental real(wp) function with_transitions(self, transitions, n_samples) result(work)
      class(march_work), intent(in) :: self
      real(wp), intent(in) :: transitions
      integer, intent(in), optional :: n_samples
      real(wp) :: anew   ! transitions of a sample in a part

      anew = self%share_anew*transitions/self%n_parts
      work = self%step*(1.0_wp + min(2.0_wp*self%lanes*anew, 2.0_wp + anew + 2.5_wp*sqrt(anew)))
      if (present(n_samples)) &
         work = work*self%lanes*((n_samples + self%lanes - 1)/self%lanes)/n_samples
      work = work + self%transition*transitions
   end function with_transitions

   !> Starts a block at rest, sliders at zero, all joints stuck; a joint with mu N = 0 slips from
   !> the start.
   pure subroutine start_block(structure, friction, state)
      type(structure_type), intent(in) :: structure
      real(wp), intent(in) :: friction(:, :)   !! mu_S = mu_D (joint, sample), not negative
      type(block_state), intent(inout) :: state   !! keeps_ledger and keeps_transitions are kept
      type(block_state) :: fresh
      integer :: m, n, w

      n = structure%n_dof
      m = structure%n_joints
      w = size(friction, 2)
      fresh%keeps_ledger = state%keeps_ledger
      fresh%keeps_transitions = state%keeps_transitions
      state = fresh
      state%n_dof = n
      state%n_joints = m
      state%n_samples = w
      allocate (state%slip_limit(m, w), source=friction*spread(structure%normal_load, 2, w))
      allocate (state%direction(m, w), source=merge(0, 1, state%slip_limit > 0.0_wp))
      allocate (state%displacement(n, w), state%velocity(n, w), state%slider(m, w), &
                state%slip_time(m, w), state%slip_distance(m, w), state%slip_since(m, w), &
                state%slip_from(m, w), source=0.0_wp)
      allocate (state%slip_starts(m, w), state%stick_starts(m, w), source=0_long)
      allocate (state%work_input(w), state%work_viscous(w), source=0.0_wp)
      allocate (state%transitions(w))
   end subroutine start_block

   !> Kinetic energy, and strain energy of the structure and of its joints [J], per sample.
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

   !> Puts one more transition into the list: in time order, by joints at one instant.
   pure subroutine append(self, time, joint, kind)
      class(transition_list), intent(inout) :: self
      real(wp), intent(in) :: time
      integer, intent(in) :: joint, kind
      integer :: i, room

      if (.not. allocated(self%time)) allocate (self%time(64), self%joint(64), self%kind(64))
      if (self%n == size(self%time)) then
         room = 2*self%n
         self%time = [self%time, spread(0.0_wp, 1, room - self%n)]
         self%joint = [self%joint, spread(0, 1, room - self%n)]
         self%kind = [self%kind, spread(0, 1, room - self%n)]
      end if
      self%n = self%n + 1
      do i = self%n, 2, -1   ! a step's transitions may come in any order
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
