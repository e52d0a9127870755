"""The PBS script of input/batch: its time limit, options, the signals of PBS, and an array job."""

from __future__ import annotations

import os
import subprocess
import time

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


def test_a_job_submits_itself_until_the_campaign_is_done(pbs, program, output, reference):
    """Two jobs of half a second are too short for the campaign; the third is long enough."""
    jobs, codes = [order(program, minutes=0.008)], []
    while jobs:
        job = jobs.pop()
        assert "MINUTES=0.008" in job[1]
        enough = {"MINUTES": "10"} if len(codes) == 2 else {}
        code, log = pbs.start(job, **enough).wait()
        codes.append(code)
        jobs = pbs.waiting()
        assert len(jobs) == (1 if code == STOPPED else 0), log
    assert codes[0] == STOPPED, "the limit was not met"
    assert codes[-1] == 0, log
    assert without_limit(scene_bits(output)) == reference
    assert OPTION in open_results(output).scene[1], "an option was lost"


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
    code, log = pbs.start(order(program, minutes=0.008), PBS_ARRAY_INDEX="1").wait()
    assert code == STOPPED, log
    again = pbs.waiting()
    assert len(again) == 1
    code, log = pbs.start(again[0], MINUTES="10").wait()
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
