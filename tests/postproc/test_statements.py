"""Each of the paper's statements, tried on data of which all three verdicts are known."""

from __future__ import annotations

import numpy as np
import pytest

from entroslip.paper import band_statements, deterministic_statements, slip_statements
from entroslip.paper.evidence import (
    NoEvidence,
    Verdict,
    all_hold,
    any_holds,
    claim_difference,
    claim_larger,
    claim_range,
    claim_range_by_quantiles,
)
from entroslip.paper.peaks import error_of_sum, prominence_weights
from entroslip.paper.printed import SLIP_HZ, STUCK_HZ
from entroslip.paper.statements import assess
from entroslip.paper.study import paper_study
from tests.postproc.synthetic import (
    FREQUENCY,
    HIGH,
    LOW,
    bumps,
    certain,
    friction_study,
    results_of,
)

YES, NO, OPEN = Verdict.CONFIRMED, Verdict.REFUTED, Verdict.UNDECIDED
FALLING = {LOW: 2.0 * 0.74 ** np.arange(5), HIGH: 2.0 * 0.74 ** np.arange(5, 10)}
SMALL, LARGE = 0.067, 0.10


def verdict_of(test, **study):
    return test(paper_study(friction_study(**study))).verdict


def hill(top):
    """Standard deviation of the slip fraction with its peak at a mean of `top`."""
    return lambda std, length, mean: std * (2.0 - 4.0 * (mean - top) ** 2)


@pytest.mark.parametrize(("top", "verdict"), [(0.3, YES), (0.62, NO), (0.4, OPEN)])
def test_peak_of_scatter(top, verdict):
    assert verdict_of(slip_statements.peak_of_scatter, scatter=hill(top), n_samples=400) == verdict


@pytest.mark.parametrize(("growth", "verdict"), [(1.2, YES), (2.0, NO), (LARGE / SMALL, OPEN)])
def test_growth_of_scatter(growth, verdict):
    def scatter(std, length, mean):
        return 0.1 * (growth if std == LARGE else 1.0) + 0 * mean

    judge = slip_statements.growth_of_scatter
    assert verdict_of(judge, scatter=scatter, n_samples=1000) == verdict


@pytest.mark.parametrize(
    ("by_length", "verdict"),
    [((1.0, 1.6, 1.3), YES), ((1.3, 1.0, 1.6), NO), ((1.0, 1.0, 1.0), OPEN)],
)
def test_order_of_scatter(by_length, verdict):
    factor = dict(zip((0.3, 1.0, 3.0), by_length, strict=True))

    def scatter(std, length, mean):
        return 0.1 * factor[length] + 0 * mean

    judge = slip_statements.order_of_scatter
    assert verdict_of(judge, scatter=scatter, n_samples=1000) == verdict


@pytest.mark.parametrize(
    ("longest", "n_samples", "verdict"), [(1.0, 4000, YES), (1.3, 1000, NO), (1.0, 40, OPEN)]
)
def test_no_consistent_effect_of_the_length(longest, n_samples, verdict):
    def scatter(std, length, mean):
        return 0.1 * (longest if length == 3.0 else 1.0) + 0 * mean

    judge = slip_statements.no_consistent_effect
    assert verdict_of(judge, scatter=scatter, n_samples=n_samples) == verdict


@pytest.mark.parametrize(("sign", "verdict"), [(-1, YES), (1, NO), (0, OPEN)])
def test_trend_of_bands(sign, verdict):
    def width(std, length, variance):
        return 1.0 + 0.1 * sign * (np.arange(5) + (5 if variance == HIGH else 0))

    assert verdict_of(band_statements.trend_of_bands, width=width) == verdict


@pytest.mark.parametrize(("rise", "verdict"), [(0.0, YES), (1.0, NO), (np.log(1.1) / 3.29, OPEN)])
def test_monotony_of_bands(rise, verdict):
    """Widths fall, but for the rise of ln(95th/5th) from the first oscillator to the second."""

    def width(std, length, variance):
        widths = FALLING[variance].copy()
        widths[0] = widths[1] - rise if variance == LOW and rise else widths[0]
        return widths

    judge = band_statements.monotony_of_bands
    assert verdict_of(judge, width=width, n_samples=1000) == verdict


@pytest.mark.parametrize(
    ("widths", "verdict"),
    [((0.3, 1.5, 0.7), YES), ((0.02, 0.02, 0.02), NO), ((0.5, 0.5, 0.5), OPEN)],
)
def test_effect_of_length(widths, verdict):
    of = dict(zip((0.3, 1.0, 3.0), widths, strict=True))

    def width(std, length, variance):
        return np.full(5, of[length])

    assert verdict_of(band_statements.effect_of_length, width=width) == verdict


