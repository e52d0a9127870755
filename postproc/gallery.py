"""Which figures a results file has data for, each with what to see in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from postproc import figures
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
