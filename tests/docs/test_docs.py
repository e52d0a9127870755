"""The documentation: nothing stale, no dead links, no command that is not there."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ENVIRONMENT, ROOT

sys.path.insert(0, str(ROOT / "docs"))
import generate

PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
SOURCES = [*ROOT.glob("src/**/*.f90"), *ROOT.glob("drivers/*.f90"), *ROOT.glob("postproc/**/*.py")]
page_by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def anchors(page: Path) -> set[str]:
    """Targets of links into a page: its headings, as Markdown names them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def code_in(page: Path) -> str:
    """Indented and fenced lines, and what stands in backticks; continued lines joined."""
    text = page.read_text().partition(generate.MARKER)[0].replace("\\\n", " ")
    blocks = re.findall(r"^(?:    |\t)(.*)$", text, re.MULTILINE)
    blocks += re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return "\n".join([*blocks, *re.findall(r"`([^`\n]+)`", text)])


@page_by_page
def test_relative_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.exists(), target
        assert not anchor or anchor in anchors(path), target


def test_every_page_is_reached_from_the_index():
    linked = set(re.findall(r"\]\(([^)#\s]+)", (ROOT / "docs/index.md").read_text()))
    assert {page.name for page in (ROOT / "docs").glob("*.md")} - linked == {"index.md"}


@pytest.fixture(scope="module")
def vocabulary(program):
    """Commands, options and group%name of scenes, as the program itself lists them."""

    def said(*arguments):
        return subprocess.run([program, *arguments], capture_output=True, text=True).stdout

    names = set()
    for group, table in re.findall(r"^## &(\w+)\n(.*?)(?=^## |\Z)", said("template", "--reference"),
                                   re.MULTILINE | re.DOTALL):  # fmt: skip
        names |= {f"{group}%{name}" for name in re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)}
    rows = re.findall(r"^  (-*\w+)", said("--help"), re.MULTILINE)
    return {
        "commands": {row for row in rows if not row.startswith("-")},
        "options": {row for row in rows if row.startswith("-")},
        "names": names,
    }


@page_by_page
def test_commands_options_and_names_exist(page, vocabulary):
    code = code_in(page)
    is_program = r"(?:^|(?<!-m)(?<!from)(?<!import)[\s/])entroslip"  # not the Python package
    for line in re.findall(rf"{is_program} +((?:[a-z]+|--)[^\n;|]*)", code):
        words = line.partition(" #")[0].split()
        if not words[0].startswith("-"):
            assert words[0] in vocabulary["commands"], line
        options = {word for word in words if word.startswith("--") and word != "--"}
        assert options <= vocabulary["options"], line
    groups = {name.partition("%")[0] for name in vocabulary["names"]}
    for group, name in re.findall(r"\b([a-z]+)%(\w+)", code):
        if group in groups:
            assert f"{group}%{name}" in vocabulary["names"], f"{group}%{name}"


@page_by_page
def test_named_files_are_there(page):
    folders = "input|src|drivers|tests|scripts|bench|docs|examples|packaging|cmake|postproc"
    for path in re.findall(rf"(?<![\w./])(?:{folders})/[\w./-]*\w", code_in(page)):
        assert (ROOT / path).exists(), path


def test_generated_pages_are_what_the_program_says(program):
    for path, text in generate.pages(program).items():
        assert path.read_text() == text, (
            f"stale: {path.name}; python docs/generate.py {program} writes it anew"
        )


def quoted_messages() -> list[list[str]]:
    """The messages of docs/troubleshooting.md, each cut where dots stand for what differs."""
    page = (ROOT / "docs/troubleshooting.md").read_text()
    cells = re.findall(r"^\| (`[^|]+) \|", page, re.MULTILINE)
    quoted = [message for cell in cells for message in re.findall(r"`([^`]+)`", cell)]
    return [[part.strip(" :") for part in message.split("...")] for message in quoted]


def joined(path: Path) -> str:
    """The source with continued lines and texts on one line."""
    return re.sub(r"'\s*//\s*'", "", re.sub(r"&\s*\n\s*", "", path.read_text()))


def test_troubleshooting_quotes_messages_that_exist():
    source = "".join(joined(path) for path in SOURCES)
    for parts in quoted_messages():
        assert all(part in source for part in parts), parts


