"""Draws every figure and table of results files, and one report of all of them.

`compare before.h5 after.h5` prints the differences of two designs instead, and says whether the
files have the same bits. `compare before.h5 one.h5 other.h5` ranks several designs.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from . import headless  # noqa: F401  (before matplotlib)
from .compare import change_table, compare, lines_of, pair_cases
from .decision import table_designs
from .figures.figure import Figure, Ranges
from .figures.gallery import make_figures
from .figures.style import apply_style
from .measured import measured_figure, read_measured
from .output import InputError, Parser, exit_code, say, show
from .paper.numbers import table_correlations, table_numbers
from .paper.printed import AXES
from .paper.statements import assess
from .report import write_report
from .results import Results, find_damage, open_results, with_own_names
from .tables import make_tables, table_statements


def main(arguments: list[str] | None = None) -> int:
    """Draw everything; exit code 2 for what cannot be read, 3 for what cannot be written."""

    words = sys.argv[1:] if arguments is None else arguments
    is_comparison = words[:1] == ["compare"]

    def draw() -> None:
        parser = _comparison_parser() if is_comparison else _parser()
        options = parser.parse_args(words[1:] if is_comparison else words)
        apply_style(*options.style)
        files = with_own_names([open_results(path) for path in options.results])
        try:
            say(_compare(files, options.out) if is_comparison else _draw(files, options))
        except OSError:
            damages = _damages(options.results)
            if not damages:
                raise
            raise InputError("\n".join(damages)) from None

    return exit_code(draw)


def _compare(files: list[Results], folder: Path | None) -> str:
    """One change in full; of several designs what each is worth, and their changes as tables."""
    if len(files) < 2:
        raise InputError("compare: needs two results files or more, the first one to compare with")
    if len(files) == 2:
        return compare(files[0], files[1], folder)
    table = table_designs(files[0], files[1:])
    if folder is None:
        return "\n".join([*lines_of(table), "", table.note])
    table.write_csv(folder)
    for after in files[1:]:
        change = change_table(files[0], after, pair_cases(files[0], after))
        replace(change, name=f"change_{after.stem}").write_csv(folder)
    where = f"designs.csv, and joint by joint change_*.csv, in {folder}"
    return "\n".join([*lines_of(table), "", table.note, where])


def _draw(files: list[Results], options: argparse.Namespace) -> str:
    """Draws all figures. Datasets are read as they are needed: a damaged one shows here."""
    planned = _figures(files, options)
    for start, _ in options.axes:
        if not any(figure.name.startswith(start) for figure in planned):
            there = ", ".join(figure.name for figure in planned)
            raise InputError(
                f"--axes {start}: no name of a figure begins with it; there are {there}"
            )
    statements, tables = assess(files), make_tables(files)
    correlations = next(filter(None, map(table_correlations, files)), None)
    of_paper = (table_numbers(files, statements), correlations)
    tables = [*(table for table in of_paper if table is not None), *tables]
    judged = [table_statements(statements)] if statements else []
    for table in [*tables, *judged]:
        table.write_csv(options.out)
    ranges = (AXES if options.paper_axes else {}) | dict(options.axes)
    figures = []
    try:
        for number, figure in enumerate(planned, start=1):
            show(f"drawing figure {number} of {len(planned)}")
            figures.append((figure, figure.save(options.out, ranges)))
    finally:
        show("")
    report = options.out / "report.html"
    write_report(files, statements, tables, figures, report)
    drawn = {"figure": len(figures), "table": len(tables) + len(judged)}
    counted = " and ".join(f"{n} {name}{'s' * (n != 1)}" for name, n in drawn.items())
    return f"{counted} in {options.out}; report: {report}"


def _figures(files: list[Results], options: argparse.Namespace) -> list[Figure]:
    figures = make_figures(files)
    if options.measured is not None:
        figures.insert(0, measured_figure(read_measured(options.measured), files[0]))
    return figures


def _damages(paths: list[Path]) -> list[str]:
    """A line for each file that cannot be read, with the dataset."""
    found = [(path, find_damage(path)) for path in paths]
    return [f"{path}: is damaged: {damage}" for path, damage in found if damage]


def _parser() -> Parser:
    parser = Parser(prog="python -m entroslip", description=__doc__)
    _add_common(parser, "results files of entroslip")
    parser.add_argument("--out", type=Path, required=True, help="folder for figures and report")
    parser.add_argument(
        "--paper-axes", action="store_true",
        help="the same ranges of the axes in all panels of a figure, to compare them with the"
        " paper's",
    )  # fmt: skip
    parser.add_argument(
        "--axes", type=_ranges, action="append", default=[], metavar="NAME=X0,X1,Y0,Y1",
        help="ranges of the axes of the figures whose names begin with NAME (repeatable)",
    )  # fmt: skip
    parser.add_argument(
        "--measured", type=Path, metavar="DATA",
        help="values that `entroslip estimate` read, to draw beside the first file's process",
    )  # fmt: skip
    return parser


def _comparison_parser() -> Parser:
    parser = Parser(
        prog="python -m entroslip compare",
        description="Prints the differences of designs, sample by sample where the seeds agree,"
        " and whether two files have the same bits.",
    )
    _add_common(parser, "results files: the present design, then one or several others")
    parser.add_argument("--out", type=Path, help="folder for tables and figures; none: only print")
    return parser


def _add_common(parser: Parser, what: str) -> None:
    parser.add_argument("results", type=Path, nargs="+", help=what)
    parser.add_argument(
        "--style", action="append", default=[],
        help="a style of matplotlib over the one of the figures: a name, or a file (repeatable)",
    )  # fmt: skip


def _ranges(text: str) -> tuple[str, Ranges]:
    """fig_09=0,0.8,0,0.25"""
    name, _, numbers = text.partition("=")
    try:
        left, right, bottom, top = (float(number) for number in numbers.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: must be NAME=X0,X1,Y0,Y1") from None
    return name, (left, right, bottom, top)


if __name__ == "__main__":
    sys.exit(main())
