"""Matrices that Abaqus and Nastran write as text, read line by line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from ..output import InputError, read_text

Dof = tuple[int, int]  # node and its dof; of a plain numbering the number and 0
_FIXED = 1.0e36  # Abaqus adds it to the diagonal of K at a dof that is held
_WIDE, _NARROW = 16, 8  # characters of a Nastran field
_FEW_DIGITS = 3  # of a value typed by hand, such as 25.0
_REAL = (1, 2)  # Nastran's types: single and double precision
_SYMMETRIC, _SQUARE = 6, 1  # Nastran's forms


@dataclass
class Entries:
    """The entries of one matrix by the names of their dofs."""

    path: Path
    is_whole: bool = False  # the file says that both triangles are given
    refusal: str = ""  # why the matrix cannot be taken, with its place
    values: dict[tuple[Dof, Dof], float] = field(default_factory=dict)
    rounding: dict[tuple[Dof, Dof], float] = field(default_factory=dict)  # largest errors

    def add(self, row: Dof, column: Dof, value: float, line: int) -> None:
        """One entry; a second one at the same place is refused."""
        if (row, column) in self.values:
            raise InputError(f"{self.path}:{line}: entry {name(row)}, {name(column)} stands twice")
        self.values[row, column] = value

    def is_half(self) -> bool:
        """True if no entry off the diagonal has its mirror: a symmetric matrix, given once."""
        return not self.is_whole and not any(
            row != column and (column, row) in self.values for row, column in self.values
        )

    def dofs(self) -> list[Dof]:
        """All that an entry names, by node and dof."""
        return sorted({dof for place in self.values for dof in place})


def name(dof: Dof) -> str:
    """'12:3', or '12' of a plain numbering."""
    return f"{dof[0]}:{dof[1]}" if dof[1] else str(dof[0])


def read_abaqus(path: Path) -> Entries:
    """The text of *MATRIX OUTPUT: FORMAT=MATRIX INPUT (or LABELS), or FORMAT=COORDINATE.

    A line is `node, dof, node, dof, value` or `row, column, value`. Of a symmetric matrix Abaqus
    writes one half in the first form and all of it in the second.
    """
    entries = Entries(path)
    width = 0
    for number, line in _lines(path):
        if line.startswith("*"):  # a keyword or a comment
            continue
        words = re.split(r"[,\s]+", line.strip(", \t"))
        if len(words) not in (3, 5) or (width and len(words) != width):
            raise InputError(
                f"{path}:{number}: must be node, dof, node, dof, value or row, column, value, alike"
                " in every line"
            )
        width = len(words)
        places = [_whole(word, path, number) for word in words[:-1]]
        row, column = (
            ((places[0], places[1]), (places[2], places[3]))
            if width == 5
            else ((places[0], 0), (places[1], 0))
        )
        entries.add(row, column, _real(words[-1], path, number), number)
    return entries


def held_dofs(entries: Entries) -> frozenset[Dof]:
    """Dofs that Abaqus holds: their diagonal of K is 1e36."""
    return frozenset(
        row for (row, column), value in entries.values.items()
        if row == column and abs(value) >= 0.5 * _FIXED
    )  # fmt: skip


def read_dmig(path: Path) -> dict[str, Entries]:
    """Every DMIG of a punch file or bulk data, by name; `refusal` of one not real and square."""
    found: dict[str, Entries] = {}
    for number, fields in _cards(path):
        label, rest = fields[1].strip(), fields[2:]
        if rest[0].strip() == "0":  # the header: form, types
            form, kind = (_whole(word, path, number) for word in rest[1:3])
            refusal = ""
            if form not in (_SYMMETRIC, _SQUARE):
                refusal = f"{path}:{number}: DMIG {label}: must be square, form 1 or 6"
            elif kind not in _REAL:
                refusal = f"{path}:{number}: DMIG {label}: must be real, type 1 or 2"
            found[label] = Entries(path, form == _SQUARE, refusal)
            continue
        if label not in found:
            raise InputError(f"{path}:{number}: DMIG {label}: its header must come first")
        if found[label].refusal:
            continue
        column = _dof(rest[0:2], path, number)
        for group in (rest[i : i + 4] for i in range(3, len(rest), 4)):
            if not any(word.strip() for word in group):
                continue
            row = _dof(group[0:2], path, number)
            found[label].add(row, column, _real(group[2], path, number), number)
            found[label].rounding[row, column] = _half_a_unit(group[2])
    if not found:
        raise InputError(f"{path}: has no DMIG")
    return found


def _cards(path: Path) -> Iterator[tuple[int, list[str]]]:
    """DMIG entries with the fields of their continuations, and the line that each begins at."""
    begun = 0
    card: list[str] = []
    for number, line in _lines(path):
        is_first = line[:4].upper() == "DMIG"
        is_more = bool(card) and (line[:1] in "*+ ," or not line[:8].strip())
        if is_first or not is_more:
            if card:
                yield begun, card
            card, begun = [], number
        if is_first or is_more:
            card += _fields(line, starts=is_first)
    if card:
        yield begun, card


def _fields(line: str, starts: bool) -> list[str]:
    """Fields of one line: after the name eight narrow or four wide ones, or free ones."""
    if "," in line:
        cells = [cell.strip() for cell in line.split(",")]
        first, rest = cells[0], cells[1:9]
        count = 4 if "*" in first else 8
    else:
        width = _WIDE if "*" in line[:_NARROW] else _NARROW
        first, count = line[:_NARROW], 8 * _NARROW // width
        rest = [line[_NARROW + i * width : _NARROW + (i + 1) * width] for i in range(count)]
    rest = [*rest, *[""] * (count - len(rest))][:count]
    return [first, *rest] if starts else rest


def _dof(words: list[str], path: Path, line: int) -> Dof:
    node = _whole(words[0], path, line)
    return node, _whole(words[1], path, line) if words[1].strip() else 0


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that are neither empty nor a comment, from 1."""
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if line.strip() and not line.startswith(("**", "$", "#")):
            yield number, line


def _whole(word: str, path: Path, line: int) -> int:
    try:
        return int(word)
    except ValueError:
        raise InputError(f"{path}:{line}: {word.strip()}: must be a whole number") from None


def _half_a_unit(word: str) -> float:
    """Half a unit of the last digit of a number, the largest error of its rounding.

    Zero of a number that is meant as it stands, with few digits.
    """
    _, digits, exponent = Decimal(_plain(word)).as_tuple()
    return 0.5 * 10.0 ** int(exponent) if len(digits) > _FEW_DIGITS else 0.0


def _plain(word: str) -> str:
    """A number as Fortran writes them, 1.0D+05, and Nastran's 1.0+5, for Python."""
    text = re.sub(r"(?<=[\d.])([+-])", r"e\1", word.strip().lower().replace("d", "e"))
    return text.replace("ee", "e")


def _real(word: str, path: Path, line: int) -> float:
    try:
        return float(_plain(word))
    except ValueError:
        raise InputError(f"{path}:{line}: {word.strip()}: must be a number") from None
