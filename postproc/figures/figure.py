"""A figure that can be drawn: its name, what to see in it, and a function per panel."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from PIL import Image

from ..output import write_file

Ranges = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax

# Order of the sections in report and gallery.
SECTIONS = ("Processes", "The chain", "The friction study", "Responses", "Accuracy and cost")
_COLUMN, _PANEL = 6.4, 4.4  # inches
_SHADES = 256  # of a small picture's palette


@dataclass(frozen=True)
class Figure:
    """One figure; its panels stand below one another."""

    name: str  # of the files
    title: str
    caption: str
    section: str  # one of SECTIONS
    panels: tuple[Callable[[Axes], None], ...]
    statements: tuple[str, ...] = ()  # numbers of the paper's statements that it shows
    height: float = _PANEL  # of a panel, in inches

    def outside_the_paper(self) -> Figure:
        """The same without the paper's number and statements."""
        caption = re.sub(r" \(the paper:[^)]*\)", "", self.caption)
        kept = [s for s in re.split(r"(?<=\.) (?=[A-Z])", caption) if "paper" not in s.lower()]
        title = re.sub(r"^Fig\. \w+\. ", "", self.title)
        return replace(self, title=title, caption=" ".join(kept), statements=())

    def of_file(self, stem: str, is_renamed: bool) -> Figure:
        """The same with its file in the title, and in its name where another has that."""
        name = f"{self.name}_{stem}" if is_renamed else self.name
        return replace(self, name=name, title=f"{self.title} ({stem}.h5)")

    def save(self, folder: Path, ranges: Mapping[str, Ranges] | None = None) -> Path:
        """PNG and PDF into the folder; returns the PNG. Ranges go by the start of the name."""
        rows = len(self.panels)
        picture, axes = plt.subplots(rows, figsize=(_COLUMN, self.height * rows), squeeze=False)
        for draw, panel in zip(self.panels, axes[:, 0], strict=True):
            draw(panel)
            for start, (left, right, bottom, top) in (ranges or {}).items():
                if self.name.startswith(start):
                    panel.set(xlim=(left, right), ylim=(bottom, top))
        png, pdf = BytesIO(), BytesIO()
        picture.savefig(png, format="png")
        with plt.rc_context({"figure.constrained_layout.use": False}):
            picture.set_layout_engine(None)  # with any engine matplotlib would draw twice
        picture.savefig(pdf, format="pdf", metadata={"CreationDate": None})
        plt.close(picture)
        path = folder / f"{self.name}.png"
        write_file(path, png.getvalue())
        write_file(path.with_suffix(".pdf"), pdf.getvalue())
        return path


def write_small_png(path: Path, picture: Image.Image) -> None:
    """A PNG of few colours, fit to be kept with the sources."""
    small = BytesIO()
    picture.convert("RGB").quantize(_SHADES).save(small, format="png", optimize=True)
    write_file(path, small.getvalue())
