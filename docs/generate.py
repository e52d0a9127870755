"""Writes the generated halves of docs/scene.md and docs/results.md from what the program says.

    python docs/generate.py build/release/bin/entroslip

A page keeps what stands above its marker; below it stands the scene reference of the program's own
tables, or what is found in results files of small scenes that together ask for everything.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import h5py

DOCS = Path(__file__).resolve().parent
MARKER = "<!-- generated below this line by docs/generate.py -->\n"
PLUMBING = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "units", "long_name", "contents"}

MOTION = """\
&process correlation_length = 0.3 order = 1 mean = 0.2 std = 0.02, 0.03 n_realizations = 1 /
&chain n_dof = 2 /
&excitation variance = 41.1 /
&integration method = 'event' n_steps = 1200 /
&campaign n_samples = 25 /
&output quantities = {quantities} segment_length = 128 /
"""
BAREST = MOTION.format(quantities="'realizations'")
FORCES = """\
&structure
  mass_matrix = 'M.mtx'  stiffness_matrix = 'M.mtx'  joints = 'joints.txt'  load = 'load.txt'
/"""
PROCESS = "&process correlation_length = 0.3 order = 2 mean = 1.0 std = 0.3 {values} /\n"

UNSOLVED = "no solution, or a note"

# what a scene asks for -> the scene; what is in the results of all of a kind is there always
MOTIONS = {"": BAREST} | {
    f"'{name}'": MOTION.format(quantities=f"'{name}'")
    for name in ("slip", "spectrum", "energy", "history", "transitions")
}
MOTIONS["'sine'"] = BAREST.replace("variance = 41.1", "kind = 'sine' frequency = 2.5 amplitude = 3")
MOTIONS["'psd', 'file'"] = BAREST.replace("variance = 41.1", "kind = 'psd' psd = 'psd.txt'")
MOTIONS["`deterministic`"] = BAREST.replace("n_samples = 25", "n_samples = 25 deterministic = t")
MOTIONS["fewer than 25 samples"] = BAREST.replace("n_samples = 25", "n_samples = 2")
MOTIONS["'spectrum', fewer than 25 samples"] = MOTIONS["'spectrum'"].replace("= 25 /", "= 2 /")
HISTORY = MOTIONS["'history'"]
MOTIONS["'history', several forces"] = HISTORY.replace("&chain n_dof = 2 /", FORCES)
MOTIONS |= {
    f"{wish}, `per_sample`": MOTIONS[wish].replace("41.1", "41.1 per_sample = t")
    for wish in ("'history'", "'history', several forces")
}
MOTIONS = {wish: scene + "&accuracy audit = 1.0 /\n" for wish, scene in MOTIONS.items()}
PROCESSES = {
    "'autoregressive'": PROCESS.format(values="positive = f"),
    "'direct'": PROCESS.format(values="positive = f method = 'direct' correlation = 'L1'"),
    "`inversion_half_width`": PROCESS.format(
        values="positive = f method = 'direct' correlation = 'L1' inversion_half_width = 9"
    ),
    "positive": PROCESS.format(values="sampler = 'sequential'"),
    "'realizations'": PROCESS.format(values="positive = f n_realizations = 2"),
    "`order = 0`": PROCESS.format(values="positive = f").replace(
        "order = 2", "order = 0 bound_l1 = 1.0"
    ),
    "`order = 0`, a range": PROCESS.format(values="positive = f").replace(
        "order = 2", "order = 0 bound_l1 = 0.1, 1.0"
    ),
    "`correlation = 'both'`": PROCESS.format(
        values="positive = f correlation = 'both' second_length = 0.3"
    ),
    UNSOLVED: PROCESS.format(values="")
    .replace("order = 2", "order = 1")
    .replace("std = 0.3", "std = 2.0, 0.3"),
}

TRADEOFF = {"": MOTION.format(quantities="'slip', 'spectrum'")}
FILES = {
    "psd.txt": "0.0 1.0\n2.5 2.0\n",
    "load.txt": "1 0\n0 1\n",
    "M.mtx": "%%MatrixMarket matrix array real general\n2 2\n1\n0\n0\n1\n",
    "joints.txt": "1 0 50 10 0.2\n2 0 50 10 0.2\n",
}

# attributes have no long_name of their own; one that is not explained here stops the generator
ATTRIBUTES = {
    "n_zero_modes": "rigid motions that no spring holds, with all joints stuck",
    "command": "command that wrote the file: run, replay or tradeoff",
    "architecture": "instruction set and compiler, on which the samples depend",
    "band_ratio": "largest relative numerical error of a band ratio",
    "bound_l0": "bound on L0",
    "bound_l1": "bound on L1",
    "second_length": "correlation = 'both': the L1 imposed beside L0 [points]",
    "upper_bound": "upper end of a range that begins at bound_l0 or bound_l1 [points]",
    "bound_side": "side of the bound; automatic: upper for L1, lower for L0",
    "compiler": "name and version of the compiler",
    "correlation": "imposed length: 'L0' (Eq. 8), 'L1' (Eq. 9) or 'both'",
    "correlation_length": "imposed length [lags]",
    "created": "time when the file was finished, UTC",
    "detrending": "what is removed from a segment before its transform",
    "direct_seconds": "CPU time of the direct method, beside `inversion_seconds`",
    "estimator": "estimator of the statistics in this group: 'pooled', 'regression' or 'plain'",
    "duration": "measured time of the march, beyond integration%n_discard [s]",
    "every": "step between displacements that enter the spectra",
    "fingerprint": "fingerprint of all values of the scene that change a sample",
    "flags": "flags of the compiler",
    "folded_share": "largest share of the power that thinning folds below the highest frequency",
    "format_version": "version of the layout described here",
    "friction_from": "where the friction of a deterministic case comes from",
    "git_commit": "commit of the program's source",
    "inversion_half_width": "M of Eq. 35, the paper's inversion of 2M + 1 points",
    "inversion_seconds": "CPU time of that inversion",
    "law": "'maximum entropy', 'independent', 'fully correlated' or 'given values'",
    "max_order": "largest order that the search tries",
    "mean": "wanted mean",
    "method": "method as in the scene; of an audit: the reference method",
    "method_meanings": "meanings of the numbers in `method`",
    "n_steps": "steps marched in each setting",
    "n_consistent": "sign sequences found to be solutions; 0: not counted",
    "n_examined": "sign sequences examined",
    "n_ranks": "ranks of the last run that wrote to the file",
    "n_samples": "samples of the case",
    "n_segments": "Welch segments of a sample",
    "psd_time_error": "relative time-average error of a density at one frequency",
    "order": "M, or m_max of the direct method",
    "overlap": "overlap of neighbouring segments [kept displacements]",
    "branch": "signs of K(m): nonnegative, alternating or mixed",
    "branch_asked": "branch asked for in the scene",
    "sign_of_first_lag": "sign of K(1)",
    "overrides": "the --set options",
    "plain_reason": "why the estimates are those of plain sampling",
    "positive": "1: with a positivity constraint",
    "process": "pNNN, or none where the friction is given",
    "program": "entroslip",
    "fit_seconds": "CPU time of the fit",
    "memory": "lags after which a value is forgotten, to 1e-9",
    "order_found": "order of the recursion: given, chosen, or a lower one (see `reason`)",
    "reason": "why no solution, a lower order, or no search of a branch to its end",
    "reference": "reference of the errors",
    "sampler": "law of a positive process: 'sequential' or 'exact'",
    "scene": "text of the scene",
    "search": "how the signs were found",
    "seed": "seed of all random streams",
    "segment_length": "length of a Welch segment [kept displacements]",
    "settings": "all values of the scene that change a sample, one a line",
    "sided": "one: the density is over positive frequencies",
    "status": "'solved' or 'infeasible'",
    "simulation": "how values are drawn: 'stationary', 'from_rest' or 'matrix'",
    "slip_points": "largest numerical error of a slip fraction [percentage points]",
    "std": "wanted standard deviation",
    "tolerance": "tolerance of the reference",
    "time_average_method": "how time-average errors of slip fractions are found",
    "title": "title of the scene",
    "amplitude": "amplitude of the sine [N]",
    "factor": "factor of the force from a file or of a given spectrum",
    "frequency": "frequency of the sine [Hz]",
    "variance": "variance of noise in a band [N^2]; else 0",
    "version": "version of the program, with its commit",
    "wall_seconds": "wall time of the last run that wrote to the file",
    "window": "window of a Welch segment",
}


@dataclass(frozen=True)
class Entry:
    """One dataset or attribute, as a results file describes it."""

    name: str
    shape: str
    kind: str
    unit: str
    meaning: str

    def order(self) -> tuple[bool, str, str]:
        """Attributes come first."""
        return self.shape != "attribute", self.name.lower(), self.meaning


Found = dict[Entry, list[str]]  # an entry, and what was asked for where it was found


def kind_of(value: object) -> str:
    """Name of a value in the tables."""
    kind = getattr(value, "dtype", None)
    if kind is None or kind.kind in "SO":
        return "text"
    return "integer" if kind.kind in "iu" else "real"


def explained(attribute: str) -> str:
    """Its meaning, which must be among those written down here."""
    if attribute in ATTRIBUTES:
        return ATTRIBUTES[attribute]
    if attribute.endswith("_method"):  # their value is the explanation
        return f"how {attribute.removesuffix('_method')} is found"
    raise SystemExit(f"docs/generate.py: ATTRIBUTES does not explain '{attribute}'")


def entries(group: h5py.Group) -> list[Entry]:
    """Attributes first, then the datasets; axes are named by their scales."""
    found = [
        Entry(name, "attribute", kind_of(value), "", explained(name))
        for name, value in group.attrs.items()
        if name not in PLUMBING
    ]
    for name, item in group.items():
        if isinstance(item, h5py.Dataset):
            axes = [scales.keys()[0] for scales in item.dims if len(scales)]
            is_axis = item.attrs.get("CLASS") == b"DIMENSION_SCALE"
            shape = f"axis `{name}`" if is_axis else f"({', '.join(axes)})" if axes else "number"
            labels = [str(item.attrs[key]) for key in ("units", "long_name")]
            found.append(Entry(name, shape, kind_of(item), *labels))
    return found


def groups_in(group: h5py.Group) -> list[tuple[str, h5py.Group]]:
    """It and all groups below it, by path."""
    below = [item for item in group.values() if isinstance(item, h5py.Group)]
    return [(group.name, group), *(found for item in below for found in groups_in(item))]


def run(program: Path, command: str, scene: str, folder: Path) -> Path:
    """The results file of a scene."""
    (folder / "scene.nml").write_text(scene)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "results.h5").unlink(missing_ok=True)
    words = [program, command, "scene.nml", "--quiet", "--output", "results.h5"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{scene}\n{done.stdout}{done.stderr}")
    return folder / "results.h5"


def results_of(program: Path, command: str, scenes: dict[str, str]) -> dict[str, Found]:
    """Each group of the results, its name the same for all of its kind, with its entries."""
    found: dict[str, Found] = {}
    with tempfile.TemporaryDirectory() as folder:
        for wish, scene in scenes.items():
            with h5py.File(run(program, command, scene, Path(folder))) as file:
                for name, group in groups_in(file):
                    if re.search(r"[pc]\d{3}", name) and not re.search(r"[pc]001", name):
                        continue
                    kind = re.sub(r"([pc])001", r"\1NNN", name)
                    for entry in entries(group):
                        found.setdefault(kind, {}).setdefault(entry, []).append(wish)
    return found


def table(found: Found, n_scenes: int) -> str:
    """Markdown; the last column is empty for what is there always, or for every solution."""
    lines = ["| name | shape | type | unit | meaning | there with |", "|---|---|---|---|---|---|"]
    for entry, wishes in sorted(found.items(), key=lambda item: item[0].order()):
        n_least = n_scenes if UNSOLVED in wishes else n_scenes - 1
        shortest = [
            one for one in wishes
            if not any(one.startswith(f"{two},") or one.endswith(f", {two}") for two in wishes)
        ]  # fmt: skip
        when = "" if len(wishes) >= n_least or "" in wishes else ", ".join(shortest)
        cells = [f"`{entry.name}`", entry.shape, entry.kind, entry.unit, entry.meaning, when]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def scene_page(program: Path) -> str:
    """Below the marker of docs/scene.md."""
    command = [program, "template", "--reference"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def results_page(program: Path) -> str:
    """Below the marker of docs/results.md."""
    processes = results_of(program, "run", PROCESSES)
    motions = results_of(program, "run", MOTIONS)
    tradeoff = results_of(program, "tradeoff", TRADEOFF)
    chosen = {name: (motions[name], MOTIONS) for name in ("/", "/structure", "/campaign/cNNN")}
    chosen |= {
        f"/campaign/cNNN/{name}": (motions[f"/campaign/cNNN/{name}"], MOTIONS)
        for name in ("audit", "plain", "error_ratio")
    }
    chosen["/process/pNNN"] = processes["/process/pNNN"], PROCESSES
    chosen |= {
        name: (found, TRADEOFF) for name, found in tradeoff.items() if name.startswith("/tradeoff")
    }
    return "".join(
        f"\n## {name}\n\n{table(found, len(scenes))}"
        for name, (found, scenes) in sorted(chosen.items())
    )


def pages(program: Path) -> dict[Path, str]:
    """Each generated page as it should be."""
    made = {"scene.md": scene_page, "results.md": results_page}
    return {
        DOCS / name: (DOCS / name).read_text().partition(MARKER)[0] + MARKER + make(program)
        for name, make in made.items()
    }


if __name__ == "__main__":
    for path, text in pages(Path(sys.argv[1]).resolve()).items():
        path.write_text(text)
