"""A schedule put onto a small project: what is added, what is changed in place, and every reason to refuse it."""

import json
import re
from dataclasses import replace

import pytest
from arxml_case import (
    alarm,
    component,
    composition,
    configuration,
    container,
    core,
    counter,
    every,
    mapped,
    os_task,
    package,
    rte,
    write,
)
from test_arxml_ecus import BOTH, VEHICLE

from command_line import run_here
from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.exporters.arxml import codes
from halpipe.exporters.arxml.onto.edit import Edit, apply_edits
from halpipe.exporters.native import format_model, format_schedule
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes as import_codes
from halpipe.importers.arxml.files import sniff
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.arxml.project import read_project
from support import job, ms, schedule

TICK = "0.001"


def project(
    folder, *, period="0.01", tick=TICK, bound=True, mapping="Main", events=(), more=(), only=True, rings=False
):
    """A pump of 10 ms whose alarm is chosen by hand, and an OsTask of its own that an alarm activates every 20 ms."""
    pump = component("Pump", every(period, "Tick", "Pump/Step"), runnables="Step")
    extra = [("RteUsedOsEventRef", f"/E/Os/{event}") for event in events]
    mappings = mapped("Pump/B/Tick", mapping, "1", more=[("RteUsedOsAlarmRef", "/E/Os/ByHand"), *extra])
    where = [("OsApplicationCoreRef", "/E/EcuC/First")] if bound else []
    tasks = [("OsAppTaskRef", f"/E/Os/{name}") for name in ("Main", "Lone")]
    application = container("Os/OsApplication", "App", refs=[*tasks, ("OsAppCounterRef", "/E/Os/Ticks"), *where])
    waits = [("OsTaskEventRef", f"/E/Os/{event}") for event in events]
    os = configuration(
        "Os",
        container("Os/OsTask", "Main", refs=waits),
        container("Os/OsTask", "Lone", refs=[("OsTaskEventRef", "/E/Os/Ring")] if rings else []),
        counter(tick),
        container("Os/OsAlarm", "ByHand", refs=[("OsAlarmCounterRef", "/E/Os/Ticks")]),
        alarm("Al", "20", start="2", **({"sets": "Ring"} if rings else {"activates": "Lone"})),
        *(container("Os/OsEvent", event) for event in events),
        application,
        *more,
    )
    cores = [core("First", "0")] if only else [core("First", "0"), core("Second", "1")]
    parts = configuration("Rte", rte(mappings, prototype="Car/p"))
    return write(
        folder, package("T", pump, composition("Car", "p:Pump")), package("E", os, parts, configuration("EcuC", *cores))
    )


def model_of(path, drop="", source=""):
    overlay = path.parent / "wcet.yaml"
    dropped = f"drop: [{drop}]\n" if drop else ""
    sources = f"sources: {{{source}}}\n" if source else ""
    overlay.write_text(f'halpipe-overlay: 1\n{dropped}{sources}tasks:\n  "*": {{wcet: 1ms}}\n')
    return import_model("arxml", [str(path.parent)], ArxmlImportOptions(overlays=(str(overlay),))).model


def planned(model, *starts):
    """Starts of the pump at 10 ms and of the lone task."""
    first, lone = starts
    unit = model.units[0].name
    jobs = [job(model, "p/Step", index, f"{first + 10 * index}ms", unit) for index in range(2)]
    return schedule(model, 20, *jobs, job(model, "Lone", 0, f"{lone}ms", unit), mode_name="default")


def put(path, model=None, starts=(0, 2)):
    model = model or model_of(path)
    return export_onto(model, planned(model, *starts), str(path.parent), ArxmlImportOptions())


def refused(path, model, *starts):
    with pytest.raises(HalpipeError) as failure:
        put(path, model, starts or (0, 2))
    return [d for d in failure.value.diagnostics if d.is_error]


