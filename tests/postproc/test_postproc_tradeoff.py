"""Figures and tables of a tradeoff."""

from __future__ import annotations

import csv

import h5py
import matplotlib.pyplot as plt
import pytest

from entroslip import open_results, tradeoff
from entroslip.__main__ import main
from entroslip.figures.gallery import make_figures
from tests.conftest import SMALL_SCENE

FEW_STEPS = ("--set", "integration%n_steps=1500", "--set", "output%segment_length=256")


@pytest.fixture(scope="module")
def tradeoff_file(results_of_scene):
    return results_of_scene(SMALL_SCENE, "tradeoff", *FEW_STEPS)


def test_the_tree_is_the_whole_file(tradeoff_file):
    """It lacked the groups within /tradeoff and within cases."""
    named: list[str] = []
    with h5py.File(tradeoff_file) as file:
        file.visit(
            lambda name: named.append(f"/{name}") if "units" not in file[name].attrs else None
        )
    assert set(open_results(tradeoff_file).tree.groups) == {"/", *named}


def test_the_only_tradeoff_has_no_file_in_its_titles(tradeoff_file, results_file):
    files = [open_results(results_file), open_results(tradeoff_file)]
    title = "Error and cost of the settings"
    assert title in [figure.title for figure in make_figures(files)]
    assert title not in [figure.title for figure in make_figures([*files, files[-1]])]


def test_a_tradeoff_is_drawn(tradeoff_file):
    folder = tradeoff_file.parent / "drawn"
    assert main([str(tradeoff_file), "--out", str(folder)]) == 0
    assert plt.imread(folder / "tradeoff.png").std() > 0.01  # not a blank page
    with (folder / "tradeoff.csv").open() as file:
        rows = list(csv.DictReader(file))
    with h5py.File(tradeoff_file) as file:
        group = file["tradeoff"]
        shown = (group["is_on_front"][()] == 1) | (group["is_own"][()] == 1)
    assert len(rows) == shown.sum()
    assert [row[""] for row in rows].count("the scene's own") == 1
    costs = [float(row["ns per sample-step"]) for row in rows]
    assert costs == sorted(costs)
    assert plt.imread(folder / "tradeoff_orders.png").std() > 0.01
    with (folder / "tradeoff_variants.csv").open() as file:
        variants = list(csv.reader(file))[1:]
    assert [row[2] for row in variants if row[1] == "order"] == ["1", "2", "3", "5", "10"]
    assert [row[5] for row in variants].count("compared with") == 2
    with (folder / "tradeoff_sizes.csv").open() as file:
        assert ["6", "1500"] in [row[:2] for row in csv.reader(file)]
    assert "Error and cost" in (folder / "report.html").read_text()


def test_a_tradeoff_of_processes_alone_has_a_report(results_of_scene, tmp_path):
    path = results_of_scene(
        "&process correlation_length = 1.0 order = 2 mean = 0.2 std = 0.05 /\n", "tradeoff"
    )
    assert main([str(path), "--out", str(tmp_path)]) == 0
    assert "What orders lose of the entropy" in (tmp_path / "report.html").read_text()
    with (tmp_path / "tradeoff_entropy.csv").open() as file:
        own = [row for row in csv.DictReader(file) if row[""] == "the scene's own"]
    # closed form: AR(2) with L0 = 1 has L1 = 1.4330127
    assert [(row["order"], row["other length"]) for row in own] == [("2", "L1 = 1.43")]


def test_other_files_have_none(results_file):
    results = open_results(results_file)
    assert not list(tradeoff.figures_of(results, {}))
    assert not list(tradeoff.tables_of(results))
