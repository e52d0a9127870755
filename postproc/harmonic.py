"""Responses to sines: frequency responses over samples, and the linear oscillator that each level
of the force makes of the structure.

>>> sweeps = sweeps_of(open_results("sine.h5"))
>>> sweeps[0].receptance.sel(dof=5)  # x/F, complex, over sample and frequency
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import eigh

from .results import Case, Results


@dataclass(frozen=True)
class Sweep:
    """The cases of one process (or none) at one amplitude, by ascending frequency."""

    process: str
    amplitude: float  # N, or m/s^2 of the ground
    cases: tuple[Case, ...]

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Frequencies of the cases [Hz]."""
        return np.array([case.frequency for case in self.cases])

    @property
    def level(self) -> str:
        """The amplitude in words."""
        return self.cases[0].level

    @property
    def is_base(self) -> bool:
        """True if the ground moves."""
        return self.cases[0].is_base

    @property
    def unit(self) -> str:
        """Unit of the receptance."""
        return "s²" if self.is_base else "m/N"

    @property
    def receptance(self) -> xr.DataArray:
        """Fundamental of the displacement over the force, complex (frequency, sample, dof)."""
        found = [
            case.data["harmonic_amplitude"] * np.exp(1j * case.data["harmonic_phase"])
            for case in self.cases
        ]
        axis = xr.DataArray(self.frequency, dims="frequency", attrs={"units": "Hz"})
        joined: xr.DataArray = xr.concat(found, dim=axis) / self.amplitude
        name = "fundamental of the displacement over force"
        joined.attrs = {"units": self.unit, "long_name": name}
        return joined

    def outer(self, dof: int) -> NDArray[np.float64]:
        """Mean, lowest and highest percentile of |x|/F of a dof over the law [m/N] (3, frequency):
        the best estimates, or those of the samples where there are none; all one of one sample.
        """
        if all(case.has("harmonic_amplitude_percentiles") for case in self.cases):
            rows = []
            for case in self.cases:
                data = case.data.isel(dof=dof - 1)
                ends = data["harmonic_amplitude_percentiles"].isel(percentile=[0, -1]).values
                rows.append([float(data["harmonic_amplitude_mean"]), *ends])
            return np.array(rows).T / self.amplitude
        size = np.abs(self.receptance.isel(dof=dof - 1).values)  # (frequency, sample)
        return np.stack([size.mean(axis=1), *np.percentile(size, (5, 95), axis=1)])

    @property
    def n_unsteady(self) -> int:
        """Samples of all cases whose last two windows of ten periods do not agree."""
        return sum(int((case.data["steady"] == 0).sum()) for case in self.cases)


@dataclass(frozen=True)
class Equivalent:
    """The linear mode that answers alike at resonance, a value for each sample.

    At the frequency where the forced point lags the force by 90 degrees, inertia and stiffness
    balance: omega^2 is the ratio of modal stiffness to modal mass, and the force feeds what damping
    takes. Not a number where a sample has no such frequency within the sweep.
    """

    frequency: NDArray[np.float64]  # Hz
    stiffness: NDArray[np.float64]  # modal, over that of the mode with all joints stuck
    damping: NDArray[np.float64]  # ratio: work in a cycle over 4 pi times the kinetic energy
    amplitude: NDArray[np.float64]  # of the forced point [m]


def sweeps_of(results: Results) -> list[Sweep]:
    """Sweeps of two frequencies or more, deterministic ones first."""
    sines = [case for case in results.cases if case.is_sine and case.has("harmonic_amplitude")]
    keys = dict.fromkeys((case.process, case.strength) for case in sines)
    found = []
    for process, amplitude in keys:
        own = [c for c in sines if (c.process, c.strength) == (process, amplitude)]
        own.sort(key=lambda case: case.frequency)
        if len(own) > 1:
            found.append(Sweep(process, amplitude, tuple(own)))
    return found


