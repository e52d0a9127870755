"""Which figures results files have data for, each with what to see in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
import xarray as xr

from . import chain_figure, figures, process_figures, response_figures, tradeoff
from .figure import SECTIONS, Figure
from .peaks import scatter_of_ln_psd
from .results import Case, Results

_Item = TypeVar("_Item")
_PROCESSES, _CHAIN, _STUDY, _RESPONSES, _ = SECTIONS
_MOST_SPECTRA = 4  # cases with friction certain; more are a sweep


def make_figures(files: Sequence[Results]) -> list[Figure]:
    """Those of every file, in the paper's order; later files' twins carry the file's name."""
    found: dict[str, Figure] = {}
    for results in files:
        for figure in (figure for source in SOURCES for figure in source(results)):
            twin = found.get(figure.name)
            if twin is not None and twin.section == _CHAIN and twin.caption == figure.caption:
                continue  # the same drawing
            kept = figure.renamed(results.stem) if twin is not None else figure
            found[kept.name] = kept
    return sorted(found.values(), key=lambda figure: (SECTIONS.index(figure.section), figure.name))


def of_processes(results: Results) -> Iterator[Figure]:
    """Figs. 1 to 6, of processes that a scene without chain solved."""
    if results.structure is not None:
        return
    solved = [p for p in results.processes.values() if p.attrs["status"] == "solved"]
    free = [p for p in solved if not process_figures.is_positive(p)]
    asked = [p for p in free if int(p.attrs["order"]) > 0]
    regressive = [p for p in asked if p.attrs["method"] == "autoregressive"]
    for number, method, family in (
        (1, "direct method", [p for p in asked if p.attrs["method"] == "direct"]),
        (2, "autoregressive", regressive),
    ):
        for name, length, panel in _length_panels(family):
            yield Figure(
                f"fig_{number:02d}{name}",
                f"Fig. {number}{name[0]}. Autocovariance, {method}, {length}",
                "At lags up to the order the values fall as the order grows, towards white noise:"
                " flat in the lag where L0 is imposed, growing with it where L1 is."
                " Without errors: both methods are exact to 1e-8.",
                _PROCESSES, (partial(process_figures.plot_autocovariances, processes=panel),),
            )  # fmt: skip
    if len({process_figures.order_of(p) for p in regressive}) > 1:
        yield Figure(
            "fig_03", "Fig. 3. Entropy over the order",
            "The order needed to come near white noise rises with the correlation length, and is"
            " higher where L0 is imposed (full lines) than where L1 is (dashed).",
            _PROCESSES, (partial(process_figures.plot_entropies, processes=regressive),),
        )  # fmt: skip
        yield Figure(
            "fig_04", "Fig. 4. The correlation length that was not imposed",
            "With L0 imposed (full lines) L1 grows with the order; with L1 imposed (dashed) L0"
            " falls. Infinite sums. The largest order with L0 = 0.3 and L1 at most 1 is 5; the"
            " paper reads 6 off its figure, where L1 is 1.03.",
            _PROCESSES, (partial(process_figures.plot_achieved_lengths, processes=regressive),),
        )  # fmt: skip
    chosen = [p for p in free if int(p.attrs["order"]) == 0]
    if chosen:
        yield Figure(
            "fig_05", "Fig. 5. One length imposed, the other bounded",
            "The bound picks the order: with L0 imposed the largest that keeps L1 below it, with L1"
            " imposed the largest that keeps L0 above it.",
            _PROCESSES, (partial(process_figures.plot_chosen_orders, processes=chosen),),
        )  # fmt: skip
    refused = [p for p in results.processes.values() if p.attrs["status"] == "infeasible"]
    yield from _positive(solved, asked, refused)
    for name, process in results.processes.items():
        if "realizations" in process:
            yield Figure(
                f"realizations_{name}", f"Realizations of process {name}",
                "The first of the realizations that the scene asked for, and the mean.",
                _PROCESSES, (partial(process_figures.plot_realizations, process=process),),
            )  # fmt: skip


def _positive(
    solved: list[xr.Dataset], free: list[xr.Dataset], refused: list[xr.Dataset]
) -> Iterator[Figure]:
    """Fig. 6: positive processes of each length and order, beside the free one; others alone."""
    positive = [p for p in solved if process_figures.is_positive(p)]
    if not positive:
        return
    kinds = sorted({_kind(p) for p in positive})
    alone = [p for p in positive if not any(_kind(q) == _kind(p) for q in free)]
    if alone:
        yield Figure(
            "positive", "Autocovariances of positive processes",
            f"Over the variance, {_how_many(len(alone), process_figures.MOST_CURVES)}.",
            _PROCESSES, (partial(process_figures.plot_each, processes=alone),),
        )  # fmt: skip
    for kind in kinds:
        alike = [p for p in positive if _kind(p) == kind]
        twins = [p for p in free if _kind(p) == kind]
        if twins:
            missing = [p for p in refused if process_figures.is_positive(p) and _kind(p) == kind]
            yield _figure_6(twins[0], alike, missing, is_only=len(kinds) == 1)


