"""Tables 1 and 2 beside the paper's, and the numbers of every case, as rows for CSV and report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from . import joints, process_tables, sensitivity, tradeoff
from .paper.evidence import Statement
from .paper.printed import SLIP_HZ, SLIP_PERCENT, STDS, STUCK_HZ, is_paper_study
from .results import Case, Results, shared_friction
from .table import ERRORS, MOST_ROWS, Table, stored, value_with_error

_MOST_COLUMNS = 12  # of a table over joints or modes; longer chains stand upright
_STATISTICS = (  # dataset, title, factor into its unit
    ("slip_mean", "mean time in slip [%]", 100.0),
    ("slip_mean_time_error", "time-average error of the mean [%]", 100.0),
    ("slip_std", "std over samples [%]", 100.0),
    ("slip_std_time_part", "part of the std from the time average [%]", 100.0),
    ("harmonic_amplitude_mean", "mean amplitude of the sine's frequency [m]", 1.0),
    ("harmonic_amplitude_std", "its std over samples [m]", 1.0),
    ("pseudo_variance_mean", "mean pseudo-variance [m²]", 1.0),
    ("pseudo_variance_mean_time_error", "its time-average error [m²]", 1.0),
)
_RATIOS = (  # dataset, title, factor into its unit, digits
    ("band_ratio", "band ratio", 1.0, ".4g"),
    ("band_ratio_low", "band ratio, 95 % from", 1.0, ".4g"),
    ("band_ratio_high", "band ratio, 95 % to", 1.0, ".4g"),
    ("band_ratio_bias", "bias of the band ratio [%]", 100.0, ".1f"),
    ("band_ratio_time_error", "time-average error of the band ratio", 1.0, ".2g"),
)
_AUDITED = (
    ("slip_mean", "mean time in slip [points]", 1.0),
    ("slip_rms", "of one sample, rms [points]", 1.0),
    ("slip_std", "std over samples [points]", 1.0),
    ("psd_mean", "mean spectrum [%]", 100.0),
    ("band_ratio", "band ratio [%]", 100.0),
)
_EXACT_DIGITS = 2  # of an error found by repeating every sample


def make_tables(files: Sequence[Results]) -> list[Table]:
    """Every table that the files have data for; named as `make_figures` names figures."""
    found: dict[str, Table] = {}
    for results in files:
        is_paper = is_paper_study(results)
        for table in (table for source in SOURCES for table in source(results)):
            twin = found.get(table.name)
            if twin == table:
                continue
            name = table.name if twin is None else f"{table.name}_{results.stem}"
            if twin is not None or (len(files) > 1 and not is_paper):
                table = replace(table, name=name, title=f"{table.title} ({results.stem}.h5)")
            found[name] = table
    return sorted(found.values(), key=lambda table: not table.title.startswith("Table "))


def table_statements(statements: Sequence[Statement]) -> Table:
    """Every number that the paper's statements were judged by."""
    rows = [
        (
            s.number, s.claim, s.verdict.value, f"{s.judgement.p_value:.2g}", finding.text,
            f"{finding.estimate:.4g}", f"{finding.low:.4g}", f"{finding.high:.4g}", s.test,
            s.scene,
        )
        for s in statements
        for finding in s.findings
    ]  # fmt: skip
    header = (
        "statement", "claim", "verdict", "p", "number", "estimate", "95 % from", "to", "test",
        "scene",
    )  # fmt: skip
    return Table("statements", "The paper's statements", header, rows)


def of_chain(results: Results) -> Iterator[Table]:
    """Tables 1 and 2."""
    if results.structure is not None:
        yield table_frequencies(results)
    drawn = [case for case in results.random if case.has("slip_mean", "slip_mean_error")]
    for quantity in joints.QUANTITIES:
        own = [case for case in drawn if quantity.is_in(case)]
        if own:
            yield table_joints(own, quantity)
    if any(case.has("slip_fraction") for case in results.deterministic):
        yield table_slip(results)


def of_cases(results: Results) -> Iterator[Table]:
    """Statistics of the cases with drawn friction, and numerical errors where they were audited."""
    if any(case.audit is not None for case in results.cases):
        yield table_audit(results)
    for case in results.random:
        if case.has("slip_mean", "slip_std"):
            yield table_statistics(case)
        elif case.n_samples == 1 and case.has("slip_fraction"):
            yield table_sample(case)


# Each yields the tables that a file has data for.
SOURCES: tuple[Callable[[Results], Iterator[Table]], ...] = (
    of_chain, process_tables.tables_of, of_cases, sensitivity.tables_of, tradeoff.tables_of,
)  # fmt: skip


