"""Writes a structure for `&structure` of a scene: from other programs' matrices, or a few numbers.

python -m entroslip.structure import --mass beam.mat:M --stiffness beam.mat:K --joint 5 --out beam
python -m entroslip.structure ring --blades 24 --scatter 0.05 --seed 1 --out ring
python -m entroslip.structure chain --masses 5 --out chain
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from shlex import quote

import numpy as np

from ..output import InputError, Parser, exit_code, say
from . import generators
from .files import read_pair
from .pair import Pair, frequencies, massless, require_mass, require_stiffness, total_mass
from .reduction import condensed, craig_bampton
from .scene import Joint, SceneOptions, load_of, read_process, stuck, write_scene

_SHOWN = 10  # frequencies
_LEAST_HZ = 1.0e-3  # of the last frequency shown; below it M and K are probably exchanged
_RIGHT = 0.01  # relative error of a frequency
_DEFAULT = "default: %(default)s"


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, reduce, print, write; exit code 2 for bad input, 3 for what cannot be written."""

    def work() -> None:
        options = _parser().parse_args(arguments)
        whole, pair, joints = options.make(options)
        load_of(pair, options.force)
        require_mass(pair)
        n_rigid = require_stiffness(pair)
        for line in _described(whole, pair, joints, n_rigid):
            say(line)
        if options.out is None:
            return
        scene = SceneOptions(
            options.title or options.out.name, options.damping_ratio,
            tuple(options.rayleigh) if options.rayleigh else None, tuple(options.force),
            read_process(options.process) if options.process else None,
        )  # fmt: skip
        if not options.force:
            say(f"force: on dof {pair.last()}, the last; --force DOF for another")
        paths = write_scene(options.out, pair, joints, scene, options.replace)
        say(f"{options.out}: {', '.join(path.name for path in paths)}")
        what = "values" if joints else "joints, one a line,"
        say(f"next: put your {what} into joints.txt, then entroslip check {quote(str(paths[-1]))}")

    return exit_code(work)


def _described(whole: Pair, pair: Pair, joints: Sequence[Joint], n_rigid: int) -> list[str]:
    """Sizes, masses of the whole as it was read, rigid modes and frequencies."""
    lines = [f"{pair.n_dof} dofs, joints: {len(joints)}"]
    lines += [f"mass, {what}: {mass:.6g}" for what, mass in total_mass(whole).items()]
    lines.append(f"rigid modes without joints: {n_rigid}")
    free = frequencies(pair, _SHOWN)
    lines.append(f"frequencies without joints [Hz]: {_listed(free)}")
    if 0.0 < free[-1] < _LEAST_HZ:
        lines.append("note: these frequencies are very low: are --mass and --stiffness exchanged?")
    if joints:
        if any(joint.stiffness is None for joint in joints):
            lines.append("stiffness of the joints: an example, that of K at their dofs")
        held = frequencies(stuck(pair, joints), _SHOWN)
        lines.append(f"frequencies with all joints stuck [Hz]: {_listed(held)}")
    return lines


