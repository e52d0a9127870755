"""Two designs side by side: differences sample by sample, with their errors.

Samples of the same number are compared. The same seed and the same process mean the same friction
values, and the same force. Then results differ by the design alone, and a difference has a far
smaller error than either result. Where the seeds differ, the errors of the two results are added in
squares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from .bits import differences
from .figures.figure import Figure
from .figures.style import add_legend, line_of_dof, of_rank, some_of
from .output import InputError
from .paper.evidence import WIDTH
from .results import Case, Results
from .table import Table, value_with_error

Values = NDArray[np.float64]

OF_RECORD = (
    "Where all samples have one force record, the scatter of the changes with the record is not"
    " included."
)
_SAME = "Both files have the same bits, except when, how long and on how many ranks they ran."
_ROUNDING = 1.0e-12  # of numbers of samples that do not scatter, relative to them
_REQUEST = (
    "law", "method", "correlation", "second_length", "order", "bound_l0", "bound_l1", "upper_bound",
    "mean", "positive", "sampler", "branch_asked", "simulation",
)  # fmt: skip
_MOST_NAMED = 5  # datasets and attributes that differ
_MOST_DRAWN = 6  # cases
_NEGLIGIBLE_POWER = 1.0e-4  # share of the mean spectrum beyond the frequencies that are drawn


@dataclass(frozen=True)
class Change:
    """A statistic of each joint or dof before and after, and its change with a standard error."""

    before: Values
    after: Values
    change: Values
    error: Values  # not a number for a single sample
    error_apart: Values  # of the change, if the samples were not the same


@dataclass(frozen=True)
class Pair:
    """The same case of two files: one process under one excitation."""

    before: Case
    after: Case
    label: str
    is_paired: bool  # sample by sample

    @cached_property
    def rows(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of the samples that both have, by their numbers."""
        before, after = (case.data["sample"].values for case in (self.before, self.after))
        _, *places = np.intersect1d(before, after, assume_unique=True, return_indices=True)
        return places[0], places[1]

    @property
    def n_samples(self) -> int:
        """Samples that both have."""
        return len(self.rows[0])

    def samples(self, name: str) -> tuple[Values, Values] | None:
        """A dataset of every sample, before and after; None where either file has it not."""
        return self._both(name, lambda case: case.data[name].values)

    def powers(self) -> tuple[Values, Values] | None:
        """Pseudo-variances (sample, dof), each by the frequencies of its own file."""
        return self._both("psd", lambda case: case.data["psd"].values.sum(axis=1) * _step(case))

    def spectra(self) -> tuple[Values, Values] | None:
        """Spectra at the frequencies of both files; None where those are not equally far apart."""
        if not (self.before.has("psd") and self.after.has("psd")):
            return None
        if not np.isclose(_step(self.before), _step(self.after), rtol=1e-9, atol=0.0):
            return None
        n = min(case.data.sizes["frequency"] for case in (self.before, self.after))
        return self._both("psd", lambda case: case.data["psd"].values[:, :n])

    def moving(self) -> list[int]:
        """Dofs whose spectra have power in both files."""
        spectra = self.spectra()
        if spectra is None:
            return []
        kept = [dof for dof in self.before.kept_dofs if dof in self.after.kept_dofs]
        return [dof for dof in kept if all((one[..., dof - 1] > 0.0).any() for one in spectra)]

    def _both(self, name: str, read: Callable[[Case], Values]) -> tuple[Values, Values] | None:
        if not (self.before.has(name) and self.after.has(name)):
            return None
        first, second = (
            np.asarray(read(case), dtype=float)[rows]
            for case, rows in zip((self.before, self.after), self.rows, strict=True)
        )
        if first.shape != second.shape:
            raise InputError(
                f"{self.label}: {name} has the shape {first.shape} before and {second.shape} after:"
                " only structures with the same joints and dofs can be compared"
            )
        return first, second


def _step(case: Case) -> float:
    """Distance of the frequencies of the spectra [Hz]."""
    return float(np.diff(case.data["frequency"].values[:2])[0])


def pair_cases(before: Results, after: Results) -> list[Pair]:
    """Cases that both have, by process, standard deviation, length and force.

    Of several processes of one length those that were asked for alike; a single one of each file
    may have another order or law.
    """
    is_paired = before.attrs.get("seed") == after.attrs.get("seed")
    rivals, others = _by_key(before), _by_key(after)
    labels = Counter(case.label for case in before.cases)
    pairs = []
    for case in before.cases:
        found = others.get(_key(case), [])
        if len(found) > 1 or len(rivals[_key(case)]) > 1:
            found = [other for other in found if _request(other) == _request(case)]
        label = case.label if labels[case.label] == 1 else f"{case.name}: {case.label}"
        pairs += [Pair(case, other, label, is_paired) for other in found[:1]]
    if not pairs:
        raise InputError(
            f"{before.path} and {after.path}: no case of the same process under the same force"
        )
    for pair in pairs:
        if pair.n_samples == 0:
            raise InputError(f"{before.path} and {after.path}: {pair.label}: no sample is in both")
    return pairs


