"""A results file as labelled data.

>>> results = open_results("paper.h5")
>>> results.cases[0].data["slip_fraction"]  # an xarray.DataArray with axes, units and long_name
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import h5py
import numpy as np
import xarray as xr

from .groups import attributes_of, open_group
from .output import InputError, readable
from .processes import MAXIMUM_ENTROPY, imposed_lengths

#: transitions of a sample whose joints stick, springs of a free body, dampers of none
_MAY_BE_EMPTY = ("transition", "stiffness_entry", "damping_entry")
_FORMAT_VERSION = 3  # of the layout, as in src/io/identity.f90


class ResultsError(InputError):
    """The file is not a results file, or not one that this version reads."""


@dataclass(frozen=True, repr=False)
class Case:
    """One case of the campaign: a process (or none) under one excitation."""

    name: str  # c001
    data: xr.Dataset  # read from the file as it is used
    audit: xr.Dataset | None = None  # its samples that the reference repeated, where it was asked
    asked: Mapping[Hashable, object] = field(default_factory=dict)  # of its process
    is_base: bool = False  # the force is an acceleration of the ground

    def __repr__(self) -> str:
        """Short: what it is a case of."""
        samples = f"{self.n_samples} sample{'s' if self.n_samples > 1 else ''}"
        return f"<{self.name}: process {self.process}, {self.force}, {samples}>"

    @property
    def process(self) -> str:
        """Name of the process, or 'none'."""
        return str(self.data.attrs.get("process", "none"))

    @property
    def is_deterministic(self) -> bool:
        """True if the friction is given, in one sample."""
        return self.process == "none"

    @property
    def variance(self) -> float:
        """Variance of noise in a band [N^2]; else 0."""
        return float(self.data.attrs.get("variance", 0.0))

    @property
    def is_sine(self) -> bool:
        """True if the force is a sine."""
        return "amplitude" in self.data.attrs

    @property
    def frequency(self) -> float:
        """Frequency of the sine [Hz]."""
        return float(self.data.attrs.get("frequency", 0.0))

    @property
    def strength(self) -> float:
        """Level of the force as a number: an amplitude, a factor or a variance."""
        names = ("amplitude", "factor", "variance")
        return next((float(self.data.attrs[n]) for n in names if n in self.data.attrs), 0.0)

    @property
    def level(self) -> str:
        """Level of the force in words."""
        if "factor" in self.data.attrs:
            return f"force factor {self.strength:g}"
        level = f"{self.strength:g} {self.force_unit}"
        return level if self.is_sine else f"variance {level}"

    @property
    def force_unit(self) -> str:
        """Unit of the level of the force: of an amplitude or a variance."""
        if self.is_sine:
            return "m/s²" if self.is_base else "N"
        return "m²/s⁴" if self.is_base else "N²"

    @property
    def force(self) -> str:
        """Force in words: its level, and the frequency of a sine."""
        return f"{self.level} at {self.frequency:g} Hz" if self.is_sine else self.level

    @property
    def given_friction(self) -> str:
        """Friction coefficients of a deterministic case, and their place in the scene."""
        values = self.data["friction"].values
        some = f"{values.min():g}"
        if values.max() > values.min():
            some = f"from {some} to {values.max():g}"
        return f"friction {some} ({self.data.attrs['friction_from']})"

    @property
    def std(self) -> float:
        """Standard deviation of the friction coefficients."""
        return float(self.data.attrs.get("std", 0.0))

    @property
    def law(self) -> str:
        """Law of the friction coefficients."""
        return str(self.asked.get("law", MAXIMUM_ENTROPY))

    @property
    def lengths(self) -> str:
        """Imposed correlation lengths with their names; L0 if the file has none."""
        default = {"correlation": "L0", "correlation_length": self.correlation_length}
        return imposed_lengths(default | dict(self.asked))

    @property
    def correlation_length(self) -> float:
        """Imposed correlation length of the friction coefficients [lags]."""
        return float(self.data.attrs.get("correlation_length", 0.0))

    @property
    def friction(self) -> str:
        """Law of the friction in words."""
        if self.is_deterministic:
            return "deterministic friction"
        if self.law == MAXIMUM_ENTROPY:
            return f"std {self.std:g}, {self.lengths}"
        return f"std {self.std:.3g}, {self.law}"

    @property
    def label(self) -> str:
        """Friction and force in words: the name of the case in tables and figures."""
        return f"{self.friction}, {self.force}"

    @property
    def duration(self) -> float:
        """Duration of the march that is measured [s]."""
        return float(self.data.attrs["duration"])

    @property
    def n_dof(self) -> int:
        """Degrees of freedom: oscillators of a chain."""
        return int(self.data.sizes["dof"])

    @property
    def kept_dofs(self) -> list[int]:
        """Numbers of the dofs whose spectra and histories the scene asked for."""
        return self.data.attrs.get("kept_dofs", list(range(1, self.n_dof + 1)))

    @property
    def keeps_all_dofs(self) -> bool:
        """True if spectra and histories are those of every dof."""
        return len(self.kept_dofs) == self.n_dof

    @property
    def n_joints(self) -> int:
        """Joints: of a chain one for each oscillator."""
        return int(self.data.sizes.get("joint", 0))

    @property
    def n_samples(self) -> int:
        """Samples that the file holds."""
        return int(self.data.sizes.get("sample", 1))

    @property
    def plain(self) -> xr.Dataset | None:
        """Statistics by plain sampling; None if the best estimates are plain themselves."""
        source = self.data.encoding.get("source")
        if source is None:  # nothing was read
            return None
        try:
            plain = open_group(Path(source), f"campaign/{self.name}/plain").load()
        except KeyError:  # no such group
            return None
        return _on_all_dofs(plain, self.data["dof"])

    def has(self, *names: str) -> bool:
        """True if the scene asked for all of these."""
        return all(name in self.data for name in names)

    def has_power(self, spectra: str) -> bool:
        """True if the scene asked for these spectra and something moves."""
        return self.has(spectra) and bool((self.data[spectra] > 0.0).any())


@dataclass(frozen=True, repr=False)
class Results:
    """Everything of one results file; what the scene did not ask for is absent."""

    path: Path
    attrs: dict[str, object]
    processes: dict[str, xr.Dataset]  # by name, p001 first
    structure: xr.Dataset | None
    cases: list[Case]  # c001 first
    tradeoff: xr.Dataset | None = None
    name: str = ""  # among files of one name

    def __repr__(self) -> str:
        """Short: what there is to look at."""
        rows = [
            f"<Results of {self.path}: {self.title}",
            f"  processes: {', '.join(self.processes)}",
        ]
        rows += [f"  cases[{i}]: {case}" for i, case in enumerate(self.cases)]
        named = ("structure", "tradeoff")
        rows += [f"  {name}" for name in named if getattr(self, name) is not None]
        return "\n".join(rows) + ">"

    @property
    def is_chain(self) -> bool:
        """True if joint i holds dof i to the ground, as in the paper's row of masses."""
        if self.structure is None or "directions" not in self.structure:
            return False
        directions = self.structure["directions"].values
        return directions.shape[0] == directions.shape[1] and bool(
            (directions == np.eye(len(directions))).all()
        )

    @property
    def place(self) -> str:
        """Name of a dof: each mass of a chain has one."""
        return "mass" if self.is_chain else "dof"

    @property
    def forced_dof(self) -> int:
        """The dof that the first force acts on most; the first one of a file without loads."""
        if self.structure is None:
            return 1
        return int(np.argmax(np.abs(self.structure["load"].values[0]))) + 1

    @property
    def deterministic(self) -> list[Case]:
        """Cases with friction as given."""
        return [case for case in self.cases if case.is_deterministic]

    @property
    def random(self) -> list[Case]:
        """Cases with drawn friction."""
        return [case for case in self.cases if not case.is_deterministic]

    @property
    def title(self) -> str:
        """Title of the scene, or else the file's name."""
        return str(self.attrs.get("title") or self.stem)

    @property
    def scene(self) -> tuple[str, str]:
        """Text of the scene, and the options that change it."""
        return str(self.attrs.get("scene", "")), str(self.attrs.get("overrides") or "")

    @property
    def stem(self) -> str:
        """The file's name without its ending, whatever bytes it is made of."""
        return self.name or readable(self.path.stem)

    @property
    def tree(self) -> xr.DataTree:
        """All groups of the file under their names, but audits under /audit.

        A branch of a DataTree must share the axes of its stem, and an audit has fewer samples.
        """
        groups = {f"process/{name}": data for name, data in self.processes.items()}
        groups |= {f"campaign/{case.name}": case.data for case in self.cases}
        groups |= {
            f"audit/{case.name}": case.audit for case in self.cases if case.audit is not None
        }
        with h5py.File(self.path) as file:
            names: list[str] = []
            file.visit(names.append)
            rest = [name for name in names if isinstance(file[name], h5py.Group)]
        groups |= {
            name: open_group(self.path, name)
            for name in rest
            if name not in groups and not name.endswith("/audit")
        }
        tree = xr.DataTree.from_dict(groups, name=self.stem)
        tree.attrs.update(self.attrs)
        return tree


