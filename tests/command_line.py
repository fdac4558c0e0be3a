"""Commands in this process, as in one of their own but without its start: that would be most of a test's time."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import signal
import subprocess
from unittest import mock

from typer.main import get_command

import halpipe.cli
from halpipe.cli import output
from halpipe.cli.app import COMPLETION, app_for


def run_here(folder, *arguments, stdin=""):
    """Run a command in the folder and return it as a finished process; its output is text."""
    words = [str(argument) for argument in arguments]
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    given = io.TextIOWrapper(io.BytesIO(stdin.encode()), "utf-8")
    with (
        contextlib.chdir(folder),
        mock.patch("sys.argv", ["halpipe", *words]),
        mock.patch("sys.stdin", given),
        mock.patch("halpipe.cli.app.app_for", _made_once),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        _own_signals(),
        mock.patch.dict(os.environ),
    ):
        output.choose(None, quiet=False, verbose=False)
        try:
            code = halpipe.cli.invoke(words)
        except SystemExit as end:  # of the completion
            code = end.code
    said = [stream.buffer.getvalue().decode() for stream in (out, err)]
    return subprocess.CompletedProcess(["halpipe", *words], code, *said)


def _made_once(arguments):
    """Stand in for `app_for`: to make the options of a command takes as long as many commands do."""
    return app_for(arguments) if COMPLETION in os.environ else _command(arguments[0] if arguments else "")


@functools.cache
def _command(verb):
    return get_command(app_for([verb] if verb else []))


@contextlib.contextmanager
def _own_signals():
    """Take back what a command does about Ctrl-C; in a process of its own it need not."""
    before = {signum: signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)
