"""Limits of the methods, where they degrade or refuse: python bench/stability.py results/stability

Runs small scenes from one extreme to the other and writes one CSV a panel of the figure, which
`python -m entroslip.stability results/stability --out FILE` draws; `--only PANEL` measures one of
them again. An error is measured; where there is none the program refused, and the reason is what
it said. Slip fractions are compared, on the same force record, with the event method at tolerance
1e-12; processes with the moments and the length wanted, two standard errors included where these
are averages over simulated values.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import subprocess
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
Row = dict[str, object]

LAWS = ("sequential", "exact")
LENGTHS = (1e-3, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100)
RATIOS = (0.01, 0.1, 0.2, 0.3, 0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1, 1.1)
BELOW_LIMIT = (1e-2, 1e-3)  # relative distances from a limit at which fits are tried once more,
LONGEST_CLOSE = 10  # to this length: beyond it a fit that close takes minutes
HIGHER_ORDERS = (2, 5, 10)  # positive ones, fitted to simulated values
HIGHER_LENGTHS = (0.1, 0.3, 1, 3, 10)
HIGHER_RATIOS = (0.1, 0.3, 0.5, 0.7, 0.9)

ORDERS = {"autoregressive": (1, 2, 3, 5, 10, 20, 30, 50, 100, 200)}
ORDERS["direct"] = (*ORDERS["autoregressive"], 500, 1000, 2000)
WIDE_LENGTHS = (1e-3, 0.01, 0.1, 0.3, 1, 3, 10, 19, 30, 100, 300, 1000)

CHAIN = """\
&chain mass = {mass} friction = {friction} /
&excitation variance = {variance} /
&integration n_steps = {n_steps} dt = {dt} {scheme} /
&campaign n_samples = 0 deterministic = .true. /
&output quantities = 'slip' /
"""
NORMAL_LOAD, VARIANCE, DT = 10.0, 41.1, 0.00843  # of the paper; the first is the scene's default
DURATION = 168.6  # s, whatever the step: 20,000 of the paper's
SCHEMES = {
    "newmark, 15 halvings": "max_halvings = 15",
    "newmark, none": "max_halvings = 0",
    "newmark, beta = 0": "max_halvings = 15 beta = 0.0",
    "event, 1e-6": "method = 'event' tolerance = 1.0e-6",
}
REFERENCE = "method = 'event' tolerance = 1.0e-12"
FRICTIONS = (0, 1e-14, 1e-10, 1e-6, 1e-4, 1e-3, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1, 1.5, 2, 4, 100,
             1e4, 1e8)  # fmt: skip
STEPS = (0.001, 0.002, 0.004, DT, 0.015, 0.03, 0.06, 0.1, 0.15, 0.195, 0.21)  # s
MASSES = (0.3, 0.1, 0.03, 0.01, 2.6e-3, 1e-3, 1e-4, 1e-5, 1e-6)  # kg, of the third of five


class Bench:
    """The program, and a folder for its scenes."""

    def __init__(self, program: Path, folder: Path) -> None:
        """The program is run from the folder."""
        self.program, self.folder = program.resolve(), folder

    def run(self, scene: str) -> tuple[Path | None, str]:
        """The results file, or none and the reason."""
        (self.folder / "scene.nml").write_text(f"&scene title = 'stability' /\n{scene}")
        done = subprocess.run(
            [self.program, "run", "scene.nml", "--fresh", "--quiet", "--output", "results.h5"],
            cwd=self.folder, capture_output=True, text=True, check=False,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        if done.returncode not in (0, 2, 4):
            raise RuntimeError(f"exit code {done.returncode} of\n{scene}\n{done.stderr}")
        if done.returncode == 0:
            return self.folder / "results.h5", ""
        said = done.stderr.splitlines()[0]
        value = re.search(r"\w+%\w+ = .*", said)  # named without the file and line it stands in
        return None, value[0] if value else said

    def processes(self, groups: Iterable[str]) -> list[dict[str, object]]:
        """Attributes of every process, its error and the reason where there is no solution."""
        path, reason = self.run("".join(f"&process {group} /\n" for group in groups))
        if path is None:
            raise RuntimeError(reason)
        with h5py.File(path) as file:
            return [
                dict(group.attrs) | {"error": miss(group)} for group in file["process"].values()
            ]

    def slip(self, **settings: object) -> tuple[np.ndarray, float] | str:
        """Slip fractions [%] and the highest natural frequency [rad/s], or why there are none."""
        path, reason = self.run(CHAIN.format(**settings))
        if path is None:
            return reason
        with h5py.File(path) as file:
            slip = 100 * file["campaign/c001/slip_fraction"][0]
            return slip, 2 * np.pi * file["structure/frequencies_stuck"][()].max()


def miss(process: h5py.Group) -> float | None:
    """Largest relative miss of mean, std and length, and residual of the optimality conditions.

    Of moments that are averages over simulated values, two standard errors are added.
    """
    if process.attrs["status"] != "solved":
        return None
    wanted = process.attrs
    length = "L0_cut" if wanted["method"] == "direct" else "L0"  # which the method imposes
    apart = np.abs([
        (process["mean_found"][()] - wanted["mean"]) / wanted["std"],
        process["std_found"][()] / wanted["std"] - 1,
        process[length][()] / wanted["correlation_length"] - 1,
    ])  # fmt: skip
    if wanted["positive"]:
        apart += 2 * np.array([
            process["mean_found_error"][()] / wanted["std"],
            process["std_found_error"][()] / wanted["std"],
            process["L0_error"][()] / wanted["correlation_length"],
        ])  # fmt: skip
    return float(max(*apart, abs(process["optimality"][()])))


def positive_processes(bench: Bench) -> Iterator[Row]:
    """Length and std/mean: order 1, whose laws are solved by quadrature, and higher ones."""
    yield from first_order(bench)
    group = (
        "order = {} mean = 1.0 branch = 'nonnegative' sampler = '{}'"
        " correlation_length = {} std = {}"
    ).format
    words = " ".join
    for p in bench.processes(
        group(order, law, words(map(str, HIGHER_LENGTHS)), words(map(str, HIGHER_RATIOS)))
        for order in HIGHER_ORDERS
        for law in LAWS
    ):
        named = re.search(r"ends at std/mean = ([\d.]+\d)", str(p.get("reason", "")))
        yield row_of(p, float(named[1]) if named else "")


def row_of(p: dict[str, object], limit: object) -> Row:
    """A positive process, and the limit of std/mean that refusals name."""
    return {
        "order": p["order"], "family": p["sampler"], "length": p["correlation_length"],
        "ratio": p["std"], "error": p["error"], "reason": p.get("reason", ""), "limit": limit,
    }  # fmt: skip


def first_order(bench: Bench) -> Iterator[Row]:
    """A fine grid, and fits once more close to the limits."""
    group = (
        "order = 1 mean = 1.0 branch = 'nonnegative' sampler = '{}'"
        " correlation_length = {} std = {}"
    ).format
    words = " ".join
    grid = bench.processes(
        group(law, words(map(str, LENGTHS)), words(map(str, RATIOS))) for law in LAWS
    )
    limits = {
        (p["sampler"], p["correlation_length"]): float(found[1])
        for p in grid
        if (found := re.search(r"must be below ([\d.]+\d)", str(p.get("reason", ""))))
    }
    close = bench.processes(
        group(law, length, words(f"{limit * (1 - below):.8f}" for below in BELOW_LIMIT))
        for (law, length), limit in limits.items()
        if length <= LONGEST_CLOSE
    )
    for p in [*grid, *close]:
        yield row_of(p, limits.get((p["sampler"], p["correlation_length"]), ""))


def orders(bench: Bench) -> Iterator[Row]:
    """Processes of any sign over M or m_max, and length."""
    lengths = " ".join(map(str, WIDE_LENGTHS))
    for p in bench.processes(
        f"method = '{method}' order = {' '.join(map(str, orders))} correlation_length = {lengths}"
        " pairing = 'product' mean = 0.0 std = 1.0 positive = .false."
        for method, orders in ORDERS.items()
    ):
        yield {
            "family": p["method"], "order": p["order"], "length": p["correlation_length"],
            "error": p["error"], "reason": p.get("reason", ""),
        }  # fmt: skip


def schemes(bench: Bench, names: Iterable[str], **settings: object) -> Iterator[tuple[float, Row]]:
    """The highest natural frequency, and of each scheme its error [points] or refusal."""
    settings = {"mass": "1.0", "friction": 0.2, "variance": VARIANCE, "dt": DT} | settings
    settings["n_steps"] = round(DURATION / float(str(settings["dt"])))
    reference = bench.slip(scheme=REFERENCE, **settings)
    for name in names:
        found = bench.slip(scheme=SCHEMES[name], **settings)
        if isinstance(reference, str) or isinstance(found, str):
            omega = float("nan") if isinstance(reference, str) else reference[1]
            reason = found if isinstance(found, str) else reference
            yield omega, {"family": name, "error": None, "reason": reason}
        else:
            error = float(np.abs(found[0] - reference[0]).max())
            yield reference[1], {"family": name, "error": error, "reason": ""}


def frictions(bench: Bench) -> Iterator[Row]:
    """The schemes from no friction to sliders that never slip."""
    names = [name for name in SCHEMES if "beta" not in name]
    for friction in FRICTIONS:
        for _, row in schemes(bench, names, friction=friction):
            yield row | {"load": friction * NORMAL_LOAD / VARIANCE**0.5}


def steps(bench: Bench) -> Iterator[Row]:
    """The schemes over the step of the paper's chain, and over one mass that grows lighter."""
    _, omega = bench.slip(
        mass=1.0, friction=0.2, variance=VARIANCE, dt=DT, n_steps=100, scheme=REFERENCE
    )  # fmt: skip
    scenes = [("step", "1.0", dt) for dt in STEPS]
    scenes += [("mass", f"2*1.0 {mass} 2*1.0", DT) for mass in MASSES]
    for varied, mass, dt in scenes:
        for own_omega, row in schemes(bench, SCHEMES, mass=mass, dt=dt):
            # a refused step leaves no file that says the frequency; that of the chain is known
            yield row | {
                "varied": varied,
                "dt_omega": dt * (omega if varied == "step" else own_omega),
            }


PANELS = {
    "processes": positive_processes,
    "friction": frictions,
    "step": steps,
    "order": orders,
}


def main() -> None:
    """One CSV a panel, and what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="for the CSVs")
    parser.add_argument(
        "--program", type=Path, default=ROOT / "build/release/bin/entroslip", help="entroslip"
    )
    parser.add_argument("--only", choices=PANELS, help="this panel; the others' CSVs stay")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scenes:
        bench = Bench(options.program, Path(scenes))
        for name, measure in PANELS.items():
            if options.only not in (None, name):
                continue
            start = time.monotonic()
            rows = list(measure(bench))
            with (options.folder / f"{name}.csv").open("w", newline="") as file:
                table = csv.DictWriter(file, sorted(rows[0]))
                table.writeheader()
                table.writerows(rows)
            print(
                f"{name}: {len(rows)} measurements in {time.monotonic() - start:.0f} s", flush=True
            )


if __name__ == "__main__":
    main()
