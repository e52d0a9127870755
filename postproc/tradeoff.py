"""What accuracy costs in a scene: work-precision diagrams and the settings on the front."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from postproc import style
from postproc.figure import SECTIONS, Figure
from postproc.results import Results
from postproc.table import Table

_FLOOR = 1e-13  # smaller errors are rounding, and stand on the lower edge
_ERRORS = {
    "slip": "error of a slip fraction [points of %]",
    "band_ratio": "relative error of the band ratio",
}
_PARTS = (
    ("discretisation", "discretisation_slip", "discretisation_ratio"),
    ("time average", "time_slip", "time_ratio"),
    ("Monte Carlo", "samples_slip", "samples_ratio"),
)


def figures_of(results: Results) -> Iterator[Figure]:
    """Error over cost, of slip fractions and of band ratios."""
    data = _settings(results)
    if data is None:
        return
    shown = [name for name in _ERRORS if float(data[name].max()) > 0.0]
    yield Figure(
        "tradeoff", "Error and cost of the settings",
        "Numerical error, the largest over cases and oscillators, against the event method at"
        f" tolerance 1e-12 on the same samples ({int(data.attrs['n_steps'])} steps); processor time"
        " of one step of one sample. Points of a line differ in halvings or tolerance; bars are"
        " standard errors. The ring is the scene's own setting; nothing lies below and left of the"
        " grey line.",
        SECTIONS[-1],
        tuple(partial(plot_error_over_cost, data=data, error=name) for name in shown),
    )  # fmt: skip


def plot_error_over_cost(axes: Axes, data: xr.Dataset, error: str) -> None:
    """A line per method and step; bars reach one standard error up."""
    cost = data["cost"].values
    values = np.maximum(data[error].values, _FLOOR)
    own = data["is_own"].values == 1
    families = sorted(
        {(int(m), float(dt)) for m, dt in zip(data["method"], data["dt"], strict=True)}
    )
    for rank, (method, dt) in enumerate(families):
        member = (data["method"].values == method) & (data["dt"].values == dt)
        order = np.flatnonzero(member)[np.argsort(cost[member])]
        axes.errorbar(
            cost[order], values[order],
            yerr=(np.zeros(order.size), data[f"{error}_error"].values[order]),
            label=f"{'event' if method else 'newmark'}, dt {dt:.3g} s", elinewidth=0.7,
            **style.of_rank(rank, len(families)),
        )  # fmt: skip
    _mark_front(axes, cost, values)
    axes.plot(
        cost[own], values[own], "o", markersize=13, markerfacecolor="none",
        markeredgecolor="#D55E00", markeredgewidth=1.6, label="the scene's own", linestyle="none",
    )  # fmt: skip
    axes.set(
        xscale="log", yscale="log", ylabel=_ERRORS[error],
        xlabel="processor time of a sample-step [ns]",
    )  # fmt: skip
    for ticks in (axes.xaxis.set_major_formatter, axes.xaxis.set_minor_formatter):
        ticks("{x:g}")
    axes.legend(ncols=2)


def _mark_front(axes: Axes, cost: np.ndarray, values: np.ndarray) -> None:
    """Steps along what no other setting beats in both."""
    order = np.argsort(cost)
    least = np.minimum.accumulate(values[order])
    axes.step(cost[order], least, where="post", color="0.7", linewidth=3.0, zorder=0)


def tables_of(results: Results) -> Iterator[Table]:
    """The front with the scene's own setting, and what the error is made of now."""
    data = _settings(results)
    if data is None:
        return
    shown = data.isel(setting=np.flatnonzero((data["is_on_front"] == 1) | (data["is_own"] == 1)))
    rows = [_row(shown.isel(setting=i)) for i in np.argsort(shown["cost"].values)]
    yield Table(
        "tradeoff", "Settings that no other beats in cost and error",
        ("method", "dt [s]", "halvings", "tolerance", "slip [points]", "mean spectrum [%]",
         "band ratio [%]", "ns per sample-step", "march [s of a processor]", ""),
        rows, "Numerical errors, the largest over cases and oscillators.",
    )  # fmt: skip
    with xr.open_dataset(results.path, group="tradeoff/parts", engine="h5netcdf") as parts:
        yield Table(
            "tradeoff_parts", "What the error of the scene is made of",
            ("part", "mean slip [points]", "band ratio [%]"),
            [
                (name, f"{float(parts[slip]):.2g}", f"{100 * float(parts[ratio]):.2g}")
                for name, slip, ratio in _PARTS
            ],
            "Discretisation measured for the scene's own setting; the others are standard errors,"
            " estimated from batches of a march and from the scatter of samples.",
        )  # fmt: skip


def _row(setting: xr.Dataset) -> tuple[str, ...]:
    is_event = int(setting["method"]) == 1
    return (
        "event" if is_event else "newmark",
        f"{float(setting['dt']):.3g}",
        "-" if is_event else str(int(setting["max_halvings"])),
        f"{float(setting['tolerance']):.0e}" if is_event else "-",
        f"{float(setting['slip']):.2g}",
        f"{100 * float(setting['psd_mean']):.2g}",
        f"{100 * float(setting['band_ratio']):.2g}",
        f"{float(setting['cost']):.3g}",
        f"{float(setting['seconds']):.3g}",
        "the scene's own" if int(setting["is_own"]) == 1 else "",
    )


def _settings(results: Results) -> xr.Dataset | None:
    """Absent where only processes were compared."""
    data = results.tradeoff
    return data if data is not None and "slip" in data else None
