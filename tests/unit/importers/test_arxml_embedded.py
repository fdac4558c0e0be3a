"""Native models in exported ARXML: exact where nothing was edited, else the standard elements are imported."""

import pytest
from lxml import etree

from arxml_reading import NS, all_of, by_path, q, write
from halpipe.core import embedding
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.codes import BESIDE_MODEL, EDITED, SECOND_MODEL, UNUSED_KIND
from halpipe.importers.common.base import ImportOptions
from support import access, after, chain, mode, model, ms, task, version

PUMP = task(
    "/pump",
    "1/30s",
    version("fast", "1/3ms", "u1 u2", access("bus", 0, "0.1ms", "1/3", "read")),
    version("slow", "2ms", "u2"),
)
VALVE = task(
    "valve", "20ms", version("v", "1ms", "u2", after("/pump", 1, 8, "end")), deadline="15.0005ms", offset="5ms"
)
VENT = task("vent", None, version("v", "1ms", "u1"))
SYSTEM = model(
    PUMP,
    VALVE,
    VENT,
    units="u1 u2",
    resources="bus",
    chains=[chain("c", "/pump valve", reaction="40ms", age="100/3ms")],
    modes=[mode("run", (PUMP, VALVE, VENT)), mode("idle", (PUMP,))],
    transitions=[("run", "idle", "1/3ms")],
)
PERIOD = q(".//PERIOD")


def factor(element, path):
    return element.find(q(f"{path}/CSE-CODE-FACTOR"))


def data(element, key):
    """The special data with a key, anywhere inside an element."""
    return next(sd for sd in element.iter(NS + "SD") if sd.get("GID") == key)


@pytest.fixture
def edit(tmp_path):
    """Export, change the file with a function, and import it: the model, and what was reported."""

    def run(change, strict=False, release="R22-11"):
        root = write(SYSTEM, release=release)
        change(root)
        path = tmp_path / "m.arxml"
        path.write_bytes(etree.tostring(root))
        imported = FORMAT.read([str(path)], ImportOptions(strict=strict))
        return imported.model, [(d.code, d.path, d.message) for d in imported.diagnostics]

    return run


def nothing(root):
    assert root is not None


@pytest.mark.parametrize("release", ["4.0.3", "R22-11"])
def test_what_nobody_edited_comes_back_without_a_word(edit, release):
    assert edit(nothing, release=release) == (SYSTEM, [])


def test_the_account_tells_what_carries_the_model(tmp_path):
    path = tmp_path / "m.arxml"
    path.write_bytes(etree.tostring(write(SYSTEM)))
    imported = FORMAT.read([str(path)], ImportOptions(name="other"))
    assert imported.model.name == "other"
    rows = {kind: (read, mapped) for kind, read, mapped, _ in imported.coverage.rows()}
    assert rows["RUNNABLE-ENTITY"] == (3, 3)
    assert not imported.coverage.ignored_elements


# ---------------------------------------------------------------------------------------------------- edited files


def period(root):
    by_path(root, "/m/Components/pump/Behavior/Every").find(NS + "PERIOD").text = "0.04"


def wcet(root):
    time = by_path(root, "/m/Implementations/pump_slow/Resources/u2")
    factor(time, "WORST-CASE-EXECUTION-TIME").text = "2500"


def unit_removed(root):
    unit = all_of(root, "HW-ELEMENT")["u1"]
    unit.getparent().remove(unit)


def event_removed(root):
    events = by_path(root, "/m/Components/valve/Behavior").find(NS + "EVENTS")
    events.remove(events[0])


def segments_swapped(root):
    refs = by_path(root, "/m/Timing/Requirements/c").find(NS + "SEGMENT-REFS")
    refs[:] = reversed(refs)


@pytest.mark.parametrize("change", [period, wcet, unit_removed, event_removed, segments_swapped])
def test_an_edit_of_any_standard_element_is_noticed(edit, change):
    found, reports = edit(change)
    assert (EDITED.id, 'AR-PACKAGE "/m"') in [(code, path) for code, path, _ in reports]
    assert found.tasks[0].name == "pump/pump", "a name of the standard elements"


def test_what_was_edited_counts(edit):
    assert edit(period)[0].task("pump/pump").period == ms(40)
    assert edit(wcet)[0].task("pump/pump").version("u2").wcet == ms("2.5ms")


