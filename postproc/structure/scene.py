"""A folder that runs: M.mtx, K.mtx, joints.txt, perhaps C.mtx and load.txt, and scene.nml."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..output import InputError, read_text, write_file
from .pair import Matrix, Pair, frequencies

_GROUND = 0  # dof_b of a joint to the ground
_TOP_MODE = 6  # the noise reaches beyond this mode of the structure with all joints stuck
_BEYOND = 1.2  # times its frequency
_STEPS_A_PERIOD = 8  # of the highest frequency of the noise
_N_STEPS, _SEGMENT = 40_000, 4096
_OVER_LIMIT = 2.0  # rms of the example's force over the slip limit mu N of a joint
_MOST_NAMED = 60  # dofs that joints.txt lists, and whose spectra a scene keeps
_PROCESS = re.compile(  # the / of a group stands neither in quotes nor in a comment
    r"""^[ \t]*(&process\b(?:'[^']*'|"[^"]*"|![^\n]*|[^/'"!])*/)""", re.MULTILINE | re.IGNORECASE
)


@dataclass(frozen=True)
class Joint:
    """A friction joint between two dofs, or from a dof to the ground."""

    dof_a: str
    dof_b: str | None = None  # None: the ground
    stiffness: float | None = None  # None: the diagonal of K at dof_a, as an example
    normal_load: float = 10.0
    friction: float = 0.2


@dataclass(frozen=True)
class SceneOptions:
    """Values of the scene beside the structure."""

    title: str
    damping_ratio: float = 0.005  # of every mode; unused where the pair has C or rayleigh is given
    rayleigh: tuple[float, float] | None = None  # alpha, beta of C = alpha M + beta K
    forces: tuple[tuple[str, float], ...] = ()  # dof and factor; none: the last dof
    process: str | None = None  # text of &process; none: an example


def read_process(path: Path) -> str:
    """The group &process of a file, from & to /."""
    found = _PROCESS.findall(read_text(path))
    if len(found) != 1:
        raise InputError(f"{path}: must have one &process, has {len(found)}")
    return str(found[0])


def write_scene(
    folder: Path, pair: Pair, joints: Sequence[Joint], options: SceneOptions, replace: bool = False
) -> list[Path]:
    """Write the files; those that are there are refused, for joints.txt is filled by hand."""
    texts = {
        f"{name}.mtx": _matrix_market(name, matrix) for name, matrix in pair.matrices().items()
    }
    joints = [_completed(pair, joint) for joint in joints]
    texts["joints.txt"] = _joints_text(pair, joints)
    if not _is_single(options):
        texts["load.txt"] = _load_text(pair, options)
    texts["scene.nml"] = _scene_text(pair, joints, options)
    there = [name for name in texts if (folder / name).exists()]
    if there and not replace:
        raise InputError(f"{folder / there[0]}: exists; --replace writes it anew")
    for name, text in texts.items():
        write_file(folder / name, text.encode())
    return [folder / name for name in texts]


def stuck(pair: Pair, joints: Sequence[Joint]) -> Pair:
    """The pair with the springs of all joints: K_s = K + sum of k_j w_j w_j'."""
    joints = [_completed(pair, joint) for joint in joints]
    directions = sp.lil_array((pair.n_dof, len(joints)))
    for j, joint in enumerate(joints):
        directions[pair.position(joint.dof_a), j] = 1.0
        if joint.dof_b is not None:
            directions[pair.position(joint.dof_b), j] = -1.0
    springs = sp.diags_array([float(joint.stiffness or 0.0) for joint in joints])
    directions = directions.tocsc()
    added = sp.csc_array(directions @ springs @ directions.T) if joints else 0.0 * pair.stiffness
    return Pair(pair.mass, sp.csc_array(pair.stiffness + added), pair.labels, pair.damping)


def _completed(pair: Pair, joint: Joint) -> Joint:
    """The joint with a stiffness: as given, or that of the structure at the dof."""
    a = pair.position(joint.dof_a)
    if joint.dof_b is not None and pair.position(joint.dof_b) == a:
        raise InputError(f"joint {joint.dof_a},{joint.dof_b}: must join two dofs")
    stiffness = joint.stiffness or float(f"{pair.stiffness[a, a]:.3g}")
    if not stiffness > 0.0:
        raise InputError(f"joint {joint.dof_a}: --joint-stiffness must be given, K is zero there")
    return Joint(joint.dof_a, joint.dof_b, stiffness, joint.normal_load, joint.friction)


def _matrix_market(name: str, matrix: Matrix) -> str:
    """The lower triangle, column by column, to the last digit."""
    lower = sp.csc_array(sp.tril(matrix))
    lower.eliminate_zeros()
    lower.sort_indices()
    entries = lower.tocoo()
    lines = [
        "%%MatrixMarket matrix coordinate real symmetric",
        f"% {name}, lower triangle, written by python -m entroslip.structure",
        f"{lower.shape[0]} {lower.shape[1]} {lower.nnz}",
        *(
            f"{i + 1} {j + 1} {value:.17g}"
            for i, j, value in zip(entries.row, entries.col, entries.data, strict=True)
        ),
    ]
    return "\n".join(lines) + "\n"


