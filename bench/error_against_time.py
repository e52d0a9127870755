"""Cost of accuracy, plain and by regression: python bench/error_against_time.py [TRUTH [TIMES]].

The true error of the mean slip fraction, its standard deviation and 95th percentile and of the band
ratio, root mean square over masses, against the processor time of N = 10 to 10,000 samples: under
one force record that all samples share, and under a record for each. Prints a table and draws
docs/error_against_time.svg.

Truth is a campaign of TRUTH samples (20,000), each with its own record. From it, and from one of
as many samples on one record, N are drawn TIMES times (60; a quarter of it from 1000 samples on).
The error of one record comes from 20 other records; what the finite draws of the law leave a
regression is added. The time is that of real runs of N samples, everything included. Builds the
target bench_regression; campaigns are kept in results/. Takes a quarter of an hour of a processor.
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import h5py
import numpy as np
from matplotlib import pyplot as plt
from regression import draws, thinned

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "build/release/bin"
FIGURE = ROOT / "docs/error_against_time.svg"
SCENE = """\
&scene seed = {seed} /
&process correlation_length = 1.0 order = 5 mean = 0.2 std = 0.10 /
&chain n_dof = 5 /
&excitation variance = 3.7 per_sample = .{own}. /
&integration method = 'event' n_steps = 100000 /
&campaign n_samples = {n} estimator = '{estimator}' /
&output segment_length = 2048 /
"""
SAMPLES = (10, 30, 100, 300, 1000, 3000, 10000)
LEAST = 20  # samples that a regression needs
RECORDS = 20
LAW = 0.8 * 2**17  # independent draws that stand for the law (campaign_pooling)
EVERY = 8  # of the frequencies, in the draws
QUANTITIES = {
    "mean": "mean slip [points]", "std": "std of slip [points]",
    "slip95": "slip 95 % [points]", "ratio": "band ratio [%]",
}  # fmt: skip
OUTPUTS = {"mean": 0, "std": 1, "slip95": 3, "ratio": 7}  # in the draws
KINDS = ("shared", "own")
ESTIMATORS = ("plain", "regression")


def campaign(name: str, n: int, kind: str, estimator: str, seed: int = 99) -> tuple[Path, float]:
    """A results file, and the processor seconds that it took (0 where it was there)."""
    path = ROOT / "results" / f"error_{name}.h5"
    if path.exists():
        return path, 0.0
    scene = path.with_suffix(".nml")
    own = "true" if kind == "own" else "false"
    scene.write_text(SCENE.format(seed=seed, own=own, n=n, estimator=estimator))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [BUILT / "entroslip", "run", scene, "--quiet", "--output", path]
    subprocess.run(words, check=True, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return path, after.ru_utime - before.ru_utime


def values_of(path: Path) -> dict[str, np.ndarray]:
    """The four statistics of every mass, as angles or logarithms where the draws have them so."""
    with h5py.File(path) as file:
        case = file["campaign/c001"]
        return {
            "mean": 100 * case["slip_mean"][()],
            "std": 100 * case["slip_std"][()],
            "slip95": 100 * case["slip_percentiles"][-1],
            "ratio": 100 * np.log(case["band_ratio"][()]),
        }


def drawn(path: Path, n: int, times: int) -> dict[str, tuple[float, float]]:
    """Errors of plain sampling and of the regression, by draws of N samples of a campaign."""
    thin = path.with_suffix(".thin.h5")
    if not thin.exists():
        thinned(path, EVERY)
    found = draws(thin, n, times, [1])[:times, 0]
    share = values_of(path)["slip95"] / 100
    scales = {"slip95": 2 * np.sqrt(share * (1 - share))}  # the draws have asin sqrt y
    errors = {}
    for quantity, output in OUTPUTS.items():
        both = found[:, :, output, :2] * 100 * scales.get(quantity, np.ones_like(share))[:, None]
        plain, ours = np.sqrt((both**2).mean((0, 1)))
        errors[quantity] = plain, math.hypot(ours, plain * math.sqrt(n / LAW))
    return errors


def record_errors(truth: dict[str, np.ndarray]) -> dict[str, float]:
    """Errors of one record: the scatter of other records' estimates about the truth."""
    squares = defaultdict(list)
    for k in range(RECORDS):
        path, _ = campaign(f"record_{k}", 200, "shared", "regression", seed=1000 + k)
        for quantity, values in values_of(path).items():
            squares[quantity].append((values - truth[quantity]) ** 2)
    return {quantity: math.sqrt(np.mean(rows)) for quantity, rows in squares.items()}


def draw(seconds: dict, errors: dict) -> None:
    """An axes for each statistic."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 7), sharex=True)
    looks = {"plain": ("0.55", "o"), "regression": ("C0", "s")}
    for panel, (quantity, label) in zip(axes.flat, QUANTITIES.items(), strict=True):
        for estimator in ESTIMATORS:
            for kind in KINDS:
                shown = [n for n in SAMPLES if (kind, estimator, n) in errors]
                colour, marker = looks[estimator]
                panel.loglog(
                    [seconds[kind, estimator, n] for n in shown],
                    [errors[kind, estimator, n][quantity] for n in shown],
                    color=colour, marker=marker, ms=4, ls="-" if kind == "own" else "--",
                    label=f"{estimator}, {'a record each' if kind == 'own' else 'one record'}",
                )  # fmt: skip
        panel.set(ylabel=f"error of {label}")
        panel.grid(alpha=0.3)
    axes[0, 0].legend(frameon=False)
    for panel in axes[1]:
        panel.set_xlabel("processor time [s]")
    figure.tight_layout()
    figure.savefig(FIGURE, metadata={"Date": None})


def main() -> None:
    """Truth, draws, times; then the table and the figure."""
    truth, times = [*map(int, sys.argv[1:]), *[20000, 60][len(sys.argv) - 1 :]]
    words = ["cmake", "--build", "--preset", "release", "--target", "bench_regression"]
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True)
    (ROOT / "results").mkdir(exist_ok=True)
    populations = {
        kind: campaign(f"truth_{kind}_{truth}", truth, kind, "plain")[0] for kind in KINDS
    }
    of_record = record_errors(values_of(populations["own"]))
    errors, seconds = {}, {}
    for n in SAMPLES:
        for kind in KINDS:
            found = drawn(populations[kind], n, times if n < 1000 else max(times // 4, 2))
            for position, estimator in enumerate(ESTIMATORS):
                if estimator == "regression" and n < LEAST:
                    continue
                path, seconds[kind, estimator, n] = campaign("timed", n, kind, estimator)
                path.unlink()
                errors[kind, estimator, n] = {
                    quantity: math.hypot(pair[position], of_record[quantity] * (kind == "shared"))
                    for quantity, pair in found.items()
                }
    print("| samples | records | estimator | processor time [s] |",
          " | ".join(QUANTITIES.values()), "|")  # fmt: skip
    print("|---" * (4 + len(QUANTITIES)) + "|")
    for (kind, estimator, n), of in sorted(errors.items(), key=lambda row: (row[0][2], row[0])):
        numbers = [f"{of[quantity]:.2g}" for quantity in QUANTITIES]
        records = "each its own" if kind == "own" else "one"
        time = f"{seconds[kind, estimator, n]:.2g}"
        print("|", " | ".join([str(n), records, estimator, time, *numbers]), "|")
    alone = [f"{of_record[quantity]:.2g}" for quantity in QUANTITIES]
    print("|", " | ".join(["", "one", "of the record alone", "", *alone]), "|")
    draw(seconds, errors)


if __name__ == "__main__":
    plt.rcParams["svg.hashsalt"] = "error_against_time"
    main()
