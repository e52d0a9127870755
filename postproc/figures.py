"""The figures of the friction study (Sec. 3), one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from postproc import style
from postproc.paper import LEVELS
from postproc.results import Case, Results

FREQUENCY_RANGE = (0.0, 3.0)  # Hz, as far as the paper's figures speak of


def variance_name(variance: float) -> str:
    """'variance 3.7 (low)', with the paper's name where it has one."""
    name = LEVELS.get(variance)
    return f"variance {variance:g}" + (f" ({name})" if name else "")


def plot_spectra(axes: Axes, case: Case, results: Results) -> None:
    """Fig. 8: power spectral densities of all oscillators, friction certain."""
    spectrum = case.data["psd"].isel(sample=0)
    for dof in range(1, case.n_dof + 1):
        axes.semilogy(
            spectrum["frequency"], spectrum.isel(dof=dof - 1),
            label=f"oscillator {dof}", **style.of_dof(dof, case.n_dof),
        )  # fmt: skip
    if results.chain is not None:
        style.mark_frequencies(axes, results.chain["frequencies_stuck"].values, "stuck", "-")
        style.mark_frequencies(axes, results.chain["frequencies_slip"].values, "slipping", ":")
    _frame_spectrum(axes, spectrum.values)
    axes.set_title(f"no uncertainty, {variance_name(case.variance)}")


def plot_slip_scatter(axes: Axes, cases: Sequence[Case]) -> None:
    """Fig. 9: scatter of the time in slip over its mean, a mark per oscillator, bars one s.e."""
    for case, look, label in _by_length(cases):
        axes.errorbar(
            case.data["slip_mean"], case.data["slip_std"],
            xerr=case.data["slip_mean_error"], yerr=case.data["slip_std_error"],
            label=label, elinewidth=0.8, **look,
        )  # fmt: skip
    axes.axvline(0.3, color="0.55", linewidth=0.8, linestyle="--", zorder=0, label="mean of 0.3")
    axes.set(
        xlabel="mean fraction of time in slip",
        ylabel="standard deviation over samples",
        xlim=(0, None), ylim=(0, None),
    )  # fmt: skip
    axes.legend(ncols=2)


def plot_band(axes: Axes, cases: Sequence[Case], dof: int, results: Results) -> None:
    """Fig. 10: mean (line) and outer percentiles (band) of the spectra of one oscillator.

    Several variances in one panel stand apart as sets of curves, the larger one higher.
    """
    lengths = [case.correlation_length for case in cases]
    values = []
    for case in cases:
        look = {"color": style.of_length(case.correlation_length, lengths)["color"]}
        frequency = case.data["frequency"].values
        mean = case.data["psd_mean"].isel(dof=dof - 1).values
        band = case.data["psd_percentiles"].isel(dof=dof - 1).values
        low, high = band[0], band[-1]
        line = style.dashes(sorted(set(lengths)).index(case.correlation_length))
        label = f"$L$ = {case.correlation_length:g}"
        axes.fill_between(frequency, low, high, alpha=0.13, linewidth=0, **look)
        axes.semilogy(frequency, mean, linestyle=line, label=label, **look)
        for edge in (low, high):
            axes.semilogy(frequency, edge, linestyle=line, linewidth=0.6, **look)
        values += [low, high]
    if results.chain is not None:
        style.mark_frequencies(axes, results.chain["frequencies_slip"].values, "slipping", ":")
    _frame_spectrum(axes, np.stack(values))
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys())


def plot_band_ratio(axes: Axes, cases: Sequence[Case]) -> None:
    """Fig. 11: ratio of the outer percentiles' pseudo-variances over the mean time in slip."""
    for case, look, label in _by_length(cases):
        ratio = case.data["band_ratio"].values
        low, high = case.data["band_ratio_low"].values, case.data["band_ratio_high"].values
        axes.errorbar(
            case.data["slip_mean"], ratio,
            yerr=np.clip([ratio - low, high - ratio], 0.0, None),
            label=label, elinewidth=0.8, **look,
        )  # fmt: skip
    first, last = cases[0].data["percentile"].values[[0, -1]]
    axes.set_yscale("log")
    for ticks in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        ticks(FuncFormatter(_short_tick))
    axes.legend(ncols=2)
    axes.set(
        xlabel="mean fraction of time in slip",
        ylabel=rf"$\sigma_{{{last:g}}}^2\,/\,\sigma_{{{first:g}}}^2$",
        xlim=(0, None),
    )


def _short_tick(value: float, _: int) -> str:
    """Plain numbers on a logarithmic axis, where there is room for them."""
    leading = float(f"{value:e}".split("e")[0])
    return f"{value:g}" if leading in (1.0, 2.0, 3.0, 5.0) else ""


def _by_length(
    cases: Sequence[Case],
) -> list[tuple[Case, dict[str, object], str | None]]:
    """Cases with their look: colour and mark by length, filled at the largest excitation."""
    lengths = [case.correlation_length for case in cases]
    variances = sorted({case.variance for case in cases})
    rows = []
    for case in cases:
        look = style.of_length(case.correlation_length, lengths) | {"linestyle": "none"}
        if case.variance != variances[-1]:
            look["markerfacecolor"] = "none"
        name = LEVELS.get(case.variance, f"variance {case.variance:g}")
        rows.append((case, look, f"$L$ = {case.correlation_length:g}, {name}"))
    return rows


def _frame_spectrum(axes: Axes, values: np.ndarray) -> None:
    positive = values[values > 0]
    if positive.size:
        top = 10 ** np.ceil(np.log10(positive.max()))
        axes.set_ylim(top * 1e-7, top)
    axes.set(xlabel="frequency [Hz]", ylabel="power spectral density [m²/Hz]", xlim=FREQUENCY_RANGE)
    axes.legend(ncols=2)
