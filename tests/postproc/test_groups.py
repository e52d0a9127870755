"""Groups of a results file beside those that xarray's own reader gives."""

from __future__ import annotations

import shutil

import h5py
import numpy as np
import pytest
import xarray as xr

from entroslip.groups import open_group

TABLE = "campaign/c003"


@pytest.mark.parametrize("group", ["structure", "process/p001", TABLE])
def test_a_group_is_what_xarray_reads(results_file, group):
    with xr.open_dataset(results_file, group=group, engine="h5netcdf") as theirs:
        xr.testing.assert_identical(open_group(results_file, group), theirs)


def test_parts_are_read_where_they_are_used(results_file):
    data, whole = (open_group(results_file, TABLE)["psd"] for _ in range(2))
    whole = whole.load()
    for part in (
        {"sample": 0}, {"frequency": slice(9, 2, -3), "dof": [2, 0]}, {"sample": -1, "dof": [1]},
    ):  # fmt: skip
        np.testing.assert_array_equal(data.isel(part), whole.isel(part))


def test_a_group_within_another_has_its_axes(results_file, tmp_path):
    path = shutil.copy(results_file, tmp_path / "inner.h5")
    with h5py.File(path, "r+") as file:
        joint = file[f"{TABLE}/joint"]
        inner = file.create_dataset(f"{TABLE}/inner/x", data=np.zeros(joint.shape))
        inner.dims[0].attach_scale(joint)
    data = open_group(path, f"{TABLE}/inner")
    xr.testing.assert_identical(data["joint"], open_group(results_file, TABLE)["joint"])
    assert data["x"].dims == ("joint",)
