"""Several designs against one: how much each changes the response, the slip and the dissipation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from .compare import OF_RECORD, Pair, mean_change, pair_cases
from .results import Results
from .table import Table, value_with_error

_PERCENT = 100.0
_NOTE = (
    "Changes of means over the samples of both files, the largest fall of the rms first. Standard"
    " errors are in brackets, in units of the last digits; they are those of the differences sample"
    f" by sample where the seeds agree. {OF_RECORD}"
)


def table_designs(before: Results, afters: Sequence[Results]) -> Table:
    """A row for each case with drawn friction and each design, the largest fall of the rms first.

    Cases with given friction stand there where a file has no others.
    """
    rows = []
    for label in dict.fromkeys(pair.label for pair in _pairs(before, afters[0])):
        own = [
            (_rms(before, pair), after.stem, pair)
            for after in afters
            for pair in _pairs(before, after)
            if pair.label == label
        ]
        own.sort(key=lambda row: np.nan_to_num(row[0][0], nan=np.inf))
        rows += [(label, name, *_cells(rms, pair)) for rms, name, pair in own]
    header = (
        "case", "design", f"rms of {before.place} {before.forced_dof} [%]", "time in slip [points]",
        "dissipated [%]",
    )  # fmt: skip
    title = f"Designs against {before.stem}"
    return Table("designs", title, header, rows, _NOTE)


def _pairs(before: Results, after: Results) -> list[Pair]:
    pairs = pair_cases(before, after)
    random = [pair for pair in pairs if not pair.before.is_deterministic]
    return random or pairs


def _rms(before: Results, pair: Pair) -> tuple[float, float]:
    """Change of the rms displacement of the forced dof, and its error [%]; NaN where unknown."""
    powers = pair.powers() or pair.samples("harmonic_amplitude")
    if powers is None:
        return np.nan, 0.0
    first, second = (values[:, before.forced_dof - 1] for values in powers)
    if pair.before.is_sine:
        first, second = first**2, second**2
    return _relative(pair, first, second, power=0.5)


def _relative(
    pair: Pair, before: NDArray[np.float64], after: NDArray[np.float64], power: float
) -> tuple[float, float]:
    """Change of a mean (sample), raised to a power, and its error [%]."""
    if not before.mean() > 0.0:
        return np.nan, 0.0
    ratio = float(after.mean() / before.mean())
    if not ratio > 0.0:
        return -_PERCENT, 0.0
    change = mean_change(before / before.mean(), after / after.mean(), pair.is_paired)
    error = float(np.nan_to_num(change.error)) * power * ratio**power
    return _PERCENT * (ratio**power - 1.0), _PERCENT * error


def _cells(rms: tuple[float, float], pair: Pair) -> Iterator[str]:
    yield value_with_error(*rms)
    slip, work = pair.samples("slip_fraction"), pair.samples("dissipation")
    if slip is None or work is None:
        yield from ("-", "-")
        return
    first, second = (_PERCENT * values.mean(axis=1) for values in slip)
    change = mean_change(first, second, pair.is_paired)
    yield value_with_error(float(change.change), float(np.nan_to_num(change.error)))
    before, after = (values.sum(axis=1) for values in work)
    yield value_with_error(*_relative(pair, before, after, power=1.0))
