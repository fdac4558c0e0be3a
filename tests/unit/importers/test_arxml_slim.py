"""Large inputs are read without what cannot matter: the same model, and everything is still counted."""

from collections import Counter

import pytest
from arxml_case import (
    component,
    configuration,
    container,
    el,
    event,
    every,
    mapped,
    module,
    named,
    os_task,
    package,
    read,
    refusal,
    rte,
    write,
)

from halpipe.core.files import BROKEN_XML, HAS_DOCTYPE, xml
from halpipe.importers.arxml.files import sniff
from halpipe.importers.common.base import format_account

PUMP = component(
    "Pump",
    every("0.01", "Tick", "Pump/Step"),
    runnables="Step",
    extra=[el("DESC", "long"), el("ADMIN-DATA", el("SDGS", el("SDG", gid="Tool:x")))],
)
SIGNALS = [named("I-SIGNAL", f"S{index}") for index in range(5)]
TYPE = named("APPLICATION-RECORD-DATA-TYPE", "R", el("ELEMENTS", named("APPLICATION-RECORD-ELEMENT", "E")))


@pytest.fixture
def large(monkeypatch):
    monkeypatch.setattr(sniff, "LARGE_INPUT", 0)


def system(tmp_path, period="0.005"):
    com = module("Com", event("BSW-TIMING-EVENT", "T", "Com/Main", el("PERIOD", period)), entities="Main")
    other = container("Com/ComGeneral", "G", params={"ComCycle": "0.02"})
    ecu = package(
        "E",
        configuration("Os", os_task("Main"), container("Os/OsStack", "Stack")),
        configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1"), mapped("Com/B/T", "Main", "2", bsw=True))),
        configuration("Com", other),
    )
    return write(tmp_path, package("T", PUMP, com, *SIGNALS, TYPE), ecu)


@pytest.mark.parametrize("period", ["0.005", "ComCycle"])
def test_the_model_is_the_same(tmp_path, monkeypatch, period):
    path = system(tmp_path, period)
    whole = read(path)
    monkeypatch.setattr(sniff, "LARGE_INPUT", 0)
    slim = read(path)
    assert slim.model == whole.model
    assert {str(task.period) for task in slim.model.tasks} == {"10ms", "5ms" if period == "0.005" else "20ms"}
    assert slim.diagnostics == whole.diagnostics


def test_what_was_dropped_is_counted_by_kind(tmp_path, monkeypatch):
    path = system(tmp_path)
    whole = read(path).coverage
    monkeypatch.setattr(sniff, "LARGE_INPUT", 0)
    slim = read(path)
    dropped = Counter({"I-SIGNAL": 5, "APPLICATION-RECORD-DATA-TYPE": 1, "APPLICATION-RECORD-ELEMENT": 1})
    assert dropped <= slim.coverage.dropped_counts
    kinds = Counter()
    for coverage, sign in ((whole, 1), (slim.coverage, -1)):
        for kind, count, mapped_, ignored in coverage.rows():
            assert count == mapped_ + ignored
            name = "ECUC-CONTAINER-VALUE" if kind.startswith(("Os", "Rte", "Com")) else kind
            kinds[name] += sign * count
    assert not any(kinds.values())
    assert b'"kind": "I-SIGNAL",\n   "count": 5' in format_account(slim)


@pytest.mark.usefixtures("large")
def test_lines_are_those_of_the_file(tmp_path):
    path = write(tmp_path, package("T", *SIGNALS, component("Pump", every("0", "Tick", "Pump/Step"), runnables="Step")))
    path.write_text(path.read_text().replace("><", ">\n<"))
    (told,) = [d for d in refusal(path).diagnostics if d.code == "HAL0520"]
    assert "<PERIOD>" in path.read_text().splitlines()[told.at.line - 1]


@pytest.mark.usefixtures("large")
@pytest.mark.parametrize(
    ("text", "code"),
    [("<!DOCTYPE a>\n<AUTOSAR/>", HAS_DOCTYPE), ("<AUTOSAR>", BROKEN_XML), ("", BROKEN_XML), ("x", BROKEN_XML)],
)
def test_hostile_files_are_refused_all_the_same(tmp_path, text, code):
    path = tmp_path / "a.arxml"
    path.write_text(text)
    assert code.id in {d.code for d in refusal(path).diagnostics}


@pytest.mark.usefixtures("large")
def test_a_reference_to_what_is_kept_is_still_checked(tmp_path):
    pump = component("Pump", every("0.01", "Tick", "Pump/Gone"), every("0.01", "T2", "Pump/Step"), runnables="Step")
    found = read(write(tmp_path, package("T", pump))).diagnostics
    assert "HAL0511" in {d.code for d in found}


def test_own_data_are_kept(tmp_path, monkeypatch):
    from halpipe.exporters.arxml import FORMAT, ArxmlOptions

    path = system(tmp_path)
    model = read(path).model
    again = tmp_path / "again.arxml"
    again.write_bytes(FORMAT.write(model, None, ArxmlOptions())[""])
    whole = read(again).model
    monkeypatch.setattr(sniff, "LARGE_INPUT", 0)
    assert read(again).model == whole


def test_progress_is_told_in_bytes(tmp_path):
    path = system(tmp_path)
    second = write(tmp_path, package("U"), name="second.arxml")
    told = []
    read(tmp_path, on_progress=lambda done, total: told.append((done, total)))
    sizes = {p: p.stat().st_size for p in (path, second)}
    assert told == [(0, sum(sizes.values())), (sizes[second], sum(sizes.values()))]


@pytest.mark.usefixtures("large")
def test_progress_is_told_inside_a_file_too(tmp_path, monkeypatch):
    monkeypatch.setattr(xml, "_CHUNK_BYTES", 512)
    path = system(tmp_path)
    total = path.stat().st_size
    told = []
    read(path, on_progress=lambda done, total: told.append((done, total)))
    assert told == [(min(done, total), total) for done in range(0, total + 512, 512)]


@pytest.mark.usefixtures("large")
def test_a_broken_file_does_not_spoil_the_next(tmp_path):
    (tmp_path / "a.arxml").write_text("<AUTOSAR>")
    write(tmp_path, package("T", PUMP), name="b.arxml")
    found = read(tmp_path)
    assert [task.name for task in found.model.tasks] == ["Pump/Step"]
    assert "HAL0506" in {d.code for d in found.diagnostics}


def test_only_large_inputs_are_slimmed():
    assert sniff.LARGE_INPUT == 32 * 2**20


@pytest.mark.usefixtures("large")
def test_a_long_text_drops_no_file_of_a_large_input(tmp_path):
    content = package("T", PUMP).replace("<ELEMENTS>", el("DESC", "x" * 10_100_000) + "<ELEMENTS>", 1)
    assert [task.name for task in read(write(tmp_path, content)).model.tasks] == ["Pump/Step"]
