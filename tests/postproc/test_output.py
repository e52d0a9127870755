"""Any bytes come out, and what cannot be written ends in one line with its exit code."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest

from entroslip import open_results
from entroslip.__main__ import main
from entroslip.output import OutputError, readable, write_file
from entroslip.results import ResultsError
from tests.program.terminal import said_on_a_terminal

PROCESSES = "&process correlation_length = 0.3 order = 2 mean = 0.0 std = 1.0 positive = .false."


@pytest.fixture(scope="module")
def process_file(results_of_scene):
    return results_of_scene(f"{PROCESSES} /\n")


def run(*words, limit=None, **changed):
    """The command, with words, a largest size of a file [bytes] and variables of environment."""

    def limit_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.run(
        [sys.executable, "-m", "entroslip", *map(os.fsencode, words)],
        stderr=subprocess.PIPE, stdout=changed.pop("stdout", subprocess.PIPE),
        preexec_fn=limit_files if limit else None, env=os.environ | changed, check=False,
    )  # fmt: skip


def one_line(done, code):
    assert done.returncode == code, done.stderr.decode()
    (line,) = done.stderr.decode().splitlines()
    return line


def test_latin_1_of_a_scene_reaches_the_report(results_of_scene, tmp_path):
    """As editors of Windows store it, in a comment and in the title."""
    scene = f"! Br\xfccke, 5 \xb5m\n&scene title = 'Tr\xe4ger' /\n{PROCESSES} /\n"
    path = results_of_scene(scene.encode("latin-1"))
    assert main([str(path), "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "! Brücke, 5 µm" in page
    assert "<h1>Träger</h1>" in page


def test_a_title_of_fixed_bytes_is_read(process_file, tmp_path):
    path = shutil.copy(process_file, tmp_path / "fixed.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["title"] = np.bytes_("Träger".encode("latin-1"))
    assert open_results(path).title == "Träger"


def test_bytes_are_read_as_what_they_are():
    assert readable("µ".encode()) == readable("µ".encode("latin-1")) == "µ"
    assert readable("\udcfc") == "ü"
    assert readable(b"\x81") == "\ufffd"  # no letter anywhere


def test_a_file_name_that_is_not_utf8_is_drawn(process_file, tmp_path):
    """In a folder of such a name, on a terminal that shows ASCII alone."""
    names = [os.fsdecode(b"Br\xfccke.h5"), os.fsdecode(b"Br\xfccke 2.h5")]
    paths = [shutil.copy(process_file, tmp_path / name) for name in names]
    out = tmp_path / os.fsdecode(b"\xfcber")
    done = run(*paths, "--out", out, PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert b"ber/report.html" in done.stdout
    assert b"drawing" not in done.stdout  # what a terminal shows
    assert (out / "fig_02a_Brücke 2.pdf").exists()
    assert 'id="fig_02a_Brücke 2"' in (out / "report.html").read_text(encoding="utf-8")


def test_the_backend_of_the_user_does_not_matter():
    assert run("--help", MPLBACKEND="nonsense").returncode == 0


@pytest.mark.parametrize("limit", [100, 20_000])
def test_a_full_disk_is_one_line(process_file, tmp_path, limit):
    """Tables or pictures do not fit; what is there is whole."""
    done = run(process_file, "--out", tmp_path, limit=limit)
    line = one_line(done, 3)
    assert line.startswith(f"{tmp_path}/")
    assert line.endswith(": cannot be written: File too large")
    assert not list(tmp_path.glob("*.part"))
    assert not (tmp_path / "report.html").exists()


def test_a_file_is_whole_or_as_before(tmp_path):
    path = tmp_path / "a"
    write_file(path, b"before")
    (tmp_path / "a.part").mkdir()
    with pytest.raises(OutputError, match=r"a: cannot be written: Is a directory"):
        write_file(path, b"after")
    assert path.read_bytes() == b"before"


def test_a_full_output_is_one_line(process_file, tmp_path):
    with open("/dev/full", "w") as full:
        line = one_line(run(process_file, "--out", tmp_path, stdout=full), 3)
        assert line == "standard output: cannot be written: No space left on device"


def test_no_standard_output_is_one_line():
    words = ["entroslip.structure", "chain", "--masses", "3"]
    done = subprocess.run(
        [sys.executable, "-m", *words], stderr=subprocess.PIPE, text=True, check=False,
        preexec_fn=lambda: os.close(1),
    )  # fmt: skip
    assert done.returncode == 3
    assert done.stderr == "standard output: cannot be written: Bad file descriptor\n"


def test_all_tables_are_counted(drawn):
    """The table of the paper's statements too."""
    tables = {path.name for path in drawn.glob("*.csv")}
    assert "statements.csv" in tables
    assert f"figures and {len(tables)} tables in" in (drawn.parent / "said").read_text()


def test_axes_of_no_use_are_refused(results_file, tmp_path, capsys):
    """A frequency that is no number, an axis without values."""
    path = shutil.copy(results_file, tmp_path / "spoilt.h5")
    for axis, spoil, rule in (
        ("frequency", np.nan, "is an axis with a value that is no number"),
        ("percentile", None, "is an axis without values"),
    ):
        shutil.copy(results_file, path)
        with h5py.File(path, "r+") as file:
            case = file["campaign/c003"]
            if spoil is not None:
                case[axis][3] = spoil
            else:
                empty_axis(case, axis)
        with pytest.raises(ResultsError, match=f"/campaign/c003/{axis}: {rule}"):
            open_results(path)
        assert main([str(path), "--out", str(tmp_path / "out")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def empty_axis(case, axis):
    """The same group with no value along an axis."""
    along = [
        name for name, item in case.items()
        if isinstance(item, h5py.Dataset) and any(axis in list(dim) for dim in item.dims)
    ]  # fmt: skip
    for name in [axis, *along]:
        del case[name]
    case[axis] = np.zeros(0)
    case[axis].make_scale(axis)


def test_ctrl_c_ends_it_without_a_traceback():
    code = (  # where tests run in the background, SIGINT is ignored
        "import signal\nfrom entroslip.output import exit_code\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "exit_code(lambda: signal.raise_signal(signal.SIGINT))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, b"")


def test_ctrl_c_during_the_imports_ends_it_without_a_traceback(tmp_path):
    (tmp_path / "h5py.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\n")
    done = subprocess.run(
        [sys.executable, "-m", "entroslip", "x.h5", "--out", "x"], capture_output=True, check=False,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (-signal.SIGINT, b"")


def test_a_reader_that_ends_early_is_no_error_to_speak_of():
    """`... | head` printed `standard output: cannot be written: Broken pipe`."""
    reader, writer = os.pipe()
    os.close(reader)
    done = run("--help", stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (3, b"")


def test_a_terminal_shows_which_figure_is_drawn(process_file, tmp_path):
    """28 figures of five files took 79 s without a word."""
    words = [sys.executable, "-m", "entroslip", process_file, "--out", tmp_path]
    code, text = said_on_a_terminal(words, "stdout")
    shown = text.rstrip().split("\r\x1b[K")
    n_figures = int(shown[-1].split()[0])
    assert code == 0
    assert shown[1] == f"drawing figure 1 of {n_figures}"
    assert shown[-1].endswith("report.html")  # in the place of the last one
