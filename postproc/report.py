"""One self-contained page: the scene, what ran, tables and figures."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path

from postproc.gallery import Figure
from postproc.results import Results
from postproc.tables import Table

_STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --soft: #666; --paper: #fff; --line: #d8d8d8; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --soft: #a0a0a0; --paper: #16181b; --line: #3a3d42; }
  img { background: #fff; border-radius: 4px; }
}
body { margin: 0 auto; padding: 2rem 1.2rem; max-width: 68rem; color: var(--ink);
  background: var(--paper); font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.2rem; margin: 2.6rem 0 .6rem; }
.facts, figcaption, .note { color: var(--soft); font-size: .92rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: .28rem .7rem; text-align: right; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
#processes { font-size: .8rem; } #processes td { white-space: nowrap; padding: .28rem .45rem; }
#processes th:nth-child(-n+3), #processes td:nth-child(-n+3) { text-align: left; }
#processes td:last-child { white-space: normal; text-align: left; }
figure { margin: 0 0 1.6rem; break-inside: avoid; } img { max-width: 100%; height: auto; }
.figures { display: grid; gap: 1.2rem;
  grid-template-columns: repeat(auto-fit, minmax(26rem, 1fr)); }
figure h3 { font-size: 1rem; margin: 0 0 .3rem; }
pre { overflow-x: auto; border: 1px solid var(--line); padding: .8rem; font-size: .82rem; }
@media (max-width: 30rem) { .figures { grid-template-columns: 1fr; } }
@media print { body { max-width: none; padding: 0; font-size: 11px; } }
"""


def write_report(
    results: Results, tables: list[Table], figures: list[tuple[Figure, Path]], path: Path
) -> None:
    """Write the page; figures come with the PNG that was saved of them."""
    title = escape(str(results.attrs.get("title") or results.path.stem))
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        f"<style>{_STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        f'<p class="facts">{_facts(results)}</p>',
    ]
    parts += [_table(table) for table in tables if not table.name.startswith("statistics")]
    if figures:
        parts.append('<h2>Figures</h2><div class="figures">')
        parts += [_figure(figure, png) for figure, png in figures]
        parts.append("</div>")
    details = [_table(table) for table in tables if table.name.startswith("statistics")]
    if details:
        parts.append("<h2>Statistics of every case</h2>")
        parts.append(
            '<p class="note">Standard errors in brackets, in units of the last digits.</p>'
        )
        parts += details
    scene = escape(str(results.attrs.get("scene", "")))
    parts.append(f"<h2>The scene</h2><details open><summary>as run</summary><pre>{scene}</pre>")
    parts.append("</details></body></html>")
    path.write_text("\n".join(parts), encoding="utf-8")


def _facts(results: Results) -> str:
    attrs = results.attrs
    samples = sum(case.data.sizes.get("sample", 1) for case in results.cases)
    facts = []
    if results.cases:
        facts.append(f"{len(results.cases)} cases, {samples} samples")
    facts.append(f"seed {attrs.get('seed')}")
    facts.append(f"{float(attrs.get('wall_seconds', 0.0)):.1f} s on {attrs.get('n_ranks')} ranks")
    facts.append(f"entroslip {attrs.get('version')}")
    facts.append(str(attrs.get("created")))
    return escape(" · ".join(facts))


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return (
        f"<h2>{escape(table.title)}</h2>"
        f'<div class="scroll"><table id="{table.name}"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>{note}"
    )


def _figure(figure: Figure, png: Path) -> str:
    image = base64.b64encode(png.read_bytes()).decode()
    title, caption = escape(figure.title), escape(figure.caption)
    return (
        f'<figure id="{figure.name}"><h3>{title}</h3>'
        f'<img alt="{title}. {caption}" src="data:image/png;base64,{image}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )
