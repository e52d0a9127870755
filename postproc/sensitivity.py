"""Table of the joints whose friction matters to the slip of each joint."""

from __future__ import annotations

from collections.abc import Iterator

from .results import Case, Results
from .table import Table, value_with_error

_MOST_COLUMNS = 12  # friction points of a table that is read
_MOST_CASES = 12  # of the beginning of a report; the tables of more stand at its end
_NOTE = (
    "Share of the variance of each joint's time in slip [%] that each friction value explains,"
    " standard errors in brackets in units of the last digits. Friction values are correlated: the"
    " shares of a row add up to what single values explain, and a share may be negative."
)


def tables_of(results: Results) -> Iterator[Table]:
    """One for each case that a regression estimated."""
    known = [case for case in results.random if case.has("sensitivity", "sensitivity_error")]
    for case in known:
        yield table_sensitivity(case, len(known) > _MOST_CASES)


def table_sensitivity(case: Case, is_of_many: bool) -> Table:
    """A row a joint, a column a friction point; the sum last."""
    share = 100.0 * case.data["sensitivity"].values
    error = 100.0 * case.data["sensitivity_error"].values
    points = case.data["friction_point"].values
    rows = [
        (
            str(joint + 1),
            *map(value_with_error, share[joint], error[joint]),
            f"{share[joint].sum():.1f}",
        )
        for joint in range(len(share))
    ]
    header = ("joint", *(f"friction {point}" for point in points), "sum")
    return Table(
        f"sensitivity_{case.name}",
        f"Whose friction matters to the time in slip: {case.name}, {case.label} [%]",
        header, rows, _NOTE,
        is_detail=is_of_many or len(points) > _MOST_COLUMNS, is_result=True,
    )  # fmt: skip