def test_additions_go_to_the_delta_and_changes_into_the_file(tmp_path):
    path = project(tmp_path)
    onto = put(path)
    added = {(c.path, c.name): c.new for c in onto.changes if c.old is None}
    assert b'<SD GID="format">1</SD>' in onto.additions
    table = "/E/Os/Halpipe_default_First"
    assert added[table, "OsScheduleTableCounterRef"] == "/E/Os/Ticks"
    assert added["/E/Os/App", "OsAppScheduleTableRef"] == table
    assert added["/E/Rte/Car_p/Pump_B_Tick", "RteUsedOsSchTblExpiryPointRef"] == f"{table}/At_0"
    changed = [(c.path, c.name, c.old, c.new) for c in onto.changes if c.old is not None]
    assert changed == [
        ("/E/Os/Al/s", "", "container", None),
        ("/E/Rte/Car_p/Pump_B_Tick", "RteUsedOsAlarmRef", "/E/Os/ByHand", None),
    ]
    before, after = path.read_bytes(), onto.files["changed/system.arxml"]
    assert b"<VALUE-REF>/E/Os/ByHand</VALUE-REF>" in before
    assert b"<VALUE-REF>/E/Os/ByHand</VALUE-REF>" not in after
    assert b"OsAlarmAutostart" not in after
    rest = re.sub(rb"<VALUE-REF>/E/Os/ByHand</VALUE-REF>", b"", before)
    start = rest.index(b"<ECUC-CONTAINER-VALUE><SHORT-NAME>s</SHORT-NAME>")
    end = rest.index(b"</ECUC-CONTAINER-VALUE>", start) + len(b"</ECUC-CONTAINER-VALUE>")
    assert rest[:start] + rest[end:] == after


def test_the_merged_project_is_the_same_model(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    onto = put(path, model)
    path.write_bytes(onto.files["changed/system.arxml"])
    (tmp_path / "delta.arxml").write_bytes(onto.files["delta.arxml"])
    again = model_of(path)
    assert [(t.name, t.period, t.offset, t.versions[0].units) for t in again.tasks] == [
        (t.name, t.period, t.offset, t.versions[0].units) for t in model.tasks
    ]
    assert again.units[0].name == model.units[0].name


def test_an_extended_os_task_is_started_by_the_event_it_waits_for(tmp_path):
    onto = put(project(tmp_path, events=["Go"]))
    added = [(c.name, c.new) for c in onto.changes if c.name.startswith("OsScheduleTableSetEvent")]
    assert set(added) == {("OsScheduleTableSetEventRef", "/E/Os/Go"), ("OsScheduleTableSetEventTaskRef", "/E/Os/Main")}


@pytest.mark.parametrize(("events", "activations"), [((), ""), ((), "1"), ((), "2"), (["Go"], "1")])
def test_an_os_task_that_still_runs_is_activated_only_where_the_project_lets_it_wait(tmp_path, events, activations):
    path = project(tmp_path, events=events)
    stated = {"OsTaskActivation": activations} if activations else None
    waits = [("OsTaskEventRef", f"/E/Os/{event}") for event in events]
    task, limited = (container("Os/OsTask", "Main", refs=waits, params=params) for params in (None, stated))
    path.write_text(path.read_text().replace(task, limited))
    model = model_of(path, drop="Lone")
    (pump,) = model.tasks
    model = replace(model, tasks=(replace(pump, versions=(replace(pump.versions[0], wcet=ms(10)),)),))
    full = schedule(model, 10, job(model, "p/Step", 0, "0ms", "First"), mode_name="default")
    if activations == "2" or events:  # an event stays set until the OsTask waits for it
        export_onto(model, full, str(tmp_path), ArxmlImportOptions())
        return
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, full, str(tmp_path), ArxmlImportOptions())
    (told,) = failure.value.diagnostics
    assert (told.code, told.path) == (codes.ACTIVATED_TWICE.id, 'OsTask "/E/Os/Main"')
    assert "OsTaskActivation to 2" in told.help