def test_a_native_model_that_cannot_be_read_is_reported(edit):
    def change(root):
        data(root, "xml").text = data(root, "xml").text.replace("<tasks>", "<task>")

    found, reports = edit(change)
    (message,) = [message for code, _, message in reports if code == EDITED.id]
    assert message.startswith("the native model cannot be read")
    assert found.tasks[0].name == "pump/pump"


def test_a_message_about_the_native_model_names_the_line_of_the_file(tmp_path):
    path = tmp_path / "m.arxml"
    path.write_bytes(etree.tostring(write(SYSTEM)))
    pump = FORMAT.read([str(path)], ImportOptions()).model.task("/pump")
    assert 'name="/pump"' in path.read_text().splitlines()[pump.at.line - 1].replace("&quot;", '"')


def test_a_large_model_is_embedded_in_pieces(edit, monkeypatch):
    monkeypatch.setattr(embedding, "PIECE", 200)
    assert edit(nothing) == (SYSTEM, [])


def test_the_configuration_may_be_edited(edit):
    """ECUC values follow from the schedule, which is no part of the model."""

    def change(root):
        elements = root.find(q("AR-PACKAGES/AR-PACKAGE/AR-PACKAGES/AR-PACKAGE/ELEMENTS"))
        etree.SubElement(elements, NS + "ECUC-VALUE-COLLECTION")

    assert edit(change) == (SYSTEM, [])


def test_special_data_and_identifiers_of_other_tools_are_no_edits(edit):
    def change(root):
        for number, element in enumerate(root.iter(NS + "HW-ELEMENT")):
            element.set("UUID", f"{number}")
            other = etree.SubElement(element, NS + "ADMIN-DATA")
            etree.SubElement(etree.SubElement(other, NS + "SDGS"), NS + "SDG").set("GID", "tool")

    assert edit(change) == (SYSTEM, [])


def test_tools_may_wrap_and_move_what_they_keep(edit):
    """Blanks round values, units in another order, and a wrapped reference are no edits."""

    def change(root):
        for sd in root.iter(NS + "SD", NS + "SDX-REF", NS + "PERIOD", NS + "CSE-CODE-FACTOR"):
            sd.text = f"\n  {sd.text}\n"
        hardware = by_path(root, "/m/Platform").find(NS + "ELEMENTS")
        hardware[:] = sorted(hardware, key=lambda e: e.findtext(NS + "SHORT-NAME"))

    found, reports = edit(change)
    assert reports == []
    assert found == SYSTEM


def test_under_strict_an_edit_is_an_error(edit):
    with pytest.raises(HalpipeError) as refused:
        edit(period, strict=True)
    assert refused.value.exit is Exit.UNSUPPORTED


# ----------------------------------------------------------------------------------------------- whole inputs


def test_two_models_are_refused(tmp_path):
    paths = []
    for name in ("a", "b"):
        paths.append(str(tmp_path / f"{name}.arxml"))
        (tmp_path / f"{name}.arxml").write_bytes(
            etree.tostring(write(model(PUMP, resources="bus", units="u1 u2", name=name)))
        )
    with pytest.raises(HalpipeError) as refused:
        FORMAT.read(paths, ImportOptions())
    assert [(d.code, d.path) for d in refused.value.diagnostics] == [(SECOND_MODEL.id, 'AR-PACKAGE "/b"')]


def test_components_beside_a_model_are_reported(edit):
    def change(root):
        other = etree.fromstring(etree.tostring(root.find(q("AR-PACKAGES/AR-PACKAGE"))))
        other.find(NS + "SHORT-NAME").text = "Other"
        other.remove(other.find(NS + "ADMIN-DATA"))
        root.find(NS + "AR-PACKAGES").append(other)

    found, reports = edit(change)
    assert found == SYSTEM
    names = "/Other/Components/pump, /Other/Components/valve, /Other/Components/vent, /Other/System/Composition"
    assert reports[0] == (BESIDE_MODEL.id, "", f"4 component types are not imported: {names}")
    kinds = ("PERIODIC-EVENT-TRIGGERING", "LATENCY-TIMING-CONSTRAINT", "OFFSET-TIMING-CONSTRAINT")
    lost = {path.split()[0] for code, path, _ in reports[1:] if code == UNUSED_KIND.id and "/Other/" in path}
    assert (lost, len(reports)) == ({*kinds, "EXECUTION-ORDER-CONSTRAINT"}, 5)
