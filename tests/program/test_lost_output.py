"""Lost output never ends with exit code 0: a full disk, a closed pipe, no standard output.

Here too: core_system, core_terminal.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import h5py
import pytest

from tests.conftest import ENVIRONMENT

LOST = 3
SCENE = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 /
&chain n_dof = 2 /
&excitation variance = 41.1 /
&integration n_steps = 1200 /
&campaign n_samples = 3 /
&output quantities = 'slip' /
"""
FITS = "&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 positive = f /\n"
COMMANDS = {
    "template": ["template"],
    "reference": ["template", "--reference"],
    "help": ["--help"],
    "version": ["--version"],
    "check": ["check", "scene.nml"],
    "run": ["run", "scene.nml", "--output", "r.h5"],
    "replay": ["replay", "scene.nml", "--case", "1", "--sample", "2"],
    "tradeoff": ["tradeoff", "fits.nml"],
}
each_command = pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)


@pytest.fixture
def run(program, tmp_path):
    """Runs a command in a folder with a scene; `options` make its standard output fail."""
    (tmp_path / "scene.nml").write_text(SCENE)
    (tmp_path / "fits.nml").write_text(FITS)

    def start(command, **options):
        return subprocess.run(
            [program, *command], cwd=tmp_path, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True,
            timeout=120, check=False, **options,
        )  # fmt: skip

    return start


def assert_lost(done, reason: str) -> None:
    assert done.returncode == LOST, done.stderr
    assert done.stderr == f"entroslip: standard output: cannot be written: {reason}\n"


@each_command
def test_a_full_disk_is_an_error(run, command):
    with Path("/dev/full").open("w") as full:
        assert_lost(run(command, stdout=full), "No space left on device")


@each_command
def test_a_closed_pipe_is_an_error_without_a_word(run, command):
    reader, writer = os.pipe()
    os.close(reader)
    done = run(command, stdout=writer)
    assert (done.returncode, done.stderr) == (LOST, "")
    os.close(writer)


@each_command
def test_no_standard_output_is_an_error(run, command):
    done = run(command, preexec_fn=lambda: os.close(1))
    assert_lost(done, "Bad file descriptor")


def test_results_are_whole_all_the_same(run, tmp_path):
    """No results file gets the descriptor of the closed standard output."""
    for place in ("/dev/full", None):
        output = tmp_path / f"{place is None}.h5"
        command = ["run", "scene.nml", "--output", output.name]
        if place:
            with Path(place).open("w") as full:
                run(command, stdout=full)
        else:
            run(command, preexec_fn=lambda: [os.close(number) for number in (0, 1, 2)])
        with h5py.File(output) as file:
            assert file["campaign/c001/slip_fraction"].shape == (3, 2)


def test_another_exit_code_stays_what_it_is(run):
    with Path("/dev/full").open("w") as full:
        done = run(["run", "scene.nml", "--set", "accuracy%target_statistical=1e-9"], stdout=full)
    assert done.returncode == 4, done.stderr
    assert "standard output: cannot be written" in done.stderr


def test_quiet_runs_need_no_standard_output(run):
    done = run(["run", "scene.nml", "--quiet"], preexec_fn=lambda: os.close(1))
    assert (done.returncode, done.stderr) == (0, "")


def test_standard_error_may_be_lost_too(run, program, tmp_path):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [program, "template"], cwd=tmp_path, env=ENVIRONMENT, stdout=full, stderr=full
        )
        assert done.returncode == LOST
        done = subprocess.run([program, "run"], cwd=tmp_path, env=ENVIRONMENT, stderr=full)
        assert done.returncode == 2
