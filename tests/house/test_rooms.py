"""The rooms: small, named after their place, of use, tested, outside libraries behind one door."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from tests.conftest import ROOT

FOLDERS = ["src", "drivers", "bench", "examples", "postproc", "scripts", "tests", "docs"]
CODE = sorted(
    path
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*")
    if path.suffix in {".f90", ".F90", ".pf", ".py", ".sh"} and "__pycache__" not in path.parts
)
FORTRAN = {path: path.read_text() for path in CODE if path.suffix in {".f90", ".F90", ".pf"}}
LIBRARY = {path: text for path, text in FORTRAN.items() if path.is_relative_to(ROOT / "src")}

#: outside modules, and the rooms that may name them
DOORS = {
    r"mpi|mpi_f08": {"parallel_world", "parallel_work"},
    r"hdf5|h5\w+": {
        "io_hdf5", "io_hdf5_attributes", "io_hdf5_datasets", "io_hdf5_file",
    },
}  # fmt: skip


def room(path: Path) -> str:
    """Floor, wing and subject, as the path below src says them."""
    return "_".join([*path.relative_to(ROOT / "src").parent.parts, path.stem])


@cache
def used(text: str) -> set[str]:
    return set(re.findall(r"^\s*use\s*(?:,\s*\w+\s*::)?\s*(\w+)", text, re.MULTILINE))


def test_a_module_is_named_after_its_place():
    named = {
        path: re.findall(r"^(?:module|program) (\w+)$", LIBRARY[path], re.M) for path in LIBRARY
    }
    assert {path: names for path, names in named.items() if names != [room(path)]} == {}


#: words that rooms had, and that say nothing to a reader
GONE = {
    "course", "crossing", "entries", "event", "existing", "foresight", "heading", "lanes",
    "location", "measuring", "quiet", "registers", "statistical", "stretches", "tables",
    "tabulated", "target", "verdict", "walk", "walker",
}  # fmt: skip


def test_rooms_have_names_that_explain_themselves():
    assert {path.stem for path in FORTRAN if path.suffix == ".f90"} & GONE == set()


#: procedures with more arguments than nine: libraries' own
MANY_ARGUMENTS = {"numerics_lapack"}


def test_docstrings_open_with_a_noun_a_verb_or_true_if():
    """None with Of, That, What or Whether: the thing itself comes first."""
    riddle = re.compile(r'(?:^\s*!>|""")\s*(?:Of|That|What|Whether)\b.*', re.MULTILINE)
    folders = ("src", "drivers", "postproc", "bench")
    found = [
        f"{path.relative_to(ROOT)}: {line}"
        for path in CODE
        if path.relative_to(ROOT).parts[0] in folders
        for line in riddle.findall(path.read_text())
    ]
    assert found == []


#: plurals that no docstring of a subroutine may open with; verbs end as they do
PLURALS = {
    "Accelerations", "Answers", "Autocovariances", "Axes", "Batches", "Bits", "Blocks",
    "Bytes", "Cases", "Coefficients", "Columns", "Components", "Constraints",
    "Derivatives", "Diagonals", "Digits", "Displacements", "Dofs", "Eigenvalues",
    "Eigenvectors", "Entries", "Errors", "Extents", "Features", "Files", "Forces",
    "Frequencies", "Gradients", "Groups", "Halvings", "Histories", "Indices", "Influences",
    "Inputs", "Integrals", "Intervals", "Joints", "Lags", "Lanes", "Lengths", "Levels", "Lines",
    "Loads", "Matrices", "Maxima", "Means", "Members", "Milliseconds", "Modes", "Moments",
    "Multipliers", "Nodes", "Numbers", "Operators", "Orders", "Outputs", "Parts", "Paths",
    "Percentiles", "Points", "Poles", "Polynomials", "Powers", "Processes", "Products",
    "Properties", "Ranks", "Ratios", "Realizations", "Residuals", "Results", "Roots", "Rows",
    "Rules", "Scalars", "Segments", "Sequences", "Series", "Shards", "Signs",
    "Sliders", "Slopes", "Solutions", "Spectra", "Statistics", "Steps", "Tables", "Terms",
    "This", "Tokens", "Transitions", "Units", "Values", "Variables", "Variances", "Variants",
    "Vectors", "Velocities", "Verdicts", "Ways", "Weights", "Windows", "Words", "Works",
}  # fmt: skip


