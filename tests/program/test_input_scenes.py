"""Every scene of input/ runs, shortened by options and not by another file."""

from __future__ import annotations

import h5py
import pytest

from tests.conftest import INPUT_SCENES, shortened


@pytest.mark.parametrize("scene", INPUT_SCENES, ids=lambda scene: scene.stem)
def test_a_scene_runs(entroslip, tmp_path, scene):
    done = entroslip("run", scene, *shortened(scene), "--output", "r.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "r.h5") as file:
        group = "process" if "\n&process" in scene.read_text() else "campaign"
        assert len(file[group]) > 0
