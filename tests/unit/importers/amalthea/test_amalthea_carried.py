"""Custom properties of halpipe: they count while they fit the standard elements, and hostile ones do no harm."""

import re

import pytest
from amalthea_case import files, found, refusal

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
def test_an_edited_standard_element_counts_and_the_property_is_told(tmp_path, change, read, expected):
    old, new = change
    imported = exported(tmp_path, (old.replace("?.", r"\?"), new))
    assert str(read(imported.model)) == expected
    assert len(found(imported.diagnostics, codes.EDITED)) == 1


def test_a_removed_condition_lets_the_task_run_in_all_modes(tmp_path):
    imported = exported(tmp_path, (r"(?s)<executionCondition>.*?</executionCondition>", ""))
    # Then no mode differs from the other, so they are one; and there is nothing to switch between.
    assert {m.name: [r.task for r in m.runs] for m in imported.model.modes} == {"default": ["first", "second"]}
    assert imported.model.transitions == ()
    assert sorted("runs" in d.message for d in found(imported.diagnostics, codes.EDITED)) == [False, True]


@pytest.mark.parametrize(
    "change",
    [
        ('value="100/3ms"', 'value="x"'),
        (r'value="1/7"', 'value="1/0"'),
        (r"\[\{&quot;resource", "{&quot;resource"),
        (r"&quot;resource&quot;: &quot;ram&quot;", "&quot;resource&quot;: &quot;rom&quot;"),
        (r"&quot;start&quot;: &quot;0ms&quot;, ", ""),
        (r"\[\[&quot;first&quot;", "[[1"),
        (r"\[\[&quot;first&quot;", "[[[&quot;first&quot;]"),
        (r"&quot;to&quot;: &quot;stop&quot;", "&quot;to&quot;: &quot;halt&quot;"),
        (r"\[\{&quot;from", "[1, {&quot;from"),
        ('value="u1"', 'value="u9"'),
    ],
)
def test_properties_that_cannot_be_used_are_told_and_left_out(tmp_path, change):
    imported = exported(tmp_path, change)
    assert found(imported.diagnostics, codes.EDITED)
    assert [t.name for t in imported.model.tasks] == ["first", "second"]


def test_properties_that_nest_without_end_are_told(tmp_path):
    imported = exported(tmp_path, (r'value="\[\{&quot;resource[^"]*"', f'value="{"[" * 100_000}"'))
    assert found(imported.diagnostics, codes.EDITED)


def test_a_wrong_unit_is_an_error_in_an_export_too(tmp_path):
    failure = refusal(exported, tmp_path, ('value="1.0" unit="GHz"', 'value="1.0" unit="THz"'))
    assert len(found(failure.diagnostics, codes.BAD_VALUE)) == 1
