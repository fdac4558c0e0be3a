"""Commands as their users run them, most of them without a process of their own."""

import subprocess
import sys
import time
from functools import partial

import pytest

from command_line import run_here
from halpipe.exporters.native import format_model
from support import hopeless_model, small_model

PATIENCE = 300
"""Seconds after which a process hangs, on however busy a machine."""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "model.xml").write_bytes(format_model(small_model()))
    (tmp_path / "hopeless.xml").write_bytes(format_model(hopeless_model()))
    return tmp_path


@pytest.fixture
def halpipe(folder):
    """Run halpipe in the folder, within this process, and return it as a finished one."""
    return partial(run_here, folder)


@pytest.fixture
def halpipe_process(folder):
    """Run halpipe in the folder as its users do: where start-up, pipes, other processes or signals are the subject."""

    def run(*arguments, stdin=None):
        return subprocess.run(
            [sys.executable, "-m", "halpipe", *map(str, arguments)],
            cwd=folder,
            input=stdin,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )

    return run


@pytest.fixture
def wait_until():
    """Wait for a condition, however busy the machine is."""

    def wait(condition):
        until = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < until, "waited in vain"
            time.sleep(0.05)

    return wait
