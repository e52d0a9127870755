"""The paper's statements on the processes of Sec. 2 (Figs. 1 to 6)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

from ..processes import (
    difference_from_free,
    is_maximum_entropy,
    is_positive,
    kind_of,
    length_of,
    model_of,
    order_of,
)  # fmt: skip
from ..results import Results
from .evidence import Finding, NoEvidence, Statement, all_hold, claim_range

ALIKE = 0.1  # a relative difference that the paper's figures would not show
CLOSE = 0.01  # "very close": difference of autocovariances over the variance
NEAR_WHITE = 0.01  # of the entropy of white noise, by which an entropy is near it [nat]
_EXACT = 1.0e-8  # the error of a process without sign constraint


def near_white_noise(results: Results) -> Statement:
    """Largest autocovariance beyond lag 0, from each order to the next."""
    findings = []
    for name, family in _families(results):
        sizes = [float(abs(_inside(process)).max()) for process in family]
        steps = [after - before for before, after in pairwise(sizes)]
        findings.append(_exact(f"{name}: largest step of max K", max(steps), below=0.0))
    return Statement(
        "S1", "The autocovariances fall as the order grows, towards white noise.",
        "Sec. 2.2 and 2.3, Figs. 1 and 2",
        "largest autocovariance beyond lag 0 falls with each order, for every method and length",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def shape_in_the_lag(number: str, lengths: Sequence[float]) -> Callable[[Results], Statement]:
    """The test that K of the direct method is constant or linear up to m_max, at some lengths."""

    def test(results: Results) -> Statement:
        findings = []
        for name, family in _families(results):
            last = family[-1]
            if last.attrs["method"] == "direct" and length_of(last) in lengths:
                curve = _inside(last)
                lag = np.arange(1, curve.size + 1)
                degree = 0 if last.attrs["correlation"] == "L0" else 1
                line = np.polyval(np.polyfit(lag, curve, degree), lag)
                apart = float(np.abs(curve - line).max() / curve.mean())
                text = f"{name}, m_max = {curve.size}: largest distance over mean K"
                findings.append(_exact(text, apart, below=ALIKE))
        of = " and ".join(f"{length:g}" for length in lengths)
        return Statement(
            number, f"At large m_max, K is constant up to m_max where L0 = {of} is imposed, and"
            f" grows linearly where L1 = {of} is.", "Sec. 2.2, Fig. 1",
            "direct method, highest m_max: K of lags 1 to m_max within 10 % of its mean from the"
            " best constant (L0) or straight line (L1)", tuple(findings), all_hold(findings),
        )  # fmt: skip

    return test


def order_needed(results: Results) -> Statement:
    """The smallest order whose entropy is near that of white noise."""
    needed = {}
    most = max((order_of(p) for p in _asked(results)), default=0)
    for definition, length, family in _regressive(results):
        enough = [
            order_of(process) for process in family
            if float(process["entropy_bound"] - process["entropy"]) < NEAR_WHITE
        ]  # fmt: skip
        needed[definition, length] = float(min(enough, default=most + 1))
    findings = []
    for definition in ("L0", "L1"):
        own = sorted(length for name, length in needed if name == definition)
        for short, long in pairwise(own):
            step = needed[definition, long] - needed[definition, short]
            text = f"{definition}: order needed at {long:g} less at {short:g}"
            findings.append(_exact(text, step, above=-0.5))
    for name, length in sorted(needed):
        if name == "L0" and ("L1", length) in needed:
            step = needed["L0", length] - needed["L1", length]
            findings.append(_exact(f"L0 less L1 at {length:g}", step, above=-0.5))
    return Statement(
        "S3", "The order needed to come near white noise rises with the correlation length, and is"
        " higher where L0 is imposed.", "Sec. 2.3, Fig. 3",
        f"smallest order within {NEAR_WHITE:g} nat of the entropy of white noise; {most + 1} where"
        " none that was solved is", tuple(findings), all_hold(findings),
    )  # fmt: skip


def other_length(results: Results) -> Statement:
    """The length that was not imposed, from each order to the next."""
    findings = []
    for definition, length, family in _regressive(results):
        other, sign = ("L1", 1.0) if definition == "L0" else ("L0", -1.0)
        values = [float(process[other]) for process in family]
        least = min(sign * (after - before) for before, after in pairwise(values))
        text = f"{definition} = {length:g}: least step of {other}"
        findings.append(_exact(text, sign * least, *((0.0,) if sign > 0 else (-np.inf, 0.0))))
    return Statement(
        "S4", "With L0 imposed L1 grows with the order; with L1 imposed L0 falls.",
        "Sec. 2.3, Fig. 4", "each step from one order to the next, for every length",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def order_six(results: Results) -> Statement:
    """L1 at order 6 where L0 = 0.3."""
    found = [
        float(process["L1"])
        for definition, length, family in _regressive(results)
        for process in family
        if (definition, length, order_of(process)) == ("L0", 0.3, 6)
    ]
    if not found:
        raise NoEvidence("no process of order 6 with L0 = 0.3")
    finding = _exact("L1 at order 6", found[0], below=1.0)
    return Statement(
        "S5", "L0 = 0.3 and L1 at most 1 lead to order 6.", "Sec. 2.3, on Fig. 4",
        "L1 at order 6 below 1, sums to infinity", (finding,), all_hold([finding]),
    )  # fmt: skip


def positive_processes(results: Results) -> Statement:
    """Largest difference over lags from the process without sign constraint, of the paper's law."""
    solved = _solved(results)
    free = {kind_of(p): p for p in solved if not is_positive(p)}
    findings = []
    for process in filter(is_positive, solved):
        twin = free.get(kind_of(process))
        if twin is None or process.attrs["sampler"] != "sequential":
            continue
        difference = difference_from_free(process, twin)
        lag = int(np.argmax(np.abs(difference["value"].values)))
        text = (
            f"L0 = {length_of(process):g}, {model_of(process)},"
            f" mean {process.attrs['mean']:g}: largest difference, lag {lag}"
        )
        value, error = (float(difference[name][lag]) for name in ("value", "error"))
        findings.append(claim_range(text, value, error, above=-CLOSE, below=CLOSE))
    return Statement(
        "S6", "Positive processes of means 2 and 3 have autocovariances very close to those without"
        " sign constraint.", "Sec. 2.4, Fig. 6",
        f"largest difference within {CLOSE:g} of the variance from the process of the same method,"
        " length and order, for every length and mean, values rejected one at a time as there",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def _exact(text: str, value: float, above: float = -np.inf, below: float = np.inf) -> Finding:
    return claim_range(text, value, _EXACT, above, below)


def _solved(results: Results) -> list[xr.Dataset]:
    if results.structure is not None:
        raise NoEvidence("not the processes of Sec. 2")
    return [
        p for p in results.processes.values()
        if p.attrs["status"] == "solved" and is_maximum_entropy(p)
    ]  # fmt: skip


def _asked(results: Results) -> list[xr.Dataset]:
    """Solved processes of one length without sign constraint, ascending in the order given."""
    found = [
        p for p in _solved(results)
        if not is_positive(p) and int(p.attrs["order"]) > 0 and p.attrs["correlation"] != "both"
    ]  # fmt: skip
    return sorted(found, key=order_of)


def _families(results: Results) -> Iterable[tuple[str, Sequence[xr.Dataset]]]:
    """Processes of one method and length, by order; a family has at least two."""
    groups: dict[str, list[xr.Dataset]] = {}
    for process in _asked(results):
        of = process.attrs
        method = "AR" if of["method"] == "autoregressive" else str(of["method"])
        name = f"{method}, {of['correlation']} = {of['correlation_length']:g}"
        groups.setdefault(name, []).append(process)
    return [(name, family) for name, family in sorted(groups.items()) if len(family) > 1]


def _regressive(results: Results) -> list[tuple[str, float, Sequence[xr.Dataset]]]:
    """Families of autoregressive processes, with their definition and length."""
    return [
        (
            str(family[0].attrs["correlation"]), float(family[0].attrs["correlation_length"]),
            family,
        )
        for name, family in _families(results) if name.startswith("AR")
    ]  # fmt: skip


def _inside(process: xr.Dataset) -> np.ndarray:
    """The autocovariance from lag 1 to the order."""
    return process["autocovariance"].values[1 : order_of(process) + 1]


ALL = (
    near_white_noise, shape_in_the_lag("S2a", (0.3,)), shape_in_the_lag("S2b", (1.0, 3.0)),
    order_needed, other_length, order_six, positive_processes,
)  # fmt: skip
