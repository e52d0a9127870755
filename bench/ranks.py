"""Parallel efficiency of a scene: its wall time on one rank beside that on several, turn by turn.

    python bench/ranks.py build/release/bin/entroslip input/paper_event.nml

Everything counts: mpirun's start, fits, march, statistics, the file written and read back. The
least of several turns is taken, as other work on the machine only adds.
"""

import argparse
import subprocess
import tempfile
import time
from pathlib import Path


def seconds(program: Path, scene: Path, n_ranks: int, more: list[str]) -> float:
    """Wall time of one run from nothing to its results."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["mpirun", "-n", str(n_ranks), str(program), "run", str(scene), "--quiet", *more]
        began = time.perf_counter()
        subprocess.run([*words, "--output", f"{folder}/r.h5"], check=True)
        return time.perf_counter() - began


def main() -> None:
    """Runs in turn, and prints the least wall times and what they make."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--set", action="append", default=[], help="as of entroslip run")
    options = parser.parse_args()
    more = [word for value in options.set for word in ("--set", value)]
    least = dict.fromkeys((1, options.ranks), float("inf"))
    for _ in range(options.turns):
        for n_ranks in least:
            wall = seconds(options.program, options.scene, n_ranks, more)
            least[n_ranks] = min(least[n_ranks], wall)
    efficiency = least[1] / (options.ranks * least[options.ranks])
    for n_ranks, wall in least.items():
        print(f"{n_ranks} ranks: {wall:.2f} s")
    print(f"efficiency: {efficiency:.3f}")


if __name__ == "__main__":
    main()
