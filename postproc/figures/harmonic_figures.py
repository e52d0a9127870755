"""Figures of sweeps by sines, one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from ..harmonic import Equivalent, Sweep, linear_receptance
from ..results import Results
from . import style

_FINE = 600  # frequencies of a linear curve


def plot_frequency_response(
    axes: Axes, sweeps: Sequence[Sweep], dof: int, results: Results
) -> None:
    """Receptance of a dof: mean over the law, a line a level; shaded: between outer percentiles."""
    span = np.linspace(sweeps[0].frequency[0], sweeps[0].frequency[-1], _FINE)
    linear = {
        "all stuck, linear": (np.abs(linear_receptance(results, span, True)[:, dof - 1]), "-"),
        "all slipping, linear": (np.abs(linear_receptance(results, span, False)[:, dof - 1]), ":"),
    }
    for name, (curve, line) in linear.items():
        axes.semilogy(span, curve, color="0.45", linewidth=0.9, linestyle=line, label=name)
    top, bottom = 0.0, np.inf
    for rank, sweep in enumerate(sweeps):
        mean, low, high = sweep.outer(dof)
        look = style.of_rank(rank, len(sweeps))
        axes.semilogy(sweep.frequency, mean, label=sweep.level, **look)
        if np.any(high > low):
            axes.fill_between(sweep.frequency, low, high, color=look["color"], alpha=0.18, lw=0)
        top, bottom = max(top, mean.max(), high.max()), min(bottom, mean.min(), low.min())
    cause = "a" if sweeps[0].is_base else "F"
    axes.set(
        xlabel="frequency [Hz]",
        ylabel=f"|x| / {cause} of {results.place} {dof} [{sweeps[0].unit}]",
        xlim=(span[0], span[-1]), ylim=(0.5 * bottom, 2 * top),
    )  # fmt: skip
    style.add_legend(axes)


def plot_phase(axes: Axes, sweeps: Sequence[Sweep], dof: int) -> None:
    """Phase of a dof against the sine, mean direction over samples."""
    for rank, sweep in enumerate(sweeps):
        curve = sweep.receptance.isel(dof=dof - 1).values
        mean = np.unwrap(np.angle((curve / np.abs(curve)).mean(axis=1)))
        axes.plot(
            sweep.frequency, np.degrees(mean), label=sweep.level,
            **style.of_rank(rank, len(sweeps)),
        )  # fmt: skip
    axes.set(xlabel="frequency [Hz]", ylabel="phase [degrees]")
    axes.set_xlim(sweeps[0].frequency[0], sweeps[0].frequency[-1])
    style.add_legend(axes)


def plot_equivalent(
    axes: Axes, sweeps: Sequence[Sweep], found: Sequence[Equivalent], name: str
) -> None:
    """Equivalent `stiffness` or `damping` over the amplitude at resonance: a mark a sample."""
    for rank, (sweep, mode) in enumerate(zip(sweeps, found, strict=True)):
        values = getattr(mode, name)
        look = style.of_rank(rank, len(sweeps)) | {"linestyle": "none", "clip_on": False}
        if np.isfinite(values).any():
            axes.plot(mode.amplitude, values, label=sweep.level, alpha=0.7, **look)
    label = {"stiffness": "modal stiffness / stuck", "damping": "damping ratio"}[name]
    axes.set_xscale("log")
    style.label_logarithmic(axes.xaxis)
    of_what = "along the inertia forces" if sweeps[0].is_base else "of the forced point"
    axes.set(xlabel=f"amplitude {of_what} at resonance [m]", ylabel=label, ylim=(0, None))
    style.add_legend(axes, "ground" if sweeps[0].is_base else "force")
