"""Which figures a results file has data for, each with what to see in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import xarray as xr
from matplotlib.axes import Axes

from postproc import figures, process_figures
from postproc.results import Case, Results


@dataclass(frozen=True)
class Figure:
    """One figure: its file name, title, caption, and how to draw it."""

    name: str
    title: str
    caption: str
    draw: Callable[[Axes], None]

    def save(self, folder: Path) -> Path:
        """PNG and PDF into the folder; returns the PNG."""
        picture, axes = plt.subplots()
        self.draw(axes)
        png = folder / f"{self.name}.png"
        picture.savefig(png)
        picture.savefig(png.with_suffix(".pdf"), metadata={"CreationDate": None})
        plt.close(picture)
        return png


def make_figures(results: Results) -> Iterator[Figure]:
    """In the paper's order; a letter per panel, as the paper has them."""
    yield from _process_figures(results)
    yield from _friction_figures(results)


def _process_figures(results: Results) -> Iterator[Figure]:
    """Figs. 1 to 6, of processes that a scene without chain solved."""
    if results.chain is not None:
        return
    solved = [p for p in results.processes.values() if p.attrs["status"] == "solved"]
    free = [p for p in solved if not int(p.attrs["positive"])]
    asked = [p for p in free if int(p.attrs["order"]) > 0]
    regressive = [p for p in asked if p.attrs["method"] == "autoregressive"]
    for number, method, family in (
        (1, "direct method", [p for p in asked if p.attrs["method"] == "direct"]),
        (2, "autoregressive", regressive),
    ):
        for name, length, panel in _length_panels(family):
            yield Figure(
                f"fig_{number:02d}{name}",
                f"Fig. {number}{name}. Autocovariance, {method}, {length}",
                "Values beyond lag 0 fall as the order grows, towards white noise: flat in the lag"
                " where L0 is imposed, growing with it where L1 is.",
                lambda axes, panel=panel: process_figures.plot_autocovariances(axes, panel),
            )
    if len({process_figures.order_of(p) for p in regressive}) > 1:
        yield Figure(
            "fig_03",
            "Fig. 3. Entropy over the order",
            "The order needed to come near white noise rises with the correlation length, and is"
            " higher where L0 is imposed (full lines) than where L1 is (dashed).",
            lambda axes: process_figures.plot_entropies(axes, regressive),
        )
        yield Figure(
            "fig_04",
            "Fig. 4. The correlation length that was not imposed",
            "With L0 imposed (full lines) L1 grows with the order; with L1 imposed (dashed) L0"
            " falls. Infinite sums.",
            lambda axes: process_figures.plot_achieved_lengths(axes, regressive),
        )
    chosen = [p for p in free if int(p.attrs["order"]) == 0]
    if chosen:
        yield Figure(
            "fig_05",
            "Fig. 5. One length imposed, the other bounded",
            "With L0 imposed the bound on L1 picks the largest order that keeps it.",
            lambda axes: process_figures.plot_chosen_orders(axes, chosen),
        )
    positive = [p for p in solved if int(p.attrs["positive"])]
    if positive:
        like = positive[0].attrs
        twins = [
            p for p in regressive
            if all(p.attrs[a] == like[a] for a in ("correlation", "correlation_length", "order"))
        ]  # fmt: skip
        yield Figure(
            "fig_06",
            "Fig. 6. Positive processes and the one without sign constraint",
            "Autocovariances of positive processes beside that of the unconstrained one of the same"
            " length and order; the closer, the larger the mean over the standard deviation.",
            lambda axes: process_figures.plot_positive(axes, [*twins, *positive]),
        )


def _length_panels(processes: list[xr.Dataset]) -> Iterator[tuple[str, str, list[xr.Dataset]]]:
    """Panel a: L0, b: L1, for the smallest length; the other lengths carry theirs in the name."""
    lengths = sorted({process_figures.length_of(p) for p in processes})
    for length in lengths:
        for letter, definition in (("a", "L0"), ("b", "L1")):
            panel = [
                p for p in processes
                if p.attrs["correlation"] == definition
                and process_figures.length_of(p) == length
            ]  # fmt: skip
            if panel:
                suffix = "" if length == lengths[0] else f"_{length:g}"
                yield letter + suffix, f"{definition} = {length:g}", panel


def _friction_figures(results: Results) -> Iterator[Figure]:
    """Figs. 8 to 11, of a campaign."""
    spectra = [case for case in results.deterministic if case.has("psd")]
    for letter, case in _lettered(spectra):
        yield Figure(
            f"fig_08{letter}",
            f"Fig. 8{letter}. Spectra without uncertainty, variance {case.variance:g}",
            "Power spectral densities of the displacements, friction certain. Where the sliders"
            " mostly stick, peaks stand at the stuck natural frequencies; where they mostly slip,"
            " the peaks are gone and energy has moved out of the band of natural frequencies.",
            lambda axes, case=case: figures.plot_spectra(axes, case, results),
        )
    scattered = [case for case in results.random if case.has("slip_mean")]
    for letter, std, cases in _by_std(scattered):
        yield Figure(
            f"fig_09{letter}",
            f"Fig. 9{letter}. Scatter of the time in slip, friction std {std:g}",
            "Standard deviation over samples of the fraction of time in slip, over its mean; a mark"
            " per oscillator, filled at the largest excitation; bars of one standard error."
            " The paper sees the largest scatter near a mean of 0.3 (dashed).",
            lambda axes, cases=cases: figures.plot_slip_scatter(axes, cases),
        )
    banded = [case for case in results.random if case.has("psd_percentiles")]
    for letter, (cases, dof) in _lettered(_band_panels(banded)):
        levels = ", ".join(figures.variance_name(v) for v in sorted({c.variance for c in cases}))
        yield Figure(
            f"fig_10{letter}",
            f"Fig. 10{letter}. Band of uncertainty, oscillator {dof}, {levels}",
            f"Mean spectrum (lines) between the outer percentiles over samples (shaded), friction"
            f" std {cases[0].std:g}, for each correlation length; dotted: natural frequencies with"
            " every slider slipping.",
            lambda axes, cases=cases, dof=dof: figures.plot_band(axes, cases, dof, results),
        )
    for letter, std, cases in _by_std(banded):
        yield Figure(
            f"fig_11{letter}",
            f"Fig. 11{letter}. Width of the band of uncertainty, friction std {std:g}",
            "Ratio of the pseudo-variances (Eq. 46) of the outer percentiles, over the mean"
            " fraction of time in slip; a mark per oscillator, filled at the largest excitation;"
            " 95 % bootstrap intervals over samples.",
            lambda axes, cases=cases: figures.plot_band_ratio(axes, cases),
        )


def _lettered(items: list) -> Iterator[tuple[str, object]]:  # type: ignore[type-arg]
    return zip("abcdefghijklmnopqrstuvwxyz", items, strict=False)


def _by_std(cases: list[Case]) -> Iterator[tuple[str, float, list[Case]]]:
    stds = sorted({case.std for case in cases})
    for letter, std in _lettered(stds):
        yield letter, std, [case for case in cases if case.std == std]


def _band_panels(cases: list[Case]) -> list[tuple[list[Case], int]]:
    """The paper's panels at the largest std: dof 1 at each variance, the last at all of them."""
    if not cases:
        return []
    std = max(case.std for case in cases)
    chosen = [case for case in cases if case.std == std]
    variances = sorted({case.variance for case in chosen})
    panels = [([c for c in chosen if c.variance == variance], 1) for variance in variances]
    return [*panels, (chosen, cases[0].n_dof)]
