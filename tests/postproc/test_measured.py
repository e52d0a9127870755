"""Measured values beside the process estimated from them."""

from __future__ import annotations

import numpy as np
import pytest

from entroslip.__main__ import main
from entroslip.measured import correlation_of, read_measured

DATA = "0.31 0.29 0.36 nan 0.27 0.22  # the first\n0.25, 0.27, 0.33, 0.29\n"
SCENE = "&process correlation_length = 1.0 order = 1 mean = 0.3 std = 0.05 {} /\n"
DRAWN = "n_points = 6 n_realizations = 800"


@pytest.fixture
def draw(entroslip, tmp_path):
    """Runs the scene, with more words in its group, and draws its results."""

    def run(words):
        (tmp_path / "joints.nml").write_text(SCENE.format(words))
        (tmp_path / "data.txt").write_text(DATA)
        assert entroslip("run", "joints.nml").returncode == 0
        names = [str(tmp_path / name) for name in ("joints.h5", "data.txt", "figures")]
        return main([names[0], "--measured", names[1], "--out", names[2]])

    return run


def test_values_are_drawn_beside_realizations_with_the_same_gaps(draw, tmp_path, capsys):
    assert draw(DRAWN) == 0, capsys.readouterr().err
    assert (tmp_path / "figures/measured.png").stat().st_size > 20_000
    report = (tmp_path / "figures/report.html").read_text()
    assert "95 % of 400 realizations measured at the same points" in report


def test_too_few_realizations_are_refused_with_what_to_ask_for(draw, tmp_path, capsys):
    assert draw("n_points = 6 n_realizations = 20") == 2
    said = capsys.readouterr().err
    assert "--set process%n_points=6 --set process%n_realizations=800" in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "figures").exists()


def test_correlation_takes_the_pairs_that_are_there(tmp_path):
    (tmp_path / "data.txt").write_text(DATA)
    first, second = read_measured(tmp_path / "data.txt")
    values = np.concatenate([first, second])
    x, y = (row - np.nanmean(values) for row in (first, second))
    pairs = [x[[0, 1]], x[[1, 2]], x[[4, 5]], y[[0, 1]], y[[1, 2]], y[[2, 3]]]
    products, squares = np.prod(pairs, axis=1), np.mean(np.square(pairs), axis=1)
    assert correlation_of([first, second])[0] == pytest.approx(products.sum() / squares.sum())


def test_a_column_is_one_record(tmp_path):
    (tmp_path / "data.txt").write_text("0.3\n0.2\nnan\n0.4\n")
    (record,) = read_measured(tmp_path / "data.txt")
    np.testing.assert_array_equal(record, [0.3, 0.2, np.nan, 0.4])


def test_values_are_separated_as_in_the_program(tmp_path):
    (tmp_path / "data.txt").write_text("\ufeff! two\n0.3,0.2 ! first\n0.1; nan, 4 # last\n")
    first, second = read_measured(tmp_path / "data.txt")
    np.testing.assert_array_equal(first, [0.3, 0.2])
    np.testing.assert_array_equal(second, [0.1, np.nan, 4.0])
