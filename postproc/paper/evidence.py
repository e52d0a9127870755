"""Verdicts on statements: what is claimed of a number, and what its error lets one say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import erfc, inf, sqrt

import numpy as np
from numpy.typing import NDArray

LEVEL = 0.025  # of each one-sided test: together those of a 95 % interval
WIDTH = 1.959964  # standard errors to the ends of a 95 % interval


class NoEvidence(Exception):
    """The data have nothing that the claim speaks of."""


class Verdict(StrEnum):
    """Verdict by a sample of this size."""

    CONFIRMED = "confirmed"
    REFUTED = "not confirmed"
    UNDECIDED = "undecided at this sample size"


@dataclass(frozen=True)
class Finding:
    """A number, its 95 % interval, and one-sided p-values for and against what is claimed of it."""

    text: str
    estimate: float
    low: float
    high: float
    p_for: float  # of a number at the edge of the claimed range showing itself so far inside
    p_against: float  # of a number at that edge showing itself so far outside


@dataclass(frozen=True)
class Judgement:
    """Verdict over all findings, and its p-value (of an undecided one, for the claim)."""

    verdict: Verdict
    p_value: float


@dataclass(frozen=True)
class Statement:
    """A statement of the paper, the test that was made of it, and what came out."""

    number: str  # 1a
    claim: str
    source: str  # where the paper says it
    test: str
    findings: tuple[Finding, ...]
    judgement: Judgement

    @property
    def verdict(self) -> Verdict:
        """Confirmed, not confirmed or undecided."""
        return self.judgement.verdict


def claim_range(
    text: str, estimate: float, error: float, above: float = -inf, below: float = inf
) -> Finding:
    """The claim above < number < below, of an estimate with a normal error."""
    return Finding(
        text, estimate, estimate - WIDTH * error, estimate + WIDTH * error,
        p_for=max(_tail(estimate - above, error), _tail(below - estimate, error)),
        p_against=min(_tail(above - estimate, error), _tail(estimate - below, error)),
    )  # fmt: skip


def claim_range_of_draws(
    text: str, draws: NDArray[np.float64], above: float = -inf, below: float = inf
) -> Finding:
    """The same of draws that are near normal: the first is the estimate."""
    return claim_range(text, float(draws[0]), float(draws[1:].std(ddof=1)), above, below)


def claim_range_by_quantiles(
    text: str, draws: NDArray[np.float64], above: float = -inf, below: float = inf
) -> Finding:
    """The same of draws that need not be normal, by their quantiles."""
    estimate, rest = float(draws[0]), draws[1:]

    def share(outside: NDArray[np.bool_]) -> float:
        return float(outside.sum() + 1) / (rest.size + 1)

    low, high = np.quantile(rest, (LEVEL, 1.0 - LEVEL))
    return Finding(
        text, estimate, float(low), float(high),
        p_for=max(share(rest <= above), share(rest >= below)),
        p_against=min(share(rest >= above), share(rest <= below)),
    )  # fmt: skip


def claim_difference(text: str, estimate: float, error: float, negligible: float) -> Finding:
    """The claim of a difference, whichever its sign; against it speaks one surely negligible."""
    return Finding(
        text, estimate, estimate - WIDTH * error, estimate + WIDTH * error,
        p_for=min(1.0, 2.0 * _tail(abs(estimate), error)),
        p_against=_tail(negligible - abs(estimate), error),
    )  # fmt: skip


def claim_larger(text: str, estimate: float, error: float, negligible: float) -> Finding:
    """The claim of a difference above zero that is seen: against it one surely below negligible."""
    clear = _tail(estimate, error) if estimate >= negligible else max(0.5, _tail(estimate, error))
    return Finding(
        text, estimate, estimate - WIDTH * error, estimate + WIDTH * error,
        p_for=clear, p_against=_tail(negligible - estimate, error),
    )  # fmt: skip


def all_hold(findings: Sequence[Finding]) -> Judgement:
    """Intersection-union test for the claim; one finding against it, Bonferroni, ends it."""
    _require(findings)
    p_for = max(f.p_for for f in findings)
    return _judge(p_for, min(1.0, len(findings) * min(f.p_against for f in findings)))


def any_holds(findings: Sequence[Finding]) -> Judgement:
    """One finding, Bonferroni, makes the claim; against it all have to speak."""
    _require(findings)
    p_for = min(1.0, len(findings) * min(f.p_for for f in findings))
    return _judge(p_for, max(f.p_against for f in findings))


def _require(findings: Sequence[Finding]) -> None:
    if not findings:
        raise NoEvidence("nothing to be tested")


def _judge(p_for: float, p_against: float) -> Judgement:
    if p_for < LEVEL:
        return Judgement(Verdict.CONFIRMED, p_for)
    if p_against < LEVEL:
        return Judgement(Verdict.REFUTED, p_against)
    return Judgement(Verdict.UNDECIDED, p_for)


def _tail(distance: float, error: float) -> float:
    """Probability of a normal error beyond a distance; without error, certainty."""
    if error > 0.0:
        return 0.5 * erfc(distance / (error * sqrt(2.0)))
    return 0.0 if distance > 0.0 else 1.0
