"""Autoregressive fits beside scipy's SLSQP doing the same work: entropies, and ratios of CPU time.

    cmake --build --preset release --target benchmarks
    python bench/process_ar.py build/release/bin/bench_process_ar

The Python search maximizes the entropy in atanh(kappa) under the correlation length summed over
enough lags, from random starts, with SLSQP's own differences. Its time is that of one start; its
share is how many of the starts end within 1e-6 nat of the best. Needs numpy and scipy.
"""

import os
import subprocess
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter

N_STARTS = 10
HALF_LOG_TWO_PI_E = 0.5 * np.log(2 * np.pi * np.e)


def coefficients(kappa: np.ndarray) -> np.ndarray:
    """1, a_1 .. a_M from reflection coefficients."""
    a = np.ones(1)
    for k in kappa:
        a = np.append(a, 0.0)
        a = a + k * a[::-1]
    return a


def length(definition: str, kappa: np.ndarray, n_lags: int) -> float:
    """Eq. (8) or (9) of the autocorrelation, that of the impulse response."""
    impulse = np.zeros(n_lags)
    impulse[0] = 1.0
    response = np.fft.rfft(lfilter([1.0], coefficients(kappa), impulse), 2 * n_lags)
    k = np.abs(np.fft.irfft(np.abs(response) ** 2)[:n_lags])
    if definition == "L0":
        return k[1:].sum() / k[0]
    return (np.arange(n_lags) * k).sum() / k.sum()


def search(definition: str, target: float, order: int, rng: np.random.Generator) -> float:
    """Entropy where one search from a random start ends; -inf where it fails."""
    n_lags = int(400 * (1 + target))

    def excess(x: np.ndarray) -> float:
        return length(definition, np.tanh(x), n_lags) - target

    found = minimize(
        lambda x: np.log(np.cosh(x)).sum(),
        rng.normal(scale=0.3, size=order),
        method="SLSQP",
        constraints={"type": "eq", "fun": excess},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    return HALF_LOG_TWO_PI_E - found.fun if abs(excess(found.x)) < 1e-6 else -np.inf


def main(program: str) -> None:
    """Print the table: a line for each case of the Fortran program."""
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    print(
        "            ------- entroslip ----------------"
        "   ---- scipy, one of 10 starts ----   CPU time,"
    )
    print(
        "     L   M       entropy  residual   fit, rivals"
        "   best entropy   share        ms   one start/fit"
    )
    for line in done.stdout.splitlines()[1:]:
        definition, target, order, entropy, residual, fit_ms, rivals_ms = line.split()
        fitted = f"{definition} {target:>4} {order:>3} {entropy} {residual:>9}"
        fitted += f" {fit_ms:>6} {rivals_ms:>6}"
        if int(order) > 10:
            print(fitted)
            continue
        rng = np.random.default_rng(2016)
        start = time.process_time()
        with np.errstate(all="ignore"):
            found = np.array(
                [search(definition, float(target), int(order), rng) for _ in range(N_STARTS)]
            )
        python_ms = 1e3 * (time.process_time() - start) / N_STARTS
        share = np.mean(found > found.max() - 1e-6)
        print(
            f"{fitted}   {found.max():12.8f}   {share:5.0%}"
            f" {python_ms:9.1f} {python_ms / float(fit_ms):12.0f}"
        )


if __name__ == "__main__":
    main(sys.argv[1])