@pytest.mark.parametrize(("factor", "verdict"), [(3.0, YES), (0.5, NO), (1.0, OPEN)])
@pytest.mark.parametrize(("number", "std", "widest"), [("4b", LARGE, 1.0), ("4c", SMALL, 3.0)])
def test_widest_bands(number, std, widest, factor, verdict):
    def width(of_std, length, variance):
        return np.full(5, 0.5 * (factor if (of_std, length) == (std, widest) else 1.0))

    test = band_statements.widest_bands(std, widest, number)
    assert verdict_of(test, width=width) == verdict


@pytest.mark.parametrize(("growth", "verdict"), [(-1.0, YES), (1.0, NO), (0.0, OPEN)])
def test_uncertainty_lowers(growth, verdict):
    def level(std, variance):
        return np.full(5, growth if std == LARGE else 0.0)

    assert verdict_of(band_statements.uncertainty_lowers, level=level) == verdict


@pytest.mark.parametrize(
    ("shape", "verdict"),
    [
        (lambda width, z: np.exp(width * z), YES),
        (lambda width, z: np.maximum(20.0 - np.exp(z), 0.1) + 0 * width, NO),
        (lambda width, z: 1.0 + 0.1 * z + 0 * width, OPEN),
    ],
)
def test_lean_of_mean(shape, verdict):
    assert verdict_of(band_statements.lean_of_mean, shape=shape, n_samples=1000) == verdict


@pytest.mark.parametrize(("high", "verdict"), [(0.4, YES), (2.0, NO), (1.0, OPEN)])
def test_narrowing_with_level(high, verdict):
    def width(std, length, variance):
        return np.full(5, high if variance == HIGH else 1.0)

    assert verdict_of(band_statements.narrowing_with_level, width=width) == verdict


@pytest.mark.parametrize(("height", "verdict"), [(1.0, YES), (-1.0, NO), (0.0, OPEN)])
def test_peaks_of_percentile(height, verdict):
    assert verdict_of(band_statements.peaks_of_percentile, high_bumps=height) == verdict


@pytest.mark.parametrize(
    ("slip", "verdict"),
    [
        ((0.1, 0.2, 0.3, 0.4, 0.5), YES),
        ((0.1, 0.2, 0.3, 0.5, 0.4), NO),
        ((0.1, 0.1, 0.3, 0.4, 0.5), OPEN),
    ],
)
def test_order_of_joints(slip, verdict):
    cases = [certain(LOW, slip), certain(HIGH)]
    assert deterministic_statements.order_of_joints(results_of(cases)).verdict == verdict


def fig_8(low=0.0, high=0.0, at=STUCK_HZ):
    in_band = 2.0 * (abs(FREQUENCY - np.mean(STUCK_HZ)) < 0.6)
    cases = [certain(LOW, ln_psd=in_band + low), certain(HIGH, ln_psd=high)]
    return results_of(cases)


def test_peaks_at_the_stuck_frequencies():
    """As worded: at each of them; not 4 % below, where the report says they are."""
    judge = deterministic_statements.peaks_at_low_level
    assert judge(fig_8(bumps(STUCK_HZ, 1.0))).verdict == YES
    assert judge(fig_8(bumps(STUCK_HZ, 0.05))).verdict == OPEN
    shifted = judge(fig_8(bumps(np.array(STUCK_HZ) * 0.96, 1.0)))
    assert shifted.verdict == NO
    assert "mass 1: nearest maximum 1.10 Hz, -4 %" in shifted.findings[0].text
    assert judge(fig_8(bumps(STUCK_HZ[1:], 1.0) + 4.0 * FREQUENCY)).verdict == NO  # one missing


@pytest.mark.parametrize(("high", "verdict"), [(0.0, YES), (1.0, NO)])
def test_peaks_are_gone_at_the_high_level(high, verdict):
    results = fig_8(bumps(STUCK_HZ, 1.0), bumps(STUCK_HZ, high))
    assert deterministic_statements.peaks_at_high_level(results).verdict == verdict


@pytest.mark.parametrize(("high", "verdict"), [(0.5, YES), (0.15, OPEN), (0.0, NO)])
def test_weak_peaks_at_slip_frequencies(high, verdict):
    results = fig_8(0.0, bumps(SLIP_HZ[:3], high))
    assert deterministic_statements.weak_peaks_of_slip(results).verdict == verdict


@pytest.mark.parametrize(("last", "verdict"), [(0.99, YES), (0.7, NO), (0.95, OPEN)])
def test_sweep(last, verdict):
    ends = zip((0.1, 1.0, 10.0, 100.0), (0.01, 0.2, 0.6, last), strict=True)
    cases = [certain(variance, np.full(5, slip)) for variance, slip in ends]
    assert deterministic_statements.sweep(results_of(cases)).verdict == verdict


def test_all_statements_in_their_order():
    numbers = [statement.number for statement in assess([friction_study(n_samples=20)])]
    assert " ".join(numbers) == "1a 1b 2a 2b 3a 3b 4a 4b 4c 5a 5b 6a 6b 7a 7b 7c 9"


