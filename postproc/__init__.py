"""Figures, tables and the report of entroslip results files."""

from .results import Case, Results, ResultsError, open_results

__all__ = ["Case", "Results", "ResultsError", "open_results"]
