"""Differences of two designs: paired by sample, their errors against other ways to find them."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from entroslip.__main__ import main
from entroslip.compare import (
    change_figures,
    change_table,
    mean_change,
    most_changed,
    pair_cases,
    std_change,
)
from entroslip.decision import table_designs
from entroslip.output import InputError
from entroslip.results import Case, Results, with_own_names
from tests.conftest import SMALL_SCENE


def design(slip, seed=7, variance=3.7, first=1, psd=None, step=0.5):
    """A file of one case with these slip fractions (sample, joint) of samples from first on."""
    data = xr.Dataset(
        {"slip_fraction": (("sample", "joint"), slip)},
        coords={"sample": np.arange(first, first + len(slip))},
        attrs={"process": "p001", "std": 0.1, "correlation_length": 1.0, "variance": variance},
    )
    if psd is not None:
        data["psd"] = ("sample", "frequency", "dof"), psd
        data["frequency"] = step * np.arange(psd.shape[1])
    return Results(Path("d.h5"), {"seed": seed, "title": "d"}, {}, None, [Case("c001", data)])


@pytest.fixture
def pair():
    """Two designs whose samples share nine tenths of their variance."""
    random = np.random.default_rng(3)
    shared = random.normal(size=(400, 3))
    return shared, 0.9 * shared + 0.1 * random.normal(size=shared.shape) + 0.25


def test_the_error_of_a_paired_mean_is_that_of_the_differences(pair):
    change = mean_change(*pair, is_paired=True)
    differences = pair[1] - pair[0]
    assert np.allclose(change.change, differences.mean(axis=0), atol=1e-15)
    assert np.allclose(change.error, differences.std(axis=0, ddof=1) / 20.0, rtol=1e-12)
    assert (change.error_apart > 5.0 * change.error).all()


def test_samples_that_differ_by_rounding_have_no_gain():
    """Nothing slips: the force gives every sample the same motion, but for its last digits."""
    before = design(0.5 + 1e-15 * np.arange(4.0)[:, None])
    after = design(0.7 + 3e-15 * np.arange(4.0)[::-1, None])
    table = change_table(before, after, pair_cases(before, after))
    assert {row[-1] for row in table.rows} == {"-"}
    assert "scatter of the changes with the record is not included" in table.note


def study(*orders):
    """A file with a case of each order, whose slip fractions are a tenth of it."""
    cases = []
    for order in orders:
        (case,) = design(np.full((4, 1), 0.1 * order)).cases
        asked = {"correlation": "L0", "correlation_length": 1.0, "order": order}
        cases.append(replace(case, name=f"c{order:03d}", asked=asked))
    return replace(design(np.zeros((4, 1))), cases=cases)


def test_orders_of_one_length_are_compared_each_with_itself():
    """Every one was compared with the last of the other file, under one name."""
    before, after = study(2, 5), study(1, 2, 5)
    pairs = pair_cases(before, after)
    assert [(pair.before.name, pair.after.name) for pair in pairs] == [("c002",) * 2, ("c005",) * 2]
    assert [pair.label[:6] for pair in pairs] == ["c002: ", "c005: "]
    assert {row[5] for row in change_table(before, after, pairs).rows} == {"0"}
    (alone,) = pair_cases(study(2), study(5))  # two orders are two designs
    assert (alone.before.name, alone.after.name) == ("c002", "c005")
    assert alone.label.startswith("std 0.1")
    with pytest.raises(InputError, match="no case of the same process"):
        pair_cases(study(2), study(3, 5))


def test_amplitudes_under_sines_are_compared():
    """Designs under sines had no change of their response."""
    files = []
    for factor in (1.0, 0.8):
        (case,) = design(np.full((3, 1), 0.3)).cases
        amplitude = factor * np.array([[1.0, 2.0], [1.1, 2.1], [0.9, 1.9]])
        case.data["harmonic_amplitude"] = ("sample", "dof"), amplitude
        case.data.attrs.update(amplitude=5.0, frequency=12.0)
        load = xr.Dataset({"load": (("force", "dof"), [[0.0, 1.0]])})
        files.append(replace(design(np.zeros((3, 1))), cases=[case], structure=load))
    table = change_table(*files, pair_cases(*files))
    rows = [row for row in table.rows if row[1] == "amplitude of the sine's frequency [m]"]
    assert [row[3:5] for row in rows] == [("1", "0.8"), ("2", "1.6")]
    (row,) = table_designs(files[0], files[1:]).rows
    assert row[2].startswith("-20")


def test_without_common_samples_errors_add_in_squares(pair):
    change = mean_change(*pair, is_paired=False)
    alone = [values.std(axis=0, ddof=1) / 20.0 for values in pair]
    assert np.allclose(change.error, np.hypot(*alone), rtol=1e-12)


def test_the_error_of_a_change_of_std_is_that_of_the_jackknife(pair):
    """Influence and jackknife agree to a relative 2/n; n = 400."""
    change = std_change(*pair, is_paired=True)
    n = len(pair[0])
    left_out = np.array(
        [
            np.subtract(*(np.delete(v, i, axis=0).std(axis=0, ddof=1) for v in pair[::-1]))
            for i in range(n)
        ]
    )
    jackknife = np.sqrt((n - 1) / n * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0))
    assert np.allclose(change.error, jackknife, rtol=0.02)


def test_only_cases_of_both_files_are_compared_and_none_is_refused(pair):
    before, after = design(pair[0]), design(pair[1])
    assert [p.is_paired for p in pair_cases(before, after)] == [True]
    assert [p.is_paired for p in pair_cases(before, design(pair[1], seed=8))] == [False]
    with pytest.raises(InputError, match="no case of the same process"):
        pair_cases(before, design(pair[1], variance=41.1))


def test_samples_are_paired_by_their_numbers(pair):
    """A replay of sample 3 is compared with sample 3; files without common samples are refused."""
    before = design(pair[0])
    (found,) = pair_cases(before, design(pair[0][2:3], first=3))
    assert found.n_samples == 1
    assert np.array_equal(*found.samples("slip_fraction"))
    with pytest.raises(InputError, match="no sample is in both"):
        pair_cases(before, design(pair[0][:1], first=401))


def test_each_pseudo_variance_is_by_the_frequencies_of_its_own_file(pair):
    """A white spectrum on half the lines has the same power; other lines are not divided."""
    psd = np.ones((400, 5, 3))
    before = design(pair[0], psd=psd)
    (found,) = pair_cases(before, design(pair[1], psd=psd[:, :3], step=5.0 / 6.0))
    assert np.allclose(*found.powers())
    assert found.spectra() is None
    (found,) = pair_cases(before, design(pair[1], psd=psd[:, :3]))
    assert [values.shape for values in found.spectra()] == [(400, 3, 3)] * 2


def test_the_error_of_an_rms_is_that_of_the_jackknife(pair):
    psd = np.exp(0.3 * np.stack(pair))[:, :, None, :].repeat(2, axis=2)
    before, after = (design(slip, psd=values) for slip, values in zip(pair, psd, strict=True))
    power = psd[:, :, :, 0].sum(axis=2)
    left = (power.sum(axis=1, keepdims=True) - power) / 399  # means without one sample
    ratios = 100.0 * np.sqrt(left[1] / left[0])
    ((_, _, rms, *_),) = table_designs(before, [after]).rows
    change, digits = re.fullmatch(r"(.*)\((.*)\)", rms).groups()
    error = int(digits) * 0.1 ** len(change.partition(".")[2])
    assert float(change) == pytest.approx(ratios.mean() - 100.0, abs=error / 10)
    assert error == pytest.approx(ratios.std() * np.sqrt(399), rel=0.05)


def test_the_cases_that_change_most_are_drawn(pair):
    """Legend and panels of every case of a sweep of sines left no room for a curve."""
    shifts = 0.1 * np.array([3, 1, 9, -8, 2, 7, 5, 6])
    pairs = [pair_cases(design(pair[0]), design(pair[0] + shift))[0] for shift in shifts]
    places = {id(one): place for place, one in enumerate(pairs)}
    assert [places[id(one)] for one in most_changed(pairs)] == [0, 2, 3, 5, 6, 7]
    assert [places[id(one)] for one in most_changed(pairs[:2])] == [0, 1]


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_dof_at_rest_has_no_change_of_its_spectrum(pair):
    """No spring moves it: its spectra were divided by zero, and a file at rest was drawn."""
    psd = np.ones((400, 3, 2))
    psd[..., 1] = 0.0
    drawn = [design(pair[0], psd=factor * psd) for factor in (1.0, 2.0)]
    figure = change_figures(pair_cases(*drawn), "dof")[-1]
    axes = plt.figure().subplots()
    figure.panels[0](axes)
    assert [line.get_label() for line in axes.lines if len(line.get_xdata()) == 3] == ["dof 1"]
    rest = [design(pair[0], psd=0.0 * psd) for _ in range(2)]
    assert [one.name for one in change_figures(pair_cases(*rest), "dof")] == ["comparison_slip"]


def test_structures_with_other_joints_are_refused(pair):
    before, after = design(pair[0]), design(pair[1][:, :2])
    with pytest.raises(InputError, match=r"slip_fraction has the shape \(400, 3\) before"):
        change_table(before, after, pair_cases(before, after))


def test_compare_tells_what_tighter_joints_change(results_of_scene, results_file, tmp_path, capsys):
    """The program end to end: tighter joints slip less; a design does not differ from itself."""
    tighter = results_of_scene(SMALL_SCENE, "run", "--set", "chain%normal_load=30")
    assert main(["compare", str(results_file), str(tighter), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "sample by sample" in said
    assert "same bits" not in said
    rows = list(csv.DictReader((tmp_path / "comparison.csv").open()))
    slip = [row for row in rows if row["statistic"].startswith("mean time in slip")]
    assert all(float(row["after"]) <= float(row["before"]) for row in slip)
    assert sum(float(row["before"]) for row in slip) > sum(float(row["after"]) for row in slip)
    assert (tmp_path / "comparison_slip.png").exists()
    assert "the same friction values and the same force" in said
    assert main(["compare", str(results_file), str(results_file), "--out", str(tmp_path)]) == 0
    rows = list(csv.DictReader((tmp_path / "comparison.csv").open()))
    assert {row["change"] for row in rows} <= {"0", "-"}
    assert "same bits" in capsys.readouterr().out


def test_compare_without_a_folder_only_prints(results_of_scene, results_file, capsys):
    """Files of processes alone have no cases: what is said of them is whether the bits agree."""
    tighter = results_of_scene(SMALL_SCENE, "run", "--set", "chain%normal_load=30")
    files = sorted(results_file.parent.iterdir())
    assert main(["compare", str(results_file), str(tighter)]) == 0
    said = capsys.readouterr().out
    assert "mean time in slip [%]" in said
    assert "Datasets and attributes whose bits differ" in said
    assert sorted(results_file.parent.iterdir()) == files
    processes = results_of_scene(
        "&process correlation_length = 0.3 order = 2 mean = 1.0 std = 0.3 positive = f /"
    )
    assert main(["compare", str(processes), str(processes)]) == 0
    assert capsys.readouterr().out.startswith("Both files have the same bits")


def test_the_note_says_what_samples_have_in_common(results_of_scene, results_file, capsys):
    """Another mean is another friction, another method the same of both, another band no force."""
    changes = {
        "process%mean=0.25": "Samples have the same force in both files",
        "integration%max_halvings=9": "the same friction values and the same force in both files",
        "excitation%band=0.0, 2.4": "Samples have the same friction values in both files",
    }
    for change, words in changes.items():
        other = results_of_scene(SMALL_SCENE, "run", "--set", change)
        assert main(["compare", str(results_file), str(other)]) == 0
        assert words in capsys.readouterr().out


def test_compare_wants_two_files(results_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["compare", str(results_file), "--out", str(out)]) == 2
    assert not out.exists()
    assert "needs two results files or more" in capsys.readouterr().err


def test_several_designs_are_ranked_with_errors(results_of_scene, results_file, tmp_path, capsys):
    """Joints tighter by half slip less than those by a tenth; each design has its table."""
    designs = []
    for load in (11, 15):
        path = results_of_scene(SMALL_SCENE, "run", "--set", f"chain%normal_load={load}")
        designs.append(path.rename(path.with_name(f"load_{load}.h5")))
    words = ["compare", str(results_file), *map(str, designs), "--out", str(tmp_path)]
    assert main(words) == 0
    assert "rms of mass 5 [%]" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "designs.csv").open()))
    assert len(rows) % 2 == 0
    for case in {row["case"] for row in rows}:
        slip = {
            row["design"]: float(row["time in slip [points]"])
            for row in rows if row["case"] == case
        }  # fmt: skip
        assert slip["load_15"] < slip["load_11"] < 0.0
    assert (tmp_path / "change_load_15.csv").exists()


def test_files_of_one_name_are_with_own_names_by_their_folders(tmp_path):
    """Two designs were both called beam, and the table of the second replaced that of the first."""
    paths = ("now/beam.h5", "a/beam.h5", "b/beam.h5", "b/tip.h5", "b/beam.h5")
    files = [replace(design(np.zeros((1, 1))), path=tmp_path / path) for path in paths]
    stems = [file.stem for file in with_own_names(files)]
    assert stems == ["now_beam", "a_beam", "b_beam_3", "tip", "b_beam_5"]


def test_designs_without_the_spectrum_of_the_forced_dof_have_no_rms(results_of_scene, capsys):
    """A dash, not a change of zero."""
    words = ["run", "--set", "output%dofs=2"]
    files = [
        results_of_scene(SMALL_SCENE, *words, "--set", f"chain%normal_load={load}")
        for load in (10, 11, 12)
    ]
    assert main(["compare", *map(str, files)]) == 0
    rows = [row for row in capsys.readouterr().out.splitlines() if row.startswith("std")]
    assert len(rows) == 4
    assert all(" -  " in row for row in rows)
