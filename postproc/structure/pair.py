"""A pair of mass and stiffness matrices: its checks, its frequencies and masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..output import InputError

Matrix: TypeAlias = Any  # scipy.sparse.csc_array: real, both triangles stored

_ASYMMETRY = 1.0e-8  # of the largest entry; exports round to 10 digits and more
_ZERO = 1.0e-10  # of the largest eigenvalue: rounding of K, or a fine mesh
_GAP = 100.0  # least ratio of an elastic eigenvalue to the rounding that rigid modes have
_AT_FIRST = 12  # eigenvalues among which rigid modes are sought; more if all are rigid
_DENSE = 600  # dofs up to which all eigenvalues are computed at once
_NAMED = 6  # dofs that a message names


@dataclass(frozen=True)
class Pair:
    """M, K and perhaps C over the same dofs, each named: '7', or '12:3' for dof 3 of node 12."""

    mass: Matrix
    stiffness: Matrix
    labels: tuple[str, ...]
    damping: Matrix | None = None
    notes: tuple[str, ...] = ()  # on what the files leave out or round

    @property
    def n_dof(self) -> int:
        """Number of dofs."""
        return len(self.labels)

    def matrices(self) -> dict[str, Matrix]:
        """The matrices by the paper's letters."""
        found = {"M": self.mass, "K": self.stiffness}
        return found if self.damping is None else found | {"C": self.damping}

    @property
    def n_kept(self) -> int:
        """Number of dofs before the modes of a reduction, which are called 'mode 1', ..."""
        return sum(not label.startswith("mode ") for label in self.labels)

    def last(self) -> str:
        """The last dof that is none of these modes."""
        return self.labels[self.n_kept - 1]

    def position(self, label: str) -> int:
        """Position of a dof, from 0."""
        try:
            return self.labels.index(label)
        except ValueError:
            node = label.partition(":")[0]
            near = [other for other in self.labels if other.partition(":")[0] == node]
            named = near or self.labels
            shown = ", ".join(named[:_NAMED]) + (" ..." if len(named) > _NAMED else "")
            raise InputError(f"dof {label}: is not among {self.n_dof} dofs: {shown}") from None


def mirrored(triangle: Matrix) -> Matrix:
    """The symmetric matrix of which one triangle is given."""
    return sp.csc_array(triangle + triangle.T - sp.diags_array(triangle.diagonal()))


def symmetric_part(name: str, matrix: Matrix, labels: Sequence[str]) -> Matrix:
    """(A + A')/2; an asymmetry above rounding is refused where it is largest."""
    entries = matrix.tocoo()
    if not np.isfinite(entries.data).all():
        raise InputError(f"{name}: has an entry that is no finite number")
    largest = float(abs(entries.data).max(initial=0.0))
    apart = (matrix - matrix.T).tocoo()
    if apart.nnz and float(abs(apart.data).max()) > _ASYMMETRY * largest:
        worst = int(abs(apart.data).argmax())
        i, j = int(apart.row[worst]), int(apart.col[worst])
        raise InputError(
            f"{name}: must be symmetric; entry ({labels[i]}, {labels[j]}) is {matrix[i, j]:g},"
            f" entry ({labels[j]}, {labels[i]}) is {matrix[j, i]:g}"
        )
    return sp.csc_array((matrix + matrix.T) * 0.5)


def require_mass(pair: Pair) -> None:
    """Refuse a mass matrix that is not positive definite; dofs without mass are named."""
    empty = massless(pair)
    if empty.size:
        raise InputError(
            f"M: must be positive definite; {_named(pair, empty)} without mass: --condense removes"
            " them by static condensation, a reduction with --modes does so too"
        )
    signs = _signs(pair.mass)
    if signs is None or (signs <= 0).any():
        raise InputError("M: must be positive definite; it has an eigenvalue that is not positive")


def require_stiffness(pair: Pair) -> int:
    """Number of rigid modes of K alone; a stiffness with a negative eigenvalue is refused."""
    largest = largest_eigenvalue(pair)
    values, n_rigid = _beyond_rigid(pair, _AT_FIRST, largest)
    if values[0] < -_ZERO * largest:
        raise InputError(
            f"K: must have no negative eigenvalue; the lowest of K x = lambda M x is {values[0]:g}"
        )
    return n_rigid


def _beyond_rigid(pair: Pair, count: int, largest: float) -> tuple[NDArray[np.float64], int]:
    """The lowest eigenvalues, `count` or more, and the number of rigid modes among them."""
    values = lowest_eigenvalues(pair, count)
    n_rigid = _n_rigid(values, largest)
    if n_rigid == values.size < pair.n_dof:
        return _beyond_rigid(pair, 2 * count, largest)
    return values, n_rigid


def _n_rigid(values: NDArray[np.float64], largest: float) -> int:
    """Number of the lowest eigenvalues that are rounding, and so far below the next one."""
    n = int((values <= _ZERO * largest).sum())
    while 0 < n < values.size and values[n] <= _GAP * abs(values[n - 1]):
        n -= 1
    return n


def massless(pair: Pair) -> NDArray[np.int64]:
    """Dofs whose row of M is zero."""
    return np.flatnonzero(np.asarray(abs(pair.mass).sum(axis=1)).ravel() == 0.0)


def frequencies(pair: Pair, count: int) -> NDArray[np.float64]:
    """The lowest natural frequencies [Hz]; those of rigid modes are 0."""
    values, n_rigid = _beyond_rigid(pair, max(count, _AT_FIRST), largest_eigenvalue(pair))
    values[:n_rigid] = 0.0
    return np.sqrt(values[:count].clip(min=0.0)) / (2.0 * np.pi)


