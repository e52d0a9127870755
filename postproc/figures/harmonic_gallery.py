"""The figures that a sweep by sines has data for, each with what to see in it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..harmonic import Sweep, equivalent, sweeps_of
from ..results import Results
from . import harmonic_figures
from .figure import SECTIONS, Figure

_STUDY = SECTIONS[2]


def of_sines(results: Results) -> Iterator[Figure]:
    """Frequency responses of the forced dof, and the linear mode that each level is alike."""
    if results.structure is None:
        return
    sweeps = sweeps_of(results)
    for process in dict.fromkeys(sweep.process for sweep in sweeps):
        own = sorted((s for s in sweeps if s.process == process), key=lambda s: s.amplitude)
        yield from _of_process(results, own, process)


def _of_process(results: Results, sweeps: list[Sweep], process: str) -> Iterator[Figure]:
    dof = results.forced_dof
    n_samples = sweeps[0].cases[0].n_samples
    name = "deterministic friction" if process == "none" else f"friction of {process}"
    band = (
        f" Lines: mean, from {n_samples} samples. Shaded: between the outer percentiles."
        if n_samples > 1
        else ""
    )
    n_unsteady = sum(sweep.n_unsteady for sweep in sweeps)
    steady = (
        "Every sample is steady."
        if n_unsteady == 0
        else f"{n_unsteady} responses of samples are not steady; they are drawn too."
    )
    cause = "acceleration a of the ground" if sweeps[0].is_base else "force F"
    yield Figure(
        f"frequency_response_{process}", f"Frequency responses of {results.place} {dof}, {name}",
        f"Fundamental of the displacement divided by the amplitude of the {cause}, beside the"
        " linear structure with all joints stuck and with all slipping. Slip lowers the resonance"
        f" and damps it; at a large amplitude it grows again.{band} {steady}",
        _STUDY,
        (
            partial(
                harmonic_figures.plot_frequency_response, sweeps=sweeps, dof=dof, results=results
            ),
            partial(harmonic_figures.plot_phase, sweeps=sweeps, dof=dof),
        ),
    )  # fmt: skip
    found = [equivalent(results, sweep) for sweep in sweeps]
    if not any(np.isfinite(mode.frequency).any() for mode in found):
        return
    bare = [
        sweep.level for sweep, mode in zip(sweeps, found, strict=True)
        if not np.isfinite(mode.frequency).any()
    ]  # fmt: skip
    without = f" No resonance within these frequencies: {', '.join(bare)}." if bare else ""
    lag = (
        "the motion along the inertia forces lags them" if sweeps[0].is_base
        else "the forced point lags the force"
    )  # fmt: skip
    yield Figure(
        f"equivalent_{process}", f"Equivalent stiffness and damping, {name}",
        f"The linear mode with the same response where {lag} by 90 degrees: its modal stiffness"
        " divided by that with all joints stuck, and its damping ratio, one mark for each sample."
        " Joints soften with the amplitude; damping is largest between stuck and slipping."
        f"{without}",
        _STUDY,
        tuple(
            partial(harmonic_figures.plot_equivalent, sweeps=sweeps, found=found, name=part)
            for part in ("stiffness", "damping")
        ),
        height=3.4,
    )  # fmt: skip
