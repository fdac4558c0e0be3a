"""What a command loads before it does anything: a start without waiting is a matter of modules, not of a clock.

Each bound is a little more than what the command loads today. What is needed on some ways only is loaded there; who
raises a bound says in the commit what for.
"""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json, sys
before = set(sys.modules)
from halpipe.cli import invoke
code = invoke(json.loads(sys.argv[1]))
print(json.dumps([code, sorted(set(sys.modules) - before)]), file=sys.stderr)
"""

# Arguments, and how many modules are loaded at most: of halpipe, and of all others.
COMMANDS = {
    "help": (["--help"], 43, 115),
    "version": (["--version"], 43, 115),
    "validate": (["validate", "model.xml"], 51, 120),
    "schedule": (["schedule", "model.xml", "-o", "made.xml", "-q"], 108, 122),
    "verify": (["verify", "model.xml", "schedule.xml"], 54, 120),
    "show": (["show", "schedule.xml"], 37, 120),
    "diff": (["diff", "schedule.xml", "schedule.xml"], 38, 120),
    "explain": (["explain", "model.xml"], 114, 125),
}

HEAVY = {"numpy", "xmlschema", "jinja2", "graphviz", "rich.console", "yaml", "asyncio", "ortools", "concurrent.futures"}
"""Each costs more than most commands, which can do without."""

# What commands load of them nevertheless.
NEEDED = {"show": {"rich.console"}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    from command_line import run_here
    from halpipe.exporters.native import format_model
    from support import small_model

    made = tmp_path_factory.mktemp("start")
    (made / "model.xml").write_bytes(format_model(small_model()))
    assert run_here(made, "schedule", "model.xml", "-o", "schedule.xml").returncode == 0
    return made


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_loads_no_more_than_it_needs(folder, command):
    arguments, ours, others = COMMANDS[command]
    program = [sys.executable, "-c", PROGRAM, json.dumps(arguments)]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=True)
    code, modules = json.loads(done.stderr.splitlines()[-1])
    assert code == 0, done.stderr
    own = [name for name in modules if name.split(".")[0] == "halpipe"]
    assert HEAVY & set(modules) <= NEEDED.get(command, set())
    assert len(own) <= ours, own
    assert len(modules) - len(own) <= others, sorted(set(modules) - set(own))
