"""The installed package: complete, found by projects of their own, packaged for Debian."""

from __future__ import annotations

import os
import re
import shutil
import subprocess

import pytest

from tests.conftest import PROGRAM, ROOT

BUILD = PROGRAM.parent.parent
EXAMPLE = ROOT / "examples/library"
COMPLETIONS = ("entroslip.bash", "_entroslip", "entroslip.fish")


def run(*command, **options):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def prefix(program, tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed") / "prefix"
    run("cmake", "--install", BUILD, "--prefix", folder)
    return folder


def test_everything_is_in_place(prefix):
    for path in (
        "bin/entroslip",
        "include/entroslip/process/process_fit.mod",
        "share/man/man1/entroslip.1",
        "share/bash-completion/completions/entroslip",
        "share/zsh/site-functions/_entroslip",
        "share/fish/vendor_completions.d/entroslip.fish",
        "share/doc/entroslip/README.md",
        "share/doc/entroslip/docs/index.md",
        "share/entroslip/input/paper.nml",
        "share/entroslip/examples/library/CMakeLists.txt",
    ):
        assert (prefix / path).exists(), path
    for name in (
        "libentroslip_core.a",
        "pkgconfig/entroslip.pc",
        "entroslip/entroslipConfig.cmake",
    ):
        assert list(prefix.glob(f"lib*/**/{name}")), name
    assert "entroslip" in run(prefix / "bin/entroslip", "--version")


def check_scatter(table):
    """Before the first slip the contact is a spring of 20 x 50 N/m."""
    rows = [[float(word) for word in line.split()] for line in table.splitlines()[1:]]
    assert rows[1][1] == pytest.approx(10.0, abs=0.2)
    assert rows[-1][1] == pytest.approx(20 * 0.2 * 10.0, rel=0.02)  # 400 x 20 coefficients
    assert rows[-1][2] > 3 * rows[1][2] > 0.0


def test_the_example_finds_the_library_by_cmake(prefix, tmp_path):
    """With the commands of its CMakeLists.txt, by Ninja. In a folder whose name has a blank h5fc
    fails, and CMake then lists also a library that it has not found."""
    folder = tmp_path / "a folder"
    shutil.copytree(EXAMPLE, folder / "examples/library")
    project = folder / "examples/library/CMakeLists.txt"
    lines = re.findall(r"^#    (.+)", project.read_text(), re.MULTILINE)
    with project.open("a") as file:
        file.write("get_target_property(found entroslip::hdf5 INTERFACE_LINK_LIBRARIES)\n")
        file.write('message(STATUS "HDF5 is ${found}")\n')
    commands = "\n".join(lines).replace("<where entroslip is installed>", str(prefix))
    printed = run("bash", "-ec", commands, cwd=folder)
    check_scatter(printed.partition("displacement")[2])
    assert (folder / "build/example/build.ninja").exists()
    (found,) = re.findall("HDF5 is (.+)", printed)
    assert "hdf5" in found
    assert "NOTFOUND" not in found


@pytest.mark.skipif(not shutil.which("pkg-config"), reason="pkg-config is not installed")
def test_the_example_finds_the_library_by_pkg_config(prefix, tmp_path):
    (folder,) = prefix.glob("lib*/**/pkgconfig")
    flags = run(
        "pkg-config", "--cflags", "--libs", "entroslip",
        env=os.environ | {"PKG_CONFIG_PATH": str(folder)},
    )  # fmt: skip
    source = EXAMPLE / "friction_of_a_contact.f90"
    run("gfortran", source, "-o", tmp_path / "example", *flags.split(), cwd=tmp_path)
    check_scatter(run(tmp_path / "example"))


@pytest.fixture(scope="module")
def words(program):
    """Commands and options in --help."""
    return re.findall(r"^  (-*\w+)", run(program, "--help"), re.MULTILINE)


def test_the_man_page_has_every_command_and_option(words):
    page = (ROOT / "packaging/entroslip.1").read_text().replace("\\-", "-")
    found = re.findall(r"^\.TP\n\.BI? (-*\w+)", page, re.MULTILINE)
    assert [word for word in found if word in words] == words
    assert {word for word in found if word.startswith("-")} <= set(words)


@pytest.mark.parametrize("name", COMPLETIONS)
def test_completion_knows_every_command_and_option(words, name):
    text = (ROOT / "packaging/completions" / name).read_text()
    for word in words:
        stem = word.removeprefix("--")
        assert re.search(rf"(?<![\w-])(?:{word}|-l {stem})\b", text), word


def test_completion_in_bash():
    script = f"""
        source {ROOT}/packaging/completions/entroslip.bash
        compopt() {{ printf '%s: ' "$2"; }}
        complete_words() {{
          COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
          _entroslip {PROGRAM} "${{COMP_WORDS[COMP_CWORD]}}" "${{COMP_WORDS[COMP_CWORD - 1]}}"
          echo "${{COMPREPLY[@]}}"
        }}
        complete_words entroslip re
        complete_words entroslip replay --s
        complete_words entroslip run small
        complete_words entroslip run smallest.nml --output bat
        complete_words entroslip run smallest.nml --set campaign%n
    """
    lines = run("bash", "-c", script, cwd=ROOT / "input").splitlines()
    assert lines == [
        "replay", "--set --sample", "filenames: smallest.nml", "filenames: batch",
        "nospace: campaign%n_samples=",
    ]  # fmt: skip


@pytest.mark.skipif(not shutil.which("fish"), reason="fish is not installed")
def test_completion_in_fish():
    source = f"source {ROOT}/packaging/completions/entroslip.fish"

    def offered(line):
        script = f"{source}; complete -C '{line}'"
        found = run("fish", "--no-config", "-c", script, cwd=ROOT / "input").splitlines()
        # fish 4 also offers what only contains the word
        choices = [choice.partition("\t")[0] for choice in found]
        return [choice for choice in choices if choice.startswith(line.split()[-1])]

    assert offered("entroslip re") == ["replay"]
    assert offered("entroslip replay --s") == ["--sample", "--set"]
    assert offered("entroslip run small") == ["smallest.nml"]


#: zsh completes on a terminal only: this gives it one, and waits for $3 among the choices
ZSH_AT_A_TERMINAL = r"""
zmodload zsh/zpty
zpty shell zsh -f -i
zpty -w shell "PS1=; stty -echo cols 200; fpath=($1 \$fpath); autoload -Uz compinit; compinit -D -u"
zpty -w shell 'zle -C choices .list-choices _main_complete; bindkey "^X^L" choices; print re""ady'
zpty -r shell out '*ready*'
zpty -w -n shell "$2"$'\C-x\C-l'
zpty -r shell out "*$3*"
print -r -- $out
"""


@pytest.mark.skipif(not shutil.which("zsh"), reason="zsh is not installed")
@pytest.mark.parametrize(
    ("line", "wanted", "others"),
    [
        ("entroslip re", "replay", ["run", "template"]),
        ("entroslip replay --s", "--sample", ["--quiet", "--share"]),
        ("entroslip run --s", "--share", ["--quiet", "--sample"]),
        ("entroslip run small", "smallest.nml", ["paper.nml"]),
    ],
)
def test_completion_in_zsh(line, wanted, others):
    folder = ROOT / "packaging/completions"
    out = run(
        "zsh", "-f", "-c", ZSH_AT_A_TERMINAL, "zsh", folder, line, wanted,
        cwd=ROOT / "input", timeout=300,
    )  # fmt: skip
    assert not [other for other in others if other in out.replace(line, "")]


@pytest.mark.skipif(
    not (shutil.which("dpkg-buildpackage") and shutil.which("dh")),
    reason="dpkg-buildpackage and debhelper are not installed",
)
def test_the_debian_package_builds(tmp_path):
    source = tmp_path / "entroslip"
    shutil.copytree(
        ROOT, source, ignore=shutil.ignore_patterns("build", "results", ".git", ".venv", "*.h5")
    )
    (source / "debian").symlink_to("packaging/debian")
    # the flags are the release build's; a package that nobody installs is not compressed
    quick = os.environ | {
        "DEB_BUILD_OPTIONS": "noopt noautodbgsym nostrip",
        "DEB_FFLAGS_STRIP": "-g",
        "DPKG_DEB_COMPRESSOR_TYPE": "none",
    }
    run("dpkg-buildpackage", "--build=binary", "--no-sign", cwd=source, env=quick)
    (package,) = tmp_path.glob("entroslip_*.deb")
    listed = run("dpkg-deb", "--contents", package)
    for path in ("/usr/bin/entroslip", "/usr/share/man/man1/entroslip.1", "/usr/share/entroslip/"):
        assert path in listed, path


def test_an_instruction_set_that_the_compiler_lacks_is_named(tmp_path):
    command = ["cmake", "-S", ROOT, "-B", tmp_path, "-G", "Ninja", "-DENTROSLIP_ARCH=none"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "ENTROSLIP_ARCH = none: must be a value of -march=" in done.stderr


def test_a_missing_nlopt_is_named_with_the_way_without_tests(tmp_path):
    """As a script, that finds no library."""
    script = tmp_path / "tests.cmake"
    script.write_text(
        "set(CMAKE_FIND_LIBRARY_SUFFIXES .none)\nfunction(add_floor_tests)\nendfunction()\n"
        f"include({ROOT}/tests/process/CMakeLists.txt)\n"
    )
    done = subprocess.run(["cmake", "-P", script], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "-DBUILD_TESTING=OFF" in done.stderr


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no clone of the repository")
def test_the_commit_is_known_where_another_user_owns_the_source(tmp_path):
    """Git refuses such a folder, so results named no commit."""
    script = tmp_path / "commit.cmake"
    script.write_text(
        "macro(set_property)\nendmacro()\n"  # a script has no folders that it configures
        f'include("{ROOT}/cmake/BuildInfo.cmake")\nmessage("commit ${{ENTROSLIP_GIT_COMMIT}}")\n'
    )
    done = subprocess.run(
        ["cmake", f"-DPROJECT_SOURCE_DIR={ROOT}", "-DENTROSLIP_ARCH=x86-64", "-P", script],
        capture_output=True, text=True, check=True,
        env=os.environ | {"GIT_TEST_ASSUME_DIFFERENT_OWNER": "1"},
    )  # fmt: skip
    assert "commit unknown" not in done.stderr
    assert "commit " in done.stderr
