"""Edits saved as an overlay: an import of the source with it gives the model that the workbench shows."""

from dataclasses import replace

import pytest
from lxml import etree

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.native import format_model
from halpipe.importers.common.base import Coverage
from halpipe.importers.native import parse_model
from halpipe.importers.overlay import OverlayUse, read_overlays
from halpipe.starters import first_model
from halpipe.workbench.edits import Edit, edited
from halpipe.workbench.overlay import overlay_of

EDITS = {
    "WCET": [Edit("version", "camera", "wcet", "7ms", "full")],
    "units": [Edit("version", "logging", "units", "core1", "only")],
    "period and slack": [Edit("task", "logging", "period", "25ms"), Edit("task", "logging", "slack", "1/8")],
    "offset and binding": [Edit("task", "camera", "offset", "1ms"), Edit("task", "camera", "binding", "system")],
    "deadline": [Edit("task", "logging", "deadline", "20ms")],
    "window": [Edit("window", "detection", "max", "3ms", "fine", "camera")],
    "chain": [Edit("chain", "see-and-brake", "max_reaction", "200ms")],
    "way of a chain": [Edit("chain", "see-and-brake", "tasks", "camera brake")],
    "no limit": [Edit("chain", "see-and-brake", "max_age", "")],
    "nothing": [],
}


def opened():
    return parse_model(first_model()["model.xml"], "model.xml")


def imported_with(overlay, tmp_path):
    path = tmp_path / "edits.yaml"
    path.write_bytes(overlay)
    found, diagnostics = OverlayUse(read_overlays([str(path)])).apply(opened(), Coverage())
    assert [d.message for d in diagnostics if d.is_error] == []
    return found


def without_origins(model):
    """The model as its file has it, which says of nothing where it comes from."""
    root = etree.fromstring(format_model(model))
    for origin in root.findall(".//{*}origin"):
        origin.getparent().text = None
        origin.getparent().remove(origin)
    etree.indent(root)
    return etree.tostring(root)


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS)
def test_the_source_with_the_overlay_is_what_is_shown(edits, tmp_path):
    shown = opened()
    for edit in edits:
        shown = edited(shown, edit)
    again = imported_with(overlay_of(opened(), shown), tmp_path)
    assert without_origins(again) == without_origins(shown)
    assert bool(edits) == (without_origins(shown) != without_origins(opened()))


def test_a_deadline_that_was_taken_away_is_stated_as_the_period():
    before = edited(opened(), Edit("task", "logging", "deadline", "20ms"))
    period = before.task("logging").period
    assert f"deadline: {period}".encode() in overlay_of(before, edited(before, Edit("task", "logging", "deadline", "")))


def test_an_overlay_begins_with_its_mark_and_has_names_as_they_are_written():
    model = opened()
    named = replace(model, tasks=tuple(replace(t, name="Kühlung") if t.name == "logging" else t for t in model.tasks))
    shown = named
    for edit in (Edit("task", "Kühlung", "period", "25ms"), Edit("chain", "see-and-brake", "max_age", "50ms")):
        shown = edited(shown, edit)
    stated = overlay_of(named, shown).decode().splitlines()
    assert [line for line in stated if line[0] not in " -"] == ["halpipe-overlay: 1", "tasks:", "chains:"]
    assert "  Kühlung:" in stated


def test_an_offset_that_was_taken_away_is_refused():
    before = edited(opened(), Edit("task", "camera", "offset", "1ms"))
    with pytest.raises(HalpipeError) as refused:
        overlay_of(before, edited(before, Edit("task", "camera", "offset", "")))
    assert [d.code for d in refused.value.diagnostics] == ["HAL0960"]
