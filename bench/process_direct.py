"""The direct method beside the paper's way in numpy and scipy: CPU time and error.

    cmake --build --preset release --target benchmarks
    python bench/process_direct.py build/release/bin/bench_process_direct

The Python search does what Sec. 2.2 says for one sequence of signs: a root of Eq. (11) in delta, by
Brent's method, the autocovariance at every trial from the inverse of a matrix of 2M + 1 points. Its
error is that of K(m)/K(0), largest over m, against the same search with four times as many points.
Needs numpy and scipy.
"""

import os
import subprocess
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import inv, toeplitz
from scipy.optimize import brentq

HALF_WIDTH = 150


def weights(definition: str, length: float, m_max: int) -> np.ndarray:
    """a_m of Eqs. (13), (14)."""
    if definition == "L0":
        return np.r_[length, -np.ones(m_max)]
    return length - np.arange(m_max + 1)


def correlation(a: np.ndarray, delta: float, half_width: int) -> np.ndarray:
    """K(m)/K(0), m = 0..m_max, from the middle row of the inverse."""
    row = np.zeros(2 * half_width + 1)
    row[: a.size] = 0.5 * delta * a
    row[0] = 1.0 + delta * a[0]
    middle = inv(toeplitz(row))[half_width, half_width:]
    return middle[: a.size] / middle[0]


def search(a: np.ndarray, half_width: int) -> np.ndarray:
    """The solution with all signs plus, short of where g touches zero."""
    circle = np.cos(np.outer(np.linspace(0.0, np.pi, 4001), np.arange(a.size)))
    limit = -1.0 / (circle @ a).min()

    def excess(delta: float) -> float:
        return a @ np.abs(correlation(a, delta, half_width))

    return correlation(a, brentq(excess, 0.0, limit * (1.0 - 1e-9), xtol=1e-12), half_width)


def main(program: str) -> None:
    """Print a line for each request of the Fortran program."""
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    print(" request               entroslip ms  residual   numpy ms   its error    ratio")
    for line in done.stdout.splitlines():
        if "one sequence" not in line:
            continue
        request, numbers = line.split("one sequence")
        ours, residual = numbers.split()
        definition, length, _, m_max = request.replace("=", " ").replace(",", " ").split()
        a = weights(definition, float(length), int(m_max))
        try:
            start = time.process_time()
            found = search(a, HALF_WIDTH)
            theirs = 1e3 * (time.process_time() - start)
            error = f"{np.abs(found - search(a, 4 * HALF_WIDTH)).max():.1e}"
        except ValueError:  # so small a matrix has no root there
            theirs, error = 1e3 * (time.process_time() - start), "no root"
        print(
            f"{request.strip():22} {float(ours):11.3f} {residual:>9} {theirs:10.1f} {error:>11}"
            f" {theirs / float(ours):8.0f}"
        )


if __name__ == "__main__":
    main(sys.argv[1])