def test_a_counter_that_is_too_coarse_is_named_with_the_one_that_is_needed(tmp_path):
    onto = put(project(tmp_path), starts=(0.5, 2))
    (told,) = [d for d in onto.findings if d.code == codes.COUNTER_NEEDED.id]
    assert "/E/Os/Ticks has a tick of 1ms" in told.message
    assert 'job 0 of "p/Step" at 500us' in told.message
    assert "a counter with a tick of 500us is needed" in told.message
    assert "--tick 1ms" in told.help
    assert any(c.name == "OsSecondsPerTick" and c.new == "0.0005" for c in onto.changes)


def test_another_project_is_refused_by_every_task(tmp_path):
    model = model_of(project(tmp_path))
    other = tmp_path / "other"
    other.mkdir()
    fan = component("Fan", every("0.01", "Tick", "Fan/Step"), runnables="Step")
    path = write(other, package("T", fan))
    found = refused(path, model)
    assert {d.code for d in found} == {import_codes.FOREIGN_PROJECT.id}
    assert {d.path for d in found} == {'task "p/Step"', 'task "Lone"'}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"period": "0.02"}, "has the period 20ms in the project, but 10ms in the model"),
        ({"only": False, "bound": False}, "may run on First, Second in the project"),
    ],
)
def test_a_project_that_changed_is_refused_with_both_places(tmp_path, change, said):
    path = project(tmp_path)
    model = model_of(path)
    project(tmp_path, **change)
    found = refused(path, model)
    told = [d for d in found if d.path == 'task "p/Step"']
    if "may run" in said:
        assert {d.code for d in found} == {codes.WRONG_CORE.id}
        return
    assert [d.code for d in told] == [import_codes.CHANGED_PROJECT.id]
    assert said in told[0].message
    assert re.search(r"imported from .*system\.arxml:\d+", told[0].message)
    assert told[0].at.line


def two_rates(folder, slow):
    """An OsTask that waits for events and runs one runnable every 10 ms and another one more seldom."""
    main = container("Os/OsTask", "Main", refs=[("OsTaskEventRef", "/E/Os/Go")])
    events = [every("0.01", "Tick", "Pump/Step"), every(slow, "Tock", "Pump/Long")]
    mappings = rte(mapped("Pump/B/Tick", "Main", "1"), mapped("Pump/B/Tock", "Main", "2"), prototype="Car/p")
    return write(
        folder,
        package("T", component("Pump", *events, runnables="Step Long"), composition("Car", "p:Pump")),
        package("E", configuration("Os", main, counter(TICK)), configuration("Rte", mappings)),
    )


def test_a_period_that_changed_is_told_where_it_is_in_the_name_of_the_task(tmp_path):
    path = two_rates(tmp_path, "0.02")
    model = import_model("arxml", [str(path)], ArxmlImportOptions(granularity="ostask")).model
    two_rates(tmp_path, "0.04")
    findings = Findings()
    with pytest.raises(HalpipeError) as refused:
        read_project([str(tmp_path)], model, ArxmlImportOptions(), findings)
    (told,) = refused.value.diagnostics
    assert (told.code, told.path) == (import_codes.CHANGED_PROJECT.id, 'task "Main@20ms"')
    assert 'is "Main@40ms" in the project, with the period 40ms for 20ms, imported from ' in told.message


def test_what_hides_a_part_of_the_project_is_told_with_the_rest(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    (tmp_path / "torn.arxml").write_text("<AUTOSAR")
    point = "<VARIATION-POINT><SHORT-LABEL>L</SHORT-LABEL><SW-SYSCOND>1</SW-SYSCOND></VARIATION-POINT>"
    path.write_text(
        path.read_text().replace("<SHORT-NAME>Tick</SHORT-NAME>", f"<SHORT-NAME>Tick</SHORT-NAME>{point}", 1)
    )
    told = {d.code for d in export_onto(model, planned(model, 0, 2), str(tmp_path), ArxmlImportOptions()).findings}
    assert {import_codes.SKIPPED_FILE.id, import_codes.VARIANT.id} <= told


def test_an_ecu_of_several_must_be_named_and_gets_all(tmp_path):
    path = write(tmp_path, VEHICLE, *BOTH)
    overlay = tmp_path / "wcet.yaml"
    overlay.write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n')
    front = ArxmlImportOptions(ecu="Front")
    model = import_model("arxml", [str(path)], ArxmlImportOptions(ecu="Front", overlays=(str(overlay),))).model
    plan = schedule(model, 10, job(model, "p/Step", 0, "1ms", "A0"), mode_name="default")
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan, str(tmp_path), ArxmlImportOptions())
    (told,) = [d for d in failure.value.diagnostics if d.is_error]
    assert told.code == import_codes.SEVERAL_ECUS.id
    onto = export_onto(model, plan, str(tmp_path), front)
    assert onto.changes
    assert all(change.path.startswith("/E1/") for change in onto.changes)


