"""Write what a .pf file does not say itself: the module that gathers its tests, the main program."""

from reading import Method, Reader

GATHERING = """\
!> Gathers the tests of {file}.
module {name}_gathering
   use funit_cases, only: TestMethod
   use funit_suite, only: TestSuite
{uses}   implicit none
   private
   public :: {name}_suite
{declarations}
contains

   subroutine {name}_suite(suite)
      type(TestSuite), intent(inout) :: suite

{registrations}
   end subroutine {name}_suite
{procedures}
end module {name}_gathering
"""

EXTERNAL_TEST = """
   interface
      subroutine {test}
      end subroutine
   end interface
"""
EXTERNAL_MPI_TEST = """
   interface
      subroutine {test}(this)
         import :: MpiTestMethod
         class(MpiTestMethod), intent(inout) :: this
      end subroutine
   end interface
"""

CASE_TYPE = """
   type, extends({case}) :: pf_case
      procedure(pf_method), nopass, pointer :: method => null()
   contains
      procedure :: runMethod => pf_run_method
   end type pf_case

   abstract interface
      subroutine pf_method(this)
         import :: {case}
         class({case}), intent(inout) :: this
      end subroutine pf_method
   end interface
"""
CASE_RUN = """
   subroutine pf_run_method(this)
      class(pf_case), intent(inout) :: this

      call this%method(this)
   end subroutine pf_run_method
"""
CASE_NEW = """
   function pf_new(method) result(test)
      procedure(pf_method) :: method
      type(pf_case) :: test

{construct}      test%method => method
   end function pf_new
"""
CASE_ADD_EACH = """
   subroutine pf_add_each(suite, name, method, parameters)
      type(TestSuite), intent(inout) :: suite
      character(*), intent(in) :: name
      procedure(pf_method) :: method
      type({parameter}), intent(in) :: parameters(:)
      type(pf_case) :: test
      integer :: i

      test%method => method
      do i = 1, size(parameters)
         test%{case} = {constructor}(parameters(i))
         call suite%add(name//'['//parameters(i)%toString()//']', test)
      end do
   end subroutine pf_add_each
"""

DRIVER = """\
!> Runs the tests of {files}.
program {program}
   use funit_suite, only: TestSuite
   use {library}, only: begin_tests, end_tests
{uses}
   implicit none(type, external)
   type(TestSuite) :: suite

   call begin_tests()
{calls}
   call end_tests(suite)
end program {program}
"""


def registration(source: Reader, test: Method) -> str:
    """The call that adds one test to the suite."""
    name = f"'{source.name}.{test.name}'"
    methods = ", ".join(
        [f"test={test.name}", *(f"{when}={method.name}" for when, method in source.around.items())]
    )
    if test.disabled:
        call = f"suite%add({name})"
    elif test.parameters:
        call = f"pf_add_each(suite, {name}, {test.name}, {test.parameters})"
    elif test.npes:
        new = f"pf_new({test.name})" if source.case else f"MpiTestMethod({methods})"
        call = f"add_for_each(suite, {name}, {new}, {test.npes})"
    elif source.case:
        call = f"suite%add({name}, pf_new({test.name}))"
    else:
        call = f"suite%add({name}, TestMethod({methods}))"
    call = f"      call {call}"
    return "\n".join([test.guard, call, "#endif"]) if test.guard else call


def gathering(source: Reader) -> str:
    """The module that gathers the tests of one file."""
    uses, declarations, procedures = "", "", ""
    if source.is_mpi:
        uses += "   use pfunit_cases, only: add_for_each, MpiTestMethod\n"
    if source.has_module:
        uses += f"   use {source.name}\n"
    else:
        external = EXTERNAL_MPI_TEST if source.is_mpi else EXTERNAL_TEST
        tests = [*source.tests, *source.around.values()]
        declarations = "".join(external.format(test=test.name) for test in tests)
    case = source.case
    if case:
        fields = {"case": case.name, "constructor": case.constructor, "parameter": source.parameter}
        declarations = CASE_TYPE.format(**fields)
        procedures = CASE_RUN
        if case.parent == "parameterizedtestcase":
            procedures += CASE_ADD_EACH.format(**fields)
        else:
            construct = f"      test%{case.name} = {case.constructor}()\n" if case.constructor else ""
            procedures += CASE_NEW.format(construct=construct)
    return GATHERING.format(
        file=source.path.name,
        name=source.name,
        uses=uses,
        declarations=declarations,
        registrations="\n".join(registration(source, test) for test in source.tests),
        procedures=procedures,
    )


def driver(program: str, names: list[str], is_mpi: bool) -> str:
    """The main program that runs the suites of some files."""
    return DRIVER.format(
        files=", ".join(f"{name}.pf" for name in names),
        program=program,
        library="pfunit_main" if is_mpi else "funit_main",
        uses="\n".join(f"   use {name}_gathering, only: {name}_suite" for name in names),
        calls="\n".join(f"   call {name}_suite(suite)" for name in names),
    )
