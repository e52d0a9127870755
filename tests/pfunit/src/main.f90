!> The command line of a test executable, and its end.
module funit_main
   use funit_suite, only: TestSuite
   implicit none(type, external)
   private
   public :: begin_tests, end_tests, run_suite, stop_on_failures

contains

   !> Nothing is to be begun for one process; the MPI runner has a procedure of this name.
   subroutine begin_tests()
   end subroutine begin_tests

   subroutine end_tests(suite)
      type(TestSuite), intent(inout) :: suite
      integer :: n_failed

      call run_suite(suite, .true., n_failed)
      call stop_on_failures(n_failed)
   end subroutine end_tests

   !> Options: `-v`/`--verbose` names each test before it starts, `-f text` takes only tests whose
   !! name contains the text.
   subroutine run_suite(suite, is_root, n_failed)
      class(TestSuite), intent(inout) :: suite
      logical, intent(in) :: is_root
      integer, intent(out) :: n_failed
      character(:), allocatable :: filter
      logical :: verbose
      integer :: i

      verbose = .false.
      filter = ''
      i = 0
      do while (i < command_argument_count())
         i = i + 1
         select case (argument(i))
         case ('-v', '--verbose')
            verbose = .true.
         case ('-f', '--filter')
            i = i + 1
            filter = argument(i)
         case default
            error stop 'usage: [-v|--verbose] [-f|--filter text]'
         end select
      end do
      call suite%run(is_root, verbose, filter, n_failed)
   end subroutine run_suite

   subroutine stop_on_failures(n_failed)
      integer, intent(in) :: n_failed

      if (n_failed > 0) stop 2
   end subroutine stop_on_failures

   function argument(i) result(text)
      integer, intent(in) :: i
      character(:), allocatable :: text
      integer :: length

      call get_command_argument(i, length=length)
      allocate (character(length) :: text)
      call get_command_argument(i, text)
   end function argument

end module funit_main
