"""Results files that several tests of postproc look at."""

from __future__ import annotations

import subprocess
from contextlib import redirect_stdout

import pytest

from entroslip.__main__ import main
from tests.conftest import ENVIRONMENT, PROGRAM, SMALL_SCENE


@pytest.fixture(scope="session")
def results_of_scene(tmp_path_factory):
    """Runs a scene's text through the program: results_of_scene(text, "replay", "--case", 1)."""

    def run(text, command="run", *options):
        folder = tmp_path_factory.mktemp("scene")
        raw = text if isinstance(text, bytes) else text.encode()
        (folder / "small.nml").write_bytes(raw)
        words = [PROGRAM, command, "small.nml", *map(str, options), "--output", "small.h5"]
        done = subprocess.run(
            words, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return folder / "small.h5"

    return run


@pytest.fixture(scope="session")
def results_file(results_of_scene):
    return results_of_scene(SMALL_SCENE)


@pytest.fixture(scope="session")
def drawn(results_file):
    """The folder with all that is drawn of it."""
    folder = results_file.parent / "drawn"
    with open(results_file.parent / "said", "w") as said, redirect_stdout(said):
        assert main([str(results_file), "--out", str(folder)]) == 0
    return folder
