"""What is finished is never lost, never repeated, and never taken for another scene's."""

from __future__ import annotations

import signal
import subprocess
import time

import h5py
import pytest

from tests.conftest import ENVIRONMENT
from tests.program.test_run import assert_same_bits

LONG_SCENE = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.067 /
&chain /
&excitation variance = 3.7, 41.1 /
&integration method = 'event' n_steps = 30000 /
&campaign n_samples = 96 /
&output segment_length = 2048 /
"""


@pytest.fixture
def long_scene(tmp_path):
    path = tmp_path / "long.nml"
    path.write_text(LONG_SCENE)
    return path


def shards(tmp_path, output):
    return sorted(path.name for path in (tmp_path / f"{output}.shards").glob("c*.h5"))


def interrupt(program, scene, output, ending, ranks=1, to_all=False):
    """Starts a run and ends it by a signal once it has finished a block."""
    launcher = ["mpirun", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    run = subprocess.Popen(
        [*launcher, program, "run", scene, "--output", output],
        cwd=scene.parent, env=ENVIRONMENT, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not shards(scene.parent, output):
        assert run.poll() is None, run.communicate()
        time.sleep(0.01)
    if to_all:
        subprocess.run(["pkill", f"-{int(ending)}", "-f", str(scene)], check=True)  # ranks as well
    else:
        run.send_signal(ending)
    return run.wait(timeout=60), run.communicate()


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
def test_a_signal_stops_with_75_and_the_run_continues(
    program, entroslip, long_scene, tmp_path, ending
):
    code, (shown, _) = interrupt(program, long_scene, "cut.h5", ending)
    assert code == 75
    assert "start again to continue" in shown
    assert not (tmp_path / "cut.h5").exists()
    before = shards(tmp_path, "cut.h5")
    assert before
    again = entroslip("run", long_scene, "--output", "cut.h5", ranks=2)
    assert again.returncode == 0, again.stderr
    assert "continuing: " in again.stdout
    assert entroslip("run", long_scene, "--output", "whole.h5").returncode == 0
    assert_same_bits(tmp_path / "cut.h5", tmp_path / "whole.h5")


def test_kill_of_mpirun_loses_only_what_was_in_flight(program, entroslip, long_scene, tmp_path):
    interrupt(program, long_scene, "cut.h5", signal.SIGKILL, ranks=2, to_all=True)
    assert not (tmp_path / "cut.h5").exists()
    again = entroslip("run", long_scene, "--output", "cut.h5")
    assert again.returncode == 0, again.stderr
    assert "continuing: " in again.stdout
    assert entroslip("run", long_scene, "--output", "whole.h5", ranks=3).returncode == 0
    assert_same_bits(tmp_path / "cut.h5", tmp_path / "whole.h5")
    assert not (tmp_path / "cut.h5.shards").exists()
    assert not (tmp_path / "cut.h5.lock").exists()


def test_the_wall_time_limit_stops_with_75(entroslip, long_scene, tmp_path):
    limited = ("--set", "campaign%walltime=0.001")
    done = entroslip("run", long_scene, *limited, "--output", "cut.h5")
    assert done.returncode == 75
    assert not (tmp_path / "cut.h5").exists()
    assert entroslip("run", long_scene, "--output", "cut.h5").returncode == 0


def test_another_scene_does_not_touch_what_is_there(program, entroslip, long_scene, tmp_path):
    interrupt(program, long_scene, "cut.h5", signal.SIGTERM)
    before = shards(tmp_path, "cut.h5")
    other = ("--set", "scene%seed=5", "--output", "cut.h5")
    refused = entroslip("run", long_scene, *other)
    assert refused.returncode == 3
    assert "belongs to another scene" in refused.stderr
    assert shards(tmp_path, "cut.h5") == before
    assert entroslip("run", long_scene, *other, "--fresh").returncode == 0
    refused = entroslip("run", long_scene, "--output", "cut.h5")
    assert refused.returncode == 3
    with h5py.File(tmp_path / "cut.h5") as file:
        assert file.attrs["seed"] == 5


def test_a_finished_campaign_goes_on_to_more_samples(entroslip, long_scene, tmp_path):
    fewer = ("--set", "campaign%n_samples=40", "--output", "grown.h5")
    assert entroslip("run", long_scene, *fewer).returncode == 0
    grown = entroslip("run", long_scene, "--output", "grown.h5")
    assert grown.returncode == 0, grown.stderr
    assert "continuing: 80 of 192 samples" in grown.stdout
    assert entroslip("run", long_scene, "--output", "whole.h5").returncode == 0
    assert_same_bits(tmp_path / "grown.h5", tmp_path / "whole.h5")


def test_two_runs_at_once_on_one_output(program, entroslip, long_scene, tmp_path):
    first = subprocess.Popen(
        [program, "run", long_scene, "--output", "r.h5", "--quiet"], cwd=tmp_path, env=ENVIRONMENT
    )
    while not shards(tmp_path, "r.h5"):
        time.sleep(0.01)
    second = entroslip("run", long_scene, "--output", "r.h5")
    assert second.returncode == 3
    assert "locked" in second.stderr
    assert first.wait(timeout=120) == 0
