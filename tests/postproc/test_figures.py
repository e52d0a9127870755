"""Contents of figures: no curve left out, units and errors named, nothing that misleads."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

from entroslip import joints, tradeoff
from entroslip.figures import looks, process_figures, study_figures, style
from entroslip.figures.figure import Figure
from entroslip.figures.gallery import make_figures
from entroslip.paper.printed import AXES
from entroslip.process_tables import table_processes
from entroslip.results import Results
from entroslip.tables import make_tables
from tests.postproc.synthetic import (
    FREQUENCY,
    case_of,
    certain,
    friction_study,
    process,
    results_of,
)


@pytest.fixture
def axes():
    picture, axes = plt.subplots()
    yield axes
    plt.close(picture)


def drawn(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def figures_of(*processes):
    named = {f"p{i + 1:03d}": p for i, p in enumerate(processes)}
    results = Results(path=None, attrs={"title": "x"}, processes=named, structure=None, cases=[])
    return {figure.name: figure for figure in make_figures([results])}


def test_zeros_and_signs_of_an_autocovariance_are_named(axes):
    curve = 0.5 ** np.arange(31)
    curve[[1, 2]], curve[4] = 0.0, -curve[4]
    process_figures.plot_autocovariances(axes, [process(3.0, 6, curve), process(3.0, 8)])
    assert drawn(axes) == ["6 (0 at lags 1, 2)", "8", "negative"]


def test_lags_that_the_direct_method_leaves_free_are_pale(axes):
    process_figures.plot_autocovariances(axes, [process(1.0, 4)])
    pale = [line for line in axes.lines if line.get_alpha() and line.get_alpha() < 0.5]
    assert [list(line.get_xdata()) for line in pale] == [list(range(4, 21))]


def test_captions_of_covariances_are_measured():
    """And orders that only one of the lengths has are left out."""
    family = [process(length, order) for length in (0.3, 1.0) for order in (2, 4)]
    found = figures_of(*family, process(1.0, 12))
    caption = found["fig_01a_1"].caption
    assert "goes from 0.5 at m_max 2 to 0.5 at m_max 4, where lag 1 has 0.5 and lag 4 0.0625" in (
        caption
    )
    assert "constant in the lag" in caption


@pytest.mark.parametrize(
    ("orders", "shown"),
    [
        ((1, 2, 3, 4, 5, 6, 7, 8, 10), ["2", "4", "6", "8", "10"]),
        (range(1, 19, 2), ["1", "3", "5", "7", "11", "13", "15", "17"]),
    ],
    ids=["most even", "all odd"],
)
def test_of_many_orders_some_are_drawn_and_the_caption_is_of_these(axes, orders, shown):
    figure = figures_of(*(process(0.3, order) for order in orders))["fig_01a"]
    figure.panels[0](axes)
    assert drawn(axes) == shown
    assert f"at m_max {shown[0]} to 0.5 at m_max {shown[-1]}," in figure.caption


def test_entropies_of_several_stds_are_drawn_at_one(axes):
    """Curves of the smaller std lay far below the line of white noise of the larger."""
    smaller = process(0.3, 2, method="autoregressive", correlation="L1", std=0.1)
    smaller["entropy"] -= np.log(10.0)
    smaller["entropy_bound"] -= np.log(10.0)
    process_figures.plot_entropies(axes, [process(0.3, 2, method="autoregressive"), smaller])
    assert [line.get_ydata()[0] for line in axes.lines] == pytest.approx([1.4189, 1.3, 1.3])
    assert drawn(axes)[0] == "$S_{max}$, Eq. 42, std 1"


def test_processes_of_both_lengths_have_a_figure_of_their_own(axes):
    """Figs. 3 and 4 have no curve for them: drawing these failed."""
    of_both = {"method": "autoregressive", "correlation": "both", "second_length": 2.0}
    found = figures_of(*(process(1.0, order, **of_both) for order in (6, 8)))
    assert list(found) == ["both_lengths"]
    found["both_lengths"].panels[0](axes)
    assert drawn(axes) == ["order 6", "order 8"]


def test_a_range_of_the_other_length_is_named(axes):
    bounds = {"correlation": "L1", "bound_l0": 0.3, "upper_bound": 0.5}
    process_figures.plot_chosen_orders(axes, [process(0.7, 3, method="autoregressive", **bounds)])
    assert drawn(axes) == ["$L_1$ = 0.7, 0.3 ≤ $L_0$ ≤ 0.5: order 3"]


def test_captions_of_other_processes_are_whole_sentences():
    """Only half of what the paper says of L0 = 0.3 was left out, and 0.5 went to 0.5."""
    found = figures_of(*(process(0.7, order, method="autoregressive") for order in (1, 2)))
    assert "order 6" not in found["fig_04"].outside_the_paper().caption
    caption = figures_of(process(0.7, 1))["fig_01a"].caption
    assert caption.startswith("The largest value beyond lag 0 is 0.5 at m_max 1, where lag 1 has")


def test_chosen_orders_are_drawn_on_a_logarithmic_axis(axes):
    lengths = [process(1.0, 4, method="autoregressive", correlation=name) for name in ("L0", "L1")]
    process_figures.plot_chosen_orders(axes, lengths)
    assert axes.get_yscale() == "log"
    assert [line.get_markerfacecolor() for line in axes.lines][1] == "w"


def test_positive_processes_of_every_length_are_drawn():
    """Each beside the free one of its length; the marks of two means stand one in the other."""
    family = [process(length, 10, method="autoregressive") for length in (0.3, 1.0, 3.0)]
    family += [
        process(length, 10, method="autoregressive", positive=1, mean=mean)
        for length in (0.3, 1.0, 3.0) for mean in (2.0, 3.0)
    ]  # fmt: skip
    others = [
        process(1.0, order, method=method, positive=positive)
        for order, method in ((5, "autoregressive"), (4, "direct")) for positive in (0, 1)
    ]  # fmt: skip
    found = figures_of(*family, *others)
    names = {name for name in found if name.startswith("fig_06")}
    assert names == {"fig_06", "fig_06_0.3", "fig_06_1", "fig_06_1_5", "fig_06_direct_1_4"}
    assert "L0 = 3, M = 10" in found["fig_06"].title
    picture, axes = plt.subplots()
    process_figures.plot_positive(axes, [family[0], *family[3:5]])
    sizes = [line.get_markersize() for line in axes.lines[1:]]
    assert sizes[0] > 1.5 * sizes[1]
    plt.close(picture)


def test_processes_of_several_stds_are_told_apart(axes):
    """Their entropies went up and down along one curve, and their names were the same."""
    family = [
        process(0.7, order, method="autoregressive", std=std) for std in (0.3, 0.5)
        for order in (1, 2)
    ]  # fmt: skip
    positive = [
        process(0.7, 1, method="autoregressive", positive=1, mean=1.0, std=std)
        for std in (0.3, 0.5)
    ]
    found = figures_of(*family, *positive)
    assert "Other means and stds change the scale alone." in found["fig_02a"].caption
    found["fig_03"].panels[0](axes)
    assert [list(line.get_xdata()) for line in axes.lines[1:]] == [[1, 2]]
    assert "at mean 1, std 0.5 (sequential)" in found["fig_06"].caption
    picture, axes = plt.subplots()
    process_figures.plot_positive(axes, [family[0], *positive])
    assert drawn(axes)[1:] == [f"positive, mean 1, std {std}, sequential" for std in (0.3, 0.5)]
    plt.close(picture)


def test_orders_of_a_tradeoff_are_named_by_their_processes(axes):
    data = xr.Dataset({
        name: ("variant", values) for name, values in (
            ("is_of_fit", [0, 0]), ("is_reference", [0, 0]), ("process", [2, 2]), ("order", [1, 2]),
            ("slip_mean", [0.2, 0.1]), ("slip_mean_error", [0.1, 0.1]), ("is_own", [0, 1]),
        )
    })  # fmt: skip
    tradeoff.plot_change_over_order(axes, data, "slip_mean", {2: "$L_0$ = 1, std 0.1"})
    assert drawn(axes) == ["$L_0$ = 1, std 0.1"]


def test_bands_hold_the_scatter_of_the_record():
    """Monte Carlo alone is less than what one record leaves in a bin."""
    case = case_of("c001", "p001", np.full((2, 1), 0.3), np.ones((2, FREQUENCY.size, 1)))
    flat = np.ones((2, FREQUENCY.size, 1))
    for name, factor in (("", 1.0), ("_low", np.exp(-0.3)), ("_high", np.exp(0.3))):
        case.data[f"psd_percentiles{name}"] = (("percentile", "frequency", "dof"), factor * flat)
    case.data.attrs["psd_time_error"] = 0.4 / 1.959964
    low, high = study_figures.percentile_interval(case, dof=1, outer=0)
    np.testing.assert_allclose(low, np.exp(-0.5), rtol=1e-6)
    np.testing.assert_allclose(high, np.exp(0.5), rtol=1e-6)


def test_a_scatter_names_lengths_and_oscillators(axes):
    case = case_of("c001", "p001", np.full((2, 3), 0.3), np.ones((2, FREQUENCY.size, 3)))
    for name in ("slip_mean", "slip_std", "slip_mean_error", "slip_std_error"):
        case.data[name] = ("joint", np.array([0.1, 0.2, 0.3]))
    study_figures.plot_slip_scatter(axes, [case])
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3"]
    assert drawn(axes)[0].startswith("$L_0$ = ")
    assert axes.get_xlabel().endswith("[%]")
    assert axes.get_ylabel().endswith("[%]")
    assert AXES["fig_09"][1] == 80.0


def test_marks_that_touch_have_their_numbers_side_by_side(axes):
    """Joints 1 and 2 were read as joint 12."""
    case = case_of("c001", "p001", np.full((2, 3), 0.3), np.ones((2, FREQUENCY.size, 3)))
    for name in ("slip_mean", "slip_std", "slip_mean_error", "slip_std_error"):
        case.data[name] = ("joint", np.array([0.1, 0.101, 0.3]))
    study_figures.plot_slip_scatter(axes, [case])
    assert [text.get_text() for text in axes.texts] == ["1, 2", "3"]


def test_every_joint_of_a_chain_of_seven_has_its_number(axes):
    """One of them had none, and the caption said that each had."""
    case = case_of("c001", "p001", np.full((2, 7), 0.3), np.ones((2, FREQUENCY.size, 7)))
    for name in ("slip_mean", "slip_std", "slip_mean_error", "slip_std_error"):
        case.data[name] = ("joint", np.linspace(0.1, 0.7, 7))
    study_figures.plot_slip_scatter(axes, [case])
    assert [text.get_text() for text in axes.texts] == list("1234567")
    assert looks.marks_of([case]) == "Each joint has a mark with its number"
    long = case_of("c001", "p001", np.full((2, 70), 0.3), np.ones((2, FREQUENCY.size, 70)))
    assert looks.marks_of([long]) == "Each joint has a mark, some with their number"


@pytest.mark.parametrize("n_joints", [3, 70])
def test_bars_end_at_one_and_are_faint_where_they_are_many(axes, n_joints):
    """Intervals of a time in slip reached 108 %; those of 200 joints hid all marks."""
    psd = np.ones((2, FREQUENCY.size, n_joints))
    case = case_of("c001", "p001", np.full((2, n_joints), 0.9), psd)
    case.data["slip_mean_time_error"] = ("joint", np.full(n_joints, 0.2))
    study_figures.plot_slip_scatter(axes, [case])
    bars = axes.containers[0].lines[2][0]
    assert max(segment[:, 0].max() for segment in bars.get_segments()) == 100.0
    assert (bars.get_colors()[0][3] < 1.0) == (n_joints > 60)
    axes.clear()
    study_figures.plot_along(axes, [case], joints.QUANTITIES[0])
    assert axes.containers[0].lines[2][0].get_segments()[0][1, 1] == 100.0


def test_a_ratio_of_bands_that_is_not_known_leaves_the_axis_to_the_others(axes):
    """An interval up to 1e14 pressed all marks into one line."""
    case = case_of("c001", "p001", np.full((2, 3), 0.3), np.ones((2, FREQUENCY.size, 3)))
    case.data["band_ratio"] = ("dof", [3.0, 20.0, np.nan])
    case.data["band_ratio_high"] = ("dof", [4.0, 1.0e14, np.nan])
    study_figures.plot_band_ratio(axes, [case])
    assert axes.get_ylim()[1] == 200.0


def test_the_first_dofs_of_many_differ_in_colour(axes):
    """Kept dofs 1 to 3 of 17 were three dark violets."""
    case = case_of("c001", "none", np.full((1, 3), 0.3), np.ones((1, FREQUENCY.size, 17)))
    case.data.attrs["kept_dofs"] = [1, 2, 3]
    study_figures.plot_spectra(axes, case, results_of([case]))
    colours = [line.get_color() for line in axes.lines[:3]]
    assert colours == [style.of_dof(dof, 5)["color"] for dof in (1, 2, 3)]


@pytest.mark.parametrize(("kept", "shown"), [([2], "2 2"), ([2, 4], "2 2 4")])
def test_bands_are_those_of_masses_with_spectra(kept, shown):
    """The paper's first and last mass were drawn without spectra: the drawing failed."""
    study = friction_study(n_samples=20)
    for case in study.cases:
        case.data.attrs["kept_dofs"] = kept
        if case.n_samples > 1:
            case.data["psd_mean"] = case.data["psd"].mean("sample")
    titles = [figure.title for figure in make_figures([study]) if figure.name.startswith("fig_10")]
    assert " ".join(re.search(r"(?:mass|dof) (\d)", title)[1] for title in titles) == shown