def table_frequencies(results: Results) -> Table:
    """Table 1: natural frequencies with every slider stuck, and with every slider slipping."""
    assert results.structure is not None
    rows = []
    for name, dataset, paper in (
        ("stuck", "frequencies_stuck", STUCK_HZ),
        ("slipping", "frequencies_slip", SLIP_HZ),
    ):
        rows.append((name, *(f"{hz:.4f}" for hz in results.structure[dataset].values)))
        if is_paper_study(results):
            rows.append((f"{name}, paper", *(f"{hz:.2f}" for hz in paper)))
    modes = range(1, results.structure.sizes["mode"] + 1)
    note = "Eigenvalues to rounding; every digit of the paper's is met." if len(rows) > 2 else ""
    header, body = _upright("mode", modes, rows, "frequency [Hz]")
    title = "Natural frequencies [Hz]"
    title = f"Table 1. {title}" if is_paper_study(results) else title
    return Table("table_1", title, header, body, note)


def table_slip(results: Results) -> Table:
    """Table 2: percentage of time in slip, friction certain."""
    cases = [case for case in results.deterministic if case.has("slip_fraction")]
    rows, beside = [], []
    for case in cases:
        slip, error = joints.slip_with_error(case)
        name = case.force
        ours = (value_with_error(100.0 * p, 100.0 * e) for p, e in zip(slip, error, strict=True))
        rows.append((name, *ours))
        if case.variance in SLIP_PERCENT and is_paper_study(results):
            paper = SLIP_PERCENT[case.variance]
            rows.append((f"{name}, paper", *(f"{p:d}" for p in paper)))
            rows += _with_random_friction(results, case)
            beside.append(f" At {name}: {beside_paper(100.0 * slip, 100.0 * error, paper)}.")
    note = f"{cases[0].given_friction.capitalize()}. {ERRORS}"
    note += " They are those of the time average over one force record"
    note += ", and of the samples too where friction is random." if beside else "."
    if beside:
        note += (
            f"{''.join(beside)} The paper's two rows are not consistent under one flat force"
            " spectrum; nothing was tuned. A lead: its row at 3.7 is near the means under random"
            f" friction of std {min(STDS):g}, its row at 41.1 near deterministic friction."
        )
    header, body = _upright("joint", range(1, cases[0].n_joints + 1), rows, "time in slip [%]")
    is_long = len(body) > MOST_ROWS
    if not beside or is_long:
        title = "Time in slip, deterministic friction [%]"
        return Table("slip", title, header, body, note, is_long, is_result=True)
    return Table("table_2", "Table 2. Time in slip [%]", header, body, note)


def _with_random_friction(results: Results, certain: Case) -> list[tuple[str, ...]]:
    """Mean time in slip [%] of the joints at the paper's smaller std, over its lengths."""
    cases = [
        case for case in results.random
        if case.std == min(STDS) and case.force == certain.force and case.has("slip_mean_error")
    ]  # fmt: skip
    if not cases:
        return []
    mean = np.mean([case.data["slip_mean"].values for case in cases], axis=0)
    times = [
        case.data["slip_mean_time_error"].values
        for case in cases if case.has("slip_mean_time_error")
    ]  # fmt: skip
    time = np.mean(times, axis=0) if times else 0.0  # one record moves all lengths alike
    errors = [case.data["slip_mean_error"].values for case in cases]
    error = np.hypot(np.sqrt(np.sum(np.square(errors), axis=0)) / len(cases), time)
    cells = map(value_with_error, 100.0 * mean, 100.0 * error)
    return [(f"{certain.force}, mean at random friction, std {min(STDS):g}", *cells)]


def table_joints(cases: Sequence[Case], quantity: joints.OfJoints) -> Table:
    """A quantity of each joint and case with its error, what there is more of below one another."""
    joint_names = [str(i + 1) for i in range(cases[0].n_joints)]
    friction = shared_friction(cases)
    case_names = [f"{case.name}: {case.force if friction else case.label}" for case in cases]
    cells = [list(map(value_with_error, *quantity.of(case))) for case in cases]
    if len(cases) > len(joint_names):
        names = [f"joint {name} [{quantity.unit}]" for name in joint_names]
        corner, lines = "case", case_names
    else:
        names = [f"[{quantity.unit}] {name}" for name in case_names]
        corner, lines = "joint", joint_names
        cells = [list(row) for row in zip(*cells, strict=True)]
    rows = [(line, *row) for line, row in zip(lines, cells, strict=True)]
    name = "joints" if quantity.name == "slip" else f"joints_{quantity.name}"
    title = f"{quantity.heading} of the joints [{quantity.unit}]{friction and f', {friction}'}"
    return Table(
        name, title, (corner, *names), rows, f"{ERRORS} {quantity.errors(cases)}.",
        is_detail=len(cases) > _MOST_COLUMNS or len(rows) > MOST_ROWS, is_result=True,
    )  # fmt: skip


def beside_paper(
    slip: NDArray[np.float64], error: NDArray[np.float64], paper: Sequence[int]
) -> str:
    """Agreement of percentages with printed whole ones, within two errors and the rounding."""
    difference = slip - paper
    if (abs(difference) <= 0.5 + 2.0 * error).all():
        return "all agree with the paper's within two standard errors and its rounding"
    worst = int(np.argmax(abs(difference) / (0.5 + 2.0 * error)))
    apart = f"{abs(difference[worst]):.1f} points {'above' if difference[worst] > 0 else 'below'}"
    return f"not the paper's, joint {worst + 1} lies {apart} (standard error {error[worst]:.1f})"


