"""Given friction values, and the reference laws, from the scene to the results."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest

SCENE = """\
&process {process} /
&chain n_dof = 3 /
&excitation variance = 41.1 /
&integration method = 'event' n_steps = 1000 /
&campaign {campaign} /
&output quantities = 'slip' /
"""


def run(entroslip, folder, process, campaign="", name="s"):
    (folder / f"{name}.nml").write_text(SCENE.format(process=process, campaign=campaign))
    return entroslip("run", f"{name}.nml")


def test_given_samples_march_as_the_drawn_ones_that_they_are(entroslip, tmp_path):
    """The friction of one campaign as given values of another: the same slip, bit for bit."""
    drawn = "correlation_length = 1.0 mean = 0.2 std = 0.067"
    assert run(entroslip, tmp_path, drawn, "n_samples = 5", "drawn").returncode == 0
    with h5py.File(tmp_path / "drawn.h5") as file:
        friction = file["campaign/c001/friction"][()]
        slip = file["campaign/c001/slip_fraction"][()]
    np.savetxt(tmp_path / "friction.txt", friction, fmt="%.17g", header="three joints")
    done = run(entroslip, tmp_path, "values = 'friction.txt'")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "s.h5") as file:
        process, case = file["process/p001"], file["campaign/c001"]
        assert np.array_equal(case["friction"][()], friction)
        assert np.array_equal(case["slip_fraction"][()], slip)
        assert process.attrs["law"] == "given values"
        not_asked = {"correlation", "correlation_length", "order", "positive", "sampler"}
        assert not not_asked & (process.attrs.keys() | case.attrs.keys())
        # summed in another order
        assert process["mean_found"][()] == pytest.approx(friction.mean(), rel=1e-14)
        assert "entropy" not in process
        assert case.attrs["plain_reason"] == "the samples are given: they have no law"
    said = entroslip("check", "s.nml")
    assert re.search(r"p001 +values +- +- +0\.\d+ ", said.stdout)  # no length, no order
    replayed = entroslip("replay", "s.nml", "--case", "1", "--sample", "4", "--output", "a b.h5")
    assert replayed.returncode == 0, replayed.stderr
    assert "Draw it: python -m entroslip 'a b.h5' --out" in replayed.stdout
    with h5py.File(tmp_path / "a b.h5") as file:
        assert np.array_equal(file["campaign/c001/friction"][0], friction[3])


def test_given_values_have_no_realizations(entroslip, tmp_path):
    """A process beside them has; those of given values were drawn from a law that was not set."""
    (tmp_path / "friction.txt").write_text("0.1 0.2 0.3\n0.2 0.2 0.1\n")
    drawn = "correlation_length = 0 mean = 0.2 std = 0.05 n_realizations = 4"
    both = f"values = 'friction.txt' /\n&process {drawn}"
    assert run(entroslip, tmp_path, both, "n_samples = 2").returncode == 0
    with h5py.File(tmp_path / "s.h5") as file:
        assert "realizations" not in file["process/p001"]
        assert file["process/p002/realizations"].shape == (4, 3)
    assert "nothing to do" in entroslip("run", "s.nml").stdout


def test_other_values_are_another_scene(entroslip, tmp_path):
    (tmp_path / "friction.txt").write_text("0.1 0.2 0.3\n0.2 0.2 0.1\n")
    assert run(entroslip, tmp_path, "values = 'friction.txt'").returncode == 0
    (tmp_path / "friction.txt").write_text("0.1 0.2 0.3\n0.2 0.2 0.2\n")
    done = run(entroslip, tmp_path, "values = 'friction.txt'")
    assert done.returncode == 3
    assert "belongs to another scene" in done.stderr
    assert "process%values" in done.stderr


def test_tradeoff_marches_the_given_samples_and_no_others(entroslip, tmp_path):
    """The Monte Carlo error is that of the six given samples; other orders are not compared."""
    rows = [[0.1, 0.2, 0.3], [0.2, 0.2, 0.1], [0.3, 0.1, 0.2], [0.15, 0.25, 0.2]]
    np.savetxt(tmp_path / "friction.txt", [*rows, [0.25, 0.3, 0.1], [0.1, 0.15, 0.25]])
    assert run(entroslip, tmp_path, "values = 'friction.txt'").returncode == 0
    done = entroslip("tradeoff", "s.nml")
    assert done.returncode == 0, done.stderr
    assert "other orders" not in done.stdout
    with h5py.File(tmp_path / "s.h5") as ran, h5py.File(tmp_path / "s_tradeoff.h5") as measured:
        stated = 100 * ran["campaign/c001/slip_mean_error"][()].max()
        assert measured["tradeoff/parts/samples_slip"][()] == pytest.approx(stated, rel=1e-4)
        assert "variants" not in measured["tradeoff"]


def test_a_need_of_more_samples_than_are_given_says_how_many_there_are(entroslip, tmp_path):
    rows = np.random.default_rng(1).uniform(0.1, 0.3, (22, 3))
    np.savetxt(tmp_path / "friction.txt", rows)
    assert run(entroslip, tmp_path, "values = 'friction.txt'").returncode == 0
    for command in ("check", "run"):
        done = entroslip(command, "s.nml", "--set", "accuracy%target_statistical=0.2")
        said = " ".join((done.stdout + done.stderr).split())
        need = r"samples and \d+ steps would meet the target[^(]* \(process%values has 22\)"
        assert re.search(need, said)


def test_laws_of_reference_are_named_in_the_results(entroslip, tmp_path):
    """Independent values, one value for all joints, and a process between both."""
    lengths = "correlation_length = 0.0, 1.0, 1e12 mean = 0.2 std = 0.067"
    done = run(entroslip, tmp_path, lengths, "n_samples = 30")
    assert done.returncode == 0, done.stderr
    checked = entroslip("check", "s.nml").stdout
    assert "independent" in checked
    assert "fully correlated" in checked
    with h5py.File(tmp_path / "s.h5") as file:
        laws = [file[f"process/p00{i}"].attrs["law"] for i in (1, 2, 3)]
        assert laws == ["independent", "maximum entropy", "fully correlated"]
        ordered = ["order" in file[f"process/p00{i}"].attrs for i in (1, 2, 3)]
        assert ordered == [False, True, False]
        assert file["process/p003"].attrs["correlation_length"] == 1e12
        one = file["campaign/c003/friction"][()]
        assert np.array_equal(one, np.repeat(one[:, :1], 3, axis=1))
        assert np.ptp(one[:, 0]) > 0.0
        assert np.ptp(file["campaign/c001/friction"][()], axis=1).min() > 0.0
