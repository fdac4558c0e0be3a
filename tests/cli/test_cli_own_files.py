"""Nobody's files are lost: no verb writes over its inputs, or over what somebody else put beside its outputs."""

import os
import shutil
import subprocess
import sys

import pytest
import typer
from test_cli_regulator import PLATFORM

from halpipe.cli.app import VERBS, build
from halpipe.core.files import FOREIGN_FILE, FOREIGN_FOLDER, OUTPUT_IS_INPUT

OVERLAY = "halpipe-overlay: 1\n"
PIPELINE = """\
halpipe-pipeline: 1
model: {model}
schedule: {{output: {schedule}}}
exports:
  - {{format: report, output: {report}}}
"""


@pytest.fixture
def place(folder, halpipe):
    """A folder with an input of every kind, and links to them."""
    assert halpipe("schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0
    (folder / "platform.yaml").write_text(PLATFORM)
    (folder / "source").mkdir()
    assert halpipe("export", "amalthea", "model.xml", "s.xml", "-o", "source/a.amxmi", "-q").returncode == 0
    (folder / "overlay.yaml").write_text(OVERLAY)
    (folder / "pipe.yaml").write_text(PIPELINE.format(model="model.xml", schedule="out.xml", report="r.html"))
    for name in ("model.xml", "s.xml", "overlay.yaml", "platform.yaml"):
        (folder / f"link-{name}").symlink_to(folder / name)
        os.link(folder / name, folder / f"hard-{name}")
    (folder / "here").symlink_to(folder)
    return folder


EXPORTS = ["amalthea", "arxml", "btf", "feo", "graph", "launch-manager", "report", "ros", "timpani", "trace", "xlsx"]
OVERWRITING = {
    "schedule": ["schedule model.xml -o {model.xml}", "schedule model.xml --freeze s.xml -o {s.xml}"],
    "import": [
        "import amalthea source/a.amxmi --overlay overlay.yaml -o {overlay.yaml}",
        "import amalthea source --overlay overlay.yaml -o source/a.amxmi",
        "import amalthea source --overlay overlay.yaml -o new.xml --report {overlay.yaml}",
        "import amalthea source --overlay overlay.yaml -o new.xml --report ./new.xml",
        "import amalthea source --overlay overlay.yaml -o - --report -",
    ],
    "run": ["run pipe.yaml"],
    "generate": ["generate -o new.xml --witness here/new.xml"],
    "export": [
        f"export {format} model.xml s.xml -o {{{file}}}" for format in EXPORTS for file in ("model.xml", "s.xml")
    ],
}
CASES = [
    command.replace(f"{{{file}}}", spelling.format(file)) if f"{{{file}}}" in command else command
    for commands in OVERWRITING.values()
    for command in commands
    for file in ("model.xml", "s.xml", "overlay.yaml")
    for spelling in ("{}", "link-{}", "here/{}", "hard-{}")
    if f"{{{file}}}" in command or ("{" not in command and (file, spelling) == ("model.xml", "{}"))
]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}


@pytest.mark.parametrize("command", [case for case in CASES if not case.startswith("run")])
def test_no_verb_writes_over_its_input(place, halpipe, command):
    before = contents(place)
    refused = halpipe(*command.split(), "-q")
    assert (refused.returncode, OUTPUT_IS_INPUT.id in refused.stderr) == (2, True), refused.stderr
    assert contents(place) == before


@pytest.mark.parametrize(
    "outputs",
    [
        {"schedule": "model.xml", "report": "r.html"},
        {"schedule": "pipe.yaml", "report": "r.html"},
        {"schedule": "out.xml", "report": "link-model.xml"},
        {"schedule": "out.xml", "report": "here/out.xml"},
        {"schedule": "out.xml", "report": "pipe.yaml"},
        {"schedule": "out.xml", "report": "out.xml"},
    ],
)
def test_no_pipeline_writes_over_its_inputs_or_twice_to_one_file(place, halpipe, outputs):
    (place / "pipe.yaml").write_text(PIPELINE.format(model="model.xml", **outputs))
    before = contents(place)
    refused = halpipe("run", "pipe.yaml", "-q")
    assert (refused.returncode, OUTPUT_IS_INPUT.id in refused.stderr) == (2, True), refused.stderr
    assert contents(place) == before


