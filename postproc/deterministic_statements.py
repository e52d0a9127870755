"""The paper's statements on the chain with friction certain (Table 2, Fig. 8, the transition)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from . import peaks
from .evidence import NoEvidence, Statement, all_hold, claim_range
from .paper import LEVELS
from .results import Case, Results

LOW, HIGH = LEVELS  # the two variances of the excitation
FULLY = 0.05  # a slider that slips (or sticks) less than that is fully stuck (or slipping)
GONE = float(np.log(1.1))  # a peak that rises less


def order_of_joints(results: Results) -> Statement:
    """Slip fractions along the chain, friction certain (Table 2)."""
    cases = [case for case in results.deterministic if case.variance in LEVELS]
    if {case.variance for case in cases} != set(LEVELS) or len(cases) != len(LEVELS):
        raise NoEvidence("not the cases that the paper speaks of")
    findings = []
    for case in cases:
        slip, error = slip_with_error(case)
        for i in range(case.n_dof - 1):
            text = f"{case.variance:g}: joint {i + 2} less {i + 1}"
            both = float(np.hypot(error[i], error[i + 1]))
            findings.append(claim_range(text, float(slip[i + 1] - slip[i]), both, above=0.0))
    return Statement(
        "6a", "The time in slip falls monotonically from the driven joint to the one at the"
        " wall, at both variances.", "Sec. 3, Table 2",
        "each neighbouring pair; errors of the time average",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def peaks_without_uncertainty(results: Results) -> Statement:
    """Prominence at the stuck frequencies, and the share of power outside their band."""
    cases = {case.variance: case for case in results.deterministic if case.has("psd")}
    if results.chain is None or set(cases) != set(LEVELS):
        raise NoEvidence("not the cases that the paper speaks of")
    stuck = results.chain["frequencies_stuck"].values
    value, error = {}, {}
    for variance in LEVELS:
        data = cases[variance].data
        weights = peaks.prominence_weights(data["frequency"].values, stuck)
        value[variance] = float((weights @ np.log(data["psd"].isel(sample=0).values)).mean())
        error[variance] = peaks.error_of_sum(weights, peaks.scatter_of_ln_psd(data))
    findings = [
        claim_range(f"ln prominence at {LOW:g}", value[LOW], error[LOW], above=0.0),
        claim_range(f"ln prominence at {HIGH:g}", value[HIGH], error[HIGH], below=GONE),
    ]
    share = {v: peaks.share_outside(cases[v].data, stuck[0], stuck[-1]) for v in LEVELS}
    for i in range(stuck.size):
        gain = float(share[HIGH][0][i] - share[LOW][0][i])
        both = float(np.hypot(share[HIGH][1][i], share[LOW][1][i]))
        text = f"gain of the share out of band, joint {i + 1}"
        findings.append(claim_range(text, gain, both, above=0.0))
    return Statement(
        "7", f"Clear peaks stand at the stuck frequencies at {LOW:g}; at {HIGH:g} they are gone,"
        " and energy has moved out of the band of these frequencies.", "Sec. 3, Fig. 8",
        "mean of ln psd within 0.03 Hz of the stuck frequencies above that out to 0.09 Hz, over"
        " modes and joints: positive, then below 10 %; share of power out of band larger for"
        " each joint; errors of the Welch estimate", tuple(findings), all_hold(findings),
    )  # fmt: skip


def sweep(results: Results) -> Statement:
    """From the smallest to the largest variance of a sweep without uncertainty."""
    cases = sorted(results.deterministic, key=lambda case: case.variance)
    if len({case.variance for case in cases}) < 4 or len(cases) != len(results.cases):
        raise NoEvidence("not the cases that the paper speaks of")
    slips = [slip_with_error(case) for case in cases]
    findings = []
    for i in range(cases[0].n_dof):
        (first, error), (last, last_error) = ((s[i], e[i]) for s, e in (slips[0], slips[-1]))
        name = f"joint {i + 1} at {{:g}}"
        findings += [
            claim_range(name.format(cases[0].variance), float(first), float(error), below=FULLY),
            claim_range(
                name.format(cases[-1].variance), float(last), float(last_error), above=1.0 - FULLY
            ),
        ]
    for (one, other), (a, b) in zip(pairwise(slips), pairwise(cases), strict=True):
        step, error = other[0].mean() - one[0].mean(), np.hypot(one[1].max(), other[1].max())
        text = f"mean rise, {a.variance:g} to {b.variance:g}"
        findings.append(claim_range(text, float(step), float(error), above=-0.01))
    return Statement(
        "8", "As the variance grows the chain goes from fully stuck to fully slipping.", "Sec. 3",
        f"slip below {FULLY:g} at the smallest and above {1 - FULLY:g} at the largest variance,"
        " no fall of more than 0.01 between; errors of the time average",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def slip_with_error(case: Case) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slip fractions of the first sample and the errors of these time averages.

    The file's, from the autocovariance of the time in slip; where it has none, that of slips and
    sticks of exponential durations in turn: of a fraction p over n slips, p (1 - p) sqrt(2/n).
    """
    data = case.data.isel(sample=0)
    slip = data["slip_fraction"].values.astype(float)
    count = np.maximum(data["slip_starts"].values.astype(float), 1.0)
    error = slip * (1.0 - slip) * np.sqrt(2.0 / count)
    if "slip_fraction_error" in data:
        measured = data["slip_fraction_error"].values.astype(float)
        error = np.where(np.isfinite(measured), measured, error)
    return slip, error


ALL = (order_of_joints, peaks_without_uncertainty, sweep)
