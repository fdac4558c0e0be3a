"""The command line: one file per verb. It parses and renders; it decides nothing."""

from __future__ import annotations

import errno
import gc
import os
import sys
from typing import NoReturn

from halpipe.diagnostics import Exit, HalpipeError

RARELY = (100_000, 50, 100)
"""Thresholds of the garbage collector: a model is a large tree of lasting objects, and looking through it again and
again takes up to a quarter of the time of an import."""


def main() -> NoReturn:
    """Run the command line and leave with the exit code of the table in docs/reference/exit-codes.md."""
    gc.set_threshold(*RARELY)
    sys.exit(invoke(sys.argv[1:]))


def invoke(arguments: list[str]) -> int:
    """Run one command; never let a traceback out."""
    from halpipe.cli import output
    from halpipe.cli.app import app
    from halpipe.files import protecting_inputs

    try:
        with protecting_inputs():
            code = app(args=arguments, prog_name="halpipe", standalone_mode=False)
    except HalpipeError as failure:
        output.report(failure.diagnostics)
        return int(failure.exit)
    except KeyboardInterrupt:
        output.say("interrupted")
        return int(Exit.INTERRUPTED)
    except BrokenPipeError:
        # Whoever read our output has gone; silence Python's own complaint at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return int(Exit.OK)
    except Exception as failure:  # noqa: BLE001 - the last line of defence: a bug must not show as a traceback
        return _usage_or_bug(failure)
    return int(code or 0)


def _usage_or_bug(failure: Exception) -> int:
    from halpipe.cli import output
    from halpipe.cli.bugs import save_report

    if hasattr(failure, "exit_code") and hasattr(failure, "show"):  # click's own errors: wrong usage
        failure.show(file=sys.stderr)
        return int(failure.exit_code)
    if type(failure).__name__ == "Abort":
        output.say("interrupted")
        return int(Exit.INTERRUPTED)
    if isinstance(failure, OSError) and failure.errno == errno.ENOSPC:
        output.say(f"error: standard output: {failure.strerror}")
        return int(Exit.FINDINGS)
    output.say(f"internal error: {type(failure).__name__}: {failure}")
    output.say(f"this is a bug; please report it with {save_report(failure)}")
    return int(Exit.INTERNAL)
