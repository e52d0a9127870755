"""The direct method: shared searches, the check by inversion, orders, simulation methods."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from entroslip.bits import scene_bits

SHARED = """\
&process method = 'direct' correlation = 'L0' correlation_length = 1 order = 8, 13 all_signs = t
         pairing = 'product' mean = 0 std = 2 positive = f inversion_half_width = 60 /
&process method = 'direct' correlation = 'L1' correlation_length = 2 order = 14 all_signs = t
         mean = 0 std = 1 positive = f /
&process method = 'direct' correlation = 'L1' correlation_length = 3 order = 5 all_signs = t
         mean = 0 std = 1 positive = f /
&process method = 'direct' correlation = 'L0' correlation_length = 0.3 order = 0 bound_l1 = 1.6
         all_signs = t mean = 0 std = 1 positive = f /
"""


def test_a_shared_search_is_the_same_on_any_number_of_ranks(entroslip, tmp_path):
    (tmp_path / "shared.nml").write_text(SHARED)
    results = []
    for ranks in (0, 2, 3):
        done = entroslip("run", "shared.nml", "--output", f"{ranks}.h5", ranks=ranks)
        assert done.returncode == 0, done.stderr
        results.append(scene_bits(tmp_path / f"{ranks}.h5"))
    assert all(result == results[0] for result in results)
    with h5py.File(tmp_path / "0.h5") as file:
        small, large, kinks = (file[f"process/p00{i}"] for i in (1, 2, 3))
        assert small.attrs["n_examined"] == 2**7
        assert large.attrs["n_examined"] == 2**12
        assert kinks.attrs["n_examined"] == 2**11
        assert large["solutions_entropy"].shape == (100,)
        assert np.all(np.diff(large["solutions_entropy"]) <= 0.0)
        assert np.all(large["signs"][()] == 1)  # all plus wins, and its own entropy is in front
        assert large["entropy"][()] == pytest.approx(large["solutions_entropy"][0], abs=1e-13)
        assert "no process has this" in str(file["process/p004"].attrs["reason"])
        chosen = file["process/p005"]  # its order is chosen first, then shared out too
        assert chosen.attrs["n_examined"] == 2 ** (chosen["a"].size - 1)
        assert chosen["a"].size > 11


def test_a_shared_search_that_is_stopped_leaves_nothing(entroslip, tmp_path):
    scene = SHARED.replace("order = 14", "order = 26")  # hours
    (tmp_path / "long.nml").write_text(scene + "&campaign walltime = 0.02 /\n")
    done = entroslip("run", "long.nml", ranks=2)
    assert done.returncode == 75, done.stderr
    assert not (tmp_path / "long.h5").exists()


def test_the_papers_inversion_stands_beside_the_process(entroslip, tmp_path):
    (tmp_path / "check.nml").write_text(
        "&process method = 'direct' correlation_length = 1 order = 4 mean = 0 std = 3\n"
        "         positive = f inversion_half_width = 12 /\n"
        "&process method = 'direct' correlation_length = 1 order = 4 mean = 0 std = 3\n"
        "         positive = f /\n"
    )
    assert entroslip("run", "check.nml").returncode == 0
    with h5py.File(tmp_path / "check.h5") as file:
        checked, plain = file["process/p001"], file["process/p002"]
        assert checked.attrs["inversion_half_width"] == 12
        assert checked.attrs["inversion_seconds"] >= 0.0
        assert checked.attrs["direct_seconds"] >= 0.0
        g = np.convolve(np.r_[1, checked["a"]], np.r_[1, checked["a"]][::-1])[4:]
        g /= checked["b0"][()] ** 2
        distance = np.abs(np.subtract.outer(range(25), range(25)))
        row = np.linalg.inv(np.where(distance < 5, g[np.minimum(distance, 4)], 0.0))[12, 12:17]
        np.testing.assert_allclose(checked["inversion_autocovariance"], row, rtol=1e-12)
        off = np.abs(row - checked["autocovariance"][:5]).max() / checked["autocovariance"][0]
        assert checked["inversion_error"][()] == pytest.approx(off, rel=1e-6)
        assert 1e-8 < off < 1e-2  # such a small matrix is wrong
        assert not [name for name in plain if "inversion" in name]
        assert not [name for name in plain.attrs if "inversion" in name]


@pytest.mark.parametrize("method", ["direct", "autoregressive"])
def test_every_way_to_simulate_has_the_process(entroslip, tmp_path, method):
    """Std and neighbours' covariance within 5 standard errors of 4000 independent pairs."""
    n = 4000
    drawn = []
    for way in ("stationary", "from_rest", "matrix"):
        (tmp_path / f"{way}.nml").write_text(
            f"&process method = '{method}' correlation_length = 1 order = 3 mean = 5 std = 2\n"
            f"         positive = f simulation = '{way}' n_points = 2 n_realizations = {n} /\n"
        )
        assert entroslip("run", f"{way}.nml").returncode == 0
        with h5py.File(tmp_path / f"{way}.h5") as file:
            process = file["process/p001"]
            k0, k1 = process["autocovariance"][:2]
            x = process["realizations"][()]
            assert str(process.attrs["simulation"]) == way
        assert x.shape == (n, 2)
        drawn.append(x)
        covariance = np.cov(x.T)
        assert abs(x.mean() - 5.0) < 5.0 * np.sqrt(k0 / n)
        assert abs(covariance[0, 0] - k0) < 5.0 * k0 * np.sqrt(2.0 / n)
        assert abs(covariance[1, 1] - k0) < 5.0 * k0 * np.sqrt(2.0 / n)
        assert abs(covariance[0, 1] - k1) < 5.0 * np.sqrt((k0**2 + k1**2) / n)
    assert not np.array_equal(drawn[0], drawn[1])
    assert not np.array_equal(drawn[0], drawn[2])


def test_a_range_of_the_other_length_chooses_the_order(entroslip, tmp_path):
    one = "correlation_length = 0.3 order = 0 bound_l1 = 1 mean = 0 std = 1 positive = f"
    (tmp_path / "orders.nml").write_text(
        f"&process {one} /\n"
        f"&process {one} bound_side = 'lower' /\n"
        f"&process {one} method = 'direct' /\n"
        f"&process {one} method = 'direct' bound_side = 'lower' /\n"
    )
    assert entroslip("run", "orders.nml").returncode == 0
    with h5py.File(tmp_path / "orders.h5") as file:
        orders = [len(file[f"process/p00{i}/a"]) for i in (1, 2, 3, 4)]
        assert orders[:2] == [5, 6]
        assert orders[3] == orders[2] + 1
        assert str(file["process/p002"].attrs["bound_side"]) == "lower"
        assert file["process/p003/L1_cut"][()] <= 1.0 < file["process/p004/L1_cut"][()]
