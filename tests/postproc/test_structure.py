"""Structures from other programs' matrices: read, checked, reduced, written for &structure."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from entroslip import structure
from entroslip.output import InputError
from entroslip.paper.printed import SLIP_HZ, STUCK_HZ
from entroslip.structure import Joint, Pair, chain, craig_bampton, read_pair, ring
from entroslip.structure.__main__ import main
from entroslip.structure.pair import frequencies, largest_eigenvalue, require_stiffness, total_mass
from entroslip.structure.reduction import condensed
from entroslip.structure.scene import read_process, stuck
from tests.conftest import ROOT

SNIPPETS = ROOT / "tests/reference/importer"
ROD_K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]) * 1000.0
ROD_M = np.diag([1.0, 1.0, 0.5])


def beam(n, length=1.0, bending=100.0, line_mass=2.0, held=2):
    """M, K of n Euler-Bernoulli elements, deflections and rotations; the first dofs are held."""
    h = length / n
    stiffness, mass = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, 2 * n + 2))
    ke = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                   [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])  # fmt: skip
    me = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                   [54, 13 * h, 156, -22 * h],
                   [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])  # fmt: skip
    for e in range(n):
        at = np.ix_(range(2 * e, 2 * e + 4), range(2 * e, 2 * e + 4))
        stiffness[at] += bending / h**3 * ke
        mass[at] += line_mass * h / 420 * me
    return mass[held:, held:], stiffness[held:, held:]


@pytest.fixture
def beam_file(tmp_path):
    mass, stiffness = beam(20)
    np.savez(tmp_path / "beam.npz", M=mass, K=stiffness)
    return tmp_path / "beam.npz"


def test_a_beam_has_its_frequencies(beam_file):
    """(beta L)^2 sqrt(EI/(rho A L^4)) of a cantilever, beta L = 1.8751, 4.6941, 7.8548."""
    pair = read_pair(f"{beam_file}:M", str(beam_file))
    exact = np.array([1.87510407, 4.69409113, 7.85475744]) ** 2 * np.sqrt(100.0 / 2.0) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(pair, 3), exact, rtol=2e-5)


@pytest.mark.parametrize(("held", "n_rigid"), [(2, 0), (1, 1), (0, 2)])
def test_modes_of_a_fine_mesh_are_not_taken_for_rigid(tmp_path, held, n_rigid):
    """A beam of 300 elements, clamped, hinged, free: lambda_1 = 9e-13 of the largest, clamped."""
    mass, stiffness = beam(300, held=held)
    np.savez(tmp_path / "fine.npz", M=mass, K=stiffness)
    pair = read_pair(str(tmp_path / "fine.npz"), str(tmp_path / "fine.npz"))
    assert require_stiffness(pair) == n_rigid
    exact = [1.87510407, 3.92660231, 4.73004074][n_rigid] ** 2 * np.sqrt(50.0) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(pair, 3)[n_rigid], exact, rtol=1e-3)


def test_all_rigid_modes_are_counted():
    """Of free rods of two masses, one rigid mode and one frequency each."""
    n = 15
    rod = 1000.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    labels = tuple(str(i + 1) for i in range(2 * n))
    pair = Pair(sp.eye_array(2 * n).tocsc(), sp.csc_array(np.kron(np.eye(n), rod)), labels)
    assert require_stiffness(pair) == n
    hertz = frequencies(pair, n + 1)
    assert not hertz[:n].any()
    assert hertz[n] == pytest.approx(np.sqrt(2000.0) / (2 * np.pi))


def test_a_joint_between_two_dofs_is_a_spring_between_them():
    spring = sp.csc_array([[10.0, -10.0], [-10.0, 10.0]])
    free = Pair(sp.eye_array(2).tocsc(), spring, ("1", "2"))
    hertz = frequencies(stuck(free, [Joint("1", "2", 50.0)]), 2)
    assert hertz == pytest.approx([0.0, np.sqrt(2 * 60.0) / (2 * np.pi)])


def test_craig_bampton_keeps_the_low_modes_and_the_statics(beam_file):
    """Against the full beam; a force on a kept dof bends both alike; kept dofs come first."""
    pair = read_pair(str(beam_file), str(beam_file))
    small = craig_bampton(pair, ["39", "19"], 8)
    assert small.labels[:3] == ("39", "19", "mode 1")
    np.testing.assert_allclose(frequencies(small, 5), frequencies(pair, 5), rtol=1e-3)
    finer = craig_bampton(pair, ["39", "19"], 16)
    exact = frequencies(pair, 5)
    above, least = (frequencies(model, 5) / exact - 1.0 for model in (small, finer))
    assert (above > 0.0).all()  # Rayleigh's quotient over fewer shapes
    assert (least < 0.3 * above).all()
    flexible = np.linalg.inv(pair.stiffness.toarray())[np.ix_([38, 18], [38, 18])]
    reduced = np.linalg.inv(small.stiffness.toarray())[:2, :2]
    np.testing.assert_allclose(reduced, flexible, rtol=1e-8)
    joint = [Joint("39", stiffness=1e4)]
    np.testing.assert_allclose(
        frequencies(stuck(small, joint), 4), frequencies(stuck(pair, joint), 4), rtol=1e-3
    )
    every = craig_bampton(pair, ["39"], 39)
    np.testing.assert_allclose(frequencies(every, 40), frequencies(pair, 40), rtol=1e-6)


def test_a_large_pair_is_solved_by_iteration(tmp_path):
    """A rod of 1000 springs: omega_j = 2 sqrt(k/m) sin((2j - 1) pi/(2 (2n + 1)))."""
    n = 1000
    stiffness = sp.diags_array([-np.ones(n - 1), np.r_[2 * np.ones(n - 1), 1], -np.ones(n - 1)],
                               offsets=[-1, 0, 1])  # fmt: skip
    scipy.io.mmwrite(tmp_path / "K.mtx", sp.coo_array(stiffness))
    scipy.io.mmwrite(tmp_path / "M.mtx", sp.coo_array(sp.eye_array(n)))
    pair = read_pair(str(tmp_path / "M.mtx"), str(tmp_path / "K.mtx"))
    exact = 2 * np.sin((2 * np.arange(1, 9) - 1) * np.pi / (2 * (2 * n + 1))) / (2 * np.pi)
    np.testing.assert_allclose(frequencies(pair, 8), exact, rtol=1e-6)
    assert largest_eigenvalue(pair) == pytest.approx(4.0, rel=0.02)
    small = craig_bampton(pair, ["1000"], 12)
    np.testing.assert_allclose(frequencies(small, 8), exact, rtol=5e-3)


def test_the_example_of_the_package_runs(beam_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scipy.io.savemat("beam.mat", dict(np.load(beam_file)))
    code = "\n".join(re.findall(r"^>>> (.*)", structure.__doc__, re.MULTILINE))
    exec(code, vars(structure) | {"Path": Path})
    assert "dof = 1\n" in Path("beam/scene.nml").read_text()


@pytest.mark.filterwarnings("error")
def test_whole_numbers_will_do():
    pairs = ring(6, 1, 25, 5, 0, 1), chain(3, 1, 25)
    assert {matrix.dtype for pair in pairs for matrix in pair.matrices().values()} == {
        np.dtype(float)
    }


def test_a_ring_has_its_frequencies():
    """Nodal diameters: lambda_n = (k + 2 k_c (1 - cos(2 pi n/blades)))/m, in pairs."""
    blades, mass, own, coupling = 24, 2.0, 25.0, 5.0
    pair = ring(blades, mass, own, coupling, scatter=0.0, seed=1)
    n = np.arange(blades)
    exact = np.sort(np.sqrt((own + 2 * coupling * (1 - np.cos(2 * np.pi * n / blades))) / mass))
    np.testing.assert_allclose(frequencies(pair, blades), exact / (2 * np.pi), rtol=1e-12)
    scattered = ring(4000, mass, own, coupling, scatter=0.05, seed=1).stiffness.diagonal()
    assert (scattered - 2 * coupling).std() / own == pytest.approx(0.05, rel=0.05)


def test_the_chain_is_the_papers(tmp_path, capsys):
    assert main(["chain", "--masses", "5", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    for name, paper in (("without joints", SLIP_HZ), ("with all joints stuck", STUCK_HZ)):
        (line,) = [line for line in said.splitlines() if f"{name} [Hz]" in line]
        assert [f"{float(word):.2f}" for word in line.split(": ")[1].split()] == [
            f"{hz:.2f}" for hz in paper
        ]


def matlab_7_3(path, **matrices):
    """As MATLAB stores them: full arrays by rows, sparse ones in three parts."""
    with h5py.File(path, "w") as file:
        for name, matrix in matrices.items():
            if sp.issparse(matrix):
                group = file.create_group(name)
                group.attrs["MATLAB_sparse"] = np.uint64(matrix.shape[0])
                group.update(data=matrix.data, ir=matrix.indices, jc=matrix.indptr)
            else:
                file[name] = matrix.T


def hbmat(triangle):
    """As Ansys writes half of a symmetric matrix: a number a line, and a right-hand side."""
    n = triangle.shape[0]
    counts = [n + 1, triangle.nnz, triangle.nnz, n]
    lines = ["Stiffness matrix".ljust(72) + "K".ljust(8)]
    lines += ["".join(f"{count:14}" for count in (sum(counts), *counts))]
    lines += ["RSA".ljust(14) + "".join(f"{count:14}" for count in (n, n, triangle.nnz, 0))]
    lines += ["(1I14)".ljust(16) * 2 + "(1D25.15)".ljust(20) * 2, "F".ljust(14) + f"{1:14}{n:14}"]
    lines += [f"{i + 1:14}" for i in (*triangle.indptr, *triangle.indices)]
    return "\n".join(
        lines + [f"{x:25.15E}".replace("E", "D") for x in (*triangle.data, *[0.0] * n)]
    )


def in_every_format(folder):
    """The rod in each format, by name: what --mass and --stiffness are given."""
    sparse_m, sparse_k = sp.csc_array(ROD_M), sp.csc_array(ROD_K)
    np.save(folder / "M.npy", ROD_M)
    np.save(folder / "K.npy", ROD_K)
    sp.save_npz(folder / "M.npz", sparse_m)
    sp.save_npz(folder / "K.npz", sparse_k)
    scipy.io.savemat(folder / "rod.mat", {"rod": {"M": ROD_M, "K": sparse_k, "name": "rod"}})
    matlab_7_3(folder / "rod73.mat", Mass=sparse_m, Stiffness=ROD_K)
    scipy.io.mmwrite(folder / "M.mtx", ROD_M)
    scipy.io.mmwrite(folder / "K.mtx", sparse_k)
    np.savetxt(folder / "M.csv", ROD_M, delimiter=",")
    np.savetxt(folder / "K.txt", ROD_K)
    scipy.io.hb_write(folder / "M.rua", sparse_m)
    (folder / "K.matrix").write_text(hbmat(sp.csc_array(sp.tril(ROD_K))))
    return {
        "npy": (folder / "M.npy", folder / "K.npy"),
        "sparse npz": (folder / "M.npz", folder / "K.npz"),
        "mat": (folder / "rod.mat", f"{folder / 'rod.mat'}:rod.K"),
        "mat 7.3": (folder / "rod73.mat", folder / "rod73.mat"),
        "Matrix Market": (folder / "M.mtx", folder / "K.mtx"),
        "rows of text": (folder / "M.csv", folder / "K.txt"),
        "Harwell-Boeing": (folder / "M.rua", folder / "K.matrix"),
        "Abaqus": (SNIPPETS / "rod_MASS1.mtx", SNIPPETS / "rod_STIF1.mtx"),
        "Abaqus COORDINATE": (SNIPPETS / "rod_MASS2.mtx", SNIPPETS / "rod_STIF2.mtx"),
        "DMIG": (SNIPPETS / "rod.pch", f"{SNIPPETS / 'rod.pch'}:KAAX"),
    }


def test_every_format_is_the_same_rod(tmp_path):
    for name, (mass, stiffness) in in_every_format(tmp_path).items():
        pair = read_pair(str(mass), str(stiffness))
        np.testing.assert_array_equal(pair.mass.toarray(), ROD_M, err_msg=name)
        np.testing.assert_array_equal(pair.stiffness.toarray(), ROD_K, err_msg=name)
        if name in ("Abaqus", "DMIG"):
            assert pair.labels == ("2:1", "3:1", "10:1")
            assert total_mass(pair) == {"direction 1": 2.5}
    held = read_pair(str(SNIPPETS / "rod_MASS1.mtx"), str(SNIPPETS / "rod_STIF1.mtx"))
    assert held.notes == ("left out, held in the model: 1:1",)


def test_dmig_in_free_fields_is_read(tmp_path):
    text = (
        "DMIG,K,0,1,1,0,,,2\nDMIG,K,1,0,,1,0,4.0,,\n+,2,0,-1.\nDMIG,K,2,0,,1,0,-1.,,\n,2,0,3.+0\n"
    )
    (tmp_path / "free.pch").write_text(text)
    path = str(tmp_path / "free.pch")
    pair = read_pair(f"{path}:K", path)  # no mass, whatever it is taken as
    np.testing.assert_array_equal(pair.stiffness.toarray(), [[4.0, -1.0], [-1.0, 3.0]])


@pytest.mark.parametrize(("digits", "is_noted"), [(4, True), (9, False)])
def test_what_rounded_dmig_does_to_the_lowest_frequency_is_noted(tmp_path, digits, is_noted):
    """A note without a number was passed over, and a plate's 9.4 Hz were 25.7 Hz.

    A chain of equal springs with 2 k and k rounded; its frequency differs by a few scatters.
    """
    n, k = 40, 7.0e6 / 17.0
    exact = np.sqrt(k) * 2.0 * np.sin(np.pi / (4 * n + 2)) / (2.0 * np.pi)
    cards = ["DMIG,M,0,6,2,0", "DMIG,K,0,6,2,0"]
    for i in range(1, n + 1):
        cards += [f"DMIG,M,{i},1,,{i},1,1.0"]
        cards += [f"DMIG,K,{i},1,,{i},1,{k if i == n else 2 * k:.{digits - 1}e}"]
        cards += [f",{i + 1},1,{-k:.{digits - 1}e}"] if i < n else []
    (tmp_path / "m.pch").write_text("\n".join(cards))
    pair = read_pair(str(tmp_path / "m.pch"), str(tmp_path / "m.pch"))
    assert bool(pair.notes) is is_noted
    if is_noted:
        stated = float(re.search(r"scatters by (\S+)%", pair.notes[0])[1]) / 100
        change = abs(frequencies(pair, 1)[0] / exact - 1)
        assert stated / 4 < change < 4 * stated


def test_a_node_alone_is_refused_with_its_dofs():
    """'1813: is not among 351 dofs: 1001:3, 1001:4 ...'"""
    pair = Pair(sp.eye_array(4), sp.eye_array(4), ("7:1", "7:3", "12:1", "12:3"))
    with pytest.raises(InputError, match=r"^dof 12: is not among 4 dofs: 12:1, 12:3$"):
        pair.position("12")
    with pytest.raises(InputError, match=r"^dof 8:1: is not among 4 dofs: 7:1, 7:3, 12:1, 12:3$"):
        pair.position("8:1")


def test_dofs_held_in_abaqus_are_left_out_by_number_too(tmp_path):
    """FORMAT=COORDINATE has 1e36 as well: it stayed, and all other modes were called rigid."""
    (tmp_path / "M.mtx").write_text("1 1 1.0\n2 2 1.0\n3 3 2.0\n")
    (tmp_path / "K.mtx").write_text("1 1 1.0e36\n2 2 3.0\n2 3 -1.0\n3 2 -1.0\n3 3 2.0\n")
    pair = read_pair(str(tmp_path / "M.mtx"), str(tmp_path / "K.mtx"))
    assert pair.labels == ("2", "3")
    assert pair.notes == ("left out, held in the model: 1",)
    np.testing.assert_array_equal(pair.stiffness.toarray(), [[3.0, -1.0], [-1.0, 2.0]])


def test_entries_given_once_may_stand_in_either_triangle(tmp_path):
    """Numbered otherwise inside of the program that wrote them, they were called asymmetric."""
    (tmp_path / "M.mtx").write_text("1,1, 1,1, 2.0\n2,1, 2,1, 2.0\n3,1, 3,1, 2.0\n")
    (tmp_path / "K.mtx").write_text(
        "1,1, 1,1, 2.0\n1,1, 2,1, -1.0\n2,1, 2,1, 2.0\n3,1, 2,1, -1.0\n3,1, 3,1, 1.0\n"
    )
    pair = read_pair(str(tmp_path / "M.mtx"), str(tmp_path / "K.mtx"))
    np.testing.assert_array_equal(
        pair.stiffness.toarray(), [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    )


def test_other_matrices_of_a_punch_file_do_not_matter(tmp_path, capsys):
    """Loads and complex matrices beside M and K, as superelements have them, were refused."""
    path = tmp_path / "super.pch"
    path.write_text(
        "DMIG,PAX,0,9,2,0,,,1\nDMIG,PAX,1,0,,1,1,5.0\n"
        "DMIG,KAAX,0,6,2,0\nDMIG,KAAX,1,1,,1,1,3.0\n"
        "DMIG,K4AAX,0,6,4,0\nDMIG,K4AAX,1,1,,1,1,3.0,1.0\n"
        "DMIG,MAAX,0,6,2,0\nDMIG,MAAX,1,1,,1,1,2.0\n"
    )
    pair = read_pair(str(path), str(path))
    assert (pair.mass[0, 0], pair.stiffness[0, 0], pair.n_dof) == (2.0, 3.0, 1)
    assert main(["import", "--mass", str(path), "--stiffness", f"{path}:PAX"]) == 2
    assert capsys.readouterr().err.endswith(":1: DMIG PAX: must be square, form 1 or 6\n")


def test_a_sparse_matrix_without_entries_is_zero(tmp_path):
    """MATLAB 7.3 then stores neither values nor rows; the whole file could not be read."""
    path = tmp_path / "rod.mat"
    matlab_7_3(path, M=sp.csc_array(ROD_M), K=ROD_K)
    with h5py.File(path, "a") as file:
        group = file.create_group("C")
        group.attrs["MATLAB_sparse"] = np.uint64(3)
        group["jc"] = np.zeros(4, dtype=np.uint64)
    pair = read_pair(str(path), str(path), str(path))
    assert pair.damping is not None
    assert pair.damping.nnz == 0


def test_the_force_of_a_reduced_model_acts_on_a_dof(beam_file, tmp_path):
    """Without --force it acted on the last of the modes."""
    command = ["import", "--mass", f"{beam_file}:M", "--stiffness", f"{beam_file}:K"]
    assert main([*command, "--joint", "39", "--modes", "3", "--out", str(tmp_path)]) == 0
    assert "dof = 1\n" in (tmp_path / "scene.nml").read_text()


def test_op4_says_what_it_needs(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyNastran.op4.op4", None)
    path = tmp_path / "rod.op4"
    path.write_bytes(b"")
    assert main(["import", "--mass", str(path), "--stiffness", str(path)]) == 2
    assert "pip install --no-deps pyNastran" in capsys.readouterr().err


def test_op4_is_read_through_pynastran(tmp_path):
    op4 = pytest.importorskip("pyNastran.op4.op4")
    matrices = {"MAA": (6, ROD_M), "KAA": (6, ROD_K)}
    op4.OP4(log=None).write_op4(str(tmp_path / "rod.op4"), matrices, is_binary=False)
    pair = read_pair(str(tmp_path / "rod.op4"), str(tmp_path / "rod.op4"))
    np.testing.assert_allclose(pair.stiffness.toarray(), ROD_K, rtol=1e-9)


def test_the_reduction_says_which_frequencies_are_kept(beam_file, capsys):
    """Those of the full beam within a per cent, from the lowest on."""
    files = ["--mass", str(beam_file), "--stiffness", str(beam_file)]
    assert main(["import", *files, "--keep", "39", "19", "--modes", "4"]) == 0
    pair = read_pair(str(beam_file), str(beam_file))
    exact = frequencies(pair, 6)
    error = frequencies(craig_bampton(pair, ["39", "19"], 4), 6) / exact - 1.0
    n_right = int((error > 0.01).argmax())
    assert 0 < n_right < 6
    told = f"frequencies within 1%: the lowest {n_right} of 6, up to {exact[n_right - 1]:.6g} Hz"
    assert told in capsys.readouterr().out


def test_the_mass_is_that_of_the_whole_model(capsys):
    """Modes are in no direction: of the dofs that a reduction keeps the mass would be a part."""
    files = [str(SNIPPETS / f"rod_{name}1.mtx") for name in ("MASS", "STIF")]
    words = ["import", "--mass", files[0], "--stiffness", files[1]]
    assert main([*words, "--modes", "1", "--joint", "10:1"]) == 0
    assert "mass, direction 1: 2.5\n" in capsys.readouterr().out


def test_a_large_scene_keeps_the_spectra_of_joints_and_forces(tmp_path):
    """All 800 of a finite element model took a minute of statistics, and most of the file."""
    np.savez(
        tmp_path / "row.npz", M=np.eye(70), K=2 * np.eye(70) - np.eye(70, k=1) - np.eye(70, k=-1)
    )
    source = f"{tmp_path / 'row.npz'}"
    words = [
        "import",
        "--mass",
        f"{source}:M",
        "--stiffness",
        f"{source}:K",
        "--joint",
        "35",
        "12,50",
    ]
    assert main([*words, "--out", str(tmp_path / "row")]) == 0
    assert re.search(r"^ +dofs = 12, 35, 50, 70 ", (tmp_path / "row/scene.nml").read_text(), re.M)


def test_the_folder_has_what_structure_reads(tmp_path, beam_file):
    """Strict Matrix Market to the last digit; a line per joint; the load; the names of the dofs."""
    out = tmp_path / "beam"
    words = ["import", "--mass", beam_file, "--stiffness", beam_file, "--joint", "39", "19,21",
             "--modes", 4, "--force", 39, "--force", "19=-0.5", "--out", out]  # fmt: skip
    assert main([*map(str, words), "--joint-stiffness", "2e5", "--rayleigh", "0.1", "1e-5"]) == 0
    assert {path.name for path in out.iterdir()} == {
        "M.mtx", "K.mtx", "joints.txt", "load.txt", "scene.nml",
    }  # fmt: skip
    small = craig_bampton(read_pair(str(beam_file), str(beam_file)), ["39", "19", "21"], 4)
    for name, matrix in small.matrices().items():
        lines = (out / f"{name}.mtx").read_text().splitlines()
        assert lines[0] == "%%MatrixMarket matrix coordinate real symmetric"
        rows = [line.split() for line in lines if not line.startswith("%")]
        assert rows[0] == ["7", "7", str(len(rows) - 1)]
        assert all(int(row[0]) >= int(row[1]) for row in rows[1:])
        np.testing.assert_array_equal(
            scipy.io.mmread(out / f"{name}.mtx").toarray(), matrix.toarray()
        )
    joints = (out / "joints.txt").read_text()
    assert [line for line in joints.splitlines() if line[0] != "#"] == [
        "1 0 200000 10 0.2", "2 3 200000 10 0.2",
    ]  # fmt: skip
    assert "#   2 is 19" in joints
    load = [line for line in (out / "load.txt").read_text().splitlines() if line[0] != "#"]
    assert [float(line) for line in load] == [1.0, -0.5, 0, 0, 0, 0, 0]
    scene = (out / "scene.nml").read_text()
    assert "rayleigh = 0.1, 1e-05" in scene
    assert "load = 'load.txt'" in scene
    assert "variance = 16 " in scene  # (2 mu N)^2
    assert re.search(r"^ *dofs = 1, 2, 3  +! without the modes", scene, re.MULTILINE)


@pytest.mark.parametrize(
    "group",
    [
        "&process mean = 0.2  std = 0.067 /",
        "&PROCESS values = 'friction/x.txt'  ! a/b, it's\n  order = 2 /",
    ],
)
def test_the_process_of_a_scene_is_taken_alone(tmp_path, group):
    path = tmp_path / "scene.nml"
    path.write_text(f"! &process of a test\n  {group}\n&chain\n  n_dof = 5\n/\n")
    assert read_process(path) == group


def test_a_filled_joints_file_is_not_lost(tmp_path, capsys):
    words = ["chain", "--masses", "3", "--out", str(tmp_path)]
    assert main(words) == 0
    (tmp_path / "joints.txt").write_text("mine")
    assert main(words) == 2
    assert capsys.readouterr().err.endswith("exists; --replace writes it anew\n")
    assert (tmp_path / "joints.txt").read_text() == "mine"
    assert main([*words, "--replace"]) == 0


def test_dofs_without_mass_are_named_and_condensed(tmp_path, capsys):
    """Statically: a spring of two halves with nothing between."""
    np.savez(tmp_path / "a.npz", M=np.diag([1.0, 0.0, 1.0]), K=ROD_K)
    words = ["import", "--mass", str(tmp_path / "a.npz"), "--stiffness", str(tmp_path / "a.npz")]
    assert main(words) == 2
    assert "dof 2 is without mass: --condense" in capsys.readouterr().err
    pair = read_pair(words[2], words[4])
    exact = np.array([[1500.0, -500.0], [-500.0, 500.0]])
    np.testing.assert_allclose(condensed(pair).stiffness.toarray(), exact)
    assert main([*words, "--condense"]) == 0
    assert main([*words, "--condense", "--joint", "2"]) == 2
    assert "dof 2: has no mass and goes with --condense" in capsys.readouterr().err
    assert main([*words, "--modes", "1", "--joint", "3"]) == 0


def spoilt(folder):
    """Bad input by name: the words after `import`, and what must be said."""
    skew = ROD_K + np.array([[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    np.savez(folder / "a.npz", M=ROD_M, K=ROD_K, skew=skew, wide=np.ones((2, 3)), one=np.eye(1),
             less=np.diag([1.0, -1.0, 1.0]), nan=np.diag([1.0, np.nan, 1.0]), soft=-ROD_K,
             complex=1j * ROD_K)  # fmt: skip
    np.savez(folder / "K.npz", K=ROD_K)
    loose = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]])
    np.savez(folder / "loose.npz", K=loose)
    springs = 1.0e4 / np.arange(3.0, 14.0)
    steps = np.diff(np.eye(12), axis=0)
    np.savez(folder / "free.npz", M=np.eye(12), K=steps.T @ np.diag(springs) @ steps)
    (folder / "text.mat").write_text("no MATLAB file")
    (folder / "bad.mtx").write_text("%%MatrixMarket matrix coordinate real general\n2 2 1\n1 x 3\n")
    (folder / "words.inp").write_text("** K\n1,1,1,1,2.0\n1,1,2,1,two\n")
    (folder / "twice.inp").write_text("1,1,1,1,2.0\n1,1,1,1,3.0\n")
    (folder / "short.inp").write_text("1,1,1,1,2.0\n1,1,1\n")
    (folder / "model.op2").write_bytes(b"\x04\0\0\0\x0c\0\0\0")
    (folder / "complex.pch").write_text("DMIG    K              0       6       3       0\n")
    (folder / "complex.hb").write_text("K\n3 1 1 1 0\nCSA 1 1 1 0\n(1I14) (1I14) (1D25.15)\n1\n")
    (folder / "cut.pch").write_text("DMIG    K              0       6       2       0\n")
    (folder / "late.pch").write_text(
        "$\nDMIG    K              1       1               1       1\n"
    )
    (folder / "zero.inp").write_text("0,0,1.0\n1,1,2.0\n")
    (folder / "far.inp").write_text("99999999999999999999,1,1.0\n")
    (folder / "empty.npy").write_bytes(b"")
    a, free = f"{folder}/a.npz", f"{folder}/free.npz"

    def of(stiffness, mass=f"{a}:M", *rest):
        return ["--mass", mass, "--stiffness", str(stiffness), *rest]

    return {
        "absent": (of(folder / "no.mat"), "no.mat: no such file"),
        "folder": (of(folder), "is a folder"),
        "not MATLAB": (of(folder / "text.mat"), "text.mat: cannot be read as a MATLAB file"),
        "not Matrix Market": (of(folder / "bad.mtx"), "bad.mtx: cannot be read .*[Ll]ine 3"),
        "word": (of(folder / "words.inp"), "words.inp:3: two: must be a number"),
        "twice": (of(folder / "twice.inp"), "twice.inp:2: entry 1:1, 1:1 stands twice"),
        "short": (of(folder / "short.inp"), "short.inp:2: must be node, dof, node, dof, value"),
        "binary": (of(folder / "model.op2"), "model.op2: is binary, and none of .npy, .npz, .mat,"),
        "row 0": (of(folder / "zero.inp"), "zero.inp: row 0: must be from 1 to"),
        "far row": (of(folder / "far.inp"), "far.inp: row 99999999999999999999: must be from 1 to"),
        "empty": (of(folder / "empty.npy"), "empty.npy: cannot be read as a NumPy array"),
        "complex DMIG": (of(folder / "complex.pch"), "complex.pch:1: DMIG K: must be real"),
        "complex HB": (of(folder / "complex.hb"), "complex.hb:3: CSA: must be real and assembled"),
        "no entries": (of(folder / "cut.pch"), "cut.pch: the matrix has no entries"),
        "no header": (of(folder / "late.pch"), "late.pch:2: DMIG K: its header must come first"),
        "no such name": (of(f"{a}:Q"), "a.npz: has no Q, only K, M, complex"),
        "no names": (of(f"{SNIPPETS}/rod_STIF1.mtx:K"), "one matrix without a name: leave :K out"),
        "names alike": (of(f"{SNIPPETS}/rod.pch:K"), "has no K, only KAAX, MAAX"),
        "another's name": (of(f"{folder}/K.npz", f"{folder}/K.npz"), "K.npz: K is K by its name;"),
        "asymmetric": (of(f"{a}:skew"), r"K: must be symmetric; entry \(2, 1\) is -1000"),
        "not square": (of(f"{a}:wide"), r"wide: must be square, has shape \(2, 3\)"),
        "complex": (of(f"{a}:complex"), "must be real numbers, is complex128"),
        "not finite": (of(f"{a}:nan"), "has an entry that is no finite number"),
        "sizes": (of(f"{a}:one"), "K has 1 dofs, M of .* has 3"),
        "mass": (of(f"{a}:K", f"{a}:less"), "M: must be positive definite"),
        "stiffness": (of(f"{a}:soft"), "K: must have no negative eigenvalue; the lowest .* is -"),
        "unnamed": (of(SNIPPETS / "rod_STIF1.mtx"), "does not name its dofs"),
        "exchanged": (of(SNIPPETS / "rod_MASS1.mtx", str(SNIPPETS / "rod_STIF1.mtx")),
                      "rod_STIF1.mtx: M has 1e36 on its diagonal, as Abaqus writes K: exchanged"),
        "joint": (of(f"{a}:K", f"{a}:M", "--joint", "7", "--out", str(folder / "x")),
                  "dof 7: is not among 3 dofs: 1, 2, 3$"),
        "force": (of(f"{a}:K", f"{a}:M", "--force", "7"), "dof 7: is not among 3 dofs: 1, 2, 3"),
        "no force": (of(f"{a}:K", f"{a}:M", "--force", "1=0"), "--force: its factors must"),
        "endless force": (of(f"{a}:K", f"{a}:M", "--force", "1=inf"), "factors must be finite"),
        "modes": (of(f"{a}:K", f"{a}:M", "--joint", "1", "--modes", "5"),
                  "--modes 5: must be from 0 to 2"),
        "nothing kept": (of(f"{a}:K", f"{a}:M", "--modes", "1"), "--modes: needs a dof to keep"),
        "keep": (of(f"{a}:K", f"{a}:M", "--keep", "1"), "--keep: needs --modes"),
        "floats": (of(free, free, "--joint", "3", "--modes", "2"),
                   "joint 3: --joint-stiffness must be given, K is zero there"),
        "loose": (of(f"{folder}/loose.npz", f"{a}:M", "--joint", "1", "--modes", "1"),
                  "the dofs that are not kept can move without force .*: keep more dofs"),
        "condense": (of(f"{a}:K", f"{a}:M", "--condense"), "every dof has mass"),
    }  # fmt: skip


def test_exchanged_matrices_are_noted(tmp_path, capsys):
    """M and K of the rod, the latter held at an end, whose frequencies are of some Hz."""
    held = ROD_K + np.diag([1000.0, 0.0, 0.0])
    np.savez(tmp_path / "rod.npz", M=1e-3 * ROD_M, K=1e6 * held)
    mass, stiffness = f"{tmp_path / 'rod.npz'}:M", f"{tmp_path / 'rod.npz'}:K"
    for first, second, is_noted in ((mass, stiffness, False), (stiffness, mass, True)):
        assert main(["import", "--mass", first, "--stiffness", second]) == 0
        assert ("--mass and --stiffness exchanged?" in capsys.readouterr().out) == is_noted


def test_bad_input_is_one_line(tmp_path, capsys):
    for name, (words, rule) in spoilt(tmp_path).items():
        code = main(["import", *words])
        said = capsys.readouterr().err
        assert code == 2, name
        assert len(said.splitlines()) == 1, (name, said)
        with pytest.raises(AssertionError, match=rule):
            raise AssertionError(said)
    two_dampings = ["--damping-ratio", "0.01", "--rayleigh", "0", "1e-4"]
    for damping in (two_dampings, ["--rayleigh", "-1", "0"]):
        with pytest.raises(SystemExit):
            main(["ring", "--blades", "6", *damping])
    assert main(["ring", "--blades", "2"]) == 2
    assert main(["ring", "--blades", "6", "--seed", "-1"]) == 2
    assert main(["ring", "--blades", "24", "--scatter", "2"]) == 2
    assert "makes the stiffness of blade" in capsys.readouterr().err.splitlines()[-1]


def test_it_runs_as_a_command(tmp_path):
    words = ["ring", "--blades", "6", "--joints", "both", "--out", "ring"]
    done = subprocess.run(
        [sys.executable, "-m", "entroslip.structure", *words], cwd=tmp_path,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "6 dofs, joints: 12" in done.stdout
    assert "6 1 50 10 0.2" in (tmp_path / "ring/joints.txt").read_text()
