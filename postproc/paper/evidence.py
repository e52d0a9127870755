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
    """The data lack what the claim is about."""


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
    p_for: float  # probability of an estimate this far inside, if the number is on the edge
    p_against: float  # probability of an estimate this far outside, if the number is on the edge


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
    source: str  # place in the paper
    test: str
    findings: tuple[Finding, ...]
    judgement: Judgement
    scene: str = ""  # title of the scene whose results decided

    @property
    def verdict(self) -> Verdict:
        """Confirmed, not confirmed or undecided."""
        return self.judgement.verdict


def claim_range(
    text: str, estimate: float, error: float, above: float = -inf, below: float = inf
) -> Finding:
    """The claim above < number < below; the estimate has a normal error."""
    p_for = max(_tail(estimate - above, error), _tail(below - estimate, error))
    p_against = min(_tail(above - estimate, error), _tail(estimate - below, error))
    return _normal(text, estimate, error, p_for, p_against)


def claim_range_of_draws(
    text: str, draws: NDArray[np.float64], above: float = -inf, below: float = inf
) -> Finding:
    """The same claim from nearly normal draws; the first one is the estimate."""
    return claim_range(text, float(draws[0]), float(draws[1:].std(ddof=1)), above, below)


def claim_range_by_quantiles(
    text: str, draws: NDArray[np.float64], above: float = -inf, below: float = inf
) -> Finding:
    """The same claim by the quantiles of draws of any law."""
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
    """The claim of a difference of either sign; a surely negligible one speaks against it."""
    p_for = min(1.0, 2.0 * _tail(abs(estimate), error))
    return _normal(text, estimate, error, p_for, _tail(negligible - abs(estimate), error))


def claim_larger(text: str, estimate: float, error: float, negligible: float) -> Finding:
    """The claim of a visible positive difference; a surely negligible one speaks against it."""
    p_for = max(_tail(estimate, error), 0.0 if estimate >= negligible else 0.5)
    return _normal(text, estimate, error, p_for, _tail(negligible - estimate, error))


def _normal(text: str, estimate: float, error: float, p_for: float, p_against: float) -> Finding:
    """The finding with the 95 % interval of a normal error."""
    half = WIDTH * error
    return Finding(text, estimate, estimate - half, estimate + half, p_for, p_against)


def all_hold(findings: Sequence[Finding]) -> Judgement:
    """All findings must hold (intersection-union test); one against refutes (Bonferroni)."""
    _require(findings)
    p_for = max(f.p_for for f in findings)
    return _judge(p_for, min(1.0, len(findings) * min(f.p_against for f in findings)))


def any_holds(findings: Sequence[Finding]) -> Judgement:
    """One finding confirms (Bonferroni); only all of them together refute."""
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
