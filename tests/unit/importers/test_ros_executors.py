"""Executors files read back: the native model in them, its lines, and what is wrong with either."""

import pytest
from ros_case import FIXTURES, found, read, reasons, refusal, rows

from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.options import RosImportOptions

TEXT = (FIXTURES / "executors.yaml").read_text()


def test_the_native_model_is_read():
    got = read("executors.yaml").model
    assert (got.name, [task.name for task in got.tasks]) == ("pair", ["/sense", "/act"])
    assert str(got.task("/sense").period) == "100/3ms"
    assert [[run.task for run in mode.runs] for mode in got.modes] == [["/sense", "/act"], ["/sense"]]


def test_the_model_may_have_another_name():
    imported = FORMAT.read([str(FIXTURES / "executors.yaml")], RosImportOptions(name="other"))
    assert imported.model.name == "other"


def test_elements_know_their_lines():
    got = read("executors.yaml").model
    assert TEXT.splitlines()[got.task("/act").at.line - 1].strip() == '<task name="/act">'
    assert got.task("/act").at.file == str(FIXTURES / "executors.yaml")


def test_executors_are_accounted_for_as_the_schedules():
    imported = read("executors.yaml")
    assert reasons(imported, "executor") == {"go u1": "is what the schedule says, not the model"}
    assert rows(imported)["task"] == [2, 2, 0]


def test_recordings_add_nothing():
    imported = read("executors.yaml", "bag/metadata.yaml")
    assert set(reasons(imported, "bag_topic").values()) >= {"the executors file states every period"}


def test_measurements_replace_the_wcet_of_a_task_with_one_version(tmp_path):
    table = tmp_path / "t.csv"
    table.write_text("callback,duration_ms\n" + "/act,5\n/sense,7\n" * 10)
    options = RosImportOptions(calibrate=(str(table),))
    imported = FORMAT.read([str(FIXTURES / "executors.yaml")], options)
    assert str(imported.model.task("/act").versions[0].wcet) == "5ms"
    assert [str(v.wcet) for v in imported.model.task("/sense").versions] == ["3ms", "1ms"]
    (left,) = found(imported.diagnostics, codes.UNMEASURED)
    assert "several versions" in left.message


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("executors: 2", "executors: 1", codes.MALFORMED.id, 2),
        ("model-xml: |", "model-xml: {}\nmore: |", codes.MALFORMED.id, 13),
        ("model-xml: |", "more: |", codes.MALFORMED.id, 2),
        ('period="100/3ms"', 'period="7"', "HAL0102", 17),
        ("</task-model>", "</task>", "HAL0010", 29),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, old, new, code, line):
    assert old in TEXT
    path = tmp_path / "x.yaml"
    path.write_text(TEXT.replace(old, new, 1))
    assert (code, line) in [(d.code, d.at.line) for d in refusal(path).diagnostics if d.is_error]


def test_a_key_that_nothing_reads_is_named(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text(TEXT + "tasks: []\n")
    (key,) = found(FORMAT.read([str(path)], RosImportOptions()).diagnostics, codes.UNKNOWN_KEY)
    assert key.at.line == TEXT.count("\n") + 1
