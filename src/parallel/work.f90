!> Distribution of work among ranks on demand, by a counter in the root's memory that is read and
!> incremented in one atomic operation.
module parallel_work
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_ptr
   use core_kinds, only: long
   use mpi_f08, only: MPI_ADDRESS_KIND, MPI_Fetch_and_op, MPI_INFO_NULL, MPI_INTEGER8, &
                      MPI_MODE_NOCHECK, MPI_Op, MPI_REPLACE, MPI_SUM, MPI_Win, MPI_Win_allocate, &
                      MPI_Win_flush, MPI_Win_free, MPI_Win_lock_all, MPI_Win_sync, &
                      MPI_Win_unlock_all
   use parallel_world, only: world_type
   implicit none(type, external)
   private
   public :: work_counter, new_counter

   integer, parameter :: word_bytes = 8   !! size of the counter

   !> Counter that gives each of the items 1..n_items to one rank. If the network has no remote
   !> atomic operations, as with TCP, the root answers when it is inside MPI (attend_to_others).
   type :: work_counter
      private
      type(world_type) :: world
      integer :: n_items = 0
      integer(long) :: taken = 0   !! items taken, if there is one rank alone
      type(MPI_Win) :: window      !! the same on the root, for several ranks
   contains
      procedure :: next
      procedure :: close => close_counter
   end type work_counter

contains

   !> Makes a counter; collective.
   subroutine new_counter(world, n_items, counter)
      type(world_type), intent(in) :: world
      integer, intent(in) :: n_items
      type(work_counter), intent(out) :: counter
      integer(MPI_ADDRESS_KIND) :: bytes
      type(c_ptr) :: memory
      integer(long), pointer :: taken

      counter%world = world
      counter%n_items = n_items
      if (world%n_ranks == 1) return
      bytes = merge(word_bytes, 0, world%is_root())
      call MPI_Win_allocate(bytes, word_bytes, MPI_INFO_NULL, world%comm, memory, counter%window)
      call MPI_Win_lock_all(MPI_MODE_NOCHECK, counter%window)
      if (world%is_root()) then
         call c_f_pointer(memory, taken)
         taken = 0
         call MPI_Win_sync(counter%window)
      end if
      call world%wait_for_all()
   end subroutine new_counter

   !> Next item for this rank; 0 if none is left.
   integer function next(self, stops) result(item)
      class(work_counter), intent(inout) :: self
      logical, intent(in) :: stops   !! no rank gets an item any more
      integer(long) :: before

      if (self%world%n_ranks == 1) then
         before = self%taken
         self%taken = merge(int(self%n_items, long), before + 1, stops)
      else if (stops) then
         before = exchange(self, int(self%n_items, long), MPI_REPLACE)
      else
         before = exchange(self, 1_long, MPI_SUM)
      end if
      item = 0
      if (before < self%n_items .and. .not. stops) item = int(before) + 1
   end function next

   !> Frees the counter; collective.
   subroutine close_counter(self)
      class(work_counter), intent(inout) :: self

      self%n_items = 0
      if (self%world%n_ranks == 1) return
      call MPI_Win_unlock_all(self%window)
      call MPI_Win_free(self%window)
   end subroutine close_counter

   !> Value of the root's counter before an operation that replaces it by a value or adds the value.
   function exchange(self, value, operation) result(before)
      class(work_counter), intent(inout) :: self
      integer(long), intent(in) :: value
      type(MPI_Op), intent(in) :: operation
      integer(long), asynchronous :: before, sent

      sent = value
      call MPI_Fetch_and_op(sent, before, MPI_INTEGER8, 0, 0_MPI_ADDRESS_KIND, operation, &
                            self%window)
      call MPI_Win_flush(0, self%window)
   end function exchange

end module parallel_work
