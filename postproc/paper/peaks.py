"""Prominence of a spectrum at given frequencies, with the error of a Welch estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from .evidence import Finding, NoEvidence, claim_range

CORE, FLANK = 0.03, 0.09  # Hz from the frequency: the peak itself, and what it stands out from
_SEARCHED = 0.08  # of a frequency, around it, for the maximum that is nearest
_SMOOTHED = 5  # bins
_NEIGHBOURS = (1.0, 4.0 / 9.0, 1.0 / 36.0)  # correlation of bins 0, 1, 2 apart, Hann window


def prominence_weights(
    frequency: NDArray[np.float64], peaks: Sequence[float] | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weights of ln psd (frequency): mean near the peaks less mean of their flanks, all peaks."""
    each = [_weights(frequency, peak, (-1.0, 1.0)) for peak in peaks]
    return np.asarray(np.sum(each, axis=0) / len(peaks))


def local_maximum(
    frequency: NDArray[np.float64], ln_psd: NDArray[np.float64], peak: float, scatter: float
) -> Finding:
    """The claim of a local maximum: the mean near the peak is above that of either flank.

    The number is the smaller rise; a surely negative rise speaks against the claim.
    """
    rises = []
    for side in (-1.0, 1.0):
        weights = _weights(frequency, peak, (side,))
        error = error_of_sum(weights, scatter)
        rises.append(claim_range("", float(weights @ ln_psd), error, above=0.0))
    least = min(rises, key=lambda rise: rise.estimate)
    p_for = max(rise.p_for for rise in rises)
    p_against = min(1.0, 2.0 * min(rise.p_against for rise in rises))
    return replace(least, p_for=p_for, p_against=p_against)


def _weights(
    frequency: NDArray[np.float64], peak: float, sides: Sequence[float]
) -> NDArray[np.float64]:
    """Weights of ln psd (frequency): mean near a peak less mean of its flanks on these sides."""
    offset = frequency - peak
    distance = np.abs(offset)
    core = distance <= CORE
    flank = ~core & (distance <= FLANK) & np.isin(np.sign(offset), sides)
    if not (core.any() and flank.any()):
        raise NoEvidence(f"the spectrum is too coarse for a peak at {peak:g} Hz")
    return np.asarray(core / core.sum() - flank / flank.sum())


def nearest_maximum(
    frequency: NDArray[np.float64], ln_psd: NDArray[np.float64], peak: float
) -> float | None:
    """Frequency [Hz] of the maximum of smoothed ln psd that is nearest to a peak."""
    smooth = np.convolve(ln_psd, np.ones(_SMOOTHED) / _SMOOTHED, mode="same")
    highest = [
        float(frequency[k]) for k in np.flatnonzero(np.abs(frequency / peak - 1.0) <= _SEARCHED)
        if smooth[k] == smooth[max(k - _SMOOTHED, 0) : k + _SMOOTHED + 1].max()
    ]  # fmt: skip
    return min(highest, key=lambda hertz: abs(hertz - peak), default=None)


def scatter_of_ln_psd(data: xr.Dataset) -> float:
    """Standard deviation of ln psd in one bin, of Hann segments that overlap by half."""
    return float(data.attrs["psd_time_error"])


def error_of_sum(weights: NDArray[np.float64], scatter: float) -> float:
    """Standard error of sum(weights*ln psd), neighbouring bins being correlated."""
    total = 0.0
    for apart, correlation in enumerate(_NEIGHBOURS):
        products = float(weights[apart:] @ weights[: weights.size - apart])
        total += (1.0 if apart == 0 else 2.0) * correlation * products
    return scatter * float(np.sqrt(total))


def share_outside(
    data: xr.Dataset, low: float, high: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of the power (dof) outside low..high Hz of the first sample, and its standard error."""
    psd = data["psd"].isel(sample=0).values
    frequency = data["frequency"].values
    outside = (frequency < low) | (frequency > high)
    share = psd[outside].sum(axis=0) / psd.sum(axis=0)
    scatter = scatter_of_ln_psd(data)
    errors = [
        error_of_sum(psd[:, i] / psd[:, i].sum() * (outside - share[i]), scatter)
        for i in range(psd.shape[1])
    ]
    return share, np.array(errors)
