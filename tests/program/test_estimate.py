"""`estimate`: from measured values to a scene."""

from __future__ import annotations

import os
import re
import subprocess

import numpy as np
import pytest

from tests.conftest import ENVIRONMENT

LINES = (
    "# friction along two flanges\n"
    "0.31 0.29 0.36 0.38 0.27 0.22 nan 0.30 0.33 0.35\n"
    "0.25, 0.27, 0.33, 0.29, 0.31, 0.40, 0.37, 0.28   # the second\n"
)


@pytest.fixture
def data(tmp_path):
    (tmp_path / "friction.txt").write_text(LINES)
    return tmp_path / "friction.txt"


def test_measured_values_become_a_scene_that_is_solved(entroslip, data):
    done = entroslip("estimate", data, "--output", "joints.nml")
    assert done.returncode == 0, done.stderr
    assert "17 values in 2 records, 1 gap" in done.stdout
    mean, error = re.search(r"mean +(\S+)\+-(\S+)", done.stdout).groups()
    assert abs(float(mean) - 5.31 / 17) < float(error)  # near the plain mean
    how = "entroslip run joints.nml --set process%n_points=10 --set process%n_realizations=800"
    assert how in done.stdout
    assert f"joints.h5 --measured {data} --out figures" in done.stdout
    scene = (data.parent / "joints.nml").read_text()
    assert "positive = .true.  branch = 'nonnegative'" in scene
    assert entroslip("run", "joints.nml").returncode == 0


def test_a_column_is_one_record_and_the_group_is_printed(entroslip, data):
    values = LINES.replace(",", " ").split("\n")[1].split()
    data.write_text("\n".join(values) + "\n")
    done = entroslip("estimate", data)
    assert "9 values in 1 record, 1 gap" in done.stdout
    assert "&process" in done.stdout
    assert entroslip("estimate", data, ranks=2).stdout == done.stdout  # the same on any ranks


def test_a_mean_of_many_stds_keeps_its_digits(entroslip, data):
    """The mean is not rounded to three digits if the std is smaller: 123.47, not 123."""
    values = 123.47 + 0.05 * np.array([-1, 1, 0, 0.4, 1.6, -1.4, -0.6, 0.5, 0, -0.4])
    np.savetxt(data, values)
    done = entroslip("estimate", data)
    printed, error = re.search(r"mean +(\S+)\+-(\S+)", done.stdout).groups()
    written = re.search(r"mean = (\S+)", done.stdout)[1]
    assert printed == written
    assert abs(float(written) - values.mean()) < float(error)


def test_correlations_end_with_the_longest_record(entroslip, data):
    """Lags longer than the longest record are not printed."""
    data.write_text("0.31 0.29 0.33 0.30 0.28\n0.33 0.35 0.27 0.30 0.31\n")
    said = entroslip("estimate", data).stdout
    assert "at lags 1 to 4 (of the process)" in said
    assert "-0.163 (0), -0.464 (0), 0.231 (0)" in said  # a zero is none of 2e-16


def test_a_correlation_of_few_pairs_is_at_most_one(entroslip, data):
    data.write_text("0.9 nan nan 0.95\n" + "0.3 nan\n0.2 nan\n0.25 nan\n" * 4)
    said = " ".join(entroslip("estimate", data).stdout.split())
    correlations = said.split("(of the process): ")[1]
    assert correlations.startswith("no pairs (")
    third = float(re.search(r"no pairs \S+, ([\d.]+) \(", correlations)[1])
    assert 0.99 < third <= 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.1\n0.2 x3\n", "friction.txt:2: 0.2 x3: must be a number; nan stands where none was"),
        ("0.1\n0.2\u00a00.3\n", "must be a number (it holds a non-breaking space, U+00A0: type"),
        ("# nothing\n", "friction.txt: holds no values"),
        ("1 2 3\n", "friction.txt: 3 values: an estimate needs 8"),
        ("0.3 " * 9, "all values are 0.3: they must scatter"),
    ],
)
def test_data_that_say_nothing_are_refused(entroslip, data, text, message):
    data.write_text(text)
    done = entroslip("estimate", data, "--output", "joints.nml")
    assert done.returncode == 2
    assert message in done.stderr
    assert not (data.parent / "joints.nml").exists()


def test_values_that_scatter_too_much_to_be_positive_are_refused_at_once(entroslip, data):
    """For instance a missing value marked by a number; refused before any search."""
    data.write_text("0.3 0.2 0.4 0.35 1e12 0.25 0.3 0.2 0.4 0.3 0.2\n")
    done = entroslip("estimate", data)
    assert done.returncode == 4
    assert done.stderr.endswith(": std/mean must be below 0.8562 with K(m) >= 0\n")


