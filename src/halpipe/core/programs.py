"""Other programs that halpipe starts: compilers, solvers, emulators; and the error where one cannot be started."""

from __future__ import annotations

import subprocess
from subprocess import TimeoutExpired
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, error

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

__all__ = ["TimeoutExpired", "not_started", "run"]

NOT_STARTED = error(
    "HAL0012",
    "Program cannot be started",
    "A compiler, solver or emulator is needed, and the system does not start it: it is not there, may not be executed, "
    "or there are too many processes or too little memory. Whatever stood in the outputs before is untouched.",
)


def run(
    command: Sequence[str],
    folder: str | Path | None = None,
    *,
    seconds: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, without input, and return what it said and its status, whatever that is.

    Raise `HalpipeError` if it cannot be started, and ``TimeoutExpired`` if it takes longer than `seconds`.
    """
    options: dict[str, Any] = {"encoding": "utf-8", "errors": "replace", "capture_output": True}
    try:
        return subprocess.run(
            command,
            cwd=folder,
            env=environment,
            timeout=seconds,
            stdin=subprocess.DEVNULL,
            check=False,
            **options,
        )
    except OSError as failure:
        raise not_started(command[0], failure) from None


def not_started(program: str, failure: OSError) -> HalpipeError:
    """Return the error for a program that the system does not start."""
    name = program.rpartition("/")[2]
    help = "see whether it is installed and may be executed, and whether the machine has room for more processes"
    return HalpipeError(NOT_STARTED(f"{name} cannot be started: {failure.strerror or failure}", help=help))