def test_a_project_that_contradicts_itself_is_refused_with_both_places(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    other = component("Pump", every("0.02", "Tick", "Pump/Step"), runnables="Step")
    second = write(tmp_path, package("T", other), name="z.arxml")
    (told,) = refused(path, model)
    assert told.code == import_codes.CONFLICT.id
    assert (told.at.file, str(path) in told.message) == (str(second), True)


def test_tasks_that_the_model_leaves_out_are_named(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    more = [os_task("New", OsTaskPeriod="0.1")]
    onto = put(project(tmp_path, more=more), model)
    (told,) = [d for d in onto.findings if d.code == import_codes.MORE_IN_PROJECT.id]
    assert "New" in told.message


def test_a_project_without_os_has_nothing_to_put_a_schedule_onto(tmp_path):
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
    path = write(tmp_path, package("T", pump))
    model = model_of(path)
    plan = schedule(model, 10, job(model, "Pump/Step", 0, "0ms", model.units[0].name), mode_name="default")
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan, str(tmp_path), ArxmlImportOptions())
    assert import_codes.NO_CONFIGURATION.id in {d.code for d in failure.value.diagnostics}


def test_an_event_without_os_task_is_refused(tmp_path):
    pump = component(
        "Pump", every("0.01", "Tick", "Pump/Step"), every("0.01", "T2", "Pump/Other"), runnables="Step Other"
    )
    parts = package(
        "E", configuration("Os", os_task("Main")), configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1")))
    )
    path = write(tmp_path, package("T", pump), parts)
    model = model_of(path, source='"Pump/Other": {period: 10ms}')
    unit = model.units[0].name
    plan = schedule(
        model,
        10,
        job(model, "Pump/Step", 0, "0ms", unit),
        job(model, "Pump/Other", 0, "2ms", unit),
        mode_name="default",
    )
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, plan, str(tmp_path), ArxmlImportOptions())
    (told,) = [d for d in failure.value.diagnostics if d.is_error]
    assert (told.code, told.path) == (codes.NOT_MAPPED.id, 'task "Pump/Other"')


