"""The paper's statements on the bands of uncertainty of the spectra (Figs. 10 and 11)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from . import peaks
from .deterministic_statements import DISTINCT
from .evidence import (
    NoEvidence,
    Statement,
    all_hold,
    any_holds,
    claim_difference,
    claim_larger,
    claim_range,
    claim_range_of_draws,
)
from .printed import LENGTHS, LEVELS, STDS
from .study import STATED, Estimates, Key, Study, contrast

LOW, HIGH = LEVELS  # the two variances of the excitation
SMALL, LARGE = STDS
MOSTLY_SLIPPING = 0.5  # "at higher fractions": joints that slip more than that in the mean
MOSTLY_STUCK = 0.2  # and those that slip less than that
NEGLIGIBLE = float(np.log(1.1))  # a relative difference that no figure would show
NOTHING = Estimates(np.zeros(1), np.zeros(1), np.zeros(1))  # what a mean is compared with


def trend_of_bands(study: Study) -> Statement:
    """Kendall's tau of band ratio and mean time in slip, along each curve of Fig. 11."""
    findings = []
    random = study.random()
    for std in STDS:
        taus = []
        for length in LENGTHS:
            x, y = (
                np.hstack([points.draws(random, study.n_draws) for points in axis])
                for axis in zip(*_curve(study, std, length), strict=True)
            )
            taus.append(_kendall(x, y))
        text = f"Kendall's tau, std {std:g}"
        findings.append(claim_range_of_draws(text, np.mean(taus, axis=0), below=0.0))
    return Statement(
        "3a", "The band of uncertainty narrows as the time in slip grows.",
        "Fig. 11; key observation (ii)",
        f"rank correlation of band ratio and mean, averaged over lengths, negative; draws by the"
        f" {STATED}", tuple(findings), all_hold(findings),
    )  # fmt: skip


def monotony_of_bands(study: Study) -> Statement:
    """Steps between neighbours along each curve of Fig. 11."""
    findings = []
    for std in STDS:
        for length in LENGTHS:
            points = [
                (float(mean.value[i]), f"mass {i + 1} at {variance:g}", ratio[i])
                for variance, (mean, ratio) in zip(LEVELS, _curve(study, std, length), strict=True)
                for i in range(study.n_dof)
            ]
            points.sort(key=lambda point: point[0])
            for (_, name, before), (_, other, after) in pairwise(points):
                text = f"step from {name} to {other}, std {std:g}, L0 = {length:g}"
                step = contrast([after], [before], one_record=False)
                findings.append(claim_range(text, *step, below=NEGLIGIBLE))
    return Statement(
        "3b", "It does so monotonically, for every mass.", "Sec. 3 (i), on Fig. 11",
        "each step of the ln band ratio between neighbours in mean time in slip rises by less than"
        f" 10 %; {STATED}; Bonferroni against", tuple(findings), all_hold(findings),
    )  # fmt: skip


def effect_of_length(study: Study) -> Statement:
    """Differences between correlation lengths where sliders mostly slip."""
    findings = []
    for std in STDS:
        for one, other in combinations(LENGTHS, 2):
            text = f"ln ratio, L0 = {one:g} against {other:g}, std {std:g}"
            findings.append(claim_difference(text, *_wider(study, std, one, other), NEGLIGIBLE))
    return Statement(
        "4a", "The correlation length has a definite effect on the width of the bands.",
        "Sec. 3 (ii); key observation (iii)",
        "any difference between two lengths, averaged over joints that slip more than half"
        f" the time; {STATED}; Bonferroni; against: all surely below 10 %",
        tuple(findings), any_holds(findings),
    )  # fmt: skip


def widest_bands(std: float, widest: float, number: str) -> Callable[[Study], Statement]:
    """The test that one length has the widest bands where sliders mostly slip."""

    def test(study: Study) -> Statement:
        findings = []
        for other in LENGTHS:
            if other != widest:
                text = f"ln ratio, L0 = {widest:g} against {other:g}"
                difference = _wider(study, std, widest, other)
                findings.append(claim_larger(text, *difference, NEGLIGIBLE))
        return Statement(
            number, f"At high fractions the band is widest for L0 = {widest:g} at std {std:g}.",
            "Sec. 3 (ii); key observation (iii)",
            "ln band ratio above that of each other length, averaged over joints that slip more"
            f" than half the time; against: one surely less than 10 % above; {STATED}",
            tuple(findings), all_hold(findings),
        )  # fmt: skip

    return test