@pytest.mark.parametrize("forced", [1, 2, 11, 15, 19, 20])
def test_the_forced_dof_is_among_those_drawn(axes, forced):
    """It was left out with others if there were more dofs than can be distinguished."""
    psd = np.ones((1, FREQUENCY.size, 20))
    case = case_of("c001", "none", np.full((1, 20), 0.3), psd)
    structure = results_of([]).structure.drop_vars("load")
    structure["load"] = (("force", "dof"), np.eye(20)[[forced - 1]])
    study_figures.plot_spectra(axes, case, Results(None, {}, {}, structure, [case]))
    dofs = [int(name.split()[1]) for name in drawn(axes) if name.startswith("dof")]
    assert forced in dofs
    assert (dofs[0], dofs[-1], len(dofs)) == (1, 20, 7)
    assert dofs == sorted(set(dofs))


def drawn_with(*asked):
    """A case of two samples for each process asked for."""
    cases = [
        replace(
            case_of(f"c{i}", f"p{i}", np.full((2, 3), 0.3), np.ones((2, FREQUENCY.size, 3)),
                    std=0.1, correlation_length=request["correlation_length"]),
            asked=request,
        )
        for i, request in enumerate(asked)
    ]  # fmt: skip
    for case in cases:
        case.data["psd_mean"] = case.data["psd"].mean("sample")
    return cases


