"""The figures that results files have data for, each with what to see in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from typing import TypeVar

import xarray as xr

from .. import joints, tradeoff
from ..harmonic import sweeps_of
from ..paper.peaks import scatter_of_ln_psd
from ..paper.printed import LEVELS, is_paper_study
from ..results import Case, Results, shared_friction
from . import (
    chain_figure,
    harmonic_gallery,
    looks,
    process_gallery,
    response_figures,
    study_figures,
    style,
)
from .figure import SECTIONS, Figure

_Item = TypeVar("_Item")
_, _CHAIN, _STUDY, _RESPONSES, _ = SECTIONS
_MOST_LINES, _MOST_LEVELS = 6, 3  # in one figure
_MOST_SPECTRA = 4  # cases with deterministic friction; more are a sweep


def make_figures(files: Sequence[Results]) -> list[Figure]:
    """Figures of every file, in the paper's order.

    A later one of the same name gets the file's. Of several files, titles say which it is, except
    those of the paper's own figures and of the only tradeoff.
    """
    found: dict[str, Figure] = {}
    n_tradeoffs = sum(results.tradeoff is not None for results in files)
    for results in files:
        is_paper = is_paper_study(results)
        is_known = is_paper or (results.tradeoff is not None and n_tradeoffs == 1)
        of_tradeoff = tradeoff.figures_of(results, _processes_of_scene(results, files))
        for figure in chain(*(source(results) for source in SOURCES), of_tradeoff):
            twin = found.get(figure.name)
            if twin is not None and twin.section == _CHAIN and twin.caption == figure.caption:
                continue  # the same drawing
            kept = figure if is_paper else figure.outside_the_paper()
            if twin is not None or (len(files) > 1 and not is_known):
                kept = kept.of_file(results.stem, twin is not None)
            found[kept.name] = kept
    return sorted(found.values(), key=_place)


def _place(figure: Figure) -> tuple[int, int, str]:
    """By section: those along the structure, the paper's by number, the others as they are made."""
    section = SECTIONS.index(figure.section)
    if figure.name.startswith("fig_"):
        return section, 1, figure.name
    return section, 0 if figure.name.startswith("along_") else 2, ""


def of_chain(results: Results) -> Iterator[Figure]:
    """Fig. 7."""
    if results.structure is not None and results.is_chain and _is_row(results.structure):
        n_dof = int(results.structure.sizes["dof"])
        is_base = any(case.is_base for case in results.cases)
        forced = None if is_base else results.forced_dof
        force = "the ground moves" if forced is None else f"the force acts on mass {forced}"
        yield Figure(
            "fig_07", "Fig. 7. The chain with its Jenkins elements",
            f"{n_dof} {'mass' if n_dof == 1 else 'masses'}. Springs k1 join neighbours, and the"
            " first mass to the wall. A joint holds each mass to the ground: a spring k2 in series"
            f" with a slider under the load N. Here {force}.",
            _CHAIN, (partial(chain_figure.plot_chain, n_dof=n_dof, forced=forced),), height=2.6,
        )  # fmt: skip


def _is_row(structure: xr.Dataset) -> bool:
    """True if springs join all neighbours and no other masses."""
    ends = zip(*(structure[f"stiffness_{end}"].values for end in ("row", "column")), strict=True)
    joined = {(min(pair), max(pair)) for pair in ends if pair[0] != pair[1]}
    return joined == {(dof, dof + 1) for dof in range(1, structure.sizes["dof"])}


