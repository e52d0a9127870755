"""The figures of the processes (Sec. 2), one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from postproc import style

LONGEST_LAG = 20  # drawn; the paper's figures end about there
MOST_CURVES = 8  # in one figure; of more orders only the even ones are drawn


def order_of(process: xr.Dataset) -> int:
    """M of the recursion, or m_max: as asked, or as chosen."""
    return int(process.sizes["order"])


def length_of(process: xr.Dataset) -> float:
    """The correlation length imposed."""
    return float(process.attrs["correlation_length"])


def plot_autocovariances(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Figs. 1 and 2: autocovariance over the lag, logarithmic, a curve per order."""
    orders = sorted({order_of(process) for process in processes})
    if len(orders) > MOST_CURVES:
        orders = [order for order in orders if order % 2 == 0]
        processes = [process for process in processes if order_of(process) in orders]
    for process in processes:
        order = order_of(process)
        curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
        positive = curve.where(curve > 0)
        look = style.of_rank(orders.index(order), len(orders))
        axes.semilogy(positive["lag"], positive, marker=".", label=f"{order}", **look)
    name = "$m_{max}$" if processes[0].attrs["method"] == "direct" else "order"
    _frame_lags(axes)
    axes.legend(title=name, ncols=2)


def plot_entropies(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 3: entropy per point over the order, with that of white noise (Eq. 42)."""
    for curve, look, label in _by_length(processes):
        axes.plot([order_of(p) for p in curve], [float(p["entropy"]) for p in curve],
                  label=label, **look)  # fmt: skip
    axes.axhline(float(processes[0]["entropy_bound"]), color="0.4", linewidth=0.9, zorder=0)
    axes.annotate(
        "white noise, Eq. 42", (0.98, float(processes[0]["entropy_bound"])),
        xycoords=("axes fraction", "data"), ha="right", va="top", fontsize=9, color="0.3",
    )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="order of the autoregressive model", ylabel="entropy per point [nat]")
    axes.legend()


def plot_achieved_lengths(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 4: the correlation length that was not imposed, over the order."""
    for curve, look, label in _by_length(processes):
        other = "L1" if curve[0].attrs["correlation"] == "L0" else "L0"
        axes.semilogy([order_of(p) for p in curve], [float(p[other]) for p in curve],
                      label=f"{_symbol(other)} at {label}", **look)  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="order of the autoregressive model", ylabel="correlation length achieved")
    axes.legend()


def plot_chosen_orders(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 5: one length imposed, the other bounded; the order follows."""
    for rank, process in enumerate(processes):
        curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
        label = f"{_imposed(process)}, {_bound(process)}: order {order_of(process)}"
        axes.plot(curve["lag"], curve, marker=".", label=label, **style.of_rank(rank, 3))
    _frame_lags(axes)
    axes.legend()


def plot_positive(axes: Axes, processes: Sequence[xr.Dataset]) -> None:
    """Fig. 6: without sign constraint, and positive with several means, by either law."""
    means = sorted({float(p.attrs["mean"]) for p in processes if int(p.attrs["positive"])})
    for process in processes:
        curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
        curve = curve / curve[0]
        if not int(process.attrs["positive"]):
            axes.plot(curve["lag"], curve, color="0.2", label="without sign constraint")
            continue
        mean, law = float(process.attrs["mean"]), str(process.attrs["sampler"])
        look = style.of_length(mean, means) | {"linestyle": "--" if law == "exact" else "none"}
        axes.plot(curve["lag"], curve, label=f"positive, mean {mean:g}, {law}", **look)
    _frame_lags(axes)
    axes.set_ylabel("autocovariance / variance")
    axes.legend()


def _by_length(
    processes: Sequence[xr.Dataset],
) -> list[tuple[list[xr.Dataset], dict[str, object], str]]:
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
                curves.append((sorted(curve, key=order_of), look, _imposed(curve[0])))
    return curves


def _symbol(definition: str) -> str:
    return f"${definition[0]}_{definition[1]}$"


def _imposed(process: xr.Dataset) -> str:
    return f"{_symbol(str(process.attrs['correlation']))} = {length_of(process):g}"


def _bound(process: xr.Dataset) -> str:
    other = "l1" if process.attrs["correlation"] == "L0" else "l0"
    return f"{_symbol(other.upper())} ≤ {float(process.attrs[f'bound_{other}']):g}"


def _frame_lags(axes: Axes) -> None:
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="lag", ylabel="autocovariance", xlim=(0, LONGEST_LAG))
