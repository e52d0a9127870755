"""Numbers of the joints: time in slip, power, slip distance, largest displacement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .results import Case

Values = NDArray[np.float64]  # (joint)
_PERCENT = 100.0


@dataclass(frozen=True)
class OfJoints:
    """A number of each joint, mean over samples; `name` is the table's and the figure's."""

    name: str
    title: str
    unit: str
    dataset: str  # of samples, with means beside it but of the largest displacement

    @property
    def heading(self) -> str:
        """The title with a capital letter."""
        return self.title[0].upper() + self.title[1:]

    def is_in(self, case: Case) -> bool:
        """True if the case has it, with its error."""
        if self.name == "displacement":
            return case.has(self.dataset) and case.n_samples > 1
        return case.has(f"{self.dataset}_mean", f"{self.dataset}_mean_error")

    def of(self, case: Case) -> tuple[Values, Values]:
        """The mean and its standard error."""
        if self.name == "displacement":
            values = case.data[self.dataset].values
            return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))
        mean = case.data[f"{self.dataset}_mean"].values
        if self.name == "slip":
            return _PERCENT * mean, _PERCENT * slip_mean_error(case)
        scale = 1.0 / case.duration if self.name == "power" else 1.0
        return scale * mean, scale * case.data[f"{self.dataset}_mean_error"].values

    def errors(self, cases: Sequence[Case]) -> str:
        """Parts of the errors of these cases; short marches have no time-average error."""
        if self.name == "slip" and all(case.has("slip_mean_time_error") for case in cases):
            return "Monte Carlo and time average together"
        if self.name != "slip" and all(case.is_sine or _has_own_records(case) for case in cases):
            return "Monte Carlo"
        return "Monte Carlo alone, without that of the time average" + (
            ", which is often larger" if self.name != "slip" else ""
        )


QUANTITIES = (
    OfJoints("slip", "mean time in slip", "%", "slip"),
    OfJoints("power", "dissipated power", "W", "dissipation"),
    OfJoints("distance", "slip distance", "m", "slip_distance"),
    OfJoints("displacement", "largest displacement", "m", "joint_displacement_max"),
)


def _has_own_records(case: Case) -> bool:
    """True if the time average of each sample's own force record is part of the scatter."""
    return case.has("slip_mean_time_error") and not case.data["slip_mean_time_error"].any()


def slip_mean_error(case: Case) -> Values:
    """Standard error of the mean time in slip: Monte Carlo, and time average where it is known."""
    error = case.data["slip_mean_error"].values
    if case.has("slip_mean_time_error"):
        error = np.hypot(error, case.data["slip_mean_time_error"].values)
    return np.asarray(error, dtype=float)


def slip_with_error(case: Case) -> tuple[Values, Values]:
    """Slip fractions of the first sample, and the errors of these time averages.

    The file has errors from the autocovariance of the time in slip. Where it has none, slips and
    sticks are taken to have exponential durations: p (1 - p) sqrt(2/n) for a fraction p of n slips.
    """
    data = case.data.isel(sample=0)
    slip = data["slip_fraction"].values.astype(float)
    count = np.maximum(data["slip_starts"].values.astype(float), 1.0)
    error = slip * (1.0 - slip) * np.sqrt(2.0 / count)
    if "slip_fraction_error" in data:
        measured = data["slip_fraction_error"].values.astype(float)
        error = np.where(np.isfinite(measured), measured, error)
    return slip, error
