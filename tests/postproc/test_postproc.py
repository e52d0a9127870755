"""Tables, figures and the report of a real, small results file."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
import sys

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pytest

from postproc import figures, open_results
from postproc.__main__ import main
from postproc.results import ResultsError
from postproc.tables import table_frequencies, table_slip, value_with_error
from tests.conftest import ENVIRONMENT, PROGRAM, ROOT, SMALL_SCENE


@pytest.fixture(scope="module")
def results_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    (folder / "small.nml").write_text(SMALL_SCENE)
    subprocess.run([PROGRAM, "run", "small.nml"], cwd=folder, env=ENVIRONMENT, check=True)
    return folder / "small.h5"


@pytest.fixture(scope="module")
def drawn(results_file):
    folder = results_file.parent / "drawn"
    assert main([str(results_file), "--out", str(folder)]) == 0
    return folder


def test_every_figure_and_table_is_drawn(drawn):
    names = {path.name for path in drawn.iterdir()}
    for figure in ("08a", "08b", "09a", "10a", "10b", "10c", "11a"):
        assert {f"fig_{figure}.png", f"fig_{figure}.pdf"} <= names
        assert plt.imread(drawn / f"fig_{figure}.png").std() > 0.01  # not a blank page
    assert {"table_1.csv", "table_2.csv", "processes.csv", "statistics_c003.csv"} <= names


def test_table_1_has_the_paper_beside_it(results_file):
    rows = dict((row[0], row[1:]) for row in table_frequencies(open_results(results_file)).rows)
    assert [f"{float(hz):.2f}" for hz in rows["stuck"]] == list(rows["stuck, paper"])
    assert [f"{float(hz):.2f}" for hz in rows["slipping"]] == list(rows["slipping, paper"])


def test_table_2_is_what_the_file_holds(results_file, drawn):
    with (drawn / "table_2.csv").open() as file:
        rows = {row[0]: row[1:] for row in csv.reader(file)}
    with h5py.File(results_file) as file:
        fraction = file["campaign/c002/slip_fraction"][0]
    np.testing.assert_allclose([float(x) for x in rows["variance 41.1"]], 100 * fraction, atol=0.05)
    assert rows["variance 41.1, paper"] == ["36", "45", "52", "59", "65"]
    assert "nothing was tuned" in table_slip(open_results(results_file)).note


def test_report_is_one_file_with_texts_for_its_images(drawn):
    page = (drawn / "report.html").read_text()
    assert not re.search(r'(src|href)="(?!data:)', page)
    images = re.findall(r"<img [^>]*>", page)
    assert len(images) == 7
    assert all(re.search(r'alt="[^"]{40,}"', image) for image in images)
    assert "Table 2" in page
    assert "&amp;process" in page  # the scene


def test_figure_functions_draw_on_the_axes_they_are_given(results_file):
    results = open_results(results_file)
    picture, (left, right) = plt.subplots(1, 2)
    figures.plot_slip_scatter(left, results.random)
    figures.plot_band_ratio(right, results.random)
    assert left.get_xlabel() == right.get_xlabel() == "mean fraction of time in slip"
    plt.close(picture)


def test_a_file_that_is_none_is_refused(tmp_path, capsys):
    (tmp_path / "text.h5").write_text("no")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["program"] = "another"
    for name in ("absent.h5", "text.h5", "other.h5"):
        with pytest.raises(ResultsError, match=name):
            open_results(tmp_path / name)
        assert main([str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
        assert name in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_values_carry_their_errors():
    assert value_with_error(1.00023, 0.00041) == "1.00023(41)"
    assert value_with_error(0.3, 0.0) == "0.3"
    assert value_with_error(123.0, 20.0) == "123(20)"


def test_module_runs_as_a_command(results_file, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "postproc", results_file, "--out", tmp_path / "x"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "report.html" in done.stdout


@pytest.mark.skipif(not shutil.which("chromium"), reason="chromium is not installed")
def test_report_opens_in_a_browser(drawn, tmp_path):
    shot = tmp_path / "report.png"
    done = subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
         "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", f"--user-data-dir={tmp_path}/profile", "--enable-logging=stderr",
         "--window-size=1200,3000", f"--screenshot={shot}", (drawn / "report.html").as_uri()],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0
    assert "CONSOLE" not in done.stderr
    assert plt.imread(shot).std() > 0.01
