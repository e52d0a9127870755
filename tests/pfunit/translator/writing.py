"""Write what a .pf file does not say: the module that gathers its tests, and the main program."""

from pathlib import Path

from reading import Method, Source

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

EXTERNAL_METHOD = """
   interface
      subroutine {name}()
      end subroutine {name}
   end interface
"""
EXTERNAL_MPI_METHOD = """
   interface
      subroutine {name}(this)
         import :: MpiTestMethod
         class(MpiTestMethod), intent(inout) :: this
      end subroutine {name}
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
CASE_CONSTRUCT = """\
      test%{case} = {constructor}()
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


def registration(source: Source, test: Method) -> str:
    """The call that adds one test to the suite."""
    name = f"'{source.name}.{test.name}'"
    methods = {"test": test.name} | {when: method.name for when, method in source.around.items()}
    components = ", ".join(f"{component}={method}" for component, method in methods.items())
    if test.disabled:
        call = f"suite%add({name})"
    elif test.parameters:
        call = f"pf_add_each(suite, {name}, {test.name}, {test.parameters})"
    elif test.npes:
        new = f"pf_new({test.name})" if source.case else f"MpiTestMethod({components})"
        call = f"add_for_each(suite, {name}, {new}, {test.npes})"
    elif source.case:
        call = f"suite%add({name}, pf_new({test.name}))"
    else:
        call = f"suite%add({name}, TestMethod({components}))"
    line = f"      call {call}"
    return "\n".join([test.guard, line, "#endif"]) if test.guard else line


def gathering(source: Source) -> str:
    """The module that gathers the tests of one file."""
    uses, declarations, procedures = "", "", ""
    if source.is_mpi:
        uses += "   use pfunit_cases, only: add_for_each, MpiTestMethod\n"
    if source.has_module:
        uses += f"   use {source.name}\n"
    else:
        declarations = "".join(
            (EXTERNAL_MPI_METHOD if method.takes_this else EXTERNAL_METHOD).format(name=method.name)
            for method in [*source.tests, *source.around.values()]
        )
    case = source.case
    if case:
        names = {"case": case.name, "constructor": case.constructor, "parameter": source.parameter}
        declarations += CASE_TYPE.format(**names)
        procedures += CASE_RUN
        if case.parent == "parameterizedtestcase":
            procedures += CASE_ADD_EACH.format(**names)
        else:
            construct = CASE_CONSTRUCT.format(**names) if case.constructor else ""
            procedures += CASE_NEW.format(construct=construct)
    return GATHERING.format(
        file=source.path.name,
        name=source.name,
        uses=uses,
        declarations=declarations,
        registrations="\n".join(registration(source, test) for test in source.tests),
        procedures=procedures,
    )


def translation(source: Source, output: Path) -> str:
    """A whole file in Fortran; compiler messages name the .pf file and its lines."""
    head = [f'#line 1 "{source.path}"', *source.lines]
    return "\n".join([*head, f'#line {len(head) + 2} "{output}"', gathering(source)])


def driver(program: str, names: list[str], is_mpi: bool) -> str:
    """The main program that runs the suites of some files."""
    return DRIVER.format(
        files=", ".join(f"{name}.pf" for name in names),
        program=program,
        library="pfunit_main" if is_mpi else "funit_main",
        uses="\n".join(f"   use {name}_gathering, only: {name}_suite" for name in names),
        calls="\n".join(f"   call {name}_suite(suite)" for name in names),
    )
