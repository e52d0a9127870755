!> The frame of an MPI test executable.
module pfunit_main
   use funit_main, only: run_suite, stop_on_failures
   use funit_suite, only: TestSuite
   use mpi_f08, only: MPI_Bcast, MPI_Comm_rank, MPI_COMM_WORLD, MPI_Finalize, MPI_Init, MPI_INTEGER
   implicit none(type, external)
   private
   public :: begin_tests, end_tests

contains

   subroutine begin_tests()
      call MPI_Init()
   end subroutine begin_tests

   !> Every process ends with the exit status of the root.
   subroutine end_tests(suite)
      type(TestSuite), intent(inout) :: suite
      integer :: n_failed, rank

      call MPI_Comm_rank(MPI_COMM_WORLD, rank)
      call run_suite(suite, rank == 0, n_failed)
      call MPI_Bcast(n_failed, 1, MPI_INTEGER, 0, MPI_COMM_WORLD)
      call MPI_Finalize()
      call stop_on_failures(n_failed)
   end subroutine end_tests

end module pfunit_main
