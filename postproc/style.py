"""One look for all figures: the same colour, mark and line for the same thing everywhere."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.axes import Axes

# Okabe and Ito: told apart in grey and by colour-blind readers; marks and dashes say it again.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKS = ("o", "s", "^", "D", "v", "P", "X")
_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 2)))


def apply_style() -> None:
    """Sizes and lines fit for a printed column."""
    mpl.rcParams.update(
        {
            "figure.figsize": (6.4, 4.4),
            "figure.constrained_layout.use": True,
            "font.size": 10,
            "axes.grid": True,
            "grid.color": "0.88",
            "grid.linewidth": 0.6,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "lines.linewidth": 1.3,
            "lines.markersize": 5,
            "legend.frameon": False,
            "legend.fontsize": 9,
            "savefig.dpi": 160,
            "svg.hashsalt": "entroslip",
        }
    )


def of_dof(dof: int, n_dof: int) -> dict[str, object]:
    """Colour and dashes of oscillator `dof`, which counts from 1."""
    if n_dof <= 5:
        colour: object = _COLOURS[dof - 1]
    else:
        colour = mpl.colormaps["viridis"](0.9 * (dof - 1) / max(n_dof - 1, 1))
    return {"color": colour, "linestyle": _DASHES[(dof - 1) % 5]}


def of_length(length: float, lengths: Sequence[float]) -> dict[str, object]:
    """Colour and mark of a correlation length among all that are drawn."""
    index = sorted(set(lengths)).index(length) % len(_COLOURS)
    return {"color": _COLOURS[index], "marker": _MARKS[index]}


def of_rank(rank: int, count: int) -> dict[str, object]:
    """Colour and dashes of the rank-th of an ordered family, dark to light."""
    colour = mpl.colormaps["viridis"](0.85 * rank / max(count - 1, 1))
    return {"color": colour, "linestyle": _DASHES[rank % len(_DASHES)]}


def dashes(index: int) -> object:
    """The index-th line style, for curves that share a colour."""
    return _DASHES[index % len(_DASHES)]


def mark_frequencies(axes: Axes, frequencies: Sequence[float], label: str, linestyle: str) -> None:
    """Natural frequencies as thin vertical lines, named once."""
    for i, frequency in enumerate(frequencies):
        axes.axvline(
            frequency, color="0.55", linewidth=0.7, linestyle=linestyle, zorder=0,
            label=label if i == 0 else None,
        )  # fmt: skip
