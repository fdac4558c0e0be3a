"""Units of the overlay in whole imports: nothing is said of units that the importer would assume without it."""

import pytest
from arxml_case import component, every, package, write
from ros_case import FIXTURES

from halpipe.flow.formats import import_model, importer
from halpipe.importers.arxml.codes import DEFAULT_UNIT as ARXML_UNIT
from halpipe.importers.overlay.codes import REPLACED
from halpipe.importers.ros.codes import DEFAULT_UNIT as ROS_UNIT

OVERLAY = "halpipe-overlay: 1\ntasks: {'*': {wcet: 1ms}}\n"
UNITS = "platform: {units: [{name: big}]}\n"


def imports(folder, format, source, text):
    """The units of an import with an overlay, and the codes of what it says of units."""
    file = folder / "overlay.yaml"
    file.write_text(text)
    found = import_model(format, [str(source)], importer(format).options(overlays=(str(file),)))
    said = {d.code for d in found.diagnostics} & {ARXML_UNIT.id, ROS_UNIT.id, REPLACED.id}
    return [unit.name for unit in found.model.units], said


@pytest.mark.parametrize(("format", "code"), [("ros", ROS_UNIT), ("arxml", ARXML_UNIT)])
def test_no_unit_is_assumed_where_the_overlay_names_units(tmp_path, format, code):
    source = FIXTURES / "stack.yaml"
    if format == "arxml":
        source = write(tmp_path, package("T", component("C", every("0.01", "E", "C/R"), runnables="R")))
    assert imports(tmp_path, format, source, OVERLAY) == (["core0"], {code.id})
    assert imports(tmp_path, format, source, OVERLAY + UNITS) == (["big"], set())
