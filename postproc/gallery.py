"""Which figures results files have data for, each with what to see in it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from typing import TypeVar

import xarray as xr

from . import chain_figure, figures, process_figures, response_figures, tradeoff
from .figure import SECTIONS, Figure
from .paper import is_paper_study
from .peaks import scatter_of_ln_psd
from .results import Case, Results

_Item = TypeVar("_Item")
_PROCESSES, _CHAIN, _STUDY, _RESPONSES, _ = SECTIONS
_MOST_SPECTRA = 4  # cases with friction certain; more are a sweep


def make_figures(files: Sequence[Results]) -> list[Figure]:
    """Those of every file, in the paper's order; later files' twins carry the file's name."""
    found: dict[str, Figure] = {}
    for results in files:
        of_tradeoff = tradeoff.figures_of(results, _processes_of_scene(results, files))
        for figure in chain(*(source(results) for source in SOURCES), of_tradeoff):
            own = figure if is_paper_study(results) else figure.outside_the_paper()
            twin = found.get(figure.name)
            if twin is not None and twin.section == _CHAIN and twin.caption == figure.caption:
                continue  # the same drawing
            kept = own.renamed(results.stem) if twin is not None else own
            found[kept.name] = kept
    return sorted(found.values(), key=lambda figure: (SECTIONS.index(figure.section), figure.name))


def of_processes(results: Results) -> Iterator[Figure]:
    """Figs. 1 to 6, of processes that a scene without chain solved."""
    if results.chain is not None:
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
                _shape_of_covariances(panel),
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
            " falls. Infinite sums. The paper reads off its figure that 6 is the largest order with"
            " L0 = 0.3 and L1 at most 1; it is 5 here, at 6 L1 is 1.03.",
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
    yield from _positive(solved, regressive, refused)
    for name, process in results.processes.items():
        if "realizations" in process:
            yield Figure(
                f"realizations_{name}", f"Realizations of process {name}",
                "The first of the realizations that the scene asked for, and the mean.",
                _PROCESSES, (partial(process_figures.plot_realizations, process=process),),
            )  # fmt: skip


def _positive(
    solved: list[xr.Dataset], regressive: list[xr.Dataset], refused: list[xr.Dataset]
) -> Iterator[Figure]:
    """Fig. 6: positive processes of one length and order, beside the free one; else all alone."""
    positive = [p for p in solved if process_figures.is_positive(p)]
    if not positive:
        return
    kinds = sorted({_kind(p) for p in positive}, key=lambda kind: -kind[1])  # L0 = 3 as the paper
    twins = {_kind(p): p for p in regressive}
    if not set(kinds) <= set(twins):
        yield Figure(
            "positive", "Autocovariances of positive processes",
            f"Over the variance, {_how_many(len(positive), process_figures.MOST_CURVES)}.",
            _PROCESSES, (partial(process_figures.plot_each, processes=positive),),
        )  # fmt: skip
        return
    for kind in kinds:
        own = [p for p in positive if _kind(p) == kind]
        not_drawn = [p for p in refused if process_figures.is_positive(p) and _kind(p) == kind]
        yield _beside_free(twins[kind], own, not_drawn, is_first=kind == kinds[0])


def _kind(process: xr.Dataset) -> tuple[str, float, int]:
    return (
        str(process.attrs["correlation"]), float(process.attrs["correlation_length"]),
        int(process.attrs["order"]),
    )  # fmt: skip


def _beside_free(
    free: xr.Dataset, positive: list[xr.Dataset], refused: list[xr.Dataset], is_first: bool
) -> Figure:
    """Fig. 6 of one length and order."""
    largest = "; ".join(
        f"{_largest(process_figures.difference_from_free(p, free)):.2g} at mean"
        f" {p.attrs['mean']:g} ({p.attrs['sampler']})"
        for p in positive
    )
    missing = "".join(
        f" Not drawn, mean {p.attrs['mean']:g} ({p.attrs['sampler']}): {p.attrs['reason']}."
        for p in refused
    )
    definition, length, order = _kind(free)
    return Figure(
        "fig_06" if is_first else f"fig_06_{length:g}",
        f"Fig. 6. Positive processes and the one without sign constraint, {definition} ="
        f" {length:g}, order {order}",
        "Autocovariances of positive processes, by the sequential law (open marks) and the exact"
        " one (dashed), beside that of the process without sign constraint; below, the differences"
        " with bars of two standard errors, the scatter of fits from other random numbers among"
        f" them. The paper finds them very close. The largest differences: {largest}.{missing}",
        _PROCESSES,
        (
            partial(process_figures.plot_positive, processes=[free, *positive]),
            partial(process_figures.plot_positive_difference, processes=[free, *positive]),
        ), height=3.6,
    )  # fmt: skip


def _shape_of_covariances(panel: list[xr.Dataset]) -> str:
    """What the curves of one length do with the order and with the lag, in numbers."""
    ordered = sorted(panel, key=process_figures.order_of)
    orders = [process_figures.order_of(process) for process in ordered]
    sizes = [
        abs(process["autocovariance"].values[1 : order + 1])
        for process, order in zip(ordered, orders, strict=True)
    ]
    name = "m_max" if panel[0].attrs["method"] == "direct" else "order"
    said = (
        f"The largest value beyond lag 0 goes from {sizes[0].max():.3g} at {name} {orders[0]} to"
        f" {sizes[-1].max():.3g} at {name} {orders[-1]}, where lag 1 has {sizes[-1][0]:.3g} and lag"
        f" {orders[-1]} {sizes[-1][-1]:.3g} (the paper:"
        f" {'constant' if panel[0].attrs['correlation'] == 'L0' else 'linear'} in the lag up to"
        f" {'m_max' if name == 'm_max' else 'M'}). Exact to 1e-8."
    )
    if name == "m_max":
        said += " Pale: lags beyond m_max, which Eq. 11 does not constrain."
    if any((process["autocovariance"] < 0).any() for process in panel):
        said += " Open marks: negative values."
    return said


