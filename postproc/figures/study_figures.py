"""The figures of the friction study (Sec. 3), one function each, drawn on the axes it is given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ..joints import OfJoints, slip_mean_error, slip_with_error
from ..paper.deterministic_statements import FULLY
from ..paper.evidence import WIDTH
from ..paper.peaks import scatter_of_ln_psd
from ..paper.slip_statements import ABOUT_03
from ..results import Case, Results, shared_friction
from . import looks, style

_Marks = tuple[NDArray[np.float64], NDArray[np.float64], Any]  # x, y (joint), colour
PERCENT = 100.0  # of a fraction of time
_BEYOND_STUCK = 1.6  # drawn of a spectrum: to this multiple of the highest stuck frequency
_LOWEST_NAME = 10.0  # of a curve, as a multiple of the lower end of the axis
_BESIDE = 0.04  # of the axis: half the width of a curve's name
_DECADES = 7.0  # drawn of a spectrum
_MOST_MODES = 20  # marked
_MOST_MARKED = 60  # joints with a mark in a line; more would meet
_FAINT = 0.3  # of the bars of more
_MOST_ABOVE = 10.0  # drawn of an interval, as a multiple of the largest band ratio
_MEET = 25.0  # [pixels] between marks that share a number
_TOUCH = 12.0  # [pixels] between marks whose numbers would cover each other


def plot_spectra(axes: Axes, case: Case, results: Results) -> None:
    """Fig. 8: power spectral densities of the masses in one sample."""
    spectrum = case.data["psd"].isel(sample=0)
    for dof in style.some_of(case.kept_dofs, wanted=results.forced_dof):
        axes.semilogy(
            spectrum["frequency"], spectrum.isel(dof=dof - 1),
            label=f"{results.place} {dof}", **style.line_of_dof(dof, case.kept_dofs[-1]),
        )  # fmt: skip
    _mark_modes(axes, results)
    _frame_spectrum(axes, spectrum["frequency"].values, spectrum.max("dof").values, results)
    _mark_scatter(axes, case)


def _mark_scatter(axes: Axes, case: Case) -> None:
    """A bar in the corner: how far one bin scatters with the force record."""
    factor = float(np.exp(scatter_of_ln_psd(case.data)))
    inverse = axes.transData.inverted()
    x, y = inverse.transform(axes.transAxes.transform((0.03, 0.06)))
    axes.errorbar(
        x, y, yerr=[[y * (1.0 - 1.0 / factor)], [y * (factor - 1.0)]], color="0.2", capsize=2.5,
    )  # fmt: skip
    axes.annotate(
        "a bin, ± 1 s.e.", (x, y), (6, 0), textcoords="offset points", va="center", fontsize=8,
        path_effects=[withStroke(linewidth=2.5, foreground="w")],
    )  # fmt: skip


def band_ratio_interval(case: Case) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The 95 % interval of the band ratio, from 1: Monte Carlo and time average together."""
    ratio = case.data["band_ratio"].values
    spread = np.log(case.data["band_ratio_high"].values / ratio)
    if case.has("band_ratio_time_error"):
        spread = np.hypot(spread, WIDTH * case.data["band_ratio_time_error"].values / ratio)
    return np.maximum(ratio * np.exp(-spread), 1.0), ratio * np.exp(spread)


def plot_slip_scatter(axes: Axes, cases: Sequence[Case], is_paper: bool = False) -> None:
    """Fig. 9: scatter of the time in slip over its mean, a mark per joint, 95 % intervals.

    Pale: the same by plain sampling.
    """
    if is_paper:
        low, high = (PERCENT * edge for edge in ABOUT_03)
        axes.axvspan(low, high, color="0.94", zorder=0, label="the paper's 30 %, as tested")
    marks = _plot_over_slip(
        axes, cases, "slip_std", PERCENT,
        lambda case: PERCENT * WIDTH * case.data["slip_std_error"].values,
    )  # fmt: skip
    axes.set(ylabel="standard deviation over samples [%]", ylim=(0, None))
    _number(axes, marks)
    style.add_legend(axes)


