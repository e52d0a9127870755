"""Fixtures of the end-to-end tests: the program, a way to run it, small scenes."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = Path(os.environ.get("ENTROSLIP", ROOT / "build/release/bin/entroslip")).resolve()
# Open MPI's starts and ends meet in one folder, which a start can find just made by another or just
# removed: a folder of one's own for each process of tests, and never an empty one.
SESSIONS = tempfile.TemporaryDirectory(prefix="ompi-")
Path(SESSIONS.name, f"ompi.{socket.gethostname().split('.')[0]}.{os.getuid()}", "kept").mkdir(
    parents=True
)
ENVIRONMENT = os.environ | {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",  # a rank that waits leaves its core to the other tests
    "OMPI_MCA_orte_tmpdir_base": SESSIONS.name,
}


INPUT_SCENES = sorted((ROOT / "input").glob("*.nml"))
SHORTER = (
    "integration%n_steps=2000",
    "campaign%n_samples=2",
    "process%order=1",
    "process%std=0.1",
    "accuracy%target_statistical=100",
)


def shortened(scene: Path) -> list[str]:
    """Options that make seconds of a scene of input/; those of groups that it has."""
    text = scene.read_text()
    options = [option for option in SHORTER if f"\n&{option.split('%')[0]}" in text]
    return [word for option in options for word in ("--set", option)]


@pytest.fixture(scope="session")
def program() -> Path:
    assert PROGRAM.exists(), f"{PROGRAM} is not built"
    return PROGRAM


@pytest.fixture
def entroslip(program, tmp_path):
    """Runs the program in a folder of its own: entroslip("run", scene, ranks=2)."""

    def run(*arguments, ranks=0, cwd=tmp_path, timeout=300):
        launcher = []
        if ranks:
            launcher = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", str(ranks)]
        return subprocess.run(
            [*launcher, program, *map(str, arguments)],
            cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, timeout=timeout, check=False,
        )  # fmt: skip

    return run


SMALL_SCENE = """\
&scene title = 'small' seed = 7 /
&process correlation_length = 0.3 order = 2 mean = 0.2 std = 0.067 positive = .true. /
&chain /
&excitation variance = 3.7, 41.1 /
&integration n_steps = 4000 max_halvings = 6 /
&campaign n_samples = 6 deterministic = .true. /
&output segment_length = 1024 /
"""


@pytest.fixture
def small_scene(tmp_path):
    path = tmp_path / "small.nml"
    path.write_text(SMALL_SCENE)
    return path
