"""What a run says of itself: progress on a terminal and in a log, a summary at the end."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ENVIRONMENT
from tests.program.campaign import SCENE
from tests.program.terminal import said_on_a_terminal

PROGRESS = re.compile(r"\d+ of 602 samples, \d+ %")
RATE = re.compile(r"\d+ of 602 samples, \d+ %, [\d.]+ a (second|minute), [\d:]+ left")


@pytest.fixture
def command(program, tmp_path):
    (tmp_path / "scene.nml").write_text(SCENE)
    return [program, "run", "scene.nml", "--output", "r.h5"]


def test_a_terminal_has_one_line_that_is_redrawn(command, tmp_path):
    code, text = said_on_a_terminal(command, "stdout", cwd=tmp_path, env=ENVIRONMENT)
    assert code == 0
    drawn = [part for part in text.split("\r") if PROGRESS.match(part)]
    assert len(drawn) >= 2
    assert RATE.fullmatch(drawn[-1])
    done = [int(part.split()[0]) for part in drawn]
    assert done == sorted(done)
    # all lines that stay are those of the summary
    lines = [line.rstrip("\r").rpartition("\r")[2] for line in text.split("\n")]
    assert not [line for line in lines if PROGRESS.match(line)]


def test_the_summary_tells_what_was_done_how_long_it_took_and_how_sure_it_is(command, entroslip):
    audited = ("--set", "accuracy%audit=0.02")
    done = entroslip(*command[1:], *audited)
    assert done.returncode == 0, done.stderr
    what, how = done.stdout.splitlines()  # no progress in a log before a minute is over
    assert what == "1 process, 4 cases, 602 samples, 14 repeated in r.h5"
    assert re.fullmatch(
        r"(less than 1|[\d.]+) s; mean time in slip: standard error at most [\d.]+ points, "
        r"numerical error [\d.e-]+ points",
        how,
    )


def test_quiet_is_quiet(command, entroslip):
    for ranks in (0, 2):
        done = entroslip(*command[1:], "--fresh", "--quiet", ranks=ranks)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    again = entroslip(*command[1:], "--quiet")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
