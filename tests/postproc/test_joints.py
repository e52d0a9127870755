"""Tables and figures of each joint along the structure."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from entroslip import joints, open_results, tables
from entroslip.figures import looks, study_figures

RING = """\
&process correlation_length = 1.0 order = 2 mean = 0.3 std = 0.06 /
&chain n_dof = 4 mass = 0.5 /
&excitation variance = 10.0, 41.1 /
&integration method = 'event' n_steps = 3000 n_discard = 200 /
&campaign n_samples = 25 /
&output segment_length = 256 /
"""


@pytest.fixture(scope="module")
def results(results_of_scene):
    return open_results(results_of_scene(RING))


def test_power_is_the_dissipated_energy_over_the_time(results):
    case = results.cases[1]
    assert case.duration == pytest.approx(2800 * float(results.structure["dt"]))
    power, error = joints.QUANTITIES[1].of(case)
    energy = case.data["dissipation_mean"].values
    np.testing.assert_allclose(power * case.duration, energy)
    np.testing.assert_allclose(error / power, case.data["dissipation_mean_error"] / energy)
    assert (power > 0.0).all()


def test_largest_displacements_are_those_of_the_samples(results):
    case = results.cases[0]
    mean, error = joints.QUANTITIES[3].of(case)
    samples = case.data["joint_displacement_max"].values
    np.testing.assert_allclose(mean, samples.mean(axis=0))
    np.testing.assert_allclose(error, samples.std(axis=0, ddof=1) / np.sqrt(25))


def test_every_quantity_has_a_table_with_its_unit_in_every_column(results):
    found = {table.name: table for table in tables.of_chain(results)}
    for name, unit in (("joints", "%"), ("joints_power", "W"), ("joints_distance", "m"),
                       ("joints_displacement", "m")):  # fmt: skip
        assert len(found[name].rows) == 4
        assert all(cell.startswith(f"[{unit}] ") for cell in found[name].header[1:])
        assert ": variance 41.1 N²" in found[name].header[2]


def test_tables_say_what_their_errors_are_of(results, results_of_scene):
    """A power of 0.700(1) W was that of one force record; with others it was 0.68 to 0.82 W."""
    short = open_results(results_of_scene(RING.replace("n_steps = 3000", "n_steps = 600")))
    for these, of_slip in ((results, "and time average together."), (short, "Monte Carlo alone, ")):
        found = {table.name: table for table in tables.of_chain(these)}
        assert of_slip in found["joints"].note
        assert found["joints_power"].note.endswith("the time average, which is often larger.")
    case = results.random[0]
    data = case.data.assign(slip_mean_time_error=0.0 * case.data["slip_mean_time_error"])
    assert joints.QUANTITIES[1].errors([replace(case, data=data)]) == "Monte Carlo"


def test_many_cases_stand_below_one_another(results):
    """A sweep has more cases than the structure has joints: a row a case."""
    table = tables.table_joints([*results.cases] * 4, joints.QUANTITIES[0])
    assert table.header == ("case", *(f"joint {i} [%]" for i in range(1, 5)))
    assert table.title.endswith(" [%], std 0.06, L0 = 1")  # the friction of all
    assert [row[0] for row in table.rows[:2]] == [
        f"{case.name}: {case.force}" for case in results.cases[:2]
    ]  # fmt: skip
    upright = tables.table_joints(results.cases, joints.QUANTITIES[0])
    assert table.rows[1][1:] == tuple(row[2] for row in upright.rows)


def test_spectra_along_the_structure_show_every_dof(results):
    picture, axes = plt.subplots()
    study_figures.plot_spectra_along(axes, results.cases[1], results)
    (mesh,) = axes.collections
    assert mesh.get_array().shape == (4, results.cases[1].data.sizes["frequency"])
    assert mesh.get_array().max() == mesh.norm.vmax
    plt.close(picture)


def test_many_joints_leave_the_beginning_of_the_report_to_the_figures(results_of_scene):
    """Tables of 200 rows stood before the figures, under the paper's name of a variance."""
    scene = RING.replace("n_dof = 4", "n_dof = 25").replace("n_samples = 25", "n_samples = 2")
    long = open_results(results_of_scene(scene.replace("= 2 /", "= 2 deterministic = .true. /")))
    found = {table.name: table for table in tables.of_chain(long)}
    assert found["joints"].is_detail
    assert found["slip"].is_detail
    assert looks.level_name(long.cases[1]) == "variance 41.1 N²"
