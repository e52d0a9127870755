"""The same bits: two results files of one scene agree in all that the scene decides.

Ranks, threads, members that share a run, and interruptions must not matter. Facts about the run
itself may differ: when it ended, its ranks, the times it took.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

_OF_THE_RUN = ("created", "n_ranks")
_TIME = "_seconds"  # ends the name of every time that a run took
_REFERENCES = ("DIMENSION_LIST", "REFERENCE_LIST")  # addresses within the file


def is_of_the_run(attribute: str) -> bool:
    """True if an attribute is about the run and not about the scene."""
    return attribute in _OF_THE_RUN or attribute.endswith(_TIME)


def scene_bits(path: Path) -> dict[str, bytes]:
    """Bytes of every dataset (`group/name`) and attribute (`group/name@attribute`) of the scene."""
    found: dict[str, bytes] = {}

    def take(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = item[()].tobytes()
        for key, value in item.attrs.items():
            if key not in _REFERENCES and not is_of_the_run(key):
                found[f"{name}@{key}"] = np.asarray(value).tobytes()

    with h5py.File(path) as file:
        take("", file)
        file.visititems(take)
    return found


def differences(path: Path, other: Path) -> list[str]:
    """Names of datasets and attributes of the scene that differ, or that one file has not."""
    ours, theirs = scene_bits(path), scene_bits(other)
    return sorted(name for name in ours.keys() | theirs if ours.get(name) != theirs.get(name))
