"""The house: laid out and linted by tools whose settings are committed, public things explained."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

CODE = ["src", "drivers", "bench", "examples"]
MODULES = sorted([*ROOT.glob("src/**/*.f90"), *ROOT.glob("drivers/*.f90")])


def tool(name: str) -> str:
    """A program of tests/requirements.txt, beside this Python."""
    found = shutil.which(name, path=str(Path(sys.executable).parent))
    if not found:
        pytest.skip(f"{name} is not installed (tests/requirements.txt)")
    return found


def complaints(*command: object) -> str:
    done = subprocess.run(
        [str(word) for word in command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr if done.returncode or done.stdout else ""


#: fprettify looks at each character by two regular expressions, which takes half of its time. A
#: line without strings, comments and directives needs none.
QUICK_FPRETTIFY = r"""
import re
import fprettify

is_special = re.compile("[\"'!#${}@]").search

def characters(line):
    return line if line.instring() or is_special(line._content) else line._it

fprettify.CharFilter.__iter__ = characters
fprettify.run()
"""


def test_fortran_is_laid_out_by_fprettify(tmp_path):
    tool("fprettify")
    for folder in CODE:
        shutil.copytree(ROOT / folder, tmp_path / folder)
    # with a wider page than ours, or lines that reach its edge may be indented less
    options = ["--config-file", ROOT / ".fprettify.rc", "--line-length", "132", "--silent"]
    folders = map(tmp_path.joinpath, CODE)
    complaints(sys.executable, "-c", QUICK_FPRETTIFY, *options, "--recursive", *folders)
    moved = []
    for path in (path for folder in CODE for path in sorted((ROOT / folder).rglob("*.f90"))):
        ours = path.read_text().splitlines()
        theirs = (tmp_path / path.relative_to(ROOT)).read_text().splitlines()
        for number, (line, wanted) in enumerate(zip(ours, theirs, strict=True)):
            # where its alignment would leave the page, it indents continued lines as it can
            is_continued = number > 0 and re.search(r"&\s*(!.*)?$", ours[number - 1])
            if line != wanted and not (is_continued and line.strip() == wanted.strip()):
                moved.append(f"{path.relative_to(ROOT)}:{number + 1}: {wanted}")
    assert moved == []


def test_fortran_passes_fortitude():
    said = complaints(tool("fortitude"), "check", "--output-format", "concise", *CODE)
    assert "All checks passed!" in said, said


def test_python_passes_ruff():
    assert "All checks passed!" in complaints(tool("ruff"), "check", ".")
    assert "would be reformatted" not in complaints(tool("ruff"), "format", "--check", ".")


def undocumented(module: Path) -> list[str]:
    """Public procedures, types and interfaces without a comment for their reader."""
    text = re.sub(r"&\s*\n\s*&?", " ", module.read_text())
    public = {
        name
        for names in re.findall(r"^   public ::(.*)$", text, re.MULTILINE)
        for name in re.findall(r"\w+", names)
    }
    missing = [] if text.startswith("!>") else [module.stem]
    procedure = r"(?:\w[\w() =*]* )?(?:subroutine|function)"
    kinds = rf"{procedure}|(?:abstract )?interface|type(?:, [\w, ()]+)? ::"
    lines = text.splitlines()
    for number, line in enumerate(lines):
        found = re.match(rf"   (?!end )(?:{kinds}) (\w+)", line)
        if found and found[1] in public and not re.match(r"\s*![>!]", lines[number - 1]):
            missing.append(f"{module.relative_to(ROOT)}: {found[1]}")
    return missing


def test_every_public_thing_is_explained():
    assert [name for module in MODULES for name in undocumented(module)] == []


def test_the_api_pages_build_offline(tmp_path):
    quick = ("--quiet", "--config", "source = false")
    said = complaints(tool("ford"), *quick, "-o", tmp_path, ROOT / "docs/ford.md")
    assert "warning" not in said.lower(), said
    pages = {path.stem for path in (tmp_path / "module").glob("*.html")}
    floors = [path for path in MODULES if path.parent.name != "drivers"]
    places = [path.relative_to(ROOT / "src").with_suffix("") for path in floors]
    assert {"_".join(place.parts) for place in places} <= pages


def test_all_files_state_one_version():
    """What `--version` and results say is the section of the changelog that describes it."""
    stated = {
        name: re.search(pattern, (ROOT / name).read_text(), re.MULTILINE)[1]
        for name, pattern in {
            "CMakeLists.txt": r"^  VERSION ([\d.]+)",
            "CHANGELOG.md": r"^## ([\d.]+)",
            "CITATION.cff": r"^version: ([\d.]+)",
            "packaging/debian/changelog": r"^entroslip \(([\d.]+)-",
            "pyproject.toml": r'^version = "([\d.]+)"',
        }.items()
    }
    assert len(set(stated.values())) == 1, stated


def test_no_vector_form_of_a_mathematical_function_is_linked(program):
    """Their last bits depend on the place of an array in memory."""
    if shutil.which("nm") is None:
        pytest.skip("no nm")
    symbols = subprocess.run(["nm", "-D", program], capture_output=True, text=True, check=True)
    assert "exp" in symbols.stdout
    assert not [line for line in symbols.stdout.splitlines() if "_ZGV" in line]
