"""Bad input: exit code 2, one message per mistake, and no file written."""

from __future__ import annotations

import os
import re

import pytest

from tests.conftest import ENVIRONMENT, ROOT
from tests.program.campaign import Run


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
        ("&chain /", "&chain n_dof = 5 mass = 1.0, 2.0 /", 3, ["chain%mass", "one", "5"]),
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


def test_a_force_file_that_never_ends_is_refused_at_once(entroslip, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "/dev/zero"):
        scene = scene_with(tmp_path, "variance = 3.7, 41.1", f"kind = 'file' file = '{name}'")
        done = entroslip("check", scene, timeout=20)
        assert done.returncode == 2
        assert done.stderr.endswith(f"{name}: is empty, or a pipe or a device\n")


def test_a_pipe_or_a_folder_stays_where_results_should_be(entroslip, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    scene = scene_with(tmp_path, "n_samples = 6", "n_samples = 2")
    for options in ((), ("--fresh",)):
        done = entroslip("run", scene, *options, "--output", "pipe", timeout=20)
        assert done.returncode == 3
        assert "pipe was not written by this program" in done.stderr
        assert (tmp_path / "pipe").is_fifo()
    done = entroslip("run", scene, "--output", tmp_path)
    assert done.returncode == 3
    assert f"{tmp_path}: is a folder: give --output a file" in done.stderr


@pytest.mark.parametrize("method", ["newmark", "event"])
@pytest.mark.parametrize(("factor", "quantity"), [("1e1", "spectrum"), ("1e55", "slip")])
def test_results_too_large_for_their_squares_are_refused(
    entroslip, tmp_path, method, factor, quantity
):
    """Each value is in range, but the response overflows."""
    (tmp_path / "force.txt").write_text("\n".join(f"{i % 7 - 3}e97" for i in range(4001)))
    force = f"kind = 'file' file = 'force.txt' factor = {factor}"
    scene = scene_with(tmp_path, "variance = 3.7, 41.1", force)
    words = [f"integration%method='{method}'", f"output%quantities='{quantity}'"]
    words = [word for setting in words for word in ("--set", setting)]
    done = entroslip("run", scene, "--output", "large.h5", *words)
    assert done.returncode == 4
    assert re.fullmatch(
        "entroslip: case [12], sample 1: "
        "(spectra or slip beyond 1e150: scale the units of the scene; .*|"
        "joint .: more than 1000 transitions in the step .*)\n",
        done.stderr,
    )
    assert not (tmp_path / "large.h5").exists()


def test_a_logger_s_file_is_a_force_file(entroslip, tmp_path):
    """Byte order mark, comments and times are accepted; another sampling step is refused."""
    lines = [f"{0.01 * i:.4f} {i % 7} # value {i}" for i in range(1001)]
    (tmp_path / "log.txt").write_text("\ufeff! logger\n" + "\n".join(lines), encoding="utf-8")
    (tmp_path / "s.nml").write_text(
        "&chain n_dof = 2 friction = 0.2 /\n&excitation kind = 'file' file = 'log.txt' /\n"
        "&integration method = 'event' n_steps = 0 dt = 0.01 /\n"
    )
    assert entroslip("check", "s.nml").returncode == 0
    done = entroslip("check", "s.nml", "--set", "integration%dt=0.0101")
    assert done.returncode == 2
    rule = "time = 0.11, 0.01 after the one before: must be 0.1111, 11 times integration%dt"
    assert rule in done.stderr
    (tmp_path / "log.txt").write_text("\n".join([*lines[:500], *lines[501:]]))  # one is lost
    done = entroslip("check", "s.nml")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "log.txt:501: time = 5.01, 0.02 after the one before: must be 5.0, 500" in done.stderr


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
        ((), "no command; there are run, check, tradeoff, replay, estimate, whatif, template"),
        (("rnu", "x.nml"), "unknown command rnu, did you mean run?"),
        (("run",), "run needs a scene: entroslip run SCENE"),
        (("run", "absent.nml"), "absent.nml: no such file"),
        (("/dev/null",), "no command before /dev/null"),
        (("run", "x.nml", "y.nml"), "one file at a time: x.nml and y.nml"),
        (("run", "x.nml", "--otuput", "r.h5"), "unknown option --otuput, did you mean --output?"),
        (("run", "x.nml", "--otuput=r.h5"), "unknown option --otuput, did you mean --output?"),
        (("run", "x.nml", "--output"), "--output needs a value"),
        (("run", "x.nml", "--output="), "--output needs a value"),
        (("run", "x.nml", "--output", ""), "--output needs a value"),
        (("run", "x.nml", "--output", "x.h5 "), "--output x.h5 : must not end in a blank"),
        (("run", "x.nml", "--fresh=yes"), "--fresh takes no value"),
        (("replay", "x.nml", "--case", "0", "--sample", "1"), "--case 0: needs a whole number"),
        (("replay", "x.nml", "--case=1", "--sample=b"), "--sample b: needs a whole number"),
        (("replay", "x.nml"), "replay needs --case and --sample"),
        (("check", "x.nml", "--case", "1"), "check takes no --case, which is for replay"),
        (("check", "--output=r.h5", "x.nml"), "check takes no --output, which is for run, trade"),
        (("--set", "chain%mass=1", "template"), "template takes no --set, which is for run, che"),
        (("template", "x.nml"), "template takes no scene"),
        (("run", "x.nml", "--share", "--fresh"), "--fresh discards what others share"),
    ],
)
def test_bad_usage(entroslip, tmp_path, arguments, message):
    done = entroslip(*arguments)
    assert done.returncode == 2
    assert done.stderr.startswith(f"entroslip: {message}")
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_bad_usage_is_said_once_for_all_ranks(program, tmp_path):
    code, _, errors = Run(program, ["run", "--bogus"], tmp_path, ENVIRONMENT, n_ranks=2).wait()
    assert code == 2
    assert errors.count("entroslip:") == 1


