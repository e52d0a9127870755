"""`check` prints which processes have a solution, and has the exit code of `run`."""

from __future__ import annotations

import re

import h5py
import numpy as np

PROCESS = "&process method = 'direct' correlation_length = 2.0 order = {} mean = 1.0 std = 0.2"
CHAIN = "&chain / &excitation variance = 1.0 / &integration n_steps = 1000 /"


def test_what_has_no_solution_is_said_before_it_is_computed(entroslip, tmp_path):
    scene = PROCESS + " pairing = 'product' /\n"
    (tmp_path / "some.nml").write_text(scene.format("2, 3"))
    (tmp_path / "none.nml").write_text(scene.format("1, 2"))
    (tmp_path / "needed.nml").write_text(scene.format("2, 3") + CHAIN)
    for name, code in (("some", 0), ("none", 4), ("needed", 4)):
        done = entroslip("check", f"{name}.nml")
        assert done.returncode == code, done.stderr
        first, second = done.stdout.split("solution\n")[1].splitlines()[:2]
        assert first.endswith("infeasible")
        assert second.endswith("infeasible" if name == "none" else "feasible")
        assert "feasible is 3" in done.stdout
        assert ("feasible is 3" in done.stderr) == (code == 4)
        assert entroslip("run", f"{name}.nml").returncode == code


def test_a_long_search_is_left_to_the_run(entroslip, tmp_path):
    scene = "&process correlation_length = 3.0 order = 10 mean = 1 std = 0.9 sampler = 'exact' /\n"
    (tmp_path / "far.nml").write_text(scene)
    done = entroslip("check", "far.nml")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("solution\n")[1].splitlines()[0].endswith("open")
    assert "a run searches further" in done.stdout


