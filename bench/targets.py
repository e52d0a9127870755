"""Tests if targets of accuracy are met, and costs as predicted: python bench/targets.py

Three scenes that differ: the paper's, shortened, with processes of order 1; a chain of 20 masses
under strong forcing; one that hardly ever slips. Each runs with every target, a quarter of its
samples audited, and once more with the exact method at a tolerance far tighter than any choice.
Prints a Markdown table:

- error: the true one, of slip fractions (rms over samples of a case, the largest over masses) and
  of band ratios, beside the target;
- audit: in how many cases and masses the rms error of all samples lies within twice the standard
  error that the audit gives its own;
- march: processor time of the scene's steps, from a run of five times as many less the scene's own
  (what a run costs at any length is left out), beside what `tradeoff` and what `check` foresee;
- finer steps: the least cost of Newmark's scheme with steps of 1/2 to 1/16 that keeps the target,
  over that of the setting chosen.
"""

from __future__ import annotations

import functools
import os
import re
import resource
import subprocess
import tempfile
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
TARGETS = (0.2, 0.05, 0.001)  # points
PROCESS = "&process correlation_length = 1.0 order = 3 mean = 0.2 std = {std} /\n"
STRONG = PROCESS.format(std=0.08) + (
    "&chain n_dof = 20 /\n&excitation variance = 400.0 /\n"
    "&integration n_steps = 20000 /\n&campaign n_samples = 32 /\n&output segment_length = 4096 /\n"
)
STUCK = PROCESS.format(std=0.05) + (
    "&chain /\n&excitation variance = 0.6 /\n"
    "&integration n_steps = 60000 /\n&campaign n_samples = 64 /\n&output segment_length = 4096 /\n"
)
EXACT = {"integration%method": "event", "integration%tolerance": 1e-11}


