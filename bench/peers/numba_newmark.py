"""Newmark's average acceleration with the step halved at every transition, in numba; one sample.

The inverse of each stick pattern and step is kept once it is known.
"""

import numpy as np
from numba import njit

STRIDE = 100


@njit
def inverse(
    pattern: int, h: float, contact: float, stiffness: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """Inverse of the effective stiffness of a step h; bit i of the pattern: mass i is stuck."""
    m = stiffness + 2 / h * damping
    for i in range(len(m)):
        m[i, i] += 4 / h**2 + (contact if pattern >> i & 1 else 0.0)
    return np.linalg.inv(m)


@njit
def march(
    dt: float,
    contact: float,
    limit: float,
    stiffness: np.ndarray,
    damping: np.ndarray,
    force: np.ndarray,
    halvings: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Slip fractions (mass) and displacements (snapshot, mass)."""
    n, steps = len(stiffness), len(force) - 1
    x, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    xe, ve, ae, b = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    slider, way, slip = np.zeros(n), np.zeros(n, np.int64), np.zeros(n)
    switch = np.zeros(n, np.bool_)
    history = np.empty((steps // STRIDE, n))
    solve = np.zeros((halvings + 1, 2**n, n, n))
    is_known = np.zeros((halvings + 1, 2**n), np.bool_)
    finest = 2**halvings
    a[-1] = force[0]
    for k in range(steps):
        place, size, level = 0, finest, 0  # place and size in units of dt/finest
        while place < finest:
            h = dt * size / finest
            f = force[k] + (force[k + 1] - force[k]) * (place + size) / finest
            pattern = 0
            for i in range(n):
                pattern |= (way[i] == 0) << i
            if not is_known[level, pattern]:
                solve[level, pattern] = inverse(pattern, h, contact, stiffness, damping)
                is_known[level, pattern] = True
            for i in range(n):
                b[i] = 4 / h**2 * x[i] + 4 / h * v[i] + a[i]
                b[i] += contact * slider[i] if way[i] == 0 else -way[i] * limit
                for j in range(n):
                    b[i] += damping[i, j] * (2 / h * x[j] + v[j])
            b[n - 1] += f
            any_switch = False
            for i in range(n):
                xe[i] = 0.0
                for j in range(n):
                    xe[i] += solve[level, pattern, i, j] * b[j]
                ve[i] = 2 / h * (xe[i] - x[i]) - v[i]
                ae[i] = 4 / h**2 * (xe[i] - x[i]) - 4 / h * v[i] - a[i]
                if way[i] == 0:
                    switch[i] = contact * abs(xe[i] - slider[i]) > limit
                else:
                    switch[i] = way[i] * ve[i] < 0
                any_switch = any_switch or switch[i]
            if any_switch and size > 1:
                size //= 2
                level += 1
                continue
            for i in range(n):
                if way[i] != 0:
                    slip[i] += h
                x[i], v[i], a[i] = xe[i], ve[i], ae[i]
                if switch[i] and way[i] != 0:
                    slider[i] = x[i] - way[i] * limit / contact
                    way[i] = 0
                elif switch[i]:
                    way[i] = 1 if x[i] > slider[i] else -1
            if any_switch:
                for i in range(n):
                    a[i] = -way[i] * limit if way[i] != 0 else -contact * (x[i] - slider[i])
                    for j in range(n):
                        a[i] -= damping[i, j] * v[j] + stiffness[i, j] * x[j]
                a[n - 1] += f
            place += size
            while size < finest and place % (2 * size) == 0:
                size *= 2
                level -= 1
        if (k + 1) % STRIDE == 0:
            history[k // STRIDE] = x
    return slip / (dt * steps), history
