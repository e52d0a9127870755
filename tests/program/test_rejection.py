"""Draws of the paper's positive processes, literally as in its Sec. 2.4, agree with their fits."""

from __future__ import annotations

import re

import h5py
import numpy as np

from tests.conftest import ROOT

N_CHAINS, N_GROUPS, N_STEPS = 2000, 20, 500
BURN_IN = 200  # the largest pole of the six, 0.94, leaves 1e-5 of a start at the mean
STANDARD_ERRORS = 4.0


def draw(a: np.ndarray, b0: float, mu: float, start: float, seed: int) -> np.ndarray:
    """Values (step, chain): each is drawn anew from the Gaussian conditional law until positive."""
    random = np.random.default_rng(seed)
    x = np.full((len(a) + BURN_IN + N_STEPS, N_CHAINS), start)
    for n in range(len(a), len(x)):
        mean = mu - a @ (x[n - len(a) : n][::-1] - mu)
        x[n] = random.normal(mean, b0)
        while (refused := np.flatnonzero(x[n] <= 0)).size:
            x[n, refused] = random.normal(mean[refused], b0)
    return x[-N_STEPS:]


def statistics(x: np.ndarray, mean: float, signs: np.ndarray) -> np.ndarray:
    """Mean, std and L0; lags count with these signs: noise of small ones has no bias."""
    d = x - mean
    k = [np.mean(d[m:] * d[: len(d) - m]) for m in range(len(signs))]
    return np.array([x.mean(), k[0] ** 0.5, np.dot(signs[1:], k[1:]) / k[0]])


def test_rejection_one_at_a_time_has_the_moments_of_the_fits(entroslip, tmp_path):
    scene = (ROOT / "input/paper_event.nml").read_text()
    groups = re.findall(r"^&(?:scene|process)\n.*?^/\n", scene, re.MULTILINE | re.DOTALL)
    (tmp_path / "fits.nml").write_text("".join(groups))
    done = entroslip("run", "fits.nml", "--output", "fits.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "fits.h5") as results:
        processes = results["process"]
        assert len(processes) == 6
        for seed, process in enumerate(processes.values()):
            wanted, stated = (
                np.array([process[name + kind][()] for name in ("mean_found", "std_found", "L0")])
                for kind in ("", "_error")
            )
            x = draw(process["a"][()], process["b0"][()], process["mu"][()], wanted[0], seed)
            signs = np.sign(process["autocovariance"][()])
            parts = [statistics(part, x.mean(), signs) for part in np.split(x, N_GROUPS, axis=1)]
            error = np.hypot(np.std(parts, axis=0, ddof=1) / N_GROUPS**0.5, stated)
            assert np.all(error < [0.002 * wanted[0], 0.002 * wanted[1], 0.04 * wanted[2]])
            deviation = (np.mean(parts, axis=0) - wanted) / error
            assert np.all(np.abs(deviation) < STANDARD_ERRORS), (process.name, deviation)