def test_standard_input_that_is_a_file_is_an_input(place):
    with open(place / "model.xml", "rb") as model:
        refused = subprocess.run(
            [sys.executable, "-m", "halpipe", "schedule", "-", "-o", "model.xml"],
            cwd=place, stdin=model, capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert (refused.returncode, OUTPUT_IS_INPUT.id in refused.stderr) == (2, True)


def test_every_verb_that_writes_is_tried_above():
    """A verb that is added with an output belongs into the table, unless it is listed here with what tries it."""
    elsewhere = {"deploy": "test_a_bundle_is_not_written_over"}
    group = typer.main.get_command(build(VERBS))
    writing = {name for name, command in group.commands.items() if hasattr(command, "commands") or _writes(command)}
    assert writing | {"run"} == {*OVERWRITING, *elsewhere}
    formats = group.commands["export"]
    names = set(formats.list_commands(formats.make_context("export", [], resilient_parsing=True)))
    assert names == {*EXPORTS, "linux", "regulator", "riscv"}


def _writes(command):
    options = [option for option in command.params if option.param_type_name == "option"]
    return any("-o" in option.opts or option.name in ("report", "witness", "trace") for option in options)


def test_a_bundle_is_not_written_over(place, halpipe):
    export = ["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg", "-q"]
    assert halpipe(*export).returncode == 0
    inside = ["export", "regulator", "cfg/model.xml", "cfg/schedule.xml", *export[4:]]
    before = contents(place / "cfg")
    refused = halpipe(*inside)
    assert (refused.returncode, OUTPUT_IS_INPUT.id in refused.stderr) == (2, True)
    traced = halpipe("deploy", "check", "cfg", "--engine", "none", "--trace", "cfg/model.xml")
    assert traced.returncode != 0
    assert contents(place / "cfg") == before


def test_notes_in_a_bundle_stop_the_next_export(place, halpipe):
    export = ["export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "cfg", "-q"]
    assert halpipe(*export).returncode == 0
    (place / "cfg" / "notes.txt").write_text("years of work")
    refused = halpipe(*export)
    assert refused.returncode == 1
    assert FOREIGN_FOLDER.id in refused.stderr
    assert '"notes.txt"' in refused.stderr
    assert (place / "cfg" / "notes.txt").read_text() == "years of work"
    (place / "cfg" / "notes.txt").unlink()
    assert halpipe(*export).returncode == 0


def test_a_foreign_folder_with_a_manifest_of_its_own_is_left_alone(place, halpipe):
    (place / "web").mkdir()
    (place / "web" / "manifest.json").write_text("{}")
    (place / "web" / "thesis.tex").write_text("x")
    refused = halpipe("export", "regulator", "model.xml", "s.xml", "--platform", "platform.yaml", "-o", "web")
    assert refused.returncode == 1
    assert contents(place / "web") == {"manifest.json": b"{}", "thesis.tex": b"x"}


def test_a_file_named_like_a_checkpoint_is_left_alone(place, halpipe):
    (place / "my.resume").write_text("career")
    refused = halpipe("schedule", "model.xml", "-o", "my.xml")
    assert refused.returncode == 1
    assert FOREIGN_FILE.id in refused.stderr
    assert (place / "my.resume").read_text() == "career"
    assert not (place / "my.xml").exists()


@pytest.mark.parametrize("kept", ["no schedule", "a complete schedule", "frozen"])
def test_a_failed_search_replaces_only_what_one_left(place, halpipe, kept):
    search = ["schedule", "hopeless.xml", "--budget", "20", "-o", "out.xml", "-q"]
    if kept == "frozen":
        assert halpipe(*search).returncode == 3
        search += ["--freeze", "out.best.xml"]
    elif kept == "no schedule":
        (place / "out.best.xml").write_text("my best ideas")
    else:
        shutil.copy(place / "s.xml", place / "out.best.xml")
    before = (place / "out.best.xml").read_bytes()
    for _ in range(2):
        # Frozen jobs that exclude each other are a proof: nothing is searched, and nothing written.
        assert halpipe(*search).returncode == (4 if kept == "frozen" else 3)
        assert (place / "out.best.xml").read_bytes() == before
        written = [] if kept == "frozen" else ["out.best-2.xml"]
        assert sorted(path.name for path in place.glob("out.best*")) == [*written, "out.best.xml"]
