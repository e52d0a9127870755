"""Results without the spectra of their samples: `output%samples = .false.`."""

from __future__ import annotations

import h5py
import pytest

from entroslip.bits import differences

SCENE = """\
&process correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067 /
&chain n_dof = 3 /
&excitation variance = 41.1 /
&integration method = 'event' n_steps = 3000 /
&campaign n_samples = 25 deterministic = .true. /
&accuracy audit = 0.1 /
&output samples = {} segment_length = 512 /
"""


@pytest.fixture
def lean(entroslip, tmp_path):
    (tmp_path / "lean.nml").write_text(SCENE.format(".false."))
    done = entroslip("run", "lean.nml", ranks=2)
    assert done.returncode == 0, done.stderr
    return tmp_path / "lean.h5"


def test_statistics_are_those_with_all_spectra(lean, entroslip, tmp_path):
    (tmp_path / "full.nml").write_text(SCENE.format(".true."))
    assert entroslip("run", "full.nml").returncode == 0
    different = differences(lean, tmp_path / "full.h5")
    datasets = {name for name in different if "@" not in name}
    # the spectrum of a single sample is the result: c001 keeps it
    long = ("psd", "slip_series", "audit/psd")
    assert datasets == {f"campaign/c002/{name}" for name in long}


def test_nothing_can_be_added_to_them(lean, entroslip):
    before = lean.read_bytes()
    assert "nothing to do" in entroslip("run", "lean.nml").stdout
    for words in (("campaign%n_samples=30",), ("campaign%estimator='plain'",)):
        done = entroslip("run", "lean.nml", "--set", *words)
        assert done.returncode == 3
        assert "has no spectra of its samples (output%samples = .false.)" in done.stderr
    assert lean.read_bytes() == before
    assert not lean.with_name("lean.h5.shards").exists()
    assert entroslip("run", "lean.nml", "--fresh").returncode == 0


def test_a_sample_of_them_is_replayed_with_its_spectrum(lean, entroslip, tmp_path):
    done = entroslip("replay", "lean.nml", "--case", 2, "--sample", 3, "--output", "odd.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "odd.h5") as odd, h5py.File(lean) as file:
        assert odd["campaign/c002/psd"].shape == (1, 65, 3)
        slip = file["campaign/c002/slip_fraction"][2]
        assert (odd["campaign/c002/slip_fraction"][0] == slip).all()


def test_another_law_is_estimated_without_spectra(lean, entroslip):
    """The deterministic case has its spectrum, but those of the samples were sought, too."""
    done = entroslip("whatif", "lean.h5", "--set", "process%std=0.05")
    assert done.returncode == 0, done.stderr
    assert "dissipation" in done.stdout
    assert "band ratio" not in done.stdout


def test_check_says_so(entroslip, tmp_path):
    (tmp_path / "lean.nml").write_text(SCENE.format(".false."))
    said = " ".join(entroslip("check", "lean.nml").stdout.split())
    assert "those of the samples are not kept: none can be added later" in said
