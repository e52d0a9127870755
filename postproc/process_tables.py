"""Tables of the processes: what was asked and found, and the two laws of positive ones."""

from __future__ import annotations

from collections.abc import Iterator

from .processes import imposed_lengths, is_maximum_entropy
from .results import Results
from .table import ERRORS, MOST_ROWS, Table, stored


def tables_of(results: Results) -> Iterator[Table]:
    """Requests and solutions of the processes."""
    if results.processes:
        yield table_processes(results)
        if any("other_mean" in data for data in results.processes.values()):
            yield table_laws(results)


def table_processes(results: Results) -> Table:
    """Request and solution of each process."""
    header = (
        "process", "asked", "model", "mean", "std", "L0", "L1", "entropy", "entropy of white noise",
        "status",
    )  # fmt: skip
    rows = []
    for name, data in results.processes.items():
        asked = data.attrs
        if not is_maximum_entropy(data):
            length = model = str(asked["law"])
        else:
            length = imposed_lengths(asked)
            method = "AR" if asked["method"] == "autoregressive" else asked["method"]
            model = f"{method}({asked.get('order_found', asked['order']) or 'chosen'})"
            if int(asked["positive"]):
                model += f", {asked['sampler']}"
        found = [
            stored(data, value)
            for value in ("mean_found", "std_found", "L0", "L1", "entropy", "entropy_bound")
        ]
        status = str(asked["status"])
        if "reason" in asked:
            status += f": {asked['reason']}"
        if asked.get("branch") == "alternating":
            status += ", K(m) alternates: neighbours are anticorrelated"
            if "nonnegative_entropy" in data:
                status += " (the other law has a process with K(m) >= 0 and more entropy)"
        wanted = f"{length}, mean {asked['mean']:g}, std {asked['std']:g}"
        rows.append((name, wanted, model, *found, status))
    note = f"Entropies in nats per point. {ERRORS}"
    return Table("processes", "Processes", header, rows, note, is_detail=len(rows) > MOST_ROWS)


def table_laws(results: Results) -> Table:
    """The two laws of positive processes side by side, for each process."""
    rows = []
    for name, data in results.processes.items():
        if "other_mean" not in data:
            continue
        row = [name, str(data.attrs["sampler"])]
        for ours, other in (("mean_found", "mean"), ("std_found", "std"), ("L0", "L0"),
                            ("entropy", "entropy")):  # fmt: skip
            row += [stored(data, ours), stored(data, f"other_{other}")]
        rows.append(tuple(row))
    header = ["process", "law"]
    for name in ("mean", "std", "L0", "entropy"):
        header += [name, f"{name}, other law"]
    note = (
        "Rejection of one value at a time (sequential) and Eq. 25 on the positive orthant (exact)"
        " are two laws. Beside each value is that of the other law with the same a, b0 and mu."
        f" {ERRORS}"
    )
    return Table("laws", "Two laws of positive processes", tuple(header), rows, note)
