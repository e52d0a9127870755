"""Verdicts on the paper's statements on processes, on processes that a test chooses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from entroslip.paper import process_statements
from entroslip.paper.evidence import NoEvidence, Verdict
from entroslip.paper.statements import assess
from entroslip.results import Results
from tests.postproc.synthetic import process, results_of

YES, NO = Verdict.CONFIRMED, Verdict.REFUTED
LAGS = np.arange(31)


def file_of(*processes):
    named = {f"p{i + 1:03d}": one for i, one in enumerate(processes)}
    return Results(path=Path("processes.h5"), attrs={}, processes=named, structure=None, cases=[])


def family(curve=lambda order: 0.5**LAGS, correlation="L0", lengths=(0.3, 1.0, 3.0), **values):
    """Orders 2, 4, 6 of each length; values by length and order."""
    made = []
    for length in lengths:
        for order in (2, 4, 6):
            one = process(
                length, order, curve(order), correlation=correlation, method="autoregressive"
            )
            made.append(one.assign({name: law(length, order) for name, law in values.items()}))
    return made


def test_processes_of_both_lengths_are_none_of_the_paper():
    """S4 was undecided on them, as their L0 does not fall."""
    assert assess([file_of(*family(correlation="both", lengths=(1.0,)))]) == []


@pytest.mark.parametrize(("sign", "verdict"), [(-1.0, YES), (1.0, NO)])
def test_towards_white_noise(sign, verdict):
    def curve(order):
        return np.where(LAGS == 0, 1.0, 0.1 + 0.01 * sign * order)

    assert process_statements.near_white_noise(file_of(*family(curve))).verdict == verdict


@pytest.mark.parametrize(
    ("correlation", "power", "verdict"),
    [("L0", 0, YES), ("L0", 1, NO), ("L1", 1, YES), ("L1", 2, NO)],
)
def test_shape_in_the_lag(correlation, power, verdict):
    """Curves of the direct method alone, with the wanted lengths."""
    curves = family(lambda order: np.where(LAGS == 0, 1.0, 0.01 * LAGS**power), correlation)
    direct = [one.assign_attrs(method="direct") for one in curves]
    test = process_statements.shape_in_the_lag("S2b", (1.0, 3.0))
    statement = test(file_of(*direct))
    assert statement.verdict == verdict
    assert [finding.text.split(",")[1] for finding in statement.findings] == [
        f" {correlation} = {length}" for length in (1, 3)
    ]
    with pytest.raises(NoEvidence):
        test(file_of(*curves))


@pytest.mark.parametrize(("rises", "verdict"), [(True, YES), (False, NO)])
def test_order_needed(rises, verdict):
    """Entropy lost: in proportion to the length, or the less the longer; a tenth more under L0."""
    found = []
    for correlation, factor in (("L0", 0.011), ("L1", 0.010)):

        def entropy(length, order, factor=factor):
            return 1.4189 - factor * 4.0 * (length if rises else 1.0 / length) / order

        found += family(correlation=correlation, entropy=entropy)
    assert process_statements.order_needed(file_of(*found)).verdict == verdict


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, YES), (-1.0, NO)])
def test_other_length(sign, verdict):
    found = family(correlation="L0", L1=lambda length, order: length + sign * 0.1 * order)
    found += family(correlation="L1", L0=lambda length, order: length - sign * 0.01 * order)
    assert process_statements.other_length(file_of(*found)).verdict == verdict


@pytest.mark.parametrize(("length", "verdict"), [(0.95, YES), (1.034, NO)])
def test_order_six(length, verdict):
    found = family(L1=lambda _, order: length)
    assert process_statements.order_six(file_of(*found)).verdict == verdict
    with pytest.raises(NoEvidence):
        process_statements.order_six(file_of(*family(lengths=(1.0,))))


@pytest.mark.parametrize(("apart", "verdict"), [(0.001, YES), (0.05, NO)])
def test_positive_processes(apart, verdict):
    found = family(lengths=(3.0,))
    curve = 0.5**LAGS + apart * (LAGS == 3)
    found.append(process(3.0, 6, curve, method="autoregressive", positive=1, mean=2.0))
    assert process_statements.positive_processes(file_of(*found)).verdict == verdict


def test_the_papers_own_law_decides_on_positive_processes():
    """Values rejected one at a time; the law of Eq. 25 is another one."""
    found = family(lengths=(3.0,))
    near = process(3.0, 6, 0.5**LAGS, method="autoregressive", positive=1, mean=2.0)
    far = process(3.0, 6, 0.7**LAGS, method="autoregressive", positive=1, mean=2.0)
    exact = far.assign_attrs(sampler="exact")
    assert process_statements.positive_processes(file_of(*found, near, exact)).verdict == YES
    assert process_statements.positive_processes(file_of(*found, near, far)).verdict == NO


def test_positive_processes_stand_beside_those_of_their_own_method():
    """The direct method sums to m_max: its K is not that of the autoregressive process."""
    found = family(lengths=(1.0,))
    direct = process(1.0, 4, 0.7**LAGS, method="direct")
    positive = process(1.0, 4, 0.7**LAGS, method="direct", positive=1, mean=3.0)
    statement = process_statements.positive_processes(file_of(*found, direct, positive))
    assert statement.verdict == YES
    assert "m_max = 4" in statement.findings[0].text


def test_they_are_judged_for_the_papers_processes_alone():
    numbers = {statement.number for statement in assess([file_of(*family())])}
    assert {"S1", "S3"} <= numbers
    other = [one.assign_attrs(correlation_length=0.7) for one in family(lengths=(1.0,))]
    assert assess([file_of(*other)]) == []
    with pytest.raises(NoEvidence):
        process_statements.near_white_noise(results_of([]))
