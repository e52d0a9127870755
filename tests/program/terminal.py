"""A pseudo-terminal as the output of a command."""

from __future__ import annotations

import os
import pty
import subprocess
from collections.abc import Sequence
from pathlib import Path


def said_on_a_terminal(
    command: Sequence[str | Path], stream: str, **options: object
) -> tuple[int, str]:
    """Exit code and output of a command whose `stream` ("stdout" or "stderr") is a terminal."""
    reader, writer = pty.openpty()
    process = subprocess.Popen(command, **{**options, stream: writer})
    os.close(writer)
    text = b""
    try:
        while part := os.read(reader, 4096):
            text += part
    except OSError:  # Linux: the other end is closed
        pass
    os.close(reader)
    return process.wait(), text.decode()
