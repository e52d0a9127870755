"""Output at a terminal: help on one screen, colour if wanted, aligned text."""

from __future__ import annotations

import subprocess

import pytest

from tests.conftest import ENVIRONMENT, INPUT_SCENES, ROOT, shortened
from tests.program.terminal import said_on_a_terminal

ESCAPE = "\x1b["


def errors_on_a_terminal(program, *arguments, **environment):
    """Text that a run writes to standard error, a terminal."""
    variables = {name: text for name, text in ENVIRONMENT.items() if name != "NO_COLOR"}
    code, text = said_on_a_terminal(
        [program, *arguments], "stderr", stdout=subprocess.DEVNULL, env=variables | environment
    )
    assert code == 2
    return text


def test_errors_are_coloured_on_a_terminal_only(program, entroslip):
    assert errors_on_a_terminal(program, "rnu").startswith(f"{ESCAPE}1;31mentroslip:{ESCAPE}0m ")
    assert ESCAPE not in errors_on_a_terminal(program, "rnu", NO_COLOR="1")
    assert entroslip("rnu").stderr.startswith("entroslip: unknown command rnu")


def test_a_complaint_begins_with_its_place(entroslip, tmp_path):
    (tmp_path / "bad.nml").write_text(
        "&chain mass = -1.0 friction = 0.2 /\n&excitation variance = 1.0 /\n"
    )
    first, line, caret = entroslip("check", "bad.nml").stderr.splitlines()
    assert first.startswith("bad.nml:1: ")
    assert line.index("-1.0") == caret.index("^")


def test_help_fits_a_screen(entroslip):
    lines = entroslip("--help").stdout.splitlines()
    assert len(lines) < 24  # the prompt stands on the last
    assert max(map(len, lines)) <= 80


def check_width(done):
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stdout.splitlines() if len(line) > 80] == []


@pytest.mark.parametrize("scene", INPUT_SCENES, ids=lambda scene: scene.stem)
def test_check_keeps_to_80_columns(entroslip, scene):
    check_width(entroslip("check", scene.name, *shortened(scene), cwd=scene.parent))


@pytest.mark.parametrize(
    ("columns", "least", "most"), [(60, 50, 60), (10, 30, 40), (300, 70, 80), (0, 70, 80)]
)
def test_check_fits_a_narrow_terminal(program, small_scene, columns, least, most):
    """Its lines beside labels; those of tables are as long as they are. At least 40 columns."""
    words = [program, "check", small_scene]
    code, text = said_on_a_terminal(words, "stdout", columns, env=ENVIRONMENT)
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("structure"))
    assert code == 0
    assert least <= max(map(len, lines[start:])) <= most


def test_reasons_of_what_has_no_solution_keep_to_80_columns(entroslip):
    refused = ["--set", "process%order=1", "--set", "process%std=1.5"]
    check_width(entroslip("check", ROOT / "input/extremes_process.nml", *refused))
