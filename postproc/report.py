"""One self-contained page: results or the paper's statements, tables, figures, the scenes."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from importlib import resources
from itertools import zip_longest
from pathlib import Path

from .figures.figure import SECTIONS, Figure
from .output import write_file
from .paper.evidence import Statement, Verdict
from .paper.printed import OBSERVATIONS, is_paper_study
from .results import Results
from .table import Table

_CLASSES = {
    Verdict.CONFIRMED: "confirmed",
    Verdict.REFUTED: "refuted",
    Verdict.UNDECIDED: "undecided",
}
# Chapters of a report on a structure of one's own: results, then what they rest on.
_ENGINEER = (
    "How much the joints slip", "The friction study", "Responses", "The chain", "Tables",
    "Processes", "Accuracy and cost", "Every process and case", "The paper's statements",
    "What ran",
)  # fmt: skip
_SMALLEST_P = 1.0e-4  # shown: errors are not known to be normal further out
_READING = (
    "Each statement has a stated test; no verdict is given by eye. Confirmed: every number of the"
    " statement lies where it says, each at the one-sided 2.5 % level. Not confirmed: at least one"
    " surely does not, with Bonferroni's correction. Otherwise it is undecided at this sample size."
    " Numbers of the friction study are the best estimates of the results file. Their intervals"
    " include the errors of finite samples and of the one force record that all samples share. If"
    " several files have the numbers of a statement, the one with the narrowest intervals decides."
    " docs/paper.md goes through the paper sentence by sentence, with 3,000 samples."
)


def write_report(
    files: Sequence[Results],
    statements: Sequence[Statement],
    tables: Sequence[Table],
    figures: Sequence[tuple[Figure, Path]],
    path: Path,
) -> None:
    """Write the page; figures come with the PNG that was saved of them."""
    title = escape(files[0].title if len(files) == 1 else f"Results of {len(files)} files")
    is_paper = any(is_paper_study(results) for results in files)
    first = [table for table in tables if table.is_result and not (is_paper or table.is_detail)]
    others = [table for table in tables if table not in first]
    chapters = [
        ("results", "How much the joints slip", _tables(first)),
        ("findings", "The paper's statements", _findings(statements)),
        ("tables", "Tables", _tables([t for t in others if not t.is_detail])),
        *(
            (f"section-{i}", name, _figures(figures, name, statements))
            for i, name in enumerate(SECTIONS)
        ),
        ("details", "Every process and case", _tables([t for t in others if t.is_detail])),
        ("scenes", "What ran", _scenes(files)),
    ]
    chapters = [chapter for chapter in chapters if chapter[2]]
    if not is_paper:
        chapters.sort(key=lambda chapter: _ENGINEER.index(chapter[1]))
    style = resources.files(__package__).joinpath("report.css").read_text(encoding="utf-8")
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        f"<style>{style}</style></head><body>",
        f"<header><h1>{title}</h1>",
        *(
            f'<p class="facts">{"" if len(files) == 1 else escape(results.title) + " · "}'
            f"{_facts(results)}</p>"
            for results in files
        ),
        "</header>",
        _contents(chapters, figures),
        "<main>",
        *(f'<section id="{name}"><h2>{head}</h2>{body}</section>' for name, head, body in chapters),
        "</main></body></html>",
    ]
    write_file(path, "\n".join(parts).encode())


def _facts(results: Results) -> str:
    attrs = results.attrs
    facts = []
    if results.processes:
        facts.append(_counted(len(results.processes), "process", "processes"))
    if results.cases:
        samples = sum(case.n_samples for case in results.cases)
        facts.append(_counted(len(results.cases), "case", "cases"))
        facts.append(_counted(samples, "sample", "samples"))
    if results.tradeoff is not None and "setting" in results.tradeoff.sizes:
        facts.append(
            _counted(results.tradeoff.sizes["setting"], "setting", "settings") + " compared"
        )
    facts.append(f"seed {attrs.get('seed')}")
    seconds = float(str(attrs.get("wall_seconds", 0.0)))
    ranks = _counted(int(str(attrs.get("n_ranks", 1))), "rank", "ranks")
    facts.append(f"{seconds:.1f} s on {ranks}")
    facts.append(f"entroslip {attrs.get('version')}")
    facts.append(_when(str(attrs.get("created"))))
    return escape(" · ".join(facts))


def _when(created: str) -> str:
    """'2016-05-01 12:30 UTC' of an ISO 8601 time."""
    zone = created[19:]
    return f"{created[:10]} {created[11:16]} {'UTC' if zone == '+00:00' else zone}"


def _counted(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _contents(
    chapters: Sequence[tuple[str, str, str]], figures: Sequence[tuple[Figure, Path]]
) -> str:
    rows = []
    for name, head, _ in chapters:
        own = [figure for figure, _ in figures if figure.section == head]
        first = {_short(figure.title): figure.name for figure in reversed(own)}
        inside = " · ".join(
            f'<a href="#{escape(target)}">{escape(label)}</a>'
            for label, target in reversed(first.items())
        )
        rows.append(f'<li><a href="#{name}">{head}</a>{f"<br>{inside}" if inside else ""}</li>')
    return f'<nav aria-label="Contents"><ul>{"".join(rows)}</ul></nav>'


def _short(title: str) -> str:
    """'Fig. 8a' of the paper's figures, the whole title of others."""
    return f"Fig. {title.split('. ')[1]}" if title.startswith("Fig. ") else title


