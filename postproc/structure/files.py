"""Matrices from files: MATLAB, NumPy, Matrix Market, rows, Abaqus, Nastran, Harwell-Boeing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

from ..output import InputError
from .harwell_boeing import is_harwell_boeing, read_harwell_boeing
from .pair import Matrix, Pair, lowest_frequency, mirrored, symmetric_part
from .text_matrix import Dof, Entries, held_dofs, name, read_abaqus, read_dmig

# Names of the matrices of each kind in files that hold several, in small letters.
_NAMES = {
    "M": ("m", "mass", "mass_matrix", "maa", "maax", "mgg", "mggx", "m2gg", "mred"),
    "K": ("k", "stiffness", "stiffness_matrix", "kaa", "kaax", "kgg", "kggx", "k2gg", "kred"),
    "C": ("c", "d", "damping", "damping_matrix", "baa", "baax", "bgg", "b2gg", "cred"),
}
_MATRIX_MARKET = "Matrix Market"
_ROWS = "rows of text"
_HARWELL_BOEING = "Harwell-Boeing"
_LEAST_ERROR = 1.0e-3  # of the lowest frequency that is noted
_MOST_ROWS = 10_000_000  # of a matrix without names of dofs; more is no matrix


@dataclass(frozen=True)
class _Read:
    """A matrix as its file has it: with names of its dofs, or by position."""

    source: str
    matrix: Matrix
    dofs: tuple[Dof, ...] | None = None
    held: frozenset[Dof] = frozenset()
    rounding: Matrix | None = None  # largest error of each entry, if the file rounds


def read_pair(mass: str, stiffness: str, damping: str | None = None) -> Pair:
    """M, K and perhaps C of files, `FILE` or `FILE:NAME`, over the same dofs in the same order.

    Files that name their dofs are put into one order, by node and dof; a dof that one of them
    leaves out has zeros there. Dofs that Abaqus holds are left out.
    """
    wanted = {"M": mass, "K": stiffness} | ({"C": damping} if damping else {})
    found = {letter: _read(source, letter) for letter, source in wanted.items()}
    named = [read for read in found.values() if read.dofs is not None]
    if not named:
        found = _numbered(found)
    elif len(named) < len(found):
        plain = next(read for read in found.values() if read.dofs is None)
        raise InputError(
            f"{plain.source}: does not name its dofs, {named[0].source} does: the order of"
            " their dofs cannot be compared"
        )
    if found["M"].held:
        raise InputError(f"{mass}: M has 1e36 on its diagonal, as Abaqus writes K: exchanged?")
    held = found["K"].held
    dofs = sorted({dof for read in found.values() for dof in read.dofs or ()} - held)
    matrices = {letter: _on(dofs, read) for letter, read in found.items()}
    labels = tuple(name(dof) for dof in dofs)
    for letter, matrix in matrices.items():
        matrices[letter] = symmetric_part(f"{found[letter].source}: {letter}", matrix, labels)
    pair = Pair(matrices["M"], matrices["K"], labels, matrices.get("C"))
    notes = [f"left out, held in the model: {_listed(map(name, held))}"] if held else []
    rounded = {letter: _on(dofs, replace(read, matrix=read.rounding))
               for letter, read in found.items() if read.rounding is not None}  # fmt: skip
    frequency, error = lowest_frequency(pair, rounded)
    if error > _LEAST_ERROR:
        sources = " and ".join(dict.fromkeys(found[letter].source for letter in rounded))
        notes.append(
            f"{sources}: values are rounded, by which the lowest frequency, {frequency:.4g} Hz,"
            f" scatters by {error:.1%}: write wide fields, DMIG*"
        )
    return replace(pair, notes=tuple(notes))


def _numbered(found: Mapping[str, _Read]) -> dict[str, _Read]:
    """Matrices without names of dofs, which then must be of one size: dofs are called 1, 2, ..."""
    sizes = {letter: read.matrix.shape[0] for letter, read in found.items()}
    for letter, size in sizes.items():
        if size != sizes["M"]:
            raise InputError(
                f"{found[letter].source}: {letter} has {size} dofs, M of {found['M'].source} has"
                f" {sizes['M']}"
            )
    dofs = tuple((i + 1, 0) for i in range(sizes["M"]))
    return {letter: replace(read, dofs=dofs) for letter, read in found.items()}


def _on(dofs: list[Dof], read: _Read) -> Matrix:
    """The matrix over these dofs: some of its own, others without entries."""
    at = {dof: i for i, dof in enumerate(dofs)}
    entries = read.matrix.tocoo()
    place = np.array([at.get(dof, -1) for dof in read.dofs or ()])
    row, column = place[entries.row], place[entries.col]
    kept = (row >= 0) & (column >= 0)
    return sp.csc_array(
        (entries.data[kept], (row[kept], column[kept])), shape=(len(dofs), len(dofs))
    )


def _read(source: str, letter: str) -> _Read:
    """One matrix of `FILE` or `FILE:NAME`."""
    path, wanted = Path(source), ""
    if not path.exists() and ":" in source:
        text, _, wanted = source.rpartition(":")
        path = Path(text)
    if not path.is_file():
        raise InputError(f"{path}: is a folder" if path.is_dir() else f"{path}: no such file")
    ending = path.suffix.lower()
    head = path.open("rb").read(4096)
    if ending not in _READERS and head.startswith(b"%%MatrixMarket"):
        ending = _MATRIX_MARKET
    elif ending not in _READERS and is_harwell_boeing(head):
        ending = _HARWELL_BOEING
    elif ending not in _READERS and _has_rows(head):
        ending = _ROWS
    if ending in _READERS:
        kind, read = _READERS[ending]
        try:
            found = read(path)
        except InputError:
            raise
        except Exception as error:  # whatever numpy, scipy, h5py and pyNastran raise
            words = " ".join(str(error).split())
            raise InputError(f"{path}: cannot be read as {kind}: {words}") from error
        key = _chosen(path, found, wanted, letter)
        return _Read(str(path), _as_matrix(found[key], f"{path}: {key}".removesuffix(": ")))
    if b"\0" in head:
        raise InputError(
            f"{path}: is binary, and none of {', '.join(key for key in _READERS if key[0] == '.')}"
        )
    named = read_dmig(path) if b"DMIG" in head.upper() else {"": read_abaqus(path)}
    return _of_entries(named[_chosen(path, named, wanted, letter)])


def _chosen(path: Path, found: Mapping[str, Any], wanted: str, letter: str) -> str:
    """The name of a matrix in a file: as asked, the only one, or one that is called so."""
    if wanted:
        if "" in found:
            raise InputError(f"{path}: holds one matrix without a name: leave :{wanted} out")
        if wanted not in found:
            raise InputError(f"{path}: has no {wanted}, only {_listed(found)}")
        return wanted
    if len(found) == 1:
        (key,) = found
        other = next((is_of for is_of, names in _NAMES.items() if key.lower() in names), letter)
        if other != letter:
            raise InputError(
                f"{path}: {key} is {other} by its name; FILE:NAME takes it as {letter}"
            )
        return key
    called = [key for key in found if key.rpartition(".")[2].lower() in _NAMES[letter]]
    if len(called) != 1:
        raise InputError(f"{path}: which is {letter}? Give FILE:NAME, of {_listed(found)}")
    return called[0]


def _listed(found: Iterable[str]) -> str:
    return ", ".join(sorted(found)) or "none at all"


def _as_matrix(values: Any, source: str) -> Matrix:  # noqa: ANN401  (what a reader hands out)
    if not (isinstance(values, np.ndarray) or sp.issparse(values)):
        raise InputError(f"{source}: must be a matrix")
    if values.ndim != 2 or values.shape[0] != values.shape[1] or not values.shape[0]:
        raise InputError(f"{source}: must be square, has shape {tuple(values.shape)}")
    if values.dtype.kind not in "fiu":
        raise InputError(f"{source}: must be real numbers, is {values.dtype}")
    return sp.csc_array(values, dtype=float)


def _of_entries(entries: Entries) -> _Read:
    """Text with named dofs; of a symmetric matrix that is given once the rest is its mirror."""
    if entries.refusal:
        raise InputError(entries.refusal)
    if not entries.values:
        raise InputError(f"{entries.path}: the matrix has no entries")
    dofs = entries.dofs()
    is_plain = all(dof == 0 for _, dof in dofs)
    if is_plain:
        lowest, highest = dofs[0][0], dofs[-1][0]
        if lowest < 1 or highest > _MOST_ROWS:
            wrong = lowest if lowest < 1 else highest
            raise InputError(f"{entries.path}: row {wrong}: must be from 1 to {_MOST_ROWS}")
        dofs = [(i + 1, 0) for i in range(highest)]
    at = {dof: i for i, dof in enumerate(dofs)}
    is_half = entries.is_half()

    def of(values: Mapping[tuple[Dof, Dof], float]) -> Matrix:
        row, column = (np.array([at[place[i]] for place in values]) for i in (0, 1))
        matrix = sp.csc_array(
            (np.array(list(values.values())), (row, column)), shape=(len(dofs), len(dofs))
        )
        if is_half:
            matrix = mirrored(matrix)
        return matrix

    return _Read(
        str(entries.path), of(entries.values), None if is_plain else tuple(dofs),
        held_dofs(entries), of(entries.rounding) if entries.rounding else None,
    )  # fmt: skip


def _npy(path: Path) -> dict[str, Any]:
    return {"": np.load(path, allow_pickle=False)}


def _npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as archive:
        if {"format", "shape", "data"} <= set(archive.files):
            return {"": sp.load_npz(path)}
        return {key: archive[key] for key in archive.files}


def _mat(path: Path) -> dict[str, Any]:
    """Numeric matrices of a MATLAB file of any version, those inside of structs as `s.M`."""
    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return _of_hdf5(file, "")
    return _flat(scipy.io.loadmat(path, simplify_cells=True), "")


def _flat(values: Mapping[str, Any], before: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{before}{key}.")
        elif getattr(value, "ndim", 0) == 2 and not key.startswith("__"):
            found[f"{before}{key}"] = value
        elif isinstance(value, float | int):  # a matrix of one dof
            found[f"{before}{key}"] = np.array([[float(value)]])
    return found


def _of_hdf5(group: h5py.Group, before: str) -> dict[str, Any]:
    """MATLAB 7.3: arrays by rows, sparse matrices as groups of data, ir, jc."""
    found: dict[str, Any] = {}
    for key, item in group.items():
        if key.startswith("#"):
            continue
        if isinstance(item, h5py.Dataset):
            if item.ndim == 2:
                found[f"{before}{key}"] = item[()].T
        elif "MATLAB_sparse" in item.attrs:
            n_rows = int(item.attrs["MATLAB_sparse"])
            starts = item["jc"][()]
            parts = [item[part][()] if part in item else [] for part in ("data", "ir")]
            shape = (n_rows, starts.size - 1)
            found[f"{before}{key}"] = sp.csc_array((*parts, starts), shape=shape)
        else:
            found |= _of_hdf5(item, f"{before}{key}.")
    return found


def _op4(path: Path) -> dict[str, Any]:
    """Through pyNastran, which knows all of OP4's forms."""
    try:
        from pyNastran.op4.op4 import OP4
    except ImportError:
        raise InputError(
            f"{path}: OP4 is read through pyNastran, which is not installed: pip install"
            " --no-deps pyNastran cpylog"
        ) from None
    found = OP4(log=None).read_op4(str(path))
    return {key: getattr(value, "data", value[1] if isinstance(value, tuple) else value)
            for key, value in found.items()}  # fmt: skip


