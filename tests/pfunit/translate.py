"""Translate .pf files, tests written for pFUnit, to Fortran.

    translate.py tests INPUT.pf OUTPUT.F90                    one file of tests
    translate.py driver [--mpi] NAME OUTPUT.f90 INPUT.pf ...  the main program of an executable

What the dialect does not know is refused as `file:line: reason`, with exit status 1.
"""

import argparse
import sys
from pathlib import Path

from reading import Reader
from writing import driver, gathering


def translate(source: Reader) -> str:
    """Fortran of a whole file; its lines keep the name and numbers of the .pf file."""
    return "\n".join([f'#line 1 "{source.path}"', *source.lines, '#line 1 "gathering"', gathering(source)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    commands = parser.add_subparsers(dest="command", required=True)
    tests = commands.add_parser("tests")
    tests.add_argument("input", type=Path)
    tests.add_argument("output", type=Path)
    program = commands.add_parser("driver")
    program.add_argument("--mpi", action="store_true")
    program.add_argument("name")
    program.add_argument("output", type=Path)
    program.add_argument("inputs", type=Path, nargs="+")
    given = parser.parse_args()
    if given.command == "driver":
        names = [path.stem for path in given.inputs]
        given.output.write_text(driver(given.name, names, given.mpi))
        return 0
    source = Reader(given.input)
    if source.complaints:
        print(*source.complaints, sep="\n", file=sys.stderr)
        return 1
    given.output.write_text(translate(source))
    return 0


if __name__ == "__main__":
    sys.exit(main())