NO_TARGET = (
    "--set", "accuracy%target_statistical=0", "--set", "accuracy%sample_until_met=.false.",
)  # fmt: skip
MOTION = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.04 /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 1.0 /
&integration method = 'event' n_steps = 20000 /
&campaign n_samples = 32 /
&accuracy target_statistical = 0.15 sample_until_met = .true. audit = 0.1 /
&output quantities = 'slip' /
"""


def test_long_trial_marches_are_left_to_the_run(entroslip, tmp_path):
    """Springs that take 64 parts a step: the pilot march of long segments would take a minute."""
    stiff = MOTION.replace("n_dof = 2", "n_dof = 8 coupling_stiffness = 4e7")
    (tmp_path / "stiff.nml").write_text(stiff.replace("audit = 0.1", "target_slip_points = 0.1"))
    quantities = ("--set", "output%quantities='slip','spectrum'")
    long = ("--set", "output%segment_length=65536", "--set", "integration%n_steps=300000")
    done = entroslip("check", "stiff.nml", *quantities, *long)
    assert done.returncode == 0, done.stderr
    for value in ("spectrum_every", "targets", "target_statistical"):
        assert f"{value} is left to run" in done.stdout


def test_cost_of_a_statistical_target_is_forecast(entroslip, tmp_path):
    """Predicted number of samples against that of `run`: a factor of two, and one block of 32."""
    (tmp_path / "scene.nml").write_text(MOTION)
    said = entroslip("check", "scene.nml", "--set", "excitation%per_sample=.true.").stdout
    forecast = int(re.search(r"about (\d+)\s+samples and\s+20000\s+steps", said)[1])
    done = entroslip("run", "scene.nml", "--set", "excitation%per_sample=.true.")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "scene.h5") as file:
        taken = int(file["campaign/c001"].attrs["n_samples"])
    assert forecast / 2 - 32 <= taken <= 2 * forecast + 32
    told, unit = re.search(
        r"would\s+meet\s+the\s+target, [\d.e-]+\s+s, ([\d.]+)\s+(kB|MB)", said
    ).groups()
    size = (tmp_path / "scene.h5").stat().st_size / {"kB": 1e3, "MB": 1e6}[unit]
    assert size / 2 <= float(told) * taken / forecast <= 2 * size
    # one record for all: its error is told, and more steps where samples alone are of no use
    one = entroslip("check", "scene.nml", "--set", "accuracy%target_statistical=0.05").stdout
    assert int(re.search(r"samples\s+and\s+(\d+)\s+steps", one)[1]) > 20000
    assert max(map(len, one.splitlines())) <= 80


def test_the_columns_of_processes_are_as_wide_as_their_texts(entroslip, tmp_path):
    both = "correlation = 'both' correlation_length = 0.6 second_length = 1.2 order = 4"
    group = "&process mean = 1.0 std = 0.3 positive = .false. {} /\n"
    (tmp_path / "s.nml").write_text(
        group.format(both) + group.format("correlation_length = 1.0 order = 3")
    )
    heading, *rows = entroslip("check", "s.nml").stdout.split("\n\n")[1].splitlines()[:3]
    assert [row[heading.index("order") :].split()[0] for row in rows] == ["4", "3"]
    assert [row.endswith("any sign   feasible") for row in rows] == [True, True]


def test_the_time_of_a_short_march_is_said(entroslip, tmp_path):
    (tmp_path / "s.nml").write_text(CHAIN.replace("&chain", "&chain friction = 0.2"))
    short = ("--set", "integration%dt=1.4e-4", "--set", "excitation%band=0,100")
    assert "1000 steps of 0.00843 s, 8.43 s\n" in entroslip("check", "s.nml").stdout
    assert "1000 steps of 1.4e-4 s, 0.14 s\n" in entroslip("check", "s.nml", *short).stdout


def test_repetitions_are_announced(entroslip, tmp_path):
    (tmp_path / "scene.nml").write_text(MOTION)
    said = entroslip("check", "scene.nml", *NO_TARGET).stdout
    assert "target_statistical" not in said
    repeated = said.split("\naudit ")[1].split("\nmemory")[0]
    words = " ".join(repeated.split())
    assert words.startswith("4 samples repeated, event, tolerance 1e-9: 80000 sample-steps")
    assert re.search(r"at [\d.]+ ns each", repeated)
    # a numerical target repeats two samples of a case, asked for or not
    target = entroslip(
        "check", "scene.nml", "--set", "accuracy%audit=0", *NO_TARGET,
        "--set", "accuracy%target_slip_points=1",
    ).stdout  # fmt: skip
    assert "\naudit        2 samples repeated" in target
    assert "audit" not in target.split("does not run")[1].split("\n")[0]


def test_whether_anything_slips_is_said(entroslip, tmp_path):
    (tmp_path / "scene.nml").write_text(MOTION)
    said = entroslip("check", "scene.nml", *NO_TARGET).stdout
    assert re.search(r"\ntransitions +0\.\d+ in a step", said)
    weak = entroslip("check", "scene.nml", *NO_TARGET, "--set", "excitation%variance=1e-6").stdout
    assert "transitions  none in a step" in weak
    assert "linear" in weak


def test_processes_that_differ_in_scale_share_a_fit_and_its_bits(entroslip, tmp_path):
    scene = "&process correlation_length = 0.3 order = 2 mean = {} std = {} n_realizations = 2 /\n"
    points = "&output quantities = 'realizations' /\n"
    (tmp_path / "both.nml").write_text(scene.format(1.0, 0.5) + scene.format(0.3, 0.1) + points)
    (tmp_path / "three.nml").write_text(
        scene.format(1.0, 0.5) + scene.format(2.0, 1.0) + scene.format(0.3, 0.1) + points
    )
    (tmp_path / "alone.nml").write_text(scene.format(2.0, 1.0) + points)
    assert "3 processes by 2 fits" in entroslip("check", "three.nml").stdout
    assert " by 2 fits" not in entroslip("check", "both.nml").stdout
    for name in ("three", "alone"):
        assert entroslip("run", f"{name}.nml").returncode == 0
    with h5py.File(tmp_path / "three.h5") as three, h5py.File(tmp_path / "alone.h5") as alone:
        first, second, only = (
            three["process/p001"],
            three["process/p002"],
            alone["process/p001"],
        )
        for name in ("a", "b0", "mu", "autocovariance", "entropy", "realizations"):
            assert np.array_equal(second[name][()], only[name][()]), name
        assert np.array_equal(first["a"][()], second["a"][()])
        assert second["mu"][()] == 2.0 * first["mu"][()]
