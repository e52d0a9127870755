"""Audits: the repeated samples, the errors found, and resumed audits."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from entroslip.bits import scene_bits
from entroslip.results import open_results
from tests.program.campaign import shards_of

SCENE = """\
&scene title = 'audited' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7, 41.1 /
&integration n_steps = 4000 /
&campaign n_samples = 8 deterministic = .true. /
&accuracy audit = 0.5 /
&output segment_length = 256 /
"""
REFERENCE = (
    "--set", "integration%method='event'", "--set", "integration%tolerance=1e-9",
    "--set", "output%quantities='slip', 'spectrum', 'energy'", "--set", "accuracy%audit=0",
)  # fmt: skip


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "audited.nml"
    path.write_text(SCENE)
    return path


def test_an_audit_tells_the_true_error(entroslip, scene, tmp_path):
    """The repeated samples equal those of a run with the reference method, bit for bit."""
    assert entroslip("run", scene, "--output", "a.h5").returncode == 0
    other = entroslip("run", scene, "--output", "b.h5", *REFERENCE)
    assert other.returncode == 0, other.stderr
    with h5py.File(tmp_path / "a.h5") as file, h5py.File(tmp_path / "b.h5") as reference:
        for case, n in (("c001", 1), ("c004", 4)):
            ours, truth = file["campaign"][case], reference["campaign"][case]
            audit = ours["audit"]
            assert audit.attrs["n_samples"] == n
            for name in ("slip_fraction", "friction", "psd"):
                np.testing.assert_array_equal(audit[name], truth[name][:n])
            defect = np.abs(audit["energy_defect"][()] / audit["energy_input"][()])
            assert defect.max() < 1e-8
            difference = 100 * (ours["slip_fraction"][:n] - truth["slip_fraction"][:n])
            rms = np.sqrt(np.mean(difference**2, axis=0))
            np.testing.assert_allclose(audit["slip_rms_difference"], rms, rtol=1e-9)
            np.testing.assert_allclose(audit.attrs["slip_points"], rms.max(), rtol=1e-9)
        assert "audit" not in reference["campaign/c004"]


def test_audits_go_on_where_they_were(entroslip, scene, tmp_path):
    """The results are the same if the audit is added or enlarged later, on any number of ranks."""
    assert entroslip("run", scene, "--output", "direct.h5", ranks=2).returncode == 0
    few = entroslip("run", scene, "--output", "grown.h5", "--set", "campaign%n_samples=4")
    assert few.returncode == 0, few.stderr
    grown = entroslip("run", scene, "--output", "grown.h5")
    assert "continuing: 16 of 28 samples are there" in grown.stdout
    none = entroslip("run", scene, "--output", "later.h5", "--set", "accuracy%audit=0")
    assert none.returncode == 0, none.stderr
    later = entroslip("run", scene, "--output", "later.h5")
    assert "continuing: 18 of 28 samples are there" in later.stdout
    again = entroslip("run", scene, "--output", "later.h5")
    assert "nothing to do" in again.stdout
    expected = scene_bits(tmp_path / "direct.h5")
    for name in ("grown.h5", "later.h5"):
        found = scene_bits(tmp_path / name)
        differing = {key for key in expected if expected[key] != found.get(key)}
        assert differing <= {"@scene", "@overrides"}
        assert not shards_of(tmp_path / name)


def test_a_larger_audit_loses_no_samples(entroslip, scene, tmp_path):
    """A file of eight samples is not replaced by one with the four of the scene."""
    assert entroslip("run", scene).returncode == 0
    before = (tmp_path / "audited.h5").read_bytes()
    fewer = ("--set", "campaign%n_samples=4", "--set", "accuracy%audit=1")
    done = entroslip("run", scene, "--set", "campaign%n_samples=5", "--set", "accuracy%audit=1")
    assert done.returncode == 3, done.stdout
    assert (
        "holds 8 samples of a case, the scene asks for 5 and for results that it lacks:"
        " campaign%n_samples = 8 keeps them" in done.stderr
    )
    assert (tmp_path / "audited.h5").read_bytes() == before
    assert not shards_of(tmp_path / "audited.h5")
    kept = entroslip("run", scene, *fewer)
    assert kept.returncode == 0, kept.stderr
    assert "nothing to do; it holds 18 samples, the scene asks for 10" in kept.stdout


@pytest.mark.parametrize("audit", ["0.25", "0"])
@pytest.mark.parametrize("more", ["output%percentiles=10,90", "campaign%n_samples=9"])
def test_a_smaller_audit_loses_no_samples(entroslip, scene, tmp_path, audit, more):
    """A file of four audited samples is not replaced by one with fewer."""
    assert entroslip("run", scene).returncode == 0
    before = (tmp_path / "audited.h5").read_bytes()
    done = entroslip("run", scene, "--set", f"accuracy%audit={audit}", "--set", more)
    assert done.returncode == 3, done.stdout
    assert "holds 4 audited samples of a case, the scene asks for" in done.stderr
    assert "a larger accuracy%audit keeps them" in done.stderr
    assert (tmp_path / "audited.h5").read_bytes() == before


def test_dofs_that_are_not_kept_are_judged_by_the_others(entroslip, scene, tmp_path):
    """With spectra of the second mass only, that mass alone has a band ratio."""
    done = entroslip(
        "run", scene, "--output", "k.h5", "--set", "output%dofs=2",
        "--set", "accuracy%target_slip_points=5.0",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "k.h5") as file:
        case = file["campaign/c003"]
        assert list(case["kept_dof"][()]) == [2]
        assert case["psd"].shape[-1] == case["audit/psd"].shape[-1] == 1
        assert case["band_ratio"].dims[0].keys() == ["kept_dof"]
        assert case["slip_fraction"].shape[-1] == 2
    ratios = open_results(tmp_path / "k.h5").cases[2].data["band_ratio"]
    assert ratios.dims == ("dof",)
    assert np.isnan(ratios.values).tolist() == [True, False]


def test_an_audit_of_stuck_joints_reads_as_a_sentence(entroslip, scene):
    done = entroslip(
        "run", scene, "--set", "chain%normal_load=1e9", "--set", "integration%n_steps=800"
    )
    assert done.returncode == 0, done.stderr
    assert "; mean time in slip: numerical error 0 points; no joint slips" in done.stdout
