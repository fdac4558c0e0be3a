"""Files for code hosting: workflows, the action, the hook for pre-commit, containers and forms.

Their commands run here; the hosting services and docker themselves do not.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
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


MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def workflow_commands(document):
    return [step["run"] for job in document["jobs"].values() for step in job["steps"] if "run" in step]


@pytest.mark.parametrize(("name", "goals"), [("test", {"test-fast"}), ("release", {"wheels", "site"})])
def test_workflows_run_targets_of_the_makefile(name, goals):
    document = parsed(f".github/workflows/{name}.yml")
    assert document["permissions"] == {"contents": "read"}
    makes = [shlex.split(command) for command in workflow_commands(document) if command.startswith("make ")]
    words = [word for make in makes for word in make[1:]]
    targets = {word for word in words if "=" not in word}
    assert goals <= targets <= set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
    variables = [word.partition("=")[0] for word in words if "=" in word]
    assert all(re.search(rf"\$\({name}\)", MAKEFILE) or f"{name} ?=" in MAKEFILE for name in variables)


def test_a_release_publishes_what_the_build_attested():
    jobs = parsed(".github/workflows/release.yml")["jobs"]
    used = [step.get("uses", "").partition("@")[0] for step in jobs["build"]["steps"]]
    assert used.index("actions/attest-build-provenance") < used.index("actions/upload-artifact")
    assert jobs["publish"]["needs"] == "build"
    assert jobs["publish"]["permissions"] == {"id-token": "write"}  # trusted publishing, without a stored password
    assert "--evidence" in " ".join(workflow_commands(parsed(".github/workflows/release.yml")))


def test_a_release_states_links_that_lead_somewhere_on_the_page_of_an_index(monkeypatch):
    pytest.importorskip("hatchling")
    monkeypatch.syspath_prepend(str(ROOT))
    from hatch_build import Description

    def described(source):
        monkeypatch.setenv("HALPIPE_SOURCE", source)
        metadata = {}
        Description(str(ROOT), {}).update(metadata)
        return metadata, re.findall(r"\]\(([^)]+)\)", metadata["readme"]["text"])

    steps = parsed(".github/workflows/release.yml")["jobs"]["build"]["steps"]
    (made,) = (step for step in steps if step.get("run", "").startswith("make wheels"))
    assert made["env"]["HALPIPE_SOURCE"].endswith("/blob/${{ github.ref_name }}")
    plain, links = described("")
    assert plain["readme"]["text"] == (ROOT / "README.md").read_text(encoding="utf-8")
    assert "urls" not in plain
    released, absolute = described("https://example.org/o/n/blob/v1")
    assert absolute == [
        link
        if link.startswith(("https:", "#"))
        else f"https://example.org/o/n/blob/v1/{link}{'?raw=true' * (link[-4:] == '.png')}"
        for link in links
    ]
    for address in released["urls"].values():
        assert (ROOT / address.removeprefix("https://example.org/o/n/blob/v1").lstrip("/")).exists()


@pytest.fixture
def shell(tmp_path):
    program = tmp_path / "bin" / "halpipe"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m halpipe "$@"\n')
    program.chmod(0o755)

    def run(command, **variables):
        environment = os.environ | {"PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"} | variables
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    return run


@pytest.mark.slow
def test_the_action_reports_findings_and_fails_with_them(shell, tmp_path):
    action = parsed("action.yml")
    _, check = action["runs"]["steps"]
    given = dict(zip(check["env"], ("model.xml", "", "found.sarif"), strict=True))
    assert {f"${{{{ inputs.{name} }}}}" for name in action["inputs"]} == set(check["env"].values())
    right = first_model()["model.xml"]
    for content, code in ((right, 0), (right.replace(b'wcet="6ms"', b'wcet="66ms"'), 1)):
        (tmp_path / "model.xml").write_bytes(content)
        done = shell(["bash", "-e", "-c", check["run"]], **given)
        assert done.returncode == code, done.stderr
        results = json.loads((tmp_path / "found.sarif").read_text())["runs"][0]["results"]
        assert any(result["level"] == "error" for result in results) == bool(code)
    (tmp_path / "model.xml").write_bytes(right)
    assert shell(["halpipe", "schedule", "model.xml", "-o", "s.xml", "-q"]).returncode == 0
    assert shell(["bash", "-e", "-c", check["run"]], **given | {"SCHEDULE": "s.xml"}).returncode == 0
    (tmp_path / "s.xml").write_bytes((tmp_path / "s.xml").read_bytes().replace(b'end="', b'end="1'))
    assert shell(["bash", "-e", "-c", check["run"]], **given | {"SCHEDULE": "s.xml"}).returncode == 1


def test_containers_install_extras_that_there_are():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (named,) = re.findall(r'"\.\[([a-z,]+)\]"', (ROOT / "Dockerfile").read_text(encoding="utf-8"))
    assert set(named.split(",")) <= set(extras)
    command = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())["onCreateCommand"]
    target = command.rpartition(" ")[2]
    assert f"{target.replace('.venv', '$(VENV)')}:" in MAKEFILE


def test_forms_ask_for_input_and_judge():
    for form in sorted((ROOT / ".github" / "ISSUE_TEMPLATE").iterdir()):
        document = yaml.safe_load(form.read_text(encoding="utf-8"))
        assert {"name", "description", "body"} <= set(document)
        assert all(field["attributes"]["label"] for field in document["body"])


@pytest.mark.slow
def test_the_hook_validates_every_model_of_a_commit(shell, tmp_path):
    (hook,) = parsed(".pre-commit-hooks.yaml")
    assert hook["id"] == "halpipe-validate"
    assert [bool(re.search(hook["files"], name)) for name in ("model.xml", "a/model.xml", "mymodel.xml")] == [1, 1, 0]
    right = first_model()["model.xml"]
    names = ("right model.xml", "wrong.xml", "right too.xml")
    for name, content in zip(names, (right, right.replace(b'wcet="6ms"', b'wcet="66ms"'), right), strict=True):
        (tmp_path / name).write_bytes(content)

    def commit(*given):
        return shell([*shlex.split(hook["entry"]), *given])

    mixed = commit(*names)
    assert mixed.returncode == 1
    assert "wrong.xml:" in mixed.stdout
    assert all(f"{name}: valid" in mixed.stdout for name in (names[0], names[2]))
    assert commit(names[0], names[2]).returncode == 0
