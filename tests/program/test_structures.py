"""&structure end to end: the reference cases by namelist, what an importer writes, hostile numbers.

The cases and their exact responses: tests/reference/structures. Their forces are given by files.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
from scipy.io import mmwrite

from tests.conftest import ROOT

CASES = ROOT / "tests/reference/structures"
NAMES = sorted(path.name for path in CASES.iterdir() if path.is_dir())
SLIDES = "s8_extreme_mu"  # a joint without friction: its counts are a matter of definition
SCENE = """\
&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' joints = 'joints.txt' load = 'load.txt'
   {damping} {directions} /
&excitation kind = 'file' file = 'force.txt' /
&integration method = 'event' dt = {dt} n_steps = {n_steps} tolerance = 1e-10 n_discard = 0 /
&campaign deterministic = .true. /
&output quantities = 'slip', 'spectrum', 'history', 'transitions' segment_length = 1024 /
"""
CHAIN = """\
&chain n_dof = 5 friction = 0.2 /
&excitation kind = 'file' file = 'force.txt' /
&integration method = 'event' dt = {dt} n_steps = {n_steps} tolerance = 1e-10 n_discard = 0 /
&campaign deterministic = .true. /
&output quantities = 'slip', 'spectrum', 'history', 'transitions' segment_length = 1024 /
"""


def written(folder, name):
    """Writes the files of a case and its scene; returns its reference response."""
    shutil.copytree(CASES / name, folder, dirs_exist_ok=True)
    known = json.loads((folder / "case.json").read_text())
    damping = known["damping"]
    kinds = {
        "given": "damping_matrix = 'C.mtx'",
        "modal": "damping_ratio = {zeta}",
        "rayleigh": "rayleigh = {alpha}, {beta}",
    }
    directions = "directions = 'W.mtx'" if (folder / "W.mtx").exists() else ""
    (folder / "scene.nml").write_text(
        SCENE.format(
            damping=kinds[damping["type"]].format(**damping), directions=directions,
            dt=known["dt"], n_steps=known["n_steps"],
        )
    )  # fmt: skip
    return known


@pytest.mark.parametrize("name", NAMES)
def test_reference_cases_are_met_by_namelist(entroslip, tmp_path, name):
    """Displacements to 1e-8 of the rms of each dof; equal transitions and slip fractions."""
    known = written(tmp_path, name)
    done = entroslip("run", "scene.nml")
    assert done.returncode == 0, done.stderr
    exact = np.loadtxt(tmp_path / "x.txt")
    counts = np.array([known["n_stick_to_slip"], known["n_slip_to_stick"]])
    with h5py.File(tmp_path / "scene.h5") as file:
        case = file["campaign/c001"]
        ours = case["displacement"][0][exact[:, 0].astype(int)]
        assert (abs(ours - exact[:, 1:]) <= 1e-8 * np.array(known["rms_x"])).all()
        is_counted = case["friction"][0] > 0.0 if name == SLIDES else slice(None)
        slip = case["slip_fraction"][0]
        assert abs(slip - known["slip_fraction"])[is_counted].max() <= 1e-7
        joints, kinds = case["transition_joint"][()], case["transition_kind"][()]
        begun = np.bincount(joints[kinds != 0] - 1, minlength=slip.size)
        ended = np.bincount(joints[kinds == 0] - 1, minlength=slip.size)
        assert (np.array([begun, ended]) == counts)[:, is_counted].all()
        stuck = file["structure/frequencies_stuck"][()]
        exact_hz = np.array(known["frequencies_stuck"]) / (2 * np.pi)
        assert abs(stuck - exact_hz).max() <= 1e-9 * exact_hz.max()


def test_matrices_of_the_chain_are_the_chain(entroslip, tmp_path):
    """Spectra, slip and histories of s1 from matrices and from &chain agree to 1e-12."""
    known = written(tmp_path, "s1_chain5")
    (tmp_path / "chain.nml").write_text(CHAIN.format(dt=known["dt"], n_steps=known["n_steps"]))
    (tmp_path / "joints.txt").write_text("".join(f"{i} 0 50 10 0.2\n" for i in range(1, 6)))
    for name in ("scene", "chain"):
        done = entroslip("run", f"{name}.nml")
        assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "scene.h5") as ours, h5py.File(tmp_path / "chain.h5") as theirs:
        for name in ("displacement", "psd", "slip_fraction", "transition_time", "dissipation"):
            one, other = (file[f"campaign/c001/{name}"][()] for file in (ours, theirs))
            assert abs(one - other).max() <= 1e-12 * abs(other).max(), name


def test_a_dense_structure_is_marched_in_modes_by_every_command(entroslip, tmp_path):
    """check, samples, an audit, a replay and a ledger, also with damping that couples modes."""
    written(tmp_path, "s6_dense8")
    scene = (tmp_path / "scene.nml").read_text()
    process = "&process correlation_length = 1.0 order = 1 mean = 0.3 std = 0.06 /\n"
    scene = process + scene.replace("deterministic = .true.", "n_samples = 4")
    scene = scene.replace("'slip', 'spectrum', 'history', 'transitions'", "'slip'")
    (tmp_path / "scene.nml").write_text(scene + "&accuracy audit = 0.5 /\n")
    said = entroslip("check", "scene.nml")
    assert said.returncode == 0, said.stderr
    assert "exact march  by modes, " in said.stdout
    assert "8 dofs, 5 joints" in said.stdout
    done = entroslip("run", "scene.nml")
    assert done.returncode == 0, done.stderr
    again = entroslip("replay", "scene.nml", "--case", "1", "--sample", "3")
    assert again.returncode == 0, again.stderr
    with (
        h5py.File(tmp_path / "scene.h5") as file,
        h5py.File(tmp_path / "scene_c001_s0003.h5") as replayed,
    ):
        ours, theirs = replayed["campaign/c001"], file["campaign/c001"]
        for name in ("slip_fraction", "slip_distance", "dissipation", "friction"):
            assert np.array_equal(ours[name][0], theirs[name][2]), name
        assert theirs["audit"].attrs["n_samples"] == 2
    kept = entroslip("run", "scene.nml", "--set", "output%quantities=energy", "--fresh")
    assert kept.returncode == 0, kept.stderr
    with h5py.File(tmp_path / "scene.h5") as file:
        assert abs(file["campaign/c001/energy_defect"][()]).max() < 1e-6
    scene = scene.replace("damping_ratio = 0.01", "rayleigh = 0.1, 1e-3")
    (tmp_path / "scene.nml").write_text(scene)
    kept = entroslip("run", "scene.nml", "--set", "output%quantities=energy", "--fresh")
    assert kept.returncode == 0, kept.stderr
    with h5py.File(tmp_path / "scene.h5") as file:
        assert abs(file["campaign/c001/energy_defect"][()]).max() < 1e-6


def test_memory_is_the_limit_of_a_structure(entroslip, tmp_path):
    """Chains and matrices that exceed the memory are refused by their size, before any work."""
    (tmp_path / "c.nml").write_text(
        "&chain n_dof = 32700 friction = 0.2 /\n&excitation variance = 1 /"
    )
    (tmp_path / "m.nml").write_text(
        "&structure mass_matrix = 'M.mtx' stiffness_matrix = 'M.mtx' joints = 'j.txt' /\n"
        "&excitation variance = 1 /\n"
    )
    (tmp_path / "M.mtx").write_text(
        "%%MatrixMarket matrix coordinate real symmetric\n32700 32700 1\n1 1 1\n"
    )
    (tmp_path / "j.txt").write_text("1 0 1 1 1\n")
    words = [
        ("c", "chain%n_dof = 32700: its", 136869),
        ("m", "M.mtx:2: 32700 32700 1: its", 68435),
    ]
    for name, place, megabytes in words:
        done = entroslip("check", f"{name}.nml")
        assert done.returncode == 2
        text = f"{place} matrices take {megabytes} MB, which the system does not give: reduce"
        assert text in done.stderr


def test_what_the_importer_writes_runs(entroslip, tmp_path):
    """A ring, a chain and a reduced beam, with the EXAMPLE values of the importer."""
    stiffness = np.diag(np.full(12, 2.0e4)) - 1.0e4 * (np.eye(12, k=1) + np.eye(12, k=-1))
    mass = np.diag(np.full(12, 4.0)) + np.eye(12, k=1) + np.eye(12, k=-1)
    np.savez(tmp_path / "rod.npz", M=mass, K=stiffness)
    makes = {
        "ring": ["ring", "--blades", "6", "--scatter", "0.05", "--joints", "both"],
        "chain": ["chain", "--masses", "4"],
        "rod": ["import", "--mass", "rod.npz:M", "--stiffness", "rod.npz:K", "--joint", "12",
                "--joint", "3,9", "--modes", "4", "--force", "6=0.5", "--force", "7"],
    }  # fmt: skip
    for name, words in makes.items():
        made = subprocess.run(
            [sys.executable, "-m", "entroslip.structure", *words, "--out", name],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        fewer = ["--set", "integration%n_steps=6000", "--set", "campaign%n_samples=3",
                 "--set", "output%segment_length=1024"]  # fmt: skip
        done = entroslip("run", f"{name}/scene.nml", *fewer, "--output", f"{name}.h5")
        assert done.returncode == 0, done.stderr
        with h5py.File(tmp_path / f"{name}.h5") as file:
            slip = file["campaign/c002/slip_fraction"][()]
            assert slip.shape[0] == 3
            assert 0.0 < slip.mean() < 1.0


UNIT = "%%MatrixMarket matrix array real symmetric\n2 2\n{}\n{}\n{}\n"


def hostile(
    entroslip, folder, joints, stiffness=(3.0, -1.0, 2.0), mass=(1.0, 0.0, 1.0), dt=0.05,
    damping="damping_ratio = 0.005",
):  # fmt: skip
    """Two dofs under a sine-like record: slip fractions, displacements, and what was said."""
    (folder / "M.mtx").write_text(UNIT.format(*mass))
    (folder / "K.mtx").write_text(UNIT.format(*stiffness))
    (folder / "joints.txt").write_text(joints)
    steps = np.arange(3001)
    np.savetxt(folder / "f.txt", 2.0 * np.sin(0.07 * steps) + np.sin(0.19 * steps))
    (folder / "h.nml").write_text(
        "&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' joints = 'joints.txt'"
        f" {damping} /\n&excitation kind = 'file' file = 'f.txt' /\n"
        f"&integration method = 'event' dt = {dt} n_steps = 3000 n_discard = 0 /\n"
        "&campaign deterministic = .true. /\n&output quantities = 'slip', 'history' /\n"
    )
    checked = entroslip("check", "h.nml")
    done = entroslip("run", "h.nml", "--fresh")
    assert (checked.returncode, done.returncode) == (0, 0), checked.stderr + done.stderr
    with h5py.File(folder / "h.h5") as file:
        case = file["campaign/c001"]
        slip, x = case["slip_fraction"][0], case["displacement"][0]
    assert np.isfinite(x).all()
    return slip, x, checked.stdout


def test_joints_that_never_and_always_slip(entroslip, tmp_path):
    """mu = 1e8 is a spring, a normal load of zero nothing: the linear structures with and without.

    And with mu = 0 a joint slips nearly always: it sticks for no time at a reversal.
    """
    slip, held, _ = hostile(entroslip, tmp_path, "2 0 5 1 1e8\n")
    assert slip == [0.0]
    slip, spring, _ = hostile(entroslip, tmp_path, "1 0 1e-9 0 0\n", stiffness=(3.0, -1.0, 7.0))
    assert abs(held - spring).max() < 1e-5 * abs(held).max()
    drag = "rayleigh = 0.02, 0"  # damping of modes would know of the joint
    slip, free, _ = hostile(entroslip, tmp_path, "2 0 5 1 0\n", damping=drag)
    assert slip[0] > 0.999
    _, none, _ = hostile(entroslip, tmp_path, "2 0 1e-9 1e-9 0.3\n", damping=drag)
    assert abs(free - none).max() < 1e-5 * abs(none).max()


def test_twins_switch_at_one_instant(entroslip, tmp_path):
    """Two halves of a joint stick and slip at the same instants as the whole joint."""
    slip, one, _ = hostile(entroslip, tmp_path, "2 0 8 4 0.25\n")
    both, two, _ = hostile(entroslip, tmp_path, "2 0 4 2 0.25\n2 0 4 2 0.25\n")
    assert 0.05 < slip[0] < 0.95
    assert both == pytest.approx([slip[0], slip[0]], abs=1e-6)
    assert abs(one - two).max() < 1e-5 * abs(one).max()


def test_light_masses_and_stiff_springs(entroslip, tmp_path):
    """A mass of 1e-6 that hangs on a spring follows the other; a spring of 1e6 ties both."""
    _, follows, _ = hostile(
        entroslip, tmp_path, "1 0 5 1 1\n", mass=(1.0, 0.0, 1e-6), stiffness=(53.0, -50.0, 50.0)
    )
    _, tied, _ = hostile(
        entroslip, tmp_path, "1 0 5 1 1\n", mass=(0.5, 0.0, 0.5), stiffness=(1e6 + 3, -1e6, 1e6)
    )
    # the light mass lags by the static stretch F/50 of its spring
    force = np.loadtxt(tmp_path / "f.txt")
    stretch = force / 50.0
    rms = np.sqrt(np.mean(tied**2))
    assert np.abs(follows[:, 1] - follows[:, 0] - stretch).max() < 0.5 * abs(stretch).max()
    assert np.abs(tied[:, 1] - tied[:, 0]).max() < 1e-4 * rms
    assert np.sqrt(np.mean((follows[:, 0] - tied[:, 0]) ** 2)) < 0.1 * rms


@pytest.mark.parametrize("omega_h", [27.0, 50.0])
def test_modes_far_above_the_step(entroslip, tmp_path, omega_h):
    """A dense mass matrix whose second mode has omega h = 27 and 50."""
    k = 2.0 * (omega_h / 0.05) ** 2
    slip, x, said = hostile(
        entroslip,
        tmp_path,
        "1 0 5 1 1\n",
        mass=(1.0, 0.1, 1.0),
        stiffness=(k / 4, -k / 4, k / 4 + 3),
    )
    assert "by modes" in said
    assert 0.0 < slip[0] < 1.0
    assert abs(x[:, 0] - x[:, 1]).max() < 0.1 * abs(x).max()


def test_zero_modes_drift_and_are_named(entroslip, tmp_path):
    """Free masses coupled by a joint: the centre of mass moves under the force alone."""
    _, x, said = hostile(entroslip, tmp_path, "1 2 5 1 1\n", stiffness=(0.0, 0.0, 0.0))
    assert "1 with all joints stuck" in " ".join(said.split())
    force, dt = np.loadtxt(tmp_path / "f.txt"), 0.05
    velocity = np.concatenate([[0.0], np.cumsum((force[1:] + force[:-1]) * dt / 4)])
    moved = velocity[:-1] * dt + dt**2 / 4 * (force[:-1] + (force[1:] - force[:-1]) / 3)
    centre = np.concatenate([[0.0], np.cumsum(moved)])
    assert abs(x.mean(axis=1) - centre).max() < 1e-6 * abs(centre).max()


def test_a_structure_that_only_stuck_joints_hold_is_named(entroslip, tmp_path):
    """A spring of -2 to the ground under a joint of 5, which never slips: stable, and said not to
    be where it slips."""
    slip, x, said = hostile(entroslip, tmp_path, "1 0 5 1e6 1\n", stiffness=(1.0, -3.0, 3.0))
    assert slip.max() == 0.0
    assert abs(x).max() < 1e3
    assert "unstable with all joints slipping, as K has a negative eigenvalue" in " ".join(
        said.split()
    )


def test_the_ground_moves_what_the_load_says(entroslip, tmp_path):
    """A beam's rotations do not follow the ground: b = -M r, with r from structure%load."""
    mass, r = np.array([[2.0, 0.3], [0.3, 0.5]]), np.array([1.0, 0.0])
    for name, matrix in (("M", mass), ("K", np.array([[300.0, -40.0], [-40.0, 90.0]]))):
        mmwrite(tmp_path / f"{name}.mtx", matrix)
    (tmp_path / "joints.txt").write_text("1 0 200 5 0.2\n")
    np.savetxt(tmp_path / "r.txt", r)
    np.savetxt(tmp_path / "b.txt", -mass @ r)
    slip = {}
    for name, load, base in (
        ("all", "", "t"),
        ("one", "load = 'r.txt'", "t"),
        ("b", "load = 'b.txt'", "f"),
    ):
        (tmp_path / f"{name}.nml").write_text(
            "&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' joints = 'joints.txt'\n"
            f"   {load} /\n"
            f"&excitation base = {base} variance = 9 band = 0, 5 /\n"
            "&integration method = 'event' dt = 0.02 n_steps = 2000 /\n"
            "&campaign deterministic = .true. /\n"
        )
        words = " ".join(entroslip("check", f"{name}.nml").stdout.split())
        assert ("ground, of all dofs alike" in words) == (name == "all")
        assert ("ground, of each by its load" in words) == (name == "one")
        assert entroslip("run", f"{name}.nml").returncode == 0
        with h5py.File(tmp_path / f"{name}.h5") as file:
            slip[name] = file["campaign/c001/slip_fraction"][0, 0]
    assert slip["one"] == slip["b"] != slip["all"]
    np.savetxt(tmp_path / "r.txt", np.eye(2))
    words = " ".join(entroslip("check", "one.nml").stdout.split())
    assert "for each of 2 forces as acceleration of the ground, of each by its load" in words


