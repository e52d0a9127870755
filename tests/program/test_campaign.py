"""Interrupted campaigns: finished samples are kept, and the results have the same bits."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import h5py
import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import SCENE as SCENE  # of the fixtures
from tests.program.campaign import STOPPED, Run, shards_of, wait_for_shards
from tests.program.torture import Torture

REFUSED = 3


@pytest.fixture
def interrupted(campaign, output):
    """A campaign that was stopped after some of its shards."""
    run = campaign()
    wait_for_shards(run, output, 3)
    run.stop(signal.SIGTERM, run.ranks())
    return sorted(shards_of(output))


def shard(output: Path, name: str) -> Path:
    return Path(f"{output}.shards") / name


def assert_refused(run: Run, *words: str) -> None:
    code, _, errors = run.wait()
    assert code == REFUSED, errors
    for word in words:
        assert word in errors
    assert "rror termination" not in errors


@pytest.mark.parametrize("n_ranks", [3, 7])
def test_same_bits_on_any_number_of_ranks(campaign, output, reference, n_ranks):
    code, _, errors = campaign(n_ranks).wait()
    assert code == 0, errors
    assert scene_bits(output) == reference


def test_a_replay_has_the_bits_of_the_campaign_also_while_its_shards_remain(
    interrupted, campaign, output, reference, entroslip
):
    """Histories, transitions and a ledger are added; the sample itself is unchanged."""
    kept = shards_of(output)
    assert set(interrupted) == set(kept)
    sample = ("--case", 4, "--sample", 7, "--output", "replay.h5")
    done = entroslip("replay", "scene.nml", *sample)
    assert done.returncode == 0, done.stderr
    assert shards_of(output) == kept
    assert campaign().wait()[0] == 0
    assert scene_bits(output) == reference
    names = ("slip_fraction", "slip_distance", "dissipation", "friction", "slip_starts")
    with h5py.File(output) as file, h5py.File(output.parent / "replay.h5") as replay:
        for name in names:
            ours, theirs = (f[f"campaign/c004/{name}"] for f in (replay, file))
            assert ours[0].tobytes() == theirs[6].tobytes(), name


@pytest.mark.parametrize(
    ("command", "begun"),
    [
        (("replay", "s.nml", "--case=4", "--sample=7"), "*.lock"),
        (("run", "s.nml", "--set", "accuracy%target_slip_points=0.1"), "said"),
    ],
)
def test_a_command_that_is_stopped_without_work_to_keep_says_so(program, tmp_path, command, begun):
    """A replay, and the trial marches of a run, which ended without a word."""
    (tmp_path / "s.nml").write_text(SCENE)
    with (
        (tmp_path / "said").open("w") as said,
        subprocess.Popen(
            [program, *command, "--set", "integration%n_steps=4000000"],
            cwd=tmp_path, env=ENVIRONMENT, stdout=said,
        ) as process,
    ):  # fmt: skip
        while process.poll() is None and not any(
            path.suffix == ".lock" or path.stat().st_size for path in tmp_path.glob(begun)
        ):
            time.sleep(0.01)
        process.terminate()
    assert process.returncode == STOPPED
    assert "stopped early; nothing is kept: start again\n" in (tmp_path / "said").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.nml", "said"]


@pytest.mark.parametrize(
    ("n_ranks", "number"), [(0, signal.SIGTERM), (3, signal.SIGINT), (3, signal.SIGUSR1)]
)
def test_a_signal_to_a_rank_stops_and_the_same_command_continues(
    campaign, output, reference, n_ranks, number
):
    run = campaign(n_ranks)
    wait_for_shards(run, output, 2)
    said = run.stop(number, run.ranks()[-1:])
    assert "start again" in said
    assert not output.exists()
    kept = shards_of(output)
    assert len(kept) >= 2
    again = campaign(n_ranks)
    while again.process.poll() is None and not output.exists():
        now = shards_of(output)
        assert not now or output.exists() or kept.items() <= now.items()
        time.sleep(0.01)
    code, said, errors = again.wait()
    assert code == 0, errors
    assert "continuing" in said
    assert scene_bits(output) == reference


def test_sigusr1_to_mpirun_stops_every_rank(campaign, output, reference):
    run = campaign(2)
    wait_for_shards(run, output, 2)
    run.stop(signal.SIGUSR1, [run.process.pid])
    assert campaign(2).wait()[0] == 0
    assert scene_bits(output) == reference


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_mpirun_itself_may_be_ended(campaign, output, reference, number):
    """Open MPI then gives the ranks one second, and an exit code of its own.

    A rank that is through within that second leaves the whole results, never a part of them.
    """
    run = campaign(2)
    wait_for_shards(run, output, 2)
    run.signal(number, [run.process.pid])
    assert run.wait()[0] != 0
    assert not output.exists() or scene_bits(output) == reference
    assert campaign(2).wait()[0] == 0
    assert scene_bits(output) == reference


def test_the_wall_time_limit_stops_like_a_signal(campaign, output, reference):
    limited = campaign(2, "--set", "campaign%walltime=0.01")
    code, said, errors = limited.wait()
    assert code == STOPPED, errors
    assert "start again" in said
    assert campaign(2).wait()[0] == 0
    assert scene_bits(output) == reference


def test_an_unfinished_campaign_can_be_looked_at(campaign, output, reference, interrupted):
    """Results of fewer samples can be written; the shards of the others stay."""
    kept = {name for name in interrupted if name > "c003"}
    assert kept
    code, said, errors = campaign(0, "--set", "campaign%n_samples=20").wait()
    assert code == 0, errors
    with h5py.File(output) as file:
        assert file["campaign/c003/slip_fraction"].shape[0] == 20
    assert kept <= set(shards_of(output))
    assert "samples beyond these stay in r.h5.shards" in said
    code, _, errors = campaign(2).wait()
    assert code == 0, errors
    assert scene_bits(output) == reference
    assert not Path(f"{output}.shards").exists()


def test_many_more_ranks_than_samples(campaign, output, tmp_path):
    few = ("--set", "campaign%n_samples=2", "--set", "campaign%deterministic=.false.")
    found = []
    for n_ranks in (0, 7):
        code, _, errors = campaign(n_ranks, *few, "--fresh").wait()
        assert code == 0, errors
        found.append(scene_bits(output))
    assert found[0] == found[1]


def test_more_samples_continue_a_finished_campaign(campaign, output, reference, tmp_path):
    assert campaign(0, "--set", "campaign%n_samples=50").wait()[0] == 0
    code, said, errors = campaign(2).wait()
    assert code == 0, errors
    assert "continuing: 102 of 602 samples" in said
    assert scene_bits(output) == reference


def test_two_runs_on_one_output_do_not_meet(campaign, output, reference):
    first = campaign()
    wait_for_shards(first, output, 1)
    assert_refused(campaign(), "r.h5.lock is locked by process", "another run is at work")
    assert first.wait()[0] == 0
    assert scene_bits(output) == reference


def test_runs_that_share_do_each_block_once_and_a_plain_run_merges(campaign, output, reference):
    members = [campaign(0, "--share"), campaign(2, "--share"), campaign(0, "--share")]
    wait_for_shards(members[0], output, 3)
    members[0].signal(signal.SIGKILL, members[0].ranks())
    members[1].signal(signal.SIGUSR1, [members[1].process.pid])
    assert_refused(campaign(), "r.h5.lock is locked by process", "another run is at work")
    members[0].wait()
    code, said, errors = members[1].wait()
    assert code == STOPPED, errors
    code, said, errors = members[2].wait()
    assert code == 0, errors
    assert not output.exists()
    # it is the last one, and nobody else has anything: every sample, or all but what it was refused
    assert "run without --share" in said
    kept = shards_of(output)
    again = campaign(2, "--share")
    code, said, errors = again.wait()
    assert code == 0, errors
    assert "every sample is there" in said
    assert kept.items() <= shards_of(output).items()
    assert_refused(campaign(0, "--share", "--set", "scene%seed=8"), "belongs to another scene")
    assert campaign(2).wait()[0] == 0
    assert scene_bits(output) == reference
    code, said, errors = campaign(0, "--share").wait()
    assert code == 0, errors
    assert "nothing to do" in said


def test_more_samples_are_shared_beside_a_finished_campaign(campaign, output, reference):
    assert campaign(0, "--set", "campaign%n_samples=50").wait()[0] == 0
    before = output.read_bytes()
    code, said, errors = campaign(0, "--share").wait()
    assert code == 0, errors
    assert "every sample is there" in said
    assert output.read_bytes() == before
    assert campaign().wait()[0] == 0
    assert scene_bits(output) == reference


def test_results_of_another_scene_are_not_overwritten(campaign, output):
    assert campaign(0, "--set", "campaign%n_samples=2").wait()[0] == 0
    before = output.read_bytes()
    other = ("--set", "scene%seed=8", "--set", "campaign%n_samples=2")
    difference = "r.h5 belongs to another scene (scene%seed = 7, here 8): choose another --output"
    assert_refused(campaign(0, *other), difference, "--fresh")
    assert output.read_bytes() == before
    assert campaign(0, *other, "--fresh").wait()[0] == 0
    assert output.read_bytes() != before


def test_a_truncated_shard_is_refused_by_name(campaign, output, interrupted, reference):
    victim = shard(output, interrupted[0])
    with victim.open("r+b") as file:
        file.truncate(victim.stat().st_size // 2)
    assert_refused(campaign(2), interrupted[0], "remove it")
    victim.unlink()
    assert campaign(2).wait()[0] == 0
    assert scene_bits(output) == reference


def test_a_flipped_bit_is_found(campaign, output, interrupted):
    victim = shard(output, interrupted[1])
    content = bytearray(victim.read_bytes())
    content[len(content) // 2] ^= 1
    victim.write_bytes(content)
    assert_refused(campaign(), interrupted[1], "remove it")


def test_a_shard_of_another_scene_is_refused_by_name(campaign, output, interrupted):
    wishes = ("scene%seed=8", "process%std=0.03", "chain%normal_load=2.0")
    other = [word for wish in wishes for word in ("--set", wish)]
    run = campaign(0, *other)
    code, _, errors = run.wait()
    assert code == REFUSED, errors
    assert interrupted[0] in errors
    assert "(scene%seed = 7, here 8; process%std = 0.02, here 0.03; chain%normal_load" in errors
    assert "remove it" not in errors
    assert sorted(shards_of(output)) == interrupted


def test_a_folder_that_goes_away_is_named(campaign, output, tmp_path):
    run = campaign()
    wait_for_shards(run, output, 2)
    folder = Path(f"{output}.shards")
    folder.rename(tmp_path / "moved")
    code, _, errors = run.wait()
    # the shards made since stand in a new folder of the old name; those before are missing
    assert code == REFUSED, errors
    assert "r.h5.shards" in errors
    assert not output.exists()


def test_an_output_that_cannot_be_written_is_named(program, campaign, tmp_path):
    run = Run(program, ["run", "scene.nml", "--output", "/proc/r.h5"], tmp_path, ENVIRONMENT, 2)
    assert_refused(run, "/proc/r.h5")


def test_killed_again_and_again(program, tmp_path):
    """Short form of `python -m tests.program.torture`; prints its seed if it fails."""
    seed = 4
    print(f"seed {seed}")
    Torture(program, tmp_path, seed).go_on(kills=8)
