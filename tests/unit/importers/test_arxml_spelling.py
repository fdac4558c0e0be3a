"""Elements and files that are almost what the importer reads."""

import pytest
from arxml_case import component, el, every, found, named, package, periods, read, refusal, write

from halpipe.importers.arxml import codes

PUMP = component("Pump", every("0.01", "A", "Pump/Step"), runnables="Step")


def with_element(tmp_path, tag):
    """Import a component with one more element of that tag in it."""
    return read(write(tmp_path, package("T", PUMP, named(tag, "X"))))


@pytest.mark.parametrize(
    ("slip", "meant"),
    [
        ("TIMMING-EVENT", "TIMING-EVENT"),
        ("TIMING-EVNT", "TIMING-EVENT"),
        ("TIMNIG-EVENT", "TIMING-EVENT"),
        ("RUNNABLE_ENTITY", "RUNNABLE-ENTITY"),
        ("Process", "PROCESS"),
    ],
)
def test_one_slip_is_named_with_what_was_meant(tmp_path, slip, meant):
    (warning,) = found(with_element(tmp_path, slip), codes.UNKNOWN_ELEMENT)
    assert slip in warning.message
    assert meant in warning.help


@pytest.mark.parametrize(
    "tag", ["EVENT", "SUCCESSOR-REF", "SUCCESSOR-REFS", "R-PORT-PROTOTYPE", "TYPE-IREF", "PROCESSORS", "VENDOR-THING"]
)
def test_other_elements_are_no_slips(tmp_path, tag):
    assert not found(with_element(tmp_path, tag), codes.UNKNOWN_ELEMENT)


def test_elements_of_another_namespace_are_named(tmp_path):
    foreign = '<TIMING-EVENT xmlns="http://example.org/other"/>'
    imported = read(write(tmp_path, package("T", PUMP, foreign)))
    (warning,) = found(imported, codes.UNKNOWN_ELEMENT)
    assert "http://example.org/other" in warning.message


def test_a_path_in_another_case_reaches_its_element(tmp_path):
    pump = PUMP.replace("/T/Pump/B/Step", "/t/PUMP/b/step")
    imported = read(write(tmp_path, package("T", pump)))
    assert periods(imported) == {"Pump/Step": "10ms"}
    assert found(imported, codes.WRONG_CASE)
    assert refusal(write(tmp_path, package("T", pump)), strict=True)


def test_elements_without_name_are_accounted_for(tmp_path):
    nameless = component("Pump", every("0.01", "A", "Pump/Step"), el("TIMING-EVENT"), runnables="Step")
    imported = read(write(tmp_path, package("T", nameless)))
    assert ("TIMING-EVENT", 2, 1, 1) in imported.coverage.rows()
    assert found(imported, codes.MALFORMED)


def test_project_data_of_tresos_in_a_directory_is_skipped_with_a_word(tmp_path):
    write(tmp_path, package("T", PUMP))
    (tmp_path / "Os.xdm").write_text("<datamodel/>")
    (warning,) = found(read(tmp_path), codes.SKIPPED_FILE)
    assert warning.at.file.endswith("Os.xdm")
