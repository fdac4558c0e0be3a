"""OsTasks of a project that get a schedule: BASIC and EXTENDED ones, and those of what an overlay left out."""

from dataclasses import replace
from fractions import Fraction

import pytest
from arxml_case import (
    alarm,
    component,
    composition,
    configuration,
    container,
    counter,
    every,
    mapped,
    os_task,
    package,
    rte,
    write,
)
from test_arxml_onto import acts, model_of, old_table, project, put, refused, removed

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.exporters.arxml import codes
from halpipe.flow.formats import check_bundle
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from support import job, schedule

# --------------------------------------------------------------------------------------- basic and extended OsTasks


def test_several_tasks_of_one_basic_os_task_are_refused(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/A"), every("0.01", "B", "Pump/B"), runnables="A B")
    maps = configuration("Rte", rte(mapped("Pump/B/A", "Main", "1"), mapped("Pump/B/B", "Main", "2")))
    path = write(tmp_path, package("T", pump), package("E", configuration("Os", os_task("Main"), counter()), maps))
    model = model_of(path)
    unit = model.units[0].name
    jobs = job(model, "Pump/A", 0, "0ms", unit), job(model, "Pump/B", 0, "2ms", unit)
    with pytest.raises(HalpipeError) as failure:
        export_onto(model, schedule(model, 10, *jobs, mode_name="default"), str(tmp_path), ArxmlImportOptions())
    (told,) = [d for d in failure.value.diagnostics if d.is_error]
    assert (told.code, "ostask" in told.help) == (codes.BASIC_SHARED.id, True)


def test_an_extended_os_task_is_woken_by_its_only_event(tmp_path):
    text = project(tmp_path, events=["Go"]).read_text()
    path = tmp_path / "system.arxml"
    path.write_text(text.replace("RteUsedOsEventRef", "RteOther"))
    changes = put(path, model_of(path)).changes
    assert "/E/Os/Go" in [c.new for c in changes if c.name == "OsScheduleTableSetEventRef"]


def test_an_extended_os_task_is_woken_by_the_event_that_its_expiry_point_sets(tmp_path):
    points = {"0": acts("Main", event="Go"), "5": acts("Main", event="Come")}
    path = project(tmp_path, events=["Go", "Come"], more=[old_table(points)])
    text = path.read_text().replace("RteUsedOsEventRef", "RteOther")
    path.write_text(
        text.replace("RteUsedOsAlarmRef", "RteUsedOsSchTblExpiryPointRef").replace("/E/Os/ByHand<", "/E/Os/Old/P5<")
    )
    changes = put(path, model_of(path)).changes
    assert [c.new for c in changes if c.name == "OsScheduleTableSetEventRef"] == ["/E/Os/Come"] * 2


def test_a_call_without_event_is_woken_by_that_of_its_period(tmp_path):
    """A runnable that was mapped after the last run of the generator."""
    pump = component("Pump", *(every("0.01", name, f"Pump/{name}") for name in "AB"), runnables="A B")
    mappings = (
        mapped("Pump/B/A", "Main", "1", more=[("RteUsedOsEventRef", "/E/Os/Go")]),
        mapped("Pump/B/B", "Main", "2"),
    )
    waits = [("OsTaskEventRef", f"/E/Os/{event}") for event in ("Go", "Come")]
    events = [container("Os/OsEvent", event) for event in ("Go", "Come")]
    os = configuration("Os", container("Os/OsTask", "Main", refs=waits), *events, counter())
    write(tmp_path, package("T", pump), package("E", os, configuration("Rte", rte(*mappings))))
    model = model_of(tmp_path / "system.arxml")
    jobs = [job(model, f"Pump/{name}", 0, at, model.units[0].name) for name, at in (("A", "0ms"), ("B", "2ms"))]
    onto = export_onto(model, schedule(model, 10, *jobs, mode_name="default"), str(tmp_path), ArxmlImportOptions())
    assert [c.new for c in onto.changes if c.name == "OsScheduleTableSetEventRef"] == ["/E/Os/Go"] * 2
    (told,) = [d for d in onto.findings if d.code == codes.SHARED_EVENT.id]
    assert "Pump/A, Pump/B" in told.message


def test_an_extended_os_task_of_which_no_event_is_known_is_refused(tmp_path):
    path = project(tmp_path, events=["Go", "Come"])
    text = path.read_text().replace("RteUsedOsEventRef", "RteOther")
    path.write_text(text)
    (told,) = refused(path, model_of(path))
    assert (told.code, told.path) == (codes.UNKNOWN_EVENT.id, 'OsTask "/E/Os/Main"')
    assert "waits for 2 OsEvents" in told.message
    kind = os_task("Main", OsTaskType="EXTENDED")
    kind = kind[kind.index("<PARAMETER-VALUES>") : kind.index("<REFERENCE-VALUES>")]
    at = text.index("<PARAMETER-VALUES>", text.index("<SHORT-NAME>Main</SHORT-NAME>"))
    text = text[:at] + kind + text[text.index("<REFERENCE-VALUES>", at) :]
    path.write_text(text.replace("OsTaskEventRef", "OsOther"))
    (told,) = refused(path, model_of(path))
    assert (told.code, "EXTENDED, but has no OsEvent" in told.message) == (codes.UNKNOWN_EVENT.id, True)


def test_an_event_for_two_os_tasks_is_set_for_both(tmp_path):
    waits = container("Os/OsTask", "Other", refs=[("OsTaskEventRef", "/E/Os/Ring")])
    model = model_of(project(tmp_path, rings=True, more=[waits, container("Os/OsEvent", "Ring")]))
    model = replace(model, tasks=tuple(replace(task, slack=Fraction(1, 2)) for task in model.tasks))
    unit = model.units[0].name
    jobs = job(model, "Lone", 0, "2ms", unit), job(model, "Other", 0, "5ms", unit)
    steps = [job(model, "p/Step", index, f"{10 * index}ms", unit) for index in range(2)]
    plan = schedule(model, 20, *steps, *jobs, mode_name="default")
    changes = export_onto(model, plan, str(tmp_path), ArxmlImportOptions()).changes
    woken = [c.new for c in changes if c.name == "OsScheduleTableSetEventTaskRef"]
    assert woken == ["/E/Os/Lone", "/E/Os/Other"]


# ----------------------------------------------------------------------------------------- what the model leaves out


def two_calls(folder, slow, *, events=()):
    """An OsTask that calls Step every 10 ms and Long more seldom, each woken by an event of an alarm, or activated."""
    ticks = every("0.01", "Tick", "Pump/Step"), every(slow, "Tock", "Pump/Long")
    refs = [[("RteUsedOsEventRef", f"/E/Os/{event}")] for event in events] or [(), ()]
    mappings = (mapped("Pump/B/Tick", "Main", "1", more=refs[0]), mapped("Pump/B/Tock", "Main", "2", more=refs[1]))
    alarms = [
        alarm(f"Al{event}", str(10 + 10 * index), start="10", sets=event)
        for index, event in enumerate(dict.fromkeys(events))
    ]
    os = configuration(
        "Os",
        container("Os/OsTask", "Main", refs=[("OsTaskEventRef", f"/E/Os/{event}") for event in events]),
        *(container("Os/OsEvent", event) for event in dict.fromkeys(events)),
        container("Os/OsAppMode", "OSDEFAULTAPPMODE"),
        counter(),
        *(alarms or [alarm("Al", "10", activates="Main")]),
    )
    types = package("T", component("Pump", *ticks, runnables="Step Long"), composition("Car", "p:Pump"))
    return write(folder, types, package("E", os, configuration("Rte", rte(*mappings, prototype="Car/p"))))


def of_steps(model):
    return schedule(model, 10, job(model, "p/Step", 0, "3ms", model.units[0].name), mode_name="default")


def test_an_alarm_of_what_an_overlay_dropped_goes_on_and_is_named(tmp_path):
    path = two_calls(tmp_path, "0.02", events=["Go", "Come"])
    model = model_of(path, drop="p/Long")
    onto = export_onto(model, of_steps(model), str(tmp_path), ArxmlImportOptions())
    assert removed(onto) == ["/E/Os/AlGo/s"]
    (told,) = [d for d in onto.findings if d.code == codes.RUNS_BESIDE.id]
    assert (told.path, "/E/Os/Come" in told.message) == ('OsAlarm "/E/Os/AlCome"', True)
    write_directory(str(tmp_path / "out"), onto.files)
    checked = check_bundle(str(tmp_path / "out"), CheckOptions())
    assert (checked.diagnostics, checked.lines[0]) == ((), "2 actions on 1 OsTasks in 10ms")


@pytest.mark.parametrize(("slow", "code"), [("0.02", codes.OTHER_RATE.id), ("0.01", None)])
@pytest.mark.parametrize("events", [(), ("Go", "Go")], ids=["basic", "extended"])
def test_what_an_overlay_dropped_keeps_its_rate_or_is_refused(tmp_path, slow, code, events):
    path = two_calls(tmp_path, slow, events=events)
    model = model_of(path, drop="p/Long")
    try:
        found = export_onto(model, of_steps(model), str(tmp_path), ArxmlImportOptions()).findings
    except HalpipeError as failure:
        found = failure.diagnostics
    assert next((d.code for d in found if d.is_error), None) == code


def test_an_os_task_alone_is_woken_by_the_event_that_its_alarm_sets(tmp_path):
    path = project(tmp_path, rings=True, more=[container("Os/OsEvent", "Ring")])
    changes = put(path, model_of(path)).changes
    assert "/E/Os/Ring" in [c.new for c in changes if c.name == "OsScheduleTableSetEventRef"]
