"""Structures for `&structure`: mass and stiffness from other programs, reduced, checked, written.

>>> pair = read_pair("beam.mat:M", "beam.mat:K")
>>> small = craig_bampton(pair, ["15"], n_modes=8)
>>> write_scene(Path("beam"), small, [Joint("15")], SceneOptions("a beam"))
"""

from .files import read_pair
from .generators import chain, ring
from .pair import Pair
from .reduction import craig_bampton
from .scene import Joint, SceneOptions, write_scene

__all__ = [
    "Joint",
    "Pair",
    "SceneOptions",
    "chain",
    "craig_bampton",
    "read_pair",
    "ring",
    "write_scene",
]
