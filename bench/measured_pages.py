"""Writes measured blocks of the documentation anew: python bench/measured_pages.py [WORD ...]

A block of docs/accuracy.md, regression.md or cost.md stands between `<!-- measured by -->` and
`<!-- end -->`: a command, indented, and what it prints. With words, only the blocks whose command
has one of them: "entroslip tradeoff", settings, "entroslip run", errors, targets, regression,
peers, requirements, chains. Says how long each took. What a page's text says of a block is not
rewritten: read it again.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "docs" / name for name in ("accuracy.md", "regression.md", "cost.md")]
BLOCK = re.compile(r"(<!-- measured by -->\n\n    (.*?)\n).*?(<!-- end -->)", re.DOTALL)

PROGRESS = re.compile(r"^\d+ of \d+ .* left\n", re.MULTILINE)


def block(found: re.Match[str]) -> str:
    """One block as its command prints it now; what is no Markdown table is fenced."""
    head, command, tail = found.groups()
    words = sys.argv[1:]
    if words and not any(word in command for word in words):
        return found[0]
    python = command.replace("python ", f"{sys.executable} ", 1)
    start = time.monotonic()
    said = subprocess.run(
        shlex.split(python, comments=True), cwd=ROOT, check=True, capture_output=True, text=True
    )
    text = PROGRESS.sub("", said.stdout).strip("\n")
    print(f"{time.monotonic() - start:4.0f} s  {command}", flush=True)
    fence = "" if text.startswith(("|", "**")) else "```\n"
    return f"{head}\n{fence}{text}\n{fence}\n{tail}"


if __name__ == "__main__":
    commands = [found[2] for page in PAGES for found in BLOCK.finditer(page.read_text())]
    for word in sys.argv[1:]:
        if not any(word in command for command in commands):
            raise SystemExit(f"{word}: no block's command has it; they are\n" + "\n".join(commands))
    (ROOT / "results").mkdir(exist_ok=True)
    for page in PAGES:
        page.write_text(BLOCK.sub(block, page.read_text()))
