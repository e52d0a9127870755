"""The march beside what others use for it, in one run on one core: accuracy, cost, and ratios.

    cmake --build --preset release --target benchmarks
    python bench/peers build/release/bin/bench_dynamics

Needs numpy; scipy, numba, openseespy and heyoka (pip), and compilers and SUNDIALS (Debian: g++,
gcc, libsundials-dev) for the lines that they give; a line whose tool is missing says so.

All march one sample of the paper's chain, the first steps of two histories that were computed in
extended precision (tests/reference/dynamics). The error is the largest over the masses: rms error
over rms displacement, and the slip fraction in points of per cent. Ours marches 32 samples
together, as a campaign does. How the accuracy of a peer was set stands in its name.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import marches
import numpy as np
from problem import Problem, read_problem

HERE = Path(__file__).parent
Result = tuple[float, np.ndarray, np.ndarray]
"""CPU seconds; slip fraction (mass); displacements (snapshot, mass) [m]"""


def output_of(*command: str | Path) -> str:
    """Output of a program."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def compiled(source: str, *libraries: str) -> Callable[[Problem, str], Result]:
    """A march by a program compiled here with -O3 for this machine; the best time of three."""
    compiler = shutil.which("g++" if source.endswith("pp") else "gcc")
    if compiler is None:
        raise ImportError("no compiler")
    folder = Path(tempfile.mkdtemp(prefix="entroslip_peers_"))
    program = folder / Path(source).stem
    options = ["-O3", "-march=native", "-o", str(program)]
    command = [compiler, *options, str(HERE / source), *libraries, "-lm"]
    if subprocess.run(command, capture_output=True).returncode != 0:
        raise ImportError(f"{source} does not compile: {' '.join(libraries)} missing")

    def march(problem: Problem, setting: str) -> Result:
        path = folder / "problem.txt"
        problem.write(path)
        repeats = [output_of(program, path, setting) for _ in range(3)]
        seconds = min(float(output.split(maxsplit=1)[0]) for output in repeats)
        rows = [np.array(line.split(), float) for line in repeats[0].splitlines()[1:]]
        return seconds, rows[0], np.array(rows[1:])

    return march


def cvode() -> Callable[[Problem, str], Result]:
    """CVODE's march, where SUNDIALS is installed."""
    names = ("cvode", "sunnonlinsolfixedpoint", "nvecserial", "generic")
    return compiled("cvode.c", *(f"-lsundials_{name}" for name in names))


def heyoka() -> Callable[[Problem, str], Result]:
    """The march of heyoka.py, where it is installed."""
    from heyoka_march import march

    return march


PEERS: list[tuple[str, int, Callable[[], Callable[[Problem, str], Result]], str]] = [
    ("scalar C++ Newmark, 15 halvings", 20000, lambda: compiled("newmark.cpp"), "15"),
    ("scalar C++ Newmark, 3 halvings", 20000, lambda: compiled("newmark.cpp"), "3"),
    ("numba Newmark, 15 halvings", 20000, lambda: marches.numba_newmark, "15"),
    ("CVODE Adams, roots, rtol 1e-6", 20000, cvode, "1e-6"),
    ("CVODE Adams, roots, rtol 1e-9", 20000, cvode, "1e-9"),
    ("heyoka.py batch of 8, tol 1e-6", 20000, heyoka, "1e-6"),
    ("heyoka.py batch of 8, tol 1e-9", 20000, heyoka, "1e-9"),
    ("OpenSees Newmark, return mapping", 20000, lambda: marches.opensees, "1"),
    ("OpenSees Newmark, dt/8", 4000, lambda: marches.opensees, "8"),
    ("scipy DOP853, events, rtol 1e-6", 600, lambda: marches.scipy_events, "1e-6"),
]


def ours(program: str, folder: Path, case: str) -> dict[str, list[float]]:
    """Rows of our own bench for a case: [ns, rms error, slip error in points] of each setting."""
    lines = output_of(program, folder, "settings").splitlines()
    rows = [line.split() for line in lines if line.startswith(case)]
    return {
        " ".join(row[1:-5]): [float(row[-5]), float(row[-4]), 100 * float(row[-3])] for row in rows
    }


def main() -> None:
    """Ours, then each peer, for both reference histories."""
    folder = HERE.parents[1] / "tests/reference/dynamics"
    for case in ("p1_low", "p2_high"):
        own = ours(sys.argv[1], folder, case)
        event, newmark = own["event 1e-6"], own["newmark halvings 15"]
        print(f"\n{case:34s}    ns/step  rms error  slip error  over event 1e-6  over newmark 15")
        for name in ("event 1e-6", "event 1e-9", "newmark halvings 3", "newmark halvings 15"):
            if name in own:
                show("ours, " + name, own[name], event, newmark)
        for name, steps, make, setting in PEERS:
            problem = read_problem(folder, case, steps)
            try:
                seconds, slip, history = make()(problem, setting)
            except ImportError as missing:
                print(f"{name:34s} left out: {missing}")
                continue
            exact = problem.snapshots[: len(history)]
            square = np.mean((history - exact) ** 2, axis=0) / np.mean(problem.snapshots**2, axis=0)
            error = np.sqrt(square).max()
            points = 100 * np.abs(slip - problem.slip).max() if steps == problem.whole else np.nan
            show(name, [1e9 * seconds / steps, error, points], event, newmark)


def show(name: str, row: list[float], event: list[float], newmark: list[float]) -> None:
    """One line; event and newmark are ours, for the ratios."""
    nanoseconds, error, points = row
    print(
        f"{name:34s} {nanoseconds:10.1f} {error:10.1e} {points:11.1e} "
        f"{nanoseconds / event[0]:16.1f} {nanoseconds / newmark[0]:16.1f}"
    )


if __name__ == "__main__":
    main()