def uncertainty_lowers(study: Study) -> Statement:
    """The 95th percentile at the larger scatter of friction, against the smaller."""
    findings = []
    for rest in study.lengths_and_variances():
        stuck = study.slip_mean((SMALL, *rest)).value < MOSTLY_STUCK
        of = {std: study.pseudo_variance((std, *rest), "high").ln() for std in STDS}
        peaks_of = {std: _power_of_peaks(study, (std, *rest)) for std in STDS}
        for i in np.flatnonzero(stuck):
            for name, power in (("all", of), ("peaks", peaks_of)):
                text = f"{name}: mass {i + 1}, L0 = {rest[0]:g}, variance {rest[1]:g} N²"
                growth = contrast([power[LARGE][i]], [power[SMALL][i]], one_record=False)
                findings.append(claim_range(text, *growth, below=0.0))
    return Statement(
        "5a", "More uncertainty does not always raise the 95th percentile: not where sliders mostly"
        " stick.", "Sec. 3, after (ii)",
        "ln of the 95th percentile at std 0.10 over that at 0.067, its integral over all"
        " frequencies or from the first to the last stuck one (the peaks), negative for any"
        f" joint that slips less than {100 * MOSTLY_STUCK:g} % of the time; {STATED};"
        " Bonferroni", tuple(findings), any_holds(findings),
    )  # fmt: skip


def _power_of_peaks(study: Study, key: Key) -> Estimates:
    """ln of the 95th percentile summed from the first to the last stuck frequency (dof).

    Errors of frequencies add up, as if all were due to the same samples; the record moves the sum
    as it moves the integral over all frequencies.
    """
    frequency, ln_psd = study.high_spectrum(key)
    inside = (frequency >= study.stuck[0]) & (frequency <= study.stuck[-1])
    psd = np.exp(ln_psd.value[inside])
    total = psd.sum(axis=0)
    error = (psd * ln_psd.error[inside]).sum(axis=0) / total
    return Estimates(np.log(total), error, study.pseudo_variance(key, "high").ln().record)


def lean_of_mean(study: Study) -> Statement:
    """Distances of the mean spectrum from its percentiles, as pseudo-variances."""
    findings = []
    for std in STDS:
        for variance in LEVELS:
            leans = [_lean(study, (std, length, variance)) for length in LENGTHS]
            text = f"ln of the distances' ratio, std {std:g}, variance {variance:g} N²"
            findings.append(claim_range(text, *contrast(leans, [NOTHING]), above=0.0))
    return Statement(
        "5b", "The mean of the spectra lies nearer the 5th percentile than the 95th.",
        "Sec. 3, after (ii)",
        "ln of (95th - mean)/(mean - 5th), of pseudo-variances, averaged over masses and"
        f" lengths, positive; {STATED}", tuple(findings), all_hold(findings),
    )  # fmt: skip


def _lean(study: Study, key: Key) -> Estimates:
    """ln of (95th - mean)/(mean - 5th) for each mass, to first order of the errors."""
    low, mean, high = (study.pseudo_variance(key, which) for which in ("low", "mean", "high"))
    above, below = high.value - mean.value, mean.value - low.value
    slopes = (1.0 / below, -(1.0 / above + 1.0 / below), 1.0 / above)
    error, record = (
        np.sqrt(sum((slope * getattr(of, part)) ** 2
                    for slope, of in zip(slopes, (low, mean, high), strict=True)))
        for part in ("error", "record")
    )  # fmt: skip
    return Estimates(np.log(above / below), error, record)


