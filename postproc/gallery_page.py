"""Writes the gallery in docs: a page, and small pictures of every figure of results files.

python -m entroslip.gallery_page results/paper/*.h5 --out docs/gallery.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from PIL import Image

from .evidence import Statement
from .figure import SECTIONS, Figure
from .gallery import make_figures
from .results import Results, open_results
from .statements import assess
from .style import apply_style

_WIDTH = 720  # pixels
_SHADES = 256  # of a picture's palette
_HEAD = """# Gallery

Every figure of the paper, drawn by `python -m entroslip` from the scenes in `input/`. The report of
the same command sets the paper's numbers beside ours. This page and its pictures are written, from
the results of `./quickstart.sh`, by

    python -m entroslip.gallery_page results/paper/*.h5 --out docs/gallery.md
"""


def write_page(files: list[Results], path: Path) -> list[Path]:
    """The page, and a folder of its name beside it; returns the pictures."""
    folder = path.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
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
    titles = ", ".join(f"{results.path.name} ({results.title})" for results in files)
    parts.append(f"Drawn from {titles}.\n")
    path.write_text("\n".join(parts), encoding="utf-8")
    return pictures


def _verdicts(statements: Sequence[Statement]) -> list[str]:
    """The paper's statements and what the tests said, as a table."""
    if not statements:
        return []
    rows = "".join(
        f"| {s.number} | {s.claim} | {s.source} | {s.verdict.value} |\n" for s in statements
    )
    return [
        "## The paper's statements\n\nBy tests that the report names, with their numbers and"
        " p-values.\n",
        f"| | statement | where | verdict |\n|---|---|---|---|\n{rows}",
    ]


def _small_picture(figure: Figure, folder: Path) -> Path:
    """A PNG of few colours, fit to be kept with the sources."""
    with tempfile.TemporaryDirectory() as drawn:
        with Image.open(figure.save(Path(drawn))) as picture:
            size = (_WIDTH, round(picture.height * _WIDTH / picture.width))
            small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        path = folder / f"{figure.name}.png"
        small.quantize(_SHADES).save(path, optimize=True)
    return path


def main(arguments: list[str] | None = None) -> int:
    """Write the page."""
    parser = argparse.ArgumentParser(prog="python -m entroslip.gallery_page")
    parser.add_argument("results", type=Path, nargs="+", help="results files of entroslip")
    parser.add_argument("--out", type=Path, required=True, help="the page")
    options = parser.parse_args(arguments)
    mpl.use("Agg")
    apply_style()
    pictures = write_page([open_results(path) for path in options.results], options.out)
    print(f"{len(pictures)} pictures beside {options.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
