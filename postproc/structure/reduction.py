"""Smaller pairs with the same joints: static condensation, and the method of Craig and Bampton."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..output import InputError
from .pair import Matrix, Pair, massless, start

_DENSE = 600  # inner dofs up to which all their modes are computed at once
_ROUNDING = 1.0e-14  # of the largest 1/omega^2: a direction without mass; of the terms of a sum
_LOOSE = (
    "K: the dofs that are not kept can move without force while the others are held: keep more dofs"
)


def craig_bampton(pair: Pair, kept: Sequence[str], n_modes: int) -> Pair:
    """The kept dofs, unchanged and first, and the lowest modes of the rest with these held.

    x_i = Psi x_b + Phi q with Psi = -K_ii^-1 K_ib and K_ii Phi = M_ii Phi diag(omega^2),
    Phi' M_ii Phi = I (Craig and Bampton, AIAA Journal 6 (1968) 1313).
    """
    outer, inner = _parted(pair, kept)
    if not 0 <= n_modes <= inner.size:
        raise InputError(f"--modes {n_modes}: must be from 0 to {inner.size}, the dofs not kept")
    stiffness = pair.stiffness[inner][:, inner].tocsc()
    shapes = _follow(pair, stiffness, inner, outer)
    modes, squares = _modes(stiffness, pair.mass[inner][:, inner].tocsc(), n_modes)
    transform = np.zeros((pair.n_dof, outer.size + modes.shape[1]))
    transform[outer, np.arange(outer.size)] = 1.0
    transform[inner, : outer.size] = shapes
    transform[inner, outer.size :] = modes
    labels = tuple(pair.labels[i] for i in outer)
    labels += tuple(f"mode {k + 1}" for k in range(modes.shape[1]))
    found = _projected(pair, transform)
    n_kept = outer.size
    found["M"][n_kept:, n_kept:] = np.eye(n_modes)  # without rounding
    found["K"][n_kept:, n_kept:] = np.diag(squares)
    found["K"][:n_kept, n_kept:] = found["K"][n_kept:, :n_kept] = 0.0
    return _pair(found, labels)


def condensed(pair: Pair) -> Pair:
    """The pair without its dofs of no mass, which follow the others statically: exact."""
    empty = massless(pair)
    if not empty.size:
        raise InputError("--condense: every dof has mass")
    outer = np.setdiff1d(np.arange(pair.n_dof), empty)
    stiffness = pair.stiffness[empty][:, empty].tocsc()
    transform = np.zeros((pair.n_dof, outer.size))
    transform[outer, np.arange(outer.size)] = 1.0
    transform[empty] = _follow(pair, stiffness, empty, outer)
    return _pair(_projected(pair, transform), tuple(pair.labels[i] for i in outer))


def _parted(pair: Pair, kept: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Positions of the kept dofs, as they are given, and of the others."""
    if len(set(kept)) != len(kept):
        raise InputError("the kept dofs: one is named twice")
    outer = np.array([pair.position(label) for label in kept], dtype=np.int64)
    if not outer.size:
        raise InputError("--modes: needs a dof to keep: --keep, --joint or --force names it")
    return outer, np.setdiff1d(np.arange(pair.n_dof), outer)


def _follow(
    pair: Pair, stiffness: Matrix, inner: NDArray[np.int64], outer: NDArray[np.int64]
) -> NDArray[np.float64]:
    """-K_ii^-1 K_ib (inner, outer): how the inner dofs follow the outer ones."""
    if not inner.size:
        return np.zeros((0, outer.size))
    coupling = pair.stiffness[inner][:, outer].toarray()
    try:
        shapes = -spla.splu(stiffness).solve(coupling)
    except RuntimeError:
        shapes = np.full(coupling.shape, np.nan)
    residual = abs(stiffness @ shapes + coupling).max(initial=0.0)
    if not residual <= 1.0e-6 * abs(coupling).max(initial=0.0):
        raise InputError(_LOOSE)
    return np.asarray(shapes)


def _modes(
    stiffness: Matrix, mass: Matrix, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The lowest modes (dof, mode), of unit mass, and their omega^2; M may be semidefinite."""
    size = stiffness.shape[0]
    if count == 0:
        return np.zeros((size, 0)), np.zeros(0)
    try:
        if size <= _DENSE or count > size // 2:
            # M x = theta K x, theta = 1/omega^2: K is definite, M need not be
            theta, vectors = scipy.linalg.eigh(
                mass.toarray(), stiffness.toarray(), subset_by_index=[size - count, size - 1]
            )
            theta, vectors = theta[::-1], vectors[:, ::-1]
            found = theta > _ROUNDING * theta[0]
            squares = 1.0 / theta[found]
            vectors = vectors[:, found] * np.sqrt(squares)
        else:
            squares, vectors = spla.eigsh(stiffness, k=count, M=mass, sigma=0.0, v0=start(size))
    except (np.linalg.LinAlgError, RuntimeError, spla.ArpackError):
        squares, vectors = np.full(1, -1.0), np.zeros((size, count))
    if (squares <= 0.0).any():
        raise InputError(_LOOSE)
    if vectors.shape[1] < count:
        raise InputError(f"--modes {count}: the dofs that are not kept have mass for"
                         f" {vectors.shape[1]} modes")  # fmt: skip
    largest = vectors[abs(vectors).argmax(axis=0), np.arange(count)]
    return vectors * np.sign(largest), squares  # the same sign on every machine


def _projected(pair: Pair, transform: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """T' A T of every matrix A; sums that cancel to rounding are zero, as of a body that floats."""
    found = {}
    for name, matrix in pair.matrices().items():
        product = transform.T @ (matrix @ transform)
        terms = abs(transform).T @ (abs(matrix) @ abs(transform))
        product[abs(product) <= _ROUNDING * terms] = 0.0
        found[name] = 0.5 * (product + product.T)
    return found


def _pair(found: dict[str, NDArray[np.float64]], labels: tuple[str, ...]) -> Pair:
    sparse = {name: sp.csc_array(matrix) for name, matrix in found.items()}
    return Pair(sparse["M"], sparse["K"], labels, sparse.get("C"))
