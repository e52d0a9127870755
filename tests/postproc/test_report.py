"""The report: one file that needs nothing else, and reads well in a browser."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace

import matplotlib.pyplot as plt
import pytest

from entroslip.__main__ import main
from entroslip.figures.figure import Figure
from entroslip.paper.statements import assess
from entroslip.report import write_report
from entroslip.table import Table
from tests.postproc.synthetic import friction_study

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--enable-logging=stderr", "--window-size=1200,3000",
]  # fmt: skip


@pytest.fixture(scope="module")
def page(drawn):
    return (drawn / "report.html").read_text()


def test_it_needs_no_other_file_and_no_network(page):
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert "url(" not in page
    assert "<script" not in page


def test_it_has_what_was_asked_and_what_came_out(page):
    for text in ("Table 1", "Table 2", "36", "&amp;process", "Fig. 11a", "seed 7"):
        assert text in page
    images = re.findall(r"<img [^>]*>", page)
    assert len(images) == 8
    assert all(re.search(r'alt="[^"]{40,}"', image) for image in images)


def test_every_link_of_the_contents_leads_somewhere(page):
    links = re.findall(r'href="#([^"]+)"', page)
    assert len(links) > 10
    assert set(links) <= set(re.findall(r'id="([^"]+)"', page))


def test_verdicts_stand_in_table_and_captions(tmp_path):
    """Every statement with its test, and at the figures that show it."""
    study = friction_study(n_samples=20)
    statements = assess([study])
    picture = plt.figure(figsize=(1, 1))
    picture.savefig(tmp_path / "f.png")
    plt.close(picture)
    figure = Figure("f", "Fig. 9a. Title", "Caption.", "The friction study", (), ("1a", "1b"))
    write_report(
        [study], statements, [], [(figure, tmp_path / "f.png")], tmp_path / "report.html"
    )  # fmt: skip
    page = (tmp_path / "report.html").read_text()
    for statement in statements:
        assert f'id="statement-{statement.number}"' in page
        assert statement.claim in page
    caption = re.search(r"<figcaption>.*</figcaption>", page).group()
    assert caption.count('class="verdict') == 2
    assert "key observation (iii)" in page
    assert "Bonferroni" in page


def test_scenes_are_named_where_there_are_several(tmp_path):
    study = friction_study(n_samples=20)
    statements = assess([study])
    other = [replace(statements[0], scene="another"), *statements[1:]]
    for decided, is_named in ((statements, False), (other, True)):
        write_report([study], decided, [], [], tmp_path / "report.html")
        assert ("Scene: synthetic." in (tmp_path / "report.html").read_text()) == is_named


def test_a_note_of_several_tables_in_turn_stands_once(tmp_path):
    tables = [
        Table(f"t{i}", "Title", ("a",), (("1",),), note, is_result=True)
        for i, note in enumerate(("Same.", "Same.", "Other.", "Same."))
    ]
    write_report([friction_study(n_samples=20)], [], tables, [], tmp_path / "report.html")
    notes = re.findall(r'<p class="note">(\w+\.)</p>', (tmp_path / "report.html").read_text())
    assert notes == ["Same.", "Other.", "Same."]


@pytest.mark.skipif(not shutil.which("chromium"), reason="chromium is not installed")
def test_it_opens_in_a_browser(drawn, page, tmp_path):
    """No message on the console, and every image has a size there."""
    probe = (
        "<script>addEventListener('load', () => { for (const image of document.images)"
        " console.log('image', image.complete, image.naturalWidth > 100, image.alt.length); })"
        "</script></body>"
    )
    for name, text in (("plain", page), ("probed", page.replace("</body>", probe))):
        (tmp_path / f"{name}.html").write_text(text)
        shot = tmp_path / f"{name}.png"
        done = subprocess.run(
            ["chromium", *FLAGS, f"--user-data-dir={tmp_path}/profile", f"--screenshot={shot}",
             (tmp_path / f"{name}.html").as_uri()],
            capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip
        assert done.returncode == 0
        said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
        if name == "plain":
            assert said == []
        else:
            assert len(said) == page.count("<img ")
            assert all("image true true" in line for line in said)
    assert plt.imread(shot).std() > 0.01


OWN = """\
&scene title = 'bracket' /
&process correlation_length = 1.0 order = 2 mean = 0.3 std = 0.1 /
&chain n_dof = 4 mass = 2.0, 1.0, 1.0, 1.0 /
&excitation variance = 3.7, 41.1 dof = 2 /
&integration method = 'event' n_steps = 2000 /
&campaign n_samples = 4 deterministic = .true. /
&output segment_length = 256 /
"""


def test_a_report_on_ones_own_structure_opens_with_its_results(results_of_scene, tmp_path):
    """Slip of the joints, then figures, then processes; nothing of the paper's."""
    assert main([str(results_of_scene(OWN)), "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text().split("</style>")[1]
    chapters = re.findall(r"<h2>([^<]+)</h2>", page)
    assert chapters[:2] == ["How much the joints slip", "The friction study"]
    first = page.split("<h2>")[1]
    assert "Mean time in slip of the joints [%]" in first
    assert "Time in slip, deterministic friction [%]" in first
    assert not re.search(r"paper|Fig\. \d|Table \d|oscillator|confirmed", page)
    assert {"along_slip.png", "joints.csv"} <= {path.name for path in tmp_path.iterdir()}
    assert not (tmp_path / "statements.csv").exists()
