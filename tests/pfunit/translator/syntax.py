"""The lines of the dialect: which directives there are, and what may stand in their parentheses."""

import re
from collections.abc import Iterable

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
# directive about the line that follows: its options
GOVERNING = {
    "test": {"npes", "ifdef", "ifndef", "testparameters"},
    "mpitest": {"npes", "ifdef", "ifndef"},
    "before": set(),
    "after": set(),
    "testcase": {"constructor", "npes", "testparameters"},
    "testparameter": {"constructor"},
}
# what pFUnit's module funit exports besides; there a test module cannot have these names itself
TAKEN = frozenset(
    """
    all_of any_of array_with_size catchnext contains_string disable empty_array ends_with equal_to
    every every_item expectation false finalize get_context ignore_all initialize is keep_all near
    not predicate relatively_near run starts_with stub subject test trim_all true
    """.split()  # noqa: SIM905
)

BLANK = re.compile(r"\s*(!.*)?$")
DIRECTIVE = re.compile(r"(\s*)@(\w*)\s*(.*?)\s*$")
MODULE = re.compile(r"\s*module\s+(?!procedure\b)(\w+)(.*)", re.IGNORECASE)
PROCEDURE = re.compile(r"(?!\s*end\b).*\b(?:subroutine|function)\s+(\w+)", re.IGNORECASE)
SUBROUTINE = re.compile(r"\s*subroutine\s+(\w+)\s*(?:\(\s*(\w*)\s*\))?\s*(?:!.*)?$", re.IGNORECASE)
EXTENSION = re.compile(
    r"\s*type\s*,\s*extends\s*\(\s*(\w+)\s*\)\s*::\s*(\w+)\s*(?:!.*)?$", re.IGNORECASE
)
BY_NAME = re.compile(r"(\w+)\s*=(?!=)\s*(.*)")
COUNTS = re.compile(r"\[\s*[1-9]\d*(\s*,\s*[1-9]\d*)*\s*\]")


class Refused(Exception):
    """Why a line is none of the dialect."""


def scan(text: str, quote: str = "") -> tuple[list[tuple[int, str, int]], str]:
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


def declared_names(line: str) -> list[str]:
    """Names that a line gives to a procedure, to what follows `::`, or to what is imported."""
    code = "".join(character for _, character, depth in scan(line)[0] if depth == 0)
    procedure = PROCEDURE.match(code)
    entities = re.split(r"::|\bonly\s*:", code, maxsplit=1, flags=re.IGNORECASE)[1:]
    names = re.findall(r"(?:^|,)\s*(\w+)", "".join(entities))
    return [name.lower() for name in ([procedure[1]] if procedure else []) + names]


def split_arguments(text: str) -> list[str]:
    """Arguments of a call, cut at the commas outside of brackets and strings."""
    arguments, start = [], 0
    for position, character, depth in scan(text)[0]:
        if character == "," and depth == 0:
            arguments.append(text[start:position].strip())
            start = position + 1
    arguments.append(text[start:].strip())
    if arguments == [""]:
        return []
    if "" in arguments:
        raise Refused("an argument is empty")
    return arguments


def read_arguments(name: str, text: str) -> list[str] | None:
    """Arguments of a directive from what follows its name; None without parentheses."""
    if not text:
        return None
    if text[0] == "(":
        end = next((position for position, _, depth in scan(text)[0] if depth == 0), None)
        if end is None:
            raise Refused(f"@{name} must end on its line: a parenthesis or a quote is open")
        if end == len(text) - 1:
            return split_arguments(text[1:end])
    raise Refused(f"@{name} must stand alone on its line")


def count_by_position(arguments: Iterable[str]) -> int:
    """Number of arguments passed without their name."""
    return sum(not BY_NAME.fullmatch(argument) for argument in arguments)


def read_options(name: str, arguments: list[str] | None) -> dict[str, str]:
    """Options of a directive by lower-case keyword."""
    options = {}
    for argument in arguments or []:
        match = BY_NAME.fullmatch(argument)
        keyword = match[1].lower() if match else ""
        if keyword not in GOVERNING[name.lower()] or keyword in options:
            raise Refused(f"@{name} does not take `{argument}` here")
        options[keyword] = match[2]
    return options


def read_npes(options: dict[str, str]) -> list[int]:
    """Numbers of processes; [] when not given."""
    text = options.get("npes")
    if text is None:
        return []
    if not COUNTS.fullmatch(text):
        raise Refused(f"npes={text}: must be a list of literal positive integers like [1, 2]")
    return [int(count) for count in re.findall(r"\d+", text)]


def read_parameters(options: dict[str, str]) -> str:
    """Expression between the braces of testParameters; empty when not given."""
    text = options.get("testparameters")
    if text is None:
        return ""
    if not re.fullmatch(r"\{.*\S.*\}", text):
        raise Refused(f"testParameters={text}: must be an expression in braces")
    return text[1:-1].strip()


def read_guard(options: dict[str, str]) -> str:
    """The preprocessor line under which a test is registered; empty when not given."""
    guards = [f"#{key} {options[key]}" for key in ("ifdef", "ifndef") if key in options]
    if len(guards) > 1:
        raise Refused("@test takes ifdef or ifndef, not both")
    return "".join(guards)
