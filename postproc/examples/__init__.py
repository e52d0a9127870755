"""Worked examples, to be read and changed."""
