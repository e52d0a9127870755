"""Translate .pf files, tests written for pFUnit, to Fortran.

    translator tests [--mpi] NAME FOLDER INPUT.pf ...   an executable: a file for each, driver.f90
    translator assertions OUTPUT.f90                    the assertions on numbers

What the dialect does not know is refused as `file:line: reason`, with exit status 1. A file that
has its text already is left alone: what was compiled from it need not be compiled again.
"""

import argparse
import sys
from pathlib import Path

from assertions import assertions
from checking import check
from reading import Source
from writing import driver, translation


def parse_arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="translator",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    tests = commands.add_parser("tests")
    tests.add_argument("--mpi", action="store_true")
    tests.add_argument("name")
    tests.add_argument("folder", type=Path)
    tests.add_argument("inputs", type=Path, nargs="+")
    numbers = commands.add_parser("assertions")
    numbers.add_argument("output", type=Path)
    return parser.parse_args()


def write(path: Path, text: str) -> None:
    """Writes a file, unless it has this text."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def main() -> int:
    """Write the files asked for; the exit status."""
    given = parse_arguments()
    if given.command == "assertions":
        given.output.write_text(assertions())
        return 0
    sources = [Source(path) for path in given.inputs]
    for source in sources:
        check(source)
    complaints = [complaint for source in sources for complaint in source.complaints]
    if complaints:
        print(*complaints, sep="\n", file=sys.stderr)
        return 1
    for source in sources:
        output = given.folder / f"{source.path.stem}.F90"
        write(output, translation(source, output))
    names = [source.path.stem for source in sources]
    write(given.folder / "driver.f90", driver(f"{given.name}_driver", names, given.mpi))
    return 0


if __name__ == "__main__":
    sys.exit(main())
