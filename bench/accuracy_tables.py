"""Tables of docs/accuracy.md from results files: python bench/accuracy_tables.py KIND FILE

KIND is `settings` (of `entroslip tradeoff`, those at the scene's step and the finest one) or
`errors` (of `entroslip run` with an audit: least and largest over cases of the largest dof).
"""

from __future__ import annotations

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
            over_cases("size of its bias (`band_ratio_bias`)", " %", largest("band_ratio_bias")),
            over_cases("power folded back (`folded_share`)", "", largest("folded_share", 1.0)),
        ]  # fmt: skip
    print_table(("error", "least case", "largest case"), rows)


if __name__ == "__main__":
    {"settings": print_settings, "errors": print_errors}[sys.argv[1]](Path(sys.argv[2]))
