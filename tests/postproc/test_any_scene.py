"""A results file of any scene is drawable, whatever it leaves out."""

from __future__ import annotations

import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.io import mmwrite

from entroslip import open_results
from entroslip.__main__ import main
from entroslip.figures.gallery import make_figures
from entroslip.figures.response_figures import find_episode, joint_force
from tests.conftest import INPUT_SCENES, shortened

PROCESS = "&process correlation_length = 0.3 order = 2 mean = 0.2 std = 0.067 /\n"
SHORT = "&integration method = 'event' n_steps = 2000 /\n"
FORCE = "&excitation variance = 41.1 /\n"
CAMPAIGN = "&campaign n_samples = 3 /\n"

ALONG = {f"along_{name}" for name in ("slip", "power", "distance", "displacement")}

SCENES = {
    "some processes refused": (
        "&process correlation_length = 0.0, 0.3 order = 1 mean = 1.0 std = 0.5, 0.9, 1.2"
        " sampler = 'exact' /\n",
        {"positive"},
    ),
    "realizations": (
        "&process correlation_length = 1.0 order = 3 mean = 1.0 std = 0.2 n_realizations = 2 /\n",
        {"positive", "realizations_p001"},
    ),
    "realizations of many": (
        "&process correlation_length = 0.1, 0.2, 0.3, 0.4, 0.5 order = 1, 2 pairing = 'product'"
        " mean = 1.0 std = 0.2 positive = .false. n_realizations = 2 /\n",
        {"fig_02a", "fig_02a_0.2", "fig_02a_0.3", "fig_02a_0.4", "fig_02a_0.5", "fig_03", "fig_04",
         "realizations_p002", "realizations_p004", "realizations_p008", "realizations_p010"},
    ),
    "a realization of one point": (
        "&process correlation_length = 0.0 mean = 1.0 std = 0.2 n_points = 1"
        " n_realizations = 2 /\n",
        {"realizations_p001"},
    ),
    "one sample": (
        PROCESS + "&chain /\n" + FORCE + SHORT + "&campaign n_samples = 1 /\n"
        "&output segment_length = 256 /\n",
        {"fig_07", "spectra_c001"},
    ),
    "no spectra, no springs": (
        PROCESS + "&chain coupling_stiffness = 0.0 /\n" + FORCE + SHORT + CAMPAIGN
        + "&output quantities = 'slip' /\n",
        {"fig_09a"} | ALONG - {"along_displacement"},
    ),
    "energy alone": (
        "&chain friction = 0.2 /\n" + FORCE + SHORT + "&output quantities = 'energy' /\n",
        {"fig_07"},
    ),
    "histories": (
        "&chain friction = 0.2 /\n" + FORCE + SHORT + "&output quantities = 'history' /\n",
        {"fig_07", "history_c001"},
    ),
    "one oscillator": (
        PROCESS + "&chain n_dof = 1 coupling_stiffness = 0.0 /\n" + FORCE + SHORT + CAMPAIGN
        + "&output segment_length = 256 /\n",
        {"fig_07", "fig_09a", "fig_10a", "fig_11a"},
    ),
    "sines of one frequency": (
        PROCESS + "&chain n_dof = 3 /\n&excitation kind = 'sine' frequency = 1.0"
        " amplitude = 2.0, 5.0, 10.0, 20.0, 40.0 /\n"
        "&integration method = 'event' n_steps = 4000 /\n"
        "&campaign n_samples = 3 deterministic = .true. /\n",
        {"fig_07", "fig_09a", "sweep"} | ALONG - {"along_displacement"},
    ),
    "some masses kept, by regression": (
        PROCESS + "&chain n_dof = 9 /\n" + FORCE + SHORT
        + "&campaign n_samples = 25 deterministic = .true. /\n"
        "&output quantities = 'slip', 'spectrum', 'history', 'transitions'"
        " segment_length = 256 dofs = 3 /\n",
        {"fig_07", "fig_08a", "fig_09a", "fig_10a", "fig_11a"}
        | {f"{kind}_{case}" for kind in ("history", "hysteresis") for case in ("c001", "c002")}
        | ALONG,
    ),
    "one percentile": (
        PROCESS + "&chain /\n" + FORCE + SHORT + CAMPAIGN
        + "&output segment_length = 256 percentiles = 50 /\n",
        {"fig_07", "fig_09a", "fig_10a", "fig_10b"},
    ),
    "200 oscillators": (
        "&chain n_dof = 200 friction = 0.2 /\n" + FORCE
        + "&integration method = 'newmark' n_steps = 400 /\n&output segment_length = 64 /\n",
        {"fig_07", "fig_08a"},
    ),
    "laws of reference": (
        "&process correlation_length = 0.0, 1e12 mean = 0.2 std = 0.067 /\n&chain /\n"
        + FORCE + SHORT + CAMPAIGN + "&output quantities = 'slip' /\n",
        {"fig_07", "fig_09a"},
    ),
    "nothing moves": (
        "&chain friction = 1.0e8 /\n&excitation variance = 1.0e-12 /\n" + SHORT
        + "&output segment_length = 256 /\n",
        {"fig_07", "fig_08a"},
    ),
}  # fmt: skip


