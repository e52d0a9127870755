!> Takes down the motion of samples that march each at its own time, after each `every`-th step.
module dynamics_newmark_recorder
   use core_kinds, only: long, wp
   use dynamics_newmark_block, only: newmark_block
   use dynamics_response, only: block_state
   implicit none(type, external)
   private
   public :: newmark_recorder, start_recorder

   !> Where the records of a block go, and which comes next.
   type :: newmark_recorder
      integer(long), allocatable :: next_tick(:)       !! (sample) of its next record; -1: none
      integer(long), private :: ticks_apart = 0
      integer, allocatable, private :: n_records(:)    !! (sample) so far
   contains
      procedure :: record
   end type newmark_recorder

contains

   !> Steps are counted from the start of the march, ticks from the beginning of this piece.
   pure subroutine start_recorder(state, block, every, recorder)
      type(block_state), intent(in) :: state
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: every   !! 0: nothing is recorded
      type(newmark_recorder), intent(out) :: recorder
      integer(long) :: first

      first = -1
      if (every > 0) &
         first = shiftl(every - modulo(state%step, int(every, long)), block%max_halvings)
      recorder%ticks_apart = shiftl(int(every, long), block%max_halvings)
      allocate (recorder%next_tick(block%n_samples), source=first)
      allocate (recorder%n_records(block%n_samples), source=0)
   end subroutine start_recorder

   !> Takes down sample w now.
   pure subroutine record(self, block, w, displacement, velocity)
      class(newmark_recorder), intent(inout) :: self
      type(newmark_block), intent(in) :: block
      integer, intent(in) :: w
      real(wp), intent(inout) :: displacement(:, :, :)         !! (record, dof, sample)
      real(wp), intent(inout), optional :: velocity(:, :, :)

      self%n_records(w) = self%n_records(w) + 1
      self%next_tick(w) = self%next_tick(w) + self%ticks_apart
      associate (motion => block%motion(:block%n_dof, :, block%slot(w), w), r => self%n_records(w))
         displacement(r, :, w) = motion(:, 3)
         if (present(velocity)) velocity(r, :, w) = motion(:, 2)
      end associate
   end subroutine record

end module dynamics_newmark_recorder