def _matrix_market(path: Path) -> dict[str, Any]:
    return {"": scipy.io.mmread(path)}


def _has_rows(head: bytes) -> bool:
    """True if a text begins with a row of a matrix.

    An entry of Abaqus has three or five values, first a whole number.
    """
    words = head.split(b"\n")[0].replace(b",", b" ").split()
    try:
        numbers = [float(word) for word in words[:6]]
    except ValueError:
        return False
    return len(numbers) > 0 and not (len(numbers) in (3, 5) and words[0].isdigit())


def _rows(path: Path) -> dict[str, Any]:
    has_commas = b"," in path.open("rb").readline()
    return {"": np.loadtxt(path, delimiter="," if has_commas else None, ndmin=2)}


# By the ending of the file: what it is called in messages, and its matrices by name.
_READERS: dict[str, tuple[str, Callable[[Path], dict[str, Any]]]] = {
    ".npy": ("a NumPy array", _npy),
    ".npz": ("an archive of NumPy arrays", _npz),
    ".mat": ("a MATLAB file", _mat),
    ".op4": ("OP4", _op4),
    _MATRIX_MARKET: (_MATRIX_MARKET, _matrix_market),
    _ROWS: (_ROWS, _rows),
    _HARWELL_BOEING: (_HARWELL_BOEING, lambda path: {"": read_harwell_boeing(path)}),
}
