"""Structures of a few numbers: rings of blades, chains."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..output import InputError
from .pair import Pair


def ring(
    blades: int, mass: float, stiffness: float, coupling: float, scatter: float, seed: int
) -> Pair:
    """Blades on a disk, a dof each, coupled to both neighbours; blade stiffnesses scatter.

    K_jj = k_j + 2 k_c, K_j,j+-1 = -k_c, k_j normal with mean `stiffness` and standard deviation
    `scatter` times it. Without scatter, lambda_n = (k + 2 k_c (1 - cos(2 pi n / blades)))/m.
    """
    if blades < 3:
        raise InputError(f"--blades {blades}: must be at least 3")
    if seed < 0:
        raise InputError(f"--seed {seed}: must be zero or positive")
    own = stiffness * (1.0 + scatter * np.random.default_rng(seed).standard_normal(blades))
    if (own <= 0.0).any():
        worst = int(own.argmin())
        raise InputError(
            f"--scatter {scatter:g}: makes the stiffness of blade {worst + 1} {own[worst]:g}, which"
            " must be positive; take another seed or less scatter"
        )
    following = (np.arange(blades) + 1) % blades
    edges = sp.coo_array((np.full(blades, -coupling), (np.arange(blades), following)))
    neighbours = sp.csc_array(edges, shape=(blades, blades))
    diagonal = sp.diags_array(own + 2.0 * coupling)
    return _pair(mass, sp.csc_array(diagonal + neighbours + neighbours.T))


def chain(masses: int, mass: float, coupling: float) -> Pair:
    """The paper's chain without its joints: springs from the wall to the first mass and on."""
    if masses < 1:
        raise InputError(f"--masses {masses}: must be at least 1")
    diagonal = np.full(masses, 2.0 * coupling)
    diagonal[-1] = coupling
    beside = np.full(masses - 1, -coupling)
    stiffness = sp.diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])
    return _pair(mass, sp.csc_array(stiffness))


def _pair(mass: float, stiffness: sp.csc_array) -> Pair:
    """All dofs with the same mass, called 1, 2, ..."""
    n_dof = stiffness.shape[0]
    labels = tuple(map(str, range(1, n_dof + 1)))
    return Pair(sp.csc_array(mass * sp.eye_array(n_dof)), stiffness, labels)
