!> The list of tests of one executable: gathered by the generated code, then run and reported.
module funit_suite
   use, intrinsic :: iso_fortran_env, only: output_unit
   use funit_cases, only: TestCase
   use funit_exceptions, only: exception_type, take_exceptions
   implicit none(type, external)
   private
   public :: TestSuite

   type :: entry_type
      character(:), allocatable :: name              !! file.test[parameters]
      class(TestCase), allocatable :: test           !! unallocated: disabled
   end type entry_type

   type :: TestSuite
      private
      type(entry_type), allocatable :: entries(:)
      integer :: n_entries = 0
   contains
      procedure :: add
      procedure :: run
   end type TestSuite

contains

   !> Without a test, the name is that of a disabled one.
   subroutine add(this, name, test)
      class(TestSuite), intent(inout) :: this
      character(*), intent(in) :: name
      class(TestCase), intent(in), optional :: test

      call make_room(this)
      this%n_entries = this%n_entries + 1
      associate (new => this%entries(this%n_entries))
         new%name = name
         if (present(test)) allocate (new%test, source=test)
      end associate
   end subroutine add

   !> Run the tests whose name contains `filter`; only the root prints. Unit of n_failed: tests.
   subroutine run(this, is_root, verbose, filter, n_failed)
      class(TestSuite), intent(inout) :: this
      logical, intent(in) :: is_root, verbose
      character(*), intent(in) :: filter
      integer, intent(out) :: n_failed
      type(exception_type), allocatable :: exceptions(:)
      integer :: i, n_run, n_disabled

      n_failed = 0
      n_run = 0
      n_disabled = 0
      do i = 1, this%n_entries
         associate (entry => this%entries(i))
            if (index(entry%name, filter) == 0) cycle
            if (.not. allocated(entry%test)) then
               n_disabled = n_disabled + 1
               if (is_root .and. verbose) print '(2a)', 'Disabled: ', entry%name
               cycle
            end if
            if (is_root .and. verbose) print '(2a)', 'Start: ', entry%name
            flush (output_unit)   ! should the test crash, its name stands last
            call entry%test%run(is_root)
            call take_exceptions(exceptions)
            n_run = n_run + 1
            if (size(exceptions) == 0) cycle
            n_failed = n_failed + 1
            if (is_root) call report_failure(entry%name, exceptions)
         end associate
      end do
      if (is_root) call report_counts(n_run, n_failed, n_disabled)
   end subroutine run

   subroutine make_room(this)
      class(TestSuite), intent(inout) :: this
      type(entry_type), allocatable :: more(:)
      integer :: i

      if (.not. allocated(this%entries)) allocate (this%entries(16))
      if (this%n_entries < size(this%entries)) return
      allocate (more(2*this%n_entries))
      do i = 1, this%n_entries
         call move_alloc(this%entries(i)%name, more(i)%name)
         call move_alloc(this%entries(i)%test, more(i)%test)
      end do
      call move_alloc(more, this%entries)
   end subroutine make_room

   subroutine report_failure(name, exceptions)
      character(*), intent(in) :: name
      type(exception_type), intent(in) :: exceptions(:)
      integer :: i

      print '(/,2a)', 'Failure in: ', name
      do i = 1, size(exceptions)
         associate (location => exceptions(i)%location)
            if (location%line > 0) print '(3a,i0,a)', '  [', location%file, ':', location%line, ']'
         end associate
         print '(2a)', '  ', exceptions(i)%message
      end do
      print '()'
   end subroutine report_failure

   subroutine report_counts(n_run, n_failed, n_disabled)
      integer, intent(in) :: n_run, n_failed, n_disabled

      if (n_failed > 0) then
         print '(a,i0,a,i0,a)', 'Tests run: ', n_run, ', Failures: ', n_failed, ', Errors: 0'
         print '(a)', 'Encountered 1 or more failures/errors during testing'
      else if (n_disabled > 0) then
         print '(a,/,a,i0,a,i0,a)', ' OK', ' (', n_run, ' tests, ', n_disabled, ' disabled)'
      else
         print '(a,/,a,i0,a)', ' OK', ' (', n_run, ' tests)'
      end if
      flush (output_unit)
   end subroutine report_counts

end module funit_suite