def _joints_text(pair: Pair, joints: Sequence[Joint]) -> str:
    lines = [
        "# Friction joints, one a line. EXAMPLE values: put in your own.",
        "#   dof_a dof_b     the joint acts on x(dof_a) - x(dof_b); dof_b = 0 is the ground",
        "#   stiffness       of the joint while it sticks [N/m]",
        "#   normal_load     N, what presses it together [N]",
        "#   friction        mu of deterministic runs; the joint slips at the force mu N",
        "#   friction_point  optional: the point of the friction process whose value it takes;",
        "#                   without it the number of the line",
    ]
    if any(label != str(i + 1) for i, label in enumerate(pair.labels)):
        lines.append("# Numbers of the dofs (node:dof of the model they come from):")
        named = enumerate(pair.labels[:_MOST_NAMED], start=1)
        lines += [f"#   {number} is {label}" for number, label in named]
        if pair.n_dof > _MOST_NAMED:
            lines.append(f"#   ... {pair.n_dof} in all, in the order of nodes and their dofs")
    lines.append("# dof_a dof_b stiffness normal_load friction")
    for joint in joints:
        a = pair.position(joint.dof_a) + 1
        b = _GROUND if joint.dof_b is None else pair.position(joint.dof_b) + 1
        lines.append(f"{a} {b} {joint.stiffness:.6g} {joint.normal_load:g} {joint.friction:g}")
    return "\n".join(lines) + "\n"


def _is_single(options: SceneOptions) -> bool:
    """True if the force acts on one dof as it is."""
    return len(options.forces) == 0 or (len(options.forces) == 1 and options.forces[0][1] == 1.0)


def load_of(pair: Pair, forces: Sequence[tuple[str, float]]) -> NDArray[np.float64]:
    """Factor of the force on each dof; no force at all is refused."""
    load = np.zeros(pair.n_dof)
    for label, factor in forces:
        load[pair.position(label)] += factor
    if forces and not (load.any() and np.isfinite(load).all()):
        raise InputError("--force: its factors must be finite, and not zero on every dof")
    return load


def _load_text(pair: Pair, options: SceneOptions) -> str:
    rows = [f"{factor:.17g}" for factor in load_of(pair, options.forces)]
    return "\n".join(["# factor of the force on each dof, one a line", *rows]) + "\n"


def _scene_text(pair: Pair, joints: Sequence[Joint], options: SceneOptions) -> str:
    title = options.title.replace("'", "''")
    hertz = frequencies(stuck(pair, joints), _TOP_MODE)
    top = _two_digits(_BEYOND * float(hertz[-1])) if hertz[-1] > 0.0 else 1.0
    limits = [joint.friction * joint.normal_load for joint in joints] or [1.0]
    variance = _two_digits((_OVER_LIMIT * float(np.median(limits)) or 1.0) ** 2)
    structure = ["mass_matrix = 'M.mtx'", "stiffness_matrix = 'K.mtx'  ! without the joints"]
    if pair.damping is not None:
        structure.append("damping_matrix = 'C.mtx'")
    elif options.rayleigh is not None:
        structure.append("rayleigh = {}, {}  ! C = alpha M + beta K".format(*options.rayleigh))
    else:
        structure.append(f"damping_ratio = {options.damping_ratio}  ! of every mode, joints stuck")
    structure.append("joints = 'joints.txt'")
    force = [
        "kind = 'band_limited'",
        f"band = 0.0, {top:g}  ! [Hz] EXAMPLE: reaches beyond mode {hertz.size}",
        f"variance = {variance:g}  ! [N^2] EXAMPLE",
    ]
    if _is_single(options):
        label = options.forces[0][0] if options.forces else pair.last()
        force.append(f"dof = {pair.position(label) + 1}")
    else:
        structure.append("load = 'load.txt'  ! factor of the force on each dof")
    mean = float(np.mean([joint.friction for joint in joints] or [0.0])) or 0.2
    groups = {
        "scene": [f"title = '{title}'"],
        "process": [
            "correlation_length = 1.0  ! [points] EXAMPLE: from joint to joint",
            "order = 5",
            f"mean = {mean:.6g}  ! of the friction coefficients, EXAMPLE",
            f"std = {0.25 * mean:.6g}  ! EXAMPLE",
        ],
        "structure": structure,
        "excitation": force,
        "integration": [
            "method = 'event'",
            f"dt = {_two_digits(1.0 / (_STEPS_A_PERIOD * top)):g}  ! [s]",
            f"n_steps = {_N_STEPS}",
        ],
        "campaign": [
            "n_samples = 100",
            "deterministic = .true.  ! also with the friction of joints.txt",
        ],
        "output": [f"segment_length = {_SEGMENT}"],
    }
    named = {dof for joint in joints for dof in (joint.dof_a, joint.dof_b) if dof is not None}
    named |= {dof for dof, _ in options.forces} or {pair.last()}
    if pair.n_kept < pair.n_dof:
        kept = ", ".join(map(str, range(1, pair.n_kept + 1)))
        groups["output"].append(f"dofs = {kept}  ! without the modes of the reduction")
    elif pair.n_dof > _MOST_NAMED and len(named) < pair.n_dof:
        kept = ", ".join(str(i + 1) for i in sorted(map(pair.position, named)))
        groups["output"].append(f"dofs = {kept}  ! of joints and forces; 0: all")
    sizes = f"{pair.n_dof} dofs, joints: {len(joints)}"
    parts = [f"! {options.title}: {sizes}. Put your own values where EXAMPLE stands."]
    for name, lines in groups.items():
        if name == "process" and options.process is not None:
            parts.append(options.process)
            continue
        parts.append("\n".join([f"&{name}", *map(_aligned, lines), "/"]))
    return "\n\n".join(parts) + "\n"


def _aligned(line: str) -> str:
    """A line of a group, its comment at one column."""
    value, mark, comment = line.partition("  ! ")
    return f"   {value:<34} ! {comment}" if mark else f"   {value}"


def _two_digits(value: float) -> float:
    """Rounded down to two significant digits."""
    step = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{floor(value / step + 1.0e-9) * step:.6g}")
