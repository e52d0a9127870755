!> Interface of the two forms of the exact march, power series and modes: the free motion of 32
!> samples over one part of a step, without transitions, and its correction by each transition.
module dynamics_exact_base_system
   use core_error, only: error_type, exit_no_solution, raise
   use core_kinds, only: wp
   use core_text, only: rounded_text, to_text
   use dynamics_exact_joint_paths, only: joint_paths, width
   use dynamics_exact_transitions, only: transition_group
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: base_system, raise_too_many

   !> A form of the equations of motion, for parts of length h.
   type, abstract :: base_system
      real(wp) :: h = 0.0_wp       !! [s]
      integer :: max_transitions = 1000   !! transitions of a sample in a part; more are an error
      logical :: keeps_ledger = .false.
      real(wp) :: work_done(width, 2) = 0.0_wp   !! (lane, input viscous) since the start [J]
      integer :: n_internal = 0    !! length of a sample's internal state, see block_state
      logical :: has_internal = .false.   !! True if the block has an internal state
      type(joint_paths) :: paths
   contains
      !> Allocates all arrays, those of paths among them, and copies samples paths%first_sample, ..
      !> from the block: their internal state if it has that, else displacements and velocities,
      !> which must be zero for modes.
      procedure(state_transfer), deferred :: load_state
      !> Copies displacements, velocities and the internal state, from which the march continues
      !> with the same bits, to the block.
      procedure(state_transfer), deferred :: store_state
      !> Finds the free motion over a part under the forces in paths: the paths of all joints, all
      !> values at the end, and the candidates for transitions (find_candidates).
      procedure(part_action), deferred :: march_freely
      procedure(add_transition), deferred :: add_transition
      procedure(march_again), deferred :: march_again
      !> Starts the next part from the ends of this one. With a ledger, also adds the work of the
      !> forces and of the dampers.
      procedure(part_action), deferred :: end_part
      procedure(copy_state), deferred :: copy_state
   end type base_system

   abstract interface
      subroutine part_action(self)
         import :: base_system
         class(base_system), intent(inout) :: self
      end subroutine part_action

      subroutine state_transfer(self, state)
         import :: base_system, block_state
         class(base_system), intent(inout) :: self
         type(block_state), intent(inout) :: state
      end subroutine state_transfer

      !> Adds the effect of transition `entry` of the group to its sample's values at the end.
      subroutine add_transition(self, group, entry)
         import :: base_system, transition_group
         class(base_system), intent(inout) :: self
         type(transition_group), intent(in) :: group
         integer, intent(in) :: entry
      end subroutine add_transition

      !> Marches the samples paths%is_remarched through the part again, from its start, one
      !> transition after another, and enters these into regimes and state.
      subroutine march_again(self, begin, state, error)
         import :: base_system, block_state, error_type, wp
         class(base_system), intent(inout) :: self
         real(wp), intent(in) :: begin           !! time at which the part begins [parts]
         type(block_state), intent(inout) :: state
         type(error_type), allocatable, intent(out) :: error
      end subroutine march_again

      !> Copies the displacements and velocities of all lanes at the start of the part.
      subroutine copy_state(self, displacement, velocity)
         import :: base_system, wp
         class(base_system), intent(in) :: self
         real(wp), intent(out) :: displacement(:, :)   !! (lane, dof) [m]
         real(wp), intent(out) :: velocity(:, :)       !! (lane, dof) [m/s]; size 0: not wanted
      end subroutine copy_state
   end interface

contains

   !> Raises the error of a joint that switches too often in one part.
   pure subroutine raise_too_many(base, joint, lane, begin, error)
      class(base_system), intent(in) :: base
      integer, intent(in) :: joint, lane
      real(wp), intent(in) :: begin   !! time at which the part begins [parts]
      type(error_type), allocatable, intent(out) :: error

      call raise(error, exit_no_solution, 'joint '//to_text(joint)//': more than '// &
                 to_text(base%max_transitions)//' transitions in the step that ends at t = '// &
                 rounded_text((begin + 1.0_wp)*base%h, 6))
      error%sample = base%paths%first_sample + lane - 1
   end subroutine raise_too_many

end module dynamics_exact_base_system
