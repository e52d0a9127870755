"""The cost of accuracy in a scene: work-precision diagrams and the settings on the front."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from .figures import style
from .figures.figure import SECTIONS, Figure
from .groups import open_group
from .processes import imposed_lengths, is_maximum_entropy
from .results import Results
from .table import Table, rounded, value_with_error

_FLOOR = 1e-13  # smaller errors are rounding, and stand on the lower edge
_ERRORS = {
    "slip": "error of a slip fraction [percentage points]",
    "band_ratio": "relative error of the band ratio",
}
_CHANGES = {  # from the highest order
    "slip_mean": "change of mean slip [points]",
    "slip_std": "change of its std [points]",
    "band_ratio": "relative change, band ratio",
}
_COMPONENTS = {"discretisation": "discretisation", "time average": "time", "Monte Carlo": "samples"}
_PUBLISHED = (
    ("slip", "mean slip [points]", 1.0),
    ("slip_std", "its std [points]", 1.0),
    ("psd_mean", "mean spectrum [%]", 100.0),
    ("psd_percentiles", "percentiles [%]", 100.0),
    ("ratio", "band ratio [%]", 100.0),
)


def figures_of(results: Results, processes: Mapping[str, xr.Dataset]) -> Iterator[Figure]:
    """Error over cost, of slip fractions and of band ratios; what orders of processes change."""
    data = _settings(results)
    if data is None:
        return
    shown = [name for name in _ERRORS if float(data[name].max()) > 0.0]
    if shown:
        yield Figure(
            "tradeoff", "Error and cost of the settings",
            "Numerical error, the largest over cases and joints, against the event method at"
            f" tolerance 1e-12 on the same samples ({int(data.attrs['n_steps'])} steps); processor"
            " time of one step of one sample. Points of a line differ in halvings or tolerance;"
            " bars are standard errors. The ring is the scene's own setting; nothing lies below and"
            " left of the grey line.",
            SECTIONS[-1],
            tuple(partial(plot_error_over_cost, data=data, error=name) for name in shown),
        )  # fmt: skip
    changes = _group(results, "variants")
    if changes is None:
        return
    yield Figure(
        "tradeoff_orders", "What the order of a process changes",
        "Change of what is published from the highest order of each process, on"
        f" {int(changes.attrs['n_samples'])} samples with the random numbers and the force in"
        " common, the largest over levels of force and joints; bars are standard errors. The"
        " ring is the scene's own order.",
        SECTIONS[-1],
        tuple(
            partial(plot_change_over_order, data=changes, name=name, names=_names(processes))
            for name in _CHANGES
        ),
        height=3.0,
    )  # fmt: skip


def _names(processes: Mapping[str, xr.Dataset]) -> dict[int, str]:
    """'$L_0$ = 0.3, std 0.1' of each process, by its number."""
    return {
        int(name[1:]): f"{style.with_symbols(imposed_lengths(of.attrs))}, std {of.attrs['std']:g}"
        for name, of in processes.items()
        if is_maximum_entropy(of)
    }


def plot_change_over_order(
    axes: Axes, data: xr.Dataset, name: str, names: Mapping[int, str]
) -> None:
    """A line per process."""
    compared = (data["is_of_fit"].values == 0) & (data["is_reference"].values == 0)
    numbers = np.unique(data["process"].values[compared])
    for rank, number in enumerate(numbers):
        rows = data.isel(variant=np.flatnonzero(compared & (data["process"].values == number)))
        axes.errorbar(
            rows["order"], np.abs(rows[name]), yerr=rows[f"{name}_error"], elinewidth=0.7,
            label=names.get(int(number), f"p{number:03d}"), **style.of_rank(rank, len(numbers)),
        )  # fmt: skip
        own = rows.isel(variant=np.flatnonzero(rows["is_own"].values == 1))
        axes.plot(own["order"], np.abs(own[name]), "o", markersize=11, markerfacecolor="none",
                  markeredgecolor="#D55E00", linestyle="none")  # fmt: skip
    axes.set(xlabel="order $M$, or $m_{max}$", ylabel=_CHANGES[name], xscale="log")
    orders = np.unique(data["order"].values[compared])
    axes.set_xticks(orders, [str(order) for order in orders])
    axes.set_xticks([], minor=True)
    axes.set_ylim(bottom=0.0)
    style.add_legend(axes)


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
        xlabel="processor time of a step of a sample [ns]",
    )  # fmt: skip
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    style.add_legend(axes)


def _mark_front(axes: Axes, cost: np.ndarray, values: np.ndarray) -> None:
    """Steps along what no other setting beats in both."""
    order = np.argsort(cost)
    least = np.minimum.accumulate(values[order])
    axes.step(cost[order], least, where="post", color="0.7", linewidth=3.0, zorder=0)


def tables_of(results: Results) -> Iterator[Table]:
    """Orders of processes, the front with the scene's own setting, and parts of the error now."""
    orders = None if results.tradeoff is None else _group(results, "orders")
    if orders is not None:
        yield Table(
            "tradeoff_entropy", "What orders lose of the entropy",
            ("process", "order", "entropy lost", "other length", "fit [ms of a processor]", ""),
            [_order_row(orders.isel(row=i)) for i in range(orders.sizes["row"])],
            "Entropy in nats per point below that of white noise, without a positivity constraint;"
            " the other length is the one that is not imposed.",
        )  # fmt: skip
    data = _settings(results)
    if data is None:
        return
    shown = data.isel(setting=np.flatnonzero((data["is_on_front"] == 1) | (data["is_own"] == 1)))
    rows = [_row(shown.isel(setting=i)) for i in np.argsort(shown["cost"].values)]
    yield Table(
        "tradeoff", "Settings that no other beats in cost and error",
        ("method", "dt [s]", "halvings", "tolerance", "slip [points]", "mean spectrum [%]",
         "band ratio [%]", "ns per sample-step", "march [s of a processor]", ""),
        rows, "Numerical errors, the largest over cases and joints; standard errors in"
        " brackets, in units of the last digits.",
    )  # fmt: skip
    errors = _group(results, "parts")
    if errors is not None:
        yield Table(
            "tradeoff_errors", "What the error of the scene is made of",
            ("component", *(title for _, title, _ in _PUBLISHED)),
            [
                (
                    title,
                    *(f"{f * float(errors[f'{name}_{of}']):.2g}" for of, _, f in _PUBLISHED),
                )
                for title, name in _COMPONENTS.items()
            ],
            "Discretisation measured for the scene's own setting; the others are standard errors,"
            " estimated from batches of a march and from the scatter of samples. Those of spectra"
            " are integrals over frequency, relative to that of the density.",
        )  # fmt: skip
    sizes = _group(results, "sizes")
    if sizes is not None:
        yield Table(
            "tradeoff_sizes", "The whole error by samples and steps",
            ("samples", "steps", "mean slip [points]", "its std [points]", "band ratio [%]",
             "march [s of a processor]"),
            [_size_row(sizes.isel(size=i)) for i in range(sizes.sizes["size"])],
            "Discretisation, time average and Monte Carlo together, by the laws that they follow.",
        )  # fmt: skip
    changes = _group(results, "variants")
    if changes is not None:
        yield Table(
            "tradeoff_variants", "What orders and lengths of fits change",
            ("process", "varied", "order", "steps of a batch", "fit [s of a processor]",
             "mean slip [points]", "its std [points]", "band ratio [%]", ""),
            [_variant_row(changes.isel(variant=i)) for i in range(changes.sizes["variant"])],
            "Against the highest order or the longest fit, random numbers and force in common; the"
            " largest over levels of force and joints, with its standard error.",
        )  # fmt: skip