def test_values_whose_likeliest_process_does_not_exist_get_an_uncorrelated_one(entroslip, data):
    """Exponential values: the correlation that they have by chance would need a smaller std."""
    data.write_text("0.99 1.06 1.65 3.18 1.15 0.22 0.64 0.2 0.01 0.64\n")
    said = " ".join(entroslip("estimate", data).stdout.split())
    refusal = "no process of order 1 has the estimates (mean 0.945, std 0.98, L0 1.19): positive"
    assert refusal in said
    assert "; the estimates above are the likeliest without correlation" in said
    assert "std = 0.924 correlation_length = 0 order = 1 positive = .true. /" in said


def test_values_beyond_the_exponential_law_by_chance_get_nearly_that(entroslip, data):
    """std/mean = 1.2 is within three standard errors of 1; no positive process has it."""
    data.write_text("0.3 2.6 0.05 0.9 0.1 5.2 0.5 1.4 0.02 0.2 1.9 0.7\n")
    said = " ".join(entroslip("estimate", data).stdout.split())
    assert "and the group has a std of 0.98 of the mean, nearly exponential, from" in said
    mean, std = map(float, re.search(r"mean = (\S+) std = (\S+) corr", said).groups())
    assert std / mean == pytest.approx(0.98, abs=0.01)
    assert "distribution yes" in said


def test_a_file_with_the_joints_below_each_other_is_noted(entroslip, data):
    """A spreadsheet with a column for each of two lines of joints: its correlation was lost."""
    columns = "0.31 0.25\n0.29 0.27\n0.36 0.33\n0.38 0.29\n0.27 0.31\n"
    data.write_text(columns)
    assert "note         the file has more lines than values" in entroslip("estimate", data).stdout
    rows = zip(*map(str.split, columns.splitlines()), strict=True)
    data.write_text("\n".join(map(" ".join, rows)))
    assert "note" not in entroslip("estimate", data).stdout


def test_an_index_beside_the_values_is_refused(entroslip, data):
    data.write_text("\n".join(f"{n} {0.2 + 0.01 * (n % 3)}" for n in range(12)))
    done = entroslip("estimate", data)
    assert done.returncode == 2
    assert "the numbers 0.0, 1.0, 2.0, ... are an index, not measured" in done.stderr


def test_a_length_that_is_the_longest_tried_is_noted(entroslip, data):
    """A trend has no correlation length."""
    note = "note no longer L0 of its order is tried for 40 values: perhaps they are too few, have"
    trend = "\n".join(str(n + n % 3) for n in range(40))
    for text, is_noted in ((trend, True), (LINES, False)):
        data.write_text(text)
        done = entroslip("estimate", data)
        assert done.returncode == 0
        assert (note in " ".join(done.stdout.split())) == is_noted


def test_values_that_differ_from_line_to_line_are_noted_with_their_scatter(entroslip, data):
    """The printed correlations are those of the values."""
    means = np.array([0.21, 0.24, 0.26, 0.29, 0.31, 0.33, 0.36, 0.4])
    values = means[:, None] + 1e-4 * np.array([0, 1, -1, 2])
    np.savetxt(data, values)
    done = entroslip("estimate", data)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    std = f"{means.std(ddof=1):.3g}"
    assert f"only from line to line (correlation_length = 1e12, std = {std})" in said
    first = float(re.search(r"\(of the process\): ([\d.]+) ", said)[1])
    x, y = values[:, 1:] - values.mean(), values[:, :-1] - values.mean()
    assert first == pytest.approx((x * y).sum() / (0.5 * (x**2 + y**2).sum()), rel=5e-3)


def test_a_file_that_is_there_is_left_alone(entroslip, data):
    done = entroslip("estimate", data, "--output", data)
    assert done.returncode == 3
    assert "exists already" in done.stderr
    assert done.stdout == ""  # told before the work
    assert data.read_text() == LINES


def test_nothing_is_left_on_a_full_disk(program, data):
    """An empty scene would be in the way of the next attempt."""
    full = "mkdir full && mount -t tmpfs -o size=4k tmpfs full && head -c 4096 /dev/zero > full/z"
    work = '"$0" estimate friction.txt --output full/joints.nml'
    alone = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--map-root-user"]), "sh", "-c"]
    if subprocess.run([*alone, full], cwd=data.parent, check=False).returncode != 0:
        pytest.skip("no file system can be mounted")
    (data.parent / "full").rmdir()
    done = subprocess.run(
        [*alone, f"{full} && {work}; code=$?; ls full; exit $code", program],
        cwd=data.parent, env=ENVIRONMENT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    reason = "cannot be written to its end: No space left on device"
    assert done.stderr == f"entroslip: full/joints.nml: {reason}\n"
    assert done.stdout.split()[-1] == "z"


def test_a_missing_folder_is_made(entroslip, data):
    done = entroslip("estimate", data, "--output", "new/joints.nml")
    assert done.returncode == 0, done.stderr
    assert (data.parent / "new/joints.nml").exists()
