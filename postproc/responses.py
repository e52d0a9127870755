"""Responses of a case as people ask for them: histories over time, spectra of derivatives."""

from __future__ import annotations

import numpy as np
import xarray as xr

from .results import Case, ResultsError


def history(case: Case, sample: int = 0) -> xr.Dataset:
    """Displacement and velocity of a sample (time, kept dof), with `time` [s] as coordinate."""
    if not case.has("displacement", "velocity", "time"):
        raise ResultsError(
            f"{case.name}: has no history: replay the sample, or ask for it by"
            " output%quantities = 'history'"
        )
    of_sample = case.data[["displacement", "velocity"]].isel(sample=sample, drop=True)
    return of_sample.sel(dof=case.kept_dofs)


def velocity_psd(case: Case) -> xr.DataArray:
    """Power spectral density of the velocity [m^2/s^2/Hz], from that of the displacement."""
    return _derivative(case, 1, "velocity", "m^2/s^2/Hz")


def acceleration_psd(case: Case) -> xr.DataArray:
    """Power spectral density of the acceleration [m^2/s^4/Hz], from that of the displacement."""
    return _derivative(case, 2, "acceleration", "m^2/s^4/Hz")


def _derivative(case: Case, order: int, name: str, unit: str) -> xr.DataArray:
    if not case.has("psd"):
        raise ResultsError(f"{case.name}: has no spectra: output%quantities = 'spectrum'")
    psd = case.data["psd"]
    found: xr.DataArray = psd * (2 * np.pi * psd["frequency"]) ** (2 * order)
    found.attrs = {"units": unit, "long_name": f"power spectral density of the {name}, one-sided"}
    return found
