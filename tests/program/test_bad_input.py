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
    ("arguments", "message"),
    [
        ((), "no command; there are run, check, tradeoff, replay, template"),
        (("rnu", "x.nml"), "unknown command rnu, did you mean run?"),
        (("run",), "run needs a scene: entroslip run SCENE"),
        (("run", "absent.nml"), "absent.nml: no such file"),
        (("/dev/null",), "no command before /dev/null"),
        (("run", "x.nml", "y.nml"), "one scene at a time: x.nml and y.nml"),
        (("run", "x.nml", "--otuput", "r.h5"), "unknown option --otuput, did you mean --output?"),
        (("run", "x.nml", "--otuput=r.h5"), "unknown option --otuput, did you mean --output?"),
        (("run", "x.nml", "--output"), "--output needs a value"),
        (("run", "x.nml", "--output="), "--output needs a value"),
        (("run", "x.nml", "--output", ""), "--output needs a value"),
        (("run", "x.nml", "--fresh=yes"), "--fresh takes no value"),
        (("replay", "x.nml", "--case", "0", "--sample", "1"), "--case 0: needs a whole number"),
        (("replay", "x.nml", "--case=1", "--sample=b"), "--sample b: needs a whole number"),
        (("replay", "x.nml"), "replay needs --case and --sample"),
        (("check", "x.nml", "--case", "1"), "--case and --sample belong to replay"),
        (("check", "x.nml", "--reference"), "--reference belongs to template"),
        (("template", "x.nml"), "template takes no scene"),
        (("check", "x.nml", "--share"), "--share belongs to run"),
        (("run", "x.nml", "--share", "--fresh"), "--fresh discards what others share"),
    ],
)
def test_bad_usage(entroslip, tmp_path, arguments, message):
    done = entroslip(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith(f"entroslip: {message}")
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_value_may_follow_its_option_behind_an_equals_sign(entroslip, tmp_path):
    done = entroslip("run", scene_with(tmp_path, "&chain /", "&chain /"), "--output=sub/r.h5",
                     "--set=campaign%n_samples=1", "--quiet")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"bad.nml", "sub"}
    assert (tmp_path / "sub" / "r.h5").stat().st_size > 0


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
    assert entroslip("help").stdout == shown.stdout
    version = entroslip("--version")
    assert version.returncode == 0
    for word in ("HDF5", "FFTW", "NLopt", "LAPACK", "MPI", "GCC", "-O3"):
        assert word in version.stdout
    template = entroslip("template")
    (tmp_path / "template.nml").write_text(template.stdout)
    assert entroslip("check", "template.nml").returncode == 0
