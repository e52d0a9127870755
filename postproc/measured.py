"""Measured values beside the process that was estimated from them: a figure of three panels."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from .figures import style
from .figures.figure import SECTIONS, Figure
from .output import InputError, read_text
from .results import Results

Records = list[NDArray[np.float64]]  # (point) of each joint line; NaN: not measured

FEWEST_COPIES = 40  # of the measurement, among the realizations: the least whose 2.5 % is any
_BLANK = str.maketrans(",;", "  ")
_LAGS = 8  # as `entroslip estimate` tests
_INNER = (0.025, 0.5, 0.975)
_MOST_RECORDS = 8  # drawn


def read_measured(path: Path) -> Records:
    """Records of a file that `entroslip estimate` read: one a line, or one value a line."""
    lines = read_text(path).splitlines()
    words = [re.split("[#!]", line)[0].translate(_BLANK).split() for line in lines]
    try:
        records = [np.array(row, dtype=float) for row in words if row]
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    if not records:
        raise InputError(f"{path}: holds no values")
    return [np.concatenate(records)] if all(row.size == 1 for row in records) else records


def measured_figure(records: Records, results: Results) -> Figure:
    """Values, correlation and distribution; shaded: 95 % of realizations at the same points."""
    solved = [p for p in results.processes.values() if p.attrs["status"] == "solved"]
    if len(solved) != 1:
        raise InputError(f"{results.path}: --measured wants one solved process, not {len(solved)}")
    copies = _copies(records, solved[0], results.path)
    return Figure(
        "measured", "Measured values beside the process estimated from them",
        "Above, the values along the joints, a line a record, with mean and standard deviation of"
        " the process. In the middle, their correlation over the distance. Below, the sorted values"
        f" over the medians of as many of the process. Shaded: 95 % of {len(copies)} realizations"
        " measured at the same points, an inner range for each lag or rank.",
        SECTIONS[0],
        (
            partial(plot_records, records=records, process=solved[0]),
            partial(plot_correlation, records=records, copies=copies, process=solved[0]),
            partial(plot_distribution, records=records, copies=copies),
        ),
        height=3.2,
    )  # fmt: skip


def plot_records(axes: Axes, records: Records, process: xr.Dataset) -> None:
    """Values along each joint line."""
    for rank, record in enumerate(records[:_MOST_RECORDS]):
        look = style.of_rank(rank, min(len(records), _MOST_RECORDS)) | {"linewidth": 1.0}
        axes.plot(np.arange(1, record.size + 1), record, label=f"record {rank + 1}", **look)
    mean, std = float(process.attrs["mean"]), float(process.attrs["std"])
    axes.axhline(mean, color="0.3", linewidth=0.9, label="mean")
    axes.axhspan(mean - std, mean + std, color="0.92", zorder=0, label="mean ± std")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="joint", ylabel="measured value")
    style.add_legend(axes)


def plot_correlation(
    axes: Axes, records: Records, copies: list[Records], process: xr.Dataset
) -> None:
    """Correlation of values some joints apart."""
    measured = correlation_of(records)
    lags = np.arange(1, measured.size + 1)
    low, _, high = np.nanquantile([correlation_of(copy) for copy in copies], _INNER, axis=0)
    axes.fill_between(lags, low, high, color="0.9", linewidth=0, label="95 % of realizations")
    curve = process["autocovariance"].values
    kept = lags[lags < curve.size]
    axes.plot(kept, curve[kept] / curve[0], label="process", **style.of_rank(0, 2))
    axes.plot(lags, measured, label="measured", **style.of_rank(1, 2) | {"color": "#D55E00"})
    axes.axhline(0.0, color="0.3", linewidth=0.9, zorder=0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="lag [joints]", ylabel="correlation")
    style.add_legend(axes)


def plot_distribution(axes: Axes, records: Records, copies: list[Records]) -> None:
    """Sorted values over the medians of the process, rank by rank."""
    low, middle, high = np.quantile([_sorted(copy) for copy in copies], _INNER, axis=0)
    axes.fill_between(middle, low, high, color="0.9", linewidth=0, label="95 % of realizations")
    axes.plot(middle, middle, color="0.3", linewidth=0.9, label="process")
    axes.plot(middle, _sorted(records), "o", color="#D55E00", markersize=3.5, label="measured")
    axes.set(xlabel="median of the process, rank by rank", ylabel="measured value")
    style.add_legend(axes)


def correlation_of(records: Records) -> NDArray[np.float64]:
    """Mean product of pairs over their mean square, lags 1 to 8 at most; NaN: no pair."""
    longest = min(_LAGS, max(record.size for record in records) - 1)
    mean = _sorted(records).mean()
    found = np.full(longest, np.nan)
    for lag in range(1, longest + 1):
        ends = [(row[lag:] - mean, row[:-lag] - mean) for row in records if row.size > lag]
        x, y = np.concatenate(ends, axis=1)
        pairs = np.isfinite(x * y)
        if pairs.any():
            found[lag - 1] = 2.0 * (x * y)[pairs].sum() / (x**2 + y**2)[pairs].sum()
    return found


def _copies(records: Records, process: xr.Dataset, path: Path) -> list[Records]:
    """Realizations of the process, each record of a copy one of them, with the gaps of the data."""
    n_points = max(record.size for record in records)
    wanted = FEWEST_COPIES * len(records)
    drawn = process["realizations"].values if "realizations" in process else np.empty((0, 0))
    if drawn.shape[0] < wanted or drawn.shape[1] < n_points:
        raise InputError(
            f"{path}: holds no {wanted} realizations of {n_points} points to lay the values beside:"
            f" --set process%n_points={n_points} --set process%n_realizations={10 * wanted}"
        )
    gaps = [np.where(np.isnan(record), np.nan, 0.0) for record in records]
    return [
        [row[: gap.size] + gap for row, gap in zip(drawn[first:], gaps, strict=False)]
        for first in range(0, drawn.shape[0] - len(records) + 1, len(records))
    ]


def _sorted(records: Records) -> NDArray[np.float64]:
    values = np.concatenate(records)
    return np.sort(values[~np.isnan(values)])
