"""entroslip run: results, restart, exit codes."""

from __future__ import annotations

import h5py
import numpy as np
import xarray as xr

from entroslip.bits import scene_bits


def test_same_bits_on_one_and_four_ranks(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, "--output", "one.h5").returncode == 0
    done = entroslip("run", small_scene, "--output", "four.h5", ranks=4)
    assert done.returncode == 0, done.stderr
    assert scene_bits(tmp_path / "one.h5") == scene_bits(tmp_path / "four.h5")


def test_a_finished_scene_has_nothing_to_do(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene).returncode == 0
    before = (tmp_path / "small.h5").read_bytes()
    again = entroslip("run", small_scene)
    assert again.returncode == 0
    assert "nothing to do" in again.stdout
    assert (tmp_path / "small.h5").read_bytes() == before
    assert not (tmp_path / "small.h5.shards").exists()
    fewer = entroslip("run", small_scene, "--set", "campaign%n_samples=4")
    assert "nothing to do; it holds 14 samples, the scene asks for 10" in fewer.stdout


def test_a_missing_folder_is_made(entroslip, small_scene, tmp_path):
    """But not for a scene with a mistake."""
    done = entroslip("run", small_scene, "--output", "some/where/s.h5")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "some/where/s.h5").exists()
    refused = entroslip("run", small_scene, "--output", "a/b/s.h5", "--set", "process%std=-1")
    assert refused.returncode == 2
    assert not (tmp_path / "a").exists()


def test_other_percentiles_are_taken_up(entroslip, small_scene, tmp_path):
    """The statistics of the same samples are computed again; no sample is marched."""
    assert entroslip("run", small_scene, "--output", "p.h5").returncode == 0
    done = entroslip("run", small_scene, "--output", "p.h5", "--set", "output%percentiles=10,90")
    assert done.returncode == 0, done.stderr
    assert "14 of 14 samples are there" in done.stdout
    with h5py.File(tmp_path / "p.h5") as file:
        case = file["campaign/c003"]
        assert list(case["percentile"]) == [10, 90]
        slip = np.percentile(case["slip_fraction"], [10, 90], axis=0)
        beside = case.get("plain", case)
        np.testing.assert_allclose(beside["slip_percentiles"], slip, rtol=1e-12)
        assert "percentile" not in file["campaign/c001"]  # without statistics it would be the first


def test_other_realizations_are_written(entroslip, tmp_path):
    """The process, here with all its sequences of signs, is read back and not fitted again."""
    (tmp_path / "r.nml").write_text("""\
&process method = 'direct' correlation = 'L1' correlation_length = 1.0 order = 5 all_signs = .true.
         mean = 0.0 std = 1.0 positive = .false. n_realizations = 2 /
""")
    assert entroslip("run", "r.nml").returncode == 0
    more = ["run", "r.nml", "--set", "process%n_realizations=3", "--set", "process%n_points=4"]
    done = entroslip(*more)
    assert done.returncode == 0, done.stderr
    assert "continuing: 1 of 1 process is there" in done.stdout
    assert entroslip(*more, "--output", "anew.h5").returncode == 0
    assert scene_bits(tmp_path / "r.h5") == scene_bits(tmp_path / "anew.h5")
    with h5py.File(tmp_path / "r.h5") as file:
        assert file["process/p001/realizations"].shape == (3, 4)
    assert "nothing to do" in entroslip(*more).stdout
    # results that have them serve a scene that does not ask for them
    assert "nothing to do" in entroslip("run", "r.nml", "--set", "process%n_realizations=0").stdout


def test_many_percentiles_ascend(entroslip, tmp_path):
    """Percentiles are estimated one by one; they and their intervals must ascend."""
    (tmp_path / "many.nml").write_text("""\
&process correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067 /
&chain n_dof = 3 /
&excitation variance = 3.7 /
&integration method = 'event' n_steps = 2048 /
&campaign n_samples = 30 /
&output segment_length = 512
  percentiles = 1, 2, 3, 5, 10, 20, 25, 30, 70, 75, 80, 90, 95, 97, 98, 99 /
""")
    assert entroslip("run", "many.nml").returncode == 0
    with h5py.File(tmp_path / "many.h5") as file:
        case = file["campaign/c001"]
        for name in ("slip_percentiles", "dissipation_percentiles", "psd_percentiles"):
            for part in ("", "_low", "_high"):
                for of in (case, case["plain"]):
                    assert (np.diff(of[name + part], axis=0) >= 0).all(), (of.name, name, part)
        step = case["frequency"][1]
        np.testing.assert_allclose(
            case["psd_percentiles"][()].sum(axis=1) * step,
            case["pseudo_variance_percentiles"], rtol=1e-12,
        )  # fmt: skip


