"""Compares results of a scene over ways to run it: ranks, binding, threads of BLAS, cores, members.

    python bench/same_bits.py build/release/bin/entroslip input/smallest.nml input/paper_process.nml

Runs each scene in every way and names what differs from the first, which is plain with one thread.
The suite has the same for scenes of a second (tests/program/test_threads.py).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from entroslip.bits import differences, scene_bits

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
THREADS = (1, 0, 2, 7)  # 0: as many as the cores allow
ON_RANKS = ("mpirun", "--oversubscribe", "-n")
UNBOUND = ("mpirun", "--oversubscribe", "--bind-to", "none", "-n", "2")
ONE_CORE = ("taskset", "-c", "0")


def environment(n_threads: int) -> dict[str, str]:
    """Without any word on threads where n_threads is 0."""
    plain = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    return plain | (dict.fromkeys(VARIABLES, str(n_threads)) if n_threads else {})


def ways() -> dict[str, list[tuple[tuple[str, ...], int]]]:
    """Name of each way: for each of its members, which share the run, the launcher and threads."""
    plain = {f"plain, threads {n or 'unset'}": [((), n)] for n in THREADS}
    bound = {f"{n} ranks": [((*ON_RANKS, str(n)), 0)] for n in (1, 2, 3, 4)}
    unbound = {f"2 ranks unbound, threads {n or 'unset'}": [(UNBOUND, n)] for n in THREADS}
    members = {"members of 1 and 7 threads": [((), 1), ((), 7)]}
    return plain | bound | unbound | {"one core": [(ONE_CORE, 7)]} | members


def run(words: list[str], members: list[tuple[tuple[str, ...], int]]) -> None:
    """One run, or several at once that share it."""
    share = ["--share"] if len(members) > 1 else []
    started = [
        subprocess.Popen([*launcher, *words, *share], env=environment(n_threads))
        for launcher, n_threads in members
    ]
    for member in started:
        if member.wait() != 0:
            sys.exit(f"{' '.join(words)}: ended with exit code {member.returncode}")
    if share:  # the members leave the merge to the next run
        subprocess.run(words, env=environment(0), check=True)


def judge(program: Path, scene: Path, chosen: list[str], more: list[str]) -> int:
    """Ways in which the scene's results differ from those of the first."""
    n_different = 0
    with tempfile.TemporaryDirectory() as folder:
        first = Path(folder, "first.h5")
        for name, members in ways().items():
            if first.exists() and not any(name.startswith(start) for start in chosen):
                continue
            if len(members) > 1 and "&campaign" not in scene.read_text():
                continue  # processes alone are not shared out
            output = Path(folder, "other.h5") if first.exists() else first
            words = [str(program), "run", str(scene), "--quiet", *more, "--output", str(output)]
            began = time.perf_counter()
            run(words, members)
            seconds = time.perf_counter() - began
            found = differences(first, output)
            n_different += bool(found)
            what = f"{len(found)} differ: {' '.join(found[:8])}" if found else "same bits"
            print(f"{scene.name:24} {name:32} {seconds:6.1f} s  {what}", flush=True)
            if output != first:
                output.unlink()
        print(f"{scene.name:24} {len(scene_bits(first))} datasets and attributes", flush=True)
    return n_different


def main() -> int:
    """Every scene in every way; exit code 1 where any bits differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=Path)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--set", action="append", default=[], help="as of entroslip run")
    parser.add_argument(
        "--ways", action="append", help="only ways whose names begin so (repeatable)"
    )
    options = parser.parse_args()
    chosen = options.ways or [""]
    more = [word for value in options.set for word in ("--set", value)]
    return int(sum(judge(options.program, scene, chosen, more) for scene in options.scenes) > 0)


if __name__ == "__main__":
    sys.exit(main())
