"""`whatif`: another law of the friction, from the samples of a results file."""

from __future__ import annotations

import itertools
import os
import re
import subprocess

import h5py
import numpy as np
import pytest

from tests.conftest import ENVIRONMENT

SCENE = """\
&process correlation_length = 1.0 order = 2 mean = 0.2 std = {std} /
&chain n_dof = 3 /
&excitation variance = 20.0, 40.0 /
&integration method = 'event' n_steps = 6000 /
&campaign n_samples = {n} /
&output segment_length = 1024 dofs = 1, 3 /
"""


@pytest.fixture(scope="module")
def folder(program, tmp_path_factory):
    """known.h5: two laws, 40 samples each; between.h5: the law between them, 300 samples."""
    folder = tmp_path_factory.mktemp("whatif")
    for name, std, n in (("known", "0.067, 0.10", 40), ("between", "0.08", 300)):
        (folder / f"{name}.nml").write_text(SCENE.format(std=std, n=n))
        words = [program, "run", f"{name}.nml", "--quiet"]
        subprocess.run(words, cwd=folder, env=ENVIRONMENT, check=True)
    return folder


def table(said: str, title: str) -> np.ndarray:
    """(joint or dof; mean, 5 %, 95 %, std or band ratio; value or error) of a table."""
    rows = said.split(f"{title}\n")[1].split("\n")[1:]
    rows = [re.findall(r"(\S+)\+-(\S+)", row) for row in rows]
    return np.array([row for row in itertools.takewhile(bool, rows)], dtype=float)