def test_modes_that_a_reduction_would_save_are_counted(entroslip, tmp_path):
    """A beam of ten elements has modes to 30 kHz; 0.5 ms is a long step for most of them."""
    beam = ROOT / "input/beam"
    (tmp_path / "joints.txt").write_text("19 0 2e4 20 0.3\n")
    (tmp_path / "beam.nml").write_text(
        f"&structure mass_matrix = '{beam}/M.mtx' stiffness_matrix = '{beam}/K.mtx'\n"
        "   joints = 'joints.txt' /\n"
        "&excitation variance = 9 band = 0, 200 dof = 19 /\n"
        "&integration method = 'event' dt = 5e-4 n_steps = 1000 /\n"
        "&campaign deterministic = .true. /\n"
    )
    words = " ".join(entroslip("check", "beam.nml").stdout.split())
    above = r"parts a step, as 1[0-9] of 20 modes are above 1/\(2 dt\) = 1000 Hz"
    reduced = ": the importer's --modes leaves out all but those of the joints"
    assert re.search(above + reduced, words)
    options = ("--set", "integration%dt=1e-5", "--set", "structure%damping_ratio=1")
    words = " ".join(entroslip("check", "beam.nml", *options).stdout.split())
    assert "modes are above" not in words
    assert "note damping_ratio = 1 is above 0.2: 1 % of critical is 0.01" in words
    (tmp_path / "joints.txt").write_text("".join(f"{i} 0 2e4 20 0.3\n" for i in range(1, 20)))
    words = " ".join(entroslip("check", "beam.nml").stdout.split())
    assert re.search(above, words)
    assert "importer" not in words, "no reduction leaves out the modes of the joints' dofs"