def of_certain_friction(results: Results) -> Iterator[Figure]:
    """Fig. 8, or the figures of a sweep of the level of the force."""
    cases = _alone(results, results.deterministic)
    spectra = [case for case in cases if case.has_power("psd")]
    if len(cases) > _MOST_SPECTRA:
        yield Figure(
            "sweep", "From stuck to slipping",
            f"Time in slip over the level of the force, {cases[0].given_friction}. Bars are 95 %"
            " intervals of the time average. Dotted lines bound fully stuck and fully slipping.",
            _STUDY, (partial(study_figures.plot_sweep, cases=cases),), ("8",),
        )  # fmt: skip
        if spectra:
            yield Figure(
                "sweep_spectra", "Spectra from stuck to slipping",
                f"Spectra of {results.place} {spectra[0].kept_dofs[0]} at each level of the force."
                " With the level, peaks at the stuck frequencies broaden, vanish, and return at the"
                f" frequencies with all joints slipping.{_of_modes(results)}",
                _STUDY,
                (partial(study_figures.plot_sweep_spectra, cases=spectra, results=results),),
                ("8",),
            )  # fmt: skip
        return
    for letter, case in _lettered(spectra):
        name = looks.level_name(case)
        yield Figure(
            f"fig_08{letter}", f"Fig. 8{letter}. Spectra without uncertainty, {name}",
            f"Power spectral densities of the displacements, {case.given_friction}. If joints"
            " mostly stick, power is in the band of the stuck natural frequencies; if they mostly"
            " slip, it has moved out of that band. Slip softens the structure, so peaks lie below"
            f" the stuck frequencies. {_welch(case)} The bar at the lower left shows it.",
            _STUDY, (partial(study_figures.plot_spectra, case=case, results=results),),
            ("7a",) if case.variance == min(LEVELS) else ("7b", "7c"),
        )  # fmt: skip


def of_drawn_friction(results: Results) -> Iterator[Figure]:
    """Figs. 9 to 11, of a campaign."""
    is_paper = is_paper_study(results)
    random = _alone(results, [case for case in results.random if case.n_samples > 1])
    scattered = [case for case in random if case.has("slip_mean", "slip_std")]
    if not is_paper:
        yield from _along(results, random)
    for letter, std, cases in _by_std(scattered):
        yield Figure(
            f"fig_09{letter}", f"Fig. 9{letter}. Scatter of the time in slip, friction std {std:g}",
            "Standard deviation over samples of the time in slip, over its mean."
            f" {looks.marks_of(cases)}. Bars are 95 % intervals,"
            f" of the mean with Monte Carlo and time average together.{_pale(cases)}"
            " Look for where the marks are highest"
            f"{_of_lengths(cases, ', and whether the lengths differ')}.",
            _STUDY, (partial(study_figures.plot_slip_scatter, cases=cases, is_paper=is_paper),),
            ("1a", "1b", "2a", "2b"),
        )  # fmt: skip
    banded = [case for case in random if case.has("psd_percentiles") and case.has_power("psd_mean")]
    for letter, (cases, dof) in _lettered(
        _band_panels(banded, None if is_paper else results.forced_dof)
    ):
        named = {case.strength: looks.level_name(case) for case in cases}
        levels = ", ".join(named[strength] for strength in sorted(named))
        shown = style.some_of(sorted(named), _MOST_LEVELS)
        panels = [[c for c in cases if c.strength == level] for level in shown]
        yield Figure(
            f"fig_10{letter}",
            f"Fig. 10{letter}. Band of uncertainty, {results.place} {dof}, {levels}",
            f"Mean spectrum (thick) at friction std {cases[0].std:g}, between the outer percentiles"
            " over samples (thin; shaded: their 95 % intervals, Monte Carlo and force record"
            f" together){_of_lengths(cases, ', for each correlation length')}. Look for the"
            " distance of the percentiles, the place of the mean between them, and peaks of the"
            " upper one at natural frequencies with all joints slipping."
            f"{_of_modes(results)} {_welch(cases[0])}",
            _STUDY,
            tuple(
                partial(study_figures.plot_band, cases=own, dof=dof, results=results, framed=cases)
                for own in panels
            ),
            ("5a", "5b", "6b", "9"),
        )  # fmt: skip
    ratios = [
        case for case in banded
        if case.has("band_ratio", "band_ratio_low", "slip_mean")
        and case.data.sizes["percentile"] > 1
    ]  # fmt: skip
    ratios = ratios if results.is_chain else []  # else a joint has no dof of its own
    for letter, std, cases in _by_std(ratios):
        yield Figure(
            f"fig_11{letter}",
            f"Fig. 11{letter}. Width of the band of uncertainty, friction std {std:g}",
            "Ratio of the pseudo-variances (Eq. 46) of the outer percentiles, over the mean time"
            f" in slip. {looks.marks_of(cases)}. Bars are 95 % intervals,"
            f" Monte Carlo and time average together.{_pale(cases)}"
            " Look for a fall with the time in slip"
            f"{_of_lengths(cases, ', and whether the lengths differ where it is long')}.",
            _STUDY, (partial(study_figures.plot_band_ratio, cases=cases),),
            ("3a", "3b", "4a", "4b", "4c"),
        )  # fmt: skip


