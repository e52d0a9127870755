"""The figures of the processes (Sec. 2), one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from ..processes import (
    LONGEST_LAG,
    correlation_of,
    difference_from_free,
    imposed_lengths,
    is_positive,
    length_of,
    order_of,
    scale_name,
    scale_of,
)  # fmt: skip
from . import style

MOST_CURVES = 8  # in one figure
MOST_REALIZATIONS = 3  # drawn
_ORDER = 1  # its place among the facts of a process
_ZERO = 1.0e-9  # of an autocovariance, relative to the variance: exact to 1e-8 and better
_PALE = 0.3  # what no equation constrains


def plot_autocovariances(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Figs. 1 and 2: size of the autocovariance over the lag, a curve per order.

    Open marks where it is negative; lags at which it is zero are named. The direct method (Eq. 11)
    constrains lags up to m_max alone: those beyond are pale.
    """
    for rank, process in enumerate(sorted(processes, key=order_of)):
        order = order_of(process)
        curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
        size = abs(curve).where(abs(curve) > _ZERO * curve[0])
        look = style.of_rank(rank, len(processes))
        is_direct = process.attrs["method"] == "direct"
        own = size.isel(lag=slice(0, order + 1)) if is_direct else size
        axes.semilogy(own["lag"], own, label=f"{order}{_zeros(size)}", **look)
        if is_direct:
            beyond = size.isel(lag=slice(order, None))
            axes.semilogy(beyond["lag"], beyond, **look | {"marker": "none", "alpha": _PALE})
        below = own.where(curve < 0)
        axes.semilogy(below["lag"], below, **look | {"linestyle": "none", "markerfacecolor": "w"})
    name = "$m_{max}$" if processes[0].attrs["method"] == "direct" else "order"
    _frame_lags(axes)
    if any((process["autocovariance"] < 0).any() for process in processes):
        axes.set_ylabel("size of the autocovariance")
        axes.plot([], [], "o", color="0.3", markerfacecolor="w", label="negative")
    style.add_legend(axes, name)


def _zeros(size: xr.DataArray) -> str:
    """' (0 at lags 1, 2)' of a curve that vanishes there; nothing of others."""
    lags = [str(int(lag)) for lag in size["lag"][np.isnan(size.values)]]
    return f" (0 at lag{'s' if len(lags) > 1 else ''} {', '.join(lags)})" if lags else ""


