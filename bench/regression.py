"""Errors and coverage of the regression: python bench/regression.py [TRUTH [TIMES [N ...]]].

Campaigns of TRUTH samples a case (20,000; kept in results/) are the truth. From each of them N
samples (100) are drawn TIMES times (400), none twice in a draw; each time all statistics are
estimated, and their errors compared with plain sampling's. Draws are made twenty at a time and
kept in results/ too: more of them go on from there, and after a change of the estimators the
folders of draws are to be deleted, not the truth. The law of the friction is that of the
campaign's samples. Every case is estimated by itself, and pooled with those of the same force.
Builds the target bench_regression. Scenes: processes of the paper under both forces, nearly
stuck, 20 masses.
"""

from __future__ import annotations

import math
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
    "lengths": "0.3, 1.0", "orders": "2, 5", "std": "0.067, 0.10", "force": "3.7, 41.1",
    "n_dof": 5, "steps": 100000, "segment": 2048,
}  # fmt: skip
ONE = {"lengths": "1.0", "orders": "5"}
#: name -> values of the scene, and its pools of cases
SCENES = {
    "paper": (PAPER, [[1, 3, 5, 7], [2, 4, 6, 8]]),
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
EVERY = 4  # frequencies
PORTION = 20  # draws


class Row(NamedTuple):
    """One output over all draws."""

    place: tuple[str, str, str]  # case, joint or dof, quantity
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


def portion(path: Path, n: int, first: int, cases: list[int]) -> list[list[str]]:
    """The lines of twenty draws from some cases, pooled."""
    names = [f"c{case:03}" for case in cases]
    folder = path.with_suffix(f".draws_{n}")
    folder.mkdir(exist_ok=True)
    kept = folder / ("_".join([*names, str(first)]) + ".txt")
    if not kept.exists():
        words = [BUILT / "bench_regression", path, n, first, first + PORTION - 1, EVERY, *names]
        said = subprocess.run(
            [str(word) for word in words], check=True, capture_output=True, text=True
        ).stdout
        kept.write_text(said)
    lines = kept.read_text().splitlines()
    return [line.split() for line in lines if not line.startswith("#")]


def rows_of(path: Path, n: int, times: int, cases: list[int]) -> list[Row]:
    """All outputs of some cases, pooled, over all draws."""
    portions = [portion(path, n, first, cases) for first in range(1, times + 1, PORTION)]
    rows = []
    for lines in zip(*portions, strict=True):
        case, place, quantity, frequency = lines[0][:4]
        numbers = [[float(word) for word in line[4:]] for line in lines]
        plain, ours = (math.sqrt(statistics.mean(row[i] ** 2 for row in numbers)) for i in (0, 1))
        plain_covers, covers = (statistics.mean(row[i] for row in numbers) for i in (3, 4))
        if float(frequency) < HIGHEST and plain > 0:
            gain = plain / max(ours, 1e-300)
            rows.append(Row((case, place, quantity), gain, plain_covers, covers))
    return rows


def cells(rows: list[Row]) -> list[str]:
    """Median and worst gain; mean coverage, and the lowest and highest of a case and a mass."""
    gains = [row.gain for row in rows]
    places = sorted({row.place for row in rows})
    covers = [statistics.mean(row.covers for row in rows if row.place == place) for place in places]
    return [
        f"{statistics.median(gains):.1f}", f"{min(gains):.2f}",
        f"{statistics.mean(covers):.2f}", f"{min(covers):.2f} to {max(covers):.2f}",
    ]  # fmt: skip


def main() -> None:
    """A table for each scene."""
    words = [int(word) for word in sys.argv[1:]]
    truth, times = [*words[:2], *[20000, 400][len(words) :]]
    for n in words[2:] or [100]:
        print("| scene | quantity | own: gain | least | covers | of a mass | pooled: gain | least "
              "| covers | of a mass | plain covers |")  # fmt: skip
        print("|---" * 11 + "|")
        for name, (values, pools) in SCENES.items():
            path = truth_of(name, values, truth)
            own = [
                row for pool in pools for case in pool for row in rows_of(path, n, times, [case])
            ]
            pooled = [row for pool in pools for row in rows_of(path, n, times, pool)]
            for key, meaning in QUANTITIES.items():
                alone = [row for row in own if row.place[2] == key]
                joined = [row for row in pooled if row.place[2] == key]
                plain = statistics.mean(row.plain_covers for row in alone)
                line = [f"{name}, N = {n}", meaning, *cells(alone), *cells(joined), f"{plain:.2f}"]
                print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
    main()
