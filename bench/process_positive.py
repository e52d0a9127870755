"""Positive processes beside numpy and scipy doing the same work: points per second, and the fits.

    cmake --build --preset release --target benchmarks
    python bench/process_positive.py build/release/bin/bench_process_positive

The Python sampler marches as many chains side by side as is best for numpy, draws each value by the
inverse of its truncated normal law, and adds up the products of all lags: what the Fortran program
times, without its control variates. Needs numpy and scipy.
"""

import os
import subprocess
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.special import ndtr, ndtri

N_CHAINS = 16384
N_STEPS = 200


def coefficients(order: int) -> np.ndarray:
    """a_1 .. a_M of the program's process: all reflection coefficients equal."""
    a = np.ones(1)
    for _ in range(order):
        a = np.append(a, 0.0)
        a = a - 0.5 / order * a[::-1]
    return a[1:]


def speed(order: int, n_lags: int) -> float:
    """Million points per second and core of one-at-a-time truncated draws with all products."""
    rng = np.random.default_rng(2016)
    a = coefficients(order)
    history = np.full((n_lags + 1, N_CHAINS), 2.0)  # the newest first, a ring
    products = np.zeros((n_lags + 1, N_CHAINS))
    start = time.process_time()
    for step in range(N_STEPS):
        newest = -step % (n_lags + 1)
        past = (newest + 1 + np.arange(order)) % (n_lags + 1)
        c = 1.0 - a @ history[past]
        below = ndtr(-c)
        history[newest] = c + ndtri(below + rng.random(N_CHAINS) * (1.0 - below))
        for lag in range(n_lags + 1):
            products[lag] += history[newest] * history[(newest + lag) % (n_lags + 1)]
    return 1e-6 * N_STEPS * N_CHAINS / (time.process_time() - start)


def main(program: str) -> None:
    """Print the program's table of speeds with numpy beside it, then its fits and their sums."""
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    print("law         M  lags   million points/s and core    numpy    ratio")
    total: dict[str, float] = {}
    for line in done.stdout.splitlines():
        words = line.split()
        if len(words) == 4:
            law, order, lags, ours = words[0], int(words[1]), int(words[2]), float(words[3])
            beside = ""
            if law == "sequential":
                theirs = speed(order, lags)
                beside = f" {theirs:8.1f} {ours / theirs:8.1f}"
            print(f"{law:10} {order:3} {lags:5} {ours:27.1f}{beside}")
        else:
            print(line)
            if words[0] != "#":
                total[words[0]] = total.get(words[0], 0.0) + float(words[4])
    for law, seconds in total.items():
        print(f"six fits, {law}: {seconds:.1f} s of one core, {seconds / 2:.1f} s on 2 ranks")


if __name__ == "__main__":
    main(sys.argv[1])
