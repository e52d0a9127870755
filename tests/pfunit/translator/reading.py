"""Read a .pf file: its directives become Fortran, line for line, and its tests become a list."""

from dataclasses import dataclass, field
from pathlib import Path

from syntax import (
    ASSERTIONS,
    BLANK,
    DIRECTIVE,
    EXTENSION,
    GOVERNING,
    MODULE,
    SUBROUTINE,
    TAKEN,
    Refused,
    count_by_position,
    declared_names,
    read_arguments,
    read_guard,
    read_npes,
    read_options,
    read_parameters,
    scan,
)


@dataclass
class Method:
    """A subroutine under @test, @before or @after."""

    name: str
    line: int
    takes_this: bool
    npes: list[int] = field(default_factory=list)
    parameters: str = ""  # an expression
    guard: str = ""  # the preprocessor line under which the test is registered
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


class Source:
    """One .pf file; its `lines` are Fortran once it is read, and keep their numbers."""

    def __init__(self, path: Path) -> None:
        """Read the file; what is wrong with its lines stands in `complaints` afterwards."""
        self.path = path
        self.has_module = False
        self.tests: list[Method] = []
        self.around: dict[str, Method] = {}  # under @before and @after
        self.case: Case | None = None
        self.parameter = ""  # the type under @testParameter
        self.lines: list[str] = []
        self.complaints: list[str] = []
        self._waiting = ""  # the directive whose line is still to come
        self._options: dict[str, str] = {}  # of that directive
        self._disabled = False
        self._quote = ""  # of a string that goes on in the next line
        for line in path.read_text().splitlines():
            self.lines.append(line)
            try:
                self._read(line)
            except Refused as reason:
                self.complain(len(self.lines), str(reason))
        if self._waiting:
            self.complain(len(self.lines), f"@{self._waiting} is followed by nothing")

    @property
    def name(self) -> str:
        """Name of the file, its module and its suite."""
        return self.path.stem

    @property
    def is_mpi(self) -> bool:
        """True if tests run on several processes."""
        return any(test.npes for test in self.tests)

    def complain(self, line: int, reason: str) -> None:
        """Note a complaint at a line."""
        self.complaints.append(f"{self.path}:{line}: {reason}")

    def _read(self, line: str) -> None:
        match = None if self._quote else DIRECTIVE.match(line)
        if match:
            self.lines[-1] = f"!{line}"
            self._directive(*match.groups())
        elif self._waiting and not BLANK.match(line):
            name, self._waiting = self._waiting, ""
            self._govern(name, line)
        else:
            self._fortran(line)

    def _directive(self, indent: str, name: str, rest: str) -> None:
        lower = name.lower()
        is_assertion = lower.removeprefix("mpi") in ASSERTIONS
        if not (is_assertion or lower in GOVERNING or lower == "disable"):
            raise Refused(f"unknown directive @{name}")
        arguments = read_arguments(name, rest)
        if lower == "disable":
            if not self._waiting.endswith("test") or arguments is not None:
                raise Refused("@disable must follow @test")
            self._disabled = True
        elif self._waiting:
            raise Refused(f"@{self._waiting} must be followed by what it is about, not by @{name}")
        elif is_assertion:
            self._assertion(indent, name, arguments)
        else:
            self._options = read_options(name, arguments)
            self._waiting = lower
            self._disabled = False

    def _assertion(self, indent: str, name: str, arguments: list[str] | None) -> None:
        is_mpi = name.lower().startswith("mpi")  # the old spelling does not leave the test
        procedure = name[3:] if is_mpi else name
        operands, by_position = ASSERTIONS[procedure.lower()]
        if arguments is None or len(arguments) < operands:
            raise Refused(f"@{name} needs parentheses with {operands} operands")
        if count_by_position(arguments) > by_position:
            raise Refused(f"@{name} takes {by_position} arguments by position: name the others")
        location = f"location=SourceLocation('{self.path.name}', {len(self.lines)})"
        call = f"{indent}call {procedure}({', '.join([*arguments, location])})"
        self.lines[-1] = call if is_mpi else f"{call}; if (anyExceptions()) return"

    def _govern(self, name: str, line: str) -> None:
        """Read the line after a directive that is about it."""
        if name in ("testcase", "testparameter"):
            match, wanted = EXTENSION.match(line), "type, extends(parent) :: name"
        else:
            match, wanted = SUBROUTINE.match(line), "subroutine name` or `subroutine name(this)"
        if not match:
            raise Refused(f"@{name} must be followed by `{wanted}`")
        if name == "testcase":
            self._new_case(*match.groups())
        elif name == "testparameter":
            self._new_parameter(*match.groups())
        elif name in ("before", "after"):
            self._new_around(name, *match.groups())
        else:
            self._new_test(*match.groups())

    def _new_test(self, name: str, argument: str | None) -> None:
        self.tests.append(
            Method(
                name,
                len(self.lines),
                bool(argument),
                read_npes(self._options),
                read_parameters(self._options),
                read_guard(self._options),
                self._disabled,
            )
        )

    def _new_around(self, directive: str, name: str, argument: str | None) -> None:
        if directive in self.around:
            raise Refused(f"a second @{directive} in this file")
        self.around[directive] = Method(name, len(self.lines), bool(argument))

    def _new_case(self, parent: str, name: str) -> None:
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

    def _new_parameter(self, parent: str, name: str) -> None:
        if self.parameter:
            raise Refused("a second @testParameter in this file")
        if parent.lower() != "abstracttestparameter":
            raise Refused(f"@testParameter {name}: must extend AbstractTestParameter")
        self.parameter = name

    def _fortran(self, line: str) -> None:
        """Let a line pass; no directive may hide in it, and names follow rules."""
        if line.startswith("#"):
            raise Refused("a line must not start with #")
        match = None if self._quote else MODULE.match(line)
        if match:
            self._new_module(*match.groups())
        for name in TAKEN.intersection(declared_names(line)):
            raise Refused(f"the name {name} is taken by pFUnit")
        code, quote = scan(line, self._quote)
        self._quote = quote if line.rstrip().endswith("&") else ""
        if any(character == "@" for _, character, _ in code):
            raise Refused("a directive must stand alone on its line")

    def _new_module(self, name: str, rest: str) -> None:
        if rest.strip():
            raise Refused("the module line must end after the name")
        if self.has_module:
            raise Refused("a second module in this file")
        if name.lower() != self.name.lower():
            raise Refused(f"module {name}: must have the name of its file, {self.name}")
        self.has_module = True
