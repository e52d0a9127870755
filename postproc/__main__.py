"""python -m postproc RESULTS --out DIR: every figure and table of a results file, and a report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

from postproc.gallery import make_figures
from postproc.report import write_report
from postproc.results import ResultsError, open_results
from postproc.style import apply_style
from postproc.tables import make_tables


def main(arguments: list[str] | None = None) -> int:
    """Draw everything; exit code 2 when the file is not a results file."""
    parser = argparse.ArgumentParser(prog="python -m postproc", description=__doc__)
    parser.add_argument("results", type=Path, help="results file of entroslip run")
    parser.add_argument("--out", type=Path, required=True, help="folder for what is drawn")
    options = parser.parse_args(arguments)
    mpl.use("Agg")
    apply_style()
    try:
        results = open_results(options.results)
    except ResultsError as error:
        print(error, file=sys.stderr)
        return 2
    options.out.mkdir(parents=True, exist_ok=True)
    tables = make_tables(results)
    for table in tables:
        table.write_csv(options.out)
    figures = [(figure, figure.save(options.out)) for figure in make_figures(results)]
    report = options.out / "report.html"
    write_report(results, tables, figures, report)
    print(f"{len(figures)} figures and {len(tables)} tables in {options.out}; report: {report}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