def in_common(before: Results, after: Results, pairs: Sequence[Pair]) -> str:
    """Names of what the samples of two files with the same seed have in common."""
    frictions = (pair.samples("friction") for pair in pairs)
    shared = []
    if all(values is not None and np.array_equal(*values) for values in frictions):
        shared.append("friction values")
    if _force_settings(before) == _force_settings(after):
        shared.append("force")
    return " and ".join(f"the same {word}" for word in shared or ["seed"])


def _force_settings(results: Results) -> list[str]:
    """Lines of the settings that shape the force."""
    words = ("excitation%", "integration%dt ", "integration%n_steps ", "hash of the force file ")
    lines = str(results.attrs.get("settings", "")).splitlines()
    return [line for line in lines if line.startswith(words)]


def _by_key(results: Results) -> dict[tuple[object, ...], list[Case]]:
    found: dict[tuple[object, ...], list[Case]] = {}
    for case in results.cases:
        found.setdefault(_key(case), []).append(case)
    return found


def _request(case: Case) -> tuple[object, ...]:
    """The request, but for length and standard deviation."""
    return tuple(case.asked.get(name) for name in _REQUEST)


def _key(case: Case) -> tuple[object, ...]:
    return (case.is_deterministic, case.std, case.correlation_length, case.frequency, case.strength)


def mean_change(before: Values, after: Values, is_paired: bool) -> Change:
    """Change of the mean over samples (sample, place)."""
    return _change(before.mean(axis=0), after.mean(axis=0), before, after, is_paired)


def std_change(before: Values, after: Values, is_paired: bool) -> Change:
    """Change of the standard deviation over samples, by the influence of each sample on it."""
    spreads = [values.std(axis=0, ddof=1) for values in (before, after)]
    influences = [
        np.divide(
            (values - values.mean(axis=0)) ** 2, 2.0 * spread,
            out=np.zeros_like(values), where=spread > _ROUNDING * np.abs(values).max(axis=0),
        )
        for values, spread in zip((before, after), spreads, strict=True)
    ]  # fmt: skip
    (first, second), (early, late) = spreads, influences
    return _change(first, second, early, late, is_paired)


def _change(
    before: Values, after: Values, per_sample: Values, per_sample_after: Values, is_paired: bool
) -> Change:
    n = len(per_sample)
    if n < 2:
        nothing = np.full(np.shape(before), np.nan)
        return Change(before, after, after - before, nothing, nothing)
    apart = np.sqrt((per_sample.var(axis=0, ddof=1) + per_sample_after.var(axis=0, ddof=1)) / n)
    paired = np.sqrt((per_sample_after - per_sample).var(axis=0, ddof=1) / n)
    return Change(before, after, after - before, paired if is_paired else apart, apart)


def _changes(pair: Pair) -> Iterator[tuple[str, float, Change]]:
    """Each statistic with the factor into its printed unit."""
    slip = pair.samples("slip_fraction")
    if slip is not None:
        yield "mean time in slip [%]", 100.0, mean_change(*slip, pair.is_paired)
        if pair.n_samples > 1:
            yield "std of the time in slip [%]", 100.0, std_change(*slip, pair.is_paired)
    for name, text in (
        ("slip_distance", "slip distance [m]"),
        ("dissipation", "dissipation [J]"),
        ("harmonic_amplitude", "amplitude of the sine's frequency [m]"),
    ):
        values = pair.samples(name)
        if values is not None:
            yield text, 1.0, mean_change(*values, pair.is_paired)
    powers = pair.powers()
    if powers is not None:
        yield "pseudo-variance [m²]", 1.0, mean_change(*powers, pair.is_paired)


def change_table(before: Results, after: Results, pairs: Sequence[Pair]) -> Table:
    """Every statistic of every joint or dof, before, after, and its change."""
    rows = []
    for pair in pairs:
        for text, factor, change in _changes(pair):
            for place in np.flatnonzero(np.isfinite(change.change)):  # of dofs that are kept
                error, apart = change.error[place], change.error_apart[place]
                largest = max(abs(change.before[place]), abs(change.after[place]))
                is_known = pair.is_paired and error > _ROUNDING * largest
                gain = f"{apart / error:.1f}" if is_known else "-"
                rows.append(
                    (
                        pair.label, text, str(place + 1),
                        f"{factor * change.before[place]:.5g}",
                        f"{factor * change.after[place]:.5g}",
                        value_with_error(factor * change.change[place], factor * error), gain,
                    )
                )  # fmt: skip
    how = (
        f"Samples have {in_common(before, after, pairs)} in both files, so errors are those of the"
        " differences sample by sample. 'gain' is how many times larger they would be with other"
        " samples."
        if pairs[0].is_paired
        else "The seeds differ: errors of the two results are added in squares."
    )
    return Table(
        "comparison", f"{after.title} against {before.title}",
        ("case", "statistic", f"joint or {before.place}", "before", "after", "change", "gain"),
        rows,
        f"{how} Values are means over the samples of both files, as in plain/. Standard errors"
        f" in brackets, in units of the last digits. {OF_RECORD}",
    )  # fmt: skip