def _size_row(size: xr.Dataset) -> tuple[str, ...]:
    return (
        str(int(size["n_samples"])), f"{float(size['n_steps']):.0f}",
        rounded(size["slip_mean"]), rounded(size["slip_std"]),
        rounded(100 * size["band_ratio"]), rounded(size["seconds"]),
    )  # fmt: skip


def _order_row(row: xr.Dataset) -> tuple[str, ...]:
    imposed, other = ("L1", "L0") if int(row["imposes_l1"]) == 1 else ("L0", "L1")
    method = "direct" if int(row["is_direct"]) == 1 else "autoregressive"
    return (
        f"{method}, {imposed} = {float(row['correlation_length']):g}", str(int(row["order"])),
        rounded(row["entropy_lost"]), f"{other} = {rounded(row['other_length'])}",
        rounded(row["milliseconds"], 2),
        "the scene's own" if int(row["is_own"]) == 1 else "",
    )  # fmt: skip


def _variant_row(variant: xr.Dataset) -> tuple[str, ...]:
    steps = int(variant["fit_steps"])
    changes = [
        value_with_error(scale * float(variant[name]), scale * float(variant[f"{name}_error"]))
        for name, scale in (("slip_mean", 1), ("slip_std", 1), ("band_ratio", 100))
    ]
    if int(variant["is_reference"]) == 1:
        changes = ["compared with", "", ""]
    return (
        f"p{int(variant['process']):03d}", "fit" if int(variant["is_of_fit"]) == 1 else "order",
        str(int(variant["order"])), str(steps) if steps else "chosen",
        rounded(variant["seconds"], 2), *changes,
        "the scene's own" if int(variant["is_own"]) == 1 else "",
    )  # fmt: skip


def _row(setting: xr.Dataset) -> tuple[str, ...]:
    is_event = int(setting["method"]) == 1
    return (
        "event" if is_event else "newmark",
        rounded(setting["dt"]),
        "-" if is_event else str(int(setting["max_halvings"])),
        f"{float(setting['tolerance']):.0e}" if is_event else "-",
        _error_of(setting, "slip", 1.0),
        rounded(100 * setting["psd_mean"], 2),
        _error_of(setting, "band_ratio", 100.0),
        rounded(setting["cost"]),
        rounded(setting["seconds"]),
        "the scene's own" if int(setting["is_own"]) == 1 else "",
    )


def _error_of(setting: xr.Dataset, name: str, scale: float) -> str:
    """A measured error with its own."""
    value, error = float(setting[name]), float(setting[f"{name}_error"])
    return value_with_error(scale * value, scale * error) if error > 0.0 else f"{scale * value:.2g}"


def _group(results: Results, name: str) -> xr.Dataset | None:
    """A group of the tradeoff; absent where nothing of the kind was compared."""
    try:
        return open_group(results.path, f"tradeoff/{name}").load()
    except KeyError:  # no such group
        return None


def _settings(results: Results) -> xr.Dataset | None:
    """Absent where only processes were compared."""
    data = results.tradeoff
    return data if data is not None and "slip" in data else None