def plot_band(
    axes: Axes, cases: Sequence[Case], dof: int, results: Results, framed: Sequence[Case] = ()
) -> None:
    """Fig. 10: mean (thick) and outer percentiles (thin) of the spectra of one mass.

    Shaded: 95 % intervals of the percentiles, Monte Carlo and force record together. The axes
    show the cases `framed`, which other panels draw, too.
    """
    named = looks.of_processes(sorted(cases, key=lambda case: case.correlation_length))
    for case in cases:
        name, look = named[case.process]
        colour, line = look["color"], style.dashes(list(named).index(case.process))
        one = case.data.isel(dof=dof - 1)
        frequency = one["frequency"].values
        axes.semilogy(
            frequency, one["psd_mean"], color=colour, linestyle=line, linewidth=1.5,
            label=name,
        )  # fmt: skip
        for outer in {0, one.sizes["percentile"] - 1}:
            edge = one["psd_percentiles"].values[outer]
            axes.semilogy(frequency, edge, color=colour, linestyle=line, linewidth=0.8)
            if case.has("psd_percentiles_low", "psd_percentiles_high"):
                low, high = percentile_interval(case, dof, outer)
                axes.fill_between(frequency, low, high, alpha=0.15, linewidth=0, color=colour)
    last = {"dof": dof - 1, "percentile": -1}
    highest = np.max([case.data["psd_percentiles"].isel(last) for case in framed or cases], axis=0)
    alike = [case.data.isel(dof=dof - 1) for case in cases]
    _mark_modes(axes, results)
    _frame_spectrum(axes, frequency, highest, results)
    _name_curves(axes, alike)
    if len(framed) > len(cases):
        style.add_legend(axes, looks.level_name(cases[0]))


