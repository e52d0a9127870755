"""Figures, tables and the report of entroslip results files."""

from postproc.results import Results, open_results

__all__ = ["Results", "open_results"]