def narrowing_with_level(study: Study) -> Statement:
    """Band ratios at the smaller excitation against the larger."""
    low, high = (
        [study.ln_ratio((std, length, variance)) for std in STDS for length in LENGTHS]
        for variance in (LOW, HIGH)
    )
    findings = []
    for i in range(study.n_dof):
        fall = contrast([case[i] for case in low], [case[i] for case in high], one_record=False)
        text = f"ln ratio at {LOW:g} less that at {HIGH:g}, mass {i + 1}"
        findings.append(claim_range(text, *fall, above=0.0))
    return Statement(
        "6b", f"The bands narrow from an excitation of variance {LOW:g} to {HIGH:g}.",
        "Sec. 3 (i), on Figs. 10(a), (b)",
        f"fall of the ln band ratio, averaged over cases, for each mass; {STATED}",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def peaks_of_percentile(study: Study) -> Statement:
    """Prominence at slip frequencies of the 95th percentile and of the spectrum of Fig. 8(b)."""
    slip = [f for f in study.slipping if np.abs(study.stuck / f - 1.0).min() > DISTINCT]
    certain = study.certain[HIGH].data
    weights = peaks.prominence_weights(certain["frequency"].values, slip)
    noise = peaks.error_of_sum(weights, peaks.scatter_of_ln_psd(certain))
    plain = weights @ np.log(certain["psd"].isel(sample=0).values)
    spectra = [study.high_spectrum((LARGE, length, HIGH)) for length in LENGTHS]
    findings = []
    for dof in (1, study.n_dof):
        near, flanks = (
            [_weighted(*of, slip, sign)[dof - 1] for of in spectra] for sign in (1.0, -1.0)
        )
        value, error = contrast(near, flanks)
        gain = value - float(plain[dof - 1])
        findings += [
            claim_range(f"ln prominence, 95th percentile, mass {dof}", value,
                        float(np.hypot(error, noise)), above=0.0),
            claim_range(f"gain over friction certain, mass {dof}", gain,
                        float(np.hypot(error, np.sqrt(2.0) * noise)), above=0.0),
        ]  # fmt: skip
    return Statement(
        "9", "The 95th percentiles peak at natural frequencies of the slipping chain, where the"
        " spectrum without uncertainty does not.", "Sec. 3, Figs. 10(b), (c) against 8",
        f"prominence as in 7b at {', '.join(f'{f:.2f}' for f in slip)} Hz, variance {HIGH:g}, std"
        f" {LARGE:g}: positive, and larger than without uncertainty; {STATED} and errors of the"
        " Welch estimate", tuple(findings), all_hold(findings),
    )  # fmt: skip


def _weighted(
    frequency: NDArray[np.float64], ln_psd: Estimates, hertz: Sequence[float], sign: float
) -> Estimates:
    """Mean of ln psd near some frequencies (sign 1) or of their flanks (sign -1), for each dof."""
    weights = peaks.prominence_weights(frequency, hertz)
    weights = np.maximum(sign * weights, 0.0)
    return Estimates(weights @ ln_psd.value, weights @ ln_psd.error, 0.0 * ln_psd.value[0])


def _curve(study: Study, std: float, length: float) -> list[tuple[Estimates, Estimates]]:
    """A curve of Fig. 11: mean time in slip and ln band ratio, for each variance."""
    keys = [(std, length, variance) for variance in LEVELS]
    return [(study.slip_mean(key), study.ln_ratio(key)) for key in keys]


def _wider(study: Study, std: float, one: float, other: float) -> tuple[float, float]:
    """Mean ln band ratio of one length less another, joints that mostly slip, and its error."""
    means = [study.slip_mean((std, length, HIGH)).value for length in LENGTHS]
    slipping = np.mean(means, axis=0) > MOSTLY_SLIPPING
    if not slipping.any():
        raise NoEvidence("no joint mostly slips")
    more, less = (study.ln_ratio((std, length, HIGH))[slipping] for length in (one, other))
    return contrast([more], [less])


def _kendall(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Kendall's tau of each draw."""
    i, j = np.triu_indices(x.shape[1], 1)
    return np.mean(np.sign(x[:, i] - x[:, j]) * np.sign(y[:, i] - y[:, j]), axis=1)


ALL = (
    trend_of_bands, monotony_of_bands, effect_of_length, widest_bands(LARGE, 1.0, "4b"),
    widest_bands(SMALL, 3.0, "4c"), uncertainty_lowers, lean_of_mean, narrowing_with_level,
)  # fmt: skip
