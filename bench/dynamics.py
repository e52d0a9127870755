"""Work and precision of the marches beside scipy's integrator with event location, in one run.

    cmake --build --preset release --target benchmarks
    python bench/dynamics.py build/release/bin/bench_dynamics

scipy's DOP853 restarts at every force sample and every transition; a step that short is exact to rounding even at
the loose tolerance given here. Its time is per sample-step of one sample. Needs numpy and scipy.
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

REFERENCE = Path(__file__).parents[1] / "tests/reference/dynamics"
DT, STIFFNESS, CONTACT, LIMIT, RATIO, N = 0.00843, 25.0, 50.0, 0.2 * 10.0, 0.005, 5


def chain() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness with all sliders slipping, and the modal damping of the stuck chain (unit masses)."""
    k = 2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
    k[-1, -1] = 1.0
    k *= STIFFNESS
    squares, modes = np.linalg.eigh(k + CONTACT * np.eye(N))
    return k, modes @ np.diag(2 * RATIO * np.sqrt(squares)) @ modes.T


def march(force: np.ndarray, tolerance: float) -> np.ndarray:
    """Displacements after every step (step, mass)."""
    stiffness, damping = chain()
    state, slider, way = np.zeros(2 * N), np.zeros(N), np.zeros(N)
    history = []
    for f0, f1 in zip(force[:-1], force[1:]):
        begin = 0.0
        while begin < DT:

            def rate(t: float, y: np.ndarray) -> np.ndarray:
                x, v = y[:N], y[N:]
                contact = np.where(way == 0, CONTACT * (x - slider), way * LIMIT)
                a = -damping @ v - stiffness @ x - contact
                a[-1] += f0 + (f1 - f0) * t / DT
                return np.concatenate([v, a])

            def guard(i: int):
                if way[i] == 0:
                    function = lambda t, y: LIMIT - CONTACT * abs(y[i] - slider[i])
                else:
                    function = lambda t, y: way[i] * y[N + i]
                function.terminal, function.direction = True, -1
                return function

            run = solve_ivp(rate, (begin, DT), state, "DOP853", rtol=tolerance, atol=tolerance * 1e-2,
                            events=[guard(i) for i in range(N)])
            state, begin = run.y[:, -1].copy(), run.t[-1]
            for i in range(N):
                if run.t_events[i].size == 0:
                    continue
                if way[i] == 0:
                    way[i] = np.sign(state[N + i])
                else:
                    slider[i] = state[i] - way[i] * LIMIT / CONTACT
                    way[i], state[N + i] = 0.0, 0.0
        history.append(state[:N].copy())
    return np.array(history)


def main() -> None:
    """Our table, then scipy's line for each case."""
    print(subprocess.run([sys.argv[1], str(REFERENCE)], check=True, capture_output=True, text=True).stdout)
    for case in ("p1_low", "p2_high"):
        steps = 600
        force = np.loadtxt(REFERENCE / f"{case}_force.txt")[: steps + 1]
        exact = np.loadtxt(REFERENCE / f"{case}_x.txt")
        begin = time.process_time()
        history = march(force, 1e-6)
        nanoseconds = (time.process_time() - begin) / steps * 1e9
        rows = exact[1:][exact[1:, 0] <= steps]
        error = history[rows[:, 0].astype(int) - 1] - rows[:, 1:]
        rms = np.sqrt(np.mean(exact[:, 1:] ** 2, axis=0))
        print(f"{case:8s} scipy DOP853 1e-6 {nanoseconds:12.0f} {np.max(np.abs(error) / rms):10.2e}")


if __name__ == "__main__":
    main()