def program(*arguments: object, **settings: object) -> tuple[str, float]:
    """Output of a serial start, and its processor time [s]."""
    overrides = [word for k, v in settings.items() for word in ("--set", f"{k}={v}")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [ROOT / "build/release/bin/entroslip", *map(str, arguments), *overrides],
        check=True, capture_output=True, text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime - before.ru_utime


def true_errors(path: Path, reference: Path) -> tuple[float, float, int, int]:
    """Largest rms error of slip [points], change of band ratios [%]; audits that agree, of all."""
    slip, ratio, agree, audited = 0.0, 0.0, 0, 0
    with h5py.File(path) as ours, h5py.File(reference) as exact:
        for case in exact["campaign"]:
            a, b = ours["campaign"][case], exact["campaign"][case]
            apart = 100 * (a["slip_fraction"][()] - b["slip_fraction"][()])
            rms = np.sqrt((apart**2).mean(axis=0))
            slip = max(slip, rms.max())
            if "band_ratio" in b:
                change = a["band_ratio"][()] / b["band_ratio"][()] - 1
                ratio = max(ratio, 100 * np.nanmax(np.abs(change)))
            audit = a["audit"]
            if "slip_rms_difference_error" in audit:
                off = np.abs(audit["slip_rms_difference"][()] - rms)
                # rounding counts where all samples have next to no error
                close = off <= 2 * audit["slip_rms_difference_error"][()] + 1e-6
                agree, audited = agree + int(close.sum()), audited + close.size
    return slip, ratio, agree, audited


class Tradeoff:
    """Costs of a sample-step [ns] by setting, as `tradeoff` measured them."""

    def __init__(self, path: Path) -> None:
        """Reads the group."""
        with h5py.File(path) as file:
            self.of = {name: data[()] for name, data in file["tradeoff"].items()
                       if isinstance(data, h5py.Dataset)}  # fmt: skip
        self.own_dt = self.of["dt"][self.of["is_own"] == 1][0]

    def cost(self, setting: dict[str, object]) -> float:
        """Cost of a setting at the scene's own step."""
        is_event = setting["integration%method"] == "event"
        chosen = (self.of["method"] == is_event) & (self.of["dt"] == self.own_dt)
        if is_event:
            off = np.log10(np.maximum(self.of["tolerance"], 1e-99)) - np.log10(
                float(setting["integration%tolerance"])
            )
            chosen &= np.abs(off) < 1e-3
        else:
            chosen &= self.of["max_halvings"] == setting["integration%max_halvings"]
        return float(self.of["cost"][chosen][0])

    def finer(self, target: float) -> float:
        """The least cost of a finer step that surely keeps a target; infinite where none does."""
        keeps = self.of["slip"] + 2 * self.of["slip_error"] <= target
        return float(self.of["cost"][keeps & (self.of["dt"] < self.own_dt)].min(initial=np.inf))


def main() -> None:
    """One row per scene and target."""
    print("| scene | target | chosen | slip error | bands [%] | audit agrees | march [s]"
          " | `tradeoff` | `check` | finer steps |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "strong.nml").write_text(STRONG)
        (folder / "stuck.nml").write_text(STUCK)
        paper = {"integration%n_steps": 40000, "campaign%n_samples": 32, "process%order": 1}
        for label, scene, settings in (
            ("paper", ROOT / "input/paper.nml", paper),
            ("strong", folder / "strong.nml", {}),
            ("stuck", folder / "stuck.nml", {}),
        ):
            compare(label, scene, settings, folder)


def compare(label: str, scene: Path, settings: dict[str, object], folder: Path) -> None:
    """The rows of one scene."""
    reference, output = folder / f"{label}_exact.h5", folder / f"{label}_tradeoff.h5"
    program("run", scene, "--output", reference, **settings, **EXACT)
    program("tradeoff", scene, "--output", output, **settings)
    tradeoff = Tradeoff(output)
    with h5py.File(reference) as file:
        samples = sum(len(case["sample"]) for case in file["campaign"].values())
    n_steps = int(
        settings.get("integration%n_steps")
        or re.search(r"n_steps = (\d+)", scene.read_text()).group(1)
    )

    @functools.cache
    def march(chosen: str) -> tuple[float, float]:
        """Processor time of the march, and what check foresees [s]."""
        timed = settings | choice(chosen) | {"process%order": 1}  # no fit by simulated values
        whole, part = (
            least_time(scene, folder, timed | {"integration%n_steps": n})
            for n in (5 * n_steps, n_steps)
        )
        said, _ = program("check", scene, **timed)
        each = float(re.search(r"at ([\d.]+) ns\s+each", said).group(1))
        return (whole - part) / 4, 1e-9 * each * samples * n_steps

    for target in TARGETS:
        wanted = settings | {"accuracy%target_slip_points": target, "accuracy%audit": 0.25}
        output = folder / f"{label}_{target}.h5"
        said, _ = program("run", scene, "--output", output, **wanted)
        chosen = re.search(r"accuracy +(.*?): the\s+least", said, re.DOTALL).group(1)
        cost = tradeoff.cost(choice(chosen))
        taken, forecast = march(chosen)
        slip, ratio, agree, audited = true_errors(output, reference)
        expected = 1e-9 * cost * samples * n_steps
        finer = tradeoff.finer(target) / cost
        print(f"| {label} | {target:g} | {chosen} | {slip:.2g} | {ratio:.2g}"
              f" | {agree} of {audited} | {taken:.2f} | {expected / taken - 1:+.0%}"
              f" | {forecast / taken - 1:+.0%}"
              f" | {f'{finer:.1f} times' if np.isfinite(finer) else 'none keeps it'} |",
              flush=True)  # fmt: skip


def least_time(scene: Path, folder: Path, settings: dict[str, object]) -> float:
    """Processor time [s] of a run, the least of three."""
    output = folder / "timed.h5"
    return min(
        program("run", scene, "--output", output, "--fresh", **settings)[1] for _ in range(3)
    )


def choice(text: str) -> dict[str, object]:
    """The settings that 'newmark, 2 halvings' or 'event, tolerance 0.001' name."""
    method, _, rest = text.partition(", ")
    if method == "newmark":
        return {"integration%method": method, "integration%max_halvings": int(rest.split()[0])}
    return {"integration%method": method, "integration%tolerance": float(rest.split()[1])}


if __name__ == "__main__":
    main()
