"""The paper's friction study in a results file: its statistics with their errors.

The statistics are the file's best estimates. Two errors are kept apart: that of a finite number of
samples, and that of the one force record, which moves all cases of a level of the force alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..results import Case, Results
from .evidence import WIDTH
from .printed import LENGTHS, LEVELS, PERCENTILES, STDS

Array = NDArray[np.float64]
Key = tuple[float, float, float]  # std, correlation length, variance

STATED = "stated errors of the estimates, those of the force record included"

_FEWEST_SAMPLES = 20  # of a case, below which its errors say little
_BATCHES = 8  # of a march, for what the record does to a standard deviation


@dataclass(frozen=True)
class Estimates:
    """Numbers, one for each joint or dof, with their standard errors."""

    value: Array
    error: Array  # due to the number of samples
    record: Array  # due to the force record

    def __getitem__(self, joints: int | np.integer | NDArray[np.bool_]) -> Estimates:
        """Estimates of some joints."""
        value, error, record = (
            np.atleast_1d(part[joints]) for part in (self.value, self.error, self.record)
        )
        return Estimates(value, error, record)

    def ln(self) -> Estimates:
        """Logarithms, to first order of the errors."""
        return Estimates(np.log(self.value), self.error / self.value, self.record / self.value)

    def draws(self, random: np.random.Generator, n: int) -> Array:
        """Normal draws (draw, joint), the estimates themselves first."""
        noise = random.standard_normal((n, self.value.size))
        return np.vstack([self.value, self.value + noise * np.hypot(self.error, self.record)])


def contrast(
    plus: Sequence[Estimates], minus: Sequence[Estimates], one_record: bool = True
) -> tuple[float, float]:
    """Mean over cases and joints of one side less that of the other, and its standard error.

    Errors of a side add up, as if all were due to the same samples; sides are independent, which
    cases that share samples are not: neither makes the error too small. Under one record both sides
    move alike.
    """
    value, error, record = (
        [float(np.mean([getattr(case, part).mean() for case in side])) for side in (plus, minus)]
        for part in ("value", "error", "record")
    )
    moved = record[0] - record[1] if one_record else hypot(*record)
    return value[0] - value[1], hypot(*error, moved)


@dataclass(frozen=True)
class Study:
    """Cases of the paper's friction study, each under its std, correlation length and variance."""

    cases: dict[Key, Case]
    certain: dict[float, Case]  # friction certain, by variance
    stuck: Array  # natural frequencies [Hz], all sliders stuck
    slipping: Array  # the same, all sliders slipping
    n_draws: int = 2000
    seed: int = 2016

    @property
    def n_dof(self) -> int:
        """Oscillators of the chain."""
        return next(iter(self.cases.values())).n_dof

    @property
    def has_spectra(self) -> bool:
        """True if the 5th and the 95th percentile of the spectra of all masses are there."""
        names = ("psd_percentiles", "pseudo_variance_percentiles", "band_ratio")
        return all(
            case.has(*names) and case.keeps_all_dofs
            and tuple(case.data["percentile"].values[[0, -1]]) == PERCENTILES
            for case in self.cases.values()
        )  # fmt: skip

    @property
    def has_certain_spectra(self) -> bool:
        """True if the spectra of Fig. 8 are there."""
        return set(self.certain) == set(LEVELS)

    def lengths_and_variances(self) -> list[tuple[float, float]]:
        """The cases at one std."""
        return sorted({(length, variance) for _, length, variance in self.cases})

    def random(self) -> np.random.Generator:
        """Generator of the draws of a statement, always from the same seed."""
        return np.random.default_rng(self.seed)

    def slip_mean(self, key: Key) -> Estimates:
        """Mean slip fraction."""
        return self._of(key, "slip_mean", "slip_mean_error", "slip_mean_time_error")

    def slip_std(self, key: Key) -> Estimates:
        """Standard deviation of the slip fraction over samples."""
        found = self._of(key, "slip_std", "slip_std_error")
        data = self.cases[key].data
        if "slip_series" not in data:
            return found
        spans = np.array_split(data["slip_series"].values, _BATCHES, axis=1)
        scatter = np.log([batch.mean(axis=1).std(axis=0, ddof=1) for batch in spans])
        record = found.value * scatter.std(axis=0, ddof=1) / np.sqrt(_BATCHES)
        return Estimates(found.value, found.error, record)

    def ln_ratio(self, key: Key) -> Estimates:
        """ln of the ratio of the pseudo-variances of the 95th and the 5th percentile."""
        data = self.cases[key].data
        ends = np.log(_values(data, "band_ratio_high") / _values(data, "band_ratio_low"))
        ratio = self._of(key, "band_ratio", "band_ratio", "band_ratio_time_error")
        return Estimates(np.log(ratio.value), ends / (2 * WIDTH), ratio.record / ratio.value)

    def pseudo_variance(self, key: Key, which: str) -> Estimates:
        """Pseudo-variance of the 'low' or 'high' percentile, or of the 'mean' (Eq. 46)."""
        if which == "mean":
            name = "pseudo_variance_mean"
            return self._of(key, name, f"{name}_error", f"{name}_time_error")
        name = "pseudo_variance_percentiles"
        found = self._of(key, name, f"{name}_error", f"{name}_time_error")
        end = 0 if which == "low" else -1
        return Estimates(found.value[end], found.error[end], found.record[end])

    def high_spectrum(self, key: Key) -> tuple[Array, Estimates]:
        """Frequencies [Hz], and ln of the 95th percentile (frequency, dof)."""
        data = self.cases[key].data.isel(percentile=-1, frequency=slice(1, None))
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.log(data["psd_percentiles_high"].values / data["psd_percentiles_low"].values)
            value = np.log(data["psd_percentiles"].values)
        record = np.full_like(value, float(data.attrs.get("psd_time_error", 0.0)))
        return data["frequency"].values, Estimates(value, ends / (2 * WIDTH), record)

    def _of(self, key: Key, *names: str) -> Estimates:
        data = self.cases[key].data
        value = _values(data, names[0])
        parts = [_values(data, name) if name in data else 0.0 * value for name in names[1:]]
        return Estimates(value, parts[0], parts[1] if len(parts) > 1 else 0.0 * value)


def _values(data: xr.Dataset, name: str) -> Array:
    return np.asarray(data[name].values, dtype=float)


def cases_with_spectra(results: Results) -> dict[float, Case]:
    """Cases without uncertainty, by variance, that have the spectra of all masses."""
    spectral = [c for c in results.deterministic if c.has("psd") and c.keeps_all_dofs]
    return {case.variance: case for case in spectral}


def paper_study(results: Results) -> Study | None:
    """The twelve cases of Sec. 3 where the file has them all, with their slip fractions."""
    found = {
        (case.std, case.correlation_length, case.variance): case
        for case in results.random
        if case.has("slip_std") and case.n_samples >= _FEWEST_SAMPLES
    }
    wanted = [(s, length, v) for s in STDS for length in LENGTHS for v in LEVELS]
    if results.structure is None or not all(key in found for key in wanted):
        return None
    return Study(
        {key: found[key] for key in wanted},
        {v: case for v, case in cases_with_spectra(results).items() if v in LEVELS},
        results.structure["frequencies_stuck"].values,
        results.structure["frequencies_slip"].values,
    )
