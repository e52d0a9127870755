"""Ends of runs on one or several ranks: exit codes, one message, no hanging, signals.

usage: check_endings.py PROGRAM MPIEXEC [MPIEXEC_FLAGS ...]
"""

import os
import signal
import subprocess
import sys
import time

PROGRAM, MPIEXEC, *FLAGS = sys.argv[1:]
PATIENCE = 60  # s: a run that takes longer hangs


def start(ending: str, n_ranks: int) -> subprocess.Popen[str]:
    """n_ranks = 0: without mpirun."""
    launcher = [MPIEXEC, *FLAGS, "-n", str(n_ranks)] if n_ranks else []
    pipe = subprocess.PIPE
    return subprocess.Popen([*launcher, PROGRAM, ending], stdout=pipe, stderr=pipe, text=True)


def check(ending: str, n_ranks: int, code: int, message: str = "") -> None:
    run = start(ending, n_ranks)
    _, errors = run.communicate(timeout=PATIENCE)
    told = f"{ending} on {n_ranks} ranks: code {run.returncode}, stderr:\n{errors}"
    assert run.returncode == code, told
    assert not message or errors.count(message) == 1, told
    assert errors.count("rank") <= 1 or n_ranks > 0, told


def ranks_of(pid: int) -> list[int]:
    """Process numbers of the ranks: the process itself, or what mpirun's children come down to."""
    if os.path.samefile(f"/proc/{pid}/exe", PROGRAM):
        return [pid]
    with open(f"/proc/{pid}/task/{pid}/children") as children:
        return [rank for child in children.read().split() for rank in ranks_of(int(child))]


def check_signal(ending: str, n_ranks: int, number: int, pause: float, to_all: bool) -> None:
    run = start(ending, n_ranks)
    assert run.stdout is not None
    assert run.stdout.readline().strip() == "ready"
    targets = ranks_of(run.pid) if to_all else ranks_of(run.pid)[-1:]
    for repeat in range(2 if pause else 1):
        time.sleep(pause * repeat)
        for pid in targets:
            os.kill(pid, number)
    _, errors = run.communicate(timeout=PATIENCE)
    assert run.returncode == 75, f"{ending} {n_ranks} {number}: {run.returncode}\n{errors}"


for n in (0, 1, 4):
    last = max(n, 1) - 1
    check("done", n, 0)
    check("last_rank_fails", n, 4, f"rank {last} found no solution")
    check("all_ranks_fail", n, 3, "rank 0 failed")
WISHES = ("SIGTERM", "SIGINT", "SIGUSR1", "SIGHUP", "SIGQUIT", "SIGXCPU")
for number in (signal.Signals[name] for name in WISHES):
    check_signal("signal", 0, number, 0.0, to_all=False)
for number in (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGHUP):
    check_signal("signal", 3, number, 0.0, to_all=False)
check_signal("second_signal", 0, signal.SIGTERM, 2.5, to_all=True)
check_signal("second_signal", 2, signal.SIGTERM, 2.5, to_all=True)

# A signal that nohup ignores stays ignored. UCX, on which some MPIs rest, would take SIGHUP first.
os.environ["UCX_DEBUG_SIGNO"] = "0"
run = subprocess.Popen(["nohup", PROGRAM, "signal"], stdout=subprocess.PIPE, text=True)
assert run.stdout is not None
assert run.stdout.readline().strip() == "ready"
run.send_signal(signal.SIGHUP)
time.sleep(0.3)
assert run.poll() is None
run.send_signal(signal.SIGTERM)
assert run.wait(PATIENCE) == 75

began = time.perf_counter()
check("done", 0, 0)
print(f"alone, from start to end: {time.perf_counter() - began:.3f} s")
