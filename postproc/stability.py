"""Map of where methods hold, degrade or refuse, drawn from the tables of bench/stability.py.

python -m entroslip.stability results/stability --out docs/gallery/stability.png
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from .figures import style
from .figures.figure import write_small_png
from .output import Parser, exit_code, say
from .paper.printed import LENGTHS

Row = dict[str, str]  # of a CSV: family, error (empty where refused), reason, and the axes

HOLDS, DEGRADES, REFUSES = "holds", "degrades", "refuses"
MOST_POINTS = 0.1  # of percent: a slip fraction that is further off has degraded
MOST_MISS = 1e-8  # relative: a process that misses what was wanted by more has degraded
MOST_SAMPLED_MISS = 1e-2  # the same of a positive process above order 1, fitted to simulated values

# of M = 1 and the exact law, by the Perron function of its kernel: L0 -> largest std/mean
THEORY = {0.1: 0.880, 0.3: 0.777, 1.0: 0.652, 3.0: 0.564}
# of the paper: std/mean of its friction, orders of its lengths, mu N over rms force, step
_RATIOS, _ORDERS, _LOADS, _DT_OMEGA = (0.335, 0.5), (2, 5, 10), (0.312, 1.04), 0.101
_LEAST_POINTS, _REFUSED_POINTS = 1e-11, 1e3  # lower edge of an axis of errors, row of refusals
_NO_LOAD = 1e-17  # where mu N = 0 stands on a logarithmic axis

# colour, and how much of a mark is filled, which is read without colours
_LOOKS: dict[str, style.Look] = {
    HOLDS: {"color": "#0072B2", "fillstyle": "full"},
    DEGRADES: {"color": "#E69F00", "fillstyle": "left", "markeredgecolor": "#7A5200"},
    REFUSES: {"color": "#B03A2E", "fillstyle": "none"},
}
_MARKS = ("o", "s", "^", "D")


def read(path: Path) -> list[Row]:
    """Measurements of one panel."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def status(row: Row, most: float) -> str:
    """Status of a measurement; an error that is not a number has degraded."""
    if row["error"] == "":
        return REFUSES
    return HOLDS if float(row["error"]) <= most else DEGRADES


def most_of(panel: str, row: Row) -> float:
    """The largest error that holds."""
    if panel in ("friction", "step"):
        return MOST_POINTS
    return MOST_SAMPLED_MISS if panel == "processes" and row["order"] != "1" else MOST_MISS


def plot_processes(axes: Axes, rows: Sequence[Row]) -> None:
    """One order: length against std/mean, both laws, under the limits that refusals name."""
    order = rows[0]["order"]
    for index, (family, own) in enumerate(_families(rows)):
        for row in own:
            x = float(row["length"]) * (0.86, 1.16)[index]
            look = status(row, most_of("processes", row))
            _mark(axes, x, float(row["ratio"]), index, look)
        limits = sorted({(float(r["length"]), float(r["limit"])) for r in own if r["limit"]})
        if limits:
            axes.plot(*zip(*limits, strict=True), color="0.25", linestyle=("--", "-")[index],
                      linewidth=1.0, label=f"limit, {family}")  # fmt: skip
    if order == "1":
        axes.plot(list(THEORY), list(THEORY.values()), "k*", markersize=9,
                  label="exact, in theory", zorder=4)  # fmt: skip
    axes.set_yticks([0.2 * tick for tick in range(6)])
    rings = [(length, ratio) for length, own in zip(LENGTHS, _ORDERS, strict=True)
             for ratio in _RATIOS if order == str(own)]  # fmt: skip
    if rings:
        _ring(axes, rings)
    lengths = [float(row["length"]) for row in rows]
    axes.set(xscale="log", xlabel="correlation length L0", ylabel="std/mean",
             xlim=(min(lengths) / 2, 2 * max(lengths)), title=f"(a) positive, order {order}",
             ylim=(-0.03, 1.15))  # fmt: skip


