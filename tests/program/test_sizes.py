"""`check` predicts the size of the results and the memory of a rank (campaign_size)."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from tests.conftest import ENVIRONMENT

SCENE = """\
&process correlation_length = 1.0 order = 1 mean = 0.2 std = {std} /
&chain n_dof = {n_dof} /
&excitation variance = {variance} /
&integration method = {method} n_steps = {n_steps} /
&campaign n_samples = {n_samples} /
&output quantities = {kept} segment_length = {segment} /
"""
USUAL = {
    "n_dof": 5, "n_steps": 4000, "n_samples": 8, "segment": 8192, "kept": "'slip', 'spectrum'",
    "std": "0.02", "variance": "41.1", "method": "'event'",
}  # fmt: skip
LEVELS = ", ".join(map(str, range(1, 33)))
CASES = {
    "smallest": {},
    "long_spectra": {"n_dof": 12, "n_steps": 9000, "n_samples": 64},
    "cut_samples": {"n_dof": 24, "n_steps": 1600, "n_samples": 64, "segment": 750},
    "many_samples": {"n_steps": 600, "n_samples": 3000, "segment": 512},
    "without_spectra": {"n_samples": 64, "kept": "'slip', 'spectrum' samples = .false."},
    "histories": {"n_steps": 40000, "kept": "'slip', 'history'"},
    "joined": {"n_steps": 40000, "kept": "'slip', 'history'", "std": "0.01, 0.02, 0.03, 0.04"},
    "regression": {"n_steps": 9000, "n_samples": 400},  # of the frequencies that have power
    # two million transitions: an axis of them takes no memory
    "many_transitions": {
        "n_steps": 2000,
        "n_samples": 960,
        "method": "'event' dt = 0.1",
        "kept": "'slip', 'transitions'",
    },
    "transitions": {"n_steps": 20000, "n_samples": 32, "kept": "'slip', 'transitions'"},
    "many_masses": {"n_dof": 400, "n_steps": 1000},
    "many_cases": {"n_dof": 90, "n_steps": 3000, "variance": "10, 20, 30, 40, 50, 60, 70, 80, 90"},
    "many_levels": {"n_steps": 40000, "n_samples": 1, "variance": LEVELS},  # the pilot march
    "long_march": {"n_dof": 1, "n_steps": 2000000, "n_samples": 1, "kept": "'slip', 'spectrum'"},
}
PROCESSES = {
    "one": "correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067",
    "fitted": "correlation_length = 0.3, 1.0 order = 10 mean = 0.2 std = 0.067",
    "signs": "method = 'direct' positive = .false. correlation_length = 1.0, 3.0 order = 8 "
    "mean = 0.0 std = 1.0 all_signs = .true.",
    "refused": "correlation_length = 1.0, 3.0, 100.0 order = 1 mean = 0.2 std = 0.067, 0.3",
    "realizations": "correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067 "
    "n_points = 50000 n_realizations = 200",
}
BYTES = {"kB": 1e3, "MB": 1e6, "GB": 1e9}


def told(text: str, label: str) -> float:
    value, unit = re.search(rf"^{label} +\w+(?: to)? ([\d.e]+) (\w+)", text, re.MULTILINE).groups()
    return float(value) * BYTES[unit]


# A small process of its own: the peak of a child holds that of the process that started it.
MEASURE = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@pytest.mark.parametrize("name", CASES)
def test_check_tells_the_size_of_results_and_memory(entroslip, program, tmp_path, name):
    size, said = size_and_memory(SCENE.format(**USUAL | CASES[name]), entroslip, program, tmp_path)
    assert size <= told(said, "results") <= 1.25 * size + 20e3


def test_check_tells_the_memory_of_newmark_s_maps(entroslip, program, tmp_path):
    options = {"n_dof": 500, "n_steps": 600, "kept": "'slip'", "method": "'newmark'"}
    size, said = size_and_memory(SCENE.format(**USUAL | options), entroslip, program, tmp_path)
    assert size <= told(said, "results") <= 1.25 * size


def test_check_tells_the_memory_of_a_dense_structure(entroslip, program, tmp_path):
    n = 500
    for name, diagonal, beside in (("mass", 4, 1), ("stiffness", 200, -100)):
        entries = [f"{i} {i} {diagonal}" for i in range(1, n + 1)]
        entries += [f"{i + 1} {i} {beside}" for i in range(1, n)]
        header = f"%%MatrixMarket matrix coordinate real symmetric\n{n} {n} {len(entries)}\n"
        (tmp_path / f"{name}.mtx").write_text(header + "\n".join(entries) + "\n")
    (tmp_path / "joints.txt").write_text("2 0 100 10 0.2 1\n9 0 100 10 0.2 2\n")
    structure = "&structure mass_matrix = 'mass.mtx' stiffness_matrix = 'stiffness.mtx' "
    scene = SCENE.replace("&chain n_dof = {n_dof}", structure + "joints = 'joints.txt'")
    scene = scene.format(**USUAL | {"n_steps": 600, "kept": "'slip'"})
    size_and_memory(scene, entroslip, program, tmp_path)


@pytest.mark.parametrize("name", PROCESSES)
def test_check_tells_the_same_of_processes_alone(entroslip, program, tmp_path, name):
    size, said = size_and_memory(f"&process {PROCESSES[name]} /", entroslip, program, tmp_path)
    assert size <= told(said, "results") <= 1.25 * size


def size_and_memory(scene: str, entroslip, program, tmp_path) -> tuple[int, str]:
    """Size of the results [bytes] and the output of `check`; checks the memory of the run."""
    (tmp_path / "s.nml").write_text(scene)
    said = entroslip("check", "s.nml").stdout
    run = subprocess.run(
        [sys.executable, "-c", MEASURE, program, "run", "s.nml", "--quiet"],
        cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    size = (tmp_path / "s.h5").stat().st_size
    memory = 1024 * int(run.stdout.split()[-1])
    # what libraries take differs from one system to another
    assert abs(told(said, "memory") - memory) <= 0.15 * memory + 12e6
    return size, said


def test_spectra_are_cut_evenly_on_the_disk(entroslip, tmp_path):
    """Chunks divide 4097 frequencies without leaving a part of the file empty."""
    options = CASES["long_spectra"] | {"n_samples": 2}
    (tmp_path / "s.nml").write_text(SCENE.format(**USUAL | options))
    every = ("--set", "output%spectrum_every=1")
    assert entroslip("run", "s.nml", *every).returncode == 0
    with h5py.File(tmp_path / "s.h5") as file:
        psd = file["campaign/c001/psd"]
        assert psd.shape == (2, 4097, 12)
        chunks = np.ceil(np.divide(psd.shape, psd.chunks))
        assert np.prod(chunks * psd.chunks) <= 1.01 * psd.size


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30, 4 * 2**30))


def test_check_is_quick_and_a_run_without_memory_ends_in_one_line(program, tmp_path):
    scene = SCENE.format(**USUAL | {"n_steps": 2000000000, "segment": 512})
    (tmp_path / "s.nml").write_text(scene)
    began = time.process_time()
    for command, code in (("check", 0), ("run", 2)):
        done = subprocess.run(
            [program, command, "s.nml"], cwd=tmp_path, env=ENVIRONMENT | {"OMP_NUM_THREADS": "1"},
            capture_output=True, text=True, timeout=100, check=False, preexec_fn=limited,
        )  # fmt: skip
        assert done.returncode == code, done.stderr
        said = done.stdout if command == "check" else done.stderr
        # two records of 16 GB, and what their synthesis takes
        wanted = r"n_steps = 2000000000: the force and what is kept of a block take (\d+) MB"
        assert 32000 <= int(re.search(wanted, said)[1]) <= 36000
        assert len(done.stderr.splitlines()) == (1 if code else 0)
    assert time.process_time() - began < 20
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.nml"]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("campaign%n_samples", 700000000, "the lists of samples take 8400 MB on each rank"),
        ("process%n_realizations", 2000000000, "the realizations of a process take 80000 MB"),
    ],
)
def test_more_than_memory_holds_is_refused_in_one_line(program, tmp_path, name, value, said):
    """The program refuses them before the Fortran runtime fails."""
    scene = SCENE.format(**USUAL | {"n_steps": 100})
    (tmp_path / "s.nml").write_text(scene)
    done = subprocess.run(
        [program, "run", "s.nml", "--set", f"{name}={value}"], cwd=tmp_path,
        env=ENVIRONMENT | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, timeout=100,
        check=False, preexec_fn=limited,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert f"{name} = {value}: {said}, which the system does not give" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.nml"]
