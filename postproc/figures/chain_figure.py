"""Fig. 7: the chain with its Jenkins elements, drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

_MOST_DRAWN = 6  # of longer chains masses are left out
_PITCH = 2.2  # from mass to mass
_SIDE = 0.9  # of a mass
_INK, _FILL = "0.15", "0.88"


def plot_chain(axes: Axes, n_dof: int, forced: int | None) -> None:
    """Masses on springs from the wall; below each, spring and slider to the ground.

    The force acts on the mass `forced`, which counts from 1, or moves wall and ground.
    """
    _hatch(axes, -1.05, -0.75, 0.2, 1.5)  # the wall
    axes.plot([-0.75, -0.75], [-0.75, 0.75], color=_INK, linewidth=1.5)
    left = -0.75
    for position, number in enumerate(_drawn(n_dof, forced)):
        centre = 0.9 + position * _PITCH
        if number is None:
            axes.text(centre, 0.0, r"$\cdots$", ha="center", va="center", fontsize=22)
            left = centre + _SIDE / 2
            continue
        _spring(axes, (left, 0.0), (centre - _SIDE / 2, 0.0))
        axes.text((left + centre - _SIDE / 2) / 2, 0.3, "$k_1$", ha="center")
        _mass(axes, centre, number)
        _jenkins(axes, centre)
        left = centre + _SIDE / 2
        if number == forced:
            _force(axes, left, height=0.0 if number == n_dof else -0.32)
    if forced is None:
        _force(axes, -1.05, height=-1.25, name=r"$\ddot{u}(t)$")
    ground = -3.62
    _hatch(axes, -0.3, ground - 0.2, left + 1.0, 0.2)
    axes.plot([-0.3, left + 0.7], [ground, ground], color=_INK, linewidth=1.5)
    axes.set(xlim=(-1.2, left + 1.4), ylim=(ground - 0.3, 1.3), aspect="equal")
    axes.axis("off")


def _drawn(n_dof: int, forced: int | None) -> Iterator[int | None]:
    """Numbers of the masses drawn, None where some are left out."""
    ends = {1, 2, 3, n_dof - 1, n_dof, forced or 1} if n_dof > _MOST_DRAWN else range(1, n_dof + 1)
    before = 0
    for number in sorted(ends):
        if number > before + 1:
            yield None
        yield number
        before = number


def _force(axes: Axes, left: float, height: float, name: str = "$F(t)$") -> None:
    """An arrow at the right side of a mass; below the spring where one is there."""
    axes.annotate(
        "", (left + 1.2, height), (left, height), arrowprops={"arrowstyle": "-|>", "lw": 1.6}
    )
    axes.text(left + 0.6, height + (0.2 if height == 0.0 else -0.5), name, ha="center")


def _mass(axes: Axes, centre: float, number: int) -> None:
    axes.add_patch(
        Rectangle((centre - _SIDE / 2, -_SIDE / 2), _SIDE, _SIDE, facecolor=_FILL, edgecolor=_INK)
    )
    axes.text(centre, 0.0, f"$m_{{{number}}}$", ha="center", va="center")
    axes.annotate(
        "", (centre + 0.55, 0.85), (centre, 0.85), arrowprops={"arrowstyle": "->", "lw": 0.9}
    )
    axes.plot([centre, centre], [0.6, 1.0], color=_INK, linewidth=0.9)
    axes.text(centre + 0.62, 0.85, f"$x_{{{number}}}$", va="center", fontsize=8.5)


def _jenkins(axes: Axes, centre: float) -> None:
    """A spring in series with a slider that the load N presses on the ground."""
    _spring(axes, (centre, -_SIDE / 2), (centre, -2.35))
    axes.text(centre + 0.3, -1.45, "$k_2$")
    axes.plot([centre, centre], [-2.35, -2.9], color=_INK, linewidth=1.2)
    axes.add_patch(Rectangle((centre - 0.4, -3.5), 0.8, 0.6, facecolor="1.0", edgecolor=_INK))
    axes.text(centre, -3.2, r"$\mu$", ha="center", va="center", fontsize=9)
    axes.plot([centre - 0.4, centre + 0.4], [-3.56, -3.56], color=_INK, linewidth=2.4)
    axes.annotate(
        "", (centre - 0.32, -2.9), (centre - 0.32, -2.3), arrowprops={"arrowstyle": "->", "lw": 0.9}
    )
    axes.text(centre - 0.42, -2.45, "$N$", ha="right", fontsize=8.5)


def _spring(axes: Axes, start: Sequence[float], end: Sequence[float], turns: int = 5) -> None:
    """A zigzag between two points."""
    along = np.array(end) - np.array(start)
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    share = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 1), [1.0]])
    swing = np.zeros(share.size)
    swing[2:-2:2], swing[3:-2:2] = 0.13, -0.13
    points = np.array(start) + share[:, None] * along + swing[:, None] * across
    axes.plot(points[:, 0], points[:, 1], color=_INK, linewidth=1.2)


def _hatch(axes: Axes, left: float, bottom: float, width: float, height: float) -> None:
    patch = Rectangle((left, bottom), width, height, hatch="////", edgecolor="0.5", linewidth=0)
    patch.set_facecolor("none")
    axes.add_patch(patch)