def _findings(statements: Sequence[Statement]) -> str:
    if not statements:
        return ""
    of = {statement.number: statement for statement in statements}
    key = "".join(
        f"<tr><td>{escape(source)}</td><td>{escape(text)}</td><td class='marks'>{marks}</td></tr>"
        for source, text, numbers in OBSERVATIONS
        if (marks := _marks([of[number] for number in numbers if number in of]))
    )
    names_scenes = len({s.scene for s in statements}) > 1
    rows = "".join(
        f'<tr id="statement-{s.number}"><td>{s.number}</td>'
        f'<td>{escape(s.claim)}<br><span class="test">{escape(s.source)}. Test: {escape(s.test)}.'
        f"{f' Scene: {escape(s.scene)}.' if names_scenes else ''}"
        f"</span></td><td>{_verdict(s)}</td>"
        f'<td class="p">{_p_value(s)}</td><td>{_numbers(s)}</td></tr>'
        for s in statements
    )
    cells = ("", "statement", "verdict", "p", "estimates [95 % intervals]")
    head = "".join(f"<th>{cell}</th>" for cell in cells)
    observations = (
        '<div class="scroll"><table class="text"><thead><tr><th>of the paper</th><th>it says</th>'
        f"<th>verdict</th></tr></thead><tbody>{key}</tbody></table></div>"
    )
    return (
        f'<p class="note">{escape(_READING)}</p>{observations if key else ""}'
        f"<h3>Statement by statement</h3>"
        f'<div class="scroll"><table class="text" id="statements"><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _verdict(statement: Statement) -> str:
    verdict = statement.verdict
    return f'<span class="verdict {_CLASSES[verdict]}">{verdict.value.split(" at ")[0]}</span>'


def _p_value(statement: Statement) -> str:
    p = statement.judgement.p_value
    return f"{p:.2g}" if p >= _SMALLEST_P else f"&lt; {_SMALLEST_P:g}"


def _marks(statements: Sequence[Statement]) -> str:
    return "<br>".join(
        f'<a href="#statement-{s.number}">{s.number}</a> {_verdict(s)}' for s in statements
    )


def _numbers(statement: Statement) -> str:
    """The numbers of a statement: all of a few, the outer ones of many."""
    findings = list(statement.findings)
    few = findings if len(findings) <= 4 else sorted(findings, key=lambda f: f.p_for)
    shown = few if len(few) <= 4 else [few[0], few[-1]]
    lines = [f"{f.text}: {f.estimate:.3g} [{f.low:.3g}, {f.high:.3g}]" for f in shown]
    if len(findings) > len(shown):
        lines.append(f"and {len(findings) - len(shown)} between these in p-value")
    return "<br>".join(escape(line) for line in lines)


def _tables(tables: Sequence[Table]) -> str:
    """Tables in rows, as many beside one another as the page is wide."""
    parts = "".join(
        _table(table, has_note=after is None or after.note != table.note)
        for table, after in zip_longest(tables, tables[1:])
    )
    return f'<div class="tables">{parts}</div>' if tables else ""


def _table(table: Table, *, has_note: bool) -> str:
    """One table; a note that the next table repeats is left to that one."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    body = "".join(
        f"<tr{_paper_class(row)}>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in table.rows
    )
    note = f'<p class="note">{escape(table.note)}</p>' if table.note and has_note else ""
    return (
        f"<div><h3>{escape(table.title)}</h3>"
        f'<div class="scroll"><table id="{table.name}"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>{note}</div>"
    )


def _paper_class(row: tuple[str, ...]) -> str:
    return ' class="paper"' if row[0].endswith(", paper") else ""


def _figures(
    figures: Sequence[tuple[Figure, Path]], section: str, statements: Sequence[Statement]
) -> str:
    parts = [_figure(f, png, statements) for f, png in figures if f.section == section]
    return f'<div class="figures">{"".join(parts)}</div>' if parts else ""


def _figure(figure: Figure, png: Path, statements: Sequence[Statement]) -> str:
    image = base64.b64encode(png.read_bytes()).decode()
    title, caption = escape(figure.title), escape(figure.caption)
    shown = [s for s in statements if s.number in figure.statements]
    verdicts = "".join(f"<li>{escape(s.claim)} {_verdict(s)}</li>" for s in shown)
    return (
        f'<figure id="{escape(figure.name)}"><h3>{title}</h3>'
        f'<img alt="{title}. {caption}" src="data:image/png;base64,{image}">'
        f"<figcaption>{caption}{f'<ul>{verdicts}</ul>' if verdicts else ''}</figcaption></figure>"
    )


def _scenes(files: Sequence[Results]) -> str:
    """Each scene once, whatever was done with it."""
    first = {results.scene: results for results in reversed(files)}
    return "".join(_scene(results) for results in files if results in first.values())


def _scene(results: Results) -> str:
    scene, overrides = map(escape, results.scene)
    changed = f'<p class="note">Changed by --set: {overrides}</p>' if overrides else ""
    return (
        f"<h3>{escape(results.title)}</h3>{changed}"
        f"<details open><summary>the scene as run</summary><pre>{scene}</pre></details>"
    )