def test_both_lengths_are_named(axes):
    """The legend had the first two letters of 'both' as symbol and index."""
    both = {"correlation": "both", "correlation_length": 1.0, "second_length": 1.5}
    (case,) = cases = drawn_with(both)
    study_figures.plot_slip_scatter(axes, cases)
    assert drawn(axes)[0].startswith("$L_0$ = 1, $L_1$ = 1.5, ")
    assert case.friction == "std 0.1, L0 = 1, L1 = 1.5"


def test_a_chosen_order_is_in_the_table_of_processes():
    """It was AR(0), as the scene asks; without a solution there is none."""
    chosen = process(1.0, 0, correlation="both", second_length=1.5, order_found=7)
    open_ = process(1.0, 0, status="infeasible")
    results = Results(None, {}, {"p001": chosen, "p002": open_}, None, [])
    table = table_processes(results)
    assert [row[2] for row in table.rows] == ["direct(7)", "direct(chosen)"]
    assert table.rows[0][1].startswith("L0 = 1, L1 = 1.5, mean")


def test_positive_processes_are_named_by_what_they_are(axes):
    """A chosen order was 0, and both lengths one."""
    both = {"correlation": "both", "correlation_length": 1.0, "second_length": 1.5}
    drawn_ = [process(1.0, 5), process(1.0, 0, **both), process(1.0, 5, **both)]
    drawn_[1] = drawn_[1].drop_dims("order").assign_attrs(order_found=3)  # given by G
    process_figures.plot_each(axes, drawn_)
    assert drawn(axes) == [
        "$L_0$ = 1, order 5", "$L_0$ = 1, $L_1$ = 1.5, order 3", "$L_0$ = 1, $L_1$ = 1.5, order 5",
    ]  # fmt: skip


