"""Limits of the system, `ulimit -v` and `ulimit -f`: one line and exit code 3.

Tests core_memory, and the restarts of core_openblas.
"""

from __future__ import annotations

import os
import resource
import subprocess
import time
from pathlib import Path

import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT

REFUSED = 3
SCENE = """\
&process correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067 /
&chain n_dof = 5 /
&excitation variance = 41.1 /
&integration method = 'event' n_steps = 4000 /
&campaign n_samples = 8 /
"""
COMMANDS = {
    "run": ["run", "scene.nml", "--output", "limited.h5", "--quiet"],
    "check": ["check", "scene.nml"],
    "replay": ["replay", "scene.nml", "--case", "1", "--sample", "2"],
    "tradeoff": ["tradeoff", "scene.nml"],
    "estimate": ["estimate", "friction.txt"],
}
NEED = (
    "entroslip: memory: the system does not give the 256 MB that libraries take before any work: "
    "raise the limit (ulimit -v) to 400000 kB or more\n"
)
UNTHREADED = {name: text for name, text in ENVIRONMENT.items() if not name.endswith("_NUM_THREADS")}


@pytest.fixture
def limited(program, tmp_path):
    """Runs a command under a limit of the system, with a thread of BLAS for each core."""
    (tmp_path / "scene.nml").write_text(SCENE)
    (tmp_path / "friction.txt").write_text("0.31 0.29 0.36 0.38 0.27 0.22 0.30 0.33\n")

    def run(command, kind, n_bytes):
        return subprocess.run(
            [program, *command], cwd=tmp_path, env=UNTHREADED, capture_output=True, text=True,
            timeout=100, check=False,
            preexec_fn=lambda: resource.setrlimit(kind, (n_bytes, n_bytes)),
        )  # fmt: skip

    return run


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
@pytest.mark.parametrize("kilobytes", [150000, 300000])
def test_too_little_memory_is_said_in_one_line(limited, tmp_path, command, kilobytes):
    done = limited(command, resource.RLIMIT_AS, 1024 * kilobytes)
    assert (done.returncode, done.stdout, done.stderr) == (REFUSED, "", NEED)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["friction.txt", "scene.nml"]


def test_what_takes_no_memory_is_done_all_the_same(limited):
    for command in (["template"], ["--help"], ["--version"]):
        done = limited(command, resource.RLIMIT_AS, 150000 * 1024)
        assert (done.returncode, done.stderr) == (os.EX_OK, "")
        assert done.stdout


def test_the_memory_that_is_asked_for_is_enough(limited, tmp_path):
    """The results have the bits of a run without a limit; arguments may have blanks."""
    done = limited(COMMANDS["run"], resource.RLIMIT_AS, 400000 * 1024)
    assert (done.returncode, done.stderr) == (os.EX_OK, "")
    free = ["run", "scene.nml", "--output", "without limit.h5", "--quiet"]
    for limit in (resource.RLIM_INFINITY, 400000 * 1024):
        assert limited(free, resource.RLIMIT_AS, limit).returncode == os.EX_OK
    assert scene_bits(tmp_path / "limited.h5") == scene_bits(tmp_path / "without limit.h5")


def test_more_values_than_the_memory_holds_are_refused(limited, tmp_path):
    (tmp_path / "friction.txt").write_text("0.31\n0.29\n0.36\n0.38\n" * 50000)
    done = limited(COMMANDS["estimate"], resource.RLIMIT_AS, 400000 * 1024)
    assert done.returncode == 2
    assert ": 200000 values: their realizations take 478 MB, which the system" in done.stderr


def test_the_process_keeps_its_name(program, tmp_path):
    """After the restart that a limit of memory needs, as `top` and `pkill` see it."""
    (tmp_path / "scene.nml").write_text(SCENE.replace("n_samples = 8", "n_samples = 100000"))
    limit = (400000 * 1024,) * 2
    process = subprocess.Popen(
        [program, *COMMANDS["run"]], cwd=tmp_path, env=UNTHREADED,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit),
    )  # fmt: skip
    while len(list(tmp_path.iterdir())) == 1 and process.poll() is None:
        time.sleep(0.01)  # until its first file is there
    name = Path(f"/proc/{process.pid}/comm").read_text()
    process.kill()
    process.wait()
    assert name == "entroslip\n"


@pytest.mark.parametrize("n_bytes", [500, 5000, 40000])
def test_a_limit_of_file_size_is_an_error_of_the_file(limited, tmp_path, n_bytes):
    """No file of processes, samples or results is left incomplete; a higher limit continues."""
    done = limited(COMMANDS["run"], resource.RLIMIT_FSIZE, n_bytes)
    assert done.returncode == REFUSED
    assert "File too large" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "limited.h5").exists()
    assert not list(tmp_path.rglob("*.part-*"))
    again = limited(COMMANDS["run"], resource.RLIMIT_FSIZE, resource.RLIM_INFINITY)
    assert (again.returncode, again.stderr) == (os.EX_OK, "")
