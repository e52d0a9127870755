"""Tables, figures and the command, on a real, small results file."""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import version

import h5py
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from entroslip import joints, open_results
from entroslip.__main__ import main
from entroslip.figures import gallery_page, looks, process_figures, study_figures
from entroslip.figures.chain_figure import plot_chain
from entroslip.figures.figure import SECTIONS, Figure
from entroslip.paper.printed import AXES
from entroslip.results import ResultsError, find_damage
from entroslip.table import Table, rounded, stored, value_with_error
from entroslip.tables import beside_paper, table_audit, table_frequencies, table_slip
from tests.conftest import ROOT
from tests.postproc.synthetic import FREQUENCY, case_of


@pytest.fixture(scope="module")
def process_file(results_of_scene):
    """Two processes and no chain."""
    return results_of_scene(
        "&process correlation_length = 0.3 order = 1, 2 pairing = 'product' mean = 0.0 std = 1.0"
        " positive = .false. /\n"
    )


def test_every_figure_and_table_is_drawn(drawn):
    names = {path.name for path in drawn.iterdir()}
    for figure in ("07", "08a", "08b", "09a", "10a", "10b", "10c", "11a"):
        assert {f"fig_{figure}.png", f"fig_{figure}.pdf"} <= names
        assert plt.imread(drawn / f"fig_{figure}.png").std() > 0.01  # not a blank page
    assert {"table_1.csv", "table_2.csv", "processes.csv", "statistics_c003.csv"} <= names
    assert {"statements.csv", "report.html"} <= names


def test_table_1_has_the_paper_beside_it(results_file):
    rows = dict((row[0], row[1:]) for row in table_frequencies(open_results(results_file)).rows)
    assert [f"{float(hz):.2f}" for hz in rows["stuck"]] == list(rows["stuck, paper"])
    assert [f"{float(hz):.2f}" for hz in rows["slipping"]] == list(rows["slipping, paper"])


def test_table_2_is_what_the_file_holds(results_file, drawn):
    """Values and their standard errors have columns of their own, as a spreadsheet wants them."""
    with (drawn / "table_2.csv").open() as file:
        rows = {row[0]: row[1:] for row in csv.reader(file)}
    with h5py.File(results_file) as file:
        fraction = file["campaign/c002/slip_fraction"][0]
    header = rows["time in slip [%]"]
    assert header[:2] == ["joint 1", "joint 1 standard error"]
    shown = [float(cell) for cell in rows["variance 41.1 N²"]]
    np.testing.assert_allclose(shown[::2], 100 * fraction, atol=0.5)  # errors are some points here
    assert min(shown[1::2]) > 0.0
    assert rows["variance 41.1 N², paper"][::2] == ["36", "45", "52", "59", "65"]
    assert "nothing was tuned" in table_slip(open_results(results_file)).note


