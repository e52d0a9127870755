"""Output of the package: files written whole, words, exit codes; a refusal is one line."""

from __future__ import annotations

import argparse
import errno
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Refusal(Exception):
    """One line for standard error, and the exit code that goes with it."""

    code = 1


class InputError(Refusal):
    """Something given cannot be used."""

    code = 2


class OutputError(Refusal):
    """A file cannot be written."""

    code = 3


class Parser(argparse.ArgumentParser):
    """Options of a command; help that cannot be written is no success."""

    def print_help(self, file: Any = None) -> None:  # noqa: ANN401
        """Print how the command is used."""
        say(self.format_help().rstrip())


def exit_code(work: Callable[[], None]) -> int:
    """0, or the code of the refusal that ended the work, which standard error then names.

    Ctrl-C ends the program as it ends one in any other language: by the signal, without a word.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # as during the imports of a command
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            work()
        finally:
            _flush()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.raise_signal(signal.SIGINT)
    except Refusal as refusal:
        try:
            if refusal.args:
                print(refusal, file=sys.stderr, flush=True)
        except OSError:
            _silence(2)
        return refusal.code
    return 0


def say(text: str) -> None:
    """Print a line; characters that the terminal cannot show are escaped."""
    if sys.stdout is None:
        raise OutputError("standard output: cannot be written: Bad file descriptor")
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    try:
        print(text.encode(encoding, "backslashreplace").decode(encoding))
    except OSError as error:
        raise _unwritten(error) from error


def show(text: str) -> None:
    """Show what is going on until the next call, on a terminal; an empty text clears the line."""
    if sys.stdout is None or not sys.stdout.isatty():
        return
    try:
        print(f"\r\x1b[K{text}", end="", flush=True)
    except OSError as error:
        raise _unwritten(error) from error


def write_file(path: Path, content: bytes) -> None:
    """Write under a name of its own, then rename: a file of this name is always whole.

    The folder is created with its first file, so that work that fails before leaves none.
    """
    _make_folder(path.parent)
    part = path.with_name(f"{path.name}.part")
    try:
        try:
            part.write_bytes(content)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error


def readable(text: bytes | str) -> str:
    """Text of any bytes: UTF-8 where they are, else Windows-1252, which has Latin-1's letters.

    In a `str`, bytes that are not UTF-8 stand as Python and h5py hand them out, as surrogates.
    """
    raw = text if isinstance(text, bytes) else text.encode("utf-8", "surrogateescape")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")


def read_text(path: Path) -> str:
    """The text of a file of any bytes, without a byte order mark."""
    try:
        return readable(path.read_bytes()).removeprefix("\ufeff")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be made a folder: {error.strerror}") from error


def _flush() -> None:
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        raise _unwritten(error) from error


def _unwritten(error: OSError) -> OutputError:
    """The refusal; it says nothing of a pipe whose reader has ended, such as `head`."""
    _silence(1)
    if error.errno == errno.EPIPE:
        return OutputError()
    return OutputError(f"standard output: cannot be written: {error.strerror}")


def _silence(descriptor: int) -> None:
    """Let what is left in a buffer go nowhere, so that the interpreter's exit does not fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
