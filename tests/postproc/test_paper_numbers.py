"""The paper's numbers stand beside ours, each once, and nobody else's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from entroslip.joints import QUANTITIES
from entroslip.paper.numbers import table_correlations, table_numbers
from entroslip.paper.statements import assess
from entroslip.results import Results
from entroslip.tables import table_joints, table_slip
from tests.postproc.synthetic import LOW, certain, friction_study, process, results_of


def processes():
    """L0 = 0.3 at orders 4, 5 and 6, where L1 passes 1."""
    named = {
        f"p{order}": process(0.3, order, method="autoregressive").assign(
            L1=1.03 - 0.1 * (6 - order)
        )
        for order in (4, 5, 6)
    }
    return Results(path=Path("processes.h5"), attrs={}, processes=named, structure=None, cases=[])


def test_every_number_of_the_paper_is_there_once():
    study = friction_study(n_samples=30)
    files = [study, processes()]
    table = table_numbers([*files, study], assess(files))
    places = [row[0] for row in table.rows]
    assert {place: places.count(place) for place in set(places)} == {
        "Table 1": 10, "Table 2": 10, "Eq. 42": 1, "Fig. 4": 1, "Fig. 9": 2,
    }  # fmt: skip
    of = {row[:2]: row[2:] for row in table.rows}
    assert of["Fig. 4", "largest order with L0 = 0.3 and L1 at most 1"][:2] == ("6", "5")
    theirs, ours, _ = of["Table 2", "variance 3.7 N², joint 5: time in slip [%]"]
    assert theirs == "37"
    assert ours == "35.00(45)"  # p (1 - p) sqrt(2/5000)


def test_what_the_paper_prescribes_stands_beside_the_file():
    study = friction_study(n_samples=30)
    study.structure["dt"] = 0.00843
    study.structure["normal_load"] = ("joint", np.full(5, 10.0))
    study.structure["stiffness_value"] = ("entry", np.array([50.0, -25.0, 25.0]))
    for case in study.random:
        case.data.attrs["duration"] = 3372.0
        study.processes[case.process] = process(1.0, 5, mean=0.2)
    found = {row[:2]: row[2:4] for row in table_numbers([study], []).rows}
    assert found["Sec. 3", "N [N]"] == ("10", "10")
    assert found["Sec. 3", "k1 [N/m]"] == ("25", "25")
    assert found["Sec. 3", "friction coefficient, mean"] == ("0.2", "0.2")
    assert found["Sec. 3", "steps"] == ("400,000", "400000")
    assert found["Sec. 3", "samples of a case"] == ("100", "30")
    assert found["Eq. 46", "Nyquist frequency [rad/s]"] == ("120 π", "118.62 π")


def test_the_smallest_error_decides():
    """A longer march of the same chain, named by its scene."""
    study, longer = friction_study(n_samples=30), results_of([certain(LOW)])
    longer.attrs["title"] = "longer"
    longer.deterministic[0].data["slip_starts"][:] = 500000
    for files in ([study, longer], [longer, study]):
        found = {row[:2]: row[2:] for row in table_numbers(files, []).rows}
        assert found["Table 2", "variance 3.7 N², joint 5: time in slip [%]"] == (
            "37", "35.000(45)", "longer",
        )  # fmt: skip


def test_a_structure_of_ones_own_has_no_such_table():
    study = friction_study(n_samples=30)
    study.structure["frequencies_stuck"] = study.structure["frequencies_stuck"] * 1.1
    assert table_numbers([study], assess([study])) is None


def test_table_2_has_the_means_at_random_friction_beside_it():
    study = friction_study(n_samples=30)
    for case in study.random:
        case.data["slip_mean"] = case.data["slip_fraction"].mean("sample")
        case.data["slip_mean_error"] = ("joint", np.full(5, 0.03))
        case.data["slip_mean_time_error"] = ("joint", np.full(5, 0.01))
    rows = {row[0]: row[1:] for row in table_slip(study).rows}
    cells = rows[f"variance {LOW:g} N², mean at random friction, std 0.067"]
    assert cells[0] == "5.0(20)"  # 3/sqrt(3) points of three lengths, 1 of their one record


def test_forces_and_given_friction_are_named():
    """No force is guessed from variance = 0: a sine has its frequency, a file its factor."""
    cases = [certain(LOW), certain(0.0), certain(0.0)]
    cases[1].data.attrs.update(amplitude=2.0, frequency=0.5)
    cases[2].data.attrs.update(factor=3.0)
    cases[2].data["friction"][0, 4] = 0.3
    table = table_slip(results_of(cases))
    assert {row[0] for row in table.rows} >= {
        f"variance {LOW:g} N²", "2 N at 0.5 Hz", "force factor 3",
    }  # fmt: skip
    assert table.note.startswith("Friction 0.2 (process%mean).")
    assert cases[2].given_friction == "friction from 0.2 to 0.3 (process%mean)"
    for case in cases:
        case.data["slip_mean"] = case.data["slip_fraction"].mean("sample")
        case.data["slip_mean_error"] = ("joint", np.full(5, 0.03))
    slip = next(quantity for quantity in QUANTITIES if quantity.name == "slip")
    joints = table_joints(cases, slip)
    assert joints.title.endswith("[%], deterministic friction")
    assert [name.split(": ")[-1] for name in joints.header[1:]] == [
        f"variance {LOW:g} N²", "2 N at 0.5 Hz", "force factor 3",
    ]  # fmt: skip


def test_the_chain_sees_few_lags():
    """Correlations at 1 to 4 joints apart, once a length; none without several lengths."""
    study = friction_study(n_samples=30)
    lengths = {case.process: case.correlation_length for case in study.random}
    study.processes.update({name: process(length, 5) for name, length in lengths.items()})
    table = table_correlations(study)
    assert [row[0] for row in table.rows] == ["L0 = 0.3", "L0 = 1", "L0 = 3"]
    assert table.rows[0][2:] == ("0.500", "0.250", "0.125", "0.062")
    assert table_correlations(friction_study(n_samples=30)) is None
