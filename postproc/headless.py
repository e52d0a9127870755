"""Imported before matplotlib by each command: files are drawn, never windows."""

import os

os.environ["MPLBACKEND"] = "agg"  # whatever the user's is
