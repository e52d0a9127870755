"""Checks of a .pf file that has been read: tests and fixtures must fit each other."""

from reading import Case, Method, Source


def check(source: Source) -> None:
    """Add what does not fit to the complaints of the file; hand the case's options to its tests."""
    if not source.tests:
        source.complain(len(source.lines), "there is no @test in this file")
    if source.case:
        check_case(source, source.case)
        for test in source.tests:
            test.npes = test.npes or source.case.npes
            test.parameters = test.parameters or source.case.parameters
    for test in source.tests:
        check_test(source, test)
    for directive, method in source.around.items():
        check_around(source, directive, method)


def check_case(source: Source, case: Case) -> None:
    """Complain unless the fixture type is one of the three kinds, with all its kind needs."""
    parents = {"testcase", "parameterizedtestcase", "mpitestcase"}
    is_mpi = case.parent == "mpitestcase"
    is_parameterized = case.parent == "parameterizedtestcase"
    broken = {
        "must stand in a module": not source.has_module,
        "must extend TestCase, ParameterizedTestCase or MpiTestCase": case.parent not in parents,
        "an MpiTestCase takes no constructor": is_mpi and case.constructor,
        "a ParameterizedTestCase needs a constructor": is_parameterized and not case.constructor,
        "a ParameterizedTestCase needs a @testParameter": is_parameterized and not source.parameter,
    }
    complain(source, case.line, f"@testCase {case.name}", broken)


def check_test(source: Source, test: Method) -> None:
    """Complain unless the test fits the fixture or is a plain one."""
    parent = source.case.parent if source.case else ""
    is_mpi = parent == "mpitestcase"
    is_parameterized = parent == "parameterizedtestcase"
    gets_this = source.case or test.npes
    broken = {
        "must take (this)": gets_this and not test.takes_this,
        "must take no arguments": test.takes_this and not gets_this,
        "npes needs an MpiTestCase": test.npes and source.case and not is_mpi,
        "needs npes, its own or of @testCase": is_mpi and not test.npes,
        "testParameters need a ParameterizedTestCase": test.parameters and not is_parameterized,
        "needs testParameters, its own or of @testCase": is_parameterized and not test.parameters,
    }
    complain(source, test.line, f"@test {test.name}", broken)


def check_around(source: Source, directive: str, method: Method) -> None:
    """Complain unless @before or @after fits every test of the file."""
    is_mixed = source.is_mpi and any(not test.npes for test in source.tests)
    broken = {
        "a @testCase has setUp and tearDown instead": source.case,
        "cannot serve serial and MPI tests in one file": is_mixed,
        "must take (this), as the MPI tests do": source.is_mpi and not method.takes_this,
        "must take no arguments": method.takes_this and not source.is_mpi,
        "MPI tests need both @before and @after": source.is_mpi and len(source.around) == 1,
    }
    complain(source, method.line, f"@{directive} {method.name}", broken)


def complain(source: Source, line: int, what: str, broken: dict[str, object]) -> None:
    """Note the rules that are broken, by their text."""
    for rule, is_broken in broken.items():
        if is_broken:
            source.complain(line, f"{what}: {rule}")
