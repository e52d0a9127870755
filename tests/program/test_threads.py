"""Threads and kernels of BLAS: the same bits with any threads, with mpirun and without."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from entroslip.bits import differences
from tests.conftest import ENVIRONMENT

#: README's smallest scene, and one whose process is solved on a grid: large enough for threads
SCENE = """\
&process correlation_length = 1.0 order = 2 mean = 0.2 std = 0.067 /
&chain n_dof = 5 /
&excitation variance = 41.1 /
&integration method = 'event' n_steps = 4000 /
&campaign n_samples = 8 /
"""
OF_ORDER_1 = SCENE.replace("order = 2", "order = 1 positive = .true.")

#: processes alone, of the kinds that take large products or long sums: Newton's method, Yule and
#: Walker, all signs beside the inversion of a matrix, quadrature, and a sampled problem
PROCESSES = """\
&process correlation = 'L1' correlation_length = 3.0 order = 20 mean = 0 std = 1 positive = f /
&process correlation_length = 1.0 order = 12 mean = 0 std = 1 positive = f /
&process method = 'direct' correlation_length = 1.0 order = 9 all_signs = t
         inversion_half_width = 100 mean = 0 std = 1 positive = f /
&process correlation_length = 3.0 order = 1 mean = 1 std = 0.3 sampler = 'sequential' /
&process correlation_length = 1.0 order = 3 mean = 1 std = 0.3 sampler = 'exact' /
"""

LAUNCHERS = {
    "plain": [],
    "bound": ["mpirun", "--oversubscribe", "-n", "2"],
    "unbound": ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", "2"],
    "one core": ["taskset", "-c", "0"],
}
VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")


def environment(n_threads: int) -> dict[str, str]:
    """Environment with a number of threads; 0: without any limit of threads."""
    plain = {name: value for name, value in ENVIRONMENT.items() if name not in VARIABLES}
    return plain | (dict.fromkeys(VARIABLES, str(n_threads)) if n_threads else {})


def run(program, folder, output, launcher="plain", n_threads=0, more=()):
    words = [*LAUNCHERS[launcher], program, "run", "scene.nml", "--output", output, *more]
    done = subprocess.run(
        words, cwd=folder, env=environment(n_threads), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "scene", [SCENE, OF_ORDER_1, PROCESSES], ids=["smallest", "order_1", "processes"]
)
def test_bits_do_not_depend_on_threads_or_launcher(program, tmp_path, scene):
    (tmp_path / "scene.nml").write_text(scene)
    run(program, tmp_path, "reference.h5", n_threads=1)
    others = [
        ("plain", 0),
        ("plain", 2),
        ("plain", 7),
        ("bound", 0),
        ("unbound", 7),
        ("one core", 0),
    ]
    for launcher, n_threads in others:
        output = f"{launcher}_{n_threads}.h5"
        run(program, tmp_path, output, launcher, n_threads)
        assert differences(tmp_path / "reference.h5", tmp_path / output) == [], output


def test_members_with_other_threads_share_a_run(program, tmp_path):
    """Their results have the bits of a single run."""
    (tmp_path / "scene.nml").write_text(OF_ORDER_1.replace("n_samples = 8", "n_samples = 200"))
    run(program, tmp_path, "alone.h5", n_threads=1)
    members = [
        subprocess.Popen(
            [program, "run", "scene.nml", "--output", "shared.h5", "--share"],
            cwd=tmp_path, env=environment(n_threads), stderr=subprocess.PIPE, text=True,
        )
        for n_threads in (1, 2)
    ]  # fmt: skip
    for member in members:
        _, errors = member.communicate(timeout=300)
        assert member.returncode == os.EX_OK, errors
    run(program, tmp_path, "shared.h5", n_threads=2)
    assert differences(tmp_path / "shared.h5", tmp_path / "alone.h5") == []


def kernels(program, **variables):
    """The kernels that OpenBLAS takes, one name for each start of the program."""
    done = subprocess.run(
        [program, "--version"], env=ENVIRONMENT | {"OPENBLAS_VERBOSE": "2"} | variables,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return re.findall(r"^Core: (\w+)$", done.stderr + done.stdout, flags=re.MULTILINE)


def test_openblas_takes_the_kernels_of_the_processor(program):
    """Also on a processor that it does not know; a choice of the user stays."""
    names = kernels(program)
    if not names or " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("no OpenBLAS with several kernels, or a processor without AVX2")
    assert names[-1] != "Prescott"
    assert len(names) == (2 if names[0] == "Prescott" else 1)
    assert kernels(program, OPENBLAS_CORETYPE="Prescott") == ["Prescott"]