def plot_entropies(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 3: entropy per point over the order, with that of white noise (Eq. 42).

    All at the std of the first process: another one adds the logarithm of their ratio.
    """
    bound = float(processes[0]["entropy_bound"])
    name = f"$S_{{max}}$, Eq. 42, std {scale_of(processes[0])[1]:g}"
    axes.axhline(bound, color="0.3", linewidth=0.9, zorder=0, label=name)
    for curve, look, label in _by_length(processes):
        entropies = [bound + float(p["entropy"] - p["entropy_bound"]) for p in curve]
        axes.plot([order_of(p) for p in curve], entropies, label=label, **look)
    _frame_orders(axes)
    axes.set_ylabel("entropy per point [nat]")
    style.add_legend(axes)


def plot_achieved_lengths(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 4: the correlation length that was not imposed, over the order."""
    for curve, look, label in _by_length(processes):
        other = "L1" if curve[0].attrs["correlation"] == "L0" else "L0"
        axes.semilogy([order_of(p) for p in curve], [float(p[other]) for p in curve],
                      label=f"{style.with_symbols(other)} at {label}", **look)  # fmt: skip
    _frame_orders(axes)
    axes.set_ylabel("correlation length achieved [lag]")
    style.add_legend(axes)


def plot_chosen_orders(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 5: one length imposed, the other bounded; the order follows."""
    lengths = [length_of(process) for process in processes]
    for process in processes:
        curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
        bounds = "".join(
            f", {_bound(process, name)}" for name in ("l0", "l1")
            if process.attrs.get(f"bound_{name}", 0.0) > 0.0
        )  # fmt: skip
        order = "$m_{max}$" if process.attrs["method"] == "direct" else "order"
        label = f"{_imposed(process)}{bounds}: {order} {order_of(process)}"
        look = style.of_length(length_of(process), lengths)
        if process.attrs["correlation"] == "L1":
            look |= {"linestyle": "--", "markerfacecolor": "w"}
        axes.semilogy(curve["lag"], abs(curve), label=label, **look)
    _frame_lags(axes)
    style.add_legend(axes)


def plot_positive(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 6: without sign constraint, and positive of several means and stds, by either law."""
    positive = [process for process in processes if is_positive(process)]
    for process in processes:
        curve = correlation_of(process)
        label, look = _look_of_law(process, positive)
        axes.plot(curve["lag"], curve, label=label, **look)
    _frame_lags(axes)
    axes.set_ylabel("autocovariance / variance")
    style.add_legend(axes)


def plot_each(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Autocovariances over the variance, a curve per process, named by what differs."""
    drawn = style.some_of(processes, MOST_CURVES)
    facts = [_facts(process) for process in drawn]
    differing = [place for place, of in enumerate(zip(*facts, strict=True)) if len(set(of)) > 1]
    for rank, process in enumerate(drawn):
        label = ", ".join(facts[rank][place] for place in differing or [_ORDER])
        curve = correlation_of(process)
        axes.plot(curve["lag"], curve, label=label, **style.of_rank(rank, len(drawn)))
    _frame_lags(axes)
    axes.set_ylabel("autocovariance / variance")
    style.add_legend(axes)


def _facts(process: xr.Dataset) -> tuple[str, ...]:
    """Facts that may differ from process to process, the order at _ORDER."""
    of = process.attrs
    numbers = (f"{name} {float(of[name]):g}" for name in ("mean", "std"))
    return _imposed(process), f"order {order_of(process)}", *numbers, str(of["sampler"])


def plot_positive_difference(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 6, enlarged: differences from the process without sign constraint, two s.e. as bars."""
    free = next(process for process in processes if not is_positive(process))
    positive = [process for process in processes if is_positive(process)]
    for process in positive:
        difference = difference_from_free(process, free)
        label, look = _look_of_law(process, positive)
        axes.errorbar(difference["lag"], difference["value"], yerr=2.0 * difference["error"],
                      label=label, elinewidth=0.8, **look)  # fmt: skip
    axes.axhline(0.0, color="0.3", linewidth=0.9, zorder=0)
    _frame_lags(axes)
    axes.set_ylabel("difference")
    style.add_legend(axes)


def plot_realizations(axes: Axes, process: xr.Dataset) -> None:
    """A few realizations of a process, point by point."""
    drawn = process["realizations"].isel(realization=slice(0, MOST_REALIZATIONS))
    marker = "none" if drawn.shape[1] > 1 else "o"
    for rank, curve in enumerate(drawn):
        look = style.of_rank(rank, len(drawn)) | {"marker": marker, "linewidth": 1.0}
        axes.plot(np.arange(1, curve.size + 1), curve, **look)
    axes.axhline(float(process.attrs["mean"]), color="0.3", linewidth=0.9, label="mean")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="point", ylabel="value", xlim=(1, max(2, drawn.shape[1])))
    style.add_legend(axes)


def _look_of_law(process: xr.Dataset, positive: Sequence[xr.Dataset]) -> tuple[str, style.Look]:
    if not is_positive(process):
        return "without sign constraint", {"color": "0.2"}
    law = str(process.attrs["sampler"])
    scales = sorted({scale_of(p) for p in positive})
    rank = scales.index(scale_of(process))
    look = style.of_rank(rank, max(len(scales), 2))
    look |= {"markersize": 9 - 4 * min(rank, 1), "markerfacecolor": "none"}  # one inside the other
    look |= {"linestyle": "none"} if law == "sequential" else {"linestyle": "--", "marker": "x"}
    return f"positive, {scale_name(process, positive)}, {law}", look


def _by_length(
    processes: Sequence[xr.Dataset],
) -> list[tuple[list[xr.Dataset], style.Look, str]]:
    """One curve per imposed length, ascending in the order: L0 full lines, L1 dashed."""
    lengths = [length_of(process) for process in processes]
    curves = []
    for definition, line in (("L0", "-"), ("L1", "--")):
        for length in sorted(set(lengths)):
            curve = [
                p for p in processes
                if p.attrs["correlation"] == definition and length_of(p) == length
            ]  # fmt: skip
            if curve:
                look = style.of_length(length, lengths) | {"linestyle": line}
                if definition == "L1":
                    look["markerfacecolor"] = "none"
                curves.append((sorted(curve, key=order_of), look, _imposed(curve[0])))
    return curves


def _imposed(process: xr.Dataset) -> str:
    return style.with_symbols(imposed_lengths(process.attrs))


def _bound(process: xr.Dataset, name: str) -> str:
    side = str(process.attrs.get("bound_side", "automatic"))
    is_lower = side == "lower" or (side == "automatic" and name == "l0")
    length = style.with_symbols(name.upper())
    bound = f"{float(process.attrs[f'bound_{name}']):g}"
    if "upper_bound" in process.attrs:
        return f"{bound} ≤ {length} ≤ {float(process.attrs['upper_bound']):g}"
    return f"{length} {'≥' if is_lower else '≤'} {bound}"


def _frame_orders(axes: Axes) -> None:
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    axes.set_xlabel("order of the autoregressive model")


def _frame_lags(axes: Axes) -> None:
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="lag", ylabel="autocovariance", xlim=(0, LONGEST_LAG))
