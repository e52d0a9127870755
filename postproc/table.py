"""Rows under a header, for the report and as CSV, and numbers with their errors."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import SupportsFloat

import numpy as np
import xarray as xr

from .output import write_file

ERRORS = "Standard errors in brackets, in units of the last digits."
MOST_ROWS = 24  # of a table among the first; a longer one stands at the end of the report
_MOST_BEHIND = 9  # digits behind the point; smaller numbers have a power of ten
_LEAST_PLAIN = 1e-3  # likewise
_SHOWN = 7  # significant digits at most; a smaller error is none that is seen


@dataclass(frozen=True)
class Table:
    """Rows under a header; `name` is that of the file, `note` says how to read the rows."""

    name: str
    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""
    is_detail: bool = False  # for the end of the report, as one with many rows
    is_result: bool = False  # for the beginning of a report on a structure of one's own

    def write_csv(self, folder: Path) -> Path:
        """The same cells, empty where there is none; standard errors have columns of their own."""
        path = folder / f"{self.name}.csv"
        cells = StringIO(newline="")
        csv.writer(cells).writerows(zip(*self._columns(), strict=True))
        write_file(path, cells.getvalue().encode())
        return path

    def _columns(self) -> Iterator[list[str]]:
        for place, title in enumerate(self.header):
            cells = ["" if row[place] == "-" else row[place] for row in self.rows]
            errors = [getattr(cell, "error", "") for cell in cells]
            yield [title, *(getattr(cell, "value", cell) for cell in cells)]
            if any(errors):
                yield [f"{title} standard error".lstrip(), *errors]


class Measured(str):
    """A value with its standard error in brackets, and both apart, in the digits that count."""

    value: str
    error: str

    def __new__(cls, text: str, value: float, error: float) -> Measured:
        """A cell with this text."""
        self = super().__new__(cls, text)
        digits = 2 + max(0, int(np.floor(np.log10(max(abs(value), error) / error))))
        self.value = f"{value:.{min(digits, _SHOWN)}g}"
        self.error = f"{error:.2g}"
        return self


def rounded(value: SupportsFloat, digits: int = 3) -> str:
    """So many significant digits; a power of ten from a million on, and below 0.0001."""
    return f"{float(f'{float(value):.{digits}g}'):g}"


def value_with_error(value: float, error: float) -> str:
    """'1.00023(41)': the error in units of the last digits; without one, six significant digits."""
    if not (np.isfinite(value) and error > 0.0 and np.isfinite(error)):
        return _bracketed(value, error)
    return Measured(_bracketed(value, error), value, error)


def stored(data: xr.Dataset, name: str, scale: float = 1.0) -> str:
    """A value of the file, times a factor, with its standard error where it has one."""
    if name not in data or not np.isfinite(value := scale * float(data[name])):
        return "-"
    if name.endswith(("_time_error", "_time_part")):  # errors themselves
        return f"{value:.2g}"
    error = float(data[f"{name}_error"]) if f"{name}_error" in data else 0.0
    return value_with_error(value, scale * error)


def _bracketed(value: float, error: float) -> str:
    if not np.isfinite(value):
        return "-"
    if not (error > 0.0 and np.isfinite(error)):
        return f"{value:.6g}".replace("e-0", "e-")
    if error < 0.5 * abs(value) * 10.0**-_SHOWN:
        return f"{value:#.{_SHOWN}g}".replace("e-0", "e-")
    digits = 1 - int(np.floor(np.log10(error)))
    size = max(abs(value), error)
    if digits > _MOST_BEHIND or size < _LEAST_PLAIN:
        power = int(np.floor(np.log10(size)))
        return f"{_bracketed(value / 10.0**power, error / 10.0**power)}e{power:d}"
    if round(error * 10.0**digits) > 99:  # 0.0995 is 0.10 in two digits
        digits -= 1
    digits = max(0, digits)
    return f"{value:.{digits}f}({round(error * 10**digits):d})"
