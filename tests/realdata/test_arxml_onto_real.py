"""Projects with Os and Rte: project to model to schedule to delta to merged project to the same model."""

import json
import shutil
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from lxml import etree

from arxml_reading import NS, name_of, parameters, q, references
from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import Duration
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.arxml.system.containers import data_of
from halpipe.importers.arxml.system.reading import read_tree
from halpipe.models import Origin
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from merged_os import differences

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not SHARED.is_dir(), reason="real ARXML projects are not part of the project")
PROJECTS = {
    "tc275": SHARED / "arxml" / "sys_vector_tc275_3core",
    "hello": SHARED / "arxml" / "sys_arccore_helloworld",
    "HelloAutosar": SHARED / "arxml" / "toppers_rtegen" / "HelloAutosar.arxml",
    **{name: SHARED / "arxml_projects" / f"vtt_{name}" for name in ("S1", "S2", "S3")},
}
COUNTS = {  # tasks of the model, tables, mappings that name an expiry point, values changed in place
    ("tc275", "ostask"): (7, 3, 34, 0),
    ("tc275", "runnable"): (27, 3, 34, 0),
    ("hello", "ostask"): (4, 1, 2, 4),
    ("HelloAutosar", "runnable"): (2, 1, 0, 4),
    ("S1", "ostask"): (4, 1, 21, 0),
    ("S2", "ostask"): (4, 1, 21, 0),
    ("S3", "runnable"): (16, 1, 21, 0),
}


def imported(tmp_path, directory, granularity):
    overlay = tmp_path / "overlay.yaml"
    text = 'halpipe-overlay: 1\ntasks:\n  "*": {wcet: 10us}\n'
    if (directory / "HelloAutosar.arxml").exists():  # its components, and with them all periods, are in no file
        text += "sources:\n  TASK1: {period: 10ms}\n  TASK2: {period: 20ms}\n"
    overlay.write_text(text)
    return import_model(
        "arxml", [str(directory)], ArxmlImportOptions(overlays=(str(overlay),), granularity=granularity)
    ).model


def copied(source, directory):
    for path in sorted(source.rglob("*.arxml")) if source.is_dir() else [source]:
        target = directory / (path.relative_to(source) if source.is_dir() else path.name)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
    return directory


@pytest.fixture
def put(tmp_path, request):
    """The project, its model and schedule, what was written, and the counts expected."""
    name, granularity = request.param
    directory = copied(PROJECTS[name], tmp_path / "project")
    model = imported(tmp_path, directory, granularity)
    tick = Duration(10**6) if granularity == "ostask" else None
    schedule = schedule_model(model, SearchOptions(tick=tick), lambda *_: True).schedule
    onto = export_onto(model, schedule, str(directory), ArxmlImportOptions())
    return directory, granularity, model, schedule, onto, COUNTS[name, granularity]


EVERY = pytest.mark.parametrize("put", COUNTS, indirect=True, ids="-".join)


def merged(directory, onto):
    for name, content in onto.files.items():
        if name.startswith("changed/"):
            (directory / name.removeprefix("changed/")).write_bytes(content)
    (directory / "delta.arxml").write_bytes(onto.files["delta.arxml"])


def plain(model):
    """A model without the files and lines of its origins."""

    def bare(element):
        return replace(element, origin=element.origin and Origin("", 0, element.origin.path))

    tasks = [
        replace(
            bare(task),
            versions=tuple(replace(bare(v), precedences=tuple(bare(p) for p in v.precedences)) for v in task.versions),
        )
        for task in model.tasks
    ]
    return tasks, [bare(unit) for unit in model.units], [bare(m) for m in model.modes], model.transitions


@pytest.mark.slow
@EVERY
def test_the_merged_project_imports_to_the_same_model(tmp_path, put):
    directory, granularity, model, _, onto, _ = put
    merged(directory, onto)
    assert plain(imported(tmp_path, directory, granularity)) == plain(model)


@pytest.mark.slow
@EVERY
def test_the_merged_project_starts_what_the_schedule_says_and_nothing_else(put):
    directory, _, model, schedule, onto, _ = put
    merged(directory, onto)
    found, acts = differences(directory, schedule, {task.name: task.origin.path for task in model.tasks})
    assert found == []
    assert acts >= len(schedule.modes[0].jobs)


@EVERY
def test_the_counts_are_those_of_the_project(put):
    _, _, model, _, onto, counts = put
    tables = [c for c in onto.changes if c.new == "OsScheduleTable"]
    named = [c for c in onto.changes if c.name.endswith("UsedOsSchTblExpiryPointRef") and c.old is None]
    changed = [c for c in onto.changes if c.old is not None]
    assert (len(model.tasks), len(tables), len(named), len(changed)) == counts
    listed = json.loads(onto.files["changes.json"])
    assert len(listed) == len(onto.changes)


