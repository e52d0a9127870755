"""Draws docs/exact_march.svg: one part of a step in which a joint starts to slip, and its guard.

Run from the root: python bench/exact_march_figure.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

KAPPA, STIFFNESS, REACH = 2.5, 0.3, 1.0  # h^2 k/m of the joint, h^2 k/m of the rest, mu N/k
DEGREE = 12


def series(x0: float, x1: float, stiffness: float, pull: float) -> np.ndarray:
    """Powers of the path of one mass in free motion, time in parts of a step."""
    x = np.zeros(DEGREE + 1)
    x[:2] = x0, x1
    for k in range(DEGREE - 1):
        x[k + 2] = ((pull if k == 0 else 0.0) - stiffness * x[k]) / ((k + 1) * (k + 2))
    return x


def draw(path: Path) -> None:
    """Upper axes: both paths; lower axes: the guard."""
    stuck = series(0.1, 2.4, STIFFNESS + KAPPA, 0.0)
    time = np.linspace(0.0, 1.0, 401)
    before = np.polyval(stuck[::-1], time)
    tau = time[np.argmax(before > REACH)]
    speed = np.polyval(np.polyder(stuck[::-1]), tau)
    slip = series(REACH, speed, STIFFNESS, -KAPPA * REACH)
    after = np.polyval(slip[::-1], time - tau)

    figure, (above, below) = plt.subplots(
        2, 1, figsize=(6.4, 5.2), sharex=True, height_ratios=(3, 2)
    )
    above.plot(time, before, "C0--", lw=2, label="series of the whole part, stuck")
    above.plot(time[time >= tau], after[time >= tau], "C3", lw=2, label="after the transition")
    above.axhline(REACH, color="0.6", lw=0.8)
    above.annotate("z + mu N/k", (0.02, REACH + 0.03), color="0.4")
    above.annotate("", (1.0, after[-1]), (1.0, before[-1]), arrowprops={"arrowstyle": "->"})
    above.annotate("d(1 - tau)", (1.0, before[-1] - 0.03), ha="right", va="top")
    above.set(ylabel="path w.x")
    above.legend(frameon=False, loc="lower right")
    guard = REACH - before
    below.plot(time, guard, "C0", label="guard mu N/k - |w.x - z|")
    below.plot([0.0, 1.0], guard[[0, -1]], "0.6", lw=0.8, label="its chord")
    below.axhline(0.0, color="0.6", lw=0.8)
    below.plot(tau, 0.0, "ko", ms=4)
    below.annotate("tau", (tau + 0.01, 0.03))
    below.set(xlabel="time t, 0 to 1 over the part", ylabel="guard", xlim=(0.0, 1.02))
    below.legend(frameon=False)
    figure.tight_layout()
    figure.align_ylabels()
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    plt.rcParams["svg.hashsalt"] = "exact_march"
    draw(Path("docs/exact_march.svg"))
