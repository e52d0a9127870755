"""One look for all figures: the same colour, mark and line for the same thing everywhere."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import matplotlib as mpl
import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator, ScalarFormatter

from ..output import InputError
from ..paper.printed import LENGTHS

Look = dict[str, Any]  # keyword arguments of a matplotlib call
_Item = TypeVar("_Item")

# Okabe and Ito: they differ in grey and for colour-blind readers. Marks and dashes differ too.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#56B4E9", "#000000")
_MARKS = ("o", "s", "^", "D", "v", "P", "X")
_DASHES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 2)))
_LIGHTEST = 0.78  # of viridis, still seen on white
_NARROW = 4.0  # ends of a logarithmic axis whose 1, 2, 3 and 5 may be none
_LINE, _HANDLE = 94, 9  # characters above the axes, and those that a curve's line takes
_WIDE = 1.0e3  # ends of a logarithmic axis whose 2, 3 and 5 would meet


def apply_style(*others: str) -> None:
    """Sizes and lines fit for a printed column; over them, styles of matplotlib or of a file."""
    mpl.rcParams.update(
        {
            "figure.constrained_layout.use": True,
            "font.size": 10,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.formatter.limits": (-3, 6),  # powers of ten: 0.00015 and its neighbour would meet
            "grid.color": "0.9",
            "grid.linewidth": 0.6,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "lines.linewidth": 1.3,
            "lines.markersize": 5,
            "legend.frameon": False,
            "legend.fontsize": 8.5,
            "savefig.dpi": 150,
            "svg.hashsalt": "entroslip",
            "pdf.fonttype": 42,
        }
    )
    for style in others:
        try:
            mpl.style.use(style)
        except (OSError, ValueError) as error:
            raise InputError(" ".join(str(error).split())) from error


def of_dof(dof: int, n_dof: int) -> Look:
    """Colour, mark and dashes of mass or joint `dof`, which counts from 1."""
    index = (dof - 1) % len(_MARKS)
    if n_dof <= len(_COLOURS):
        colour: Any = _COLOURS[index]
    else:
        colour = _shade((dof - 1) / (n_dof - 1))
    return {"color": colour, "linestyle": _DASHES[index], "marker": _MARKS[index]}


def line_of_dof(dof: int, n_dof: int) -> Look:
    """The same without mark, for curves of many points."""
    return of_dof(dof, n_dof) | {"marker": "none"}


def some_of(
    items: Sequence[_Item], most: int = len(_COLOURS), wanted: _Item | None = None
) -> list[_Item]:
    """All items, or as many as can be distinguished, with the first, the last and `wanted`."""
    if len(items) <= most:
        return list(items)
    places = [round(i * (len(items) - 1) / (most - 1)) for i in range(most)]
    if wanted in items and (place := items.index(wanted)) not in places:
        places[1 + min(range(most - 2), key=lambda i: abs(places[i + 1] - place))] = place
    return [items[place] for place in places]


def of_length(length: float, lengths: Iterable[float]) -> Look:
    """Colour and mark of a correlation length.

    The paper's have their own in every figure; of more lengths than colours each has a shade.
    """
    every = sorted(set(lengths))
    others = [one for one in every if one not in LENGTHS]
    if len(LENGTHS) + len(others) > len(_COLOURS):
        rank = every.index(length)
        return {"color": _shade(rank / (len(every) - 1)), "marker": _MARKS[rank % len(_MARKS)]}
    index = [*LENGTHS, *others].index(length)
    return {"color": _COLOURS[index], "marker": _MARKS[index]}


def of_rank(rank: int, count: int) -> Look:
    """Colour, mark and dashes of the rank-th of an ordered family, dark to light."""
    return {
        "color": _shade(rank / max(count - 1, 1)),
        "linestyle": _DASHES[rank % len(_DASHES)],
        "marker": _MARKS[rank % len(_MARKS)],
        "markersize": 3.5,
    }


def with_symbols(lengths: str) -> str:
    """'$L_0$ = 1' of 'L0 = 1'."""
    return re.sub(r"L(\d)", r"$L_\1$", lengths)


def dashes(index: int) -> Any:  # noqa: ANN401  (a matplotlib line style has no type of its own)
    """The index-th line style, for curves that share a colour."""
    return _DASHES[index % len(_DASHES)]


def add_legend(axes: Axes, title: str = "") -> None:
    """A legend above the axes, where it hides nothing, in as many columns as fit."""
    names = axes.get_legend_handles_labels()[1]
    widest = max(len(re.sub(r"[$_{}\\]", "", name)) for name in names)
    n_columns = max(1, min(len(names), _LINE // (widest + _HANDLE)))
    axes.legend(title=title, ncols=n_columns, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def mark_frequencies(axes: Axes, frequencies: Iterable[float], label: str, linestyle: str) -> None:
    """Natural frequencies as thin vertical lines, named once."""
    for i, frequency in enumerate(frequencies):
        axes.axvline(
            frequency, color="0.6", linewidth=0.8, linestyle=linestyle, zorder=0,
            label=label if i == 0 else None,
        )  # fmt: skip


def label_logarithmic(axis: Axis) -> None:
    """Plain numbers on a logarithmic axis that is drawn: 1, or 1, 2, 3 and 5, or a few between."""
    low, high = sorted(axis.get_view_interval())
    if high < _NARROW * low:
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_formatter(FuncFormatter(_short_tick))
        axis.set_minor_formatter("" if high > _WIDE * low else FuncFormatter(_short_tick))


def _short_tick(value: float, _: int) -> str:
    leading = float(f"{value:e}".split("e")[0])
    return f"{value:g}" if leading in (1.0, 2.0, 3.0, 5.0) else ""


def _shade(share: float) -> Any:  # noqa: ANN401
    return mpl.colormaps["viridis"](_LIGHTEST * share)