def test_audited_cases_show_their_numerical_errors(results_of_scene, tmp_path):
    text = "&process correlation_length = 0.3 order = 2 mean = 0.2 std = 0.067 /\n&chain /\n"
    text += "&excitation variance = 41.1 /\n&integration n_steps = 2000 /\n"
    text += "&campaign n_samples = 4 /\n&accuracy audit = 0.5 /\n&output segment_length = 256 /\n"
    path = results_of_scene(text)
    results = open_results(path)
    audit = results.cases[0].audit
    assert "/audit/c001" in results.tree.groups
    (row,) = table_audit(results).rows
    assert row[:2] == ("c001", "2 of 4")
    shown = row[2].split("(")[0].split(" ")[0]
    worst = np.abs(audit["slip_mean_difference"]).max()
    np.testing.assert_allclose(float(shown), worst, rtol=0.1)  # as many digits as its error allows
    assert main([str(path), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "audit.csv").exists()


def test_every_dataset_is_labelled(results_file):
    results = open_results(results_file)
    for group in results.tree.subtree:
        for name, variable in group.variables.items():
            assert variable.attrs["units"], (group.path, name)
            assert variable.attrs["long_name"], (group.path, name)
            if name not in variable.dims and variable.ndim:
                assert all(axis in group.variables for axis in variable.dims), (group.path, name)
    assert {"/structure", "/process/p001", "/campaign/c003"} <= set(results.tree.groups)
    assert results.tree["campaign/c003"].attrs["process"] == "p001"
    assert results.title == "small"


def test_table_2_says_what_agrees():
    """Three percentages: within two errors and the rounding, or the one that is worst."""
    ours, error = np.array([7.4, 8.0, 12.9]), np.array([0.1, 0.1, 0.1])
    assert beside_paper(ours, error, (7, 8, 13)).startswith("all agree")
    said = beside_paper(ours, error, (7, 8, 17))
    assert "joint 3 lies 4.1 points below (standard error 0.1)" in said


def test_the_chain_is_drawn_with_its_force():
    """At the forced mass, which is drawn even where masses are left out."""
    for n_dof, forced, drawn in (
        (5, 5, range(1, 6)),
        (5, 3, range(1, 6)),
        (50, 20, (1, 2, 3, 20, 49, 50)),
    ):
        picture, axes = plt.subplots()
        plot_chain(axes, n_dof, forced)
        texts = {text.get_text(): text.get_position() for text in axes.texts}
        assert {f"$m_{{{number}}}$" for number in drawn} <= set(texts)
        behind = texts["$F(t)$"][0] - texts[f"$m_{{{forced}}}$"][0]
        assert 0.0 < behind < 2.2  # of the distance between masses
        assert (r"$\cdots$" in texts) == (n_dof > len(drawn))
        plt.close(picture)


def test_levels_of_the_force_have_the_papers_names(results_file):
    case = open_results(results_file).cases[-1]
    case.data.attrs["variance"] = 41.1
    assert looks.level_name(case) == "variance 41.1 N² (high)"
    case.data.attrs |= {"variance": 0.0, "factor": 2.0}
    assert looks.level_name(case) == "force factor 2"


def test_figure_functions_draw_on_the_axes_they_are_given(results_file):
    results = open_results(results_file)
    picture, (left, right) = plt.subplots(1, 2)
    study_figures.plot_slip_scatter(left, results.random)
    study_figures.plot_band_ratio(right, results.random)
    assert left.get_xlabel() == right.get_xlabel() == "mean time in slip [%]"
    plt.close(picture)


def test_bars_hold_monte_carlo_and_the_finite_march():
    case = case_of("c001", "p001", np.full((2, 1), 0.3), np.ones((2, FREQUENCY.size, 1)))
    case.data.update(
        {
            "slip_mean_error": ("joint", [0.03]),
            "slip_mean_time_error": ("joint", [0.04]),
            "band_ratio": ("dof", [2.0]),
            "band_ratio_low": ("dof", [2.0 * np.exp(-0.3)]),
            "band_ratio_high": ("dof", [2.0 * np.exp(0.3)]),
        }
    )
    np.testing.assert_allclose(joints.slip_mean_error(case), 0.05)
    np.testing.assert_allclose(study_figures.band_ratio_interval(case)[0], 2.0 * np.exp(-0.3))
    case.data["band_ratio_time_error"] = ("dof", [2.0 * 0.4 / 1.959964])
    low, high = study_figures.band_ratio_interval(case)
    np.testing.assert_allclose([low[0], high[0]], 2.0 * np.exp([-0.5, 0.5]))
    case.data["band_ratio_time_error"] = ("dof", [4.0])  # no ratio is below 1
    assert study_figures.band_ratio_interval(case)[0] == 1.0


def test_one_look_for_one_thing():
    """Each length and oscillator: one colour, mark and line, whatever else is drawn."""
    from entroslip.figures import style

    assert style.of_length(1.0, [1.0]) == style.of_length(1.0, [0.3, 1.0, 3.0, 7.0])
    assert style.of_length(7.0, [7.0]) != style.of_length(0.3, [0.3])
    many = [0.3, *np.arange(12.0)]  # the ninth had the colour and the mark of the second
    assert len({str(style.of_length(length, many)) for length in many}) == 13
    looks = [style.of_dof(dof, 5) for dof in range(1, 6)]
    for trait in ("color", "marker", "linestyle"):
        assert len({str(look[trait]) for look in looks}) == 5
    assert style.some_of(range(1, 4)) == [1, 2, 3]
    assert style.some_of(range(1, 201))[0] == 1
    assert style.some_of(range(1, 201))[-1] == 200


def test_chosen_orders_say_their_bounds():
    """On either side: automatic is above for L0, below for L1."""
    picture, axes = plt.subplots()
    found = {"autocovariance": ("lag", np.ones(3)), "a": ("order", np.ones(2))}
    asked = {"method": "autoregressive", "correlation_length": 1.0}
    sides = [("L0", "l1", "automatic"), ("L1", "l0", "automatic"), ("L1", "l0", "upper")]
    process_figures.plot_chosen_orders(
        axes,
        [
            xr.Dataset(found, {"lag": np.arange(3)},
                       {**asked, "correlation": length, f"bound_{other}": 3.0, "bound_side": side})
            for length, other, side in sides
        ],
    )  # fmt: skip
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == [
        "$L_0$ = 1, $L_1$ ≤ 3: order 2",
        "$L_1$ = 1, $L_0$ ≥ 3: order 2",
        "$L_1$ = 1, $L_0$ ≤ 3: order 2",
    ]
    plt.close(picture)


def test_axes_can_be_laid_beside_the_papers(process_file, tmp_path, capsys):
    """The ranges of the paper's text, or of the user, by the start of the figure's name."""
    panels = []
    figure = Figure("fig_09b", "", "", SECTIONS[0], (panels.append,))
    figure.save(tmp_path, AXES)
    figure.save(tmp_path, {"fig_09": (0.0, 1.0, 0.1, 2.0), "fig_1": (0.0, 9.0, 0.0, 9.0)})
    ranges = [(*axes.get_xlim(), *axes.get_ylim()) for axes in panels]
    assert ranges == [AXES["fig_09"], (0.0, 1.0, 0.1, 2.0)]
    options = [str(process_file), "--out", str(tmp_path), "--paper-axes"]
    assert main([*options, "--axes", "fig_02=0,5,1e-3,1"]) == 0
    with pytest.raises(SystemExit):
        main([*options, "--axes", "fig_08=1"])
    assert main([*options, "--axes", "fig_8=0,5,0,1"]) == 2
    assert "fig_8: no name of a figure begins with it; there are fig_0" in capsys.readouterr().err


def test_a_style_of_ones_own_is_laid_over(process_file, tmp_path, capsys):
    style = tmp_path / "mine.mplstyle"
    style.write_text("savefig.dpi: 40\n")
    with plt.rc_context():
        words = [str(process_file), "--out", str(tmp_path / "out")]
        assert main([*words, "--style", str(style)]) == 0
        assert plt.imread(tmp_path / "out/fig_02a.png").shape[1] < 300
        assert main([*words, "--style", "absent"]) == 2
    assert "absent" in capsys.readouterr().err.splitlines()[-1]


def test_two_files_make_one_report(process_file, tmp_path):
    twin = process_file.with_name("twin.h5")
    twin.write_bytes(process_file.read_bytes())
    assert main([str(process_file), str(twin), "--out", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert {"processes.csv", "fig_02a.png", "fig_02a_twin.png"} <= names
    assert "processes_twin.csv" not in names  # the same table
    page = (tmp_path / "report.html").read_text()
    assert page.count("the scene as run") == 1  # the same scene


def test_a_file_that_is_none_is_refused(tmp_path, capsys):
    (tmp_path / "text.h5").write_text("no")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["program"] = "another"
    with h5py.File(tmp_path / "later.h5", "w") as file:
        file.attrs.update(program="entroslip", version="9.0.0", format_version=4)
    with h5py.File(tmp_path / "damaged.h5", "w") as file:
        file.attrs.update(program="entroslip", format_version=3)
        file["structure"] = 3.0
    (tmp_path / "unfinished.h5.shards").mkdir()
    for name, rule in (
        ("absent.h5", "no such file"),
        ("unfinished.h5", "its run is not finished"),
        ("", "is a folder"),
        ("text.h5", "cannot be read as HDF5"),
        ("damaged.h5", "cannot be read as HDF5"),
        ("other.h5", "not a results file of entroslip"),
        ("later.h5", "format_version = 4: .* entroslip 9.0.0"),
    ):
        with pytest.raises(ResultsError, match=f"{tmp_path / name}: {rule}"):
            open_results(tmp_path / name)
        assert main([str(tmp_path / name), "--out", str(tmp_path / "out")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("campaign/c003/psd_mean", "is damaged: "),
        ("campaign/c003/slip_mean", "cannot be read as HDF5: "),  # its values lie in its header
    ],
)
def test_a_damaged_dataset_is_named(results_file, process_file, tmp_path, capsys, name, rule):
    damaged = tmp_path / "damaged.h5"
    contents = bytearray(results_file.read_bytes())
    with h5py.File(results_file) as file:
        place = contents.index(file[name][()].tobytes())
    contents[place + 8] ^= 1
    damaged.write_bytes(contents)
    assert main([str(process_file), str(damaged), "--out", str(tmp_path / "figures")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{damaged}: {rule}/{name}: ")
    assert find_damage(damaged).startswith(f"/{name}: ")


def test_a_folder_that_cannot_be_is_refused(process_file, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert main([str(process_file), "--out", str(tmp_path / "taken")]) == 3
    assert (
        capsys.readouterr().err == f"{tmp_path / 'taken'}: cannot be made a folder: File exists\n"
    )


def test_rounded_numbers_have_no_power_of_ten_where_none_is_needed():
    shown = {1144.0: "1140", 0.00251: "0.00251", 31.249: "31.2", 2e7: "2e+07"}
    assert {value: rounded(value) for value in shown} == shown
    assert rounded(124.9, 2) == "120"


def test_values_carry_their_errors():
    assert value_with_error(1.00023, 0.00041) == "1.00023(41)"
    assert value_with_error(0.3, 0.0) == "0.3"
    assert value_with_error(1.58e-7, 0.0) == "1.58e-7"
    assert value_with_error(123.0, 20.0) == "123(20)"
    assert value_with_error(float("nan"), 1.0) == "-"
    assert value_with_error(1.0, 3.4e-9) == "1.000000"  # an error that is not seen
    assert value_with_error(2.0e-13, 4.0e-15) == "2.000(40)e-13"
    assert value_with_error(1.4e-7, 2.5e-8) == "1.40(25)e-7"
    assert value_with_error(0.0027651, 0.0000997) == "0.00277(10)"  # rounded up to three digits
    assert value_with_error(123.0, 99.7) == "123(100)"


def test_a_value_that_is_not_known_is_an_empty_cell(tmp_path):
    """Time-average errors were `nan`, and others a dash, which make a column of text."""
    data = xr.Dataset({"x_time_error": np.nan, "y": 2.0})
    cells = tuple(stored(data, name) for name in ("x_time_error", "y", "z"))
    assert cells == ("-", "2", "-")
    assert (
        Table("t", "", ("a", "b", "c"), [cells]).write_csv(tmp_path).read_text() == "a,b,c\n,2,\n"
    )


def test_the_other_law_has_its_errors(drawn):
    """It had none: beside the exact law near its limit, noise stood as a length below zero."""
    with (drawn / "laws.csv").open() as file:
        (row,) = csv.DictReader(file)
    for name in ("mean", "std", "L0", "entropy"):
        assert float(row[f"{name}, other law standard error"]) > 0.0


def test_gallery_is_a_page_with_small_pictures(process_file, tmp_path):
    page = tmp_path / "gallery.md"
    assert gallery_page.main([str(process_file), "--out", str(page)]) == 0
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", page.read_text())
    assert len(pictures) == 3
    assert all((tmp_path / picture).stat().st_size < 100_000 for picture in pictures)


def test_committed_gallery_has_all_figures_of_the_paper():
    page = (ROOT / "docs/gallery.md").read_text()
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", page)
    for number in range(1, 12):
        assert any(f"fig_{number:02d}" in picture for picture in pictures)
    assert all((ROOT / "docs" / picture).stat().st_size < 100_000 for picture in pictures)


def test_it_installs_as_a_package(tmp_path):
    """With its style sheet and its command, built without the network."""
    if int(version("setuptools").split(".")[0]) < 71:
        pytest.skip("a setuptools before 71 cannot build a wheel alone")
    source = shutil.copytree(ROOT / "postproc", tmp_path / "source/postproc")
    shutil.copy(ROOT / "pyproject.toml", source.parent)
    done = subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation",
         "--target", tmp_path / "site", source.parent],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    names = {
        path.relative_to(tmp_path / "site").as_posix() for path in (tmp_path / "site").rglob("*")
    }
    ours = ("report.css", "py.typed", "structure/__main__.py")
    assert {"bin/entroslip-figures", *(f"entroslip/{name}" for name in ours)} <= names
    assert not [name for name in names if "postproc" in name]


def test_its_types_agree():
    """The promise of py.typed; pyproject.toml has its strictness."""
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-incremental", "--cache-dir", os.devnull],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_the_study_reads_what_the_program_states(results_of_scene):
    from entroslip.paper.study import Study

    text = "&process correlation_length = 0.3 order = 2 mean = 0.2 std = 0.067 /\n&chain /\n"
    text += "&excitation variance = 3.7 /\n&integration method = 'event' n_steps = 4000 /\n"
    text += "&campaign n_samples = 30 /\n&output segment_length = 1024 /\n"
    case = open_results(results_of_scene(text)).cases[0]
    key = (0.067, 0.3, 3.7)
    study = Study({key: case}, {}, np.array([1.15, 1.9]), np.ones(5))
    data = case.data
    scatter = study.slip_std(key)
    np.testing.assert_array_equal(scatter.value, data["slip_std"])
    np.testing.assert_array_equal(scatter.error, data["slip_std_error"])
    assert (scatter.record > 0).all()
    assert (scatter.record < scatter.value).all()
    ratio = study.ln_ratio(key)
    ends = data["band_ratio_high"] / data["band_ratio_low"]
    np.testing.assert_allclose(np.exp(2 * 1.96 * ratio.error), ends, rtol=1e-4)
    frequency, high = study.high_spectrum(key)
    step = frequency[1] - frequency[0]
    power = step * np.exp(high.value).sum(axis=0)
    np.testing.assert_allclose(power, study.pseudo_variance(key, "high").value, rtol=0.05)
