"""Errors and coverage of the regression: python bench/regression.py [TRUTH [TIMES [N ...]]].

Campaigns of TRUTH samples a case (20,000; kept in results/) are the truth. From each of them N
samples (100) are drawn TIMES times (400), each time all statistics are estimated, and their
errors compared with plain sampling's. The law of the friction is that of the campaign's samples.
Every case is estimated by itself, and pooled with those of the same force. Builds the target
bench_regression. Scenes: the paper's six processes under both forces, nearly stuck, 20 masses.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "build/release/bin"

SCENE = """\
&scene seed = 99 /
&process correlation_length = {lengths} order = {orders} mean = 0.2 std = {std} /
&chain n_dof = {n_dof} /
&excitation variance = {force} /
&integration method = 'event' n_steps = {steps} /
&campaign n_samples = {truth} estimator = 'plain' /
&output segment_length = {segment} /
"""
PAPER = {
    "lengths": "0.3, 1.0, 3.0", "orders": "2, 5, 10", "std": "0.067, 0.10", "force": "3.7, 41.1",
    "n_dof": 5, "steps": 100000, "segment": 2048,
}  # fmt: skip
ONE = {"lengths": "1.0", "orders": "5"}
#: name -> values of the scene, and its pools of cases
SCENES = {
    "paper": (PAPER, [[1, 3, 5, 7, 9, 11], [2, 4, 6, 8, 10, 12]]),
    "stuck": (PAPER | ONE | {"std": "0.10", "force": "0.8"}, [[1]]),
    "twenty": (PAPER | ONE | {"n_dof": 20, "steps": 20000, "segment": 1024}, [[1, 3], [2, 4]]),
}
QUANTITIES = {
    "mean": "mean slip", "std": "std of slip", "slip5": "slip 5 %", "slip95": "slip 95 %",
    "var_mean": "pseudo-variance of the mean", "var5": "pseudo-variance 5 %",
    "var95": "pseudo-variance 95 %", "ratio": "band ratio", "psd_mean": "mean spectrum < 3 Hz",
    "psd5": "spectrum 5 % < 3 Hz", "psd95": "spectrum 95 % < 3 Hz",
}  # fmt: skip
HIGHEST = 3.0  # [Hz] of the bins in the table


class Row(NamedTuple):
    """One output over all replicates."""

    quantity: str
    gain: float  # error of plain sampling over that of the estimate
    plain_covers: float
    covers: float


def truth_of(name: str, values: dict[str, object], truth: int) -> Path:
    """The campaign, run where it is not there yet."""
    folder = ROOT / "results"
    folder.mkdir(exist_ok=True)
    path = folder / f"regression_{name}_{truth}.h5"
    if not path.exists():
        scene = path.with_suffix(".nml")
        scene.write_text(SCENE.format(truth=truth, **values))
        subprocess.run([BUILT / "entroslip", "run", scene, "--quiet", "--output", path], check=True)
    return path


def rows_of(path: Path, n: int, replicates: int, cases: list[int]) -> list[Row]:
    """All outputs of some cases, pooled."""
    names = [f"c{case:03}" for case in cases]
    words = [BUILT / "bench_regression", path, n, replicates, 1, 4, *names]
    said = subprocess.run(
        [str(word) for word in words], check=True, capture_output=True, text=True
    ).stdout
    rows = []
    for line in said.splitlines():
        if line.startswith("#"):
            continue
        _, _, quantity, frequency, plain, ours, _, plain_covers, covers = line.split()
        if float(frequency) < HIGHEST and float(plain) > 0:
            gain = float(plain) / max(float(ours), 1e-300)
            rows.append(Row(quantity, gain, float(plain_covers), float(covers)))
    return rows


def cells(rows: list[Row]) -> list[str]:
    """Median and worst gain, mean and lowest coverage."""
    gains = [row.gain for row in rows]
    covers = [row.covers for row in rows]
    return [
        f"{statistics.median(gains):.1f}", f"{min(gains):.2f}",
        f"{statistics.mean(covers):.2f}", f"{min(covers):.2f}",
    ]  # fmt: skip


def main() -> None:
    """A table for each scene."""
    words = [int(word) for word in sys.argv[1:]]
    truth, replicates = [*words[:2], *[20000, 400][len(words) :]]
    for n in words[2:] or [100]:
        print("| scene | quantity | own: median | worst | covers | lowest | pooled: median | worst "
              "| covers | lowest | plain covers |")  # fmt: skip
        print("|---" * 11 + "|")
        for name, (values, pools) in SCENES.items():
            path = truth_of(name, values, truth)
            own = [
                row
                for pool in pools
                for case in pool
                for row in rows_of(path, n, replicates, [case])
            ]
            pooled = [row for pool in pools for row in rows_of(path, n, replicates, pool)]
            for key, meaning in QUANTITIES.items():
                alone = [row for row in own if row.quantity == key]
                joined = [row for row in pooled if row.quantity == key]
                plain = statistics.mean(row.plain_covers for row in alone)
                line = [f"{name}, N = {n}", meaning, *cells(alone), *cells(joined), f"{plain:.2f}"]
                print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
    main()
