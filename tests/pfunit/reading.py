"""Read a .pf file: its directives become Fortran, line for line, and its tests become a list.

What the dialect does not know is refused with the number of the line where it stands.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

# assertion: operands needed, arguments that may be passed by position
ASSERTIONS = {
    "assertequal": (2, 4),
    "assertnotequal": (2, 3),
    "assertequivalent": (2, 2),
    "assertlessthan": (2, 2),
    "assertlessthanorequal": (2, 2),
    "assertgreaterthan": (2, 2),
    "assertgreaterthanorequal": (2, 2),
    "assertrelativelyequal": (3, 3),
    "asserttrue": (1, 2),
    "assertfalse": (1, 2),
    "assertany": (1, 2),
    "assertall": (1, 2),
    "assertnone": (1, 2),
    "assertnotall": (1, 2),
    "assertisnan": (1, 2),
    "assertisfinite": (1, 2),
    "assertexceptionraised": (0, 1),
    "assertfail": (1, 1),
    "assertsameshape": (2, 3),
}
# other directive: its options
OPTIONS = {
    "test": {"npes", "ifdef", "ifndef", "testparameters"},
    "mpitest": {"npes", "ifdef", "ifndef", "testparameters"},
    "before": set(),
    "after": set(),
    "disable": set(),
    "testcase": {"constructor", "npes", "testparameters"},
    "testparameter": {"constructor"},
}
GUARDS = ("ifdef", "ifndef")

BLANK = re.compile(r"\s*(!.*)?$")
DIRECTIVE = re.compile(r"(\s*)@(\w*)\s*(.*?)\s*$")
MODULE = re.compile(r"\s*module\s+(?!procedure\b)(\w+)(.*)", re.I)
SUBROUTINE = re.compile(r"\s*subroutine\s+(\w+)\s*(?:\(\s*(\w*)\s*\))?\s*(?:!.*)?$", re.I)
TYPE = re.compile(r"\s*type\s*,\s*extends\s*\(\s*(\w+)\s*\)\s*::\s*(\w+)\s*(?:!.*)?$", re.I)
BY_NAME = re.compile(r"(\w+)\s*=(?!=)\s*(.*)")
COUNTS = re.compile(r"\[\s*[1-9]\d*(\s*,\s*[1-9]\d*)*\s*\]")


class Refused(Exception):
    """What is wrong with the line at hand."""


@dataclass
class Method:
    """A subroutine under @test, @before or @after."""

    name: str
    line: int
    takes_this: bool
    npes: list[int] = field(default_factory=list)
    parameters: str = ""  # expression
    guard: str = ""  # cpp line under which the test is registered
    disabled: bool = False


@dataclass
class Case:
    """The type under @testCase."""

    name: str
    line: int
    parent: str  # lower case
    constructor: str
    npes: list[int]
    parameters: str


def scan(text, quote=""):
    """Code outside of strings as (position, character, depth of brackets), and the open quote."""
    code, depth = [], 0
    for position, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character == "!":
            break
        else:
            depth += (character in "([{") - (character in ")]}")
            code.append((position, character, depth))
    return code, quote


def split_arguments(text):
    """Arguments of a call, by its commas outside of brackets and strings."""
    commas = [at for at, character, depth in scan(text)[0] if character == "," and depth == 0]
    arguments = [
        text[start + 1 : end].strip() for start, end in zip([-1, *commas], [*commas, len(text)])
    ]
    if arguments == [""]:
        return []
    if "" in arguments:
        raise Refused("an argument is empty")
    return arguments


def read_arguments(name, text):
    """Arguments of a directive from what follows its name; None without parentheses."""
    if not text:
        return None
    if text[0] == "(":
        end = next((at for at, _, depth in scan(text)[0] if depth == 0), None)
        if end is None:
            raise Refused(f"@{name} must end on its line: a parenthesis or a quote is open")
        if end == len(text) - 1:
            return split_arguments(text[1:end])
    raise Refused(f"@{name} must stand alone on its line")


def read_options(name, arguments):
    """Options of a directive by lower-case keyword."""
    options = {}
    for argument in arguments or []:
        match = BY_NAME.fullmatch(argument)
        keyword = match[1].lower() if match else ""
        if keyword not in OPTIONS[name.lower()] or keyword in options:
            raise Refused(f"@{name} does not take `{argument}` here")
        options[keyword] = match[2]
    return options


def read_npes(options):
    """Numbers of processes; [] when not given."""
    text = options.get("npes", "")
    if text and not COUNTS.fullmatch(text):
        raise Refused(f"npes={text}: must be a list of literal positive integers like [1, 2]")
    return [int(n) for n in re.findall(r"\d+", text)]


def read_parameters(options):
    """Expression between the braces of testParameters; empty when not given."""
    text = options.get("testparameters")
    if text is None:
        return ""
    if not re.fullmatch(r"\{.*\S.*\}", text):
        raise Refused(f"testParameters={text}: must be an expression in braces")
    return text[1:-1].strip()


class Reader:
    """One .pf file, translated while it is read."""

    def __init__(self, path: Path):
        self.path = path
        self.has_module = False
        self.tests: list[Method] = []
        self.around: dict[str, Method] = {}  # under @before and @after
        self.case: Case | None = None
        self.parameter = ""  # the type under @testParameter
        self.lines: list[str] = []  # in Fortran
        self.complaints: list[str] = []
        self._waiting = ""  # the directive whose line is still to come
        self._options: dict[str, str] = {}
        self._disabled = False
        self._quote = ""  # of a string that goes on in the next line
        for line in path.read_text().splitlines():
            self.lines.append(line)
            try:
                self._read(line)
            except Refused as reason:
                self._complain(len(self.lines), reason)
        if self._waiting:
            self._complain(len(self.lines), f"@{self._waiting} is followed by nothing")
        self._check_around()
        if self.case:
            self._check_case(self.case)
        for test in self.tests:
            self._check_test(test)

    @property
    def name(self) -> str:
        """Of the file, its module and its suite."""
        return self.path.stem

    @property
    def is_mpi(self) -> bool:
        """Whether tests run on several processes."""
        return any(test.npes for test in self.tests)

    def _complain(self, number, reason):
        self.complaints.append(f"{self.path}:{number}: {reason}")

    def _read(self, line):
        match = None if self._quote else DIRECTIVE.match(line)
        if match:
            self.lines[-1] = f"!{line}"
            self._directive(*match.groups())
        elif self._waiting and not BLANK.match(line):
            name, self._waiting = self._waiting, ""
            self._govern(name, line)
        else:
            self._fortran(line)

    def _directive(self, indent, name, rest):
        lower = name.lower()
        if lower not in OPTIONS and lower.removeprefix("mpi") not in ASSERTIONS:
            raise Refused(f"unknown directive @{name}")
        arguments = read_arguments(name, rest)
        if lower == "disable":
            if self._waiting not in ("test", "mpitest") or arguments is not None:
                raise Refused("@disable must follow @test")
            self._disabled = True
        elif self._waiting:
            raise Refused(f"@{self._waiting} must be followed by the line it governs, not @{name}")
        elif lower in OPTIONS:
            self._options = read_options(name, arguments)
            self._waiting = lower
            self._disabled = False
        else:
            self._assertion(indent, name, arguments)

    def _assertion(self, indent, name, arguments):
        is_mpi = name.lower().startswith("mpi")  # the old spelling does not leave the test
        procedure = name[3:] if is_mpi else name
        operands, by_position = ASSERTIONS[procedure.lower()]
        if arguments is None or len(arguments) < operands:
            raise Refused(f"@{name} needs {operands} operands in parentheses")
        if sum(not BY_NAME.fullmatch(argument) for argument in arguments) > by_position:
            raise Refused(f"@{name} takes {by_position} arguments by position: name the rest")
        location = f"location=SourceLocation('{self.path.name}', {len(self.lines)})"
        call = f"{indent}call {procedure}({', '.join([*arguments, location])})"
        self.lines[-1] = call if is_mpi else f"{call}; if (anyExceptions()) return"

    def _govern(self, name, line):
        """The line after a directive that is not an assertion."""
        if name in ("testcase", "testparameter"):
            match, wanted = TYPE.match(line), "type, extends(parent) :: name"
        else:
            match, wanted = SUBROUTINE.match(line), "subroutine name` or `subroutine name(this)"
        if not match:
            raise Refused(f"@{name} must be followed by `{wanted}`")
        if name == "testcase":
            self._new_case(*match.groups())
        elif name == "testparameter":
            self._new_parameter(*match.groups())
        else:
            method = Method(match[1], len(self.lines), bool(match[2]))
            if name in ("before", "after"):
                self._new_around(name, method)
            else:
                self._new_test(method)

    def _new_case(self, parent, name):
        if self.case:
            raise Refused("a second @testCase in this file")
        self.case = Case(
            name,
            len(self.lines),
            parent.lower(),
            self._options.get("constructor", ""),
            read_npes(self._options),
            read_parameters(self._options),
        )

    def _new_parameter(self, parent, name):
        if self.parameter:
            raise Refused("a second @testParameter in this file")
        if parent.lower() != "abstracttestparameter":
            raise Refused(f"@testParameter {name}: must extend AbstractTestParameter")
        self.parameter = name

    def _new_around(self, name, method):
        if name in self.around:
            raise Refused(f"a second @{name} in this file")
        self.around[name] = method

    def _new_test(self, test):
        guards = [f"#{key} {self._options[key]}" for key in GUARDS if key in self._options]
        if len(guards) > 1:
            raise Refused("@test takes ifdef or ifndef, not both")
        test.guard = "".join(guards)
        test.npes = read_npes(self._options)
        test.parameters = read_parameters(self._options)
        test.disabled = self._disabled
        self.tests.append(test)

    def _fortran(self, line):
        """A line without directive: none may hide in it, and a module has its name by rule."""
        if line.startswith("#"):
            raise Refused("a line must not start with #")
        match = None if self._quote else MODULE.match(line)
        if match:
            self._new_module(*match.groups())
        code, quote = scan(line, self._quote)
        self._quote = quote if line.rstrip().endswith("&") else ""
        if any(character == "@" for _, character, _ in code):
            raise Refused("a directive must stand alone on its line")

    def _new_module(self, name, rest):
        if rest.strip():
            raise Refused("the module line must end after the name")
        if self.has_module:
            raise Refused("a second module in this file")
        if name.lower() != self.name.lower():
            raise Refused(f"module {name}: must have the name of its file, {self.name}")
        self.has_module = True

    def _check_around(self):
        """Whether @before and @after fit the tests, once all are known."""
        serial = any(not test.npes for test in self.tests)
        for name, method in self.around.items():
            if self.case:
                self._complain(method.line, f"@{name} beside @testCase: override setUp, tearDown")
            elif self.is_mpi and serial:
                self._complain(method.line, f"@{name} cannot serve serial and MPI tests in one file")
            elif method.takes_this != self.is_mpi:
                wanted = "(this)" if self.is_mpi else "no arguments"
                self._complain(method.line, f"@{name} subroutine {method.name}: must take {wanted}")
            elif self.is_mpi and len(self.around) == 1:
                self._complain(method.line, "MPI tests need both @before and @after, or neither")

    def _check_case(self, case):
        """Whether the fixture is of a known kind; its tests inherit its npes and parameters."""
        if not self.has_module:
            self._complain(case.line, "@testCase needs a module around it")
        if case.parent not in ("testcase", "parameterizedtestcase", "mpitestcase"):
            parents = "TestCase, ParameterizedTestCase or MpiTestCase"
            self._complain(case.line, f"@testCase {case.name}: must extend {parents}")
        if case.parent == "mpitestcase" and case.constructor:
            self._complain(case.line, f"@testCase {case.name}: an MPI case takes no constructor")
        if case.parent == "parameterizedtestcase" and not case.constructor:
            self._complain(case.line, f"@testCase {case.name}: needs constructor=")
        if case.parent == "parameterizedtestcase" and not self.parameter:
            self._complain(case.line, f"@testCase {case.name}: needs a @testParameter type before it")
        for test in self.tests:
            test.npes = test.npes or case.npes
            test.parameters = test.parameters or case.parameters

    def _check_test(self, test):
        """Whether a test fits its fixture."""
        parent = self.case.parent if self.case else ""
        if test.takes_this != bool(self.case or test.npes):
            wanted = "no arguments" if test.takes_this else "(this)"
            self._complain(test.line, f"@test subroutine {test.name}: must take {wanted}")
        if test.npes and parent not in ("", "mpitestcase"):
            self._complain(test.line, f"@test {test.name}: npes needs an MpiTestCase")
        if not test.npes and parent == "mpitestcase":
            self._complain(test.line, f"@test {test.name}: needs npes, its own or @testCase's")
        if test.parameters and parent != "parameterizedtestcase":
            self._complain(
                test.line, f"@test {test.name}: testParameters need a ParameterizedTestCase"
            )
        if not test.parameters and parent == "parameterizedtestcase":
            self._complain(test.line, f"@test {test.name}: needs testParameters, its own or @testCase's")
