"""Native models in exported AMALTHEA: exact where nothing was edited, else the standard elements are imported."""

import re

import pytest
from amalthea_case import files, found, refusal

from halpipe.core import embedding
from halpipe.exporters.amalthea import FORMAT as OUT
from halpipe.exporters.amalthea import AmaltheaOptions
from halpipe.importers.amalthea import codes
from support import access, after, chain, mode, model, task, version

FAST = version("fast", "1/3ms", "u1", access("ram", "0ms", "0.1ms"))
FIRST = task("first", "100/3ms", FAST, slack="1/7", offset="1ms")
SECOND = task("second", "20ms", version("only", "2ms", "u1 u2", after("first", "0ms", "10ms", "end"), gang=2))
MODEL = model(
    FIRST,
    SECOND,
    units="u1 u2",
    resources="ram",
    chains=[chain("c", "first second", age="1/3s")],
    modes=[mode("run", [FIRST, SECOND]), mode("stop", [SECOND])],
    transitions=[("run", "stop", "5ms")],
)


def exported(tmp_path, *changes):
    """Export MODEL, change the text, import it."""
    text = OUT.write(MODEL, None, AmaltheaOptions())[""].decode()
    for old, new in changes:
        assert re.search(old, text), old
        text = re.sub(old, new, text, count=1)
    path = tmp_path / "m.amxmi"
    path.write_text(text, encoding="utf-8")
    return files(path)


def test_exact_values_come_back(tmp_path):
    imported = exported(tmp_path)
    first = imported.model.task("first")
    assert (str(first.period), str(first.slack), str(first.versions[0].wcet)) == ("100/3ms", "1/7", "1000/3us")
    assert (imported.model.name, found(imported.diagnostics, codes.EDITED)) == ("m", [])


@pytest.mark.parametrize(
    ("change", "read", "expected"),
    [
        (('value="33333333333" unit="ps"', 'value="30" unit="ms"'), lambda m: m.task("first").period, "30ms"),
        (('<offset value="1" unit="ms"', '<offset value="2" unit="ms"'), lambda m: m.task("first").offset, "2ms"),
        (('Constant" value="333334"', 'Constant" value="500000"'), lambda m: m.task("first").versions[0].wcet, "500us"),
        (('affinity="u1?.type=Pro', 'affinity="u2?type=Pro'), lambda m: m.task("first").versions[0].units[0], "u2"),
    ],
)
def test_an_edited_standard_element_counts_and_a_warning_says_so(tmp_path, change, read, expected):
    old, new = change
    imported = exported(tmp_path, (old.replace("?.", r"\?"), new))
    assert str(read(imported.model)) == expected
    assert len(found(imported.diagnostics, codes.EDITED)) == 1


def test_a_removed_condition_lets_the_task_run_in_all_modes(tmp_path):
    imported = exported(tmp_path, (r"(?s)<executionCondition>.*?</executionCondition>", ""))
    # Then no mode differs from the other, so they are one.
    assert {m.name: [r.task for r in m.runs] for m in imported.model.modes} == {"default": ["first", "second"]}
    assert len(found(imported.diagnostics, codes.EDITED)) == 1


@pytest.mark.parametrize("text", ["&lt;tasks&gt;", "&lt;task-model ", "period=&quot;100/3ms"])
def test_a_native_model_that_cannot_be_read_is_told(tmp_path, text):
    imported = exported(tmp_path, (text, "&lt;other "))
    (told,) = found(imported.diagnostics, codes.EDITED)
    assert told.message.startswith("the native model cannot be read")
    assert [t.name for t in imported.model.tasks] == ["first", "second"]


def test_a_model_in_pieces_comes_back(tmp_path, monkeypatch):
    monkeypatch.setattr(embedding, "PIECE", 100)
    imported = exported(tmp_path)
    assert imported.model == MODEL
    assert found(imported.diagnostics, codes.EDITED) == []


def test_blanks_and_prefixes_are_no_edits(tmp_path):
    imported = exported(tmp_path, (r"<swModel>\n +", "<swModel>"), (r"xmlns:am=", "xmlns:sys='urn:x' xmlns:am="))
    assert imported.model == MODEL


def test_a_file_beside_an_export_is_told(tmp_path):
    (tmp_path / "other.amxmi").write_text('<am:Amalthea xmlns:am="http://app4mc.eclipse.org/amalthea/3.3.0"/>')
    assert exported(tmp_path).model == MODEL
    several = files(tmp_path / "m.amxmi", tmp_path / "other.amxmi")
    (told,) = found(several.diagnostics, codes.EDITED)
    assert told.message.startswith("other files stand beside an export")


def test_a_wrong_unit_is_an_error_in_an_export_too(tmp_path):
    failure = refusal(exported, tmp_path, ('value="1.0" unit="GHz"', 'value="1.0" unit="THz"'))
    assert len(found(failure.diagnostics, codes.BAD_VALUE)) == 1
