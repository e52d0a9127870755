"""A figure that can be drawn: its name, what to see in it, and a function per panel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

Ranges = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax

# Order of the sections in report and gallery.
SECTIONS = ("Processes", "The chain", "The friction study", "Responses", "Accuracy and cost")
_COLUMN, _PANEL = 6.4, 4.4  # inches


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

    def renamed(self, ending: str) -> Figure:
        """The same under another name, where two files have the same figure."""
        return replace(self, name=f"{self.name}_{ending}", title=f"{self.title} ({ending})")

    def save(self, folder: Path, ranges: Mapping[str, Ranges] | None = None) -> Path:
        """PNG and PDF into the folder; returns the PNG. Ranges go by the start of the name."""
        rows = len(self.panels)
        picture, axes = plt.subplots(rows, figsize=(_COLUMN, self.height * rows), squeeze=False)
        for draw, panel in zip(self.panels, axes[:, 0], strict=True):
            draw(panel)
            for start, (left, right, bottom, top) in (ranges or {}).items():
                if self.name.startswith(start):
                    panel.set(xlim=(left, right), ylim=(bottom, top))
        png = folder / f"{self.name}.png"
        picture.savefig(png)
        picture.set_layout_engine("none")  # as laid out once
        picture.savefig(png.with_suffix(".pdf"), metadata={"CreationDate": None})
        plt.close(picture)
        return png
