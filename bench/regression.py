"""Errors and coverage of the regression: python bench/regression.py [TIMES [N ...] [SCENE ...]].

With the word `whatif` it estimates, from the samples of each case, the other laws of its force.

Campaigns of 5000 samples a case (20,000 nearly stuck, 2500 of 40 masses) are the truth. From each
of them N samples (25, 100 and 400) are drawn TIMES times (400), with replacement; each time all
statistics are estimated, and their errors compared with plain sampling's. The law of the friction
is that of the campaign's samples, of which each draw takes most. Percentiles of the truth are those
of a fit to it with its residuals, without their noise. Every case is estimated by itself, and
pooled as the program does. Prints a table for each scene (paper, stuck, ring, twenty, forty, laws):
median gain over cases, masses (and frequencies), in brackets the least; mean coverage, in brackets
the least and the largest of a case and a mass.
What is left of the campaigns (`.thin.h5`: every fourth frequency, as far as there is power) and the
draws (`.raw`) are kept in results/: more draws go on from there, and after a change of the
estimators the draws are to be deleted, not the truth. Builds the target bench_regression.
"""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "build/release/bin"
RESULTS = ROOT / "results"

SCENE = """\
&scene seed = 99 /
&process correlation_length = {lengths} order = {orders} mean = 0.2 std = {std} /
{others}
{structure}
&excitation variance = {force} {band} /
&integration method = 'event' n_steps = {steps} /
&campaign n_samples = {truth} estimator = 'plain' /
&output segment_length = {segment} /
"""
CHAIN = {
    "lengths": "1.0", "orders": "5", "structure": "&chain n_dof = 5 /", "force": "3.7, 41.1",
    "band": "", "std": "0.067, 0.10", "steps": 100000, "truth": 5000, "segment": 2048,
    "others": "",
}  # fmt: skip
OTHER_MEANS = "\n".join(
    f"&process correlation_length = 1.0 order = 5 mean = {mean} std = {std} /"
    for mean, std in ((0.12, 0.04), (0.3, 0.1), (0.4, 0.067))
)
RING = """\
&structure
   mass_matrix = 'ring/M.mtx' stiffness_matrix = 'ring/K.mtx' joints = 'ring/joints.txt'
   damping_ratio = 0.005
/"""
BLADES = "ring --blades 6 --scatter 0.05 --seed 1"  # of entroslip.structure


class Scene(NamedTuple):
    """Cases and how they are pooled."""

    meaning: str
    values: dict[str, object]
    pools: list[list[int]]


SCENES = {
    "paper": Scene(
        "The paper's chain: L0 = 0.3, 1, 3, both std, both forces",
        CHAIN | {"lengths": "0.3, 1.0, 3.0", "orders": "2, 5, 10"},
        [[1, 3, 5, 7, 9, 11], [2, 4, 6, 8, 10, 12]],
    ),
    "stuck": Scene(
        "The chain nearly stuck: std 0.1, force 0.8",
        CHAIN | {"std": "0.10", "force": "0.8", "truth": 20000},
        [[1]],
    ),
    "ring": Scene(
        "Six blades in a ring, from matrices",
        CHAIN | {"structure": RING, "force": "16.0", "band": "band = 0.0, 1.8 dof = 6",
                 "steps": 50000},
        [[1, 2]],
    ),
    "twenty": Scene(
        "20 masses, both std, both forces",
        CHAIN | {"structure": "&chain n_dof = 20 /", "steps": 20000,
                 "segment": 1024},
        [[1, 3], [2, 4]],
    ),
    "forty": Scene(
        "40 masses: std 0.1, force 41.1",
        CHAIN | {"structure": "&chain n_dof = 40 /", "std": "0.10", "force": "41.1",
                 "steps": 20000, "truth": 2500, "segment": 1024},
        [[1]],
    ),
    "laws": Scene(
        "Seven laws of L0 = 1: means 0.12 to 0.4, std 0.04 to 0.14, both forces",
        CHAIN | {"std": "0.04, 0.067, 0.10, 0.14", "others": OTHER_MEANS},
        [[1, 3, 5, 7, 9, 11, 13], [2, 4, 6, 8, 10, 12, 14]],
    ),
}  # fmt: skip
#: statistics in the order of the draws; those of spectra follow for each frequency
NUMBERS = (
    "mean slip", "std of slip", "slip 5 %", "slip 95 %", "pseudo-variance of the mean",
    "pseudo-variance 5 %", "pseudo-variance 95 %", "band ratio",
)  # fmt: skip
SPECTRA = ("mean spectrum < 3 Hz", "spectrum 5 % < 3 Hz", "spectrum 95 % < 3 Hz")
HIGHEST = 3.0  # [Hz] of the spectra in the draws
EVERY = 4  # frequencies
POWERLESS = 1e-5  # share of the power above the frequencies that are kept
EXTRAPOLATIONS = (0.0, 0.5, 2.0, 5.0, 20.0, math.inf)  # ends of ranges
MOST_POOLED = 600  # samples of a pool, as in src/campaign/pooling.f90
LEAST = 0.95  # gain below which an estimate is worse than plain sampling
COVERS = 0.90, 0.99  # wanted of the intervals of each case and joint