def _kind(process: xr.Dataset) -> tuple[str, str, float, int]:
    asked = process.attrs
    return (
        str(asked["method"]), str(asked["correlation"]), float(asked["correlation_length"]),
        int(asked["order"]),
    )  # fmt: skip


def _figure_6(
    free: xr.Dataset, positive: list[xr.Dataset], refused: list[xr.Dataset], *, is_only: bool
) -> Figure:
    method, correlation, length, order = _kind(free)
    largest = "; ".join(
        f"{_largest(process_figures.difference_from_free(p, free)):.2g} at mean"
        f" {p.attrs['mean']:g} ({p.attrs['sampler']})"
        for p in positive
    )
    missing = "".join(
        f" Not drawn, mean {p.attrs['mean']:g} ({p.attrs['sampler']}): {p.attrs['reason']}."
        for p in refused
    )
    both = [free, *positive]
    return Figure(
        "fig_06" if is_only else f"fig_06_{method}_{correlation}_{length:g}_{order}",
        "Fig. 6. Positive processes and the one without sign constraint"
        + ("" if is_only else f", {method}, {correlation} = {length:g}, order {order}"),
        "Autocovariances of positive processes, by the sequential law (marks) and the exact one"
        " (dashed), beside that of the process without sign constraint; below, the differences with"
        " bars of two standard errors, the scatter of fits from other random numbers among them."
        " The paper finds them very close; the largest differences here:"
        f" {largest}.{missing}", _PROCESSES,
        (
            partial(process_figures.plot_positive, processes=both),
            partial(process_figures.plot_positive_difference, processes=both),
        ), height=3.6,
    )  # fmt: skip


def _how_many(count: int, most: int) -> str:
    return "all that were solved" if count <= most else f"{most} of the {count} that were solved"


def _largest(difference: xr.Dataset) -> float:
    return float(abs(difference["value"]).max())


def of_chain(results: Results) -> Iterator[Figure]:
    """Fig. 7."""
    if results.structure is not None and results.is_chain:
        n_dof = int(results.structure.sizes["dof"])
        forced = int(np.argmax(np.abs(results.structure["load"].values[0]))) + 1
        yield Figure(
            "fig_07", "Fig. 7. The chain with its Jenkins elements",
            f"{n_dof} oscillators. Springs k1 join neighbours and the first mass to the wall; each"
            " mass holds to the ground by a spring k2 in series with a slider that the load N"
            f" presses down; the force acts on mass {forced}; the far side of the last is free.",
            _CHAIN, (partial(chain_figure.plot_chain, n_dof=n_dof, forced=forced),), height=2.6,
        )  # fmt: skip


def of_certain_friction(results: Results) -> Iterator[Figure]:
    """Fig. 8, or the figures of a sweep of the variance."""
    cases = results.deterministic
    spectra = [case for case in cases if case.has("psd")]
    if len(cases) > _MOST_SPECTRA:
        yield Figure(
            "sweep", "From stuck to slipping",
            "Time in slip over the variance of the force, friction certain, bars of two standard"
            " errors of the time average; dotted: what counts as fully stuck and fully slipping.",
            _STUDY, (partial(figures.plot_sweep, cases=cases),), ("8",),
        )  # fmt: skip
        if spectra:
            yield Figure(
                "sweep_spectra", "Spectra from stuck to slipping",
                "Oscillator 1, over the variance of the force: peaks at the stuck frequencies (full"
                " lines) broaden, vanish, and return at those of the slipping chain (dotted).",
                _STUDY,
                (partial(figures.plot_sweep_spectra, cases=spectra, results=results),), ("8",),
            )  # fmt: skip
        return
    for letter, case in _lettered(spectra):
        name = figures.variance_name(case.variance)
        yield Figure(
            f"fig_08{letter}", f"Fig. 8{letter}. Spectra without uncertainty, {name}",
            "Power spectral densities of the displacements, friction certain. Where the sliders"
            " mostly stick, power stands in the band of the stuck natural frequencies; where they"
            f" mostly slip it has moved out of it. {_welch(case)}",
            _STUDY, (partial(figures.plot_spectra, case=case, results=results),), ("7",),
        )  # fmt: skip


