"""The figures of the friction study (Sec. 3), one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from . import style
from .certain_statements import FULLY, slip_with_error
from .paper import LEVELS
from .results import Case, Results
from .slip_statements import ABOUT_03

_BEYOND_STUCK = 1.6  # drawn of a spectrum: to this multiple of the highest stuck frequency
_DECADES = 7.0  # drawn of a spectrum
_MOST_MODES = 20  # marked; more would hide the curves
_SLIP_AXIS = "mean fraction of time in slip"


def variance_name(variance: float) -> str:
    """'variance 3.7 (low)', with the paper's name where it has one."""
    if variance == 0.0:
        return "force from a file"
    name = LEVELS.get(variance)
    return f"variance {variance:g}" + (f" ({name})" if name else "")


def plot_spectra(axes: Axes, case: Case, results: Results) -> None:
    """Fig. 8: power spectral densities of the oscillators in one sample."""
    spectrum = case.data["psd"].isel(sample=0)
    drawn = style.some_of(case.n_dof)
    for dof in drawn:
        axes.semilogy(
            spectrum["frequency"], spectrum.isel(dof=dof - 1),
            label=f"oscillator {dof}", **style.line_of_dof(dof, case.n_dof),
        )  # fmt: skip
    _mark_chain(axes, results)
    _frame_spectrum(axes, spectrum["frequency"].values, spectrum.values, results)


def slip_mean_error(case: Case) -> NDArray[np.float64]:
    """Of the mean time in slip: Monte Carlo and time average together."""
    error = case.data["slip_mean_error"].values
    return np.hypot(error, case.data.get("slip_mean_time_error", 0.0 * error))


def band_ratio_interval(case: Case) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The 95 % interval of the band ratio: Monte Carlo and time average together."""
    ratio = case.data["band_ratio"].values
    spread = np.log(case.data["band_ratio_high"].values / ratio)
    if case.has("band_ratio_time_error"):
        spread = np.hypot(spread, 1.96 * case.data["band_ratio_time_error"].values / ratio)
    return ratio * np.exp(-spread), ratio * np.exp(spread)


def plot_slip_scatter(axes: Axes, cases: Sequence[Case]) -> None:
    """Fig. 9: scatter of the time in slip over its mean, a mark per oscillator, bars one s.e."""
    axes.axvspan(*ABOUT_03, color="0.94", zorder=0, label="a mean of about 0.3")
    for case, look, label in _by_length(cases):
        axes.errorbar(
            case.data["slip_mean"], case.data["slip_std"],
            xerr=slip_mean_error(case), yerr=case.data["slip_std_error"],
            label=label, elinewidth=0.8, **look,
        )  # fmt: skip
    axes.set(
        xlabel=_SLIP_AXIS, ylabel="standard deviation over samples", xlim=(0, None), ylim=(0, None)
    )
    axes.legend(ncols=2)


def plot_band(axes: Axes, cases: Sequence[Case], dof: int, results: Results) -> None:
    """Fig. 10: mean (thick) and outer percentiles (thin) of the spectra of one oscillator.

    Shaded: 95 % intervals of the percentiles. Several variances in one panel stand apart as sets
    of curves, the larger one higher, each named.
    """
    lengths = sorted({case.correlation_length for case in cases})
    values = []
    for case in cases:
        colour = style.of_length(case.correlation_length, lengths)["color"]
        line = style.dashes(lengths.index(case.correlation_length))
        one = case.data.isel(dof=dof - 1)
        frequency = one["frequency"].values
        axes.semilogy(
            frequency, one["psd_mean"], color=colour, linestyle=line, linewidth=1.5,
            label=f"$L$ = {case.correlation_length:g}",
        )  # fmt: skip
        for outer in (0, -1):
            edge = one["psd_percentiles"].values[outer]
            axes.semilogy(frequency, edge, color=colour, linestyle=line, linewidth=0.8)
            if case.has("psd_percentiles_low", "psd_percentiles_high"):
                low, high = (one[f"psd_percentiles_{end}"].values[outer] for end in ("low", "high"))
                axes.fill_between(frequency, low, high, alpha=0.15, linewidth=0, color=colour)
            values.append(edge)
    variances = sorted({case.variance for case in cases})
    for variance in variances:
        level = "" if len(variances) == 1 else LEVELS.get(variance, f"{variance:g} N²")
        alike = [case.data.isel(dof=dof - 1) for case in cases if case.variance == variance]
        _name_curves(axes, alike, level, _last_shown(frequency, results))
    _mark_chain(axes, results, stuck=False)
    _frame_spectrum(axes, frequency, np.stack(values), results)
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(list(unique.values()), list(unique.keys()))


def _name_curves(axes: Axes, alike: Sequence[xr.Dataset], level: str, last: float) -> None:
    """Says at the curves what they are: the mean, the percentiles, or all of a level."""
    frequency = alike[0]["frequency"].values
    low, mean, high = (
        np.stack([curve.values for curve in curves])
        for curves in (
            [one["psd_percentiles"][0] for one in alike],
            [one["psd_mean"] for one in alike],
            [one["psd_percentiles"][-1] for one in alike],
        )
    )
    shown = np.flatnonzero((frequency > 0.1 * last) & (frequency < 0.6 * last) & (low > 0).all(0))
    if not shown.size:
        return
    apart = high[:, shown].min(axis=0) / low[:, shown].max(axis=0)
    wide, narrow = shown[np.argmax(apart)], shown[np.argmin(apart)]
    first, final = alike[0]["percentile"].values[[0, -1]]
    names = [
        (f"{first:g} %", wide, low[:, wide].min(), "top"),
        ("mean", wide, mean[:, wide].max(), "bottom"),
        (f"{final:g} %", wide, high[:, wide].max(), "bottom"),
    ]
    if level:
        names = [(level, narrow, high[:, narrow].max(), "bottom")]
    for text, at, value, side in names:
        axes.annotate(
            text, (frequency[at], value), (0, 3 if side == "bottom" else -3),
            textcoords="offset points", ha="center", va=side, fontsize=8.5,
            path_effects=[withStroke(linewidth=2.5, foreground="w")],
        )  # fmt: skip


def plot_band_ratio(axes: Axes, cases: Sequence[Case]) -> None:
    """Fig. 11: ratio of the outer percentiles' pseudo-variances over the mean time in slip."""
    for case, look, label in _by_length(cases):
        ratio = case.data["band_ratio"].values
        low, high = band_ratio_interval(case)
        axes.errorbar(
            case.data["slip_mean"], ratio, xerr=slip_mean_error(case),
            yerr=np.clip([ratio - low, high - ratio], 0.0, None),
            label=label, elinewidth=0.8, **look,
        )  # fmt: skip
    first, last = cases[0].data["percentile"].values[[0, -1]]
    axes.set_yscale("log")
    for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        ticks(FuncFormatter(_short_tick))
    axes.legend(ncols=2)
    axes.set(
        xlabel=_SLIP_AXIS,
        ylabel=rf"band ratio $\sigma_{{{last:g}}}^2\,/\,\sigma_{{{first:g}}}^2$",
        xlim=(0, None),
    )