def thinned(path: Path, every: int = EVERY) -> Path:
    """A campaign with some of the frequencies, as far as there is power."""
    thin = path.with_suffix(".thin.h5")
    kept = {}
    with h5py.File(path) as file:
        for name, case in file["campaign"].items():
            density = case["psd"][:, 1::every].astype(np.float32)  # (sample, frequency, dof)
            numbers = {key: case[key][()] for key in ("friction", "slip_fraction")}
            kept[name] = numbers | {"psd": density, "frequency": case["frequency"][1::every]}
    above = [np.cumsum(of["psd"].mean(0, dtype=float)[::-1], 0)[::-1] for of in kept.values()]
    n_kept = max(int((power > POWERLESS * power[0]).sum(0).max()) for power in above)
    with h5py.File(thin, "w") as file:
        for name, of in kept.items():
            cut = {"psd": of["psd"][:, :n_kept], "frequency": of["frequency"][:n_kept]}
            for key, data in (of | cut).items():
                file[f"campaign/{name}/{key}"] = data
    return thin


def truth_of(name: str, scene: Scene) -> Path:
    """The thinned campaign, run where it is not there yet."""
    path = RESULTS / f"regression_{name}.h5"
    thin = path.with_suffix(".thin.h5")
    if thin.exists():
        return thin
    if scene.values["structure"] == RING and not (RESULTS / "ring").exists():
        words = [sys.executable, "-m", "entroslip.structure", *BLADES.split()]
        subprocess.run([*words, "--out", RESULTS / "ring"], check=True, capture_output=True)
    text = path.with_suffix(".nml")
    text.write_text(SCENE.format(**scene.values))
    subprocess.run([BUILT / "entroslip", "run", text, "--quiet", "--output", path], check=True)
    thinned(path)
    path.unlink()
    return thin


