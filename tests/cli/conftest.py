"""Commands run as their users run them: in a process of their own."""

import os
import subprocess
import sys

import pytest

from halpipe.exporters.native import format_model
from support import access, after, chain, model, task, version

CORES = "c1 c2"


def small_model():
    """Two tasks and a chain on two units: schedulable at once."""
    sense = task("sense", "10ms", version("v", "3ms", CORES, access("mem", "0ms", "1ms")))
    act = task("act", "10ms", version("v", "2ms", CORES, after("sense", "0ms", "4ms", "end")))
    return model(sense, act, units=CORES, resources="mem", chains=[chain("c", "sense act", reaction="40ms")])


def hopeless_model():
    """Three tasks of which no two fit on one unit, and two units: valid as a model, and no search succeeds."""
    wcets = {"first": "7ms", "second": "7ms", "third": "6ms"}
    return model(*(task(name, "10ms", version("v", wcet, CORES)) for name, wcet in wcets.items()), units=CORES)


@pytest.fixture(scope="session", autouse=True)
def compiled_kernel(tmp_path_factory):
    """Compile the search kernel before any test looks at the clock; on a fresh machine that takes half a minute."""
    folder = tmp_path_factory.mktemp("warm")
    (folder / "model.xml").write_bytes(format_model(small_model()))
    command = [sys.executable, "-m", "halpipe", "schedule", "model.xml", "-q", "-o", "schedule.xml"]
    subprocess.run(command, cwd=folder, check=True, timeout=600)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "model.xml").write_bytes(format_model(small_model()))
    (tmp_path / "hopeless.xml").write_bytes(format_model(hopeless_model()))
    return tmp_path


@pytest.fixture
def halpipe(folder):
    """Run halpipe in the folder and return the finished process; its output is text."""

    def run(*arguments, stdin=None, env=None):
        return subprocess.run(
            [sys.executable, "-m", "halpipe", *map(str, arguments)],
            cwd=folder,
            input=stdin,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
            env={**os.environ, **(env or {})},
        )

    return run
