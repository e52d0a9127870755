"""A pseudo-terminal as the output of a command."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import termios
from collections.abc import Sequence
from pathlib import Path


def said_on_a_terminal(
    command: Sequence[str | Path], stream: str, columns: int = 0, **options: object
) -> tuple[int, str]:
    """Exit code and output of a command whose `stream` ("stdout" or "stderr") is a terminal.

    A new terminal has no columns: it does not say how many.
    """
    reader, writer = pty.openpty()
    fcntl.ioctl(writer, termios.TIOCSWINSZ, struct.pack("HHHH", 0, columns, 0, 0))
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
