"""Fixtures that run the scene SCENE of a test module."""

from __future__ import annotations

import pytest

from entroslip.bits import scene_bits
from tests.conftest import ENVIRONMENT
from tests.program.campaign import Run


@pytest.fixture(scope="module")
def reference(request, program, tmp_path_factory):
    """Results of the uninterrupted campaign on one rank."""
    folder = tmp_path_factory.mktemp("reference")
    (folder / "scene.nml").write_text(request.module.SCENE)
    run = Run(program, ["run", "scene.nml", "--output", "r.h5"], folder, ENVIRONMENT)
    code, said, errors = run.wait()
    assert code == 0, errors
    assert "continuing" not in said
    return scene_bits(folder / "r.h5")


@pytest.fixture
def campaign(request, program, tmp_path):
    """Starts the campaign in its own folder: campaign(n_ranks, further arguments)."""
    (tmp_path / "scene.nml").write_text(request.module.SCENE)

    def start(n_ranks: int = 0, *more: str) -> Run:
        arguments = ["run", "scene.nml", "--output", "r.h5", *more]
        return Run(program, arguments, tmp_path, ENVIRONMENT, n_ranks)

    return start


@pytest.fixture
def output(tmp_path):
    return tmp_path / "r.h5"
