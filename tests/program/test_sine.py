"""Sines, given spectra and factors of a force file, from the scene to the results."""

from __future__ import annotations

import h5py
import numpy as np

from entroslip.bits import scene_bits
from entroslip.results import open_results

SINES = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.05 /
&chain n_dof = 2 damping_ratio = 0.02 /
&excitation kind = 'sine' frequency = 0.8 1.2 amplitude = 0.5 3.0 /
&integration method = 'event' dt = 0.02 n_steps = 6000 /
&campaign n_samples = 3 deterministic = .true. /
"""
LEVELS = """\
&chain n_dof = 2 friction = 0.2 /
&excitation kind = '{kind}' {kind} = '{file}' factor = 1 2 /
&integration method = 'event' dt = 0.02 n_steps = 999 /
&output quantities = 'slip', 'history' /
"""


def test_sines_are_told_to_be_steady_and_go_on_with_the_same_bits(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(SINES)
    done = entroslip("run", "s.nml")
    assert "all samples are steady" in done.stdout, done.stdout + done.stderr
    with h5py.File(tmp_path / "s.h5") as file:
        case = file["campaign/c006"]
        assert (case.attrs["frequency"], case.attrs["amplitude"]) == (1.2, 0.5)
        assert case["harmonic_amplitude"].shape == case["harmonic_phase"].shape == (3, 2)
        assert (case["steady"][()] == 1).all()
        # the sample that does not slip answers in phase with the deterministic one
        assert "psd" not in case
    more = ("--set", "campaign%n_samples=5")
    assert entroslip("run", "s.nml", *more).returncode == 0
    assert entroslip("run", "s.nml", *more, "--output", "at_once.h5").returncode == 0
    assert scene_bits(tmp_path / "s.h5") == scene_bits(tmp_path / "at_once.h5")


def test_the_fewest_steps_of_a_long_period_are_enough(entroslip, tmp_path):
    """Two windows of 313 values, 128 steps apart, fit into the march."""
    (tmp_path / "s.nml").write_text(
        "&chain n_dof = 1 friction = 1e6 damping_ratio = 0.6 /\n"
        "&excitation kind = 'sine' frequency = 1 amplitude = 2 /\n"
        "&integration method = 'event' dt = 2.5e-4 n_steps = 100063 n_discard = 20000 /\n"
    )
    assert "must be at least 100064: " in entroslip("run", "s.nml").stderr
    done = entroslip("run", "s.nml", "--set", "integration%n_steps=100064")
    assert "all samples are steady" in done.stdout, done.stdout + done.stderr


def test_the_force_is_stated(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(SINES)
    one = ("--set", "excitation%frequency=1.2")
    assert "force        sine, 0.8 to 1.2 Hz " in entroslip("check", "s.nml").stdout
    assert "force        sine, 1.2 Hz " in entroslip("check", "s.nml", *one).stdout


def test_the_order_of_sines_is_stated(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(SINES)
    said = entroslip("check", "s.nml").stdout
    assert "c005-c008  p001     3        0.5, 3, each at 0.8, 1.2 Hz\n" in said
    assert entroslip("run", "s.nml").returncode == 0
    results = open_results(tmp_path / "s.h5")
    forces = ["0.5 N at 0.8 Hz", "0.5 N at 1.2 Hz", "3 N at 0.8 Hz", "3 N at 1.2 Hz"]
    assert [case.force for case in results.cases] == 2 * forces
    assert "<c006: process p001, 0.5 N at 1.2 Hz, 3 samples>" in repr(results)


def test_amplitudes_are_estimated_by_regression(entroslip, tmp_path):
    """Errors of mean and std against 600 samples: a third of those of plain sampling."""
    (tmp_path / "s.nml").write_text(SINES)
    one = ("--set", "excitation%frequency=1.2", "--set", "excitation%amplitude=3.0")
    for name, words in (
        ("few", ("campaign%n_samples=40",)),
        ("many", ("campaign%n_samples=600", "campaign%estimator='plain'")),
    ):
        options = [option for word in words for option in ("--set", word)]
        done = entroslip("run", "s.nml", *one, *options, "--output", f"{name}.h5")
        assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "few.h5") as few, h5py.File(tmp_path / "many.h5") as many:
        case, truth = few["campaign/c002"], many["campaign/c002"]
        of_samples = case["harmonic_amplitude"][()]
        np.testing.assert_allclose(case["plain/harmonic_amplitude_mean"], of_samples.mean(axis=0))
        np.testing.assert_allclose(
            truth["harmonic_amplitude_std"], truth["harmonic_amplitude"][()].std(axis=0, ddof=1)
        )
        assert case["harmonic_amplitude_percentiles"].shape == (2, 2)
        assert case["harmonic_amplitude_mean"].attrs["estimator"] == "regression"
        for name in ("mean", "std"):
            ours = case[f"harmonic_amplitude_{name}"]
            stated = np.hypot(
                case[f"harmonic_amplitude_{name}_error"], truth[f"harmonic_amplitude_{name}_error"]
            )
            assert (case[f"error_ratio/harmonic_amplitude_{name}"][()] > 3).all()
            assert (abs(ours[()] - truth[f"harmonic_amplitude_{name}"][()]) < 4 * stated).all()


def test_a_short_march_is_told_to_be_unsteady(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(SINES)
    done = entroslip("run", "s.nml", "--set", "integration%n_steps=1400", "--set",
                     "chain%damping_ratio=1e-4")  # fmt: skip
    assert "not steady in c001" in done.stdout, done.stdout + done.stderr


def test_factors_scale_a_file_and_a_density(entroslip, tmp_path):
    force = np.random.default_rng(1).normal(size=1000)
    np.savetxt(tmp_path / "force.txt", force)
    np.savetxt(tmp_path / "density.txt", [[0.5, 1.0], [2.0, 3.0]])
    for kind, name in (("file", "force.txt"), ("psd", "density.txt")):
        (tmp_path / "s.nml").write_text(LEVELS.format(kind=kind, file=name))
        done = entroslip("run", "s.nml", "--fresh")
        assert done.returncode == 0, done.stderr
        with h5py.File(tmp_path / "s.h5") as file:
            one, two = (file[f"campaign/{name}"] for name in ("c001", "c002"))
            assert (one.attrs["factor"], two.attrs["factor"]) == (1.0, 2.0)
            np.testing.assert_array_equal(2 * one["force"][()], two["force"][()])
            if kind == "file":
                np.testing.assert_array_equal(one["force"][()], force)


def test_a_bad_density_is_named_by_its_lines(entroslip, tmp_path):
    (tmp_path / "density.txt").write_text("0 1\n2 -1\n1 3\n")
    (tmp_path / "s.nml").write_text(LEVELS.format(kind="psd", file="density.txt"))
    done = entroslip("check", "s.nml")
    assert done.returncode == 2
    assert "density.txt:2: density = -1.0: must be zero or positive" in done.stderr
    assert "density.txt:3: frequency = 1.0: must ascend" in done.stderr
    (tmp_path / "density.txt").write_text("1 1\n1.00001 1\n")
    done = entroslip("check", "s.nml")
    assert done.returncode == 2
    assert "density.txt: must not be narrower than about" in done.stderr


def test_there_is_no_tradeoff_of_sines(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(SINES)
    done = entroslip("tradeoff", "s.nml")
    assert done.returncode == 2
    assert "needs noise or a force file" in done.stderr
