"""Writes the gallery in docs: a page, and small pictures of every figure of results files.

python -m entroslip.figures.gallery_page RESULTS.h5 ... --out docs/gallery.md
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from .. import headless  # noqa: F401  (before matplotlib)
from ..output import Parser, exit_code, say, write_file
from ..paper.evidence import Statement
from ..paper.statements import assess
from ..results import Results, open_results
from .figure import SECTIONS, Figure, write_small_png
from .gallery import make_figures
from .style import apply_style

_WIDTH = 720  # pixels
_HEAD = """# Gallery

Every figure of the paper, drawn by `python -m entroslip` from the scenes in `input/`. The report of
the same command sets the paper's numbers beside ours. This page and its pictures are written, from
the results of `./quickstart.sh`, by

    python -m entroslip.figures.gallery_page --out docs/gallery.md \\
      results/paper/{paper_process,paper,deterministic,sweep,one_sample,tradeoff}.h5
"""


def write_page(files: list[Results], path: Path) -> list[Path]:
    """The page, and a folder of its name beside it; returns the pictures."""
    folder = path.with_suffix("")
    figures = make_figures(files)
    pictures = [_small_picture(figure, folder) for figure in figures]
    parts = [_HEAD, *_verdicts(assess(files))]
    for section in SECTIONS:
        own = [figure for figure in figures if figure.section == section]
        parts += [f"## {section}\n"] if own else []
        for figure in own:
            parts.append(
                f"### {figure.title}\n\n![{figure.title}]({folder.name}/{figure.name}.png)\n\n"
                f"{figure.caption}\n"
            )
    titles = ", ".join(f"{results.stem}.h5 ({results.title})" for results in files)
    parts.append(f"Drawn from {titles}.\n")
    write_file(path, "\n".join(parts).encode())
    return pictures


def _verdicts(statements: Sequence[Statement]) -> list[str]:
    """Table of the paper's statements and verdicts."""
    if not statements:
        return []
    rows = "".join(
        f"| {s.number} | {s.claim} | {s.source} | {s.verdict.value} |\n" for s in statements
    )
    return [
        "## The paper's statements\n\nThe report names the test of each verdict,"
        " with its numbers and p-value.\n",
        f"| | statement | where | verdict |\n|---|---|---|---|\n{rows}",
    ]


def _small_picture(figure: Figure, folder: Path) -> Path:
    """The figure at the width of a page."""
    with tempfile.TemporaryDirectory() as drawn:
        with Image.open(figure.save(Path(drawn))) as picture:
            size = (_WIDTH, round(picture.height * _WIDTH / picture.width))
            small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        path = folder / f"{figure.name}.png"
        write_small_png(path, small)
    return path


def main(arguments: list[str] | None = None) -> int:
    """Write the page."""
    parser = Parser(prog="python -m entroslip.figures.gallery_page")
    parser.add_argument("results", type=Path, nargs="+", help="results files of entroslip")
    parser.add_argument("--out", type=Path, required=True, help="the page")

    def draw() -> None:
        options = parser.parse_args(arguments)
        apply_style()
        pictures = write_page([open_results(path) for path in options.results], options.out)
        say(f"{len(pictures)} pictures beside {options.out}")

    return exit_code(draw)


if __name__ == "__main__":
    sys.exit(main())
