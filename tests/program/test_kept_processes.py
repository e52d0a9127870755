"""A solved process is not solved again: after interruptions, kills, more samples, damage."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import h5py
import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import Run, processes_kept, wait_for_shards

REFUSED, NO_SOLUTION = 3, 4
N_PROCESSES = 6
SCENE = """\
&scene title = 'fits' seed = 7 /
&process correlation_length = 0.3, 1.0, 1.5 order = 1, 2, 3 mean = 0.2 std = 0.02, 0.05
         positive = .true. /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7 /
&integration method = 'event' n_steps = 60000 /
&campaign n_samples = 70 /
&output segment_length = 256 /
"""


@pytest.fixture
def interrupted(campaign, output):
    """A campaign that was stopped after some of its processes."""
    run = campaign()
    wait_for_shards(run, output, 1, processes_kept)
    run.stop(signal.SIGTERM, run.ranks())
    return processes_kept(output)


@pytest.mark.parametrize(
    ("n_ranks", "number"),
    [(0, signal.SIGTERM), (1, signal.SIGKILL), (2, signal.SIGINT), (3, signal.SIGKILL),
     (4, signal.SIGUSR1)],
)  # fmt: skip
def test_no_fit_is_lost_or_repeated(campaign, output, reference, n_ranks, number):
    run = campaign(n_ranks)
    wait_for_shards(run, output, 1, processes_kept)
    run.signal(number, run.ranks()[-1:])
    code, _, errors = run.wait()
    assert code != 0, errors
    kept = processes_kept(output)
    assert kept
    again = campaign(n_ranks)
    while again.process.poll() is None:
        now = processes_kept(output)
        assert kept.items() <= now.items() or output.exists()
        time.sleep(0.01)
    code, said, errors = again.wait()
    assert code == 0, errors
    assert f"continuing: {len(kept)} of {N_PROCESSES} processes are there" in said
    assert scene_bits(output) == reference


@pytest.mark.parametrize("n_ranks", [0, 3])
def test_all_fits_are_there_once_samples_are(campaign, output, reference, n_ranks):
    run = campaign(n_ranks)
    wait_for_shards(run, output, 1)
    run.signal(signal.SIGKILL, [run.process.pid, *run.ranks()])
    assert run.wait()[0] != 0
    code, said, errors = campaign(n_ranks).wait()
    assert code == 0, errors
    assert f"continuing: {N_PROCESSES} of {N_PROCESSES} processes are there" in said
    assert scene_bits(output) == reference


@pytest.mark.parametrize("way", [(), ("--share",)])
def test_more_samples_take_the_processes_from_the_results(campaign, output, reference, way):
    assert campaign(0, "--set", "campaign%n_samples=20").wait()[0] == 0
    code, said, errors = campaign(2, *way).wait()
    assert code == 0, errors
    assert f"continuing: {N_PROCESSES} of {N_PROCESSES} processes are there" in said
    assert campaign().wait()[0] == 0
    assert scene_bits(output) == reference


def test_members_that_share_take_what_is_solved(campaign, output, reference, interrupted):
    code, said, errors = campaign(0, "--share").wait()
    assert code == 0, errors
    assert f"continuing: {len(interrupted)} of {N_PROCESSES} processes" in said
    assert interrupted.items() <= processes_kept(output).items()
    assert campaign().wait()[0] == 0
    assert scene_bits(output) == reference


@pytest.mark.parametrize("n_ranks", [0, 2])
def test_a_damaged_process_is_refused_by_name(campaign, output, reference, interrupted, n_ranks):
    name = min(interrupted)
    victim = Path(f"{output}.shards") / name
    content = bytearray(victim.read_bytes())
    with h5py.File(victim) as file:
        place = content.index(file["solution/autocovariance"][()].tobytes())
    content[place] ^= 1
    victim.write_bytes(content)
    code, _, errors = campaign(n_ranks).wait()
    assert code == REFUSED, errors
    assert name in errors
    assert "remove it to have what it holds computed again" in errors
    victim.unlink()
    assert campaign(n_ranks).wait()[0] == 0
    assert scene_bits(output) == reference


def test_a_process_of_another_scene_is_refused_by_name(campaign, output, interrupted):
    code, _, errors = campaign(0, "--set", "scene%seed=8").wait()
    assert code == REFUSED, errors
    assert min(interrupted) in errors
    assert "belongs to another scene" in errors
    assert processes_kept(output) == interrupted


def test_a_scene_without_solution_leaves_nothing_to_its_mended_form(campaign, output, tmp_path):
    scene = tmp_path / "scene.nml"
    fits = "correlation_length = 0.3, 1.0, 1.5 order = 1, 2, 3"
    mended = scene.read_text().replace(fits, "correlation_length = 0.3, 1.0 order = 1")
    scene.write_text(mended.replace("std = 0.02, 0.05", "std = 0.02, 0.6 branch = 'nonnegative'"))
    code, _, errors = campaign(2).wait()
    assert code == NO_SOLUTION, errors
    assert not Path(f"{output}.shards").exists()
    scene.write_text(mended)
    code, said, errors = campaign(2, "--set", "campaign%n_samples=2").wait()
    assert code == 0, errors
    assert "continuing" not in said


def test_processes_alone_go_on_too(program, tmp_path):
    (tmp_path / "scene.nml").write_text(SCENE.partition("&chain")[0])

    def start(output: str) -> Run:
        return Run(program, ["run", "scene.nml", "--output", output], tmp_path, ENVIRONMENT)

    run = start("r.h5")
    wait_for_shards(run, tmp_path / "r.h5", 2, processes_kept)
    run.signal(signal.SIGKILL, run.ranks())
    run.wait()
    code, said, errors = start("r.h5").wait()
    assert code == 0, errors
    assert f"of {N_PROCESSES} processes are there" in said
    assert not (tmp_path / "r.h5.shards").exists()
    assert start("whole.h5").wait()[0] == 0
    assert scene_bits(tmp_path / "r.h5") == scene_bits(tmp_path / "whole.h5")