def _how_many(count: int, most: int) -> str:
    return "all that were solved" if count <= most else f"{most} of the {count} that were solved"


def _largest(difference: xr.Dataset) -> float:
    return float(abs(difference["value"]).max())


def of_chain(results: Results) -> Iterator[Figure]:
    """Fig. 7."""
    if results.chain is not None:
        n_dof = int(results.chain.sizes["dof"])
        forced = int(results.chain.attrs.get("forced_dof", n_dof))
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
            "Time in slip over the variance of the force, friction certain; bars: 95 % intervals of"
            " the time average; dotted: what counts as fully stuck and fully slipping.",
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
            " mostly slip it has moved out of it. Slip softens the chain, so that its peaks lie"
            f" below the stuck frequencies. {_welch(case)} The bar at the lower left shows it.",
            _STUDY, (partial(figures.plot_spectra, case=case, results=results),), ("7",),
        )  # fmt: skip


def of_drawn_friction(results: Results) -> Iterator[Figure]:
    """Figs. 9 to 11, of a campaign."""
    is_paper = is_paper_study(results)
    random = [case for case in results.random if case.n_samples > 1]
    scattered = [case for case in random if case.has("slip_mean", "slip_std")]
    for letter, std, cases in _by_std(scattered):
        yield Figure(
            f"fig_09{letter}", f"Fig. 9{letter}. Scatter of the time in slip, friction std {std:g}",
            "Standard deviation over samples of the time in slip, over its mean; a mark"
            " per oscillator with its number, filled at the largest excitation; bars are 95 %"
            " intervals, of the mean with Monte Carlo and time average together. To look for: where"
            " the marks stand highest, and whether the lengths differ.",
            _STUDY, (partial(figures.plot_slip_scatter, cases=cases, is_paper=is_paper),),
            ("1a", "1b", "2"),
        )  # fmt: skip
    banded = [case for case in random if case.has("psd_mean", "psd_percentiles")]
    for letter, (cases, dof) in _lettered(_band_panels(banded)):
        variances = sorted({case.variance for case in cases})
        levels = ", ".join(figures.variance_name(v) for v in variances)
        panels = [[c for c in cases if c.variance == v] for v in variances]
        below = " One panel a level, from the smallest above." if len(panels) > 1 else ""
        yield Figure(
            f"fig_10{letter}", f"Fig. 10{letter}. Band of uncertainty, oscillator {dof}, {levels}",
            "Mean spectrum (thick) between the outer percentiles over samples (thin; shaded: their"
            " 95 % intervals, Monte Carlo and force record together), friction std"
            f" {cases[0].std:g}, for each correlation length; lines: natural frequencies with every"
            " slider stuck (full) and slipping (dotted). To look for: how far the percentiles lie"
            " apart, where the mean lies between them, and peaks of the upper one at the dotted"
            f" lines.{below} {_welch(cases[0])}",
            _STUDY,
            tuple(
                partial(figures.plot_band, cases=own, dof=dof, results=results, framed=cases)
                for own in panels
            ),
            ("5a", "5b", "6b", "9"),
        )  # fmt: skip
    ratios = [case for case in banded if case.has("band_ratio", "band_ratio_low", "slip_mean")]
    for letter, std, cases in _by_std(ratios):
        yield Figure(
            f"fig_11{letter}",
            f"Fig. 11{letter}. Width of the band of uncertainty, friction std {std:g}",
            "Ratio of the pseudo-variances (Eq. 46) of the outer percentiles, over the mean"
            " time in slip; a mark per oscillator with its number, filled at"
            " the largest excitation; 95 % intervals, Monte Carlo (bootstrap over samples) and time"
            " average together. To look for: a fall with the time in slip, and"
            " whether the lengths differ where that is long.",
            _STUDY, (partial(figures.plot_band_ratio, cases=cases),),
            ("3a", "3b", "4a", "4b", "4c"),
        )  # fmt: skip


def of_responses(results: Results) -> Iterator[Figure]:
    """Histories, and a transition enlarged; the spectra of a sample that stands alone."""
    for case in results.cases:
        name = (
            f"{results.title}, case {case.name[1:].lstrip('0')},"
            f" {figures.variance_name(case.variance)}"
        )
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
        if results.chain is not None and case.has("transition_time", "friction"):
            yield from _transition(results.chain, case, name)


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
)  # fmt: skip


def _processes_of_scene(results: Results, files: Sequence[Results]) -> dict[str, xr.Dataset]:
    """The processes of the scene, of whichever file of it has them."""
    scene = results.attrs.get("scene")
    alike = (other.processes for other in files if other.attrs.get("scene") == scene)
    return next((processes for processes in alike if processes), {})


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
    asked = Counter(int(p.attrs["order"]) for p in processes)
    for length in lengths:
        for letter, definition in (("a", "L0"), ("b", "L1")):
            panel = [
                p for p in processes
                if p.attrs["correlation"] == definition
                and process_figures.length_of(p) == length
                and (len(lengths) == 1 or asked[int(p.attrs["order"])] > 1)  # as its siblings have
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
