"""Commands as their users run them, most of them without a process of their own."""

import subprocess
import sys
import time
from functools import partial

import pytest

from command_line import run_here
from halpipe.exporters.native import format_model
from support import access, after, chain, model, task, version

CORES = "c1 c2"

PATIENCE = 120
"""Seconds after which a process hangs, on however busy a machine."""


def small_model():
    """Two tasks and a chain on two units: schedulable at once."""
    sense = task("sense", "10ms", version("v", "3ms", CORES, access("mem", "0ms", "1ms")))
    act = task("act", "10ms", version("v", "2ms", CORES, after("sense", "0ms", "4ms", "end")))
    return model(sense, act, units=CORES, resources="mem", chains=[chain("c", "sense act", reaction="40ms")])


def hopeless_model():
    """Three tasks of which no two fit on one unit, and two units: valid as a model, and no search succeeds."""
    wcets = {"first": "7ms", "second": "7ms", "third": "6ms"}
    return model(*(task(name, "10ms", version("v", wcet, CORES)) for name, wcet in wcets.items()), units=CORES)


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