def table_statistics(case: Case) -> Table:
    """Slip fractions, amplitudes, pseudo-variances and band ratios of one case with errors."""
    data = case.data
    columns = [column for column in _STATISTICS if column[0] in data]
    percentiles = data["percentile"].values if case.has("pseudo_variance_percentiles") else ()
    rows = []
    ratios: tuple[tuple[str, str, float, str], ...] = ()
    if len(percentiles) > 1:
        ratios = tuple(column for column in _RATIOS if case.has(column[0]))
    for i in sorted({*range(case.n_joints), *(dof - 1 for dof in case.kept_dofs)}):
        row = [str(i + 1)]
        here = data.isel({axis: i for axis in ("dof", "joint") if i < data.sizes.get(axis, 0)})
        row += [
            stored(here, name, scale) if here[name].ndim == 0 else "" for name, _, scale in columns
        ]
        if i >= case.n_dof:  # a joint more than there are dofs
            rows.append((*row, *[""] * (len(percentiles) + len(ratios))))
            continue
        row += [
            stored(here.isel(percentile=k), "pseudo_variance_percentiles")
            for k in range(len(percentiles))
        ]
        row += [
            f"{value:{shown}}" if np.isfinite(value := scale * float(here[name])) else "-"
            for name, _, scale, shown in ratios
        ]
        rows.append(tuple(row))
    header = ["joint and dof", *(title for _, title, _ in columns)]
    header += [f"pseudo-variance of percentile {level:g} [m²]" for level in percentiles]
    header += [title for _, title, _, _ in ratios]
    title = f"{case.name}: {case.process}, {case.label}, {case.n_samples} samples"
    note = ERRORS
    if case.has("steady"):
        note += f" {int(data['steady'].sum())} of {case.n_samples} samples are steady."
    if case.has("band_ratio"):
        note += (
            " Those of pseudo-variances, and the interval of the band ratio, are Monte Carlo errors"
            " alone"
            + (
                "; time-average errors stand beside them."
                if case.has("band_ratio_time_error")
                else ": time-average errors need 16 segments."
            )
        )
    return Table(f"statistics_{case.name}", title, tuple(header), rows, note, is_detail=True)


def table_sample(case: Case) -> Table:
    """Friction and time in slip of the only sample of a case, as a replay has it."""
    data = case.data.isel(sample=0)
    slip, error = joints.slip_with_error(case)
    rows = [
        ("friction coefficient", *(f"{value:.4g}" for value in data["friction"].values)),
        ("time in slip [%]", *map(value_with_error, 100.0 * slip, 100.0 * error)),
        ("slips begun", *(str(count) for count in data["slip_starts"].values)),
    ]
    header, body = _upright("joint", range(1, case.n_joints + 1), rows)
    title = f"{case.name}: sample {int(data['sample'])}, {case.label}"
    note = f"{ERRORS} They are those of the time average."
    return Table(f"sample_{case.name}", title, header, body, note, is_result=True)


def table_audit(results: Results) -> Table:
    """Numerical errors: samples less what a reference gives for the same ones."""
    rows = []
    for case in results.cases:
        audit = case.audit
        if audit is None:
            continue
        errors = [_largest(audit, f"{name}_difference", scale) for name, _, scale in _AUDITED]
        rows.append((case.name, f"{audit.attrs['n_samples']} of {case.n_samples}", *errors))
    header = ("case", "samples repeated", *(title for _, title, _ in _AUDITED))
    note = (
        "Difference of the case's own method from the reference method on the same samples, at the"
        f" joint where it is largest. {ERRORS}"
    )
    return Table("audit", "Numerical errors, by audit", header, rows, note)


def _largest(audit: xr.Dataset, name: str, scale: float) -> str:
    """The largest difference over joints (and percentiles), with its own error."""
    if name not in audit:
        return "-"
    sizes = np.abs(audit[name].values).ravel()
    if not np.isfinite(sizes).any():
        return "-"
    worst = int(np.nanargmax(sizes))
    error = f"{name}_error"
    known = float(audit[error].values.ravel()[worst]) if error in audit else 0.0
    if known <= 0.0:
        return f"{scale * float(sizes[worst]):.{_EXACT_DIGITS}g}"
    return value_with_error(scale * float(sizes[worst]), scale * known)


def _upright(
    what: str, numbers: Sequence[int], rows: Sequence[tuple[str, ...]], corner: str = ""
) -> tuple[tuple[str, ...], Sequence[tuple[str, ...]]]:
    """Header and rows over joints or modes; many of them stand below one another."""
    header = (corner, *(f"{what} {number}" for number in numbers))
    if len(numbers) <= _MOST_COLUMNS:
        return header, rows
    names = (what, *(row[0] for row in rows))
    return names, [
        (str(number), *(row[number] for row in rows)) for number in numbers
    ]  # fmt: skip
