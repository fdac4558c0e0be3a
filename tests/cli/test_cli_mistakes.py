"""Mistakes that everybody makes once, and what halpipe says of them."""

import pytest

from command_line import run_here
from halpipe.starters import first_model

AUTOSAR = '<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES/></AUTOSAR>'
AMALTHEA = '<am:Amalthea xmlns:am="http://app4mc.eclipse.org/amalthea/3.0.0"/>'


@pytest.fixture
def folder(tmp_path):
    for name, content in first_model().items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / "extract.arxml").write_text(AUTOSAR)
    (tmp_path / "system.amxmi").write_text(AMALTHEA)
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "schedule.xml", "-q").returncode == 0
    return tmp_path


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["validate", "extract.arxml"], "halpipe import arxml"),
        (["schedule", "system.amxmi", "-o", "s.xml"], "halpipe import amalthea"),
        (["validate", "overlay.yaml"], "halpipe import"),
        (["schedule", "graph.dot", "-o", "s.xml"], "halpipe import"),
        (["verify", "schedule.xml", "model.xml"], "MODEL first, then SCHEDULE"),
        (["export", "report", "schedule.xml", "model.xml", "-o", "r.html"], "MODEL first, then SCHEDULE"),
        (["show", "model.xml"], "this is a model"),
    ],
)
def test_a_file_of_another_kind(folder, words, remedy):
    refused = run_here(folder, *words)
    assert refused.returncode == 1
    assert remedy in refused.stderr


@pytest.mark.parametrize("text", ["tasks:\n  *: {wcet: 1ms}\n", "tasks: {a: {units: [*core]}}\n", "drop: *_log\n"])
def test_globs_without_quotes(folder, text):
    (folder / "o.yaml").write_text("halpipe-overlay: 1\n" + text)
    refused = run_here(folder, "import", "ros", "graph.dot", "--overlay", "o.yaml", "-o", "m.xml")
    assert refused.returncode == 1
    assert "quote names that begin with *" in refused.stderr


@pytest.mark.parametrize("verb", ["import", "export"])
def test_a_format_that_is_not_there_is_a_usage_error(folder, verb):
    refused = run_here(folder, verb, "arxmll", "model.xml", "-o", "x")
    assert refused.returncode == 2
    assert 'did you mean "arxml"' in refused.stderr
