"""The installed package serves a project of its own."""

from __future__ import annotations

import subprocess

from tests.conftest import PROGRAM, ROOT


def test_an_installed_library_is_found_and_linked(tmp_path):
    prefix, build = tmp_path / "prefix", tmp_path / "build"
    for command in (
        ["cmake", "--install", PROGRAM.parent.parent, "--prefix", prefix],
        ["cmake", "-G", "Ninja", "-S", ROOT / "tests/package", "-B", build,
         f"-DCMAKE_PREFIX_PATH={prefix}"],
        ["cmake", "--build", build],
    ):  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    done = subprocess.run([build / "example"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "b0 =  0.928203" in done.stdout
    shown = subprocess.run(
        [prefix / "bin/entroslip", "--version"], capture_output=True, check=False
    )
    assert shown.returncode == 0
