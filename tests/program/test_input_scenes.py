"""Every scene of input/ runs, shortened by options and not by another file."""

from __future__ import annotations

import h5py
import pytest

from tests.conftest import ROOT

SHORT = [
    "integration%n_steps=2000",
    "campaign%n_samples=2",
    "process%order=1",
    "process%std=0.1",
]


@pytest.mark.parametrize("scene", sorted(path.stem for path in (ROOT / "input").glob("*.nml")))
def test_a_scene_runs(entroslip, tmp_path, scene):
    text = (ROOT / f"input/{scene}.nml").read_text()
    short = [option for option in SHORT if f"\n&{option.split('%')[0]}" in text]
    options = [word for option in short for word in ("--set", option)]
    done = entroslip("run", ROOT / f"input/{scene}.nml", *options, "--output", "r.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "r.h5") as file:
        assert len(file["process"] if "\n&process" in text else file["campaign"]) > 0
