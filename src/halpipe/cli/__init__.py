"""The command line: it parses and renders, and decides nothing."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # the less is loaded here, the sooner Ctrl-C is answered properly
if TYPE_CHECKING:
    from typing import Any, NoReturn

INTERRUPTED = 130
NO_MEMORY = b"error[HAL0007] the system gives no more memory\n"
UNLOADABLE = (MemoryError, ImportError, SyntaxError, SystemError, ValueError)
"""What Python raises where memory does not suffice to load a module, or to compile it."""
RARELY = (100_000, 50, 100)
"""Thresholds of the garbage collector: a model is a large tree of lasting objects, and looking through it again and
again takes up to a quarter of the time of an import."""


def main() -> NoReturn:
    """Run the command line and leave with the exit code of the table in docs/reference/exit-codes.md."""
    try:
        _interrupt_on_termination()
        code = _run()
    except KeyboardInterrupt:  # before the command began, or once more while it ended
        os.write(2, b"interrupted\n")
        code = INTERRUPTED
    except UNLOADABLE:  # before the command began, or once more while it was told
        os.write(2, NO_MEMORY)
        code = 1
    _leave_when_interrupted(code)
    _forget_all()
    sys.exit(code)


def _run() -> int:
    import gc

    from halpipe.cli import output

    gc.set_threshold(*RARELY)
    output.prepare()
    return invoke(sys.argv[1:])


def _interrupt_on_termination() -> None:
    """Let a request to end be what Ctrl-C is, so that nothing half done is left behind."""
    import signal

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no terminals that hang up
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def _leave_when_interrupted(code: int) -> None:
    """From now on Python only clears up; being interrupted there would show as a traceback."""
    import signal

    def leave(*_: Any) -> None:
        os._exit(code)

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, leave)


def _forget_all() -> None:
    """Keep Python from looking through all objects once more, which takes up to a fifth of a short command."""
    import gc

    gc.freeze()


def invoke(arguments: list[str]) -> int:
    """Run one command; never let a traceback out."""
    try:
        code = _invoke(arguments)
        from halpipe.cli import output

        output.flush_results()
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:
        return _ended_by_reader()
    except Exception as failure:  # noqa: BLE001 - the last line of defence: a bug must not show as a traceback
        return _interrupted() if _is_interrupt(failure) else _exit_code(failure)
    return code


def _invoke(arguments: list[str]) -> int:
    from halpipe.cli.app import app_for
    from halpipe.core.files import protecting_inputs
    from halpipe.core.suggest import bounded_suggestions

    _refuse_empty(arguments)
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "-h"]
    try:
        with protecting_inputs(), bounded_suggestions():
            return int(app_for(arguments)(args=arguments, prog_name="halpipe", standalone_mode=False) or 0)
    except SystemExit as end:  # click's answer to a reader that has gone
        if isinstance(end.__context__, BrokenPipeError):
            raise end.__context__ from None
        raise


def _refuse_empty(arguments: list[str]) -> None:
    """Refuse an argument without text, as a variable of a shell leaves it: it would count as one not stated."""
    import typer

    for before, argument in zip(["halpipe", *arguments], arguments, strict=False):
        name, sign, value = argument.partition("=")
        if not argument or (sign and not value and name.startswith("--")):
            place = name if sign else before
            raise typer.BadParameter(f'the text after "{place}" is empty; write a value, or omit the option')


def _interrupted() -> int:
    from halpipe.cli import output

    output.say("interrupted")
    return INTERRUPTED


def _is_interrupt(failure: BaseException) -> bool:
    """Whether Ctrl-C is the stated cause of a failure: Python before 3.12 wraps what `__set_name__` raises.

    A failure while Ctrl-C is handled, such as one of saving the best result, is reported like any other.
    """
    cause = failure.__cause__
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__
    return cause is not None


def _ended_by_reader() -> int:
    """The reader of our output has closed it: that is no failure."""
    from halpipe.cli import output

    output.silence(sys.stdout)
    return 0


def _exit_code(failure: Exception) -> int:
    """Tell what went wrong, and return the exit code that says so."""
    if isinstance(failure, MemoryError):
        failure.__traceback__ = None  # what the command held is free now
    try:
        from halpipe.cli import failures

        return failures.told(failure)
    except BrokenPipeError:
        return _ended_by_reader()
    except UNLOADABLE:  # too little even to load what tells it
        os.write(2, NO_MEMORY)
        return 1
