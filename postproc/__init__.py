"""Figures, tables and the report of entroslip results files."""

from . import interrupts  # noqa: F401  (before all that takes long)
from .responses import acceleration_psd, history, velocity_psd
from .results import Case, Results, ResultsError, open_results

__all__ = [
    "Case", "Results", "ResultsError", "acceleration_psd", "history", "open_results",
    "velocity_psd",
]  # fmt: skip