def lowest_frequency(pair: Pair, rounding: Mapping[str, Matrix]) -> tuple[float, float]:
    """The lowest frequency that is no rigid mode's [Hz], and how far rounded entries scatter it.

    To first order, of an eigenvalue s with the mode x, x'Mx = 1: x'dK x - s x'dM x, where an
    entry's error is uniform up to `rounding`; equal entries, as of a regular mesh, have the same.
    The scatter is relative; 0 without rounding, of many dofs, and of a K that is to be refused.
    """
    if not rounding or pair.n_dof > _DENSE:
        return 0.0, 0.0
    mass, stiffness = pair.mass.toarray(), pair.stiffness.toarray()
    typical = float(stiffness.trace() / mass.trace())
    try:  # M may be singular; K with this much of it is not
        inverse, modes = scipy.linalg.eigh(mass, stiffness + _ZERO * typical * mass)
    except np.linalg.LinAlgError:
        return 0.0, 0.0
    values = 1.0 / inverse[::-1].clip(min=np.finfo(float).tiny) - _ZERO * typical
    first = _n_rigid(values, typical)
    mode = modes[:, -1 - first] / np.sqrt(inverse[-1 - first])
    variance = 0.0
    for letter, matrix, scale in (("K", stiffness, 1.0), ("M", mass, values[first])):
        if letter in rounding:
            half = sp.triu(rounding[letter]).tocoo()
            entries = matrix[half.row, half.col]
            weight = np.where(half.row == half.col, 1.0, 2.0) * np.sign(entries)
            terms = scale * weight * mode[half.row] * mode[half.col] * half.data
            _, group = np.unique(abs(entries), return_inverse=True)
            variance += float((np.bincount(group, terms) ** 2).sum()) / 3.0
    value = float(values[first])
    return float(np.sqrt(value)) / (2.0 * np.pi), 0.5 * float(np.sqrt(variance)) / value


def lowest_eigenvalues(pair: Pair, count: int) -> NDArray[np.float64]:
    """The lowest eigenvalues of K x = lambda M x, ascending."""
    count = min(count, pair.n_dof)
    if pair.n_dof <= _DENSE or count > pair.n_dof // 2:
        return _all_eigenvalues(pair)[:count]
    shift = -1.0e-6 * largest_eigenvalue(pair)  # K - shift M is regular, rigid modes or not
    return np.sort(_iterated(pair, k=count, M=pair.mass, sigma=shift))


def largest_eigenvalue(pair: Pair) -> float:
    """The largest eigenvalue of K x = lambda M x; of many dofs to a per cent."""
    if pair.n_dof <= _DENSE:
        return float(_all_eigenvalues(pair)[-1])
    solve = spla.splu(pair.mass.tocsc())
    inverse = spla.LinearOperator((pair.n_dof, pair.n_dof), matvec=solve.solve, dtype=float)
    (value,) = _iterated(pair, k=1, M=pair.mass, Minv=inverse, which="LM", tol=1.0e-2)
    return float(value)


def _all_eigenvalues(pair: Pair) -> NDArray[np.float64]:
    try:
        return np.asarray(scipy.linalg.eigvalsh(pair.stiffness.toarray(), pair.mass.toarray()))
    except np.linalg.LinAlgError:
        raise InputError("M: must be positive definite") from None


def _iterated(pair: Pair, **options: Any) -> NDArray[np.float64]:  # noqa: ANN401
    try:
        values = spla.eigsh(
            pair.stiffness, v0=start(pair.n_dof), return_eigenvectors=False, **options
        )
    except (RuntimeError, spla.ArpackError) as error:
        raise InputError(f"K x = lambda M x: cannot be solved: {error}") from None
    return np.asarray(values)


def total_mass(pair: Pair) -> dict[str, float]:
    """Mass by direction of motion, if the names of the dofs or a rigid motion show it."""
    found = {}
    for direction in "123":
        moved = np.array([label.endswith(f":{direction}") for label in pair.labels], dtype=float)
        if moved.any():
            found[f"direction {direction}"] = float(moved @ (pair.mass @ moved))
    together = np.ones(pair.n_dof)
    force = float(abs(pair.stiffness @ together).max())
    if not found and force <= _ZERO * float(abs(pair.stiffness).max()):
        found["all dofs together"] = float(together @ (pair.mass @ together))
    return found


def start(size: int) -> NDArray[np.float64]:
    """The same start of every iteration: the same digits on every machine."""
    return np.random.default_rng(1).standard_normal(size)


def _signs(matrix: Matrix) -> NDArray[np.float64] | None:
    """Signs of the pivots of A = L D L', those of its eigenvalues; None where A is singular."""
    try:
        factors = spla.splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # exactly singular
        return None
    if (factors.perm_r != factors.perm_c).any():  # a pivot off the diagonal: one on it was zero
        return None
    return np.asarray(np.sign(factors.U.diagonal()))


def _named(pair: Pair, dofs: NDArray[np.int64]) -> str:
    names = ", ".join(pair.labels[i] for i in dofs[:_NAMED])
    more = f" and {dofs.size - _NAMED} more" if dofs.size > _NAMED else ""
    return (
        f"{'dof' if dofs.size == 1 else 'dofs'} {names}{more} {'is' if dofs.size == 1 else 'are'}"
    )
