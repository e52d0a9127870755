"""A process of a results file: what was asked of it, and its autocovariance."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

import xarray as xr

MAXIMUM_ENTROPY = "maximum entropy"  # law of a process of Sec. 2
LONGEST_LAG = 20  # shown; the paper's figures end about there
Kind = tuple[str, str, float, int]


def is_maximum_entropy(process: xr.Dataset) -> bool:
    """True for a process of Sec. 2; what it is compared with has neither order nor sampler."""
    return str(process.attrs.get("law", MAXIMUM_ENTROPY)) == MAXIMUM_ENTROPY


def order_of(process: xr.Dataset) -> int:
    """M of the recursion, or m_max: as asked, or as chosen. A process given by G has no a_q."""
    return int(process.sizes.get("order", process.attrs.get("order_found", 0)))


def imposed_lengths(asked: Mapping[Hashable, object]) -> str:
    """'L0 = 1', or 'L0 = 1, L1 = 2', of what was asked of a process."""
    names = {"both": ("L0", "L1")}.get(str(asked["correlation"]), (str(asked["correlation"]),))
    values = (asked[name] for name in ("correlation_length", "second_length") if name in asked)
    return ", ".join(f"{name} = {value:g}" for name, value in zip(names, values, strict=False))


def length_of(process: xr.Dataset) -> float:
    """The correlation length imposed."""
    return float(process.attrs["correlation_length"])


def kind_of(process: xr.Dataset) -> Kind:
    """Method, correlation, length and order: a positive process shares them with its free twin."""
    of = process.attrs
    return str(of["method"]), str(of["correlation"]), length_of(process), int(of["order"])


def scale_of(process: xr.Dataset) -> tuple[float, float]:
    """Mean and standard deviation imposed."""
    return float(process.attrs["mean"]), float(process.attrs["std"])


def scale_name(process: xr.Dataset, processes: Sequence[xr.Dataset]) -> str:
    """'mean 3', with ', std 1' where the processes have several."""
    mean, std = scale_of(process)
    has_several = len({scale_of(p)[1] for p in processes}) > 1
    return f"mean {mean:g}, std {std:g}" if has_several else f"mean {mean:g}"


def model_of(process: xr.Dataset) -> str:
    """'M = 10' of an autoregressive process, 'm_max = 4' of the direct method."""
    name = "m_max" if process.attrs["method"] == "direct" else "M"
    return f"{name} = {order_of(process)}"


def is_positive(process: xr.Dataset) -> bool:
    """True if its values may not be negative."""
    return bool(int(process.attrs["positive"]))


def correlation_of(process: xr.Dataset) -> xr.DataArray:
    """Autocovariance over variance, to the longest lag shown."""
    curve = process["autocovariance"].isel(lag=slice(0, LONGEST_LAG + 1))
    return curve / curve[0]


def difference_from_free(process: xr.Dataset, free: xr.Dataset) -> xr.Dataset:
    """Autocovariance over variance, less that of the process without sign constraint; errors."""
    error = process["autocovariance_error"] / float(process["autocovariance"][0])
    return xr.Dataset(
        {"value": correlation_of(process) - correlation_of(free), "error": error}
    ).isel(lag=slice(0, LONGEST_LAG + 1))