def _listed(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _imported(options: argparse.Namespace) -> tuple[Pair, Pair, list[Joint]]:
    """A pair of files, as read and as condensed or reduced, and its joints."""
    whole = pair = read_pair(options.mass, options.stiffness, options.damping)
    for note in pair.notes:
        say(note)
    named = [*options.keep, *(dof for pair_of in options.joint for dof in pair_of if dof),
             *(dof for dof, _ in options.force)]  # fmt: skip
    if options.condense:
        for i in massless(pair):
            if pair.labels[i] in named:
                raise InputError(
                    f"dof {pair.labels[i]}: has no mass and goes with --condense; joints, forces"
                    " and --keep need one that has"
                )
        pair = condensed(pair)
        say(f"condensed: {whole.n_dof} dofs to {pair.n_dof}")
    joints = [_joint(a, b, options) for a, b in options.joint]
    if options.modes is not None:
        full, pair = pair, craig_bampton(pair, list(dict.fromkeys(named)), options.modes)
        say(f"reduced: {full.n_dof} dofs to {pair.n_dof}, {options.modes} of them modes")
        say(_kept(full, pair))
    elif options.keep:
        raise InputError("--keep: needs --modes, how many modes of the other dofs are kept")
    return whole, pair, joints


def _kept(full: Pair, small: Pair) -> str:
    """Sentence: the number of frequencies of the reduced pair that are those of the full one."""
    ours = frequencies(small, small.n_dof)
    full = condensed(full) if massless(full).size else full
    exact = frequencies(full, ours.size)
    is_off = abs(ours - exact) > _RIGHT * exact
    n_right = int(is_off.argmax()) if is_off.any() else ours.size
    text = f"frequencies within {_RIGHT:.0%}: the lowest {n_right} of {ours.size}"
    return text + (f", up to {exact[n_right - 1]:.6g} Hz" if n_right else "")


def _ring(options: argparse.Namespace) -> tuple[Pair, Pair, list[Joint]]:
    pair = generators.ring(
        options.blades, options.blade_mass, options.blade_stiffness, options.coupling,
        options.scatter, options.seed,
    )  # fmt: skip
    joints = []
    if options.joints in ("ground", "both"):
        joints += [_joint(label, None, options) for label in pair.labels]
    if options.joints in ("blades", "both"):
        following = [*pair.labels[1:], pair.labels[0]]
        joints += [_joint(a, b, options) for a, b in zip(pair.labels, following, strict=True)]
    return pair, pair, joints


def _chain(options: argparse.Namespace) -> tuple[Pair, Pair, list[Joint]]:
    pair = generators.chain(options.masses, options.mass, options.coupling)
    return pair, pair, [_joint(label, None, options) for label in pair.labels]


def _joint(a: str, b: str | None, options: argparse.Namespace) -> Joint:
    return Joint(a, b, options.joint_stiffness, options.normal_load, options.friction)


def _parser() -> Parser:
    parser = Parser(
        prog="python -m entroslip.structure", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    commands = parser.add_subparsers(required=True, metavar="import | ring | chain")
    add = commands.add_parser("import", help="M and K of another program, reduced if asked")
    add.add_argument(
        "--mass", required=True, metavar="FILE[:NAME]",
        help=".mat, .npy, .npz, Matrix Market, rows of text, Abaqus text, Nastran DMIG or OP4,"
        " Ansys HBMAT text",
    )  # fmt: skip
    add.add_argument("--stiffness", required=True, metavar="FILE[:NAME]", help="without the joints")
    add.add_argument(
        "--joint", nargs="+", action="extend", default=[], type=_two_dofs, metavar="A[,B]",
        help="joints, each from dof A to dof B or to the ground",
    )  # fmt: skip
    add.add_argument(
        "--keep", nargs="+", action="extend", default=[], metavar="DOF", help="other kept dofs"
    )
    add.add_argument(
        "--modes", type=int, metavar="N",
        help="Craig-Bampton: keep the dofs of joints and forces, and N modes of the others",
    )  # fmt: skip
    add.add_argument("--condense", action="store_true", help="remove the dofs without mass")
    damping = _add_common(add, stiffness=None)
    damping.add_argument(
        "--damping", metavar="FILE[:NAME]", help="viscous damping; default: a ratio"
    )
    add.set_defaults(make=_imported)
    ring = commands.add_parser("ring", help="blades on a disk, each coupled to its neighbours")
    ring.add_argument("--blades", type=int, required=True)
    ring.add_argument("--blade-mass", type=_positive, default=1.0, help=_DEFAULT)
    ring.add_argument("--blade-stiffness", type=_positive, default=25.0, help=f"mean; {_DEFAULT}")
    ring.add_argument("--scatter", type=_not_negative, default=0.0, help="std over mean of it")
    ring.add_argument("--seed", type=int, default=1, help="of the scatter")
    ring.add_argument("--coupling", type=_not_negative, default=5.0, help=_DEFAULT)
    ring.add_argument("--joints", choices=("ground", "blades", "both"), default="ground")
    _add_common(ring, stiffness=50.0)
    ring.set_defaults(make=_ring)
    chain = commands.add_parser("chain", help="the paper's chain with any number of masses")
    chain.add_argument("--masses", type=int, required=True)
    chain.add_argument("--mass", type=_positive, default=1.0, help=_DEFAULT)
    chain.add_argument("--coupling", type=_not_negative, default=25.0, help=_DEFAULT)
    _add_common(chain, stiffness=50.0)
    chain.set_defaults(make=_chain)
    return parser


def _add_common(
    parser: argparse.ArgumentParser, stiffness: float | None
) -> argparse._MutuallyExclusiveGroup:
    """Add the options of all commands; return the group of those of damping."""
    add = parser.add_argument
    add("--out", type=Path, metavar="FOLDER", help="what is written; without it: checks alone")
    add("--replace", action="store_true", help="write over the files of FOLDER, joints.txt too")
    add("--title", default="", help="of the scene; default: the folder's name")
    add("--joint-stiffness", type=_positive, default=stiffness,
        help=f"in each line of joints.txt; default: {stiffness or 'K at its dof'}")  # fmt: skip
    add("--normal-load", type=_not_negative, default=10.0, help=f"likewise; {_DEFAULT}")
    add("--friction", type=_not_negative, default=0.2, help=f"likewise; {_DEFAULT}")
    add("--process", type=Path, metavar="FILE",
        help="a scene whose &process is taken, as estimate writes it")  # fmt: skip
    add("--force", nargs="+", action="extend", default=[], type=_factor, metavar="DOF[=FACTOR]",
        help="where the force acts; default: the last dof")  # fmt: skip
    damping = parser.add_mutually_exclusive_group()
    damping.add_argument("--damping-ratio", type=_not_negative, default=0.005, help="of every mode")
    damping.add_argument(
        "--rayleigh", type=_not_negative, nargs=2, metavar=("ALPHA", "BETA"),
        help="C = ALPHA M + BETA K",
    )  # fmt: skip
    return damping


def _two_dofs(text: str) -> tuple[str, str | None]:
    a, _, b = text.partition(",")
    return a.strip(), b.strip() or None


def _factor(text: str) -> tuple[str, float]:
    """'5' or '5=0.5'."""
    dof, sign, factor = text.partition("=")
    try:
        return dof.strip(), float(factor) if sign else 1.0
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: must be DOF or DOF=FACTOR") from None


def _positive(text: str) -> float:
    value = _not_negative(text)
    if value == 0.0:
        raise argparse.ArgumentTypeError(f"{text}: must be positive")
    return value


def _not_negative(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: must be a number") from None
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text}: must be zero or positive")
    return value


if __name__ == "__main__":
    sys.exit(main())