def plot_orders(axes: Axes, rows: Sequence[Row]) -> None:
    """Order against length; the mark grows with the decades of the largest residual."""
    for index, (_, own) in enumerate(_families(rows)):
        for row in own:
            x = float(row["order"]) * (0.92, 1.09)[index]
            _mark(axes, x, float(row["length"]), index, status(row, MOST_MISS), _size(row))
    _ring(axes, list(zip(_ORDERS, LENGTHS, strict=True)))
    axes.set(xscale="log", yscale="log", xlabel="order M, or m_max", ylabel="correlation length L0",
             title="(d) processes of any sign")  # fmt: skip
    for miss in (1e-16, 1e-12, 1e-8):
        axes.plot([], [], "o", color="0.4", markersize=_size({"error": str(miss)}),
                  label=f"off by {miss:.0e}")  # fmt: skip
    _legend(axes, rows)


def plot_friction(axes: Axes, rows: Sequence[Row]) -> None:
    """Error of a slip fraction from no friction at all to sliders that never slip."""
    _plot_errors(axes, rows, lambda row: float(row["load"]) or _NO_LOAD, lambda row: "")
    for load in _LOADS:
        _paper_line(axes, load)
    ticks = [_NO_LOAD, *(10.0**power for power in range(-14, 9, 4))]
    axes.set(xscale="log", xlabel="friction limit mu N over rms force", xticks=ticks,
             title="(b) motion, friction")  # fmt: skip
    axes.set_xticks([], minor=True)
    axes.set_xticklabels(["0", *(f"$10^{{{power}}}$" for power in range(-14, 9, 4))])
    _legend(axes, rows)


def plot_steps(axes: Axes, rows: Sequence[Row]) -> None:
    """Error over the step times the highest stuck frequency: full lines by step, dotted by mass."""
    _plot_errors(axes, rows, lambda row: float(row["dt_omega"]), lambda row: row["varied"])
    _paper_line(axes, _DT_OMEGA)
    axes.axvline(2.0, color="0.4", linewidth=0.8, linestyle="--", label="limit, beta = 0")
    axes.set(xscale="log", xlabel="dt times highest frequency",
             title="(c) motion, time step (full: dt; dotted: a light mass)")  # fmt: skip
    _legend(axes, rows)


def _plot_errors(
    axes: Axes, rows: Sequence[Row], x_of: Callable[[Row], float], part_of: Callable[[Row], str]
) -> None:
    """A line per family and part, in points of percent; refusals stand in a row above."""
    for index, (_, own) in enumerate(_families(rows)):
        for part in sorted({part_of(row) for row in own}):
            line = sorted((r for r in own if part_of(r) == part), key=x_of)
            points = [(x_of(row), _height(row)) for row in line if row["error"] != ""]
            axes.plot(*zip(*points, strict=True), color="0.55", linewidth=0.8, zorder=1,
                      linestyle=":" if part == "mass" else "-")  # fmt: skip
            for row in line:
                _mark(axes, x_of(row), _height(row), index, status(row, MOST_POINTS))
    axes.axhline(MOST_POINTS, color="0.4", linewidth=0.8)
    decades = range(-10, 2, 2)
    axes.set(yscale="log", ylabel="error of a slip fraction [percentage points]",
             ylim=(_LEAST_POINTS / 3, 1e4),
             yticks=[_LEAST_POINTS, *(10.0**d for d in decades), _REFUSED_POINTS])  # fmt: skip
    axes.set_yticklabels(["less", *(f"$10^{{{d}}}$" for d in decades), "refused"])
    axes.set_yticks([], minor=True)


