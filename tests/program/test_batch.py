"""The job scripts of input/batch under a real Slurm on one machine."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT, ROOT
from tests.program import slurm as slurm_on_this_machine
from tests.program.campaign import SCENE, STOPPED, TOKEN, processes_of, shards_of

BATCH = ROOT / "input/batch"
OF_ONE_MACHINE = {"MPIRUN_OPTIONS": "--oversubscribe --bind-to none"}


@pytest.fixture(scope="module")
def slurm():
    lacking = slurm_on_this_machine.missing()
    if lacking:
        pytest.skip(f"Slurm is not installed: no {', '.join(lacking)} (slurm-wlm, munge)")
    folder = Path(tempfile.mkdtemp(prefix="entroslip-slurm-"))  # sockets want short paths
    server = slurm_on_this_machine.Slurm(folder, ENVIRONMENT | OF_ONE_MACHINE)
    try:
        server.start()
        yield server
    finally:
        server.stop()
        shutil.rmtree(folder)


@pytest.fixture
def submit(slurm, program, tmp_path):
    """Runs a command that submits jobs, in its own folder; returns its output."""
    (tmp_path / "scene.nml").write_text(SCENE)

    def run(*words: str) -> str:
        done = subprocess.run(
            words, cwd=tmp_path, capture_output=True, text=True, check=False,
            env=slurm.environment | {"ENTROSLIP": str(program), TOKEN: str(tmp_path)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_a_job_that_runs_out_of_time_goes_on_by_itself(slurm, submit, reference, tmp_path):
    """A minute is granted, and the signal comes as early as Slurm ever sends it.

    The ranks are held once some shards are finished, so that no machine outruns the signal.
    """
    output, log = tmp_path / "r.h5", tmp_path / "job.log"
    said = submit(
        "sbatch", "--parsable", "--ntasks=2", "--time=1", "--signal=B:USR1@59", f"--output={log}",
        str(BATCH / "slurm.sh"), "scene.nml", str(output),
    )  # fmt: skip
    job = said.strip()
    slurm.wait_until(lambda: len(shards_of(output)) >= 3, "shards")
    ranks = [pid for pid in processes_of(str(tmp_path)) if is_rank(pid)]
    for pid in ranks:
        os.kill(pid, signal.SIGSTOP)
    slurm.wait_until(lambda: "signalled" in log.read_text(), "the signal ahead of the wall time")
    kept = shards_of(output)
    for pid in ranks:
        os.kill(pid, signal.SIGCONT)
    slurm.wait_until(lambda: slurm.state(job) == "COMPLETED", "the end of the job")
    text = log.read_text()
    assert len(ranks) == 2
    assert len(kept) >= 3
    assert "stopped early" in text
    assert "back into the queue" in text
    assert "continuing:" in text
    # a loaded machine may need another minute
    assert re.search(r"Restarts=[1-9]", slurm.ask("show", "job", job))
    assert scene_bits(output) == reference


def test_members_of_an_array_share_the_work(slurm, submit, reference, tmp_path):
    output = tmp_path / "r.h5"
    said = submit(
        str(BATCH / "slurm_array.sh"), "3", "scene.nml", str(output), "--ntasks=1", "--time=5",
        f"--output={tmp_path}/%j.log",
    )  # fmt: skip
    merge = said.split()[-1]
    slurm.wait_until(lambda: slurm.state(merge) == "COMPLETED", "the merging job")
    logs = [path.read_text() for path in tmp_path.glob("*.log")]
    assert len(logs) == 4
    assert sum("run without --share" in log for log in logs) == 3
    assert scene_bits(output) == reference


@pytest.fixture
def job(tmp_path):
    """Runs the script under bash with an `mpirun` of one line and a `scontrol` that only tells."""

    def run(mpirun: str, *options: str, **variables: str) -> subprocess.CompletedProcess[str]:
        for name, line in {"mpirun": mpirun, "scontrol": 'echo "scontrol $@"'}.items():
            (tmp_path / name).write_text(f"#!/bin/sh\n{line}\n")
            (tmp_path / name).chmod(0o755)
        return subprocess.run(
            ["bash", BATCH / "slurm.sh", "scene.nml", "r.h5", *options], cwd=tmp_path,
            capture_output=True, text=True, check=False,
            env=os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_NTASKS": "2"}
            | variables,
        )  # fmt: skip

    return run


def test_options_of_run_reach_the_program(job):
    """`slurm.sh SCENE OUTPUT --set ...`, to extend a campaign, left the option out."""
    extended = ["--set", "campaign%n_samples=600"]
    done = job('echo "$@"', *extended)
    assert done.stdout.split()[-4:] == ["--output", "r.h5", *extended]


@pytest.mark.parametrize(
    ("variables", "number"),
    [({}, "7"), ({"SLURM_ARRAY_JOB_ID": "7", "SLURM_ARRAY_TASK_ID": "3"}, "7_3")],
    ids=["alone", "member"],
)
def test_a_member_requeues_itself_alone(job, variables, number):
    """The number of an array is SLURM_JOB_ID of one of its members: it requeued all others too."""
    done = job("mkdir r.h5.shards; : >r.h5.shards/c.h5; exit 75", SLURM_JOB_ID="7", **variables)
    assert done.returncode == STOPPED
    assert f"scontrol requeue {number}\n" in done.stdout


def test_a_job_too_short_for_a_block_of_samples_does_not_come_back(job):
    """It went through the queue for ever."""
    done = job("exit 75", SLURM_JOB_ID="7")
    assert done.returncode == STOPPED
    assert "scontrol" not in done.stdout
    assert "more time" in done.stdout


def is_rank(pid: int) -> bool:
    return Path(f"/proc/{pid}/comm").read_text().strip() == "entroslip"
