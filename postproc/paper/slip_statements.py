"""The paper's statements on the scatter of the time in slip (Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .evidence import Statement, all_hold, claim_larger, claim_range, claim_range_by_quantiles
from .printed import LENGTHS, LEVELS, STDS
from .study import STATED, Study, contrast

SMALL, LARGE = STDS
NEGLIGIBLE = float(np.log(1.05))  # a relative difference of scatter that no figure would show
ABOUT_03 = (0.2, 0.4)  # what "approximately 30 %" is taken to mean


def peak_of_scatter(study: Study) -> Statement:
    """Mean at the maximum of a cubic through the standard deviations over the means."""
    findings = []
    random = study.random()
    for std in STDS:
        keys = [key for key in study.cases if key[0] == std]
        scatter = [study.slip_std(key) for key in keys]
        x, y = (
            np.hstack([points.draws(random, study.n_draws) for points in axis])
            for axis in ([study.slip_mean(key) for key in keys], scatter)
        )
        errors = np.hstack([np.hypot(points.error, points.record) for points in scatter])
        weights = 1.0 / np.maximum(errors, 1.0e-6)
        tops = np.array([_top(*point, weights) for point in zip(x, y, strict=True)])
        findings.append(
            claim_range_by_quantiles(f"mean at the peak, std {std:g}", tops, *ABOUT_03)
        )  # fmt: skip
    return Statement(
        "1a", "The standard deviation of the time in slip peaks where its mean is about 0.3.",
        "Fig. 9; key observation (i)",
        f"maximum of a weighted cubic through the points of Fig. 9 within {ABOUT_03[0]:g} to"
        f" {ABOUT_03[1]:g}; percentile interval of draws by the {STATED}",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def growth_of_scatter(study: Study) -> Statement:
    """Geometric mean over the points of Fig. 9 of the ratio of standard deviations."""
    more, less = (
        [study.slip_std((std, *rest)).ln() for rest in study.lengths_and_variances()]
        for std in (LARGE, SMALL)
    )
    bound = LARGE / SMALL
    finding = claim_range(
        "ln ratio of the standard deviations", *contrast(more, less), below=float(np.log(bound))
    )
    return Statement(
        "1b", f"Raising the std of the friction coefficients {bound:.2f}-fold raises that of the"
        " time in slip by less.", "Sec. 3, on Fig. 9",
        f"ln of the ratio, averaged over joints and cases, below ln {bound:.2f}; {STATED}",
        (finding,), all_hold([finding]),
    )  # fmt: skip


def order_of_scatter(study: Study) -> Statement:
    """Mean over joints and variances of ln s, between correlation lengths."""
    findings = []
    for more, less in ((1.0, 3.0), (3.0, 0.3)):
        text = f"ln s(L0 = {more:g}) - ln s(L0 = {less:g})"
        findings.append(claim_larger(text, *_wider(study, (LARGE,), more, less), NEGLIGIBLE))
    return Statement(
        "2a", "At std 0.10 the time in slip scatters typically more for L0 = 1 than for 3, and more"
        " for 3 than for 0.3.", "Sec. 3, on Fig. 9(b)",
        "both differences, averaged over joints and variances, positive; against: one of them"
        f" surely below 5 %, or reversed; {STATED}",
        tuple(findings), all_hold(findings),
    )  # fmt: skip


def no_consistent_effect(study: Study) -> Statement:
    """Differences of ln s between correlation lengths, over everything else."""
    findings = [
        claim_range(
            f"ln s(L0 = {one:g}) - ln s(L0 = {other:g})", *_wider(study, STDS, one, other),
            above=-NEGLIGIBLE, below=NEGLIGIBLE,
        )
        for one, other in combinations(LENGTHS, 2)
    ]  # fmt: skip
    return Statement(
        "2b", "The correlation length has no consistent effect on the scatter of the time in slip.",
        "Sec. 3, on Fig. 9",
        "every difference between two lengths, averaged over joints, variances and both std, within"
        f" 5 %; {STATED}", tuple(findings), all_hold(findings),
    )  # fmt: skip


def _wider(study: Study, stds: Sequence[float], one: float, other: float) -> tuple[float, float]:
    """Mean over joints and cases of ln s of one length less another, and its error."""
    more, less = (
        [study.slip_std((std, length, v)).ln() for std in stds for v in LEVELS]
        for length in (one, other)
    )
    return contrast(more, less)


def _top(x: NDArray[np.float64], y: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Place of the maximum of a weighted cubic within the range of x."""
    grid = np.linspace(x.min(), x.max(), 401)
    return float(grid[np.argmax(np.polyval(np.polyfit(x, y, 3, w=weights), grid))])


ALL = (peak_of_scatter, growth_of_scatter, order_of_scatter, no_consistent_effect)
