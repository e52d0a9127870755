"""Names, colours and marks of cases: by process, fuller and larger with the excitation."""

from __future__ import annotations

from collections.abc import Sequence

from ..paper.printed import LEVELS, STUCK_HZ
from ..processes import MAXIMUM_ENTROPY
from ..results import Case
from . import style

MOST_NUMBERED = 12  # marks of a case
_MOST_FILLINGS = 2  # of marks: open and full; more levels of the force differ in size too
_SMALLEST_MARK, _LARGEST_MARK = 4.0, 8.0  # [points]
_DIFFERENCES = {"order_found": "order ", "mean": "mean ", "sampler": ""}


def level_name(case: Case) -> str:
    """'variance 3.7 N² (low)', with the paper's name where it has one."""
    name = _name_in_paper(case)
    return case.level + (f" ({name})" if name else "")


def _name_in_paper(case: Case) -> str:
    """'low' or 'high', of as many masses as the paper's; '' if it has no name."""
    return LEVELS.get(case.variance, "") if case.n_dof == len(STUCK_HZ) else ""


def of_processes(cases: Sequence[Case]) -> dict[str, tuple[str, style.Look]]:
    """Name and look of the process of each case.

    '$L_0$ = 1', or the law of friction that is none of maximum entropy, and what else differs
    between processes of one std. Colour and mark are those of the length, or of the rank if lengths
    are shared.
    """
    of = {case.process: case for case in cases}
    names = {
        process: style.with_symbols(case.lengths) if case.law == MAXIMUM_ENTROPY else case.law
        for process, case in of.items()
    }
    for fact, word in _DIFFERENCES.items():
        values = {process: case.asked.get(fact) for process, case in of.items()}
        apart = {(name, of[process].std) for process, name in names.items()}
        if len(apart) < len(of) and len(set(values.values())) > 1:
            names = {process: f"{name}, {word}{values[process]}" for process, name in names.items()}
    lengths = [case.correlation_length for case in of.values()]
    is_distinct = len(set(lengths)) == len(lengths)
    return {
        process: (
            names[process],
            style.of_length(case.correlation_length, lengths)
            if is_distinct
            else style.of_rank(rank, len(of)),
        )
        for rank, (process, case) in enumerate(of.items())
    }


def marks_of(cases: Sequence[Case]) -> str:
    """'Each joint has a mark', which of them are numbered, and how marks differ with the force."""
    is_long = cases[0].n_joints > MOST_NUMBERED
    marks = f"Each joint has a mark{', some with their' if is_long else ' with its'} number"
    n_levels = len({case.strength for case in cases})
    if n_levels > _MOST_FILLINGS:
        return f"{marks}, fuller and larger with the excitation"
    return marks + ", open at the lower and full at the higher excitation" * (n_levels > 1)


def by_length(cases: Sequence[Case]) -> list[tuple[Case, style.Look, str]]:
    """Cases with their look: colour and mark by length, fuller and larger with the excitation."""
    named = of_processes(cases)
    levels = sorted({case.strength for case in cases})
    rows = []
    for case in cases:
        of_process, look = named[case.process]
        look = look | {"linestyle": "none"}
        look |= {"markeredgecolor": look["color"], "markeredgewidth": 1.0}
        rank = levels.index(case.strength) / (len(levels) - 1) if len(levels) > 1 else 1.0
        look["markerfacecolor"] = (look["color"], rank)  # the smallest excitation open
        if len(levels) > _MOST_FILLINGS:
            look["markersize"] = _SMALLEST_MARK + rank * (_LARGEST_MARK - _SMALLEST_MARK)
        name = _name_in_paper(case) or case.level
        rows.append((case, look, f"{of_process}, {name}"))
    return rows