def percentile_interval(
    case: Case, dof: int, outer: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The 95 % interval of a percentile at each frequency: Monte Carlo and force record together.

    The scatter of a bin with the record, `psd_time_error` of ln psd, is added in squares.
    """
    one = case.data.isel(dof=dof - 1)
    middle = one["psd_percentiles"].values[outer]
    record = WIDTH * scatter_of_ln_psd(case.data)
    ends = []
    for end, sign in (("low", -1.0), ("high", 1.0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.log(one[f"psd_percentiles_{end}"].values[outer] / middle)
        ends.append(middle * np.exp(sign * np.hypot(np.nan_to_num(spread), record)))
    return ends[0], ends[1]


def _name_curves(axes: Axes, alike: Sequence[xr.Dataset]) -> None:
    """Names of the mean and the percentiles at their curves, within the axes."""
    frequency = alike[0]["frequency"].values
    last, lowest = axes.get_xlim()[1], _LOWEST_NAME * axes.get_ylim()[0]
    outer = np.array([one["psd_percentiles"].values for one in alike])[:, [0, -1]]
    low, high = np.maximum(outer, lowest).swapaxes(0, 1)
    mean = np.maximum([one["psd_mean"].values for one in alike], lowest)
    apart = high.min(axis=0) / low.max(axis=0)
    apart[(frequency <= 0.1 * last) | (frequency >= 0.6 * last)] = 0.0
    wide = np.argmax(apart)
    first, final = alike[0]["percentile"].values[[0, -1]]
    if final > first and apart[wide] <= 1.0:
        return
    around = np.abs(frequency - frequency[wide]) < _BESIDE * last
    names = [
        (f"{first:g} %", low[:, around].min(), "top", -4),
        ("mean", np.median(mean[:, wide]), "center", 0),
        (f"{final:g} %", high[:, around].max(), "bottom", 4),
    ]
    for text, value, side, apart_by in names[: 3 if final > first else 2]:
        axes.annotate(
            text, (frequency[wide], value), (0, apart_by),
            textcoords="offset points", ha="center", va=side, fontsize=8.5,
            path_effects=[withStroke(linewidth=2.5, foreground="w")],
        )  # fmt: skip


def _plot_over_slip(
    axes: Axes, cases: Sequence[Case], name: str, scale: float,
    bars: Callable[[Case], NDArray[np.float64]],
) -> list[_Marks]:  # fmt: skip
    """A dataset, times a factor, over the mean time in slip; pale: the same by plain sampling."""
    marks = []
    for case, look, label in looks.by_length(cases):
        mean, value = PERCENT * case.data["slip_mean"].values, scale * case.data[name].values
        colour, share = look["markerfacecolor"]
        if (plain := case.plain) is not None:
            pale = {"markerfacecolor": (colour, 0.3 * share), "markeredgecolor": (colour, 0.3)}
            faint = look | pale | {"zorder": 1}
            axes.plot(PERCENT * plain["slip_mean"], scale * plain[name], **faint)
        shade = (colour, _FAINT) if mean.size > _MOST_MARKED else None
        reach = _up_to(PERCENT, mean, PERCENT * WIDTH * slip_mean_error(case))
        axes.errorbar(
            mean, value, xerr=reach, yerr=bars(case), label=label, ecolor=shade, elinewidth=0.8,
            **look,
        )  # fmt: skip
        marks.append((mean, value, colour))
    axes.set(xlabel="mean time in slip [%]", xlim=(0, None))
    return marks


def _up_to(
    most: float, mean: NDArray[np.float64], reach: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Lengths of an interval below and above its mean: it ends at `most`, which none exceeds."""
    return np.stack([reach, np.minimum(reach, np.maximum(most - mean, 0.0))])


def _number(axes: Axes, marks: Sequence[_Marks]) -> None:
    """Numbers of joints at their marks, as many as can be read; once where marks meet."""
    placed: list[tuple[int, NDArray[np.float64], Annotation]] = []
    for x, y, colour in marks:
        pixels = axes.transData.transform(np.column_stack([x, y]))
        for joint in style.some_of(range(1, x.size + 1), looks.MOST_NUMBERED):
            here = pixels[joint - 1]
            apart = [(np.hypot(*(here - at)), other, name) for other, at, name in placed]
            if any(joint == other and distance < _MEET for distance, other, _ in apart):
                continue
            name = next((name for distance, _, name in apart if distance < _TOUCH), None)
            if name is None:
                name = axes.annotate(
                    str(joint), (x[joint - 1], y[joint - 1]), (5, 4), textcoords="offset points",
                    fontsize=7.5, color=colour if len(marks) == 1 else "0.2",
                )  # fmt: skip
            else:
                name.set_text(f"{name.get_text()}, {joint}")
                name.xy = max(name.xy, (x[joint - 1], y[joint - 1]))  # beside the right one
            placed.append((joint, here, name))


def plot_band_ratio(axes: Axes, cases: Sequence[Case]) -> None:
    """Fig. 11: ratio of the outer percentiles' pseudo-variances over the mean time in slip.

    Pale: the same by plain sampling.
    """

    def bars(case: Case) -> NDArray[np.float64]:
        low, high = band_ratio_interval(case)
        ratio = case.data["band_ratio"].values
        return np.clip([ratio - low, high - ratio], 0.0, None)

    marks = _plot_over_slip(axes, cases, "band_ratio", 1.0, bars)
    first, last = cases[0].data["percentile"].values[[0, -1]]
    axes.set_yscale("log")
    ratios = np.concatenate([ratio for _, ratio, _ in marks])
    highest = ratios.max(initial=1.0, where=np.isfinite(ratios))
    axes.set_ylim(top=min(axes.get_ylim()[1], _MOST_ABOVE * highest))
    style.label_logarithmic(axes.yaxis)
    axes.set_ylabel(rf"band ratio $\sigma_{{{last:g}}}^2\,/\,\sigma_{{{first:g}}}^2$")
    _number(axes, marks)
    style.add_legend(axes)


def plot_along(axes: Axes, cases: Sequence[Case], quantity: OfJoints) -> None:
    """A quantity along the structure, joint by joint, a line per case, 95 % intervals."""
    named = looks.of_processes(cases)
    is_shared = shared_friction(cases) != ""
    for rank, case in enumerate(cases):
        mean, error = quantity.of(case)
        name = looks.level_name(case)
        if not is_shared:
            name = f"{named[case.process][0]}, std {case.std:.3g}, {name}"
        look = style.of_rank(rank, len(cases))
        if mean.size > _MOST_MARKED:
            look["marker"] = "none"
        most = PERCENT if quantity.unit == "%" else np.inf
        axes.errorbar(
            np.arange(1, mean.size + 1), mean, yerr=_up_to(most, mean, WIDTH * error),
            label=name, elinewidth=0.8, **look,
        )  # fmt: skip
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="joint", ylabel=f"{quantity.title} [{quantity.unit}]", ylim=(0, None))
    axes.ticklabel_format(axis="y", scilimits=(-3, 5))
    style.add_legend(axes)


