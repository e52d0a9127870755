"""The paper's chain under a reference force, as all marches here take it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

N = 5


@dataclass
class Problem:
    """The march, and its known results."""

    dt: float  # [s]
    contact: float  # stiffness of a Jenkins spring [N/m]
    limit: float  # slip force [N]
    stiffness: np.ndarray  # (mass, mass) with all sliders slipping [N/m]
    damping: np.ndarray  # (mass, mass) modal, of the stuck chain [N s/m]
    force: np.ndarray  # (step) on the last mass, linear between samples [N]
    whole: int  # steps of the reference
    snapshots: np.ndarray  # (snapshot, mass) exact displacements at every 100th step [m]
    slip: np.ndarray  # (mass) exact slip fractions over the whole reference

    @property
    def steps(self) -> int:
        """Steps of the march, which may be shorter than the reference."""
        return len(self.force) - 1

    def write(self, path: Path) -> None:
        """As newmark.cpp and cvode.c read it."""
        with path.open("w") as file:
            print(self.steps, repr(self.dt), repr(self.contact), repr(self.limit), file=file)
            for values in (self.stiffness, self.damping, self.force):
                np.savetxt(file, values)


def read_problem(folder: Path, case: str, steps: int) -> Problem:
    """The first steps of a reference history; unit masses."""
    lines = (folder / f"{case}_reference.txt").read_text().splitlines()
    numbers = [np.array(line.split(), float) for line in lines if not line.startswith("#")]
    dt, whole = numbers[0][0], int(numbers[0][1])
    _, coupling, contact, load, ratio = numbers[1]
    stiffness = 2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
    stiffness[-1, -1] = 1.0
    stiffness *= coupling
    squares, modes = np.linalg.eigh(stiffness + contact * np.eye(N))
    damping = modes @ np.diag(2 * ratio * np.sqrt(squares)) @ modes.T
    force = np.loadtxt(folder / f"{case}_force.txt")[: steps + 1]
    snapshots = np.loadtxt(folder / f"{case}_x.txt")[1:, 1:]
    limit = float(load * numbers[2][0])
    return Problem(
        float(dt), float(contact), limit, stiffness, damping, force, whole, snapshots, numbers[3]
    )
