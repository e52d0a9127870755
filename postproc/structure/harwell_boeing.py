"""Matrices in Harwell-Boeing text, as HBMAT of Ansys writes them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ..output import InputError, read_text
from .pair import Matrix, mirrored

_KIND = re.compile(rb"[RCPI][SUHZR][AE]\s")  # type of the matrix, at the start of the third line
_FORMAT = re.compile(r"(\d*)[IEDFG](\d+)")  # numbers in a line and characters of each, (3E25.15)


def is_harwell_boeing(head: bytes) -> bool:
    """True if a text begins with a header of Harwell-Boeing."""
    lines = head.upper().split(b"\n")
    return len(lines) > 3 and bool(_KIND.match(lines[2])) and lines[3].startswith(b"(")


def read_harwell_boeing(path: Path) -> Matrix:
    """A real assembled matrix, RSA or RUA; of a symmetric one a triangle stands for both."""
    lines = read_text(path).upper().splitlines()
    kind = lines[2][:3]
    if kind not in ("RSA", "RUA"):
        raise InputError(f"{path}:3: {kind}: must be real and assembled, RSA or RUA")
    # lines of the starts of the columns, of the rows, of the values, and of right-hand sides
    starts, rows, values, *right = (int(word) for word in lines[1].split()[1:])
    size = tuple(int(word) for word in lines[2].split()[1:3])
    first = 5 if any(right) else 4  # right-hand sides have a line of the header
    formats = lines[3][:16], lines[3][16:32], lines[3][32:52]
    words = []
    for text, count in zip(formats, (starts, rows, values), strict=True):
        per_line, width = re.findall(_FORMAT, text)[-1]
        end = int(per_line or 1) * int(width)
        words.append([line[i : i + int(width)] for line in lines[first : first + count]
                      for i in range(0, min(end, len(line.rstrip())), int(width))])  # fmt: skip
        first += count
    column, row = (np.array([int(word) for word in part]) - 1 for part in words[:2])
    value = np.array([float(word.replace("D", "E")) for word in words[2]])
    matrix = sp.csc_array((value, row, column), shape=size)
    if kind == "RSA" and 0 in (sp.tril(matrix, -1).nnz, sp.triu(matrix, 1).nnz):
        matrix = mirrored(matrix)
    return matrix