def change_figures(pairs: Sequence[Pair], place: str) -> list[Figure]:
    """Change of the time in slip over the joints, and of the mean spectra over frequency."""
    figures = []
    slips = [pair for pair in pairs if pair.samples("slip_fraction") is not None]
    if slips:
        figures.append(
            Figure(
                "comparison_slip", "Change of the time in slip",
                "Mean over samples, after minus before, in percentage points; 95 % intervals.",
                "The friction study", (partial(_draw_slip, slips),),
            )
        )  # fmt: skip
    spectra = [pair for pair in pairs if pair.n_samples > 1 and pair.moving()]
    if spectra:
        figures.append(
            Figure(
                "comparison_spectra", "Change of the mean spectra",
                "Mean spectral density after, divided by that before, with 95 % bands.",
                "The friction study",
                tuple(partial(_draw_spectra, pair, place) for pair in spectra),
            )
        )  # fmt: skip
    return figures


def most_changed(pairs: Sequence[Pair]) -> list[Pair]:
    """The pairs whose mean time in slip changes most, as many as can be drawn."""
    largest = []
    for pair in pairs:
        slip = pair.samples("slip_fraction")
        largest.append(0.0 if slip is None else float(abs(slip[1].mean(0) - slip[0].mean(0)).max()))
    places = np.argsort(largest, kind="stable")[-_MOST_DRAWN:]
    return [pairs[i] for i in sorted(places)]


def _draw_slip(pairs: Sequence[Pair], axes: Axes) -> None:
    width = 0.6 / len(pairs)
    for rank, pair in enumerate(pairs):
        slip = pair.samples("slip_fraction")
        if slip is None:
            continue
        change = mean_change(*slip, pair.is_paired)
        place = np.arange(1, len(change.change) + 1) + width * (rank - (len(pairs) - 1) / 2)
        look = of_rank(rank, len(pairs)) | {"linestyle": "none"}
        bars = np.nan_to_num(WIDTH * 100.0 * change.error)
        axes.errorbar(place, 100.0 * change.change, yerr=bars, capsize=2, label=pair.label, **look)
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    axes.set(xlabel="joint", ylabel="change of the mean time in slip [percentage points]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    add_legend(axes)


def _draw_spectra(pair: Pair, place: str, axes: Axes) -> None:
    spectra = pair.spectra()
    if spectra is None:
        return
    before, after = spectra
    frequency = pair.before.data["frequency"].values
    power = np.cumsum(np.nansum(before.mean(axis=0), axis=1))
    kept = int(np.argmax(power >= (1.0 - _NEGLIGIBLE_POWER) * power[-1])) + 1
    for dof in some_of(pair.moving()):
        first, second = (values[:, :kept, dof - 1] for values in (before, after))
        means = first.mean(axis=0), second.mean(axis=0)
        one, other = first / means[0], second / means[1]
        change = _change(np.log(means[0]), np.log(means[1]), one, other, pair.is_paired)
        look = line_of_dof(dof, pair.before.kept_dofs[-1])
        axes.plot(frequency[:kept], np.exp(change.change), label=f"{place} {dof}", **look)
        reach = WIDTH * change.error
        axes.fill_between(
            frequency[:kept], np.exp(change.change - reach), np.exp(change.change + reach),
            color=look["color"], alpha=0.15, linewidth=0.0,
        )  # fmt: skip
    axes.axhline(1.0, color="0.4", linewidth=0.8)
    axes.set(
        xlabel="frequency [Hz]", ylabel="spectral density, after / before", yscale="log",
    )  # fmt: skip
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    add_legend(axes, pair.label)


def compare(before: Results, after: Results, folder: Path | None) -> str:
    """Differences of two files in words; table and figures go into the folder, if there is one."""
    bits = _bits(differences(before.path, after.path))
    if not (before.cases or after.cases):
        return bits
    pairs = pair_cases(before, after)
    table = change_table(before, after, pairs)
    written = []
    if folder is not None:
        table.write_csv(folder)
        drawn = most_changed(pairs)
        figures = [figure.save(folder).name for figure in change_figures(drawn, before.place)]
        written = [f"{', '.join(['comparison.csv', *figures])} in {folder}"]
        if len(drawn) < len(pairs):
            written += [f"Drawn: the {len(drawn)} of {len(pairs)} cases whose slip changes most."]
    return "\n".join([*lines_of(table), "", *written, table.note, bits])


def _bits(different: Sequence[str]) -> str:
    """Sentence on the bits of two files: the same, or how many datasets and attributes differ."""
    if not different:
        return _SAME
    named = ", ".join(different[:_MOST_NAMED])
    more = ", ..." if len(different) > _MOST_NAMED else ""
    return f"Datasets and attributes whose bits differ: {len(different)} ({named}{more})."


def lines_of(table: Table) -> Iterator[str]:
    """The table in columns."""
    rows = [table.header, *table.rows]
    widths = [max(len(row[i]) for row in rows) for i in range(len(table.header))]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
