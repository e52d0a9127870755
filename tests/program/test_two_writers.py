"""Two runs on one output whose lock is lost: one complete file; the other run has code 3."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import Run, shards_of, wait_for_shards

DONE, LOST = 0, 3
SCENE = """\
&scene title = 'two writers' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 positive = .true. /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7, 41.1 /
&integration n_steps = 6000 /
&campaign n_samples = 200 /
&output segment_length = 1024 /
"""
#: what grants every lock, as some network file systems do
GRANTS_ALL = "int lockf(int file, int command, long length) { return 0; }\n"


def lock_of(output: Path) -> Path:
    return Path(f"{output}.lock")


def wait_for(ready, run: Run) -> None:
    limit = time.monotonic() + 60
    while not ready() and run.process.poll() is None:
        assert time.monotonic() < limit
        time.sleep(0.001)


def assert_one_winner(runs: list[Run], output: Path, reference: dict[str, bytes]) -> list[int]:
    ends = [run.wait() for run in runs]
    codes = [code for code, _, _ in ends]
    told = "\n".join(errors for _, _, errors in ends)
    assert DONE in codes, told
    assert set(codes) <= {DONE, LOST}, told
    for code, _, errors in ends:
        assert (code == DONE) == (errors == ""), errors
    assert scene_bits(output) == reference, told
    assert not list(output.parent.glob("*.part-*")), told
    return codes


def test_a_run_whose_lock_another_took_says_so(campaign, output, reference):
    first = campaign()
    wait_for_shards(first, output, 1)
    first.signal(signal.SIGSTOP, first.ranks())
    lock_of(output).unlink()
    second = campaign()
    wait_for(lock_of(output).exists, second)
    wait_for(lambda: lock_of(output).read_text() != "", second)
    first.signal(signal.SIGCONT, first.ranks())
    code, _, errors = first.wait()
    assert code == LOST
    assert f"r.h5.lock was taken by process {second.process.pid} on " in errors
    assert lock_of(output).exists() or output.exists()
    assert_one_winner([second], output, reference)
    assert not Path(f"{output}.shards").exists()


def test_a_lock_that_somebody_removed_is_made_again(campaign, output, reference):
    run = campaign()
    wait_for_shards(run, output, 1)
    lock_of(output).unlink()
    wait_for(lock_of(output).exists, run)
    code, _, errors = campaign().wait()
    assert code == LOST
    assert f"is locked by process {run.process.pid} on " in errors
    assert_one_winner([run], output, reference)
    assert not lock_of(output).exists()


def test_a_run_that_slept_while_another_finished_changes_nothing(campaign, output, reference):
    first = campaign()
    wait_for_shards(first, output, 1)
    first.signal(signal.SIGSTOP, first.ranks())
    lock_of(output).unlink()
    assert campaign().wait()[0] == DONE
    finished = output.stat()
    first.signal(signal.SIGCONT, first.ranks())
    code, _, errors = first.wait()
    assert code == LOST
    assert "r.h5 was written by another run" in errors
    assert (output.stat().st_ino, output.stat().st_mtime_ns) == (
        finished.st_ino, finished.st_mtime_ns
    )  # fmt: skip
    assert scene_bits(output) == reference


@pytest.mark.parametrize("n_ranks", [0, 2])
def test_the_lock_is_removed_at_any_moment(campaign, output, reference, n_ranks):
    """Both runs end, and the file is complete, whichever is faster."""
    seed = 3
    print(f"seed {seed}")
    chance = random.Random(seed)
    for _ in range(4 if n_ranks == 0 else 2):
        first = campaign(n_ranks)
        wait_for(lock_of(output).exists, first)
        time.sleep(chance.uniform(0.0, 0.5))
        lock_of(output).unlink(missing_ok=True)
        second = campaign(n_ranks)
        assert_one_winner([first, second], output, reference)
        output.unlink()
        shutil.rmtree(f"{output}.shards", ignore_errors=True)


def test_a_file_system_that_grants_every_lock(program, tmp_path, output, reference):
    """The run that locked last has its name in the lock file and owns the output."""
    if not shutil.which("gcc"):
        pytest.skip("no gcc")
    (tmp_path / "scene.nml").write_text(SCENE)
    (tmp_path / "grants.c").write_text(GRANTS_ALL)
    library = tmp_path / "grants.so"
    subprocess.run(["gcc", "-shared", "-o", library, tmp_path / "grants.c"], check=True)
    environment = ENVIRONMENT | {"LD_PRELOAD": os.fspath(library)}
    chance = random.Random(5)
    codes: list[int] = []
    for _ in range(3):
        arguments = ["run", "scene.nml", "--output", "r.h5"]
        first = Run(program, arguments, tmp_path, environment)
        time.sleep(chance.uniform(0.0, 0.6))
        second = Run(program, arguments, tmp_path, environment)
        codes += assert_one_winner([first, second], output, reference)
        output.unlink()
        shutil.rmtree(f"{output}.shards", ignore_errors=True)
    assert set(codes) == {DONE, LOST}


@pytest.mark.parametrize("target", ["there/t.h5", "other"])
def test_a_symbolic_link_writes_its_target(campaign, output, reference, tmp_path, target):
    """Lock and shards are beside the target, so a link to a busy output is locked too."""
    target = tmp_path / target
    output.symlink_to(target)
    run = campaign()
    wait_for_shards(run, target, 1)
    assert lock_of(target).exists()
    assert not shards_of(output)
    (tmp_path / "second.h5").symlink_to("r.h5")
    again = Run(run.program, ["run", "scene.nml", "--output", "second.h5"], tmp_path, ENVIRONMENT)
    code, _, errors = again.wait()
    assert code == LOST
    assert f"{target.name}.lock is locked by process {run.process.pid}" in errors
    assert run.wait()[0] == DONE
    assert output.is_symlink()
    assert not target.is_symlink()
    assert scene_bits(target) == reference
    code, said, _ = campaign().wait()
    assert code == DONE
    assert "is complete: nothing to do" in said


def test_a_link_that_leads_nowhere_is_refused(campaign, output):
    output.symlink_to(output.name)
    code, _, errors = campaign().wait()
    assert code == LOST
    assert "leads nowhere: Too many levels of symbolic links" in errors
    assert output.is_symlink()
