"""Releases before 4, and what tools write that is almost right."""

import re

import pytest
from arxml_case import FIXTURES, component, every, found, orders, package, periods, read, refusal, write

from halpipe.importers.arxml import codes

RELEASE3 = FIXTURES / "release3.arxml"


def test_release_3_gives_tasks_orders_and_modes():
    imported = read(RELEASE3)
    assert periods(imported) == {
        "sensor/Measure": "5ms",
        "pump/Control": "20ms",
        "pump/Filter": "5ms",
        "Watch": "100ms",
    }
    assert orders(imported) == {"sensor/Measure > pump/Filter"}
    runs = {mode.name: {run.task for run in mode.runs} for mode in imported.model.modes}
    everything = {"sensor/Measure", "pump/Control", "pump/Filter", "Watch"}
    assert runs == {"On": everything, "Standby": everything - {"pump/Control"}}


def test_release_3_mapping_gives_the_offset():
    assert str(read(RELEASE3).model.task("sensor/Measure").offset) == "2ms"


def test_release_3_variables_between_runnables_are_data_flow():
    (note,) = found(read(RELEASE3), codes.DATA_FLOW)
    assert "pump/Filter to pump/Control" in note.message


def test_release_3_keeps_lines():
    lines = RELEASE3.read_text().splitlines()
    for task in read(RELEASE3).model.tasks:
        assert "<RUNNABLE-ENTITY>" in lines[task.origin.line - 1] or "<CONTAINER>" in lines[task.origin.line - 1]


def test_release_3_passes_strict():
    (note,) = found(read(RELEASE3, strict=True), codes.OLD_RELEASE)
    assert "3.1.5" in note.message


def test_release_3_delegation_reaches_inner_components(tmp_path):
    text = RELEASE3.read_text().replace(
        "</COMPONENTS>",
        """<COMPONENT-PROTOTYPE><SHORT-NAME>box</SHORT-NAME><TYPE-TREF>/Plant/Types/Box</TYPE-TREF></COMPONENT-PROTOTYPE>
        </COMPONENTS>""",
    )
    box = """<COMPOSITION-TYPE><SHORT-NAME>Box</SHORT-NAME>
      <PORTS><R-PORT-PROTOTYPE><SHORT-NAME>level</SHORT-NAME></R-PORT-PROTOTYPE></PORTS>
      <COMPONENTS><COMPONENT-PROTOTYPE><SHORT-NAME>pump</SHORT-NAME>
        <TYPE-TREF>/Plant/Types/Pump</TYPE-TREF></COMPONENT-PROTOTYPE></COMPONENTS>
      <CONNECTORS><DELEGATION-CONNECTOR-PROTOTYPE><SHORT-NAME>d</SHORT-NAME>
        <INNER-PORT-IREF><COMPONENT-PROTOTYPE-REF>/Plant/Types/Box/pump</COMPONENT-PROTOTYPE-REF>
          <PORT-PROTOTYPE-REF DEST="R-PORT-PROTOTYPE">/Plant/Types/Pump/in</PORT-PROTOTYPE-REF></INNER-PORT-IREF>
        <OUTER-PORT-REF>/Plant/Types/Box/level</OUTER-PORT-REF>
      </DELEGATION-CONNECTOR-PROTOTYPE></CONNECTORS></COMPOSITION-TYPE><COMPOSITION-TYPE>"""
    text = text.replace("<COMPOSITION-TYPE>", box, 1)
    text = text.replace(
        ">/Plant/Types/Root/pump</COMPONENT-PROTOTYPE-REF>", ">/Plant/Types/Root/box</COMPONENT-PROTOTYPE-REF>"
    )
    text = text.replace(
        ">/Plant/Types/Pump/in</R-PORT-PROTOTYPE-REF>\n                  </REQUESTER",
        ">/Plant/Types/Box/level</R-PORT-PROTOTYPE-REF>\n                  </REQUESTER",
    )
    path = tmp_path / "nested.arxml"
    path.write_text(text)
    assert "sensor/Measure > box/pump/Filter" in orders(read(path))


@pytest.mark.parametrize("is_configured", [True, False])
def test_release_3_has_a_composition_of_its_own_for_services(tmp_path, is_configured):
    """The system names the other one only."""
    text = re.sub(r"<CONNECTORS>.*?</CONNECTORS>", "", RELEASE3.read_text(), flags=re.DOTALL)
    pump = re.search(r"<COMPONENT-PROTOTYPE>\s*<SHORT-NAME>pump<.*?</COMPONENT-PROTOTYPE>", text, re.DOTALL)[0]
    service = pump.replace("COMPONENT-PROTOTYPE", "SERVICE-COMPONENT-PROTOTYPE")
    service = service.replace("TYPE-TREF", "SERVICE-COMPONENT-TREF")
    more = f"""<ECU-SW-COMPOSITION><SHORT-NAME>Services</SHORT-NAME><COMPONENTS>{service}</COMPONENTS>
    </ECU-SW-COMPOSITION><SYSTEM><SHORT-NAME>S</SHORT-NAME><SOFTWARE-COMPOSITION><SHORT-NAME>all</SHORT-NAME>
      <SOFTWARE-COMPOSITION-TREF DEST="COMPOSITION-TYPE">/Plant/Types/Root</SOFTWARE-COMPOSITION-TREF>
    </SOFTWARE-COMPOSITION></SYSTEM><COMPOSITION-TYPE>"""
    text = text.replace(pump, "").replace("<COMPOSITION-TYPE>", more, 1)
    text = text.replace(">/Plant/Types/Root/pump<", ">/Plant/Types/Services/pump<")
    path = tmp_path / "services.arxml"
    path.write_text(text if is_configured else text.replace(">/Vendor/Rte<", ">/Vendor/Com<"))
    imported = read(path)
    assert periods(imported)["pump/Control"] == "20ms"
    assert not found(imported, codes.NOT_INSTANTIATED)


def test_other_namespaces_of_old_releases_are_read(tmp_path):
    for namespace in ("http://autosar.org/2.1.4", "http://autosar.org/3.1.2.DAI.2", "http://autosar.org"):
        path = tmp_path / "old.arxml"
        path.write_text(RELEASE3.read_text().replace("http://autosar.org/3.1.5", namespace))
        assert len(read(path).model.tasks) == 4


def test_mixed_releases_are_imported_together_and_warned_of(tmp_path):
    new = write(tmp_path, package("T", component("Valve", every("0.01", "E", "Valve/Move"), runnables="Move")))
    imported = read(RELEASE3, new)
    assert "Valve" not in {task.name for task in imported.model.tasks}  # the composition of the old file has none
    (warning,) = found(imported, codes.MIXED_RELEASES)
    assert "3.1.5, 4" in warning.message
    assert refusal(RELEASE3, new, strict=True)
