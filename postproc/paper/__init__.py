"""The paper's printed numbers and statements, each put to a test on results files."""