def raised_messages() -> list[str]:
    """The fixed words of every message that the sources raise; the rest is values."""
    call = r"call \S*?(?:raise|raise_system|add_general|require|complain|conclude)\((.*)"
    arguments = [found for path in SOURCES for found in re.findall(call, joined(path))]
    texts = [re.findall(r"'((?:[^']|'')*)'|\"([^\"]*)\"", found) for found in arguments]
    return [" ".join(one or other for one, other in found) for found in texts]


def test_troubleshooting_has_every_message():
    """But those that say their rule themselves, `name = value: must ...`, `needs ...`."""
    quoted = quoted_messages()
    messages = [
        message
        for message in raised_messages()
        if len(re.findall(r"[a-z]{2,}", message)) > 2
        and not re.search(r"\b(must|needs)\b", message)
    ]
    assert len(messages) > 60
    for message in messages:
        assert any(all(part in message for part in parts) for parts in quoted), message


@pytest.fixture
def as_written(program, tmp_path):
    """Runs the lines of a page in a folder that looks like that of the source; what they print."""
    (tmp_path / "input").symlink_to(ROOT / "input")
    (tmp_path / "build/release").mkdir(parents=True)
    (tmp_path / "build/release/bin").symlink_to(program.parent)
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/python").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (tmp_path / ".venv/bin/python").chmod(0o755)

    def run(lines):
        (tmp_path / "lines.sh").write_text(lines)
        done = subprocess.run(
            ["bash", "-e", "lines.sh"], cwd=tmp_path, capture_output=True, text=True, check=False,
            env=ENVIRONMENT | {"OMPI_MCA_rmaps_base_oversubscribe": "1"},
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def test_first_run_works_as_written(as_written, tmp_path):
    page = (ROOT / "docs/first_run.md").read_text()
    said = as_written("".join(re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)))
    assert "nothing to do" in said
    assert (tmp_path / "figures/report.html").exists()


def test_a_structure_of_ones_own_works_as_written(as_written, tmp_path):
    """Natural frequencies and levels are those that the page speaks of."""
    page = (ROOT / "docs/own_structure.md").read_text()
    said = as_written("".join(re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)))
    (frequencies,) = re.findall(r"`(\d+ to .* slipping)`", page)
    assert frequencies in said
    assert (tmp_path / "joints/report.html").exists()
    rows = csv.DictReader((tmp_path / "change/comparison.csv").open())
    slip = [row for row in rows if row["statistic"].startswith("mean time in slip")]
    assert len(slip) == 4
    for row in slip:
        assert float(row["change"]) < -4 * float(row["change standard error"])


def test_measured_joints_lead_to_a_decision_as_written(as_written, tmp_path):
    """At most ten commands and edits; the tip's joint is the one, and what it does turns round."""
    page = (ROOT / "docs/measured_joints.md").read_text()
    assert len(re.findall(r"\*\*\d+\.|and \d+\. ", page)) == 8
    said = as_written("".join(re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)))
    assert "8.36 to" in said
    assert "36.1 to" in said
    assert (tmp_path / "beam/figures/report.html").exists()
    rows = list(csv.DictReader((tmp_path / "beam/which/designs.csv").open()))
    assert len(rows) == 12
    change = [float(row["rms of dof 4 [%]"]) for row in rows]
    assert rows[3]["design"] == "tight_4"  # the largest rise at the smallest level
    assert change[3] > 1.0
    assert rows[8]["design"] == "tight_4"  # the largest fall at the largest
    assert change[8] < -1.0


def test_python_works_as_written(as_written, tmp_path):
    """The blocks of the page, on the results of its scene."""
    page = (ROOT / "docs/python.md").read_text()
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    ):
        (tmp_path / f"block_{number}.py").write_text(block)
    said = as_written(
        "build/release/bin/entroslip run input/smallest.nml --output smallest.h5\n"
        "build/release/bin/entroslip replay input/smallest.nml --case 1 --sample 3"
        " --output one.h5\n"
        "export PYTHONPATH=$PWD MPLBACKEND=agg\n"
        "for block in block_*.py; do .venv/bin/python $block; done\n"
    )
    assert "fraction of time in slip" in said
    assert (tmp_path / "mine.pdf").exists()
    assert (tmp_path / "rod/scene.nml").exists()


def test_the_readme_works_as_written(as_written, tmp_path):
    page = (ROOT / "README.md").read_text()
    (scene,) = re.findall(r"^```fortran\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "smallest.nml").write_text(scene)
    as_written("\n".join(re.findall(r"^    (.*smallest.*)$", page, re.MULTILINE)))
    assert (tmp_path / "smallest_c001_s0003.h5").exists()
    assert (tmp_path / "figures/report.html").exists()