OWN_RECORDS = """\
&process mean = 0.2 std = 0.05 correlation_length = 1.0 order = 1 /
&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' joints = 'joints.txt'
   load = 'load.txt' /
&excitation kind = 'file' file = 'force.h5' per_sample = .true. /
&integration method = 'event' n_steps = 4200 /
&campaign n_samples = 3 /
&output quantities = 'slip' /
"""


def test_tradeoff_takes_no_more_records_than_there_are(entroslip, tmp_path):
    """Two forces and three samples have six records; no fourth sample is marched."""
    mmwrite(tmp_path / "M.mtx", np.eye(2))
    mmwrite(tmp_path / "K.mtx", np.array([[60.0, -30.0], [-30.0, 40.0]]))
    (tmp_path / "joints.txt").write_text("1 0 50.0 10.0 0.2\n2 1 50.0 10.0 0.2\n")
    np.savetxt(tmp_path / "load.txt", [[1.0, 0.0], [0.5, 1.0]])
    with h5py.File(tmp_path / "force.h5", "w") as file:
        file["force"] = 6.0 * np.random.default_rng(3).normal(size=(6, 4201))
    (tmp_path / "scene.nml").write_text(OWN_RECORDS)
    done = entroslip("tradeoff", "scene.nml")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "scene_tradeoff.h5") as file:
        assert file["tradeoff/variants"].attrs["n_samples"] == 3
