"""Table 2 over a dozen force records, beside the paper: python bench/table_2.py [METHOD].

Every record is another seed of input/deterministic.nml, all 400,000 steps, nothing discarded.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PAPER = {"c001": (7, 8, 12, 22, 37), "c002": (36, 45, 52, 59, 65)}  # variances 3.7 and 41.1
N_SEEDS = 12


def slip_percent(seed: int, method: str, folder: Path) -> dict[str, np.ndarray]:
    """Percentage of time in slip of each oscillator, for both variances."""
    output = folder / f"{seed}.h5"
    settings = {
        "scene%seed": seed,
        "integration%method": method,
        "integration%n_discard": 0,
        "output%quantities": "slip",
    }
    overrides = [word for item in settings.items() for word in ("--set", "{}={}".format(*item))]
    subprocess.run(
        [ROOT / "build/release/bin/entroslip", "run", ROOT / "input/deterministic.nml",
         "--quiet", "--output", output, *overrides],
        check=True,
    )  # fmt: skip
    with h5py.File(output) as file:
        return {case: 100 * file[f"campaign/{case}/slip_fraction"][0] for case in PAPER}


def main() -> None:
    """Print mean and standard deviation over the seeds."""
    method = sys.argv[1] if len(sys.argv) > 1 else "event"
    with tempfile.TemporaryDirectory() as folder:
        runs = [slip_percent(seed, method, Path(folder)) for seed in range(1, N_SEEDS + 1)]
    print(f"time in slip [%], {method}, {N_SEEDS} force records")
    for case, paper in PAPER.items():
        values = np.array([run[case] for run in runs])
        for name, row, digits in (
            ("mean", values.mean(axis=0), 1),
            ("scatter", values.std(axis=0, ddof=1), 2),
            ("paper", paper, 0),
            ("difference", values.mean(axis=0) - paper, 1),
        ):
            print(f"  {case} {name:<11}", "".join(f"{x:8.{digits}f}" for x in row))


if __name__ == "__main__":
    main()
