"""More than 64 ranks: shards of several blocks, killed and continued; the bits of one rank."""

from __future__ import annotations

import signal
from pathlib import Path

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import Run, shards_of, wait_for_shards

N_RANKS = 65
SCENE = """\
&scene title = 'many ranks' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 positive = .true. /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7 /
&integration method = 'event' n_steps = 600 /
&campaign n_samples = 17000 estimator = 'plain' /
&output quantities = 'slip', 'spectrum' segment_length = 64 samples = .false. /
"""


def test_65_ranks_keep_several_blocks_in_a_shard_and_one_rank_goes_on(program, tmp_path):
    (tmp_path / "scene.nml").write_text(SCENE)
    output = tmp_path / "many.h5"

    def run(path: Path, n_ranks: int) -> Run:
        words = ["run", "scene.nml", "--output", str(path)]
        return Run(program, words, tmp_path, ENVIRONMENT, n_ranks)

    killed = run(output, N_RANKS)
    wait_for_shards(killed, output, 10)
    killed.signal(signal.SIGKILL, killed.ranks())
    killed.wait()
    ends = [name[:-3].split("_s")[1].split("-") for name in shards_of(output)]
    assert max(int(last) - int(first) + 1 for first, last in ends) > 32
    code, said, errors = run(output, 2).wait()
    assert code == 0, errors
    assert "continuing" in said
    alone = tmp_path / "alone.h5"
    assert run(alone, 0).wait()[0] == 0
    assert scene_bits(output) == scene_bits(alone)
