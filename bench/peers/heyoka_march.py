"""The march by heyoka.py: Taylor series with event location, as many samples as a register holds.

Regimes are parameters of a lane, so nothing is compiled anew at a transition: terminal events
switch them. Every interval of the force is one call for all lanes.
"""

import time
from collections.abc import Callable

import heyoka as hy
import numpy as np
from problem import N, Problem

STRIDE = 100
STUCK, SLIDER, WAY, REACH = (slice(k * N, (k + 1) * N) for k in range(4))  # parameters
SLOPE = 4 * N  # of the force


def march(problem: Problem, setting: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Lane 1 is the reference, the others differ in friction; CPU time of one sample."""
    lanes = hy.recommended_simd_size()
    slip, since = np.zeros((N, lanes)), np.zeros((N, lanes))  # time in slip; where it began
    taylor = integrator(problem, float(setting), lanes, slip, since)
    state, parameters = taylor.state, taylor.pars
    parameters[STUCK] = 1.0
    parameters[REACH] = problem.limit / problem.contact
    parameters[REACH, 1:] *= np.random.default_rng(1).uniform(0.5, 1.5, (N, lanes - 1))
    history = []
    begin = time.process_time()
    for k in range(problem.steps):
        state[2 * N] = problem.force[k]
        parameters[SLOPE] = (problem.force[k + 1] - problem.force[k]) / problem.dt
        taylor.propagate_until(np.full(lanes, (k + 1) * problem.dt))
        if (k + 1) % STRIDE == 0:
            history.append(state[:N, 0].copy())
    seconds = time.process_time() - begin
    end = problem.steps * problem.dt
    slip += np.where(parameters[STUCK] > 0.0, 0.0, end - since)
    return seconds / lanes, slip[:, 0] / end, np.array(history)


def integrator(
    problem: Problem, tolerance: float, lanes: int, slip: np.ndarray, since: np.ndarray
) -> hy.taylor_adaptive_batch:
    """State: x, v and the force, which is linear in time."""
    x, v = hy.make_vars(*(f"x{i}" for i in range(N))), hy.make_vars(*(f"v{i}" for i in range(N)))
    force = hy.make_vars("force")
    stuck, slider, way, reach = ([hy.par[k * N + i] for i in range(N)] for k in range(4))
    rates = []
    for i in range(N):
        pulls = [problem.damping[i, j] * v[j] for j in range(N)]
        pulls += [problem.stiffness[i, j] * x[j] for j in range(N) if problem.stiffness[i, j]]
        pulls.append(problem.contact * (stuck[i] * (x[i] - slider[i]) + way[i] * reach[i]))
        rates.append((force if i == N - 1 else 0.0) - hy.sum(pulls))
    equations = [*zip(x, v, strict=True), *zip(v, rates, strict=True), (force, hy.par[SLOPE])]
    events = [
        hy.t_event_batch(
            stuck[i] * (reach[i] ** 2 - (x[i] - slider[i]) ** 2) + way[i] * v[i],
            callback=switch(i, slip, since),
            direction=hy.event_direction.negative,
        )
        for i in range(N)
    ]
    start = np.zeros((2 * N + 1, lanes))
    parameters = np.zeros((4 * N + 1, lanes))
    return hy.taylor_adaptive_batch(
        equations, start, tol=tolerance, pars=parameters, t_events=events
    )


def switch(
    i: int, slip: np.ndarray, since: np.ndarray
) -> Callable[[hy.taylor_adaptive_batch, int, int], bool]:
    """Callback that changes the regime of mass i at a zero of its guard."""

    def callback(taylor: hy.taylor_adaptive_batch, sign: int, lane: int) -> bool:
        now, p, state = taylor.time[lane], taylor.pars[:, lane], taylor.state[:, lane]
        if p[i] > 0.0:
            p[i], p[2 * N + i], since[i, lane] = 0.0, np.sign(state[N + i]), now
        else:
            p[i], p[N + i] = 1.0, state[i] - p[2 * N + i] * p[3 * N + i]
            p[2 * N + i], state[N + i] = 0.0, 0.0
            slip[i, lane] += now - since[i, lane]
        return True

    return callback
