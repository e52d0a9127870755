"""Files have the same bits where they agree in all that the scene decides."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from entroslip.bits import differences


@pytest.fixture
def files(tmp_path):
    """Two files that differ in what tells of the run."""
    paths = tmp_path / "a.h5", tmp_path / "b.h5"
    for n_ranks, path in enumerate(paths, 1):
        with h5py.File(path, "w") as file:
            file.attrs.update(n_ranks=n_ranks, wall_seconds=0.1 * n_ranks, seed=7)
            group = file.create_group("process/p001")
            group.attrs.update(inversion_seconds=0.2 * n_ranks, method="direct")
            group["a"] = np.array([0.5, 0.25])
    return paths


def test_what_tells_of_the_run_may_differ(files):
    assert differences(*files) == []


def test_a_last_bit_an_attribute_and_what_one_file_lacks_are_named(files):
    with h5py.File(files[1], "r+") as file:
        file["process/p001/a"][1] = np.nextafter(0.25, 1.0)
        file.attrs["seed"] = 8
        file["process/p001"].attrs["method"] = "positive"
        file["more"] = 1.0
    assert differences(*files) == ["@seed", "more", "process/p001/a", "process/p001@method"]
