"""The table of whose friction matters to whose slip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from entroslip.results import Case, Results
from entroslip.sensitivity import tables_of


def study(**variables):
    data = xr.Dataset(
        variables, coords={"friction_point": [1, 3]}, attrs={"process": "p001", "n_samples": 100}
    )
    return Results(Path("x.h5"), {"title": "x"}, {}, None, [Case("c001", data)])


def test_shares_stand_by_joint_and_friction_point():
    axes = ("joint", "friction_point")
    share = np.array([[0.95, 0.03], [0.1, 0.8]])
    results = study(sensitivity=(axes, share), sensitivity_error=(axes, 0.01 + 0.0 * share))
    (table,) = tables_of(results)
    assert table.header == ("joint", "friction 1", "friction 3", "sum")
    assert table.rows[0] == ("1", "95.0(10)", "3.0(10)", "98.0")
    assert table.rows[1] == ("2", "10.0(10)", "80.0(10)", "90.0")


def test_tables_of_many_cases_stand_at_the_end():
    """A sine sweep's report opened with as many tables as it had frequencies."""
    axes = ("joint", "friction_point")
    shares = dict.fromkeys(("sensitivity", "sensitivity_error"), (axes, np.ones((2, 2))))
    results = study(**shares)
    for n_cases in (12, 13):
        tables = list(tables_of(replace(results, cases=n_cases * results.cases)))
        assert [table.is_detail for table in tables] == n_cases * [n_cases > 12]


def test_plain_estimates_have_no_table():
    assert list(tables_of(study())) == []