def test_processes_of_one_length_are_told_apart(axes):
    """Orders of one length had one colour, one mark and one name."""
    asked = [
        {"correlation": "L0", "correlation_length": 1.0, "order_found": order} for order in (2, 5)
    ]
    cases = drawn_with(*asked)
    results = results_of(cases)
    study_figures.plot_band(axes, cases, 1, results)
    assert drawn(axes)[:2] == ["$L_0$ = 1, order 2", "$L_0$ = 1, order 5"]
    assert len({line.get_color() for line in axes.lines[:6]}) == 2
    axes.clear()
    study_figures.plot_slip_scatter(axes, cases)
    assert [name.split(", ")[1] for name in drawn(axes)] == ["order 2", "order 5"]
    assert len({container.lines[0].get_color() for container in axes.containers}) == 2


def test_every_level_of_the_force_has_marks_of_its_own(axes):
    """Open to full, and larger with it where there are more than two; the outline is drawn."""
    levels = (1.0, 5.0, 7.0, 30.0)
    values = np.full((2, 3), 0.3)
    cases = [
        case_of(f"c00{i}", "p001", values, np.ones((2, FREQUENCY.size, 3)), variance=level)
        for i, level in enumerate(levels, 1)
    ]
    for case in cases:
        for name in ("slip_mean", "slip_std", "slip_mean_error", "slip_std_error"):
            case.data[name] = ("joint", np.array([0.1, 0.2, 0.3]))
    study_figures.plot_slip_scatter(axes, cases)
    marks = [container.lines[0] for container in axes.containers]
    fillings = [mark.get_markerfacecolor()[1] for mark in marks]
    sizes = [mark.get_markersize() for mark in marks]
    assert fillings[0] == 0.0
    assert fillings[-1] == 1.0
    assert np.diff(fillings).min() > 0.2
    assert np.diff(sizes).min() > 1.0
    assert {mark.get_markeredgecolor() for mark in marks} == {marks[0].get_color()}
    assert [name.split(", ")[1] for name in drawn(axes)] == [f"variance {v:g} N²" for v in levels]
    told = [looks.marks_of(cases[:n]) for n in (1, 2, 4)]
    marks = "Each joint has a mark with its number"
    assert told == [
        marks, f"{marks}, open at the lower and full at the higher excitation",
        f"{marks}, fuller and larger with the excitation",
    ]  # fmt: skip