def test_too_few_samples_or_cases_are_not_judged():
    few = friction_study(n_samples=19)
    assert paper_study(few) is None
    with pytest.raises(NoEvidence):
        deterministic_statements.sweep(few)
    few.cases.pop()
    assert {statement.number for statement in assess([few])} == {"6a", "7a", "7b", "7c"}
    with pytest.raises(NoEvidence):
        deterministic_statements.peaks_at_low_level(results_of([certain(LOW)]))
    with pytest.raises(NoEvidence):
        deterministic_statements.order_of_joints(results_of([certain(LOW)]))


def test_spectra_of_some_masses_or_other_percentiles_are_not_judged():
    partial, other = friction_study(n_samples=20), friction_study(n_samples=20)
    for case in partial.cases:
        case.data.attrs["kept_dofs"] = [1, 3]
    for case in other.random:
        case.data["percentile"] = ("percentile", [1.0, 99.0])
    of_slip = {"1a", "1b", "2a", "2b", "6a"}
    assert {statement.number for statement in assess([partial])} == of_slip
    assert {statement.number for statement in assess([other])} == of_slip | {"7a", "7b", "7c"}


def test_a_claim_of_more_can_come_out_against():
    """Surely negligible or reversed; surely positive, yet negligible, is no confirmation."""
    assert all_hold([claim_larger("x", 0.2, 0.05, 0.1)]).verdict == YES
    assert all_hold([claim_larger("x", 0.05, 0.001, 0.1)]).verdict == NO
    assert all_hold([claim_larger("x", -0.3, 0.1, 0.1)]).verdict == NO
    assert all_hold([claim_larger("x", 0.05, 0.05, 0.1)]).verdict == OPEN


def test_intervals_and_p_values_of_a_normal_error():
    finding = claim_range("x", 1.0, 0.5, above=0.0)
    assert finding.p_for == pytest.approx(0.02275, abs=1e-5)  # two standard errors, one-sided
    assert finding.p_against == pytest.approx(1.0 - 0.02275, abs=1e-5)
    assert (finding.low, finding.high) == pytest.approx((0.02, 1.98), abs=1e-3)
    inside = claim_range("x", 1.0, 0.5, above=0.0, below=1.5)
    assert inside.p_for == pytest.approx(0.15866, abs=1e-5)  # one standard error from the edge
    exact = claim_range("x", 1.0, 0.0, above=0.0)
    assert (exact.p_for, exact.p_against) == (0.0, 1.0)


def test_quantiles_need_no_normal_error():
    draws = np.concatenate([[0.3], np.linspace(0.0, 1.0, 999)])
    finding = claim_range_by_quantiles("x", draws, above=0.1, below=2.0)
    assert (finding.low, finding.high) == pytest.approx((0.025, 0.975), abs=1e-3)
    assert finding.p_for == pytest.approx(0.1, abs=2e-3)


def test_difference_of_either_sign():
    assert claim_difference("x", -1.0, 0.1, 0.1).p_for < 1e-6
    assert claim_difference("x", 0.0, 0.01, 0.1).p_against < 1e-6
    unclear = claim_difference("x", 0.0, 1.0, 0.1)
    assert unclear.p_for == 1.0
    assert unclear.p_against > 0.4


def test_one_of_many_needs_more_than_one_of_one():
    clear, weak = claim_range("x", 3.0, 1.0, above=0.0), claim_range("x", 2.2, 1.0, above=0.0)
    assert any_holds([weak]).verdict == YES
    assert any_holds([weak] * 2).verdict == OPEN
    assert all_hold([clear, weak]).verdict == YES
    against = claim_range("x", -2.2, 1.0, above=0.0)
    assert all_hold([against]).verdict == NO
    assert all_hold([clear, against]).verdict == OPEN
    assert any_holds([against, against]).verdict == NO
    for judge in (all_hold, any_holds):
        with pytest.raises(NoEvidence):
            judge([])


def test_prominence_of_a_bump_and_its_error():
    weights = prominence_weights(FREQUENCY, SLIP_HZ)
    assert weights @ (3.0 + 2.0 * FREQUENCY) == pytest.approx(0.0, abs=0.05)  # a slope has none
    assert weights @ bumps(SLIP_HZ, 1.0) > 0.4
    # white noise of Hann bins: neighbours correlate by 4/9 and 1/36
    random = np.random.default_rng(5)
    white = random.standard_normal((4000, FREQUENCY.size + 2))
    taps = np.array([0.25, 0.614, 0.25])  # of a moving average near to that
    noise = np.array([np.convolve(row, taps / np.hypot.reduce(taps), "valid") for row in white])
    spread = (noise @ weights).std()
    assert error_of_sum(weights, 1.0) == pytest.approx(spread, rel=0.1)
    with pytest.raises(NoEvidence, match="too coarse"):
        prominence_weights(FREQUENCY[::20], SLIP_HZ)
