"""The paper's friction study in a results file, and bootstrap samples of its statistics.

A bootstrap draw takes samples with replacement, the same ones for every case of a process, since
these share their friction coefficients. Every array of draws begins with the statistic of the
samples as they are. The force record that all samples share is not drawn again: its scatter is in
no interval that is made here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .paper import LENGTHS, LEVELS, STDS
from .results import Case, Results

Draws = NDArray[np.float64]  # (draw, dof), the statistic itself first
Key = tuple[float, float, float]  # std, correlation length, variance

RESAMPLED = "bootstrap over samples"

_NEGLIGIBLE_POWER = 1.0e-4  # share of it beyond the frequencies that draws integrate over
_FEWEST_SAMPLES = 20  # of a case, below which a bootstrap says little
_MOST_SAMPLES = 40_000  # drawn of a case, with hundred draws at least
_PERCENTILES = (5.0, 95.0)  # of Eq. 46


@dataclass
class Bands:
    """Draws of what the spectra's percentiles give."""

    frequency: NDArray[np.float64]
    pseudo_variance: dict[str, Draws]  # Eq. 46 of 'low', 'mean' and 'high'
    high: NDArray[np.float64]  # ln of the 95th percentile (draw, frequency, dof)

    @property
    def ln_ratio(self) -> Draws:
        """Of the pseudo-variances of the 95th and the 5th percentile."""
        return np.log(self.pseudo_variance["high"] / self.pseudo_variance["low"])

    def power_of_high(self, first: float, last: float) -> Draws:
        """The 95th percentile summed from one frequency to another."""
        inside = (self.frequency >= first) & (self.frequency <= last)
        return np.exp(self.high[:, inside]).sum(axis=1)


@dataclass
class Study:
    """Cases of the paper's friction study, each under its std, correlation length and variance."""

    cases: dict[Key, Case]
    certain: dict[float, Case]  # friction certain, by variance
    stuck: NDArray[np.float64]  # natural frequencies [Hz], all sliders stuck
    slipping: NDArray[np.float64]  # the same, all sliders slipping
    n_draws: int = 400
    seed: int = 2016
    _bands: dict[Key, Bands] = field(default_factory=dict)

    @property
    def n_dof(self) -> int:
        """Oscillators of the chain."""
        return next(iter(self.cases.values())).n_dof

    @property
    def has_spectra(self) -> bool:
        """Whether the spectra of every sample are there."""
        return all(case.has("psd") for case in self.cases.values())

    @property
    def has_certain_spectra(self) -> bool:
        """Whether the spectra of Fig. 8 are there."""
        return set(self.certain) == set(LEVELS)

    def lengths_and_variances(self) -> list[tuple[float, float]]:
        """The cases at one std."""
        return sorted({(length, variance) for _, length, variance in self.cases})

    def slip_fraction(self, key: Key) -> NDArray[np.float64]:
        """Slip fractions of the drawn samples (draw, sample, dof)."""
        values = np.asarray(self.cases[key].data["slip_fraction"].values, dtype=float)
        return values[self._indices(key)]

    def slip_mean(self, key: Key) -> Draws:
        """Mean over samples."""
        return self.slip_fraction(key).mean(axis=1)

    def slip_std(self, key: Key) -> Draws:
        """Standard deviation over samples."""
        return self.slip_fraction(key).std(axis=1, ddof=1)

    def bands(self, key: Key) -> Bands:
        """Draws of the percentiles of the spectra; kept, for they take a while."""
        if key not in self._bands:
            self._bands[key] = self._draw_bands(key)
        return self._bands[key]

    def _indices(self, key: Key) -> NDArray[np.int64]:
        """Which samples make each draw (draw, sample), the same for all cases of a process."""
        case = self.cases[key]
        n = case.data.sizes["sample"]
        random = np.random.default_rng([self.seed, *case.process.encode()])
        return np.vstack([np.arange(n), random.integers(0, n, (self.n_draws, n))])

    def _draw_bands(self, key: Key) -> Bands:
        data = self.cases[key].data
        frequency = data["frequency"].values
        power = np.cumsum(data["psd"].values.mean(axis=0), axis=0)
        kept = int(np.argmax((power >= (1.0 - _NEGLIGIBLE_POWER) * power[-1]).all(axis=1))) + 1
        psd = np.ascontiguousarray(data["psd"].values[:, :kept].transpose(1, 2, 0), np.float32)
        step = frequency[1] - frequency[0]
        pseudo: dict[str, list[NDArray[np.float64]]] = {"low": [], "mean": [], "high": []}
        highs = []
        for index in self._indices(key):
            drawn = np.sort(psd[..., index], axis=-1)
            low, high = (_sorted_percentile(drawn, level) for level in _PERCENTILES)
            for name, curve in (("low", low), ("mean", drawn.mean(axis=-1)), ("high", high)):
                pseudo[name].append(curve.sum(axis=0, dtype=float) * step)
            highs.append(np.log(high))
        return Bands(
            frequency[:kept], {name: np.array(rows) for name, rows in pseudo.items()},
            np.array(highs),
        )  # fmt: skip


def paper_study(results: Results, n_draws: int = 400) -> Study | None:
    """The twelve cases of Sec. 3 where the file has them all, with their slip fractions."""
    found = {
        (case.std, case.correlation_length, case.variance): case
        for case in results.random
        if case.has("slip_fraction") and case.data.sizes["sample"] >= _FEWEST_SAMPLES
    }
    wanted = [(s, length, v) for s in STDS for length in LENGTHS for v in LEVELS]
    if results.structure is None or not all(key in found for key in wanted):
        return None
    largest = max(found[key].data.sizes["sample"] for key in wanted)
    return Study(
        {key: found[key] for key in wanted},
        {c.variance: c for c in results.deterministic if c.variance in LEVELS and c.has("psd")},
        results.structure["frequencies_stuck"].values,
        results.structure["frequencies_slip"].values,
        n_draws=min(n_draws, max(100, _MOST_SAMPLES // largest)),
    )


def pooled(draws: Sequence[Draws]) -> NDArray[np.float64]:
    """Mean over cases and joints."""
    return np.mean(draws, axis=(0, 2))


def _sorted_percentile(values: NDArray[np.float32], level: float) -> NDArray[np.float32]:
    """Linear between the two order statistics around the level; the last axis ascends."""
    position = level / 100.0 * (values.shape[-1] - 1)
    below = int(position)
    above = min(below + 1, values.shape[-1] - 1)
    weight = np.float32(position - below)
    return (1 - weight) * values[..., below] + weight * values[..., above]
