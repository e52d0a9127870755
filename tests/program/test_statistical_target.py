"""Sampling until the standard error of slip fractions meets the target."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest

from entroslip.bits import scene_bits

SCENE = """\
&scene title = 'until' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 0.1, 1.0 per_sample = .true. /
&integration method = 'event' n_steps = 10000 /
&campaign n_samples = 8 deterministic = .true. /
&accuracy target_statistical = 0.6 sample_until_met = .true. audit = 0.1 /
&output quantities = 'slip' /
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "until.nml"
    path.write_text(SCENE)
    return path


def standard_errors(case: h5py.Group) -> float:
    """Largest standard error over dofs [points], from the scatter: each sample has its record."""
    return float(100 * case["slip_mean_error"][()].max())


def test_sampling_goes_on_until_the_target_is_met(entroslip, scene, tmp_path):
    """Meets it with fewer samples than plain sampling; the same on three ranks and resumed."""
    done = entroslip("run", scene, "--output", "a.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "a.h5") as file:
        reached = []
        for name in ("c003", "c004"):
            case = file["campaign"][name]
            reached.append(case.attrs["n_samples"])
            assert reached[-1] % 8 == 0
            assert standard_errors(case) <= 0.6
            assert reached[-1] > 8
            if case.attrs["estimator"] != "plain":
                # about 30 samples: the estimate's error counts the kernel's constants, plain's none
                assert standard_errors(case["plain"]) > 0.95 * standard_errors(case)
            assert case["audit"].attrs["n_samples"] == max(2, np.ceil(reached[-1] / 10))
        assert reached[0] != reached[1]
    assert "nothing to do" in entroslip("run", scene, "--output", "a.h5").stdout

    added = ("--case", 3, "--sample", reached[0], "--output", "one.h5")
    done = entroslip("replay", scene, *added)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "a.h5") as file, h5py.File(tmp_path / "one.h5") as replay:
        last, same = (f["campaign/c003/slip_starts"][-1] for f in (file, replay))
        assert last.tobytes() == same.tobytes()
        assert replay["campaign/c003/force"].shape == (1, 10001), "each sample has a record"

    some = entroslip("run", scene, "--output", "b.h5", "--set", "accuracy%sample_until_met=.false.")
    assert some.returncode == 4
    assert "target_statistical = 0.6: case 3 has" in some.stderr
    assert "samples and 10000 steps would meet the target" in some.stderr
    assert entroslip("run", scene, "--output", "b.h5", ranks=3).returncode == 0
    expected, found = scene_bits(tmp_path / "a.h5"), scene_bits(tmp_path / "b.h5")
    assert not {key for key in expected if expected[key] != found.get(key)}


PAPER = """\
&scene seed = 5 /
&process correlation_length = 1.0 order = 1 mean = 0.2 std = 0.05 /
&chain n_dof = 3 /
&excitation variance = 41.1 per_sample = .true. /
&integration method = 'event' n_steps = 20000 /
&campaign n_samples = 25 /
&accuracy target_statistical = 0.25 sample_until_met = .true. /
&output quantities = 'slip' /
"""


def test_a_regression_meets_the_target_with_fewer_samples(entroslip, tmp_path):
    """The error of the regression counts: plain sampling needs ten times as many samples."""
    (tmp_path / "paper.nml").write_text(PAPER)
    done = entroslip("run", "paper.nml")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "paper.h5") as file:
        case = file["campaign/c001"]
        n = case.attrs["n_samples"]
        assert case.attrs["estimator"] == "regression"
        assert standard_errors(case) <= 0.25
        assert n * (standard_errors(case["plain"]) / 0.25) ** 2 > 10 * n
    plain = ("--set", "campaign%estimator='plain'")
    eight = ("--set", "campaign%n_samples=8")  # too few of their own for a regression
    forecast = [
        int(re.search(r"about (\d+) samples", " ".join(said.split())).group(1))
        for said in (entroslip("check", "paper.nml", *more).stdout for more in ((), plain, eight))
    ]
    assert n / 2 <= forecast[0] <= 4 * n
    assert forecast[1] > 10 * forecast[0]
    assert n / 2 <= forecast[2] <= 4 * n
    few = entroslip("run", "paper.nml", "--output", "few.h5",
                    "--set", "accuracy%sample_until_met=.false.",
                    "--set", "excitation%per_sample=.false.")  # fmt: skip
    assert few.returncode == 4
    assert "samples with excitation%per_sample = .true." in few.stderr
    assert "a regression needs fewer" not in few.stderr
    fewer = entroslip("run", "paper.nml", "--output", "fewer.h5", *eight,
                      "--set", "accuracy%sample_until_met=.false.")  # fmt: skip
    assert "would meet the target (a regression needs fewer, from 25 samples on)" in fewer.stderr


def test_a_target_that_no_samples_meet_is_reported(entroslip, scene, tmp_path):
    """With one record for all samples only more steps lower the time-average error."""
    one = ("--set", "excitation%per_sample=.false.", "--set", "accuracy%target_statistical=0.1")
    done = entroslip("run", scene, "--output", "c.h5", *one)
    assert done.returncode == 4
    assert "c.h5 is written, and not as accurate as wanted" in done.stderr
    assert "steps would meet the target" in done.stderr
    with h5py.File(tmp_path / "c.h5") as file:
        assert file["campaign/c003"].attrs["n_samples"] == 8
    again = entroslip("run", scene, "--output", "c.h5", *one)
    assert again.returncode == 4


def test_a_target_needs_a_march_that_has_a_standard_error(entroslip, scene):
    short = entroslip("check", scene, "--set", "integration%n_steps=511")
    assert short.returncode == 2
    assert "target_statistical = " in short.stderr
    assert "needs a march of 512 steps or more behind integration%n_discard" in short.stderr


def test_a_share_of_runs_cannot_sample_on(entroslip, scene):
    done = entroslip("run", scene, "--share")
    assert done.returncode == 2
    assert "accuracy%sample_until_met" in done.stderr