def shared_friction(cases: Sequence[Case]) -> str:
    """Law of the friction in words; '' if the cases have several processes."""
    return cases[0].friction if len({case.process for case in cases}) == 1 else ""


def _on_all_dofs(data: xr.Dataset, dof: xr.DataArray) -> xr.Dataset:
    """Spectra and histories of some dofs on the axis of all, not a number where none was kept."""
    if "kept_dof" not in data.dims:
        return data
    kept = {name: array for name, array in data.data_vars.items() if "kept_dof" in array.dims}
    spread = {name: array.rename(kept_dof="dof").reindex(dof=dof) for name, array in kept.items()}
    numbers = [int(number) for number in data["kept_dof"]]
    return data.drop_vars([*kept, "kept_dof"]).assign(spread).assign_attrs(kept_dofs=numbers)


def open_results(path: str | Path) -> Results:
    """Open a results file; every dataset carries `units` and `long_name`."""
    path = Path(path)
    if not path.exists() and Path(f"{path}.shards").is_dir():
        raise ResultsError(
            f"{path}: its run is not finished: start it again, with --set campaign%n_samples=N for"
            " a look at the first N samples"
        )
    if not path.exists():
        raise ResultsError(f"{path}: no such file")
    if path.is_dir():
        raise ResultsError(f"{path}: is a folder")
    try:
        return _read(path)
    except (OSError, KeyError, RuntimeError, ValueError) as error:  # of damaged files
        words = " ".join(str(error).split())  # on one line
        raise ResultsError(f"{path}: cannot be read as HDF5: {words}") from error


