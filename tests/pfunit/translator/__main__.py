"""Translate .pf files, tests written for pFUnit, to Fortran.

    translator tests INPUT.pf OUTPUT.F90                     the tests of one file
    translator driver [--mpi] NAME OUTPUT.f90 INPUT.pf ...   the main program of an executable
    translator assertions OUTPUT.f90                         the assertions on numbers

What the dialect does not know is refused as `file:line: reason`, with exit status 1.
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
    tests.add_argument("input", type=Path)
    tests.add_argument("output", type=Path)
    program = commands.add_parser("driver")
    program.add_argument("--mpi", action="store_true")
    program.add_argument("name")
    program.add_argument("output", type=Path)
    program.add_argument("inputs", type=Path, nargs="+")
    numbers = commands.add_parser("assertions")
    numbers.add_argument("output", type=Path)
    return parser.parse_args()


def main() -> int:
    """Write the file asked for; the exit status."""
    given = parse_arguments()
    if given.command == "assertions":
        given.output.write_text(assertions())
    elif given.command == "driver":
        names = [path.stem for path in given.inputs]
        given.output.write_text(driver(given.name, names, given.mpi))
    else:
        source = Source(given.input)
        check(source)
        if source.complaints:
            print(*source.complaints, sep="\n", file=sys.stderr)
            return 1
        given.output.write_text(translation(source, given.output))
    return 0


if __name__ == "__main__":
    sys.exit(main())
