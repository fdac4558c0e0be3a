"""The standard streams, in whatever state the shell left them: closed, full, or without a reader.

What is said to the user on standard error never stops the work. A result that cannot be printed does, unless its reader
has had enough.
"""

from __future__ import annotations

import contextlib
import os
import sys
from typing import Any, TextIO

from halpipe.core.diagnostics import HalpipeError


def prepare() -> None:
    """Make closed streams harmless: else the next file that is opened would take their place, and their output."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what an encoding lacks is escaped
            stream.reconfigure(errors="backslashreplace")


def write_result(text: str) -> None:
    """Print to standard output; raise `BrokenPipeError` if its reader has gone, `HalpipeError` if it takes no more."""
    with _refusals_told():
        _open(sys.stdout).write(text)


def flush_results() -> None:
    """Have results reach their reader, or raise as `write_result` does."""
    if sys.stdout is not None:
        with _refusals_told():
            sys.stdout.flush()


def can_print(text: str) -> bool:
    """Return whether standard output has these characters, so that they need not be escaped."""
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


def write_remark(text: str) -> None:
    """Print to standard error, if that is possible."""
    try:
        _open(sys.stderr).write(text)
        sys.stderr.flush()
    except (OSError, ValueError):
        silence(sys.stderr)


def silence(stream: TextIO | None) -> None:
    """Let a stream go nowhere from now on, so that Python itself does not complain of it in the end."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        target = os.open(os.devnull, os.O_WRONLY)
        os.dup2(target, stream.fileno())  # type: ignore[union-attr]
        os.close(target)


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether people read a stream."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:
        return False


def _open(stream: TextIO | None) -> Any:
    if stream is None:
        import errno

        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return stream


@contextlib.contextmanager
def _refusals_told() -> Any:
    from halpipe.core.files.writing import cannot_write

    try:
        yield
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as failure:
        silence(sys.stdout)
        raise HalpipeError(*cannot_write("-", failure).diagnostics) from None
