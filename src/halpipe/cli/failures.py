"""Internal errors: the traceback goes to a file, the user sees where it is."""

from __future__ import annotations

import errno
import io
import platform
import sys
import tempfile
import traceback
from typing import Any

from halpipe import __version__
from halpipe.cli import output
from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.suggest import nearest


def save_report(failure: Exception) -> str:
    """Write version, command and traceback to a new temporary file and return its name."""
    lines = [
        f"halpipe {__version__}, Python {platform.python_version()}, {platform.platform()}",
        f"command: {sys.argv[1:]}",
        "",
        "".join(traceback.format_exception(failure)),
    ]
    with tempfile.NamedTemporaryFile(
        "w", prefix="halpipe-bug-", suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
    ) as stream:
        stream.write("\n".join(lines))
    return stream.name


OUT_OF_MEMORY = error(
    "HAL0007",
    "Memory does not suffice",
    "The system gave no more memory, threads, processes or open files. What stood in the outputs before is untouched.",
)

_NO_MEMORY = (
    "can't start new thread",
    "cannot allocate memory",
    "failed to map segment",
    "returned null without setting an exception",  # Python's compiler and its imports, when an allocation fails
)
_SCARCE = (errno.EAGAIN, errno.EMFILE, errno.ENFILE)
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


def told(failure: Exception) -> int:
    """Report why the command ended, and return its exit code."""
    if isinstance(failure, HalpipeError):
        from halpipe.cli.checks import gathered

        output.report(gathered(failure.diagnostics) if output.is_brief() else failure.diagnostics)
        return int(failure.exit)
    if hasattr(failure, "exit_code") and hasattr(failure, "show"):  # click's own errors: wrong usage
        return _tell_usage(failure)
    if type(failure).__name__ == "Abort":
        output.say("interrupted")
        return int(Exit.INTERRUPTED)
    if _is_want_of_memory(failure):
        help = "free some, lift the limit on it, use fewer --workers, or split the file"
        is_other = isinstance(failure, OSError) and failure.errno in _SCARCE
        what = "open files, processes or threads" if is_other else "memory"
        output.report([OUT_OF_MEMORY(f"the system gives no more {what}", help=help)])
        return int(Exit.FINDINGS)
    if isinstance(failure, OSError) and failure.errno in _NO_ROOM:
        output.say(f"error: standard output: {failure.strerror}")
        return int(Exit.FINDINGS)
    return _tell_bug(failure)


def _tell_usage(failure: Exception) -> int:
    shown = io.StringIO()
    context: Any = getattr(failure, "ctx", None)
    if context is not None and hasattr(failure, "possibilities"):  # of an unknown option
        known = [name for option in context.command.params for name in option.opts if name.startswith("--")]
        failure.possibilities = nearest(str(getattr(failure, "option_name", "")), known)
    try:
        failure.show(file=shown)  # type: ignore[attr-defined]
    except Exception as bug:  # noqa: BLE001 - versions of typer and click that do not fit each other
        return _tell_bug(bug)
    for line in shown.getvalue().splitlines():
        output.say(line)
    return int(failure.exit_code)  # type: ignore[attr-defined]


def _is_want_of_memory(failure: Exception) -> bool:
    if isinstance(failure, MemoryError):
        return True
    if isinstance(failure, OSError) and failure.errno in (errno.ENOMEM, *_SCARCE):
        return True
    return isinstance(failure, (RuntimeError, ImportError, OSError, SystemError)) and any(
        text in str(failure).lower() for text in _NO_MEMORY
    )


def _tell_bug(failure: Exception) -> int:
    output.say(f"internal error: {type(failure).__name__}: {failure}")
    try:
        output.say(f"this is a bug; please report it with {save_report(failure)}")
    except (OSError, ValueError) as reason:
        output.say(f"this is a bug; please report it (no report could be saved: {reason})")
    return int(Exit.INTERNAL)