def test_estimates_of_more_samples_are_told_where_they_are_not_those_asked_for(
    entroslip, small_scene
):
    """A file with more samples than the scene is not changed; the run says so."""
    asked = ("--set", "output%percentiles=10,90")
    fewer = ("--set", "campaign%n_samples=4")
    assert entroslip("run", small_scene, "--output", "p.h5").returncode == 0
    same = entroslip("run", small_scene, "--output", "p.h5", *fewer)
    assert "percentiles" not in same.stdout
    done = entroslip("run", small_scene, "--output", "p.h5", *asked, *fewer)
    assert done.returncode == 0, done.stderr
    assert "its estimator or percentiles are not those of the scene" in done.stdout
    assert "campaign%n_samples = 6 computes them again" in done.stdout
    again = entroslip("run", small_scene, "--output", "p.h5", *asked)
    assert "14 of 14 samples are there" in again.stdout


def test_a_process_without_solution_is_reported(entroslip, tmp_path):
    law = "order = 1 mean = 1 correlation_length = 1 branch = 'nonnegative'"
    (tmp_path / "two.nml").write_text(f"&process {law} std = 0.3, 0.9 /\n")
    done = entroslip("run", "two.nml")
    assert done.returncode == 0, done.stderr
    assert "process 2 has no solution: " in done.stdout


def test_results_open_labelled(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, "--output", "r.h5").returncode == 0
    with xr.open_dataset(tmp_path / "r.h5", group="campaign/c003", engine="h5netcdf") as case:
        assert case["slip_fraction"].dims == ("sample", "joint")
        assert case["psd"].dims == ("sample", "frequency", "dof")
        assert case["psd_percentiles"].dims == ("percentile", "frequency", "dof")
        assert case["psd"].attrs["units"] == "m^2/Hz"
        assert case["psd"].attrs["long_name"]
        assert case.sizes["sample"] == 6
        # the density integrates to what Eq. 46 reports
        step = float(case["frequency"][1] - case["frequency"][0])
        integral = case["psd_mean"].sum("frequency") * step
        np.testing.assert_allclose(integral, case["pseudo_variance_mean"], rtol=1e-12)


def test_one_process_meets_both_variances_with_the_same_friction(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, "--output", "r.h5").returncode == 0
    with h5py.File(tmp_path / "r.h5") as file:
        low, high = (file[f"campaign/{c}/friction"][()] for c in ("c003", "c004"))
        assert low.tobytes() == high.tobytes()
        assert (file["campaign/c001/friction"][()] == 0.2).all()
        assert file["campaign/c001"].attrs["process"] in (b"none", "none")


def test_first_samples_of_a_longer_campaign_are_the_same(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, "--output", "six.h5").returncode == 0
    more = ("--set", "campaign%n_samples=40")
    assert entroslip("run", small_scene, *more, "--output", "forty.h5", ranks=2).returncode == 0
    with h5py.File(tmp_path / "six.h5") as six, h5py.File(tmp_path / "forty.h5") as forty:
        for name in ("friction", "slip_fraction", "psd", "slip_starts"):
            a, b = six[f"campaign/c004/{name}"][()], forty[f"campaign/c004/{name}"][:6]
            assert a.tobytes() == b.tobytes(), name


def test_replay_is_the_sample_of_the_campaign(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, "--output", "r.h5").returncode == 0
    done = entroslip("replay", small_scene, "--case", 4, "--sample", 5)
    assert done.returncode == 0, done.stderr
    with (
        h5py.File(tmp_path / "r.h5") as campaign,
        h5py.File(tmp_path / "small_c004_s0005.h5") as replay,
    ):
        ours, theirs = replay["campaign/c004"], campaign["campaign/c004"]
        assert ours["friction"][0].tobytes() == theirs["friction"][4].tobytes()
        assert ours["slip_starts"][0].tobytes() == theirs["slip_starts"][4].tobytes()
        np.testing.assert_allclose(ours["slip_fraction"][0], theirs["slip_fraction"][4], rtol=1e-9)
        assert ours["displacement"].shape == (1, 4001, 5)
        assert ours["sample"][()] == [5]
        assert set(ours["transition_sample"]) == {5}
        times = ours["transition_time"][()]
        assert len(times) > 0
        assert (np.diff(times) >= 0).all()


def test_set_overrides_and_is_recorded(entroslip, small_scene, tmp_path):
    done = entroslip("run", small_scene, "--set", "integration%n_steps=2048", "--output", "r.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "r.h5") as file:
        assert file.attrs["overrides"] == "integration%n_steps=2048"
