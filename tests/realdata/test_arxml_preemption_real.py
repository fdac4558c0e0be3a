"""OsTaskSchedule of a real three-core system, read here by ElementTree alone, against the splits of the import."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.overlay import OverlayUse, read_overlays
from halpipe.models import WHOLE, Binding
from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.solve.schedule import SearchOptions
from support import ms

SYSTEM = Path(__file__).parents[2].parent / "shared" / "data" / "arxml" / "sys_vector_tc275_3core"
pytestmark = pytest.mark.skipif(not SYSTEM.is_dir(), reason="real ARXML files are not part of the project")


def stated():
    """Return what OsTaskSchedule says of each OsTask."""
    found = {}
    for node in ElementTree.parse(SYSTEM / "TC27x_Os_ecuc.arxml").iter():
        if not node.tag.endswith("}ECUC-CONTAINER-VALUE"):
            continue
        space = node.tag.removesuffix("ECUC-CONTAINER-VALUE")
        if not node.findtext(f"{space}DEFINITION-REF", "").endswith("/OsTask"):
            continue
        for value in node.iter(f"{space}ECUC-TEXTUAL-PARAM-VALUE"):
            if value.findtext(f"{space}DEFINITION-REF", "").endswith("/OsTaskSchedule"):
                found[node.findtext(f"{space}SHORT-NAME")] = value.findtext(f"{space}VALUE")
    return found


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    overlay = tmp_path_factory.mktemp("tc275") / "overlay.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 300us}\n')
    used = OverlayUse(read_overlays([str(overlay)]))
    found = FORMAT.read([str(SYSTEM)], ArxmlImportOptions(overlay=used, granularity="ostask", pieces=ms("0.1ms")))
    return used.apply(found.model, found.coverage)[0]


def test_full_tasks_are_split_and_bound_and_others_are_not_split(imported):
    says = stated()
    assert set(says.values()) == {"FULL", "NON"}
    seen = set()
    for task in imported.tasks:
        kind = says[task.name.split("@")[0]]
        seen.add(kind)
        assert task.binding is Binding.SYSTEM
        for version in task.versions:
            assert (version.split == WHOLE) == (kind == "NON"), task.name
            assert version.split.points == ((ms("0.1ms"), ms("0.2ms")) if kind == "FULL" else ())
    assert seen == {"FULL", "NON"}


def test_the_system_has_a_schedule(imported):
    found = schedule_model(imported, SearchOptions(), lambda *_: True)
    assert found.is_complete
    assert [d.message for d in verify_schedule(imported, found.schedule) if d.is_error] == []
