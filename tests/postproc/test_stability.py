"""The map of stability, drawn from measurements that a test chooses."""

from __future__ import annotations

import csv

import matplotlib.pyplot as plt
import pytest
from PIL import Image

from entroslip import stability

PROCESSES = [
    {"order": order, "family": law, "length": length, "ratio": ratio, "error": error,
     "limit": limit}
    for order, law, length, ratio, error, limit in (
        (1, "sequential", 0.1, 0.5, 1e-12, ""),
        (1, "sequential", 1.0, 0.9, "", 0.84),
        (1, "sequential", 3.0, 0.9, "", 0.84),
        (1, "exact", 1.0, 0.5, 1e-3, ""),
        (5, "exact", 1.0, 0.3, 1e-3, ""),
        (5, "exact", 1.0, 0.5, 0.02, ""),
    )
]  # fmt: skip
MOTION = [
    {"family": family, "error": error, "load": load, "dt_omega": 0.1, "varied": varied}
    for family, error, load, varied in (
        ("newmark, 15 halvings", 0.0, 0.0, "step"),
        ("newmark, 15 halvings", 0.05, 1.0, "step"),
        ("newmark, none", 2.0, 1.0, "mass"),
        ("newmark, none", "", 1e8, "mass"),
    )
]
ORDERS = [
    {"family": "direct", "order": order, "length": 3.0, "error": error}
    for order, error in ((2, ""), (10, 1e-15))
]
TABLES = {"processes": PROCESSES, "friction": MOTION, "step": MOTION, "order": ORDERS}


@pytest.fixture
def folder(tmp_path):
    for name, rows in TABLES.items():
        with (tmp_path / f"{name}.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, rows[0])
            table.writeheader()
            table.writerows(rows)
    return tmp_path


@pytest.fixture
def tables(folder):
    return {name: stability.read(folder / f"{name}.csv") for name in TABLES}


@pytest.mark.parametrize(
    ("error", "said"),
    [
        ("", "refuses"),
        ("0.0", "holds"),
        ("0.1", "holds"),
        ("0.11", "degrades"),
        ("nan", "degrades"),
    ],
)
def test_status_is_by_the_error(error, said):
    assert stability.status({"error": error}, 0.1) == said


def test_the_map_is_drawn(folder, capsys):
    picture = folder / "map.png"
    assert stability.main([str(folder), "--out", str(picture)]) == 0
    with Image.open(picture) as drawn:
        assert min(drawn.size) > 500
    assert plt.imread(picture).std() > 0.01  # not a blank page
    said = capsys.readouterr().out
    assert "| processes, order 1 | sequential | 1 | 0 | 2 | 1.0e-12 |" in said
    assert "| processes, order 1 | exact | 0 | 1 | 0 | 1.0e-03 |" in said
    # of simulated values: a percent
    assert "| processes, order 5 | exact | 1 | 1 | 0 | 2.0e-02 |" in said
    assert "| step | newmark, none | 0 | 1 | 1 | 2.0e+00 |" in said


def test_no_error_and_no_friction_have_a_place_on_logarithmic_axes(tables):
    _, axes = plt.subplots()
    stability.plot_friction(axes, tables["friction"])
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    marks = [line.get_xydata()[0] for line in axes.lines if line.get_marker() in ("o", "s")]
    assert len(marks) == len(MOTION)
    assert all(left <= x <= right and bottom <= y <= top for x, y in marks)
    heights = [y for _, y in marks]
    assert max(heights) == heights[3] > 100 * heights[2]  # refusals stand above every error
    assert min(heights) == heights[0]
    plt.close()


def test_limits_are_drawn_where_refusals_name_them(tables):
    _, axes = plt.subplots()
    stability.plot_processes(axes, [row for row in tables["processes"] if row["order"] == "1"])
    curves = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
    assert curves["limit, sequential"] == [[1.0, 0.84], [3.0, 0.84]]
    assert "limit, exact" not in curves
    plt.close()