def test_a_value_may_follow_its_option_behind_an_equals_sign(entroslip, tmp_path):
    done = entroslip("run", scene_with(tmp_path, "&chain /", "&chain /"), "--output=sub/r.h5",
                     "--set=campaign%n_samples=1", "--quiet")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"bad.nml", "sub"}
    assert (tmp_path / "sub" / "r.h5").stat().st_size > 0


def test_a_command_takes_the_options_that_completion_offers_and_no_others(entroslip):
    bash = (ROOT / "packaging/completions/entroslip.bash").read_text()
    offered = dict(re.findall(r"^ +(\w+)\) options='(.*)'", bash, re.MULTILINE))
    options = set(re.findall(r"^  (--\w+)", entroslip("--help").stdout, re.MULTILINE))
    for command, its in offered.items():
        for option in sorted(options - {"--help", "--version"}):
            value = {"--set": ["a%b=1"], "--output": ["r"], "--case": ["1"], "--sample": ["1"]}
            done = entroslip(command, option, *value.get(option, []))
            assert (f"{command} takes no {option}" in done.stderr) != (option in its.split())
            is_fine = (command, option) == ("template", "--reference")
            assert done.returncode == (0 if is_fine else 2)


def test_folders_on_the_way_to_the_output_are_made_for_a_good_scene_only(entroslip, tmp_path):
    scene = scene_with(tmp_path, "&chain /", "&chain mass = -1.0 /")
    assert entroslip("run", scene, "--output", "a/b/r.h5").returncode == 2
    scene_with(tmp_path, "&chain /", "&chain /")
    done = entroslip("check", scene, "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.nml"]


def test_nothing_but_its_own_earlier_output_is_replaced(entroslip, tmp_path):
    scene = scene_with(tmp_path, "n_samples = 6", "n_samples = 2")
    (tmp_path / "p.nml").write_text("&process correlation_length = 1 order = 1 mean = 2 std = 1 /")
    replay, tradeoff = ("replay", scene, "--case=3", "--sample=2"), ("tradeoff", "p.nml")
    assert entroslip("run", scene, "--output=run.h5").returncode == 0
    assert entroslip(*replay, "--output=replay.h5").returncode == 0
    assert entroslip(*tradeoff, "--output=tradeoff.h5").returncode == 0
    contents = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    commands = [("run", scene), ("run", scene, "--fresh"), replay, tradeoff]
    for command in commands:
        for output in contents:
            if output == f"{command[0]}.h5":
                continue
            done = entroslip(*command, f"--output={output}")
            assert done.returncode == 3, (command, output)
            assert len(done.stderr.splitlines()) == 1
            if output.endswith(".h5"):
                assert f"{output} was written by entroslip {output[:-3]}" in done.stderr
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == contents
    assert entroslip(*replay, "--output=replay.h5").returncode == 0
    assert entroslip("run", scene, "--output=run.h5", "--fresh").returncode == 0


def test_no_run_replaces_a_file_that_it_cannot_read(entroslip, tmp_path):
    """Half of a results file names what to do; a file of another program is refused as such."""
    (tmp_path / "p.nml").write_text("&process correlation_length = 1 order = 1 mean = 2 std = 1 /")
    run = ("run", "p.nml", "--output")
    assert entroslip(*run, "whole.h5").returncode == 0
    half = (tmp_path / "whole.h5").read_bytes()[:4000]
    foreign = "was not written by this program"
    for content, words in ((half, "or remove it"), (b"", foreign), (b"x", foreign)):
        (tmp_path / "r.h5").write_bytes(content)
        for options in ((), ("--fresh",)):
            done = entroslip(*run, "r.h5", *options)
            assert done.returncode == 3
            assert words in done.stderr
            assert (tmp_path / "r.h5").read_bytes() == content


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
    for words in (("help",), ("run", "--help"), ("--help", "replay"), ("run", "-h", "--nonsense")):
        assert entroslip(*words).stdout == shown.stdout
    version = entroslip("--version")
    assert version.returncode == 0
    for word in ("HDF5", "FFTW", "LAPACK", "MPI", "GCC", "-O3"):
        assert word in version.stdout
    template = entroslip("template")
    (tmp_path / "template.nml").write_text(template.stdout)
    assert entroslip("check", "template.nml").returncode == 0
