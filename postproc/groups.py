"""Groups of a results file as datasets of xarray, whose arrays are read where they are used.

xarray's own reader (h5netcdf) searches the file for each axis of a dataset: a second for a case
among some hundred. Here axes are found by their addresses.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from .output import readable

#: attributes by which HDF5 joins datasets to their axes
_OF_AXES = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS")


def open_group(path: Path, name: str) -> xr.Dataset:
    """The datasets of one group, with those above it that are their axes."""
    with h5py.File(path) as file:
        group = file[name]
        if not isinstance(group, h5py.Group):
            raise OSError(f"/{name} is not a group")
        axes = _axes(group)
        own = {
            key: _variable(path, item, axes) for key, item in _members(group)
            if isinstance(item, h5py.Dataset)
        }  # fmt: skip
        used = {dim for variable in own.values() for dim in variable.dims}
        above = {
            axis: _variable(path, file[place], axes) for axis, place in axes.values()
            if axis in used and axis not in own
        }  # fmt: skip
        data = xr.Dataset({**above, **own}, attrs=attributes_of(group))
    data.encoding["source"] = str(path)
    return data


def _members(group: h5py.Group) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Names and objects of a group; h5py's own `items` gives None for a damaged object."""
    for name in group:
        try:
            yield name, group[name]
        except KeyError as error:
            raise OSError(f"{group.name.rstrip('/')}/{name}: {error.args[0]}") from error


def _axes(group: h5py.Group) -> dict[int, tuple[str, str]]:
    """Name and place of every scale in a group and those above it, by address."""
    found = {}
    while True:
        for name, item in _members(group):
            if isinstance(item, h5py.Dataset) and item.is_scale:
                found[_address(item)] = (name, item.name)
        if group.name == "/":
            return found
        group = group.parent


def _address(item: h5py.Dataset) -> int:
    return int(h5py.h5o.get_info(item.id).addr)


def _variable(path: Path, item: h5py.Dataset, axes: dict[int, tuple[str, str]]) -> xr.Variable:
    """A dataset with its axes; what it holds stays in the file."""
    if item.is_scale:
        dims = [axes[_address(item)][0]]
    else:
        lists = item.attrs.get("DIMENSION_LIST", ())
        dims = [axes[_address(item.file[scales[-1]])][0] for scales in lists]
    data = indexing.LazilyIndexedArray(_Stored(path, item))
    return xr.Variable(dims, data, attributes_of(item), {"chunksizes": item.chunks})


def attributes_of(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Attributes of a group or dataset, but those that join it to its axes."""
    return {key: _plain(item.attrs[key]) for key in item.attrs if key not in _OF_AXES}


def _plain(value: Any) -> Any:  # noqa: ANN401  (a number, an array or text)
    if isinstance(value, bytes | str):
        return readable(value)
    return value[0] if getattr(value, "shape", ()) == (1,) else value


class _Stored(BackendArray):
    """An array in a file, parts of which are read by opening it."""

    def __init__(self, path: Path, item: h5py.Dataset) -> None:
        self.path, self.name = path, item.name
        self.shape, self.dtype = item.shape, np.dtype(item.dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:  # noqa: ANN401
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER_1VECTOR, self._read
        )

    def _read(self, key: tuple[Any, ...]) -> Any:  # noqa: ANN401
        with h5py.File(self.path) as file:
            return file[self.name][key]