def draws(thin: Path, n: int, times: int, cases: list[int], laws: Sequence[int] = ()) -> np.ndarray:
    """(draw, case or law, joint, output, number), of bench/regression.f90; `times` or more."""
    names = [f"c{case:03}" for case in cases] + [f"law:c{case:03}" for case in laws]
    ending = f".{n}.{'_'.join(names).replace(':', '_')}.raw"
    raw = thin.with_name(thin.name.replace(".thin.h5", ending))
    words = [BUILT / "bench_regression", thin, n, times, raw, *names]
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([str(word) for word in words], check=True, capture_output=True, env=alone)
    with h5py.File(thin) as file:
        n_joints = file["campaign/c001/slip_fraction"].shape[1]
        n_bins = int((file["campaign/c001/frequency"][()] < HIGHEST).sum())
    shape = (-1, len(names), n_joints, len(NUMBERS) + len(SPECTRA) * n_bins, 5)
    numbers = np.fromfile(raw, np.float32).astype(float)
    return numbers[: len(numbers) // math.prod(shape[1:]) * math.prod(shape[1:])].reshape(shape)


class Score(NamedTuple):
    """One statistic of a scene's cases and joints, over all draws."""

    gain: np.ndarray  # (case and joint, bin): error of plain sampling over that of the estimate
    error: np.ndarray  # standard error of the gain
    covers: np.ndarray  # (case and joint): share of intervals that hold the truth
    plain_covers: np.ndarray
    covers_error: np.ndarray  # (case and joint): standard error of `covers`


def score_of(found: np.ndarray, statistic: int) -> Score:
    """Score of a statistic, all its bins, in some draws."""
    n_numbers = len(NUMBERS)
    some = slice(statistic, statistic + 1)
    if statistic >= n_numbers:
        some = slice(statistic, None, len(SPECTRA))
    plain, ours, low, high, stated = np.moveaxis(
        found[..., some, :].reshape(len(found), -1, found[0, 0, 0, some].shape[0], 5), -1, 0
    )
    has_error = (plain != 0).any(0)  # no sample of all slips, or all do
    squares = np.stack([plain**2, ours**2]).sum(1)
    gain = np.sqrt(squares[0] / np.maximum(squares[1], 1e-300))
    share = plain**2 / np.maximum(squares[0], 1e-300) - ours**2 / np.maximum(squares[1], 1e-300)
    error = 0.5 * gain * np.sqrt((share**2).sum(0))
    holds = (ours <= low + 1e-12) & (-ours <= high + 1e-12)
    plainly = np.abs(plain) <= 1.959964 * stated + 1e-12
    gain[~has_error] = np.nan
    # scatter of the draws' shares, and no less than that of 0.99 if all bins were independent
    least = math.sqrt(0.99 * 0.01 / (len(found) * holds.shape[2]))
    each = np.maximum(holds.mean(2).std(0) / math.sqrt(len(found)), least)
    covers = np.where(has_error.any(1), holds.mean((0, 2)), np.nan)
    return Score(gain, error, covers, plainly.mean((0, 2)), each)


def together(scores: list[Score]) -> Score:
    """Score of several cases together."""
    return Score(*(np.concatenate(part) for part in zip(*scores, strict=True)))


def cells(score: Score) -> tuple[str, str]:
    """Median and least gain; mean coverage, and the least and largest of a case and joint."""
    covers = score.covers
    return (
        f"{np.nanmedian(score.gain):.1f} ({np.nanmin(score.gain):.2f})",
        f"{np.nanmean(covers):.2f} ({np.nanmin(covers):.2f}-{np.nanmax(covers):.2f})",
    )


def chance_below(n: int, covers: float) -> float:
    """Chance that an interval with this coverage is found too small in n draws."""
    chance = 0.0
    for held in range(n + 1):
        share = held / n
        margin = 2 * math.sqrt(max(share * (1 - share), 0.99 * 0.01) / n)
        if share + margin < COVERS[0]:
            chance += math.comb(n, held) * covers**held * (1 - covers) ** (n - held)
    return chance


def report(name: str, times: int, sizes: list[int]) -> list[str]:
    """The table of a scene, and what is worse than plain sampling in it."""
    scene = SCENES[name]
    thin = truth_of(name, scene)
    head = ["statistic"]
    worse, n_outputs = [], 0
    outside, n_outside, n_intervals, by_chance = [], 0, 0, np.zeros(2)
    of = {}
    for n in sizes:
        apart = [draws(thin, n, times, [case]) for pool in scene.pools for case in pool]
        kinds = {"own": apart}
        if n * len(scene.pools[0]) <= MOST_POOLED and len(scene.pools[0]) > 1:
            kinds["pooled"] = [draws(thin, n, times, pool) for pool in scene.pools]
        for kind, found in kinds.items():
            n_draws = min(len(part) for part in found)
            head += [f"{kind}, N = {n}, {n_draws} draws: gain", "covers"]
        head.append("plain covers")
        for statistic, label in enumerate((*NUMBERS, *SPECTRA)):
            for kind, found in kinds.items():
                score = together([score_of(part, statistic) for part in found])
                of[n, kind, statistic] = score
                is_worse = score.gain + 2 * score.error < LEAST
                n_outputs += np.isfinite(score.gain).sum()
                worse += [
                    f"{label} ({kind}, N = {n}) {gain:.2f} ± {error:.2f}"
                    for gain, error in zip(score.gain[is_worse], score.error[is_worse], strict=True)
                ]
                covers, margin = score.covers, 2 * score.covers_error
                if statistic < len(NUMBERS):
                    by_chance += np.isfinite(covers).sum() * np.array(
                        [chance_below(len(found[0]), at) for at in (np.nanmean(covers), COVERS[0])]
                    )
                is_outside = (covers + margin < COVERS[0]) | (covers - margin > COVERS[1])
                n_intervals += np.isfinite(covers).sum()
                n_outside += is_outside.sum()
                for side in (is_outside & (covers < COVERS[0]), is_outside & (covers > COVERS[1])):
                    if side.any():
                        least, most = covers[side].min(), covers[side].max()
                        shares = f"{least:.3f}" + (f" to {most:.3f}" if most > least else "")
                        outside.append(f"{label} ({kind}, N = {n}) {side.sum()} of {shares}")
    lines = ["", f"**{scene.meaning}:**", ""]
    lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for statistic, label in enumerate((*NUMBERS, *SPECTRA)):
        row = [label]
        for n in sizes:
            for kind in ("own", "pooled"):
                row += cells(of[n, kind, statistic]) if (n, kind, statistic) in of else ()
            row.append(f"{of[n, 'own', statistic].plain_covers.mean():.2f}")
        lines.append("| " + " | ".join(row) + " |")
    lines += ["", f"Gains below {LEAST} by two standard errors: {len(worse)} of {n_outputs}"
              + (": " + "; ".join(worse[:8]) if worse else "") + ".",
              f"Coverages outside {COVERS[0]:.2f} to {COVERS[1]} by two standard errors: "
              f"{n_outside} of {n_intervals}"
              + (": " + "; ".join(outside) if outside else "") + ".",
              f"Too small by chance, without spectra: {by_chance[0]:.2g} if each is the mean of "
              f"its row, {by_chance[1]:.2g} if each is {COVERS[0]:.2f}."]  # fmt: skip
    return lines


def report_of_laws(name: str, times: int, sizes: list[int]) -> list[str]:
    """Table of the laws without samples by extrapolation: gain over samples of their own."""
    scene = SCENES[name]
    thin = truth_of(name, scene)
    lines = []
    for n, sources in itertools.product(sizes, ("one case", "all others")):
        found = []
        for pool in scene.pools:
            for case in pool:
                others = [other for other in pool if other != case]
                if sources == "one case":
                    found.append(draws(thin, n, times, [case], others)[:, 1:])
                else:
                    found.append(draws(thin, n, times, others, [case])[:, -1:])
        ratios = [
            np.concatenate([extrapolation_of(part[..., number, :]) for part in found])
            for number in range(len(NUMBERS))
        ]
        ranges = [
            (low, high)
            for low, high in itertools.pairwise(EXTRAPOLATIONS)
            if any(((ratio >= low) & (ratio < high)).any() for ratio in ratios)
        ]
        n_draws = min(len(part) for part in found)
        title = f"{scene.meaning}; from {n} samples of {sources}, {n_draws} draws"
        lines += ["", f"**{title}:**", ""]
        head = ["statistic"]
        for low, high in ranges:
            label = f"{low:g} to {high:g}" if math.isfinite(high) else f"above {low:g}"
            head += [f"{label}: joints", "gain", "covers"]
        lines += ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for statistic, label in enumerate(NUMBERS):
            score = together([score_of(part, statistic) for part in found])
            row = [label]
            for low, high in ranges:
                some = (ratios[statistic] >= low) & (ratios[statistic] < high)
                part = Score(*(values[some] for values in score))
                row += [str(some.sum()), *(cells(part) if some.any() else ("-", "-"))]
            lines.append("| " + " | ".join(row) + " |")
    return lines


def extrapolation_of(found: np.ndarray) -> np.ndarray:
    """(law and joint): median over the draws of the error times it, over the error."""
    _, _, low, high, product = np.moveaxis(found.reshape(len(found), -1, 5), -1, 0)
    return np.median(product * 2 * 1.959964 / np.maximum(low + high, 1e-300), 0)


def main() -> None:
    """A table for each scene."""
    named = [word for word in sys.argv[1:] if word in SCENES]
    sizes = [int(word) for word in sys.argv[1:] if word.isdigit()]
    table = report_of_laws if "whatif" in sys.argv else report
    times = sizes.pop(0) if sizes else 400
    build = ["cmake", "--build", "--preset", "release", "--target", "bench_regression"]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    RESULTS.mkdir(exist_ok=True)
    for name in named or SCENES:
        print("\n".join(table(name, times, sizes or [25, 100, 400])), flush=True)


if __name__ == "__main__":
    main()
