"""The paper's statements, each put to a stated test."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..results import Results
from . import band_statements, deterministic_statements, process_statements, slip_statements
from .evidence import NoEvidence, Statement
from .printed import is_paper_study
from .study import paper_study


def assess(files: Sequence[Results]) -> list[Statement]:
    """Every statement that these results files have data for.

    Where several have them, the one with the narrowest intervals decides, and the statement names
    its scene.
    """
    found: dict[str, list[tuple[float, Statement]]] = {}
    for results in filter(is_paper_study, files):
        for test in _tests(results):
            try:
                with np.errstate(divide="ignore", invalid="ignore"):
                    statement = test()
            except NoEvidence:
                continue
            named = replace(statement, scene=results.title)
            widths = [finding.high - finding.low for finding in statement.findings]
            found.setdefault(statement.number, []).append((sum(widths), named))
    decided = [min(group, key=lambda one: one[0])[1] for group in found.values()]
    return sorted(decided, key=lambda statement: statement.number)


def _tests(results: Results) -> Iterator[Callable[[], Statement]]:
    study = paper_study(results)
    if study is not None:
        yield from (partial(test, study) for test in slip_statements.ALL)
        if study.has_spectra:
            yield from (partial(test, study) for test in band_statements.ALL)
            if study.has_certain_spectra:
                yield partial(band_statements.peaks_of_percentile, study)
    for test in (*deterministic_statements.ALL, *process_statements.ALL):
        yield partial(test, results)