def _alone(results: Results, cases: Sequence[Case]) -> list[Case]:
    """Cases that are not part of a frequency response."""
    swept = {case.name for sweep in sweeps_of(results) for case in sweep.cases}
    return [case for case in cases if case.name not in swept]


def _few_lines(cases: list[Case]) -> list[Case]:
    """All cases, or those of the largest std: every process at as many levels as fit."""
    if len(cases) <= _MOST_LINES:
        return cases
    largest = max(case.std for case in cases)
    cases = [case for case in cases if case.std == largest]
    levels = sorted({case.strength for case in cases})
    n_levels = _MOST_LINES // len({case.process for case in cases})
    levels = style.some_of(levels, n_levels) if n_levels > 1 else levels[-1:]
    return style.some_of([case for case in cases if case.strength in levels], _MOST_LINES)


def _along(results: Results, cases: list[Case]) -> Iterator[Figure]:
    """Joints and dofs along the structure, from its first to its last."""
    for quantity in joints.QUANTITIES:
        there = [case for case in cases if case.n_joints > 1 and quantity.is_in(case)]
        own = _few_lines(there)
        if own:
            some = f" {len(own)} of {len(there)} cases." if len(own) < len(there) else ""
            friction = shared_friction(own)
            yield Figure(
                f"along_{quantity.name}",
                f"{quantity.heading} along the structure",
                f"Mean over samples of each joint{friction and f', {friction}'}."
                f" Bars are 95 % intervals, {quantity.errors(own)}.{some}",
                _STUDY,
                (partial(study_figures.plot_along, cases=own, quantity=quantity),),
            )  # fmt: skip
    spectra = [case for case in cases if case.n_dof > 1 and case.has_power("psd_mean")]
    if spectra and spectra[0].keeps_all_dofs:
        case = max(spectra, key=lambda case: case.strength)
        yield Figure(
            "along_spectra", f"Spectra along the structure, {looks.level_name(case)}",
            f"Mean spectrum of the displacement of every {results.place}, {case.friction}. Bright"
            " ridges are resonances; dark spots in them are nodes.",
            _STUDY, (partial(study_figures.plot_spectra_along, case=case, results=results),),
        )  # fmt: skip


def of_responses(results: Results) -> Iterator[Figure]:
    """Histories, and a transition enlarged; the spectra of a sample that stands alone."""
    for case in results.cases:
        name = f"{results.title}, case {case.name[1:].lstrip('0')}, {looks.level_name(case)}"
        if case.n_samples == 1 and not case.is_deterministic and case.has_power("psd"):
            yield Figure(
                f"spectra_{case.name}", f"Spectra of one sample, {name}",
                f"Power spectral densities of the displacements. {_welch(case)}",
                _RESPONSES, (partial(study_figures.plot_spectra, case=case, results=results),),
            )  # fmt: skip
        if not case.has("displacement", "velocity", "time"):
            continue
        sample = f"sample {int(case.data['sample'][0])}"
        yield Figure(
            f"history_{case.name}", f"Displacements, {name}",
            f"History of {sample}, at most its last minute.",
            _RESPONSES,
            (partial(response_figures.plot_history, case=case, results=results),), height=3.2,
        )  # fmt: skip
        if results.structure is None or not case.has("transition_time"):
            continue
        loops = response_figures.most_dissipating(case, results.structure)
        if loops:
            yield Figure(
                f"hysteresis_{case.name}", f"Hysteresis loops, {name}",
                f"Force over displacement of the joints that dissipate most, in {sample}, at most"
                " its last 10 s. The area of a loop is the energy that it dissipates.",
                _RESPONSES,
                tuple(
                    partial(
                        response_figures.plot_hysteresis,
                        case=case, structure=results.structure, joint=joint,
                    )
                    for joint in loops
                ),
                height=2.6,
            )  # fmt: skip
        if results.is_chain and case.keeps_all_dofs:
            yield from _transition(results.structure, case, name)


