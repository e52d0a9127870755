"""Tables of docs/accuracy.md and cost.md: python bench/accuracy_tables.py KIND FILE

KIND is `settings` (FILE of `entroslip tradeoff`: those at the scene's step and the finest one),
`errors` (FILE of `entroslip run` with an audit: least and largest over cases of the largest dof) or
`chains` (FILE is bench_dynamics, which is run: what longer chains cost).
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np


def print_table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """In Markdown."""
    for row in (header, ("---",) * len(header), *rows):
        print("|", " | ".join(row), "|")


def print_settings(path: Path) -> None:
    """Cost and every error of some settings."""
    with h5py.File(path) as file:
        of = {name: data[()] for name, data in file["tradeoff"].items()
              if isinstance(data, h5py.Dataset)}  # fmt: skip
    own_dt = of["dt"][of["is_own"] == 1][0]
    at_own = np.isclose(of["dt"], own_dt)
    finest = (of["method"] == 0) & (of["max_halvings"] == of["max_halvings"][~at_own].max())
    shown = np.flatnonzero(at_own | (finest & (of["dt"] < own_dt)))
    shown = sorted(shown, key=lambda i: (of["method"][i], -of["dt"][i], of["max_halvings"][i],
                                         -of["tolerance"][i]))  # fmt: skip
    rows = []
    for i in shown:
        name = (f"event, tolerance {of['tolerance'][i]:.0e}" if of["method"][i]
                else f"newmark, {of['max_halvings'][i]} halvings")  # fmt: skip
        if not at_own[i]:
            name += f", dt/{own_dt / of['dt'][i]:.0f}"
        if of["is_own"][i]:
            name += " (the scene's)"
        rows.append((
            name, f"{of['cost'][i]:.3g}",
            f"{of['slip'][i]:.2g} ± {of['slip_error'][i]:.1g}",
            *(f"{100 * of[key][i]:.2g} %" for key in ("psd_mean", "psd_percentiles")),
            f"{100 * of['band_ratio'][i]:.2g} ± {100 * of['band_ratio_error'][i]:.1g} %",
        ))  # fmt: skip
    print_table(("setting", "ns a sample-step", "slip fraction [points]", "mean spectrum",
                 "its percentiles", "band ratio"), rows)  # fmt: skip


def print_errors(path: Path) -> None:
    """Each error of a results file, least and largest over the cases that have it."""
    with h5py.File(path) as file:
        cases = [case for case in file["campaign"].values() if case.attrs["n_samples"] > 1]

        def over_cases(label: str, unit: str, values: list[float]) -> tuple[str, ...]:
            return label, f"{min(values):.2g}{unit}", f"{max(values):.2g}{unit}"

        def largest(name: str, scale: float = 100.0) -> list[float]:
            return [scale * float(np.nanmax(np.abs(case[name][()]))) for case in cases]

        audits = [case["audit"] for case in cases]
        defects = [float(np.max(np.abs(a["energy_defect"][()] / a["energy_input"][()])))
                   for a in audits]  # fmt: skip
        upward = [float(np.nanmax(case["band_ratio_high"][()] / case["band_ratio"][()]))
                  for case in cases]  # fmt: skip
        along = [100 * float(np.nanmax(case["band_ratio_time_error"][()] / case["band_ratio"][()]))
                 for case in cases]  # fmt: skip
        rows = [
            over_cases("numerical, slip fraction (`audit`, `slip_points`) [points]", "",
                       [float(a.attrs["slip_points"]) for a in audits]),
            over_cases("numerical, band ratio (`audit`, `band_ratio`)", " %",
                       [100 * float(a.attrs["band_ratio"]) for a in audits]),
            over_cases("energy that the audit's balance lacks (`energy_defect`), of the work of"
                       " the force", "", defects),
            over_cases("Monte Carlo, mean slip fraction (`slip_mean_error`) [points]", "",
                       largest("slip_mean_error")),
            over_cases("Monte Carlo, its standard deviation (`slip_std_error`) [points]", "",
                       largest("slip_std_error")),
            over_cases("time average, mean slip fraction (`slip_mean_time_error`) [points]", "",
                       largest("slip_mean_time_error")),
            over_cases("time average, in the standard deviation (`slip_std_time_part`) [points]",
                       "", largest("slip_std_time_part")),
            over_cases("Monte Carlo, band ratio: 95 % interval, upper end over value", "", upward),
            over_cases("time average, band ratio (`band_ratio_time_error`)", " %", along),
            over_cases("power folded back (`folded_share`)", "", largest("folded_share", 1.0)),
        ]  # fmt: skip
    print_table(("error", "least case", "largest case"), rows)


def print_chains(program: Path) -> None:
    """Cost of a sample-step by the number of masses, both methods, and how much happens in one."""
    said = "".join(
        subprocess.run(
            [program.resolve(), "tests/reference/dynamics", part],
            check=True, capture_output=True, text=True,
        ).stdout
        for part in ("chains", "newmark")
    )  # fmt: skip
    cost: dict[str, dict[int, float]] = {"event": {}, "newmark": {}}
    transitions: dict[int, float] = {}
    of_method = None
    for line in said.splitlines():
        if head := re.match(r"# (event|newmark)\b.*: dofs ", line):
            of_method = cost[head[1]]
        elif line.startswith("# when"):
            of_method = None
        elif of_method is not None and not line.startswith("#"):
            n, nanoseconds, rate = line.split()
            of_method[int(n)] = float(nanoseconds)
            transitions[int(n)] = float(rate)
    masses = sorted(transitions)
    print_table(
        ("masses", *map(str, masses)),
        [
            ("transitions a step", *(f"{transitions[n]:.2g}" for n in masses)),
            ("event, tolerance 1e-6 [ns]", *(_cost(cost["event"], n) for n in masses)),
            ("newmark, 15 halvings [ns]", *(_cost(cost["newmark"], n) for n in masses)),
        ],
    )


def _cost(of: dict[int, float], masses: int) -> str:
    return f"{float(f'{of[masses]:.3g}'):g}" if masses in of else "-"


if __name__ == "__main__":
    KINDS = {"settings": print_settings, "errors": print_errors, "chains": print_chains}
    KINDS[sys.argv[1]](Path(sys.argv[2]))