def plot_sweep(axes: Axes, cases: Sequence[Case]) -> None:
    """Time in slip of each oscillator over the variance of the force, bars two standard errors."""
    cases = sorted(cases, key=lambda case: case.variance)
    variance = [case.variance for case in cases]
    slips = [slip_with_error(case) for case in cases]
    for joint in style.some_of(cases[0].n_joints):
        axes.errorbar(
            variance, [slip[joint - 1] for slip, _ in slips],
            yerr=[2.0 * error[joint - 1] for _, error in slips],
            label=f"oscillator {joint}", elinewidth=0.8,
            **style.of_dof(joint, cases[0].n_joints),
        )  # fmt: skip
    for edge in (FULLY, 1.0 - FULLY):
        axes.axhline(edge, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axes.set_xscale("log")
    axes.set(xlabel="variance of the force [N²]", ylabel="fraction of time in slip", ylim=(0, 1))
    axes.legend()


def plot_sweep_spectra(axes: Axes, cases: Sequence[Case], results: Results) -> None:
    """Spectra of the first oscillator over the variance of the force, from stuck to slipping."""
    cases = sorted(cases, key=lambda case: case.variance)
    chosen = [cases[i - 1] for i in style.some_of(len(cases), 6)]
    values = []
    for rank, case in enumerate(chosen):
        spectrum = case.data["psd"].isel(sample=0, dof=0) / case.variance
        look = style.of_rank(rank, len(chosen)) | {"marker": "none"}
        axes.semilogy(spectrum["frequency"], spectrum, label=f"{case.variance:g} N²", **look)
        values.append(spectrum.values)
    _mark_chain(axes, results)
    _frame_spectrum(axes, spectrum["frequency"].values, np.stack(values), results)
    axes.set_ylabel("power spectral density / variance [m²/(N² Hz)]")


def _mark_chain(axes: Axes, results: Results, stuck: bool = True) -> None:
    chain = results.structure
    if chain is not None and chain.sizes["mode"] <= _MOST_MODES:
        if stuck:
            style.mark_frequencies(axes, chain["frequencies_stuck"].values, "modes, stuck", "-")
        style.mark_frequencies(axes, chain["frequencies_slip"].values, "modes, slipping", ":")


def _short_tick(value: float, _: int) -> str:
    """Plain numbers on a logarithmic axis, where there is room for them."""
    leading = float(f"{value:e}".split("e")[0])
    return f"{value:g}" if leading in (1.0, 2.0, 3.0, 5.0) else ""


def _by_length(cases: Sequence[Case]) -> list[tuple[Case, style.Look, str]]:
    """Cases with their look: colour and mark by length, filled at the largest excitation."""
    lengths = [case.correlation_length for case in cases]
    variances = sorted({case.variance for case in cases})
    rows = []
    for case in cases:
        look = style.of_length(case.correlation_length, lengths) | {"linestyle": "none"}
        if case.variance != variances[-1]:
            look["markerfacecolor"] = "none"
        name = LEVELS.get(case.variance, variance_name(case.variance))
        rows.append((case, look, f"$L$ = {case.correlation_length:g}, {name}"))
    return rows


def _frame_spectrum(
    axes: Axes, frequency: NDArray[np.float64], values: NDArray[np.float64], results: Results
) -> None:
    positive = values[values > 0]
    if positive.size:
        top = 10 ** np.ceil(np.log10(positive.max()))
        axes.set_ylim(top * 10**-_DECADES, top)
    axes.set(
        xlabel="frequency [Hz]", ylabel="power spectral density [m²/Hz]",
        xlim=(0.0, _last_shown(frequency, results)),
    )  # fmt: skip
    axes.legend(ncols=2)


def _last_shown(frequency: NDArray[np.float64], results: Results) -> float:
    """The highest frequency drawn."""
    last = float(frequency[-1])
    if results.structure is None:
        return last
    return min(last, _BEYOND_STUCK * float(results.structure["frequencies_stuck"][-1]))