def test_a_figure_outside_the_paper_says_nothing_of_it():
    caption = "It falls to 3 (the paper: constant in the lag). The paper finds 2. To look for: a."
    figure = Figure("fig_09a", "Fig. 9a. Scatter", caption, "Processes", (), ("1a",))
    own = figure.outside_the_paper()
    assert (own.title, own.statements) == ("Scatter", ())
    assert own.caption == "It falls to 3. To look for: a."


def test_of_several_files_titles_say_whose_they_are():
    """The first file's had none, nor had those of a figure that one file alone has."""
    case, structure = certain(1.0), results_of([]).structure
    structure["frequencies_stuck"] = 2.0 * structure["frequencies_stuck"]  # none of the paper
    own, other = (Results(Path(f"{n}.h5"), {"title": n}, {}, structure, [case]) for n in "ab")
    titles = [figure.title for figure in make_figures([own, other])]
    assert [title[-6:] for title in titles] == ["(a.h5)", "(b.h5)"]
    assert not make_figures([own])[0].title.endswith("h5)")
    assert make_tables([own, other])[0].title.endswith("(a.h5)")


def test_a_single_percentile_is_drawn_and_named_once(axes):
    """Its curve was the lower and the upper end of the band."""
    (case,) = drawn_with({"correlation": "L0", "correlation_length": 1.0})
    one = replace(case, data=case.data.isel(percentile=[0]))
    study_figures.plot_band(axes, [one], 1, results_of([one]))
    assert [text.get_text() for text in axes.texts] == ["5 %", "mean"]
    curves = [line for line in axes.lines if len(line.get_xdata()) == FREQUENCY.size]
    assert len(curves) == 2
    assert len(axes.collections) == 1
