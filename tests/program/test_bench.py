"""The measurements in bench/ are built, and the program accepts their scenes."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from bench.requirements import SCENES
from bench.stability import SCHEMES, Bench


def test_all_are_built(program):
    folder = program.parent.parent
    if not (folder / "CMakeCache.txt").exists():
        pytest.skip("the program is not in a build folder")
    done = subprocess.run(
        ["cmake", "--build", folder, "--target", "benchmarks"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
    assert "Warning" not in done.stdout


@pytest.mark.parametrize("asked", SCENES)
def test_what_a_scene_asks_for_can_be_costed(entroslip, tmp_path, asked):
    (tmp_path / "s.nml").write_text(SCENES[asked])
    done = entroslip("check", "s.nml")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_map_of_motion_has_slip_and_frequency(program, tmp_path, scheme):
    bench = Bench(program, tmp_path)
    settings = {"mass": 1.0, "friction": 0.2, "variance": 41.1, "n_steps": 2000, "dt": 0.00843}
    slip, omega = bench.slip(scheme=SCHEMES[scheme], **settings)
    assert slip.shape == (5,)
    # the highest of a stuck chain in closed form: k_c + 2 k (1 - cos(9 pi/11)) of a unit mass
    assert omega**2 == pytest.approx(50 + 50 * (1 - np.cos(9 * np.pi / 11)), rel=1e-10)