def test_a_law_between_those_marched_is_that_of_a_run(entroslip, folder):
    """Within 4 of both standard errors together, and with errors worth stating."""
    done = entroslip("whatif", folder / "known.h5", "--set", "process%std=0.08", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "law          mean = 0.2, std = 0.08, L0 = 1.0, order = 2\n" in done.stdout
    assert "samples      40 of c001, 40 of c003\n" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80
    slip = table(done.stdout, "time in slip [%]")
    power = table(done.stdout, "pseudo-variance [m^2]")
    with h5py.File(folder / "between.h5") as file:
        case = file["campaign/c001"]
        for found, name, scale in (
            (slip[:, 0], "slip_mean", 100),
            (slip[:, 3], "slip_std", 100),
            (power[:, 0], "pseudo_variance_mean", 1),
        ):
            truth, its_error = scale * case[name][()], scale * case[f"{name}_error"][()]
            assert (abs(found[:, 0] - truth) < 4 * np.hypot(found[:, 1], its_error)).all()
        assert (slip[:, 0, 1] < 100 * case["slip_std"][()] / np.sqrt(40)).all()
        for column, truth in ((1, case["slip_percentiles"][0]), (2, case["slip_percentiles"][1])):
            assert (abs(slip[:, column, 0] - 100 * truth) < 4 * slip[:, column, 1]).all()


def test_errors_say_what_another_force_record_would_change(entroslip, folder, tmp_path):
    """Errors of 0.05 points stood beside a time-average error of a point, which was not named."""
    done = entroslip("whatif", folder / "known.h5", "--set", "process%std=0.08", "--quiet")
    with h5py.File(folder / "known.h5") as file:
        cases = (file[f"campaign/{name}/slip_mean_time_error"][()] for name in ("c001", "c003"))
        largest = 100 * np.max(list(cases))
    said = re.search(r"one force\s+record is up to (\S+)\s+points", done.stdout)
    assert float(said[1]) == pytest.approx(largest, rel=5e-3)  # three digits


def test_ranks_and_other_folders_give_the_same_text(entroslip, folder, tmp_path):
    """The results file has all that is needed."""
    (tmp_path / "moved.h5").write_bytes((folder / "known.h5").read_bytes())
    words = ["--set", "process%std=0.08", "--set", "process%correlation_length=0.5", "--quiet"]
    alone = entroslip("whatif", "moved.h5", *words)
    assert "L0 = 0.5" in alone.stdout
    assert entroslip("whatif", folder / "known.h5", *words, ranks=3).stdout == alone.stdout


def test_a_law_too_far_from_the_samples_is_not_estimated(entroslip, folder):
    done = entroslip("whatif", folder / "known.h5", "--set", "process%mean=1.5", "--quiet")
    assert done.returncode == 4
    assert "the samples do not reach this law: name it in the scene, and run" in done.stderr
    assert not re.search(r"\d\+-\d", done.stdout)
    assert "joint" not in done.stdout  # no table of dashes


def test_each_quantity_is_judged_by_itself(entroslip, folder):
    """A std of 0.133 is near enough to the samples for slip, not for power."""
    done = entroslip("whatif", folder / "known.h5", "--set", "process%std=0.133", "--quiet")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("time in slip [%]\njoint") == 2
    assert done.stdout.count("pseudo-variance [m^2]  -\n") == 2
    assert "-: too far from the samples" in done.stdout


def test_a_file_that_may_not_be_read_is_not_called_foreign(program, folder, tmp_path):
    """Neither by whatif nor by a run that would replace it."""
    scene, results = tmp_path / "known.nml", tmp_path / "known.h5"
    scene.write_text((folder / "known.nml").read_text())
    results.write_bytes(b"x")
    results.chmod(0)
    alone = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 else []
    for words in (("whatif", "known.h5", "--set", "process%std=0.08"), ("run", "known.nml")):
        words = [*alone, program, *words]
        done = subprocess.run(
            words, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, check=False
        )
        assert "known.h5: cannot be opened as HDF5: Permission denied\n" in done.stderr
        assert done.returncode == 3


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("known.h5",), 2, "whatif needs another law: --set process%std=0.1"),
        ((), 2, "whatif needs results: entroslip whatif RESULTS.h5"),
        (("known.h5", "--set", "campaign%n_samples=9"), 2, "changes the law of the friction alone"),
        (("known.h5", "--set", "process%std=0.1"), 2, "known.h5: has samples of this law"),
        (("known.h5", "--set", "process%stdd=0.1"), 2, "did you mean std?"),
        (("known.h5", "--set", "process%std=2"), 4, "process 3: positive process"),
        (("none.h5", "--set", "process%std=0.08"), 2, "none.h5: no such file"),
        (("known.nml", "--set", "process%std=0.08"), 3, "cannot be read as results of entroslip"),
    ],
)
def test_what_cannot_be_asked_is_refused(entroslip, folder, words, code, message):
    done = entroslip("whatif", *words, cwd=folder)
    assert message in done.stderr
    assert done.returncode == code
    assert done.stdout == ""


def test_samples_of_no_law_are_refused(entroslip, tmp_path):
    text = SCENE.format(std="0.1", n=3).replace("n_steps = 6000", "n_steps = 1100")
    (tmp_path / "few.nml").write_text(text)
    assert entroslip("run", "few.nml", "--quiet").returncode == 0
    done = entroslip("whatif", "few.h5", "--set", "process%std=0.08")
    assert done.returncode == 2
    assert "few.h5: no case has the samples of a regression" in done.stderr


def test_the_percentiles_are_those_of_the_samples(entroslip, tmp_path):
    """A deterministic case stands before them and has none."""
    scene = SCENE.format(std=0.067, n=25).replace("n_samples", "deterministic = .true. n_samples")
    scene = scene.replace("6000", "600").replace("&output", "&output percentiles = 10, 80")
    (tmp_path / "both.nml").write_text(scene.replace("1024", "128"))
    assert entroslip("run", "both.nml", "--quiet").returncode == 0
    done = entroslip("whatif", "both.h5", "--set", "process%std=0.06", "--quiet")
    assert done.returncode == 0, done.stderr
    assert re.search(r"joint mean +10 % +80 % +std", done.stdout)