@pytest.fixture(autouse=True)
def quick_drawing(monkeypatch):
    """Coarse PNG and no PDF: how they are saved is another test's."""
    save = plt.Figure.savefig

    def savefig(self, file, format, **_):
        if format == "png":
            save(self, file, format=format, dpi=30)

    monkeypatch.setattr(plt.Figure, "savefig", savefig)


@pytest.mark.filterwarnings("error::RuntimeWarning", "error::UserWarning")
@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_is_drawn(results_of_scene, tmp_path, scene):
    text, wanted = SCENES[scene]
    assert main([str(results_of_scene(text)), "--out", str(tmp_path)]) == 0
    assert {path.stem for path in tmp_path.glob("*.png")} == wanted
    report = (tmp_path / "report.html").read_text()
    assert ("Pale marks" in report) == ("by regression" in scene)


@pytest.mark.filterwarnings("error::RuntimeWarning", "error::UserWarning")
@pytest.mark.parametrize(
    "scene",
    # but for method and number of samples, these two are paper.nml; they run in test_input_scenes
    [scene for scene in INPUT_SCENES if scene.stem not in ("paper_claims", "paper_event")],
    ids=lambda scene: scene.stem,
)
def test_a_scene_of_input_is_drawn(results_of_scene, tmp_path, scene):
    """With the paths of its files in full, for the scene is copied."""
    paths = r"(?m)^( *(?:file|mass_matrix|stiffness_matrix|joints) *= *')(?=.*\w)"
    text = re.sub(paths, rf"\g<1>{scene.parent}/", scene.read_text())
    path = results_of_scene(text, "run", *shortened(scene))
    assert main([str(path), "--out", str(tmp_path)]) == 0
    assert any(tmp_path.glob("*.png"))
    if scene.stem == "ring":  # of so many modes no line marks them
        assert "Vertical lines" not in (tmp_path / "report.html").read_text()


@pytest.mark.filterwarnings("error::RuntimeWarning", "error::UserWarning")
def test_a_structure_at_rest_is_drawn(results_of_scene, tmp_path):
    """Under a force of zeros no spectrum has power, and no setting an error."""
    (tmp_path / "force.txt").write_text("0\n" * 1001)
    text = PROCESS + "&chain n_dof = 2 /\n" + CAMPAIGN + "&output segment_length = 256 /\n"
    text += f"&excitation kind = 'file' file = '{tmp_path}/force.txt' /\n"
    text += "&integration method = 'event' n_steps = 0 /\n"
    for command in ("run", "tradeoff"):
        out = tmp_path / command
        assert main([str(results_of_scene(text, command)), "--out", str(out)]) == 0
        assert (out / "report.html").exists()
    assert not (tmp_path / "run" / "along_spectra.png").exists()
    assert not (tmp_path / "tradeoff" / "tradeoff.png").exists()


@pytest.mark.filterwarnings("error::RuntimeWarning", "error::UserWarning")
def test_given_values_are_drawn_beside_a_process(results_of_scene, tmp_path):
    """They have neither length nor order nor sampler that figures or tables could name."""
    np.savetxt(tmp_path / "friction.txt", np.linspace(0.1, 0.3, 9).reshape(3, 3))
    text = f"&process values = '{tmp_path}/friction.txt' /\n" + PROCESS + "&chain n_dof = 3 /\n"
    text += FORCE + SHORT + CAMPAIGN + "&output segment_length = 256 /\n"
    for command in ("run", "tradeoff"):
        out = tmp_path / command
        assert main([str(results_of_scene(text, command)), "--out", str(out)]) == 0
    assert "given values" in (tmp_path / "run" / "report.html").read_text()


