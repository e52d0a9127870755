"""The paper's statements on the bands of uncertainty of the spectra (Figs. 10 and 11)."""

from __future__ import annotations

from collections.abc import Callable
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
from .paper import LENGTHS, LEVELS, STDS
from .study import RESAMPLED, Draws, Study, pooled

LOW, HIGH = LEVELS  # the two variances of the excitation
SMALL, LARGE = STDS
MOSTLY_SLIPPING = 0.5  # "at higher fractions": joints that slip more than that in the mean
MOSTLY_STUCK = 0.2  # and those that slip less than that
NEGLIGIBLE = float(np.log(1.1))  # a relative difference that no figure would show


def trend_of_bands(study: Study) -> Statement:
    """Kendall's tau of band ratio and mean time in slip, along each curve of Fig. 11."""
    findings = []
    for std in STDS:
        taus = [_kendall(*_curve(study, std, length)) for length in LENGTHS]
        text = f"Kendall's tau, std {std:g}"
        findings.append(claim_range_of_draws(text, np.mean(taus, axis=0), below=0.0))
    return Statement(
        "3a", "The band of uncertainty narrows as the time in slip grows.",
        "Fig. 11; key observation (ii)",
        f"rank correlation of band ratio and mean, averaged over lengths, negative; {RESAMPLED}",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def monotony_of_bands(study: Study) -> Statement:
    """Steps between neighbours along each curve of Fig. 11."""
    findings = []
    for std in STDS:
        for length in LENGTHS:
            mean, ratio = _curve(study, std, length)
            for i, j in pairwise(np.argsort(mean[0])):
                text = f"step at {mean[0, i]:.2f} to {mean[0, j]:.2f}, std {std:g}, L {length:g}"
                step = ratio[:, j] - ratio[:, i]
                findings.append(claim_range_of_draws(text, step, below=NEGLIGIBLE))
    return Statement(
        "3b", "It does so monotonically, for every mass.", "Sec. 3 (i), on Fig. 11",
        "each step of the ln band ratio between neighbours in mean time in slip rises by less than"
        f" 10 %; {RESAMPLED}, Bonferroni against", tuple(findings), all_hold(findings),
    )  # fmt: skip


def effect_of_length(study: Study) -> Statement:
    """Differences between correlation lengths where sliders mostly slip."""
    findings = []
    for std in STDS:
        for one, other in combinations(LENGTHS, 2):
            draws = _wider(study, std, one, other)
            error = float(draws[1:].std(ddof=1))
            text = f"ln ratio, L {one:g} against {other:g}, std {std:g}"
            findings.append(claim_difference(text, float(draws[0]), error, NEGLIGIBLE))
    return Statement(
        "4a", "The correlation length has a definite effect on the width of the bands.",
        "Sec. 3 (ii); key observation (iii)",
        "any difference between two lengths, averaged over joints that slip more than half"
        f" the time; {RESAMPLED}, Bonferroni; against: all surely below 10 %",
        tuple(findings), any_holds(findings),
    )  # fmt: skip


def widest_bands(std: float, widest: float, number: str) -> Callable[[Study], Statement]:
    """The test that one length has the widest bands where sliders mostly slip."""

    def test(study: Study) -> Statement:
        findings = []
        for other in LENGTHS:
            if other != widest:
                draws = _wider(study, std, widest, other)
                text = f"ln ratio, L0 = {widest:g} against {other:g}"
                error = float(draws[1:].std(ddof=1))
                findings.append(claim_larger(text, float(draws[0]), error, NEGLIGIBLE))
        return Statement(
            number, f"At high fractions the band is widest for L0 = {widest:g} at std {std:g}.",
            "Sec. 3 (ii); key observation (iii)",
            "ln band ratio above that of each other length, averaged over joints that slip more"
            f" than half the time; against: one surely less than 10 % above; {RESAMPLED}",
            tuple(findings), all_hold(findings),
        )  # fmt: skip

    return test


def uncertainty_lowers(study: Study) -> Statement:
    """Whether the 95th percentile falls anywhere when the friction varies more."""
    first, last = study.stuck[0], study.stuck[-1]
    findings = []
    for rest in study.lengths_and_variances():
        more, less = study.bands((LARGE, *rest)), study.bands((SMALL, *rest))
        growth = {
            "all": np.log(more.pseudo_variance["high"] / less.pseudo_variance["high"]),
            "peaks": np.log(more.power_of_high(first, last) / less.power_of_high(first, last)),
        }
        stuck = study.slip_mean((SMALL, *rest))[0] < MOSTLY_STUCK
        for i in np.flatnonzero(stuck):
            for name, draws in growth.items():
                text = f"{name}: mass {i + 1}, L {rest[0]:g}, variance {rest[1]:g}"
                findings.append(claim_range_of_draws(text, draws[:, i], below=0.0))
    return Statement(
        "5a", "More uncertainty does not always raise the 95th percentile: not where sliders mostly"
        " stick.", "Sec. 3, after (ii)",
        "ln of the 95th percentile at std 0.10 over that at 0.067, its integral over all"
        " frequencies or from the first to the last stuck one (the peaks), negative for any"
        f" joint that slips less than {100 * MOSTLY_STUCK:g} % of the time; {RESAMPLED},"
        " Bonferroni", tuple(findings), any_holds(findings),
    )  # fmt: skip


def lean_of_mean(study: Study) -> Statement:
    """Distances of the mean spectrum from its percentiles, as pseudo-variances."""
    findings = []
    for std in STDS:
        for variance in LEVELS:
            leans = []
            for length in LENGTHS:
                of = study.bands((std, length, variance)).pseudo_variance
                leans.append(np.log((of["high"] - of["mean"]) / (of["mean"] - of["low"])))
            text = f"ln of the distances' ratio, std {std:g}, variance {variance:g}"
            findings.append(claim_range_of_draws(text, pooled(leans), above=0.0))
    return Statement(
        "5b", "The mean of the spectra lies nearer the 5th percentile than the 95th.",
        "Sec. 3, after (ii)",
        "ln of (95th - mean)/(mean - 5th), of pseudo-variances, averaged over masses and"
        f" lengths, positive; {RESAMPLED}", tuple(findings), all_hold(findings),
    )  # fmt: skip


def narrowing_with_level(study: Study) -> Statement:
    """Band ratios at the smaller excitation against the larger."""
    steps = np.mean(
        [study.bands((s, length, LOW)).ln_ratio - study.bands((s, length, HIGH)).ln_ratio
         for s in STDS for length in LENGTHS], axis=0,
    )  # fmt: skip
    findings = [
        claim_range_of_draws(
            f"ln ratio at {LOW:g} less that at {HIGH:g}, mass {i + 1}", steps[:, i], above=0.0
        )
        for i in range(study.n_dof)
    ]  # fmt: skip
    return Statement(
        "6b", f"The bands narrow from an excitation of variance {LOW:g} to {HIGH:g}.",
        "Sec. 3 (i), on Figs. 10(a), (b)",
        f"fall of the ln band ratio, averaged over cases, for each mass; {RESAMPLED}",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def peaks_of_percentile(study: Study) -> Statement:
    """Prominence at slip frequencies of the 95th percentile and of the spectrum of Fig. 8(b)."""
    slip = [f for f in study.slipping if np.abs(study.stuck / f - 1.0).min() > DISTINCT]
    certain = study.certain[HIGH].data
    weights = peaks.prominence_weights(certain["frequency"].values, slip)
    noise = peaks.error_of_sum(weights, peaks.scatter_of_ln_psd(certain))
    plain = weights @ np.log(certain["psd"].isel(sample=0).values)
    findings = []
    for dof in (1, study.n_dof):
        draws = np.zeros(study.n_draws + 1)
        for length in LENGTHS:
            bands = study.bands((LARGE, length, HIGH))
            of_bands = peaks.prominence_weights(bands.frequency, slip)
            draws += bands.high[:, :, dof - 1] @ of_bands / len(LENGTHS)
        scatter = float(draws[1:].std(ddof=1))
        gain = float(draws[0] - plain[dof - 1])
        findings += [
            claim_range(f"ln prominence, 95th percentile, mass {dof}", float(draws[0]),
                        float(np.hypot(scatter, noise)), above=0.0),
            claim_range(f"gain over friction certain, mass {dof}", gain,
                        float(np.hypot(scatter, np.sqrt(2.0) * noise)), above=0.0),
        ]  # fmt: skip
    return Statement(
        "9", "The 95th percentiles peak at natural frequencies of the slipping chain, where the"
        " spectrum without uncertainty does not.", "Sec. 3, Figs. 10(b), (c) against 8",
        f"prominence as in 7b at {', '.join(f'{f:.2f}' for f in slip)} Hz, variance {HIGH:g}, std"
        f" {LARGE:g}: positive, and larger than without uncertainty; {RESAMPLED} and errors of the"
        " Welch estimate", tuple(findings), all_hold(findings),
    )  # fmt: skip


def _curve(study: Study, std: float, length: float) -> tuple[Draws, Draws]:
    """A curve of Fig. 11: mean time in slip and ln band ratio at both variances."""
    keys = [(std, length, variance) for variance in LEVELS]
    mean = np.hstack([study.slip_mean(key) for key in keys])
    return mean, np.hstack([study.bands(key).ln_ratio for key in keys])


def _wider(study: Study, std: float, one: float, other: float) -> NDArray[np.float64]:
    """Draws of ln band ratio of one length less another, joints that mostly slip."""
    means = [study.slip_mean((std, length, HIGH))[0] for length in LENGTHS]
    slipping = np.mean(means, axis=0) > MOSTLY_SLIPPING
    if not slipping.any():
        raise NoEvidence("no joint mostly slips")
    ratio = {x: study.bands((std, x, HIGH)).ln_ratio for x in (one, other)}
    return (ratio[one] - ratio[other])[:, slipping].mean(axis=1)


def _kendall(x: Draws, y: Draws) -> NDArray[np.float64]:
    """Kendall's tau of each draw."""
    i, j = np.triu_indices(x.shape[1], 1)
    return np.mean(np.sign(x[:, i] - x[:, j]) * np.sign(y[:, i] - y[:, j]), axis=1)


ALL = (
    trend_of_bands, monotony_of_bands, effect_of_length, widest_bands(LARGE, 1.0, "4b"),
    widest_bands(SMALL, 3.0, "4c"), uncertainty_lowers, lean_of_mean, narrowing_with_level,
)  # fmt: skip
