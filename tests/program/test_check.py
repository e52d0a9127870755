"""`check` says which processes have a solution, and ends as `run` would."""

from __future__ import annotations

PROCESS = "&process method = 'direct' correlation_length = 2.0 order = {} mean = 1.0 std = 0.2"
CHAIN = "&chain / &excitation variance = 1.0 / &integration n_steps = 1000 /"


def test_what_has_no_solution_is_said_before_it_is_computed(entroslip, tmp_path):
    scene = PROCESS + " pairing = 'product' /\n"
    (tmp_path / "some.nml").write_text(scene.format("2, 3"))
    (tmp_path / "none.nml").write_text(scene.format("1, 2"))
    (tmp_path / "needed.nml").write_text(scene.format("2, 3") + CHAIN)
    for name, code in (("some", 0), ("none", 4), ("needed", 4)):
        done = entroslip("check", f"{name}.nml")
        assert done.returncode == code, done.stderr
        first, second = done.stdout.split("verdict\n")[1].splitlines()[:2]
        assert first.endswith("infeasible")
        assert second.endswith("infeasible" if name == "none" else "ordinary")
        assert "feasible is 3" in done.stdout
        assert ("feasible is 3" in done.stderr) == (code == 4)
        assert entroslip("run", f"{name}.nml").returncode == code