@pytest.mark.slow
@EVERY
def test_every_reference_of_the_delta_leads_into_the_project(put):
    directory, _, _, _, onto, _ = put
    merged(directory, onto)
    tree = read_tree([str(directory)], Findings())
    root = etree.fromstring(onto.files["delta.arxml"])
    targets = [element.text for element in root.iter(NS + "VALUE-REF", NS + "SDX-REF")]
    assert targets
    assert [path for path in targets if not tree.has(path, "ECUC-CONTAINER-VALUE")] == []


@EVERY
def test_strict_validation_takes_the_delta_beside_the_project(put):
    autosar_data = pytest.importorskip("autosar_data")
    directory, _, _, _, onto, _ = put
    autosar_data.AutosarModel().load_buffer(onto.files["delta.arxml"].decode(), "delta.arxml", True)
    model = autosar_data.AutosarModel()
    for path in sorted(directory.rglob("*.arxml")):
        changed = onto.files.get(f"changed/{path.relative_to(directory)}", path.read_bytes())
        if b"UsedOs" in changed or b"/Os/" in changed:
            model.load_buffer(changed.decode(), str(path), False)
    _, warnings = model.load_buffer(onto.files["delta.arxml"].decode(), "delta.arxml", True)
    assert list(warnings) == []


@pytest.mark.slow
@EVERY
def test_nothing_that_a_generator_owns_is_written(put):
    directory, _, _, _, onto, _ = put
    tree = read_tree([str(directory)], Findings())
    owned = {
        node.path
        for node in tree.tagged("ECUC-CONTAINER-VALUE")
        if "DV:RTE" in [e.text for e in node.parts[0].element.iterfind(q("ANNOTATIONS/ANNOTATION/ANNOTATION-ORIGIN"))]
    }
    assert [c for c in onto.changes if c.path in owned] == []
    assert data_of(tree, next(iter(tree.tagged("AR-PACKAGE"))), "delta") is None


@EVERY
def test_tables_have_the_starts_of_the_schedule_in_ticks_of_their_counters(put):
    directory, _, _, schedule, onto, _ = put
    merged(directory, onto)
    containers = {}
    for path in sorted(directory.rglob("*.arxml")):
        for element in etree.parse(path).iter(NS + "ECUC-CONTAINER-VALUE"):
            containers.setdefault(name_of(element), []).append(element)
    root = etree.fromstring(onto.files["delta.arxml"])
    units = {}
    for table in root.iter(NS + "ECUC-CONTAINER-VALUE"):
        if not table.findtext(NS + "DEFINITION-REF").endswith("/OsScheduleTable"):
            continue
        counter = dict(references(table))["OsScheduleTableCounterRef"].rpartition("/")[2]
        ticks = {parameters(c)["OsSecondsPerTick"] for c in containers[counter] if "OsSecondsPerTick" in parameters(c)}
        tick = Fraction(next(iter(ticks)))
        starts = set()
        for point in table.iterfind(q("SUB-CONTAINERS/*")):
            offset = parameters(point).get("OsScheduleTblExpPointOffset")
            starts |= {int(offset) * tick} if offset is not None else set()
        assert int(parameters(table)["OsScheduleTableDuration"]) * tick == schedule.modes[0].hyperperiod.in_unit("s")
        units[name_of(table)] = starts
    expected = {}
    for job in schedule.modes[0].jobs:
        expected.setdefault(job.units[0], set()).add(job.start.in_unit("s"))
    assert sorted(map(sorted, units.values())) == sorted(map(sorted, expected.values()))


@pytest.mark.slow
@EVERY
def test_a_second_delta_beside_the_first_is_refused(put):
    directory, _, model, schedule, onto, _ = put
    merged(directory, onto)
    with pytest.raises(HalpipeError) as refused:
        export_onto(model, schedule, str(directory), ArxmlImportOptions())
    assert {d.code for d in refused.value.diagnostics if d.is_error} == {"HAL0884"}
    assert all("delta.arxml" in d.at.file for d in refused.value.diagnostics if d.is_error)


@EVERY
def test_bytes_outside_the_changed_values_are_those_of_the_project(put):
    directory, _, _, _, onto, _ = put
    for name, content in onto.files.items():
        if name.startswith("changed/"):
            original = (directory / name.removeprefix("changed/")).read_bytes()
            assert len(content) < len(original)
            head = next(i for i, (a, b) in enumerate(zip(original, content, strict=False)) if a != b)
            tail = next(i for i, (a, b) in enumerate(zip(original[::-1], content[::-1], strict=False)) if a != b)
            assert b"OsAlarm" in original[head : len(original) - tail]
            assert original[:head] == content[:head]
