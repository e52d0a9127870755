"""Results that were never computed: a friction study whose statistics a test chooses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from entroslip.paper.printed import LENGTHS, LEVELS, SLIP_HZ, STDS, STUCK_HZ
from entroslip.results import Case, Results

FREQUENCY = np.arange(0, 173) * 0.01448  # Hz
LOW, HIGH = LEVELS
TINY = 1.0e-300  # where nothing scatters
MEAN_SLIP = {LOW: np.linspace(0.05, 0.35, 5), HIGH: np.linspace(0.4, 0.7, 5)}


def bumps(at, height):
    """ln of a spectrum (frequency) that stands out near these frequencies."""
    return height * sum(np.exp(-(((FREQUENCY - f) / 0.02) ** 2)) for f in at)


def case_of(name, process, slip, psd, starts=5000, n_segments=400, **attrs):
    """slip (sample, joint); psd (sample, frequency, dof)."""
    axes = ("sample", "joint")
    data = xr.Dataset(
        {
            "slip_fraction": (axes, slip),
            "slip_starts": (axes, np.full(slip.shape, starts)),
            "psd": (("sample", "frequency", "dof"), psd),
            **(sample_statistics(slip, psd) if len(slip) > 1 else {}),
        },
        coords={"frequency": FREQUENCY},
        attrs={
            "process": process,
            "n_segments": n_segments,
            "psd_time_error": np.sqrt((1 + (1 - 1 / n_segments) / 18) / n_segments),
            **attrs,
        },
    )
    return Case(name, data)


def sample_statistics(slip, psd):
    """Datasets of a case's statistics over samples, with their standard errors."""
    n = len(slip)
    mean, std = slip.mean(axis=0), slip.std(axis=0, ddof=1)
    fourth = ((slip - mean) ** 4).mean(axis=0)
    found = {
        "slip_mean": ("joint", mean),
        "slip_mean_error": ("joint", std / np.sqrt(n)),
        "slip_mean_time_error": ("joint", 0.0 * mean),
        "slip_std": ("joint", std),
        "slip_std_error": (
            "joint",
            np.sqrt(np.maximum(fourth - std**4, 0.0) / n) / (2 * std + TINY),
        ),
    }
    ranked = np.sort(psd, axis=0)
    share = np.array((0.05, 0.95))
    reach = 1.96 * np.sqrt(share * (1 - share) / n)  # binomial
    low, curve, high = (
        np.array([ranked[int(np.clip(round(at * (n - 1)), 0, n - 1))] for at in ends])
        for ends in (share - reach, share, share + reach)
    )
    power = curve.sum(axis=1) * FREQUENCY[1]  # (percentile, dof); all frequencies move alike
    error = (high - low).sum(axis=1) * FREQUENCY[1] / (2 * 1.96)
    spread = 1.96 * np.hypot(*(error / power))
    means = psd.sum(axis=1) * FREQUENCY[1]
    of_spectra = ("percentile", "frequency", "dof")
    return found | {
        "percentile": ("percentile", 100 * share),
        "psd_percentiles": (of_spectra, curve),
        "psd_percentiles_low": (of_spectra, low),
        "psd_percentiles_high": (of_spectra, high),
        "pseudo_variance_percentiles": (("percentile", "dof"), power),
        "pseudo_variance_percentiles_error": (("percentile", "dof"), error),
        "pseudo_variance_mean": ("dof", means.mean(axis=0)),
        "pseudo_variance_mean_error": ("dof", means.std(axis=0) / np.sqrt(n)),
        "band_ratio": ("dof", power[1] / power[0]),
        "band_ratio_low": ("dof", power[1] / power[0] * np.exp(-spread)),
        "band_ratio_high": ("dof", power[1] / power[0] * np.exp(spread)),
        "band_ratio_time_error": ("dof", 0.0 * spread),
    }  # fmt: skip


def results_of(cases):
    """A file that holds these cases of the paper's chain."""
    chain = xr.Dataset(
        {
            "frequencies_stuck": ("mode", list(STUCK_HZ)),
            "frequencies_slip": ("mode", list(SLIP_HZ)),
            "load": (("force", "dof"), np.eye(5)[4:]),
        }
    )
    return Results(Path("synthetic.h5"), {"title": "synthetic"}, {}, chain, cases)


def certain(variance, slip=None, ln_psd=0.0, starts=5000, n_segments=400):
    """A case with friction certain; ln_psd is a number, a spectrum, or (frequency, dof)."""
    slip = MEAN_SLIP.get(variance, np.full(5, 0.5)) if slip is None else np.asarray(slip, float)
    ln_psd = np.asarray(ln_psd, float)
    if ln_psd.ndim == 1:
        ln_psd = ln_psd[:, None]
    psd = np.exp(np.broadcast_to(ln_psd, (FREQUENCY.size, 5)))[None]
    given = {"variance": variance, "friction_from": "process%mean"}
    case = case_of("c001", "none", slip[None], psd, starts, n_segments, **given)
    case.data["friction"] = (("sample", "joint"), np.full((1, 5), 0.2))
    return case


def friction_study(
    scatter=lambda std, length, mean: 0.1 + 0 * mean,
    width=lambda std, length, variance: np.full(5, 0.5),
    level=lambda std, variance: np.zeros(5),
    shape=lambda width, z: np.exp(width * z),
    high_bumps=0.0,
    n_samples=40,
    seed=4,
):
    """The paper's twelve cases and the two with friction certain.

    scatter: standard deviation of the slip fractions over their mean; width: standard deviation of
    ln psd over samples (dof); level: ln psd (dof); shape: psd of normal deviates z of that width.
    Samples of a process share z, in all oscillators and at both variances.
    """
    cases = [certain(variance) for variance in LEVELS]
    processes = [(std, length) for std in STDS for length in LENGTHS]
    for number, (std, length) in enumerate(processes, start=1):
        random = np.random.default_rng([seed, number])
        z = random.standard_normal(n_samples)
        z = (z - z.mean()) / z.std()
        for variance in LEVELS:
            mean = MEAN_SLIP[variance]
            noise = random.standard_normal((n_samples, 5))
            slip = mean + scatter(std, length, mean) * (noise - noise.mean(axis=0))
            spread = shape(width(std, length, variance)[None, :], z[:, None])  # (sample, dof)
            rise = np.maximum(z, 0.0)[:, None, None] * bumps(SLIP_HZ[:3], high_bumps)[:, None]
            psd = spread[:, None, :] * np.exp(level(std, variance) + rise)
            cases.append(
                case_of("c003", f"p{number:03d}", slip, psd, std=std,
                        correlation_length=length, variance=variance)
            )  # fmt: skip
    return results_of(cases)


def process(length, order, curve=None, **changed):
    """A process of Sec. 2 with its autocovariance at 31 lags."""
    lags = np.arange(31)
    curve = 0.5**lags if curve is None else curve
    attrs = {"correlation": "L0", "correlation_length": length, "order": order, "mean": 0.0,
             "std": 1.0, "method": "direct", "positive": 0, "sampler": "sequential",
             "status": "solved"} | changed  # fmt: skip
    data = {
        "autocovariance": ("lag", curve), "autocovariance_error": ("lag", 1e-4 + 0.0 * curve),
        "a": ("order", np.ones(order)), "L0": length, "L1": length, "entropy": 1.3,
        "entropy_bound": 1.4189,
    }  # fmt: skip
    return xr.Dataset(data, {"lag": lags}, attrs)