def of_drawn_friction(results: Results) -> Iterator[Figure]:
    """Figs. 9 to 11, of a campaign."""
    random = [case for case in results.random if case.n_samples > 1]
    scattered = [case for case in random if case.has("slip_mean", "slip_std")]
    for letter, std, cases in _by_std(scattered):
        yield Figure(
            f"fig_09{letter}", f"Fig. 9{letter}. Scatter of the time in slip, friction std {std:g}",
            "Standard deviation over samples of the fraction of time in slip, over its mean; a mark"
            " per oscillator, filled at the largest excitation; bars of one standard error. To look"
            " for: where the marks stand highest, and whether the lengths differ.",
            _STUDY, (partial(figures.plot_slip_scatter, cases=cases),), ("1a", "1b", "2"),
        )  # fmt: skip
    banded = [case for case in random if case.has("psd_mean", "psd_percentiles")]
    for letter, (cases, dof) in _lettered(_band_panels(banded)):
        levels = ", ".join(figures.variance_name(v) for v in sorted({c.variance for c in cases}))
        yield Figure(
            f"fig_10{letter}", f"Fig. 10{letter}. Band of uncertainty, oscillator {dof}, {levels}",
            "Mean spectrum (thick) between the outer percentiles over samples (thin; shaded: their"
            f" 95 % intervals), friction std {cases[0].std:g}, for each correlation length; dotted:"
            " natural frequencies with every slider slipping. To look for: how far the percentiles"
            " lie apart, where the mean lies between them, and peaks of the upper one at the dotted"
            f" lines. {_welch(cases[0])}",
            _STUDY, (partial(figures.plot_band, cases=cases, dof=dof, results=results),),
            ("5a", "5b", "6b", "9"),
        )  # fmt: skip
    ratios = [case for case in banded if case.has("band_ratio", "band_ratio_low", "slip_mean")]
    ratios = [case for case in ratios if case.n_joints == case.n_dof]
    for letter, std, cases in _by_std(ratios):
        yield Figure(
            f"fig_11{letter}",
            f"Fig. 11{letter}. Width of the band of uncertainty, friction std {std:g}",
            "Ratio of the pseudo-variances (Eq. 46) of the outer percentiles, over the mean"
            " fraction of time in slip; a mark per oscillator, filled at the largest excitation;"
            " 95 % intervals, Monte Carlo (bootstrap over samples) and time average together. To"
            " look for: a fall with the time in slip, and"
            " whether the lengths differ where that is long.",
            _STUDY, (partial(figures.plot_band_ratio, cases=cases),),
            ("3a", "3b", "4a", "4b", "4c"),
        )  # fmt: skip


def of_responses(results: Results) -> Iterator[Figure]:
    """Histories, and a transition enlarged; the spectra of a sample that stands alone."""
    for case in results.cases:
        name = f"case {case.name[1:].lstrip('0')}, {figures.variance_name(case.variance)}"
        if case.has("psd") and case.n_samples == 1 and not case.is_deterministic:
            yield Figure(
                f"spectra_{case.name}", f"Spectra of one sample, {name}",
                f"Power spectral densities of the displacements. {_welch(case)}",
                _RESPONSES, (partial(figures.plot_spectra, case=case, results=results),),
            )  # fmt: skip
        if not case.has("displacement", "velocity", "time"):
            continue
        yield Figure(
            f"history_{case.name}", f"Displacements, {name}",
            "Of the first sample, the last minute at most.",
            _RESPONSES, (partial(response_figures.plot_history, case=case),), height=3.2,
        )  # fmt: skip
        if results.structure is not None and results.is_chain and case.has("transition_time"):
            yield from _transition(results.structure, case, name)


def _transition(chain: xr.Dataset, case: Case, name: str) -> Iterator[Figure]:
    episode = response_figures.find_episode(case)
    if episode is not None:
        yield Figure(
            f"transition_{case.name}", f"One slip, oscillator {episode.dof}, {name}",
            "Above, a slip from start to end: the force in the slider stays at its limit until the"
            " mass turns. Below, its end at full resolution: the transition is located inside a"
            " time step.",
            _RESPONSES,
            (
                partial(response_figures.plot_slider, case=case, chain=chain, episode=episode),
                partial(response_figures.plot_transition, case=case, chain=chain, episode=episode),
            ),
            height=3.2,
        )  # fmt: skip


# Each yields the figures that a file has data for.
SOURCES: tuple[Callable[[Results], Iterator[Figure]], ...] = (
    of_processes, of_chain, of_certain_friction, of_drawn_friction, of_responses,
    tradeoff.figures_of,
)  # fmt: skip


def _welch(case: Case) -> str:
    n_segments = int(case.data.attrs["n_segments"])
    error = scatter_of_ln_psd(case.data)
    segments = "segment" if n_segments == 1 else "segments"
    return (
        f"Welch's method, {n_segments} {segments}: a bin scatters by"
        f" {100 * error:.0f} % with the force record."
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


def _lettered(items: Sequence[_Item]) -> Iterator[tuple[str, _Item]]:
    """(a, first), (b, second), ..., (z, ...), (aa, ...)."""
    for i, item in enumerate(items):
        yield ("" if i < 26 else chr(96 + i // 26)) + chr(97 + i % 26), item


def _by_std(cases: list[Case]) -> Iterator[tuple[str, float, list[Case]]]:
    for letter, std in _lettered(sorted({case.std for case in cases})):
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
