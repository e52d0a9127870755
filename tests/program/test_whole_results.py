"""A results file counts as complete only if all its data are present and undamaged."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import shards_of

REFUSED = 3
SCENE = """\
&scene title = 'whole' seed = 7 /
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02 n_realizations = 2 /
&chain n_dof = 2 normal_load = 1.0 /
&excitation variance = 3.7 /
&integration n_steps = 3000 /
&campaign n_samples = 40 /
&accuracy audit = 0.1 /
&output quantities = 'slip', 'spectrum', 'energy', 'transitions', 'realizations'
        segment_length = 256 /
"""
MORE = ("--set", "campaign%n_samples=50")


@pytest.fixture(scope="module")
def finished(program, tmp_path_factory):
    """Folder of a finished campaign."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "scene.nml").write_text(SCENE)
    command = [program, "run", "scene.nml", "--output", "r.h5"]
    subprocess.run(command, cwd=folder, env=ENVIRONMENT, check=True, capture_output=True)
    return folder


@pytest.fixture
def output(finished, tmp_path):
    shutil.copy(finished / "r.h5", tmp_path / "r.h5")
    return tmp_path / "r.h5"


def assert_refused(run, *words: str) -> None:
    code, said, errors = run.wait()
    assert code == REFUSED, said + errors
    for word in words:
        assert word in errors
    assert "put a sound copy in its place, or remove it" in errors
    assert errors.count("entroslip: ") == 1


def names_in(path: Path) -> list[str]:
    """Names of all groups and datasets."""
    found: list[str] = []
    with h5py.File(path) as file:
        file.visit(found.append)
    return found


def test_a_finished_file_is_complete(campaign, output):
    before = output.read_bytes()
    code, said, errors = campaign().wait()
    assert code == 0, errors
    assert "is complete: nothing to do" in said
    assert output.read_bytes() == before


def test_whatever_is_missing_is_named(campaign, output):
    """Removes one object of each kind."""
    names = names_in(output)
    assert len(names) > 90
    whole = output.read_bytes()
    for name in names[:: len(names) // 12]:
        with h5py.File(output, "a") as file:
            del file[name]
        assert_refused(campaign(), f"r.h5 is damaged: /{name} is missing")
        output.write_bytes(whole)


def test_all_that_is_missing_is_counted(campaign, output):
    with h5py.File(output, "a") as file:
        for name in ("psd", "band_ratio", "slip_series", "sample", "friction"):
            del file["campaign/c001"][name]
    assert_refused(campaign(2), "/campaign/c001/band_ratio is missing; ", " and 2 more")


def test_a_damaged_value_is_found(campaign, output):
    whole = output.read_bytes()
    for name in ("psd", "psd_percentiles", "slip_fraction", "audit/friction"):
        with h5py.File(output) as file:
            place = whole.rindex(file[f"campaign/c001/{name}"][()].tobytes())
        content = bytearray(whole)
        content[place + 5] ^= 4
        output.write_bytes(content)
        assert_refused(campaign(), f"/campaign/c001/{name}: cannot be read")


def test_a_damaged_header_is_found(campaign, output):
    """HDF5 1.10 refuses to open such a dataset once, and opens it at the second attempt."""
    content = bytearray(output.read_bytes())
    content[content.rindex(b"OCHK") + 20] ^= 4  # a later part of a header
    output.write_bytes(content)
    assert_refused(campaign(), "cannot be read: incorrect metadata checksum")


def test_damaged_attributes_are_not_those_of_another_program(campaign, output):
    content = bytearray(output.read_bytes())
    content[100] ^= 4
    output.write_bytes(content)
    assert_refused(campaign(), "attribute program of /: cannot be read")
    assert_refused(campaign(0, "--fresh"), "attribute program of /: cannot be read")


def test_another_shape_is_found(campaign, output):
    with h5py.File(output, "a") as file:
        values = file["campaign/c001/slip_mean"][:1]
        del file["campaign/c001/slip_mean"]
        file["campaign/c001/slip_mean"] = values
    assert_refused(campaign(), "/campaign/c001/slip_mean does not have the shape (2) any more")


def test_what_somebody_added_is_not_damage(campaign, output):
    with h5py.File(output, "a") as file:
        file["campaign/c001/remark"] = np.arange(3)
    code, said, errors = campaign().wait()
    assert code == 0, errors
    assert "nothing to do" in said


def test_samples_of_a_damaged_file_become_no_shards(campaign, output, tmp_path):
    """More samples of an undamaged copy can be added afterwards."""
    whole = output.read_bytes()
    with h5py.File(output, "a") as file:
        del file["campaign/c001/psd"]
        file["campaign/c001/psd"] = np.zeros((40, 100_000, 2))
    assert_refused(
        campaign(0, *MORE), "r.h5 is damaged", "/campaign/c001/psd does not have the shape (40,"
    )
    assert not shards_of(output)
    output.write_bytes(whole)
    code, _, errors = campaign(0, *MORE).wait()
    assert code == 0, errors
    continued = scene_bits(output)
    output.unlink()
    assert campaign(0, *MORE).wait()[0] == 0
    assert scene_bits(output) == continued


def test_fresh_discards_a_damaged_file(campaign, output):
    expected = scene_bits(output)
    with h5py.File(output, "a") as file:
        del file["campaign"]
    assert_refused(campaign(0, "--share"), "/campaign is missing")
    code, _, errors = campaign(0, "--fresh").wait()
    assert code == 0, errors
    assert scene_bits(output) == expected
