"""Whether targets of accuracy are met, and costs as predicted: python bench/targets.py

Three scenes that differ: the paper's, shortened; a chain of 20 masses under strong forcing; one
that hardly ever slips. Each runs with every target, and once more with the exact method at a
tolerance far tighter than any choice; the true error is that of slip fractions (rms over samples
of a case) and of band ratios. The march's processor time is that of a run less that of a short one.
"""

from __future__ import annotations

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
    """What a serial start says, and the processor time it takes [s]."""
    overrides = [word for k, v in settings.items() for word in ("--set", f"{k}={v}")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [ROOT / "build/release/bin/entroslip", *map(str, arguments), *overrides],
        check=True, capture_output=True, text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime - before.ru_utime


def true_errors(path: Path, reference: Path) -> tuple[float, float]:
    """Largest over cases and dofs: rms over samples of slip [points], change of band ratios [%]."""
    slip, ratio = 0.0, 0.0
    with h5py.File(path) as ours, h5py.File(reference) as exact:
        for case in exact["campaign"]:
            a, b = ours["campaign"][case], exact["campaign"][case]
            apart = 100 * (a["slip_fraction"][()] - b["slip_fraction"][()])
            slip = max(slip, np.sqrt((apart**2).mean(axis=0)).max())
            if "band_ratio" in b:
                change = a["band_ratio"][()] / b["band_ratio"][()] - 1
                ratio = max(ratio, 100 * np.nanmax(np.abs(change)))
    return slip, ratio


def predicted(path: Path) -> dict[tuple[int, int, float], float]:
    """Cost of a sample-step [ns] at the scene's own steps, by method, halvings, tolerance."""
    with h5py.File(path) as file:
        group = file["tradeoff"]
        own = group["dt"][group["is_own"][()] == 1][0]
        names = ("method", "max_halvings", "tolerance", "cost", "dt")
        rows = zip(*(group[name][()] for name in names), strict=True)
        return {
            (int(m), int(h), round(np.log10(t or 1), 6)): c for m, h, t, c, dt in rows if dt == own
        }


def main() -> None:
    """One row per scene and target."""
    print("scene   target  chosen                      slip error  bands [%]  march [s]  predicted")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "strong.nml").write_text(STRONG)
        (folder / "stuck.nml").write_text(STUCK)
        paper = {"integration%n_steps": 40000, "campaign%n_samples": 32}
        for label, scene, settings in (
            ("paper", ROOT / "input/paper.nml", paper),
            ("strong", folder / "strong.nml", {}),
            ("stuck", folder / "stuck.nml", {}),
        ):
            compare(label, scene, settings, folder)


def compare(label: str, scene: Path, settings: dict[str, object], folder: Path) -> None:
    """The rows of one scene."""
    reference, tradeoff = folder / f"{label}_exact.h5", folder / f"{label}_tradeoff.h5"
    program("run", scene, "--output", reference, **settings, **EXACT)
    program("tradeoff", scene, "--output", tradeoff, **settings)
    costs = predicted(tradeoff)
    with h5py.File(reference) as file:
        samples = sum(len(case["sample"]) for case in file["campaign"].values())
    for target in TARGETS:
        wanted = settings | {"accuracy%target_slip_points": target}
        output = folder / f"{label}_{target}.h5"
        said, _ = program("run", scene, "--output", output, **wanted)
        chosen = re.search(r"accuracy +(.*?): the least", said).group(1)
        setting = choice(chosen)
        n_steps = int(
            settings.get("integration%n_steps")
            or re.search(r"n_steps = (\d+)", scene.read_text()).group(1)
        )
        timed = settings | setting
        whole, part = (
            least_time(scene, folder, timed | {"integration%n_steps": n})
            for n in (n_steps, n_steps // 4)
        )
        march = (whole - part) / 0.75
        key = (int(setting["integration%method"] == "event"),
               setting.get("integration%max_halvings", 0),
               round(np.log10(setting.get("integration%tolerance", 1)), 6))  # fmt: skip
        expected = 1e-9 * costs[key] * samples * n_steps
        slip, ratio = true_errors(output, reference)
        print(f"{label:<8}{target:<8g}{chosen:<28}{slip:<12.2g}{ratio:<11.2g}{march:<11.2f}"
              f"{expected:.2f} ({expected / march - 1:+.0%})", flush=True)  # fmt: skip


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
