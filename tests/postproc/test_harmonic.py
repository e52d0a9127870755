"""Sweeps by sines, hysteresis loops, spectra of derivatives: what must hold of them."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

from entroslip import acceleration_psd, history, open_results, velocity_psd
from entroslip.figures.gallery import make_figures
from entroslip.figures.harmonic_figures import plot_frequency_response
from entroslip.figures.response_figures import joint_force, most_dissipating
from entroslip.harmonic import equivalent, linear_receptance, sweeps_of
from entroslip.results import ResultsError
from entroslip.tables import table_statistics

SINES = """\
&chain n_dof = 2 friction = 0.2 damping_ratio = 0.02 /
&excitation kind = 'sine' frequency = 1.05 1.15 1.2 1.22 1.25 1.3 amplitude = 0.01 3.0 /
&integration method = 'event' dt = 0.01 n_steps = 12000 /
"""
RANDOM_SINES = """\
&process correlation_length = 1.0 order = 1 mean = 0.2 std = 0.067 /
&chain n_dof = 2 damping_ratio = 0.02 /
&excitation kind = 'sine' frequency = 1.1 1.2 amplitude = 3.0 /
&integration method = 'event' dt = 0.01 n_steps = 6000 /
&campaign n_samples = 25 deterministic = .false. /
"""
HISTORY = """\
&chain n_dof = 3 friction = 0.1 /
&excitation variance = 20 /
&integration method = 'event' n_steps = 6000 /
&output quantities = 'slip', 'spectrum', 'history', 'transitions' segment_length = 1024 /
"""


@pytest.fixture(scope="module")
def sines(results_of_scene):
    return open_results(results_of_scene(SINES))


@pytest.fixture(scope="module")
def replayed(results_of_scene):
    return open_results(results_of_scene(HISTORY))


def test_a_moving_ground_is_named_with_its_units(results_of_scene, tmp_path):
    """Amplitudes are accelerations, and no mass is forced."""
    results = open_results(results_of_scene(RANDOM_SINES.replace("kind", "base = .true. kind")))
    sweep = sweeps_of(results)[0]
    assert sweep.level == results.cases[0].level == "3 m/s²"
    assert sweep.receptance.attrs["units"] == "s²"
    chain = next(figure for figure in make_figures([results]) if figure.name == "fig_07")
    assert "the ground moves" in chain.caption
    assert chain.save(tmp_path).exists()
    _, axes = plt.subplots()
    plot_frequency_response(axes, [sweep], 1, results)
    assert axes.get_ylabel() == "|x| / a of mass 1 [s²]"
    (response,) = (f for f in make_figures([results]) if f.name == "frequency_response_p001")
    assert "acceleration a of the ground" in response.caption


def test_tables_have_amplitudes_and_how_many_samples_are_steady(results_of_scene):
    results = open_results(results_of_scene(RANDOM_SINES))
    case = results.random[0]
    table = table_statistics(case)
    place = table.header.index("mean amplitude of the sine's frequency [m]")
    found = [float(row[place].split("(")[0]) for row in table.rows]
    assert found == pytest.approx(case.data["harmonic_amplitude_mean"].values, rel=1e-3)
    steady = int(case.data["steady"].values.sum())
    assert f"{steady} of 25 samples are steady" in table.note


def test_a_stuck_structure_is_its_linear_self(sines):
    """The chord of a sine of 80 steps takes (2 pi/80)^2/12 = 5e-4 of it."""
    small, large = sweeps_of(sines)
    assert (small.amplitude, large.amplitude) == (0.01, 3.0)
    assert small.n_unsteady == 0
    exact = linear_receptance(sines, small.frequency, is_stuck=True)
    np.testing.assert_allclose(small.receptance.values[:, 0], exact, rtol=2e-3)


def test_the_equivalent_mode_of_a_stuck_structure_is_its_own(sines):
    """Stiffness and damping of the first mode: between frequencies the response is taken linear."""
    mode = equivalent(sines, sweeps_of(sines)[0])
    np.testing.assert_allclose(mode.stiffness, 1.0, atol=0.01)
    np.testing.assert_allclose(mode.damping, 0.02, rtol=0.1)


def test_slip_leaves_no_resonance_or_a_softer_damped_one(sines):
    mode = equivalent(sines, sweeps_of(sines)[1])
    assert np.isnan(mode.frequency).all() or (mode.stiffness < 1.0).all()


def test_sweeps_are_drawn(sines, tmp_path):
    names = [figure.name for figure in make_figures([sines])]
    assert "frequency_response_none" in names
    assert "equivalent_none" in names
    assert not [name for name in names if name.startswith(("sweep", "fig_08"))]
    for figure in make_figures([sines]):
        figure.save(tmp_path)


def test_frequency_responses_are_the_best_estimates(results_of_scene):
    """Their mean is not that of the samples, but within its error; percentiles enclose it."""
    sweep = sweeps_of(open_results(results_of_scene(RANDOM_SINES)))[0]
    mean, low, high = sweep.outer(2)
    best = [case.data["harmonic_amplitude_mean"].values[1] / 3.0 for case in sweep.cases]
    np.testing.assert_array_equal(mean, best)
    size = np.abs(sweep.receptance.isel(dof=1).values)
    assert (mean != size.mean(axis=1)).any()
    assert (np.abs(mean - size.mean(axis=1)) < size.std(axis=1)).all()
    assert ((low < mean) & (mean < high)).all()


def test_loops_enclose_the_work_of_the_joint(replayed):
    """Along w.x the force does the joint's dissipation and loads its spring."""
    case = replayed.cases[0]
    for joint in (1, 2, 3):
        _, place, force = joint_force(case, replayed.structure, joint, finer=8)
        work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(place))
        stiffness = replayed.structure["joint_stiffness"].values[joint - 1]
        stored = 0.5 * force[-1] ** 2 / stiffness
        dissipation = case.data["dissipation"].values[0, joint - 1]
        assert work == pytest.approx(dissipation + stored, rel=1e-3)


def test_histories_are_of_the_dofs_that_are_kept(results_of_scene):
    """So are the loops: of joints between these dofs."""
    path = results_of_scene(HISTORY.replace("&output", "&output dofs = 1, 3"))
    results = open_results(path)
    case = results.cases[0]
    table = history(case)
    assert table["dof"].values.tolist() == [1, 3]
    assert np.isfinite(table["displacement"].values).all()
    assert most_dissipating(case, results.structure) == [1, 3]
    _, place, force = joint_force(case, results.structure, 3)
    assert np.isfinite([place, force]).all()


def test_histories_have_time(replayed, sines, tmp_path):
    table = history(replayed.cases[0])
    assert table["time"].values[-1] == pytest.approx(6000 * 0.00843)
    table.to_dataframe().to_csv(tmp_path / "h.csv")
    assert (tmp_path / "h.csv").read_text().startswith("time,dof,")
    with pytest.raises(ResultsError, match="replay the sample"):
        history(sines.cases[0])
    assert "hysteresis_c001" in [figure.name for figure in make_figures([replayed])]


def test_derivatives_have_the_powers_of_frequency(replayed):
    case = replayed.cases[0]
    omega = 2 * np.pi * case.data["frequency"]
    np.testing.assert_allclose(velocity_psd(case), case.data["psd"] * omega**2)
    np.testing.assert_allclose(acceleration_psd(case), case.data["psd"] * omega**4)
    assert velocity_psd(case).attrs["units"] == "m^2/s^2/Hz"
