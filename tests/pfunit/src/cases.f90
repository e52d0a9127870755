!> What can be run as a test: a plain procedure, or a fixture type of the user's own.
module funit_cases
   use funit_exceptions, only: anyExceptions, throw
   implicit none(type, external)
   private
   public :: AbstractTestParameter, ParameterizedTestCase, TestCase, TestMethod

   !> A fixture overrides what it needs; the generated wrapper overrides runMethod.
   type, abstract :: TestCase
   contains
      procedure :: setUp => do_nothing
      procedure :: tearDown => do_nothing
      procedure :: runMethod => no_method
      procedure :: run_bare
      procedure :: run
   end type TestCase

   type, abstract, extends(TestCase) :: ParameterizedTestCase
   end type ParameterizedTestCase

   type, abstract :: AbstractTestParameter
   contains
      procedure(parameter_text), deferred :: toString
   end type AbstractTestParameter

   !> A procedure without arguments, with the file's set-up and tear-down.
   type, extends(TestCase) :: TestMethod
      procedure(plain_method), nopass, pointer :: test => null()
      procedure(plain_method), nopass, pointer :: before => null()
      procedure(plain_method), nopass, pointer :: after => null()
   contains
      procedure :: setUp => call_before
      procedure :: tearDown => call_after
      procedure :: runMethod => call_test
   end type TestMethod

   abstract interface
      function parameter_text(this) result(string)
         import :: AbstractTestParameter
         implicit none(type, external)
         class(AbstractTestParameter), intent(in) :: this
         character(:), allocatable :: string
      end function parameter_text

      subroutine plain_method()
      end subroutine plain_method
   end interface

contains

   !> One process runs a serial test; the others of an MPI executable wait at the next MPI test.
   subroutine run(this, is_root)
      class(TestCase), intent(inout) :: this
      logical, intent(in) :: is_root

      if (is_root) call this%run_bare()
   end subroutine run

   !> The tear-down is owed once the set-up has succeeded, also to a test that failed.
   subroutine run_bare(this)
      class(TestCase), intent(inout) :: this

      call this%setUp()
      if (anyExceptions()) return
      call this%runMethod()
      call this%tearDown()
   end subroutine run_bare

   subroutine do_nothing(this)
      class(TestCase), intent(inout) :: this

      associate (unused => this)
      end associate
   end subroutine do_nothing

   subroutine no_method(this)
      class(TestCase), intent(inout) :: this

      associate (unused => this)
      end associate
      call throw('runMethod is not overridden: nothing was tested')
   end subroutine no_method

   subroutine call_before(this)
      class(TestMethod), intent(inout) :: this

      if (associated(this%before)) call this%before()
   end subroutine call_before

   subroutine call_after(this)
      class(TestMethod), intent(inout) :: this

      if (associated(this%after)) call this%after()
   end subroutine call_after

   subroutine call_test(this)
      class(TestMethod), intent(inout) :: this

      call this%test()
   end subroutine call_test

end module funit_cases
