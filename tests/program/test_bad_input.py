"""Bad input ends with 2, one clear message a mistake, and nothing written."""

from __future__ import annotations

import pytest


def scene_with(tmp_path, old, new):
    from tests.conftest import SMALL_SCENE

    assert old in SMALL_SCENE
    path = tmp_path / "bad.nml"
    path.write_text(SMALL_SCENE.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("n_samples = 6", "n_smaples = 6", 6, ["campaign%n_smaples", "n_samples"]),
        ("&chain /", "&chain mass = -2.0 /", 3, ["chain%mass = -2.0", "positive"]),
        ("&chain /", "&chain mass = 1.0, 2.0 /", 3, ["chain%mass", "one", "5"]),
        ("&chain /", "&chian /", 3, ["chian", "chain"]),
        ("n_steps = 4000", "n_steps = many", 5, ["integration%n_steps", "many"]),
        ("variance = 3.7, 41.1", "kind = 'file' file = 'absent.txt'", 4, ["absent.txt"]),
        ("order = 2", "order = 2, 5", 2, ["process%order"]),
        ("&chain /", "&chain / &accuracy audit = 2.0 /", 3, ["accuracy%audit", "0 to 1"]),
    ],
)
def test_a_mistake_gets_its_line(entroslip, tmp_path, old, new, line, words):
    scene = scene_with(tmp_path, old, new)
    for command in ("check", "run"):
        done = entroslip(command, scene)
        assert done.returncode == 2
        assert f"bad.nml:{line}:" in done.stderr
        for word in words:
            assert word in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["bad.nml"]


def test_all_mistakes_in_one_pass(entroslip, tmp_path):
    scene = tmp_path / "bad.nml"
    scene.write_text("&chain mass = -1.0 /\n&excitation variance = -3.0 bnad = 1.0 /\n")
    done = entroslip("run", scene, ranks=2)
    assert done.returncode == 2
    for word in ("chain%mass", "excitation%variance", "excitation%bnad", "band"):
        assert word in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("rnu", "x.nml"),
        ("run",),
        ("run", "absent.nml"),
        ("run", "x.nml", "--otuput", "r.h5"),
        ("run", "x.nml", "--output"),
        ("replay", "x.nml", "--case", "0", "--sample", "1"),
        ("replay", "x.nml"),
        ("template", "x.nml"),
        ("check", "x.nml", "--share"),
        ("run", "x.nml", "--share", "--fresh"),
    ],
)
def test_bad_usage(entroslip, tmp_path, arguments):
    done = entroslip(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip()
    assert not list(tmp_path.iterdir())


def test_a_scene_without_samples_has_nothing_to_share(entroslip, tmp_path):
    scene = "&process correlation_length = 1.0 order = 2 mean = 0.2 std = 0.067 /\n"
    (tmp_path / "p.nml").write_text(scene)
    done = entroslip("run", "p.nml", "--share")
    assert done.returncode == 2
    assert "no samples to be shared" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["p.nml"]


def test_help_version_and_template(entroslip, tmp_path):
    shown = entroslip("--help")
    assert shown.returncode == 0
    assert len(shown.stdout.splitlines()) <= 24
    version = entroslip("--version")
    assert version.returncode == 0
    for word in ("HDF5", "FFTW", "NLopt", "LAPACK", "MPI", "GCC", "-O3"):
        assert word in version.stdout
    template = entroslip("template")
    (tmp_path / "template.nml").write_text(template.stdout)
    assert entroslip("check", "template.nml").returncode == 0
