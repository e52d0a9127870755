!> One array in memory for all ranks of a node: a force record is long, and the same for everybody.
module parallel_shared
   use, intrinsic :: iso_c_binding, only: c_f_pointer, c_ptr
   use core_kinds, only: wp
   use mpi_f08, only: MPI_ADDRESS_KIND, MPI_Comm, MPI_Comm_free, MPI_Comm_rank, &
                      MPI_Comm_split_type, MPI_COMM_TYPE_SHARED, MPI_INFO_NULL, MPI_Win, &
                      MPI_Win_allocate_shared, MPI_Win_fence, MPI_Win_free, MPI_Win_shared_query
   use parallel_world, only: world_type
   implicit none(type, external)
   private
   public :: shared_array, new_shared_array

   integer, parameter :: word_bytes = 8

   !> The owner of each node fills `values`, all call `publish`, and from then on everybody may read
   !> them.
   type :: shared_array
      real(wp), pointer, contiguous :: values(:, :) => null()
      logical :: is_owner = .false.
      logical, private :: has_window = .false.
      type(MPI_Comm), private :: node
      type(MPI_Win), private :: window
   contains
      procedure :: publish
      procedure :: free
   end type shared_array

contains

   !> Collective.
   subroutine new_shared_array(world, extent, array)
      type(world_type), intent(in) :: world
      integer, intent(in) :: extent(2)
      type(shared_array), intent(out) :: array
      integer(MPI_ADDRESS_KIND) :: bytes
      type(c_ptr) :: memory
      integer :: node_rank, unit_bytes

      if (world%n_ranks == 1) then
         allocate (array%values(extent(1), extent(2)))
         array%is_owner = .true.
         return
      end if
      call MPI_Comm_split_type(world%comm, MPI_COMM_TYPE_SHARED, world%rank, MPI_INFO_NULL, &
                               array%node)
      call MPI_Comm_rank(array%node, node_rank)
      array%is_owner = node_rank == 0
      array%has_window = .true.
      bytes = 0
      if (array%is_owner) bytes = product(int(extent, MPI_ADDRESS_KIND))*word_bytes
      call MPI_Win_allocate_shared(bytes, word_bytes, MPI_INFO_NULL, array%node, memory, &
                                   array%window)
      call MPI_Win_shared_query(array%window, 0, bytes, unit_bytes, memory)
      call c_f_pointer(memory, array%values, extent)
      call MPI_Win_fence(0, array%window)
   end subroutine new_shared_array

   !> What the owners have written becomes visible to all; collective.
   subroutine publish(self)
      class(shared_array), intent(in) :: self

      if (self%has_window) call MPI_Win_fence(0, self%window)
   end subroutine publish

   !> Collective.
   subroutine free(self)
      class(shared_array), intent(inout) :: self

      if (self%has_window) then
         call MPI_Win_free(self%window)
         call MPI_Comm_free(self%node)
         self%has_window = .false.
      else if (associated(self%values)) then
         deallocate (self%values)
      end if
      self%values => null()
   end subroutine free

end module parallel_shared