def _families(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Families with their rows, in the order of their first appearance."""
    names = dict.fromkeys(row["family"] for row in rows)
    yield from ((name, [row for row in rows if row["family"] == name]) for name in names)


def _height(row: Row) -> float:
    if row["error"] == "":
        return _REFUSED_POINTS
    return max(float(row["error"]), _LEAST_POINTS)


def _size(row: Row) -> float:
    """Size of a mark [points], from 2.5 at 1e-16 by decades."""
    error = float(row["error"] or 1e-12)
    return 2.5 + 0.5 * (math.log10(max(error, 1e-16)) + 16)


def _mark(axes: Axes, x: float, y: float, family: int, look: str, size: float = 4.2) -> None:
    axes.plot(x, y, _MARKS[family], markersize=size, markerfacecoloralt="white",
              markeredgewidth=0.7, **_LOOKS[look])  # fmt: skip


def _ring(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    axes.plot(*zip(*points, strict=True), "o", markersize=11, fillstyle="none", color="black",
              markeredgewidth=1.1, label="the paper's")  # fmt: skip


def _paper_line(axes: Axes, x: float) -> None:
    label = "the paper's" if "the paper's" not in axes.get_legend_handles_labels()[1] else None
    axes.axvline(x, color="black", linewidth=1.1, linestyle="-.", label=label, zorder=0)


def _handles(axes: Iterable[Axes], rows: Sequence[Row]) -> list[Artist]:
    """Families by their marks, then what else is labelled, each once."""
    families: list[Artist] = [
        Line2D([], [], color="0.4", marker=_MARKS[i], linestyle="none", label=family)
        for i, (family, _) in enumerate(_families(rows))
    ]
    others = {
        label: handle
        for each in axes
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True)
    }
    return [*families, *others.values()]


def _legend(axes: Axes, rows: Sequence[Row]) -> None:
    axes.legend(handles=_handles([axes], rows), ncols=2, fontsize=9, loc="upper center",
                bbox_to_anchor=(0.5, -0.14))  # fmt: skip


_PANELS = {"friction": plot_friction, "step": plot_steps, "order": plot_orders}
_TABLES = ("processes", *_PANELS)


def draw(tables: dict[str, list[Row]]) -> Figure:
    """Positive processes by order over the other panels; what colours and fillings mean."""
    picture = plt.figure(figsize=(14, 11))
    (above,), (below,) = picture.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 1.15))
    orders = dict.fromkeys(row["order"] for row in tables["processes"])
    panels = above.subplots(1, len(orders), sharey=True)
    for axes, order in zip(panels, orders, strict=True):
        plot_processes(axes, [row for row in tables["processes"] if row["order"] == order])
        axes.label_outer()
    above.legend(handles=_handles(panels, tables["processes"]), ncols=6, fontsize=9,
                 loc="outside lower center")  # fmt: skip
    for axes, (name, plot) in zip(below.subplots(1, len(_PANELS)), _PANELS.items(), strict=True):
        plot(axes, tables[name])
    looks = [
        Line2D([], [], marker="o", markersize=7, linestyle="none", markerfacecoloralt="white",
               label=look, **_LOOKS[look])
        for look in _LOOKS
    ]  # fmt: skip
    picture.legend(handles=looks, ncols=3, loc="outside upper center", fontsize=10)
    return picture


def save_small(picture: Figure, path: Path) -> None:
    """A PNG of few colours, fit to be kept with the sources."""
    drawn = io.BytesIO()
    picture.savefig(drawn, dpi=90)
    plt.close(picture)
    with Image.open(drawn) as full:
        write_small_png(path, full)


def _by_order(tables: dict[str, list[Row]]) -> Iterator[tuple[str, list[Row]]]:
    """The tables, that of positive processes cut by order."""
    for name, rows in tables.items():
        if name != "processes":
            yield name, rows
            continue
        for order in dict.fromkeys(row["order"] for row in rows):
            yield f"{name}, order {order}", [row for row in rows if row["order"] == order]


def summary(tables: dict[str, list[Row]]) -> str:
    """A Markdown table: of each family how many hold, degrade, refuse, and the largest error."""
    lines = [
        "| panel | | holds | degrades | refuses | largest error |",
        "|---|---|---|---|---|---|",
    ]
    for name, rows in _by_order(tables):
        for family, own in _families(rows):
            counts = Counter(status(row, most_of(name.split(",")[0], row)) for row in own)
            largest = max((float(row["error"]) for row in own if row["error"] != ""), default=0.0)
            numbers = " | ".join(str(counts[look]) for look in _LOOKS)
            lines.append(f"| {name} | {family} | {numbers} | {largest:.1e} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Draw the map and print its summary."""
    parser = Parser(prog="python -m entroslip.stability", description=__doc__)
    parser.add_argument("folder", type=Path, help="with the CSVs of bench/stability.py")
    parser.add_argument("--out", type=Path, required=True, help="the picture, a PNG")

    def draw_map() -> None:
        options = parser.parse_args(arguments)
        mpl.use("Agg")
        style.apply_style()
        tables = {name: read(options.folder / f"{name}.csv") for name in _TABLES}
        save_small(draw(tables), options.out)
        say(summary(tables))

    return exit_code(draw_map)


if __name__ == "__main__":
    raise SystemExit(main())
