"""A dense structure, marched in its modes: the same bits on any ranks, blocks, interruptions.

Modal damping, which leaves the modes apart, and given damping, which couples them.
"""

from __future__ import annotations

import shutil
import signal

import h5py
import numpy as np
import pytest

from entroslip.bits import differences
from tests.conftest import ENVIRONMENT, ROOT
from tests.program.campaign import Run, wait_for_shards

CASE = ROOT / "tests/reference/structures/s6_dense8"
SCENE = """\
&process correlation_length = 1.0 order = 1 mean = 0.3 std = 0.06 /
&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' joints = 'joints.txt' load = 'load.txt'
   directions = 'W.mtx' {damping} /
&excitation kind = 'file' file = 'force.txt' factor = 1.0, 3.0 /
&integration method = 'event' dt = 0.02 n_steps = {n_steps} n_discard = 0 /
&campaign n_samples = 70 /
&output quantities = 'slip', 'spectrum', 'energy', 'transitions' segment_length = 256 /
"""
N_STEPS = 3000
DAMPINGS = {
    "modal": "damping_ratio = 0.01",
    "given": "damping_matrix = 'C.mtx'",
}


@pytest.mark.parametrize("kind", DAMPINGS)
def test_ranks_blocks_and_interruptions_change_no_bit(program, tmp_path, kind):
    for path in CASE.iterdir():
        shutil.copy(path, tmp_path)
    # a line of comment first
    force = (CASE / "force.txt").read_text().splitlines(keepends=True)
    (tmp_path / "force.txt").write_text("".join(force[: N_STEPS + 2]))
    dampers = np.diag(np.arange(1.0, 9.0)) + 0.2 * np.ones((8, 8))
    text = "".join(f"{value}\n" for value in dampers.ravel())
    (tmp_path / "C.mtx").write_text(f"%%MatrixMarket matrix array real general\n8 8\n{text}")
    (tmp_path / "scene.nml").write_text(SCENE.format(damping=DAMPINGS[kind], n_steps=N_STEPS))

    def run(output, n_ranks, *more):
        words = ["run", "scene.nml", "--output", output, *more]
        return Run(program, words, tmp_path, ENVIRONMENT, n_ranks)

    for output, n_ranks in (("one.h5", 0), ("three.h5", 3)):
        code, _, errors = run(output, n_ranks).wait()
        assert code == 0, errors
    stopped = run("stopped.h5", 2)
    wait_for_shards(stopped, tmp_path / "stopped.h5", 1)
    stopped.stop(signal.SIGTERM, stopped.ranks())
    assert run("stopped.h5", 0).wait()[0] == 0
    for name in ("three.h5", "stopped.h5"):
        assert differences(tmp_path / "one.h5", tmp_path / name) == []

    assert run("fewer.h5", 2, "--set", "campaign%n_samples=37").wait()[0] == 0
    with h5py.File(tmp_path / "one.h5") as file, h5py.File(tmp_path / "fewer.h5") as few:
        for case in ("c001", "c002"):
            ours, theirs = few[f"campaign/{case}"], file[f"campaign/{case}"]
            for name in ("slip_fraction", "psd", "dissipation", "energy_defect"):
                assert ours[name][()].tobytes() == theirs[name][:37].tobytes(), name
            assert abs(theirs["energy_defect"][()]).max() < 1e-5
            assert theirs["slip_starts"][()].sum() > 1000
