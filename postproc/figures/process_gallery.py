"""The figures of processes (Sec. 2) that results files have data for, each with what to see."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial

import xarray as xr

from ..processes import (
    Kind,
    difference_from_free,
    imposed_lengths,
    is_maximum_entropy,
    is_positive,
    kind_of,
    length_of,
    model_of,
    order_of,
    scale_name,
    scale_of,
)
from ..results import Results
from . import process_figures, style
from .figure import SECTIONS, Figure

_PROCESSES = SECTIONS[0]
_MOST_REALIZED = 4  # processes with a figure of their realizations


def of_processes(results: Results) -> Iterator[Figure]:
    """Figs. 1 to 6, of processes that a scene without chain solved."""
    if results.structure is not None:
        return
    processes = [p for p in results.processes.values() if is_maximum_entropy(p)]
    solved = [p for p in processes if p.attrs["status"] == "solved"]
    all_free = [p for p in solved if not is_positive(p)]
    first = {kind_of(p): scale_of(p) for p in reversed(all_free)}
    free = [p for p in all_free if scale_of(p) == first[kind_of(p)]]
    omitted = " Other means and stds change the scale alone." if len(free) < len(all_free) else ""
    asked = [p for p in free if int(p.attrs["order"]) > 0]
    of_both = [p for p in asked if p.attrs["correlation"] == "both"]
    of_one = [p for p in asked if p.attrs["correlation"] != "both"]
    regressive = [p for p in of_one if p.attrs["method"] == "autoregressive"]
    for number, method, family in (
        (1, "direct method", [p for p in of_one if p.attrs["method"] == "direct"]),
        (2, "autoregressive", regressive),
    ):
        for name, length, panel in _length_panels(family):
            yield Figure(
                f"fig_{number:02d}{name}",
                f"Fig. {number}{name[0]}. Autocovariance, {method}, {length}",
                _shape_of_covariances(panel) + omitted,
                _PROCESSES, (partial(process_figures.plot_autocovariances, processes=panel),),
                ("S1",) if method == "autoregressive" else ("S1", "S2a", "S2b"),
            )  # fmt: skip
    if len({order_of(p) for p in regressive}) > 1:
        yield Figure(
            "fig_03", "Fig. 3. Entropy over the order",
            "The order needed to come near white noise rises with the correlation length, and is"
            " higher where L0 is imposed (full lines) than where L1 is (dashed).",
            _PROCESSES, (partial(process_figures.plot_entropies, processes=regressive),),
            ("S3",),
        )  # fmt: skip
        yield Figure(
            "fig_04", "Fig. 4. The correlation length that was not imposed",
            "With L0 imposed (full lines) L1 grows with the order; with L1 imposed (dashed) L0"
            " falls. Infinite sums. The paper reads off its figure that 6 is the largest order with"
            " L0 = 0.3 and L1 at most 1; here it is 5: at order 6 L1 is 1.03.",
            _PROCESSES, (partial(process_figures.plot_achieved_lengths, processes=regressive),),
            ("S4", "S5"),
        )  # fmt: skip
    chosen = [p for p in free if int(p.attrs["order"]) == 0]
    if chosen:
        yield Figure(
            "fig_05", "Fig. 5. One length imposed, the other bounded",
            "In the legend: the length imposed, the bounds on the other one, and the order that"
            " follows from them.",
            _PROCESSES, (partial(process_figures.plot_chosen_orders, processes=chosen),),
        )  # fmt: skip
    if of_both:
        yield _each("both_lengths", "Autocovariances of processes of both lengths", of_both)
    refused = [p for p in processes if p.attrs["status"] == "infeasible"]
    yield from _positive(solved, asked, refused)
    yield from _realizations(results)


def _realizations(results: Results) -> Iterator[Figure]:
    """A figure of each process with realizations; of many processes some that look different."""
    drawn = {name: p for name, p in results.processes.items() if "realizations" in p}
    shown, some = list(drawn), ""
    if len(drawn) > _MOST_REALIZED:
        last = {(imposed_lengths(p.attrs), is_positive(p)): name for name, p in drawn.items()}
        shown = style.some_of(list(last.values()), _MOST_REALIZED)
        some = f" {len(shown)} of {len(drawn)} processes, of different length or sign."
    for name in shown:
        process = drawn[name]
        yield Figure(
            f"realizations_{name}",
            f"Realizations of process {name}, {imposed_lengths(process.attrs)}",
            f"The first of the realizations that the scene asked for, and the mean.{some}",
            _PROCESSES, (partial(process_figures.plot_realizations, process=process),),
        )  # fmt: skip


def _positive(
    solved: list[xr.Dataset], asked: list[xr.Dataset], refused: list[xr.Dataset]
) -> Iterator[Figure]:
    """Fig. 6: positive processes of one method, length and order beside the free one; or alone."""
    positive = [p for p in solved if is_positive(p)]
    if not positive:
        return
    kinds = sorted(
        {kind_of(p) for p in positive},
        key=lambda kind: (kind[0] == "direct", -kind[2], -kind[3]),
    )  # L0 = 3 of order 10 first, as the paper
    twins = {kind_of(p): p for p in asked}
    if not set(kinds) <= set(twins):
        yield _each("positive", "Autocovariances of positive processes", positive)
        return
    for kind in kinds:
        own = [p for p in positive if kind_of(p) == kind]
        not_drawn = [p for p in refused if is_positive(p) and kind_of(p) == kind]
        yield _beside_free(twins[kind], own, not_drawn, _name_of(kind, kinds))


def _name_of(kind: Kind, kinds: list[Kind]) -> str:
    """fig_06 of the first; others have what sets them apart: method, length, order."""
    method, _, length, order = kind
    if kind == kinds[0]:
        return "fig_06"
    if method == "direct":
        return f"fig_06_direct_{length:g}_{order}"
    return f"fig_06_{length:g}" if order == kinds[0][3] else f"fig_06_{length:g}_{order}"


def _beside_free(
    free: xr.Dataset, positive: list[xr.Dataset], refused: list[xr.Dataset], name: str
) -> Figure:
    """Fig. 6 of one method, length and order."""
    largest = "; ".join(
        f"{float(abs(difference_from_free(p, free)['value']).max()):.2g}"
        f" at {scale_name(p, [*positive, *refused])} ({p.attrs['sampler']})"
        for p in positive
    )
    missing = "".join(
        f" Not drawn, {scale_name(p, [*positive, *refused])} ({p.attrs['sampler']}):"
        f" {p.attrs['reason']}."
        for p in refused
    )
    imposed = imposed_lengths(free.attrs)
    return Figure(
        name,
        f"Fig. 6. Positive processes and the one without sign constraint, {imposed},"
        f" {model_of(free)}",
        f"Autocovariances of positive processes, {_laws(positive)}, beside that of the process"
        " without sign constraint. Below: the differences, with bars of two standard errors that"
        " include the scatter of fits. The paper finds them very close. The largest differences:"
        f" {largest}.{missing}",
        _PROCESSES,
        (
            partial(process_figures.plot_positive, processes=[free, *positive]),
            partial(process_figures.plot_positive_difference, processes=[free, *positive]),
        ), statements=("S6",), height=3.6,
    )  # fmt: skip


def _laws(positive: list[xr.Dataset]) -> str:
    """'by the sequential law (open marks) and by the exact law (dashed)', those that there are."""
    marks = {"sequential": "open marks", "exact": "dashed"}
    laws = {str(process.attrs["sampler"]) for process in positive}
    return " and ".join(f"by the {law} law ({marks[law]})" for law in marks if law in laws)


def _shape_of_covariances(panel: list[xr.Dataset]) -> str:
    """Change of the curves of one length with the order and with the lag, in numbers."""
    orders = [order_of(process) for process in panel]
    sizes = [
        abs(process["autocovariance"].values[1 : order + 1])
        for process, order in zip(panel, orders, strict=True)
    ]
    name = "m_max" if panel[0].attrs["method"] == "direct" else "order"
    first = f"goes from {sizes[0].max():.3g} at {name} {orders[0]} to" if len(orders) > 1 else "is"
    said = (
        f"The largest value beyond lag 0 {first} {sizes[-1].max():.3g} at {name} {orders[-1]},"
        f" where lag 1 has {sizes[-1][0]:.3g} and lag"
        f" {orders[-1]} {sizes[-1][-1]:.3g}"
    )
    if name == "m_max":
        shape = "constant" if panel[0].attrs["correlation"] == "L0" else "linear"
        said += f" (the paper: {shape} in the lag up to m_max)"
    said += ". Exact to 1e-8."
    if name == "m_max":
        said += " Pale: lags beyond m_max, which Eq. 11 does not constrain."
    if any((process["autocovariance"] < 0).any() for process in panel):
        said += " Open marks: negative values."
    return said


def _each(name: str, title: str, processes: list[xr.Dataset]) -> Figure:
    """A curve for each process, or for as many as can be told apart."""
    count, most = len(processes), process_figures.MOST_CURVES
    drawn = "all" if count <= most else f"{most} of the {count}"
    return Figure(
        name, title, f"Over the variance, {drawn} that were solved.",
        _PROCESSES, (partial(process_figures.plot_each, processes=processes),),
    )  # fmt: skip


def _length_panels(processes: list[xr.Dataset]) -> Iterator[tuple[str, str, list[xr.Dataset]]]:
    """Panel a: L0, b: L1, for the smallest length; the other lengths carry theirs in the name."""
    lengths = sorted({length_of(p) for p in processes})
    asked = Counter(int(p.attrs["order"]) for p in processes)
    for length in lengths:
        for letter, definition in (("a", "L0"), ("b", "L1")):
            panel = [
                p for p in processes
                if p.attrs["correlation"] == definition
                and length_of(p) == length
                and (len(lengths) == 1 or asked[int(p.attrs["order"])] > 1)  # as its siblings have
            ]  # fmt: skip
            if panel:
                suffix = "" if length == lengths[0] else f"_{length:g}"
                yield letter + suffix, f"{definition} = {length:g}", _some_orders(panel)


def _some_orders(panel: list[xr.Dataset]) -> list[xr.Dataset]:
    """All by ascending order; of more than can be told apart the even ones if most are even."""
    ascending = sorted(panel, key=order_of)
    even = [process for process in ascending if order_of(process) % 2 == 0]
    if 2 * len(even) > len(panel) > process_figures.MOST_CURVES:
        ascending = even
    return style.some_of(ascending, process_figures.MOST_CURVES)