def with_own_names(files: Sequence[Results]) -> list[Results]:
    """The files; those of one name get their folder before it, or else a number behind it."""
    stems = [file.stem for file in files]
    folders = [f"{readable(file.path.resolve().parent.name)}_{file.stem}" for file in files]
    for longer in (folders, [f"{folder}_{i}" for i, folder in enumerate(folders, 1)]):
        stems = [
            more if stems.count(stem) > 1 else stem
            for stem, more in zip(stems, longer, strict=True)
        ]
    return [replace(file, name=stem) for file, stem in zip(files, stems, strict=True)]


def find_damage(path: Path) -> str | None:
    """The first dataset that cannot be read, and why; reads the whole file, a chunk at a time."""
    with h5py.File(path) as file:
        groups = [file["/"]]
        for group in groups:
            for name in group:
                try:
                    item = group[name]
                    if isinstance(item, h5py.Group):
                        groups.append(item)
                    else:
                        for chunk in item.iter_chunks() if item.chunks else [()]:
                            item[chunk]
                except (OSError, KeyError) as error:  # of numbers, of a header
                    return f"{group.name.rstrip('/')}/{name}: {error.args[0]}"
    return None


def _read(path: Path) -> Results:
    with h5py.File(path) as file:
        attrs = attributes_of(file)
        groups = {kind: sorted(file[kind]) for kind in ("process", "campaign") if kind in file}
        alone = {kind for kind in ("structure", "tradeoff") if kind in file}
        audited = {name for name in groups.get("campaign", []) if "audit" in file["campaign"][name]}
    if attrs.get("program") != "entroslip":
        raise ResultsError(f"{path}: not a results file of entroslip")
    if attrs.get("format_version") != _FORMAT_VERSION:
        raise ResultsError(
            f"{path}: format_version = {attrs.get('format_version')}: this package reads version"
            f" {_FORMAT_VERSION}; take the one that came with entroslip {attrs.get('version')}"
        )

    def view(group: str) -> xr.Dataset:
        data = open_group(path, group)
        _require_axes(data, f"{path}: /{group}")
        return data

    def load(group: str) -> xr.Dataset:
        return view(group).load()

    processes = {name: load(f"process/{name}") for name in groups.get("process", [])}

    is_base = "excitation%base = .true." in str(attrs.get("settings"))

    def case_of(name: str) -> Case:
        group = f"campaign/{name}"
        data = view(group)
        data = _on_all_dofs(data, data["dof"])
        audit = _on_all_dofs(view(f"{group}/audit"), data["dof"]) if name in audited else None
        process = processes.get(str(data.attrs.get("process")))
        asked = {} if process is None else process.attrs
        return Case(name, data, audit, asked, is_base)

    return Results(
        path=path,
        attrs=attrs,
        processes=processes,
        structure=load("structure") if "structure" in alone else None,
        cases=[case_of(name) for name in groups.get("campaign", [])],
        tradeoff=load("tradeoff") if "tradeoff" in alone else None,
    )


def _require_axes(data: xr.Dataset, place: str) -> None:
    """Refuse axes without values, or with values that are not finite."""
    for name, size in data.sizes.items():
        if size == 0 and name not in _MAY_BE_EMPTY:
            raise ResultsError(f"{place}/{name}: is an axis without values")
        values = data[name].values
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise ResultsError(f"{place}/{name}: is an axis with a value that is no number")
