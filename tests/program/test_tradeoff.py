"""entroslip tradeoff: its table, its file, the same numbers on any number of ranks.

Here too: io_tradeoff_results and tradeoff_process_settings.
"""

from __future__ import annotations

import re

import h5py
import numpy as np
import xarray as xr

SHORT = (
    "--set", "integration%n_steps=1500", "--set", "output%segment_length=256",
    "--set", "campaign%n_samples=7",
)  # fmt: skip
COSTS = {"cost", "seconds", "milliseconds", "is_on_front"}  # those depend on the machine's hurry


def measured(path):
    """Bytes of every dataset except costs."""
    found = {}
    with h5py.File(path) as file:
        file["tradeoff"].visititems(
            lambda name, item: (
                found.update({name: item[()].tobytes()})
                if isinstance(item, h5py.Dataset) and name.split("/")[-1] not in COSTS
                else None
            )
        )
    return found


def test_a_scene_gets_its_tradeoff(entroslip, small_scene, tmp_path):
    done = entroslip("tradeoff", small_scene, *SHORT)
    assert done.returncode == 0, done.stderr
    for words in (
        "slip [points]", "cheapest", "largest", "time average", "L0 = 0.3",
        "all errors by samples and steps", "other orders", "other lengths of its fit",
    ):  # fmt: skip
        assert words in done.stdout
    assert re.search(r"^[0-9]+ trial marches, .* s on 1 rank$", done.stdout, re.M)
    assert max(map(len, done.stdout.splitlines())) <= 80
    path = tmp_path / "small_tradeoff.h5"
    with xr.open_dataset(path, group="tradeoff", engine="h5netcdf") as data:
        assert data["slip"].dims == ("setting",)
        assert all(data[name].attrs["units"] and data[name].attrs["long_name"] for name in data)
        own = data.isel(setting=int(np.flatnonzero(data["is_own"])[0]))
        assert int(own["max_halvings"]) == 6
        assert int(own["method"]) == 0
        # the exact method at its loosest, 1e-3, is far below the scheme at the same step
        exact = data["slip"][(data["method"] == 1) & (data["dt"] == float(own["dt"]))]
        assert float(exact.max()) < 1e-2 * float(own["slip"])
        front = data["slip"][data["is_on_front"] == 1]
        assert float(front.min()) == float(data["slip"].min())
    with h5py.File(path) as file:
        check_sizes(file["tradeoff/sizes"], file["tradeoff/parts"])
        check_variants(file["tradeoff/variants"])
        errors = file["tradeoff/parts"]
        assert all(errors[name][()] > 0 for name in errors), dict(errors)
        # not half of the interval of seven samples, which is 14 times as long
        assert errors["samples_psd_percentiles"][()] < 5 * errors["samples_psd_mean"][()]
    again = entroslip("tradeoff", small_scene, *SHORT, "--output", "three.h5", ranks=3)
    assert again.returncode == 0, again.stderr
    assert measured(tmp_path / "small_tradeoff.h5") == measured(tmp_path / "three.h5")
    assert len(measured(tmp_path / "three.h5")) > 25


def check_sizes(sizes, errors):
    """All together for the scene's own numbers; 28 samples are enough for a regression, whose
    error is less than half of that of 7."""
    own = int(np.flatnonzero((sizes["n_samples"][()] == 7) & (sizes["n_steps"][()] == 1500))[0])
    of = {name: errors[f"{name}_slip"][()] for name in ("discretisation", "time", "samples")}
    np.testing.assert_allclose(sizes["slip_mean"][own] ** 2, sum(v**2 for v in of.values()))
    more = int(np.flatnonzero((sizes["n_samples"][()] == 28) & (sizes["n_steps"][()] == 1500))[0])
    rest = of["discretisation"] ** 2 + of["time"] ** 2
    assert rest < sizes["slip_mean"][more] ** 2 < rest + of["samples"] ** 2 / 8
    np.testing.assert_allclose(sizes["seconds"][more], 4 * sizes["seconds"][own])


