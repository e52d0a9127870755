"""Figures of single responses: a history, and one transition between stick and slip, enlarged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..results import Case, Results
from . import style

_SHOWN = 60.0  # s of a history, at most
_SHOWN_LOOPS = 10.0  # s of hysteresis loops, at most
_LOOPS = 3  # joints in one figure
_MARGIN = 0.6  # of an episode's length, shown on either side
_STEPS_AROUND = 5  # of a transition enlarged
_FINER = 8  # points of a curve between two time steps enlarged


@dataclass(frozen=True)
class Episode:
    """A slip of one joint, from its start to the stick that ends it."""

    dof: int  # counts from 1
    start: float
    end: float
    direction: int


def plot_history(axes: Axes, case: Case, results: Results) -> None:
    """Displacements of the first sample, the last minute of it at most."""
    time = case.data["time"].values
    first = int(np.searchsorted(time, time[-1] - _SHOWN))
    for dof in style.some_of(case.kept_dofs, 5, results.forced_dof):
        axes.plot(
            time[first:], case.data["displacement"].isel(sample=0, dof=dof - 1).values[first:],
            label=f"{results.place} {dof}",
            **style.line_of_dof(dof, case.kept_dofs[-1]) | {"linewidth": 1.0},
        )  # fmt: skip
    axes.set(xlabel="time [s]", ylabel="displacement [m]", xlim=(time[first], time[-1]))
    style.add_legend(axes)


def find_episode(case: Case) -> Episode | None:
    """The longest slip that starts in the second half of the first sample and ends in it."""
    rows = _transitions(case)
    middle = float(case.data["time"][-1]) / 2.0
    found: list[Episode] = []
    for dof in range(1, case.n_joints + 1):
        times, kinds = rows.time[rows.joint == dof], rows.kind[rows.joint == dof]
        found += [
            Episode(dof, float(times[i]), float(times[i + 1]), int(kinds[i]))
            for i in range(times.size - 1)
            if kinds[i] != 0 and kinds[i + 1] == 0 and times[i] > middle
        ]
    return max(found, key=lambda episode: episode.end - episode.start, default=None)


def plot_slider(axes: Axes, case: Case, chain: xr.Dataset, episode: Episode) -> None:
    """Force in the slider and velocity of its mass through one slip, a mark per time step."""
    margin = _MARGIN * (episode.end - episode.start)
    limit = _limit(case, chain, episode.dof)
    times, _, force = joint_force(case, chain, episode.dof)
    shown = (times >= episode.start - margin) & (times <= episode.end + margin)
    look = style.of_dof(1, 5)
    axes.axvspan(episode.start, episode.end, color="0.93", zorder=0, label="slip")
    axes.plot(times[shown], force[shown], color=look["color"], label="force in the slider")
    _mark_steps(axes, case, times[shown], force[shown])
    for sign in (-1, 1):
        axes.axhline(sign * limit, color="0.4", linewidth=0.9, linestyle="--",
                     label=r"$\pm\mu N$" if sign > 0 else None)  # fmt: skip
    axes.set(
        xlabel="time [s]", ylabel="force [N]",
        xlim=(episode.start - margin, episode.end + margin), ylim=(-1.2 * limit, 1.2 * limit),
    )  # fmt: skip
    beside = axes.twinx()
    beside.grid(visible=False)
    velocity = case.data["velocity"].isel(sample=0, dof=episode.dof - 1).values
    steps = case.data["time"].values
    shown = (steps >= episode.start - margin) & (steps <= episode.end + margin)
    other = style.of_dof(2, 5)
    curve = {"color": other["color"], "linestyle": "-.", "label": "velocity of the mass"}
    beside.plot(steps[shown], velocity[shown], **curve)
    axes.plot([], [], **curve)  # for the legend
    style.add_legend(axes)
    largest = 1.2 * np.abs(velocity[shown]).max()
    beside.set(ylabel="velocity [m/s]", ylim=(-largest, largest))
    beside.spines["right"].set_visible(True)


def plot_transition(axes: Axes, case: Case, chain: xr.Dataset, episode: Episode) -> None:
    """The end of that slip at full resolution: the transition falls inside a time step."""
    steps = case.data["time"].values
    width = _STEPS_AROUND * (steps[1] - steps[0])
    times, _, force = joint_force(case, chain, episode.dof, finer=_FINER)
    shown = np.abs(times - episode.end) <= width
    axes.axvspan(episode.end - width, episode.end, color="0.93", zorder=0, label="slip")
    axes.axvline(episode.end, color="0.2", linewidth=0.9, linestyle=":", label="located transition")
    axes.plot(times[shown], force[shown], label="force in the slider", **style.line_of_dof(1, 5))
    _mark_steps(axes, case, times[shown], force[shown])
    axes.set(xlabel="time [s]", ylabel="force [N]", xlim=(episode.end - width, episode.end + width))
    axes.ticklabel_format(useOffset=False)
    style.add_legend(axes)


def most_dissipating(case: Case, structure: xr.Dataset) -> list[int]:
    """Joints that dissipate most in the first sample, a few, by number; their dofs are kept."""
    is_dropped = ~np.isin(np.arange(1, case.n_dof + 1), case.kept_dofs)
    is_unknown = structure["directions"].values[:, is_dropped].any(axis=1)
    work = np.where(is_unknown, 0.0, case.data["dissipation"].isel(sample=0).values)
    chosen = 1 + np.argsort(work)[::-1][:_LOOPS]
    return sorted(int(joint) for joint in chosen if work[joint - 1] > 0.0)


def plot_hysteresis(axes: Axes, case: Case, structure: xr.Dataset, joint: int) -> None:
    """Force over displacement of a joint, the last ten seconds at most."""
    times, place, force = joint_force(case, structure, joint, finer=4)
    shown = times >= times[-1] - _SHOWN_LOOPS
    look = style.line_of_dof(joint, case.n_joints) | {"linewidth": 0.9, "linestyle": "-"}
    axes.plot(place[shown], force[shown], **look)
    axes.set(xlabel=f"displacement of joint {joint} [m]", ylabel=f"force of joint {joint} [N]")


def joint_force(
    case: Case, structure: xr.Dataset, joint: int, finer: int = 1
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Times of steps (each in `finer` parts) and transitions; w.x [m] and the force of a joint [N].

    Of the first sample. While it slips the force is the limit; when it sticks the slider stays
    where that limit put it.
    """
    rows = _transitions(case)
    times, kinds = rows.time[rows.joint == joint], rows.kind[rows.joint == joint]
    direction = structure["directions"].values[joint - 1]
    one = case.data.isel(sample=0)
    moved = np.flatnonzero(direction)  # others may have no history
    place, speed = (
        one[name].transpose("time", "dof").values[:, moved] @ direction[moved]
        for name in ("displacement", "velocity")
    )
    steps = one["time"].values
    parts = np.linspace(0.0, 1.0, finer, endpoint=False)
    between = (steps[:-1, None] + np.diff(steps)[:, None] * parts).ravel()
    inside = times[(times >= steps[0]) & (times <= steps[-1])]
    every = np.union1d(np.append(between, steps[-1]), inside)
    position = _hermite(steps, place, speed, every)
    stiffness = float(structure["joint_stiffness"][joint - 1])
    limit = _limit(case, structure, joint)
    kinds = np.concatenate([[0], kinds])  # sliders start at zero, stuck
    at_stick = np.interp(times, every, position)
    left = np.where(kinds[:-1] != 0, kinds[:-1] * limit - stiffness * at_stick, 0.0)
    slider = np.concatenate([[0.0], left])
    now = np.searchsorted(times, every, side="right")  # transitions before
    slips = kinds[now] != 0
    force = np.where(slips, kinds[now] * limit, stiffness * position + slider[now])
    return every, position, force