def test_several_tasks_of_one_event_are_named(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/A"), every("0.01", "B", "Pump/B"), runnables="A B")
    go = [("RteUsedOsEventRef", "/E/Os/Go")]
    os = configuration(
        "Os",
        container("Os/OsTask", "Main", refs=[("OsTaskEventRef", "/E/Os/Go")]),
        container("Os/OsEvent", "Go"),
        counter(),
    )
    maps = configuration("Rte", rte(mapped("Pump/B/A", "Main", "1", more=go), mapped("Pump/B/B", "Main", "2", more=go)))
    path = write(tmp_path, package("T", pump), package("E", os, maps))
    model = model_of(path)
    unit = model.units[0].name
    plan = schedule(
        model, 10, job(model, "Pump/A", 0, "0ms", unit), job(model, "Pump/B", 0, "2ms", unit), mode_name="default"
    )
    onto = export_onto(model, plan, str(tmp_path), ArxmlImportOptions())
    (told,) = [d for d in onto.findings if d.code == codes.SHARED_EVENT.id]
    assert "starts Pump/A, Pump/B" in told.message


def test_an_alarm_that_starts_more_than_the_schedule_plays_is_refused(tmp_path):
    path = project(tmp_path, more=[os_task("Idle")])
    kind = "Os/OsAlarm/OsAlarmAction/OsAlarmActivateTask"
    other = container(kind, "b", refs=[("OsAlarmActivateTaskRef", "/E/Os/Idle")])
    text = path.read_text()
    start = text.rindex("<ECUC-CONTAINER-VALUE>", 0, text.index("<SHORT-NAME>a</SHORT-NAME>"))
    path.write_text(text[:start] + other + text[start:])
    (told,) = refused(path, model_of(path, drop="Idle"))
    assert (told.code, told.path) == (codes.DOUBLE_START.id, 'OsAlarm "/E/Os/Al"')
    assert told.at.line


def test_a_second_delta_is_refused(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    onto = put(path, model)
    (tmp_path / "delta.arxml").write_bytes(onto.files["delta.arxml"])
    assert {d.code for d in refused(path, model)} == {codes.IN_THE_WAY.id}


@pytest.mark.parametrize("encoding", ["utf-8", "iso-8859-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_edits_keep_every_other_byte(encoding, newline):
    text = newline.join(
        [
            f'<?xml version="1.0" encoding="{encoding}"?>',
            '<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><!-- \xe4 --><AR-PACKAGES><AR-PACKAGE>',
            "<SHORT-NAME>P</SHORT-NAME><X><SHORT-NAME>C</SHORT-NAME><R>",
            "<ECUC-REFERENCE-VALUE><DEFINITION-REF>/M/R</DEFINITION-REF>",
            "<VALUE-REF DEST='a>b'> /Old <!-- \xe4 --></VALUE-REF></ECUC-REFERENCE-VALUE>",
            "</R></X></AR-PACKAGE></AR-PACKAGES></AUTOSAR>",
        ]
    )
    data = text.encode(encoding)
    changed = apply_edits(data, "f", [Edit(Location("f"), "/P/C", "R", "/Old", "/N\xfc")])
    assert changed == text.replace(" /Old <!-- \xe4 -->", "/N\xfc").encode(encoding)
    assert apply_edits(data, "f", [Edit(Location("f"), "/P/C", "R", "/Old")]) == re.sub(
        r"<VALUE-REF.*</VALUE-REF>", "", text
    ).encode(encoding)


@pytest.mark.parametrize("data", [b"<a/>", "<a/>".encode("utf-16")])
def test_an_edit_that_finds_nothing_is_refused(data):
    with pytest.raises(HalpipeError) as failure:
        apply_edits(data, "f", [Edit(Location("f"), "/P/C", "R", "/Old", "/New")])
    assert failure.value.diagnostics[0].code == codes.CANNOT_EDIT.id


def test_the_command_writes_a_folder_and_lists_the_changes(tmp_path):
    source = tmp_path / "in"
    source.mkdir()
    path = project(source)
    model = model_of(path)
    (tmp_path / "m.xml").write_bytes(format_model(model))
    (tmp_path / "s.xml").write_bytes(format_schedule(planned(model, 0, 2)))
    done = run_here(tmp_path, "export", "arxml", "m.xml", "s.xml", "--onto", "in", "-o", "out", "--format", "json")
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    assert {"file", "path", "parameter", "old", "new"} == set(listed[0])
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "changed",
        "changes.json",
        "delta.arxml",
        "manifest.json",
        "model.xml",
        "schedule.xml",
    ]
    done = run_here(tmp_path, "export", "arxml", "m.xml", "s.xml", "--onto", "in", "-o", "out2")
    assert "RteUsedOsAlarmRef: /E/Os/ByHand -> (nothing)" in done.stderr


def test_a_pipeline_puts_its_schedule_onto_the_project(tmp_path):
    source = tmp_path / "in"
    source.mkdir()
    project(source)
    (tmp_path / "wcet.yaml").write_text('halpipe-overlay: 1\ntasks:\n  "*": {wcet: 1ms}\n')
    text = """halpipe-pipeline: 1
import: {format: arxml, inputs: in, overlay: wcet.yaml}
model: model.xml
schedule: {output: schedule.xml, tick: 1ms}
exports:
  - {format: arxml, onto: in, output: out}
"""
    (tmp_path / "pipeline.yaml").write_text(text)
    done = run_here(tmp_path, "run", "pipeline.yaml")
    assert done.returncode == 0
    assert "/E/Rte/Car_p/Pump_B_Tick RteUsedOsAlarmRef: /E/Os/ByHand -> (nothing)" in done.stderr
    again = run_here(tmp_path, "export", "arxml", "model.xml", "schedule.xml", "--onto", "in", "-o", "other")
    assert again.returncode == 0
    names = [path.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert names
    assert all((tmp_path / "out" / name).read_bytes() == (tmp_path / "other" / name).read_bytes() for name in names)
    (tmp_path / "pipeline.yaml").write_text(text.replace("format: arxml, onto", "format: btf, onto"))
    assert "HAL0021" in run_here(tmp_path, "run", "pipeline.yaml").stderr


def test_nothing_is_written_where_something_stands_against_it(tmp_path):
    source = tmp_path / "in"
    source.mkdir()
    path = project(source)
    model = model_of(path)
    (tmp_path / "m.xml").write_bytes(format_model(model))
    (tmp_path / "s.xml").write_bytes(format_schedule(planned(model, 0, 2)))
    project(source, period="0.02")
    done = run_here(tmp_path, "export", "arxml", "m.xml", "s.xml", "--onto", "in", "-o", "out")
    assert (done.returncode, (tmp_path / "out").exists()) == (1, False)
    assert "HAL0581" in done.stderr


def test_a_large_project_gets_the_same(tmp_path, monkeypatch):
    path = project(tmp_path, events=["Go"], more=[container("Os/OsStack", "Halpipe_default_First")])
    text = path.read_text()
    marked = text.replace("<ECUC-CONTAINER-VALUE>", '<ECUC-CONTAINER-VALUE UUID="1">')
    path.write_text(marked.replace("<AR-PACKAGE>", '<AR-PACKAGE UUID="2">'))
    whole = put(path)
    monkeypatch.setattr(sniff, "LARGE_INPUT", 0)
    assert put(path).files == whole.files
    assert b'UUID="1"' in whole.files["delta.arxml"]
    assert b'UUID="2"' in whole.files["delta.arxml"]


def test_a_project_of_an_older_release_is_refused(tmp_path):
    path = project(tmp_path)
    model = model_of(path)
    old = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="http://autosar.org/3.1.5 x.xsd"'
    path.write_text(path.read_text().replace("<AUTOSAR ", f"<AUTOSAR {old} ", 1))
    assert {d.code for d in refused(path, model)} == {import_codes.NO_CONFIGURATION.id}


# -------------------------------------------------------------------------------- what else starts the same OsTasks


KIND = "Os/OsScheduleTable/OsScheduleTableExpiryPoint"


def acts(*tasks, event=""):
    """Actions of an expiry point on OsTasks: activations, or an event for each."""
    if event:
        refs = [
            ("OsScheduleTableSetEventRef", f"/E/Os/{event}"),
            ("OsScheduleTableSetEventTaskRef", f"/E/Os/{tasks[0]}"),
        ]
        return [container(f"{KIND}/OsScheduleTableEventSetting", "set", refs=refs)]
    refs = [[("OsScheduleTableActivateTaskRef", f"/E/Os/{task}")] for task in tasks]
    return [container(f"{KIND}/OsScheduleTableTaskActivation", f"a{i}", refs=r) for i, r in enumerate(refs)]


def old_table(points, *, started=True):
    """A table of the project; points by their ticks."""
    inner = [
        container(KIND, f"P{at}", *found, params={"OsScheduleTblExpPointOffset": at}) for at, found in points.items()
    ]
    begin = container("Os/OsScheduleTable/OsScheduleTableAutostart", "go", params={"OsScheduleTableStartValue": "3"})
    return container(
        "Os/OsScheduleTable",
        "Old",
        *inner,
        *([begin] if started else []),
        params={"OsScheduleTableDuration": "20", "OsScheduleTableRepeating": "true"},
        refs=[("OsScheduleTableCounterRef", "/E/Os/Ticks")],
    )


def removed(onto):
    return [c.path for c in onto.changes if c.old == "container"]


def test_a_table_that_does_the_same_loses_its_autostart(tmp_path):
    path = project(tmp_path, more=[old_table({"0": acts("Main"), "10": acts("Main", "Lone")})])
    model = model_of(path)
    onto = put(path, model, starts=(0, 13))
    assert removed(onto) == ["/E/Os/Al/s", "/E/Os/Old/go"]
    path.write_bytes(onto.files["changed/system.arxml"])
    (tmp_path / "delta.arxml").write_bytes(onto.files["delta.arxml"])
    again = model_of(path)
    assert [(t.name, t.period, t.offset) for t in again.tasks] == [(t.name, t.period, t.offset) for t in model.tasks]


def test_a_table_that_does_more_loses_its_actions_on_what_is_played(tmp_path):
    points = {"0": acts("Main"), "5": acts("Main", "Idle"), "9": acts("Idle")}
    for started in (True, False):
        path = project(tmp_path, more=[os_task("Idle"), old_table(points, started=started)])
        onto = put(path, model_of(path, drop="Idle*"))
        assert removed(onto) == ["/E/Os/Al/s", "/E/Os/Old/P0", "/E/Os/Old/P5/a0"]
        text = onto.files["changed/system.arxml"].decode()
        assert "/E/Os/Main</VALUE-REF>" not in text[text.index("<SHORT-NAME>Old<") : text.index("<SHORT-NAME>Rte<")]


def test_a_table_that_sets_events_for_a_played_os_task_is_stopped(tmp_path):
    path = project(tmp_path, events=["Go"], more=[old_table({"0": acts("Main", event="Go")})])
    assert removed(put(path, model_of(path))) == ["/E/Os/Al/s", "/E/Os/Old/go"]


def test_a_table_that_code_starts_is_refused_and_named(tmp_path):
    path = project(tmp_path, more=[old_table({"0": acts("Main")}, started=False)])
    (told,) = refused(path, model_of(path))
    assert (told.code, told.path) == (codes.DOUBLE_START.id, 'OsScheduleTable "/E/Os/Old"')
    assert (told.at.file, "/E/Os/Main" in told.message) == (str(path), True)


def test_a_start_by_the_rte_configuration_is_taken_away(tmp_path):
    path = project(tmp_path, more=[old_table({"0": acts("Main")}, started=False)])
    start = container(
        "Rte/RteOsInteraction/RteUsedOsActivation", "Use", refs=[("RteActivationOsSchTblRef", "/E/Os/Old")]
    )
    text = path.read_text()
    at = text.index("<CONTAINERS>", text.index("<SHORT-NAME>Rte</SHORT-NAME>")) + len("<CONTAINERS>")
    path.write_text(text[:at] + container("Rte/RteOsInteraction", "Uses", start) + text[at:])
    assert removed(put(path, model_of(path))) == ["/E/Os/Al/s", "/E/Rte/Uses/Use"]


def test_an_os_task_that_starts_with_the_os_is_named(tmp_path):
    path = project(tmp_path)
    begin = container("Os/OsTask/OsTaskAutostart", "begin")
    text = path.read_text()
    end = text.index("<SUB-CONTAINERS></SUB-CONTAINERS>", text.index("<SHORT-NAME>Lone</SHORT-NAME>"))
    path.write_text(text[:end] + text[end:].replace("<SUB-CONTAINERS>", f"<SUB-CONTAINERS>{begin}", 1))
    (told,) = [d for d in put(path, model_of(path)).findings if d.code == codes.STARTS_ONCE.id]
    assert told.path == 'OsTask "/E/Os/Lone"'
