"""Output of a run: progress on a terminal and in a log, and the summary."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ENVIRONMENT
from tests.program.campaign import SCENE
from tests.program.terminal import said_on_a_terminal

PROGRESS = re.compile(r"\d+ of 602 samples, \d+ %")
RATE = re.compile(PROGRESS.pattern + r", [\d.]+ a (second|minute), [\d.e-]+ (s|min|h|days) left")
NO_WRAP, WRAP = r"\x1b\[\?7l", r"\x1b\[\?7h"  # a narrow terminal keeps the line, cut
ONE_RECORD = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.01 /
&chain n_dof = 1 /
&excitation variance = 10.0 /
&integration method = 'event' n_steps = 2000 /
&campaign n_samples = 30 /
&output quantities = 'slip' /
"""


@pytest.fixture
def command(program, tmp_path):
    (tmp_path / "scene.nml").write_text(SCENE)
    return [program, "run", "scene.nml", "--output", "r.h5"]


def test_a_terminal_has_one_line_that_is_redrawn(command, tmp_path):
    code, text = said_on_a_terminal(command, "stdout", cwd=tmp_path, env=ENVIRONMENT)
    assert code == 0
    drawn = re.findall(rf"{NO_WRAP}\r *\r([^\r]+){WRAP}", text)
    drawn = [part for part in drawn if PROGRESS.match(part)]
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
        r"(less than 1|[\d.]+) s; mean time in slip: standard error at most [\d.]+ points \(.+\), "
        r"numerical error [\d.e-]+ points",
        how,
    )


def test_the_summary_says_what_more_samples_do_not_lower(entroslip, tmp_path):
    """One record for all samples, one per sample, fewer than 512 steps, no friction, no slip."""
    (tmp_path / "s.nml").write_text(ONE_RECORD)
    of_time = "points (most of it time-average error: more steps lower it, more samples do not)"
    for option, ending in (
        ("excitation%per_sample=.false.", of_time),
        ("excitation%per_sample=.true.", "points"),
        ("integration%n_steps=511", "the march is too short for a standard error"),
        ("chain%normal_load=0.0", " s"),
        ("chain%normal_load=1e6", "no joint slips in c001"),
    ):
        done = entroslip("run", "s.nml", "--fresh", "--set", option)
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines()[-1].endswith(ending), done.stdout


def test_quiet_is_quiet(command, entroslip):
    quiet = (*command[1:], "--quiet", "--set", "campaign%n_samples=2")
    for ranks in (0, 2):
        done = entroslip(*quiet, "--fresh", ranks=ranks)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    again = entroslip(*quiet)
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