def _transition(chain: xr.Dataset, case: Case, name: str) -> Iterator[Figure]:
    episode = response_figures.find_episode(case)
    if episode is not None:
        yield Figure(
            f"transition_{case.name}", f"One slip, joint {episode.dof}, {name}",
            "Top: a slip from start to end. The force in the slider stays at its limit until the"
            " mass turns. Bottom: its end at full resolution. The transition is located inside a"
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
    process_gallery.of_processes, of_chain, of_certain_friction, of_drawn_friction,
    harmonic_gallery.of_sines, of_responses,
)  # fmt: skip


def _processes_of_scene(results: Results, files: Sequence[Results]) -> dict[str, xr.Dataset]:
    """The processes of the scene, of whichever file of it has them."""
    alike = (other.processes for other in files if other.scene == results.scene)
    return next((processes for processes in alike if processes), {})


def _welch(case: Case) -> str:
    n_segments = int(case.data.attrs["n_segments"])
    error = scatter_of_ln_psd(case.data)
    segments = "segment" if n_segments == 1 else "segments"
    return (
        f"Welch's method, {n_segments} {segments}: a bin scatters by"
        f" {100 * error:.0f} % with the force record."
    )


def _of_modes(results: Results) -> str:
    """Sentence on the lines at natural frequencies, if they are drawn."""
    if study_figures.marked_structure(results) is None:
        return ""
    return " Vertical lines: natural frequencies with all joints stuck (full), slipping (dotted)."


def _pale(cases: Sequence[Case]) -> str:
    """Sentence on pale marks, where a regression made estimates of its own."""
    is_drawn = any(case.plain is not None for case in cases)
    return " Pale marks: plain sampling." if is_drawn else ""


def _of_lengths(cases: Sequence[Case], words: str) -> str:
    """The words, if there are several correlation lengths to compare."""
    return words if len({case.correlation_length for case in cases}) > 1 else ""


def _lettered(items: Sequence[_Item]) -> Iterator[tuple[str, _Item]]:
    """(a, first), (b, second), ..., (z, ...), (aa, ...)."""
    for i, item in enumerate(items):
        yield ("" if i < 26 else chr(96 + i // 26)) + chr(97 + i % 26), item


def _by_std(cases: list[Case]) -> Iterator[tuple[str, float, list[Case]]]:
    for letter, std in _lettered(sorted({case.std for case in cases})):
        yield letter, std, [case for case in cases if case.std == std]


def _band_panels(cases: list[Case], forced: int | None) -> list[tuple[list[Case], int]]:
    """Cases and mass of each figure at the largest std.

    The paper's: mass 1 at each variance, the last at all of them; or the forced mass at all. Where
    their spectra are not kept, the first or last mass with spectra stands for them.
    """
    if not cases:
        return []
    std = max(case.std for case in cases)
    chosen = [case for case in cases if case.std == std]
    kept = cases[0].kept_dofs
    if forced is not None:
        return [(chosen, forced if forced in kept else kept[-1])]
    levels = sorted({case.strength for case in chosen})
    panels = [([c for c in chosen if c.strength == level], kept[0]) for level in levels]
    return [*panels, (chosen, kept[-1])] if len(kept) > 1 else panels
