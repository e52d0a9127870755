"""The paper's statements on the chain with friction certain (Table 2, Fig. 8, the transition)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..joints import slip_with_error
from ..results import Case, Results
from . import peaks
from .evidence import NoEvidence, Statement, all_hold, any_holds, claim_larger, claim_range
from .printed import LEVELS
from .study import cases_with_spectra

LOW, HIGH = LEVELS  # the two variances of the excitation
FULLY = 0.05  # a slider that slips (or sticks) less than that is fully stuck (or slipping)
DISTINCT = 0.05  # relative distance from any stuck frequency of a slip frequency that is its own
GONE = float(np.log(1.1))  # a peak that rises less


def order_of_joints(results: Results) -> Statement:
    """Slip fractions along the chain, friction certain (Table 2)."""
    cases = [case for case in results.deterministic if case.variance in LEVELS]
    if {case.variance for case in cases} != set(LEVELS) or len(cases) != len(LEVELS):
        raise NoEvidence("not the cases that the paper speaks of")
    findings = []
    for case in cases:
        slip, error = slip_with_error(case)
        for i in range(case.n_joints - 1):
            text = f"{case.variance:g}: joint {i + 2} less {i + 1}"
            both = float(np.hypot(error[i], error[i + 1]))
            findings.append(claim_range(text, float(slip[i + 1] - slip[i]), both, above=0.0))
    return Statement(
        "6a", "The time in slip falls monotonically from the driven joint to the one at the"
        " wall, at both variances.", "Sec. 3, Table 2",
        "each neighbouring pair; errors of the time average",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def peaks_at_low_level(results: Results) -> Statement:
    """A local maximum at each stuck frequency, in the spectrum of any mass; how far peaks shift."""
    cases, stuck = _cases_with_spectra(results)
    data = cases[LOW].data
    frequency, ln_psd = data["frequency"].values, np.log(data["psd"].isel(sample=0).values)
    scatter = peaks.scatter_of_ln_psd(data)
    findings = []
    for mode, hertz in enumerate(stuck, start=1):
        rises = [
            peaks.local_maximum(frequency, ln_psd[:, i], hertz, scatter)
            for i in range(ln_psd.shape[1])
        ]
        best = min(range(len(rises)), key=lambda i: rises[i].p_for)
        nearest = peaks.nearest_maximum(frequency, ln_psd[:, 0], hertz)
        text = f"mode {mode}, {hertz:.2f} Hz, mass {best + 1}: rise over the lower flank"
        if nearest is not None:
            text += (
                f" (mass 1: nearest maximum {nearest:.2f} Hz, {100 * (nearest / hertz - 1):+.0f} %)"
            )
        findings.append(
            replace(
                rises[best],
                text=text,
                p_for=min(1.0, len(rises) * rises[best].p_for),
                p_against=max(rise.p_against for rise in rises),
            )
        )
    return Statement(
        "7a", f"Clear peaks stand at the stuck frequencies at {LOW:g}.", "Sec. 3, Fig. 8(a)",
        f"for every mode a local maximum: ln psd of one mass within {peaks.CORE:g} Hz above that of"
        f" both flanks, out to {peaks.FLANK:g} Hz; Bonferroni over masses; errors of the Welch"
        " estimate. Slip softens the chain: maxima lie below the stuck frequencies",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def peaks_at_high_level(results: Results) -> Statement:
    """Prominence at the stuck frequencies, and the share of power outside their band."""
    cases, stuck = _cases_with_spectra(results)
    value, error = _prominence(cases[HIGH], stuck)
    findings = [claim_range(f"ln prominence at {HIGH:g}", value, error, below=GONE)]
    share = {v: peaks.share_outside(cases[v].data, stuck[0], stuck[-1]) for v in LEVELS}
    for i in range(stuck.size):
        gain = float(share[HIGH][0][i] - share[LOW][0][i])
        both = float(np.hypot(share[HIGH][1][i], share[LOW][1][i]))
        text = f"gain of the share out of band, mass {i + 1}"
        findings.append(claim_range(text, gain, both, above=0.0))
    return Statement(
        "7b", f"At {HIGH:g} the peaks at the stuck frequencies are gone, and energy has moved out"
        " of the band of these frequencies.", "Sec. 3, Fig. 8(b)",
        f"mean of ln psd within {peaks.CORE:g} Hz of the stuck frequencies less than 10 % above"
        f" that out to {peaks.FLANK:g} Hz, over modes and masses; share of power out of band larger"
        " than at the low level for each mass; errors of the Welch estimate",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def weak_peaks_of_slip(results: Results) -> Statement:
    """Prominence at the frequencies of the slipping chain that no stuck mode hides."""
    cases, stuck = _cases_with_spectra(results)
    assert results.structure is not None
    slipping = [
        hertz for hertz in results.structure["frequencies_slip"].values
        if np.abs(stuck / hertz - 1.0).min() > DISTINCT
    ]  # fmt: skip
    findings = []
    for hertz in slipping:
        value, error = _prominence(cases[HIGH], [hertz])
        findings.append(claim_larger(f"ln prominence at {hertz:.2f} Hz", value, error, GONE))
    return Statement(
        "7c", f"At {HIGH:g} peaks at slip frequencies are weakly seen.", "Sec. 3, Fig. 8(b)",
        f"ln psd within {peaks.CORE:g} Hz above that out to {peaks.FLANK:g} Hz, averaged over"
        " masses, at any slip frequency away from the stuck ones; Bonferroni; against: all surely"
        " less than 10 % above; errors of the Welch estimate", tuple(findings), any_holds(findings),
    )  # fmt: skip


def _cases_with_spectra(results: Results) -> tuple[dict[float, Case], NDArray[np.float64]]:
    """The two cases of Fig. 8 by variance, and the stuck frequencies [Hz]."""
    cases = cases_with_spectra(results)
    if results.structure is None or set(cases) != set(LEVELS):
        raise NoEvidence("not the cases that the paper speaks of")
    return cases, results.structure["frequencies_stuck"].values


def _prominence(case: Case, hertz: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
    """Mean over masses and frequencies of ln psd near them less its flanks, and its error."""
    data = case.data
    weights = peaks.prominence_weights(data["frequency"].values, hertz)
    value = float((weights @ np.log(data["psd"].isel(sample=0).values)).mean())
    return value, peaks.error_of_sum(weights, peaks.scatter_of_ln_psd(data))


def sweep(results: Results) -> Statement:
    """Slip fractions from the smallest to the largest variance of a sweep without uncertainty."""
    cases = sorted(results.deterministic, key=lambda case: case.variance)
    if len({case.variance for case in cases}) < 4 or len(cases) != len(results.cases):
        raise NoEvidence("not the cases that the paper speaks of")
    slips = [slip_with_error(case) for case in cases]
    findings = []
    for i in range(cases[0].n_joints):
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


ALL = (order_of_joints, peaks_at_low_level, peaks_at_high_level, weak_peaks_of_slip, sweep)
