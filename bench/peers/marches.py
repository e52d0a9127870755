"""One sample marched with the tools that Python users have.

Each march returns CPU seconds, the slip fractions and the displacements at every 100th step.
"""

import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from problem import N, Problem

STRIDE = 100


def scipy_events(problem: Problem, setting: str) -> tuple[float, np.ndarray, np.ndarray]:
    """DOP853 with event location, started anew at every force sample and every transition.

    A step that short is exact to rounding even at a loose tolerance.
    """
    from scipy.integrate import solve_ivp

    tolerance, dt, contact, limit = float(setting), problem.dt, problem.contact, problem.limit
    state, slider, way, slip = np.zeros(2 * N), np.zeros(N), np.zeros(N), np.zeros(N)
    history = []
    begin = time.process_time()
    for f0, f1 in pairwise(problem.force):
        start = 0.0
        while start < dt:

            def rate(t: float, y: np.ndarray, f0: float = f0, f1: float = f1) -> np.ndarray:
                x, v = y[:N], y[N:]
                a = -problem.damping @ v - problem.stiffness @ x
                a -= np.where(way == 0, contact * (x - slider), way * limit)
                a[-1] += f0 + (f1 - f0) * t / dt
                return np.concatenate([v, a])

            def guard(i: int) -> Callable[[float, np.ndarray], float]:
                def function(t: float, y: np.ndarray) -> float:
                    if way[i] == 0:
                        return limit - contact * abs(y[i] - slider[i])
                    return way[i] * y[N + i]

                function.terminal, function.direction = True, -1
                return function

            events = [guard(i) for i in range(N)]
            run = solve_ivp(
                rate,
                (start, dt),
                state,
                "DOP853",
                rtol=tolerance,
                atol=tolerance / 100,
                events=events,
            )
            slip += (run.t[-1] - start) * (way != 0)
            state, start = run.y[:, -1].copy(), run.t[-1]
            for i in range(N):
                if run.t_events[i].size == 0:
                    continue
                if way[i] == 0:
                    way[i] = np.sign(state[N + i])
                else:
                    slider[i] = state[i] - way[i] * limit / contact
                    way[i], state[N + i] = 0.0, 0.0
        history.append(state[:N].copy())
    seconds = time.process_time() - begin
    return seconds, slip / (dt * problem.steps), np.array(history[STRIDE - 1 :: STRIDE])


def opensees(problem: Problem, setting: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Average acceleration with Newton iterations and return mapping; `setting` divides dt.

    No step is halved at a transition. Slip fractions are not among its results.
    """
    import openseespy.opensees as ops

    divided = int(setting)
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    coupling = problem.stiffness[-1, -1]
    ops.uniaxialMaterial("Elastic", 1, coupling)
    ops.uniaxialMaterial("ElasticPP", 2, problem.contact, problem.limit / problem.contact)
    for i in range(2 * N + 1):  # the wall, the masses, the ground below each
        ops.node(i, 0.0)
    ops.fix(0, 1)
    for i in range(1, N + 1):
        ops.mass(i, 1.0)
        ops.fix(N + i, 1)
        ops.element("zeroLength", i, i - 1, i, "-mat", 1, "-dir", 1)
        ops.element("zeroLength", N + i, N + i, i, "-mat", 2, "-dir", 1)
    ops.timeSeries("Path", 1, "-dt", problem.dt, "-values", *problem.force)
    ops.pattern("Plain", 1, 1)
    ops.load(N, 1.0)
    ratio = modal_ratio(problem)
    ops.eigen("-fullGenLapack", N)  # all modes: the default solver gives all but one
    ops.modalDamping(ratio)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("NormUnbalance", 1e-10, 20)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    history = []
    begin = time.process_time()
    for _ in range(problem.steps // STRIDE):
        ops.analyze(STRIDE * divided, problem.dt / divided)
        history.append([ops.nodeDisp(i, 1) for i in range(1, N + 1)])
    return time.process_time() - begin, np.full(N, np.nan), np.array(history)


def modal_ratio(problem: Problem) -> float:
    """The damping ratio that all modes of the stuck chain share."""
    squares, modes = np.linalg.eigh(problem.stiffness + problem.contact * np.eye(N))
    return float((modes.T @ problem.damping @ modes)[0, 0] / (2 * np.sqrt(squares[0])))


def numba_newmark(problem: Problem, setting: str) -> tuple[float, np.ndarray, np.ndarray]:
    """The paper's scheme, compiled by numba; compiling is not counted."""
    from numba_newmark import march

    arguments = (problem.dt, problem.contact, problem.limit, problem.stiffness, problem.damping)
    march(*arguments, problem.force[:200], int(setting))
    begin = time.process_time()
    slip, history = march(*arguments, problem.force, int(setting))
    return time.process_time() - begin, slip, history