@dataclass(frozen=True)
class _Rows:
    time: NDArray[np.float64]
    joint: NDArray[np.int64]
    kind: NDArray[np.int64]


def _transitions(case: Case) -> _Rows:
    """Transitions of the first sample, in time order."""
    data = case.data
    first = data["transition_sample"].values == data["sample"].values[0]
    columns = (data[f"transition_{name}"].values[first] for name in ("time", "joint", "kind"))
    return _Rows(*columns)


def _limit(case: Case, chain: xr.Dataset, dof: int) -> float:
    return float(case.data["friction"][0, dof - 1] * chain["normal_load"][dof - 1])


def _mark_steps(
    axes: Axes, case: Case, times: NDArray[np.float64], force: NDArray[np.float64]
) -> None:
    steps = case.data["time"].values
    steps = steps[(steps >= times[0]) & (steps <= times[-1])]
    axes.plot(steps, np.interp(steps, times, force), ".", color="0.2", label="time steps")


def _hermite(
    x: NDArray[np.float64], y: NDArray[np.float64], slope: NDArray[np.float64],
    at: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """Cubic through values and slopes."""
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    t = (at - x[i]) / h
    start = (1 + 2 * t) * (1 - t) ** 2 * y[i] + t * (1 - t) ** 2 * h * slope[i]
    return start + t**2 * (3 - 2 * t) * y[i + 1] + t**2 * (t - 1) * h * slope[i + 1]
