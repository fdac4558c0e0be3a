"""Files for code hosting: the workflow that tests every Python of the package, and the hook for pre-commit."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import yaml

from halpipe.starters import first_model

ROOT = Path(__file__).parents[2]


def parsed(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_workflow_tests_every_python_that_the_package_names():
    job = parsed(".github/workflows/test.yml")["jobs"]["test"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [text.rpartition(" ")[2] for text in project["classifiers"] if re.search(r":: 3\.\d+$", text)]
    assert job["strategy"]["matrix"]["python"] == named
    assert project["requires-python"] == f">={named[0]}"


def test_the_workflow_runs_targets_of_the_makefile():
    document = parsed(".github/workflows/test.yml")
    assert document["permissions"] == {"contents": "read"}
    commands = [step["run"] for step in document["jobs"]["test"]["steps"] if "run" in step]
    (make,) = (shlex.split(command) for command in commands if command.startswith("make "))
    targets = [word for word in make[1:] if "=" not in word]
    rules = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert "test-fast" in targets
    assert set(targets) <= set(rules)
    variables = [word.partition("=")[0] for word in make[1:] if "=" in word]
    assert all(re.search(rf"\$\({name}\)", (ROOT / "Makefile").read_text(encoding="utf-8")) for name in variables)


def test_the_hook_validates_every_model_of_a_commit(tmp_path):
    (hook,) = parsed(".pre-commit-hooks.yaml")
    assert hook["id"] == "halpipe-validate"
    assert [bool(re.search(hook["files"], name)) for name in ("model.xml", "a/model.xml", "mymodel.xml")] == [1, 1, 0]
    right = first_model()["model.xml"]
    names = ("right model.xml", "wrong.xml", "right too.xml")
    for name, content in zip(names, (right, right.replace(b'wcet="6ms"', b'wcet="66ms"'), right), strict=True):
        (tmp_path / name).write_bytes(content)
    program = tmp_path / "bin" / "halpipe"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m halpipe "$@"\n')
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}

    def commit(*given):
        command = [*shlex.split(hook["entry"]), *given]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    mixed = commit(*names)
    assert mixed.returncode == 1
    assert "wrong.xml:" in mixed.stdout
    assert all(f"{name}: valid" in mixed.stdout for name in (names[0], names[2]))
    assert commit(names[0], names[2]).returncode == 0
