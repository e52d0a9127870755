"""Table 2 over a thousand force records, beside the paper: python bench/table_2.py [METHOD].

Every record of 100,000 steps drives a sample of input/deterministic.nml, whose friction is 0.2 to
nine digits. Tells also how far the time in slip falls from each joint to the next (statement 6a).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PAPER = {"c001": (7, 8, 12, 22, 37), "c002": (36, 45, 52, 59, 65)}  # variances 3.7 and 41.1
N_RECORDS = 1000
FRICTION, SCATTER = 0.2, 1.0e-9  # the program refuses values that do not scatter


def slip_percent(method: str, folder: Path) -> dict[str, np.ndarray]:
    """Percentage of time in slip (record, joint), for both variances."""
    values, output = folder / "friction.txt", folder / "slip.h5"
    np.savetxt(values, np.tile(FRICTION + SCATTER * np.arange(N_RECORDS)[:, None], 5), fmt="%.12g")
    settings = {
        "process%values": values,
        "excitation%per_sample": ".true.",
        "integration%method": method,
        "integration%n_steps": 100000,
        "campaign%n_samples": N_RECORDS,
        "output%quantities": "slip",
    }
    overrides = [word for item in settings.items() for word in ("--set", "{}={}".format(*item))]
    subprocess.run(
        [ROOT / "build/release/bin/entroslip", "run", ROOT / "input/deterministic.nml",
         "--quiet", "--output", output, *overrides],
        check=True, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    with h5py.File(output) as file:
        return {case: 100 * file[f"campaign/{case}/slip_fraction"][:] for case in PAPER}


def main() -> None:
    """Print means over the records with their errors, and differences of neighbours."""
    method = sys.argv[1] if len(sys.argv) > 1 else "event"
    with tempfile.TemporaryDirectory() as folder:
        found = slip_percent(method, Path(folder))
    print(f"time in slip [%], {method}, {N_RECORDS} force records of 100,000 steps")
    for case, paper in PAPER.items():
        values = found[case]
        steps = np.diff(values, axis=1)
        for name, row, digits in (
            ("mean", values.mean(axis=0), 3),
            ("its s.e.", values.std(axis=0, ddof=1) / np.sqrt(N_RECORDS), 3),
            ("paper", paper, 0),
            ("less the paper", values.mean(axis=0) - paper, 1),
            ("to the next joint", steps.mean(axis=0), 3),
            ("its s.e.", steps.std(axis=0, ddof=1) / np.sqrt(N_RECORDS), 3),
        ):
            print(f"  {case} {name:<18}", "".join(f"{x:8.{digits}f}" for x in row))


if __name__ == "__main__":
    main()