def test_lines_along_the_structure_are_every_process_at_every_level(results_of_scene):
    """Six of twelve, drawn as they came, were one level of some processes, the other of others."""
    text = (
        "&process correlation_length = 0.0, 0.3, 1.0 order = 2 mean = 0.2 std = 0.04, 0.067 /\n"
        "&chain n_dof = 3 /\n&excitation variance = 4.0, 41.1 /\n" + SHORT + CAMPAIGN
        + "&output quantities = 'slip' /\n"
    )  # fmt: skip
    figures = {
        figure.name: figure for figure in make_figures([open_results(results_of_scene(text))])
    }
    drawn = figures["along_slip"].panels[0].keywords["cases"]
    assert {case.std for case in drawn} == {0.067}
    lines = {(case.correlation_length, case.variance) for case in drawn}
    assert lines == {(length, level) for length in (0.0, 0.3, 1.0) for level in (4.0, 41.1)}
    assert figures["along_slip"].caption.endswith(" 6 of 12 cases.")


def test_a_joint_between_two_dofs_has_no_ratio_of_bands(results_of_scene, tmp_path):
    """Fig. 11 set the band of dof i over the slip of joint i, wherever that joint is."""
    text = structure_of(np.array([[50.0, -25.0], [-25.0, 25.0]]), ("2 0", "2 1"), tmp_path)
    assert main([str(results_of_scene(text)), "--out", str(tmp_path)]) == 0
    drawn = {path.stem for path in tmp_path.glob("fig_*.png")}
    assert drawn == {"fig_09a", "fig_10a"}


def test_a_ring_is_not_drawn_as_a_row(results_of_scene, tmp_path):
    """Its joints hold dof by dof to the ground, as those of the paper's row of masses do."""
    stiffness = 60.0 * np.eye(3) - 25.0 * (np.ones((3, 3)) - np.eye(3))
    results = open_results(
        results_of_scene(structure_of(stiffness, ("1 0", "2 0", "3 0"), tmp_path))
    )
    assert results.is_chain
    assert "fig_07" not in [figure.name for figure in make_figures([results])]


def structure_of(stiffness, joints, folder):
    """A scene with unit masses and joints between these dofs, whose files are in the folder."""
    for name, matrix in (("M", np.eye(len(stiffness))), ("K", stiffness)):
        mmwrite(folder / f"{name}.mtx", matrix)
    lines = [f"{joint} 50 10 0.2\n" for joint in joints]
    (folder / "joints.txt").write_text("".join(lines))
    text = PROCESS + FORCE + SHORT + CAMPAIGN + "&output segment_length = 256 /\n"
    text += f"&structure mass_matrix = '{folder}/M.mtx' joints = '{folder}/joints.txt'"
    return f"{text} stiffness_matrix = '{folder}/K.mtx' /\n"


@pytest.fixture(scope="module")
def replayed(results_of_scene):
    text = PROCESS + "&chain /\n" + FORCE + SHORT + CAMPAIGN + "&output segment_length = 256 /\n"
    return results_of_scene(text, "replay", "--case", 1, "--sample", 2)


def test_a_replayed_sample_is_drawn(replayed, tmp_path):
    assert main([str(replayed), "--out", str(tmp_path)]) == 0
    assert "History of sample 2, at most" in (tmp_path / "report.html").read_text()
    drawn = {path.stem for path in tmp_path.glob("*.png")}
    assert drawn == {
        "fig_07", "history_c001", "hysteresis_c001", "spectra_c001", "transition_c001",
    }  # fmt: skip


def test_force_of_a_slider_keeps_its_limit(replayed):
    """It never exceeds mu N, is mu N in the slip, and is continuous where a slip starts."""
    results = open_results(replayed)
    case, chain = results.cases[0], results.structure
    episode = find_episode(case)
    for dof in range(1, case.n_dof + 1):
        limit = 10.0 * float(case.data["friction"][0, dof - 1])
        times, _, force = joint_force(case, chain, dof)
        # cubic between steps of 0.00843 s: 1e-4 of the force
        assert np.abs(force).max() < limit * (1 + 1e-3)
        first_slip = case.data["transition_time"].values[
            (case.data["transition_joint"] == dof) & (case.data["transition_kind"] != 0)
        ][0]
        before = np.searchsorted(times, first_slip) - 1
        assert abs(force[before]) > 0.7 * limit
    finer_times, _, finer = joint_force(case, chain, episode.dof, finer=4)
    times, _, force = joint_force(case, chain, episode.dof)
    np.testing.assert_allclose(finer[np.searchsorted(finer_times, times)], force, atol=1e-12)
    inside = (times > episode.start) & (times < episode.end)
    limit = 10.0 * float(case.data["friction"][0, episode.dof - 1])
    np.testing.assert_allclose(force[inside], episode.direction * limit)
