"""The JSON schemas that come with halpipe: made by its readers, and right about its own files and outputs."""

import json
import re
import subprocess
import sys
from pathlib import Path

import build_native
import pytest
import yaml
from jsonschema import Draft7Validator

import halpipe
from command_line import run_here
from halpipe import starters
from halpipe.exporters.native import format_model
from support import small_model

ROOT = Path(__file__).parents[2]
SCHEMAS = Path(halpipe.__file__).parent / "schemas"
KINDS = {
    "halpipe-overlay": "overlay",
    "halpipe-regulator": "platform",
    "halpipe-pipeline": "pipeline",
    "halpipe-profile": "profile",
}


def validator(name):
    schema = json.loads((SCHEMAS / f"{name}-1.schema.json").read_bytes())
    Draft7Validator.check_schema(schema)
    return Draft7Validator(schema)


def kind_of(text):
    return next((kind for key, kind in KINDS.items() if f"{key}: 1" in text), None)


OWN = sorted(
    path
    for folder in ("examples", "src/halpipe/profiles")
    for path in (ROOT / folder).rglob("*.yaml")
    if kind_of(path.read_text(encoding="utf-8"))
)


def test_the_schemas_on_disk_are_those_that_the_readers_make(tmp_path):
    made = build_native.write_schemas(tmp_path)
    assert {path: path.read_bytes() for path in SCHEMAS.glob("*.json")} == {
        SCHEMAS.parents[1] / place: path.read_bytes() for place, path in made.items()
    }, "run python build_native.py"


def test_a_working_copy_without_schemas_is_built_again(tmp_path, monkeypatch):
    monkeypatch.setattr(starters, "HERE", tmp_path / "starters")
    (tmp_path / "starters" / "first").mkdir(parents=True)
    done = run_here(tmp_path, "new", "demo")
    assert done.returncode == 1
    assert "build_native.py" in done.stderr
    assert "HAL0941" in done.stderr


def test_schemas_are_made_where_no_package_is_installed(tmp_path):
    """A wheel is made in such an environment; formats of others that are installed stay out."""
    code = f"import build_native, pathlib; build_native.write_schemas(pathlib.Path({str(tmp_path)!r}))"
    subprocess.run(
        [sys.executable, "-I", "-S", "-c", f"import sys; sys.path[:0] = [{str(ROOT)!r}]; {code}"], check=True
    )
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in SCHEMAS.glob("*.json")}


@pytest.mark.parametrize("path", OWN, ids=lambda path: str(path.relative_to(ROOT)))
def test_our_own_files_follow_their_schemas(path):
    text = path.read_text(encoding="utf-8")
    assert [e.message for e in validator(kind_of(text)).iter_errors(yaml.safe_load(text))] == []


def test_there_are_files_of_each_kind():
    assert {kind_of(path.read_text(encoding="utf-8")) for path in OWN} == set(KINDS.values())


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("overlay", "halpipe-overlay: 1\ntaskz: {}\n"),
        ("overlay", "halpipe-overlay: 1\ntasks: {a: {wcet: 5}}\n"),
        ("overlay", "halpipe-overlay: 1\ntasks: {a: {binding: often}}\n"),
        ("platform", "halpipe-regulator: 1\nclock: 250MHz\n"),
        ("pipeline", "halpipe-pipeline: 1\nmodel: m.xml\nschedule: {output: s.xml}\nexports: [{format: dot}]\n"),
        ("pipeline", "halpipe-pipeline: 2\nmodel: m.xml\nschedule: {output: s.xml}\n"),
        ("profile", "halpipe-profile: 1\nuart: {kind: other, base: 1}\n"),
    ],
)
def test_what_the_readers_refuse_an_editor_marks(kind, text):
    assert list(validator(kind).iter_errors(yaml.safe_load(text)))


def test_what_show_and_doctor_print_follows_its_schema(tmp_path):
    (tmp_path / "model.xml").write_bytes(format_model(small_model()))
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "s.xml").returncode == 0
    for kind, arguments in (
        ("show", ("show", "s.xml", "--format", "json")),
        ("doctor", ("doctor", "--format", "json")),
    ):
        printed = json.loads(run_here(tmp_path, *arguments).stdout)
        assert [e.message for e in validator(kind).iter_errors(printed)] == []


def test_findings_follow_their_schema(tmp_path):
    """Those of a model with a misspelt unit, which has a fix, and a name that two tasks have, at two places."""
    text = format_model(small_model()).decode()
    first = text.index("<task name=")
    task = text[first : text.index("</task>") + len("</task>")]
    unit = re.search(r'<unit name="([^"]+)"', text)[1]
    wrong = text[:first] + task + "\n" + text[first:].replace(f'<units names="{unit}', f'<units names="{unit}x', 1)
    (tmp_path / "model.xml").write_text(wrong)
    done = run_here(tmp_path, "validate", "model.xml", "--format", "json")
    assert done.returncode == 1
    printed = json.loads(done.stdout or done.stderr)
    assert [e.message for e in validator("findings").iter_errors(printed)] == []
    assert any("fix" in finding for finding in printed)
    assert any(finding["places"] for finding in printed)
    assert all(finding["subjects"] for finding in printed)
    assert list(validator("findings").iter_errors([{**printed[0], "subjects": ["a"]}]))
