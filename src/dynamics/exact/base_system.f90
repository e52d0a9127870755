!> The linear system that the exact march rests on: how the motion of 32 samples goes on over one
!> part of a step while no joint changes its regime, and how it answers to one that does.
module dynamics_exact_base_system
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: to_text
   use dynamics_exact_joint_paths, only: joint_paths, layer_side, width
   use dynamics_exact_transitions, only: transition_group
   use dynamics_joint, only: enter_transition, slip_direction
   use dynamics_response, only: block_state
   use structure_model, only: structure_type
   implicit none(type, external)
   private
   public :: base_system, raise_too_many, switch_joint

   !> A form of the equations of motion, for parts of length h.
   type, abstract :: base_system
      real(wp) :: h = 0.0_wp       !! [s]
      integer :: n_forces = 1
      integer :: max_transitions = 1000   !! of one sample in one part; more are an error
      logical :: keeps_ledger = .false.
      real(wp) :: works(width, 2) = 0.0_wp   !! (lane, input viscous) so far [J]
      integer :: n_kept = 0        !! numbers of a sample that `give` keeps in the block
      logical :: is_kept = .false. !! `take` finds them there
      type(joint_paths) :: paths
   contains
      !> Gets memory for a march, paths among it; the next begin gives it back.
      procedure(act), deferred :: begin
      !> Takes samples paths%first_sample, ... from the block: displacements and velocities, or what
      !> has been kept of them.
      procedure(exchange), deferred :: take
      !> Gives displacements and velocities back, and keeps what `take` restores bit for bit.
      procedure(exchange), deferred :: give
      !> Fills the paths of all joints, their ends, and the ends of all else, under the forces in
      !> paths; lists the suspects (dynamics_exact_free_steps: finish_part).
      procedure(act), deferred :: run_part
      procedure(correct), deferred :: correct
      procedure(redo), deferred :: redo
      !> Makes the ends the starts of the next part. With a ledger, also adds the works of the force
      !> and of the dampers.
      procedure(act), deferred :: go_on
      procedure(put_state), deferred :: put_state
   end type base_system

   abstract interface
      subroutine act(self)
         import :: base_system
         class(base_system), intent(inout) :: self
      end subroutine act

      subroutine exchange(self, state)
         import :: base_system, block_state
         class(base_system), intent(inout) :: self
         type(block_state), intent(inout) :: state
      end subroutine exchange

      !> Adds the effect of transition `entry` of the group to the ends of its sample.
      subroutine correct(self, group, entry)
         import :: base_system, transition_group
         class(base_system), intent(inout) :: self
         type(transition_group), intent(in) :: group
         integer, intent(in) :: entry
      end subroutine correct

      !> Marches the samples paths%is_involved through the part again, one transition after another,
      !> from the start and the regimes in paths. Enters all transitions into regimes and account.
      subroutine redo(self, begin, state, error)
         import :: base_system, block_state, error_type, wp
         class(base_system), intent(inout) :: self
         real(wp), intent(in) :: begin           !! of the part [parts]
         type(block_state), intent(inout) :: state
         type(error_type), allocatable, intent(out) :: error
      end subroutine redo

      !> Puts the state of all lanes now.
      subroutine put_state(self, displacement, velocity)
         import :: base_system, wp
         class(base_system), intent(in) :: self
         real(wp), intent(out) :: displacement(:, :)   !! (lane, dof) [m]
         real(wp), intent(out) :: velocity(:, :)       !! (lane, dof) [m/s]; or size 0
      end subroutine put_state
   end interface

contains

   !> Switches a joint in the regimes of its lane and in the account of its sample.
   subroutine switch_joint(base, lane, joint, time, place, velocity, state)
      class(base_system), intent(inout) :: base
      integer, intent(in) :: lane, joint
      real(wp), intent(in) :: time       !! [parts]
      real(wp), intent(in) :: place      !! w.x [m]
      real(wp), intent(in) :: velocity   !! of any unit; where slip starts its sign counts
      type(block_state), intent(inout) :: state
      integer :: side, way   ! of the slip that ends or 0; of that which ends or starts

      side = nint(base%paths%regime(lane, joint, layer_side))
      way = merge(side, slip_direction(velocity), side /= 0)
      call base%paths%switch(lane, joint, way, place)
      call enter_transition(state, joint, base%paths%first_sample + lane - 1, time*base%h, place, &
                            merge(0, way, side /= 0))
   end subroutine switch_joint

   !> Says that a joint has switched too often in one part.
   pure subroutine raise_too_many(base, joint, lane, begin, error)
      class(base_system), intent(in) :: base
      integer, intent(in) :: joint, lane
      real(wp), intent(in) :: begin   !! of the part [parts]
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_no_solution, 'joint '//to_text(joint)//' of sample '// &
                 to_text(base%paths%first_sample + lane - 1)//' of its block: more than '// &
                 to_text(base%max_transitions)//' transitions in the step that ends at t = '// &
                 to_text((begin + 1.0_wp)*base%h))
   end subroutine raise_too_many

end module dynamics_exact_base_system
