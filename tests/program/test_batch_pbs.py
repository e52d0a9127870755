"""The PBS script of input/batch: its time limit, options, the signals of PBS, and an array job."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from entroslip.bits import scene_bits
from entroslip.results import open_results
from tests.conftest import ENVIRONMENT, ROOT
from tests.program.campaign import SCENE, STOPPED, TOKEN, processes_of, shards_of
from tests.program.pbs import Pbs

SCRIPT = ROOT / "input/batch/pbs.sh"
OPTION = "campaign%deterministic=.true."  # as in the scene


@pytest.fixture(scope="module")
def reference(reference):
    return without_limit(reference)


@pytest.fixture
def pbs(program, tmp_path):
    queue = Pbs(
        tmp_path,
        ENVIRONMENT | {TOKEN: str(tmp_path), "MPIRUN_OPTIONS": "--oversubscribe --bind-to none"},
        n_ranks=2,
    )
    (tmp_path / "work/scene.nml").write_text(SCENE)
    return queue


@pytest.fixture
def output(tmp_path):
    return tmp_path / "work/r.h5"


def without_limit(found: dict[str, bytes]) -> dict[str, bytes]:
    """Results without scene and options, in which the script sets its time limit."""
    return {name: value for name, value in found.items() if name not in ("@scene", "@overrides")}


def order(program, minutes: float) -> list[str]:
    """Arguments of qsub."""
    settings = f"SCENE=scene.nml,OUTPUT=r.h5,MINUTES={minutes}"
    settings += f",ENTROSLIP={program},SCRIPT={SCRIPT},OPTIONS=--set {OPTION}"
    return ["-v", settings, str(SCRIPT)]


def wait_for(is_so, what: str) -> None:
    limit = time.monotonic() + 120
    while not is_so():
        assert time.monotonic() < limit, what
        time.sleep(0.01)


def stand_in(pbs, line: str) -> Path:
    """An `mpirun` of one line for the jobs to come."""
    path = pbs.folder / "bin/mpirun"
    path.write_text(f"#!/bin/sh\n{line}\n")
    path.chmod(0o755)
    return path


def test_a_job_keeps_to_its_limit_and_the_next_one_goes_on(pbs, program, output, reference):
    """Half a second is too short for the campaign, on a busy machine even for its process."""
    job = order(program, minutes=0.008)
    code, log = pbs.start(job).wait()
    assert code == STOPPED, log
    (again,) = pbs.waiting() or [job]
    code, log = pbs.start(again, MINUTES="10").wait()
    assert code == 0, log
    assert not pbs.waiting()
    assert without_limit(scene_bits(output)) == reference
    assert OPTION in open_results(output).scene[1], "an option was lost"


def test_a_job_too_short_for_a_block_of_samples_does_not_come_back(pbs, program):
    """It went through the queue for ever."""
    job = order(program, minutes=4)
    stand_in(pbs, "mkdir r.h5.shards; : >r.h5.shards/c.h5; exit 75")
    assert pbs.start(job).wait()[0] == STOPPED
    (again,) = pbs.waiting()
    assert again[1].startswith("SCENE=scene.nml,OUTPUT=r.h5,MINUTES=4,")
    stand_in(pbs, "exit 75")
    code, log = pbs.start(again).wait()
    assert code == STOPPED
    assert "more time" in log
    assert not pbs.waiting()


def test_a_job_ended_by_force_loses_nothing_and_does_not_come_back(
    pbs, program, output, reference, tmp_path
):
    job = pbs.start(order(program, minutes=10))
    wait_for(lambda: len(shards_of(output)) >= 2, "no shards")
    kept = shards_of(output)
    job.end_by_force(delay=5)
    job.wait()
    wait_for(lambda: not processes_of(str(tmp_path)), "processes of the job live on")
    assert not pbs.waiting()
    assert kept.items() <= shards_of(output).items()
    code, log = pbs.start(order(program, minutes=10)).wait()
    assert code == 0, log
    assert "continuing:" in log
    assert without_limit(scene_bits(output)) == reference


def test_members_of_an_array_share_and_one_more_job_merges(pbs, program, output, reference):
    members = [pbs.start(order(program, minutes=10), PBS_ARRAY_INDEX=str(i)) for i in (1, 2)]
    for member in members:
        code, log = member.wait()
        assert code == 0, log
        assert "run without --share" in log
    assert not output.exists()
    code, log = pbs.start(order(program, minutes=10)).wait()
    assert code == 0, log
    assert without_limit(scene_bits(output)) == reference


def test_a_member_that_runs_out_of_time_stays_a_member(pbs, program, output):
    short = stand_in(pbs, "mkdir r.h5.shards; : >r.h5.shards/c.h5; exit 75")
    assert pbs.start(order(program, minutes=10), PBS_ARRAY_INDEX="1").wait()[0] == STOPPED
    (again,) = pbs.waiting()
    short.unlink()
    shutil.rmtree(f"{output}.shards")
    code, log = pbs.start(again).wait()
    assert code == 0, log
    assert "run without --share" in log
    assert not output.exists()


def test_what_is_missing_is_named(pbs, program):
    words = order(program, minutes=10)
    code, log = pbs.start([words[0], words[1].replace("SCENE=", "NOT="), words[2]]).wait()
    assert code != 0
    assert "which scene?" in log


@pytest.mark.parametrize("script", sorted(SCRIPT.parent.glob("*.sh")), ids=lambda path: path.name)
def test_bash_can_read_the_script(script):
    done = subprocess.run(["bash", "-n", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert os.access(script, os.X_OK)