def check_variants(variants):
    """Orders are compared with the highest, fits with the longest, whose difference is zero."""
    of_fit, reference = variants["is_of_fit"][()] == 1, variants["is_reference"][()] == 1
    assert reference.sum() == 2 * len(set(variants["process"]))
    assert (variants["order"][~of_fit & reference] == 10).all()
    assert (variants["fit_steps"][of_fit & reference] == 65536).all()
    for name in ("slip_mean", "slip_std", "band_ratio"):
        assert (variants[name][reference] == 0).all()
        assert (variants[f"{name}_error"][~reference & ~of_fit] > 0).all()
    # 256 simulated values in a batch: far nearer to 65536 of them than order 1 is to order 10
    short = np.abs(variants["slip_mean"][variants["fit_steps"][()] == 256]).max()
    assert short < 0.1 * np.abs(variants["slip_mean"][~of_fit]).max()
    assert (variants["seconds"][()] > 0).all()


def test_results_that_a_scene_lacks_are_not_listed(entroslip, tmp_path):
    """With given friction, a force file and no spectra: no Monte Carlo error, no band ratio."""
    force = 8.0 * np.sin(0.04 * np.arange(4001))
    np.savetxt(tmp_path / "force.txt", force)
    scene = tmp_path / "certain.nml"
    scene.write_text(
        "&chain friction = 0.2 /\n&excitation kind = 'file' file = 'force.txt' /\n"
        "&integration n_steps = 0 /\n&output quantities = 'slip' /\n"
    )
    done = entroslip("tradeoff", scene)
    assert done.returncode == 0, done.stderr
    assert "Monte Carlo" not in done.stdout
    assert "n_steps = 16000, with a record as long" in " ".join(done.stdout.split())
    now = next(line for line in done.stdout.splitlines() if line.startswith("  time average"))
    assert now.split()[3:] == ["-", "-", "-", "-"]
    samples = re.findall(r"^  (\d+) +\d{4,} +[\d.e-]+ +- +- ", done.stdout, re.MULTILINE)
    assert samples == ["1", "1", "1"]


def test_a_campaign_is_not_overwritten(entroslip, small_scene, tmp_path):
    assert entroslip("run", small_scene, *SHORT).returncode == 0
    before = (tmp_path / "small.h5").read_bytes()
    done = entroslip("tradeoff", small_scene, *SHORT, "--output", "small.h5")
    assert done.returncode == 3
    assert "small.h5" in done.stderr
    assert (tmp_path / "small.h5").read_bytes() == before


def test_processes_alone_have_orders(entroslip, tmp_path):
    scene = tmp_path / "alone.nml"
    scene.write_text(
        "&process correlation_length = 1.0 order = 2 mean = 0 std = 1 positive = .false. /\n"
    )
    done = entroslip("tradeoff", scene)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "alone_tradeoff.h5") as file:
        orders = file["tradeoff/orders"]
        assert (np.diff(orders["entropy_lost"][()]) < 0).all()
        own = orders["order"][orders["is_own"][()] == 1]
        assert own.tolist() == [2]
        # closed form: AR(2) with L0 = 1 has L1 = 1.4330127
        assert abs(orders["other_length"][1] - 1.4330127) < 1e-6


def test_errors_of_fits_are_of_simulated_ones(entroslip, tmp_path):
    """Independent and equal values need no simulation; L0 of independent values is zero."""
    scene = tmp_path / "alone.nml"
    scene.write_text("&process correlation_length = 0, 1, 1e12 order = 2 mean = 0.2 std = 0.05 /\n")
    done = entroslip("tradeoff", scene)
    assert done.returncode == 0, done.stderr
    fits = done.stdout.split("standard errors\n")[1].splitlines()[:-1]
    assert [line.split()[0] for line in fits] == ["p002"]


def test_a_tradeoff_that_is_stopped_says_that_nothing_is_kept(entroslip, small_scene, tmp_path):
    done = entroslip("tradeoff", small_scene, *SHORT, "--set", "campaign%walltime=1e-6")
    assert done.returncode == 75, done.stderr
    assert "stopped early; nothing is kept: start again\n" in done.stdout
    assert not list(tmp_path.glob("*.h5"))
