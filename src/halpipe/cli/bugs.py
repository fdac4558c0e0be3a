"""Internal errors: the traceback goes to a file, the user sees where it is."""

from __future__ import annotations

import platform
import sys
import tempfile
import traceback

from halpipe import __version__


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
