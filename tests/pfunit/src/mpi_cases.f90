!> Tests that run on a communicator of the number of processes they ask for.
module pfunit_cases
   use funit_cases, only: AbstractTestParameter, TestCase
   use funit_exceptions, only: throw
   use funit_suite, only: TestSuite
   use mpi_f08, only: MPI_Comm, MPI_Comm_free, MPI_Comm_split, MPI_COMM_WORLD, MPI_UNDEFINED
   use pfunit_context, only: MpiContext
   implicit none(type, external)
   private
   public :: add_for_each, MpiTestCase, MpiTestMethod, MpiTestParameter

   type, extends(AbstractTestParameter) :: MpiTestParameter
      integer :: npes = 1
   contains
      procedure :: toString
   end type MpiTestParameter

   type, abstract, extends(TestCase) :: MpiTestCase
      type(MpiContext), allocatable :: context   !! while the test runs
      type(MpiTestParameter) :: requested
   contains
      procedure :: run
      procedure :: getMpiCommunicator
      procedure :: getNumProcesses
      procedure :: getProcessRank
      procedure :: getNumProcessesRequested
   end type MpiTestCase

   !> A procedure that takes the test itself, with the file's set-up and tear-down.
   type, extends(MpiTestCase) :: MpiTestMethod
      procedure(mpi_method), nopass, pointer :: test => null()
      procedure(mpi_method), nopass, pointer :: before => null()
      procedure(mpi_method), nopass, pointer :: after => null()
   contains
      procedure :: setUp
      procedure :: tearDown
      procedure :: runMethod
   end type MpiTestMethod

   abstract interface
      subroutine mpi_method(this)
         import :: MpiTestMethod
         implicit none(type, external)
         class(MpiTestMethod), intent(inout) :: this
      end subroutine mpi_method
   end interface

contains

   !> The test once for each number of processes.
   subroutine add_for_each(suite, name, test, npes)
      type(TestSuite), intent(inout) :: suite
      character(*), intent(in) :: name
      class(MpiTestCase), intent(in) :: test
      integer, intent(in) :: npes(:)
      class(MpiTestCase), allocatable :: one
      integer :: i

      allocate (one, source=test)
      do i = 1, size(npes)
         one%requested = MpiTestParameter(npes(i))
         call suite%add(name//'['//one%requested%toString()//']', one)
      end do
   end subroutine add_for_each

   !> All processes come here; those beyond the number asked for have nothing to do.
   subroutine run(this, is_root)
      class(MpiTestCase), intent(inout) :: this
      logical, intent(in) :: is_root
      type(MpiContext) :: world
      type(MPI_Comm) :: comm
      integer :: colour

      world = MpiContext(MPI_COMM_WORLD)
      if (this%requested%npes > world%getNumProcesses()) then
         if (is_root) call throw('Insufficient processes to run this test.')
         return
      end if
      colour = merge(0, MPI_UNDEFINED, world%processRank() < this%requested%npes)
      call MPI_Comm_split(world%comm, colour, world%processRank(), comm)
      if (colour == MPI_UNDEFINED) return
      this%context = MpiContext(comm)
      call this%run_bare()
      call this%context%gather_exceptions()
      call MPI_Comm_free(comm)
   end subroutine run

   type(MPI_Comm) function getMpiCommunicator(this) result(comm)
      class(MpiTestCase), intent(in) :: this

      comm = this%context%comm
   end function getMpiCommunicator

   integer function getNumProcesses(this) result(n)
      class(MpiTestCase), intent(in) :: this

      n = this%context%getNumProcesses()
   end function getNumProcesses

   !> Counted from 0.
   integer function getProcessRank(this) result(rank)
      class(MpiTestCase), intent(in) :: this

      rank = this%context%processRank()
   end function getProcessRank

   integer function getNumProcessesRequested(this) result(n)
      class(MpiTestCase), intent(in) :: this

      n = this%requested%npes
   end function getNumProcessesRequested

   function toString(this) result(string)
      class(MpiTestParameter), intent(in) :: this
      character(:), allocatable :: string
      character(16) :: buffer

      write (buffer, '("npes=",i0)') this%npes
      string = trim(buffer)
   end function toString

   subroutine setUp(this)
      class(MpiTestMethod), intent(inout) :: this

      if (associated(this%before)) call this%before(this)
   end subroutine setUp

   subroutine tearDown(this)
      class(MpiTestMethod), intent(inout) :: this

      if (associated(this%after)) call this%after(this)
   end subroutine tearDown

   subroutine runMethod(this)
      class(MpiTestMethod), intent(inout) :: this

      call this%test(this)
   end subroutine runMethod

end module pfunit_cases