def plot_spectra_along(axes: Axes, case: Case, results: Results) -> None:
    """Mean spectrum of every dof, frequency across, dofs upward; logarithmic."""
    mean = case.data["psd_mean"]
    frequency, dof = mean["frequency"].values, mean["dof"].values
    values = np.where(mean.values > 0.0, mean.values, np.nan)
    top = float(np.nanmax(values))
    shown = axes.pcolormesh(
        frequency, dof, values.T, norm=LogNorm(top * 10**-_DECADES, top), rasterized=True,
        shading="nearest",
    )  # fmt: skip
    bar = axes.figure.colorbar(shown, ax=axes)
    bar.set_label("mean spectrum [m²/Hz]")
    axes.grid(visible=False)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(
        xlabel="frequency [Hz]", ylabel=results.place,
        xlim=(0.0, _last_shown(frequency, mean.max("dof").values, results)),
    )  # fmt: skip


def plot_sweep(axes: Axes, cases: Sequence[Case]) -> None:
    """Time in slip of each joint over the level of the force, 95 % intervals."""
    cases = sorted(cases, key=lambda case: case.strength)
    strength = [case.strength for case in cases]
    slips = [slip_with_error(case) for case in cases]
    for joint in style.some_of(range(1, cases[0].n_joints + 1)):
        axes.errorbar(
            strength, [PERCENT * slip[joint - 1] for slip, _ in slips],
            yerr=[PERCENT * WIDTH * error[joint - 1] for _, error in slips],
            label=f"joint {joint}", elinewidth=0.8, **style.of_dof(joint, cases[0].n_joints),
        )  # fmt: skip
    for edge in (FULLY, 1.0 - FULLY):
        axes.axhline(PERCENT * edge, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
    axes.set_xscale("log")
    axes.set(xlabel=force_axis(cases[0]), ylabel="time in slip [%]", ylim=(0, 100))
    style.add_legend(axes)


def plot_sweep_spectra(axes: Axes, cases: Sequence[Case], results: Results) -> None:
    """Spectra of the first mass kept over the level of the force, from stuck to slipping."""
    cases = sorted(cases, key=lambda case: case.strength)
    chosen = style.some_of(cases, 6)
    values = []
    for rank, case in enumerate(chosen):
        density = case.data["psd"].isel(sample=0, dof=case.kept_dofs[0] - 1)
        spectrum = density / (case.variance or case.strength**2)
        look = style.of_rank(rank, len(chosen)) | {"marker": "none"}
        axes.semilogy(spectrum["frequency"], spectrum, label=looks.level_name(case), **look)
        values.append(spectrum.values)
    _mark_modes(axes, results)
    _frame_spectrum(axes, spectrum["frequency"].values, np.max(values, axis=0), results)
    per_variance = "variance [s⁴/Hz]" if cases[0].is_base else "variance [m²/(N² Hz)]"
    unit = per_variance if cases[0].variance else "factor² [m²/Hz]"
    axes.set_ylabel(f"power spectral density / {unit}")


def force_axis(case: Case) -> str:
    """Label of an axis of levels of the force."""
    if not (case.is_sine or case.variance):
        return "factor of the force"
    what = "amplitude" if case.is_sine else "variance"
    return f"{what} of the {'ground' if case.is_base else 'force'} [{case.force_unit}]"


def _mark_modes(axes: Axes, results: Results) -> None:
    structure = marked_structure(results)
    if structure is not None:
        style.mark_frequencies(axes, structure["frequencies_stuck"].values, "modes, stuck", "-")
        style.mark_frequencies(axes, structure["frequencies_slip"].values, "modes, slipping", ":")


def marked_structure(results: Results) -> xr.Dataset | None:
    """The structure whose natural frequencies are lines in spectra: many would hide the curves."""
    structure = results.structure
    return structure if structure is not None and structure.sizes["mode"] <= _MOST_MODES else None


def _frame_spectrum(
    axes: Axes, frequency: NDArray[np.float64], highest: NDArray[np.float64], results: Results
) -> None:
    """Ranges that show all curves below `highest` (frequency)."""
    if highest.max() > 0.0:
        top = 10 ** np.ceil(np.log10(highest.max()))
        axes.set_ylim(top * 10**-_DECADES, top)
    axes.set(
        xlabel="frequency [Hz]", ylabel="power spectral density [m²/Hz]",
        xlim=(0.0, _last_shown(frequency, highest, results)),
    )  # fmt: skip
    style.add_legend(axes)


def _last_shown(
    frequency: NDArray[np.float64], highest: NDArray[np.float64], results: Results
) -> float:
    """The highest frequency drawn: beyond it `highest` (frequency) has no power to be seen."""
    last = float(frequency[highest >= highest.max() * 10**-_DECADES][-1])
    if results.structure is None:
        return last
    return min(last, _BEYOND_STUCK * float(results.structure["frequencies_stuck"][-1]))