def linear_receptance(
    results: Results, frequency: NDArray[np.float64], is_stuck: bool
) -> NDArray[np.complex128]:
    """x/F of the structure with all joints stuck or all slipping [m/N] (frequency, dof)."""
    structure = _structure(results)
    mass, damping = (matrix(structure, name) for name in ("mass", "damping"))
    stiffness = _stuck(structure) if is_stuck else matrix(structure, "stiffness")
    load = structure["load"].values.sum(axis=0)
    omega = 2 * np.pi * frequency[:, None, None]
    dynamic = stiffness - omega**2 * mass + 1j * omega * damping
    return np.linalg.solve(dynamic, np.broadcast_to(load, (frequency.size, load.size))[..., None])[
        ..., 0
    ]


def equivalent(results: Results, sweep: Sweep, mode: int | None = None) -> Equivalent:
    """The linear mode that each sample of a sweep is alike at its resonance.

    The resonance is the one of the largest amplitude of the forced point. Its stiffness is
    divided by that of `mode` (from 1), or else of the stuck mode whose shape is nearest.
    """
    structure = _structure(results)
    mass = matrix(structure, "mass")
    load = structure["load"].values.sum(axis=0)
    shape = sweep.receptance.values  # (frequency, sample, dof)
    forced = shape @ load  # of the point that the work is done on
    count = shape.shape[1]
    columns = np.full((4, count), np.nan)
    stuck_values, stuck_shapes = eigh(_stuck(structure), mass)
    for sample in range(count):
        found = _resonance(forced[:, sample])
        if found is None:
            continue
        i, weights = found  # of frequencies i and i + 1
        both = slice(i, i + 2)
        frequency = weights @ sweep.frequency[both]
        # between two frequencies the dynamic stiffness is nearly linear, the response is not
        rigid = weights @ (1 / forced[both, sample])
        at = weights @ (shape[both, sample] / forced[both, sample, None]) / rigid
        omega = 2 * np.pi * frequency
        kinetic = 0.5 * omega**2 * np.real(np.conj(at) @ mass @ at)  # its largest, over F^2
        work = -np.pi * np.imag(at @ load)  # in a cycle, over F^2
        nearest = mode or 1 + int(np.argmax(np.abs(stuck_shapes.T @ mass @ at)))
        columns[:, sample] = (
            frequency, omega**2 / stuck_values[nearest - 1], work / (4 * np.pi * kinetic),
            sweep.amplitude * abs(at @ load) / np.linalg.norm(load),
        )  # fmt: skip
    return Equivalent(*columns)


def matrix(structure: xr.Dataset, name: str) -> NDArray[np.float64]:
    """M, C or K (dof, dof) from its entries in the results file."""
    size = structure.sizes["dof"]
    full = np.zeros((size, size))
    row, column = (structure[f"{name}_{axis}"].values - 1 for axis in ("row", "column"))
    full[row, column] = structure[f"{name}_value"].values
    return full


def _structure(results: Results) -> xr.Dataset:
    if results.structure is None:
        raise ValueError(f"{results.path}: has no structure")
    return results.structure


def _stuck(structure: xr.Dataset) -> NDArray[np.float64]:
    """K with the joints' springs."""
    directions = structure["directions"].values  # (joint, dof)
    springs = structure["joint_stiffness"].values[:, None] * directions
    stiff: NDArray[np.float64] = matrix(structure, "stiffness") + directions.T @ springs
    return stiff


def _resonance(forced: NDArray[np.complex128]) -> tuple[int, NDArray[np.float64]] | None:
    """Place i where the phase falls through -90 degrees, and weights of frequencies i and i + 1."""
    spring = np.real(1 / forced)  # stiffness less inertia, as the forced point feels them
    crossings = np.flatnonzero((spring[:-1] > 0) & (spring[1:] <= 0))
    if not crossings.size:
        return None
    i = int(crossings[np.argmax(np.abs(forced[crossings]) + np.abs(forced[crossings + 1]))])
    share = float(spring[i] / (spring[i] - spring[i + 1]))
    return i, np.array([1 - share, share])
