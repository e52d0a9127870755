"""Table of every number that the paper prints, beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..joints import slip_with_error
from ..processes import is_positive, length_of, order_of
from ..results import Results
from ..table import Table, value_with_error
from .evidence import WIDTH, Statement
from .printed import (
    GIVEN,
    NYQUIST_OVER_PI,
    ORDER_OF_FIG_4,
    PEAK_MEAN,
    SLIP_HZ,
    SLIP_PERCENT,
    STUCK_HZ,
    WHITE_NOISE,
    is_paper_study,
)


@dataclass(frozen=True)
class _Row:
    """A number of the paper: where it stands, what it is, and ours with its standard error."""

    place: str
    what: str
    theirs: str
    ours: str
    error: float = 0.0


def table_numbers(files: Sequence[Results], statements: Sequence[Statement]) -> Table | None:
    """The paper's number and ours with its error; the file with the smallest error decides."""
    rows: dict[tuple[str, str], tuple[_Row, str]] = {}
    for results in filter(is_paper_study, files):
        for row in (
            *_frequencies(results), *_slips(results), *_processes(results), *_given(results)
        ):  # fmt: skip
            known = rows.get((row.place, row.what))
            if known is None or row.error < known[0].error:
                rows[row.place, row.what] = row, results.title
    for row, scene in _judged(statements):
        rows[row.place, row.what] = row, scene
    if not rows:
        return None
    note = (
        "Standard errors in brackets, in units of the last digits; without brackets: exact to the"
        " digits shown. Of several scenes the one with the smallest error is shown."
    )
    header = ("in the paper", "number", "the paper's", "ours", "scene")
    cells = [
        (row.place, row.what, row.theirs, row.ours, scene)
        for _, (row, scene) in sorted(rows.items(), key=lambda item: item[0])
    ]
    return Table("numbers", "The paper's numbers", header, cells, note)


def _frequencies(results: Results) -> Iterator[_Row]:
    if results.structure is None:
        return
    for name, dataset, paper in (
        ("stuck", "frequencies_stuck", STUCK_HZ), ("slipping", "frequencies_slip", SLIP_HZ),
    ):  # fmt: skip
        for mode, (theirs, ours) in enumerate(
            zip(paper, results.structure[dataset].values, strict=True), start=1
        ):
            yield _Row("Table 1", f"{name}, mode {mode} [Hz]", f"{theirs:.2f}", f"{ours:.5f}")


def _slips(results: Results) -> Iterator[_Row]:
    for case in results.deterministic:
        if case.variance not in SLIP_PERCENT or not case.has("slip_fraction"):
            continue
        slip, error = slip_with_error(case)
        for joint, theirs in enumerate(SLIP_PERCENT[case.variance], start=1):
            ours = value_with_error(100.0 * slip[joint - 1], 100.0 * error[joint - 1])
            yield _Row(
                "Table 2", f"{case.force}, joint {joint}: time in slip [%]",
                str(theirs), ours, float(error[joint - 1]),
            )  # fmt: skip


def _processes(results: Results) -> Iterator[_Row]:
    if results.structure is not None:
        return
    solved = [p for p in results.processes.values() if p.attrs["status"] == "solved"]
    free = [p for p in solved if not is_positive(p)]
    if free:
        bound = float(free[0]["entropy_bound"])
        name = "entropy of white noise, std 1 [nat a point]"
        yield _Row("Eq. 42", name, WHITE_NOISE, f"{bound:.7f}")
    orders = [
        order_of(p) for p in free
        if p.attrs["method"] == "autoregressive" and p.attrs["correlation"] == "L0"
        and length_of(p) == 0.3 and int(p.attrs["order"]) > 0
        and float(p["L1"]) <= 1.0
    ]  # fmt: skip
    if orders:
        name = "largest order with L0 = 0.3 and L1 at most 1"
        yield _Row("Fig. 4", name, str(ORDER_OF_FIG_4), str(max(orders)))


def _given(results: Results) -> Iterator[_Row]:
    """Rows of what the paper prescribes for chain, march and study, as the file has it."""
    if results.structure is None or "dt" not in results.structure:
        return
    drawn = {case.process for case in results.random} & set(results.processes)
    found: dict[str, Sequence[float]] = {
        "friction coefficient, mean": [results.processes[name].attrs["mean"] for name in drawn],
        "samples of a case": [case.n_samples for case in results.random],
        "steps": [round(case.duration / float(results.structure["dt"])) for case in results.random],
    }
    for what, name in (
        ("mass [kg]", "mass_value"), ("k1 [N/m]", "stiffness_value"),
        ("k2 [N/m]", "joint_stiffness"), ("N [N]", "normal_load"),
        ("modal damping, stuck", "damping_ratio"), ("time step [s]", "dt"),
    ):  # fmt: skip
        if name in results.structure:
            values = np.atleast_1d(results.structure[name].values)
            found[what] = (-values[values < 0.0] if what.startswith("k1") else values).tolist()
    for what, theirs in GIVEN.items():
        ours = sorted({float(f"{value:.6g}") for value in found.get(what, ())})
        if ours:
            yield _Row("Sec. 3", what, theirs, ", ".join(f"{value:.6g}" for value in ours))
    nyquist = 1.0 / float(results.structure["dt"])
    name = "Nyquist frequency [rad/s]"
    yield _Row("Eq. 46", name, f"{NYQUIST_OVER_PI:g} π", f"{nyquist:.2f} π")


def _judged(statements: Sequence[Statement]) -> Iterator[tuple[_Row, str]]:
    """The mean time in slip at which its scatter peaks, and the scene of the estimate."""
    for statement in statements:
        if statement.number == "1a":
            for finding in statement.findings:
                error = (finding.high - finding.low) / (2.0 * WIDTH)
                ours = value_with_error(100.0 * finding.estimate, 100.0 * error)
                row = _Row("Fig. 9", f"{finding.text} [%]", PEAK_MEAN, ours, error)
                yield row, statement.scene


def table_correlations(results: Results) -> Table | None:
    """Correlation of the friction of two joints, by how far apart they are, for each length."""
    if results.structure is None or not is_paper_study(results) or not results.random:
        return None
    apart = range(1, results.structure.sizes["mode"])
    rows: dict[float, tuple[str, ...]] = {}
    for name in sorted({case.process for case in results.random}):
        process = results.processes.get(name)
        if process is None or "autocovariance" not in process:
            continue
        curve = process["autocovariance"].values
        length = length_of(process)
        cells = (f"{curve[lag] / curve[0]:.3f}" for lag in apart)
        rows.setdefault(length, (f"L0 = {length:g}", str(process.attrs.get("order", "-")), *cells))
    if len(rows) < 2:
        return None
    note = (
        "The chain sees these lags alone. What a longer L0 adds lies mostly beyond its last joint:"
        " at the paper's orders the correlations of L0 = 1 and L0 = 3 are nearly alike, so the"
        " length can have little effect on slip and spectra. With order 1 for all lengths it has"
        " one: docs/paper.md."
    )
    header = ("process", "order", *(f"{lag} joint{'s' * (lag > 1)} apart" for lag in apart))
    title = "Correlation of the friction along the chain"
    return Table("correlations", title, header, [rows[length] for length in sorted(rows)], note)