def test_subroutines_docstrings_open_with_a_verb():
    """In the third person: "Writes ..."; one that overrides may say where the words stand."""
    head = re.compile(
        r"^ *!> *(.*)\n(?: *!.*\n)* *(?:(?:pure|impure|elemental|recursive|module) )*"
        r"subroutine (\w+)",
        re.MULTILINE,
    )
    documented = [
        (f"{path.relative_to(ROOT)}: {name}", words)
        for path, text in FORTRAN.items()
        if path.relative_to(ROOT).parts[0] in {"src", "drivers", "bench"}
        for words, name in head.findall(text)
    ]
    assert len(documented) > 500
    wrong = []
    for name, words in documented:
        verb = re.match(r"See \w+\.|([A-Z][a-z]+s)\b(?!')", words)
        if not verb or verb[1] in PLURALS:
            wrong.append(f"{name}: {words}")
    assert wrong == []


def test_no_procedure_has_more_than_nine_arguments():
    found = []
    for path, text in LIBRARY.items():
        joined = re.sub(r"&\s*\n\s*&?", " ", re.sub(r"!.*", "", text))
        for name, arguments in re.findall(r"\b(?:subroutine|function) (\w+)\(([^)]*)\)", joined):
            if arguments.count(",") > 8 and room(path) not in MANY_ARGUMENTS:
                found.append(f"{room(path)}: {name}")
    assert found == []


def test_a_small_room_serves_more_than_one_of_its_floor():
    """Under 60 lines of code, used by one room of the same floor alone: it belongs there."""
    floor = {room(path): path.relative_to(ROOT / "src").parts[0] for path in LIBRARY}
    lonely = []
    for path, text in LIBRARY.items():
        lines = [line for line in text.splitlines() if re.match(r"\s*[^!\s]", line)]
        users = {room(other) for other, words in LIBRARY.items() if room(path) in used(words)}
        elsewhere = any(room(path) in used(t) for p, t in FORTRAN.items() if "drivers" in p.parts)
        if len(lines) < 60 and len(users) == 1 and "groups" not in path.parts and not elsewhere:
            lonely += [room(path)] if floor[users.pop()] == floor[room(path)] else []
    assert lonely == []


def test_no_word_of_the_glossary_has_two_meanings():
    text = (ROOT / "docs/glossary.md").read_text()
    words = [word for row in re.findall(r"^\| (\*\*.*?) \|", text, re.MULTILINE)
             for word in re.findall(r"\*\*(.*?)\*\*", row)]  # fmt: skip
    assert len(words) > 30
    assert sorted({word for word in words if words.count(word) > 1}) == []


def test_every_module_serves_the_program_or_an_example():
    modules = {room(path): used(text) for path, text in LIBRARY.items()}
    users = [
        text
        for path, text in FORTRAN.items()
        if path.is_relative_to(ROOT / "drivers") or path.is_relative_to(ROOT / "examples")
    ]
    served, ahead = set(), set().union(*map(used, users))
    while ahead:
        served |= ahead
        ahead = set().union(*(modules.get(name, set()) for name in ahead)) - served
    assert modules.keys() - served == set()


def test_every_public_name_is_used_elsewhere():
    """By another module, or a test; a type may also be that of a component or an argument here."""
    n_files = Counter(word for text in FORTRAN.values() for word in set(re.findall(r"\w+", text)))
    idle = []
    for path, text in LIBRARY.items():
        joined = re.sub(r"&\s*\n\s*&?", " ", text)
        public = re.findall(r"^   public ::([^!\n]*)", joined, re.MULTILINE)
        for name in re.findall(r"\w+", " ".join(public)):
            if n_files[name] == 1 and not re.search(rf"(?:type|class)\({name}\)", text):
                idle.append(f"{room(path)}: {name}")
    assert idle == []


def test_every_module_has_a_test_or_is_named_in_one():
    """`tests/<floor>/test_<floor>_<room>.pf`, or the head or a `use` of another test."""
    tests = set(CODE).intersection((ROOT / "tests").rglob("*")) - {Path(__file__)}
    named = {word for path in tests for word in re.findall(r"\w+", path.read_text())}
    names = {path.name for path in tests}
    untested = [
        room(path)
        for path in LIBRARY
        if f"test_{room(path)}.pf" not in names and room(path) not in named
    ]
    assert untested == []


@pytest.mark.parametrize("outside", DOORS)
def test_an_outside_library_has_one_door(outside):
    doors = {
        room(path)
        for path, text in LIBRARY.items()
        if any(re.fullmatch(outside, name) for name in used(text))
    }
    assert doors <= DOORS[outside]


def test_only_drivers_print_or_stop():
    """The library hands errors back; two rooms write to a terminal on behalf of a driver."""
    words = r"^\s*(?:print\b|stop\b|write \((?:\*|output_unit|error_unit)"
    words += r"|call (?:say|write_output)\b)"
    loud = re.compile(words, re.MULTILINE)
    speakers = {room(path) for path, text in LIBRARY.items() if loud.search(text)}
    assert speakers <= {"core_terminal", "io_progress"}
