!> The processes that take part in an MPI test.
module pfunit_context
   use funit_context, only: ParallelContext
   use funit_exceptions, only: exception_type, SourceLocation, take_exceptions, throw
   use mpi_f08, only: MPI_Allreduce, MPI_Barrier, MPI_CHARACTER, MPI_Comm, MPI_Comm_rank, &
      MPI_Comm_size, MPI_INTEGER, MPI_LOGICAL, MPI_LOR, MPI_Recv, MPI_Send, MPI_STATUS_IGNORE
   implicit none(type, external)
   private
   public :: MpiContext

   type, extends(ParallelContext) :: MpiContext
      type(MPI_Comm) :: comm
   contains
      procedure :: getMpiCommunicator
      procedure :: getNumProcesses
      procedure :: processRank
      procedure :: isRootProcess
      procedure :: barrier
      procedure :: any_of
      procedure :: gather_exceptions
   end type MpiContext

contains

   type(MPI_Comm) function getMpiCommunicator(this) result(comm)
      class(MpiContext), intent(in) :: this

      comm = this%comm
   end function getMpiCommunicator

   integer function getNumProcesses(this) result(n)
      class(MpiContext), intent(in) :: this

      call MPI_Comm_size(this%comm, n)
   end function getNumProcesses

   !> Counted from 0.
   integer function processRank(this) result(rank)
      class(MpiContext), intent(in) :: this

      call MPI_Comm_rank(this%comm, rank)
   end function processRank

   logical function isRootProcess(this)
      class(MpiContext), intent(in) :: this

      isRootProcess = this%processRank() == 0
   end function isRootProcess

   subroutine barrier(this)
      class(MpiContext), intent(in) :: this

      call MPI_Barrier(this%comm)
   end subroutine barrier

   logical function any_of(this, mine)
      class(MpiContext), intent(in) :: this
      logical, intent(in) :: mine

      call MPI_Allreduce(mine, any_of, 1, MPI_LOGICAL, MPI_LOR, this%comm)
   end function any_of

   !> Collective: afterwards the root alone has the exceptions of all, each with its rank.
   subroutine gather_exceptions(this)
      class(MpiContext), intent(in) :: this
      type(exception_type), allocatable :: mine(:)
      integer :: i, n, rank

      call take_exceptions(mine)
      if (this%isRootProcess()) then
         do i = 1, size(mine)
            call throw(mine(i)%message//' (PE=0)', mine(i)%location)
         end do
         do rank = 1, this%getNumProcesses() - 1
            call MPI_Recv(n, 1, MPI_INTEGER, rank, 0, this%comm, MPI_STATUS_IGNORE)
            do i = 1, n
               call receive_exception(this%comm, rank)
            end do
         end do
      else
         call MPI_Send(size(mine), 1, MPI_INTEGER, 0, 0, this%comm)
         do i = 1, size(mine)
            call send_exception(this%comm, mine(i))
         end do
      end if
   end subroutine gather_exceptions

   subroutine send_exception(comm, exception)
      type(MPI_Comm), intent(in) :: comm
      type(exception_type), intent(in) :: exception
      character(:), allocatable :: file
      integer :: header(3)

      file = ''
      if (allocated(exception%location%file)) file = exception%location%file
      header = [len(exception%message), len(file), exception%location%line]
      call MPI_Send(header, 3, MPI_INTEGER, 0, 0, comm)
      call MPI_Send(exception%message//file, sum(header(:2)), MPI_CHARACTER, 0, 0, comm)
   end subroutine send_exception

   subroutine receive_exception(comm, rank)
      type(MPI_Comm), intent(in) :: comm
      integer, intent(in) :: rank
      character(:), allocatable :: text
      character(12) :: suffix
      integer :: header(3)

      call MPI_Recv(header, 3, MPI_INTEGER, rank, 0, comm, MPI_STATUS_IGNORE)
      allocate (character(sum(header(:2))) :: text)
      call MPI_Recv(text, len(text), MPI_CHARACTER, rank, 0, comm, MPI_STATUS_IGNORE)
      write (suffix, '(" (PE=",i0,")")') rank
      call throw(text(:header(1))//trim(suffix), &
         SourceLocation(text(header(1) + 1:), header(3)))
   end subroutine receive_exception

end module pfunit_context
