"""The cost of a scene by what it asks for: python bench/requirements.py

One scene of motion, 32 samples of 50,000 steps, and for each quantity the same scene asking for it
too; then scenes that ask for less. Prints a Markdown table: what runs, in the words of
`entroslip check`, and processor time, memory (largest resident set) and size of the results file
as multiples of those of the first row. Times are the least of three serial runs.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "build/release/bin/entroslip"
PROCESS = "&process correlation_length = 1.0 order = {order} mean = 0.2 std = 0.067 {drawn} /\n"
SCALED = PROCESS.replace("0.2 std = 0.067", "0.4 std = 0.134")
MOTION = """\
&chain n_dof = 5 {chain} /
&excitation variance = {variance} /
&integration n_steps = 50000 /
&campaign n_samples = {n_samples} deterministic = {deterministic} /
&output quantities = 'slip' {more} /
&accuracy audit = {audit} /
"""


def scene(
    process: str = PROCESS, more: str = "", variance: float = 41.1, n_samples: int = 32,
    deterministic: str = ".false.", audit: float = 0.0, drawn: str = "", chain: str = "",
    order: int = 1,
) -> str:  # fmt: skip
    """The barest scene of motion, but for what is named."""
    return process.format(drawn=drawn, order=order) + MOTION.format(
        more=more,
        variance=variance,
        n_samples=n_samples,
        deterministic=deterministic,
        audit=audit,
        chain=chain,
    )


SCENES = {
    "`'slip'`": scene(),
    "and `'spectrum'`": scene(more=", 'spectrum'"),
    "and `'energy'`": scene(more=", 'energy'"),
    "and `'transitions'`": scene(more=", 'transitions'"),
    "and `'history'`": scene(more=", 'history'"),
    "and `'history'`, `dofs = 1`": scene(more=", 'history' dofs = 1"),
    "and `'spectrum'`, `dofs = 1`": scene(more=", 'spectrum' dofs = 1"),
    "and `'realizations'`, 10,000": scene(more=", 'realizations'", drawn="n_realizations = 10000"),
    "and `audit = 0.1`": scene(audit=0.1),
    "and `deterministic`": scene(deterministic=".true."),
    "and `order = 2`: a fit by simulated values": scene(order=2),
    "and twice that process in scale": scene(process=PROCESS + SCALED, order=2),
    "a force too weak for slip": scene(variance=1e-3),
    "`deterministic` alone, friction given": scene(
        process="", n_samples=0, deterministic=".true.", chain="friction = 0.2"
    ),
    "`'realizations'` alone, no chain": PROCESS.format(drawn="n_realizations = 10000", order=1)
    + "&output quantities = 'realizations' /\n",
}


@dataclass(frozen=True)
class Cost:
    """Costs of one run: processor time [s], largest resident set [kB], size of its file [bytes]."""

    seconds: float
    memory: float
    file: float

    def over(self, other: Cost) -> list[str]:
        """Multiples of another's."""
        pairs = (
            (self.seconds, other.seconds),
            (self.memory, other.memory),
            (self.file, other.file),
        )
        return [f"{ours / theirs:.2g}" if ours < 10 * theirs else f"{ours / theirs:.0f}"
                for ours, theirs in pairs]  # fmt: skip


def started(*words: object) -> tuple[str, float, float]:
    """Output of a serial start, its processor time [s], its largest resident set [kB]."""
    with subprocess.Popen(
        [PROGRAM, *map(str, words)], stdout=subprocess.PIPE, text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    ) as process:  # fmt: skip
        said = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{words}: exit code {process.returncode}\n{said}")
    return said, used.ru_utime + used.ru_stime, used.ru_maxrss


def cost(path: Path) -> Cost:
    """Costs of running a scene, the least of three."""
    output = path.with_suffix(".h5")
    runs = [started("run", path, "--quiet", "--fresh", "--output", output)[1:] for _ in range(3)]
    found = Cost(min(run[0] for run in runs), min(run[1] for run in runs), output.stat().st_size)
    output.unlink()
    return found


def what_runs(path: Path) -> str:
    """The program's own words."""
    said = started("check", path)[0]
    return " ".join(re.search(r"^runs +(.*?)(?=^\S)", said, re.MULTILINE | re.DOTALL)[1].split())


def main() -> None:
    """One row per scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.nml"
        found = {}
        for asked, text in SCENES.items():
            path.write_text(text)
            found[asked] = what_runs(path), cost(path)
    barest = next(iter(found.values()))[1]
    print("| asked for | what runs | time | memory | file |\n|---|---|---|---|---|")
    for asked, (runs, run) in found.items():
        print("|", " | ".join([asked, runs, *run.over(barest)]), "|")
    print(f"\nThe first row took {barest.seconds:.2f} s and {barest.memory / 1e3:.0f} MB, "
          f"and its file has {barest.file / 1e3:.0f} kB.")  # fmt: skip


if __name__ == "__main__":
    main()
