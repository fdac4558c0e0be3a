"""Merged projects are played: each OsTask is started where the schedule says, once, whatever else is there."""

import pytest
from arxml_case import alarm, component, configuration, container, core, every, mapped, os_task, package, rte
from arxml_case import write as written
from test_arxml_onto import acts, model_of, old_table, planned, project, put, removed

from halpipe.exporters.arxml import codes
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from merged_os import Os, differences
from support import job, schedule


def played(path, onto=None, schedule=None):
    """What the project does wrong, with an export merged into it."""
    model = model_of(path)
    if onto is not None:
        (path.parent / "delta.arxml").write_bytes(onto.files["delta.arxml"])
        if "changed/system.arxml" in onto.files:
            path.write_bytes(onto.files["changed/system.arxml"])
    origins = {task.name: task.origin.path for task in model.tasks}
    return differences(path.parent, schedule or planned(model, 0, 2), origins)


START = container("Os/OsAppMode", "OSDEFAULTAPPMODE")
MORE = {
    "plain": (os_task("Idle"), alarm("Slow", "20", activates="Idle")),
    "an alarm beside it": (alarm("Second", "10", activates="Main"),),
    "a table beside it": (old_table({"0": acts("Main"), "10": acts("Main")}),),
    "a table that does more": (os_task("Idle"), old_table({"4": acts("Main", "Idle")}, started=False)),
}


@pytest.mark.parametrize("more", MORE.values(), ids=MORE)
@pytest.mark.parametrize("events", [(), ("Go",)], ids=["basic", "extended"])
def test_the_merged_project_does_what_the_schedule_says(tmp_path, more, events):
    path = project(tmp_path, more=[*more, START], events=events)
    model = model_of(path, drop="Idle" if "Idle" in path.read_text() else "")
    onto = put(path, model)
    assert played(path, onto, planned(model, 0, 2))[0] == []


def test_the_player_sees_a_second_start(tmp_path):
    path = project(tmp_path, more=[*MORE["an alarm beside it"], START])
    onto = put(path)
    text = path.read_bytes()
    found, count = played(path, onto)
    assert (found, count) == ([], 3)
    path.write_bytes(text)
    found, count = played(path)
    assert "/E/Os/Main  twice at 0" in found
    assert any("contradiction" in told for told in found)
    assert count == 3 + 1 + 2


def test_the_player_sees_a_start_that_is_missing(tmp_path):
    path = project(tmp_path, more=[START])
    onto = put(path)
    onto.files["delta.arxml"] = onto.files["delta.arxml"].replace(b"<VALUE>10</VALUE>", b"<VALUE>11</VALUE>")
    assert {told.partition(" at ")[0] for told in played(path, onto)[0]} == {
        "/E/Os/Main  started",
        "/E/Os/Main not started",
    }


def test_the_player_sees_an_extended_os_task_that_is_activated(tmp_path):
    path = project(tmp_path, events=["Go"], more=[START])
    onto = put(path)
    for old, new in (
        (b"OsScheduleTableEventSetting", b"OsScheduleTableTaskActivation"),
        (b"SetEventTaskRef", b"ActivateTaskRef"),
    ):
        onto.files["delta.arxml"] = onto.files["delta.arxml"].replace(old, new)
    assert "/E/Os/Main is extended, but activated" in played(path, onto)[0]


def test_tables_begin_at_their_start_value_and_repeat(tmp_path):
    points = {"0": acts("Main"), "5": acts("Lone")}
    path = project(tmp_path, more=[old_table(points), container("Os/OsEvent", "None")])
    table = [(float(act.time), act.task) for act in Os(path.parent).play(0.03) if act.by.endswith("Old")]
    assert table == [(0.003, "/E/Os/Main"), (0.008, "/E/Os/Lone"), (0.023, "/E/Os/Main"), (0.028, "/E/Os/Lone")]


def test_a_project_in_which_nothing_starts_a_table_is_named(tmp_path):
    path = project(tmp_path)
    onto = put(path)
    (told,) = [d for d in onto.findings if d.code == codes.NEVER_STARTED.id]
    assert "OsAppMode" in told.message
    assert "/E/Os/Main not started at 0" in played(path, onto)[0]


# ------------------------------------------------------------------------------------------------ what else starts


def in_modes(text, *modes):
    """An alarm or autostart that names application modes."""
    refs = [("OsAlarmAppModeRef", f"/E/Os/{mode}") for mode in modes]
    more = container("X", "x", refs=refs)
    return text.replace("<REFERENCE-VALUES></REFERENCE-VALUES>", more[more.index("<REF") : more.index("<SUB")], 1)


def test_the_mode_that_the_alarms_name_is_played_and_others_stay_as_they_were(tmp_path):
    begins = in_modes(alarm("Both", "10", activates="Main"), "Boot", "Normal")
    more = [container("Os/OsAppMode", name) for name in ("Boot", "Normal")]
    path = project(tmp_path, more=[*more, begins, in_modes(alarm("One", "20", start="2", activates="Lone"), "Normal")])
    before = Os(tmp_path, "/E/Os/Boot").play(0.1)
    onto = put(path)
    assert removed(onto) == ["/E/Os/Al/s", "/E/Os/One/s"]
    model = model_of(path)
    assert played(path, onto)[0] == []
    merged = Os(tmp_path, "/E/Os/Boot")
    assert [act for act in before if not act.by.endswith("/Al")] == merged.play(0.1)
    assert merged.mode_of("Halpipe_") == "/E/Os/Normal"
    assert [(t.name, t.period, t.offset) for t in model_of(path).tasks] == [
        (t.name, t.period, t.offset) for t in model.tasks
    ]


def test_what_only_code_starts_is_named_and_left_as_it_is(tmp_path):
    action = [("OsAlarmActivateTaskRef", "/E/Os/Main")]
    coded = container(
        "Os/OsAlarm", "Coded", container("Os/OsAlarm/OsAlarmAction/OsAlarmActivateTask", "a", refs=action)
    )
    night = old_table({"0": acts("Main", "Lone")}, started=False).replace(">Old<", ">Night<")
    path = project(tmp_path, more=[coded, night, old_table({"0": acts("Main")}), START])
    onto = put(path)
    told = [d.path for d in onto.findings if d.code == codes.CODE_STARTS.id]
    assert told == ['OsAlarm "/E/Os/Coded"', 'OsScheduleTable "/E/Os/Night"']
    assert removed(onto) == ["/E/Os/Al/s", "/E/Os/Old/go"]


def two_cores(folder, *ticks):
    """A runnable every 10 ms and one every 5 ms on two cores, which have counters of their own."""
    names, periods = ("One", "Two"), ("0.01", "0.005")
    types = [
        component(n, every(period, "Tick", f"{n}/Step"), runnables="Step")
        for n, period in zip(names, periods, strict=True)
    ]
    counters = [
        container("Os/OsCounter", f"Ticks{name}", params={"OsSecondsPerTick": tick})
        for name, tick in zip(names, ticks, strict=True)
    ]
    applications = [
        container(
            "Os/OsApplication",
            f"App{name}",
            refs=[
                ("OsAppTaskRef", f"/E/Os/Task{name}"),
                ("OsAppCounterRef", f"/E/Os/Ticks{name}"),
                ("OsApplicationCoreRef", f"/E/EcuC/Core{name}"),
            ],
        )
        for name in names
    ]
    os = configuration("Os", *(os_task(f"Task{name}") for name in names), *counters, *applications, START)
    maps = configuration("Rte", rte(*(mapped(f"{name}/B/Tick", f"Task{name}", "1") for name in names)))
    cores = configuration("EcuC", *(core(f"Core{name}", str(number)) for number, name in enumerate(names)))
    path = written(folder, package("T", *types), package("E", os, maps, cores))
    model = model_of(path)
    jobs = [job(model, "Two/Step", index, f"{2 + 5 * index}ms", "CoreTwo") for index in range(2)]
    jobs.append(job(model, "One/Step", 0, "4ms", "CoreOne"))
    return path, model, schedule(model, 10, *jobs, mode_name="default")


def test_the_tables_of_cores_with_other_ticks_begin_together(tmp_path):
    path, model, planned = two_cores(tmp_path, "0.002", "0.0005")
    onto = export_onto(model, planned, str(tmp_path), ArxmlImportOptions())
    starts = {c.path.split("/")[3]: c.new for c in onto.changes if c.name == "OsScheduleTableStartValue"}
    assert starts == {"Halpipe_default_CoreOne": "5", "Halpipe_default_CoreTwo": "20"}
    assert played(path, onto, planned) == ([], 3)
    path.with_name("delta.arxml").write_bytes(
        onto.files["delta.arxml"].replace(b"<VALUE>20</VALUE>", b"<VALUE>17</VALUE>")
    )
    assert played(path, None, planned)[0] != []


def test_an_autostart_in_two_files_is_taken_out_of_both(tmp_path):
    path = project(tmp_path, more=[alarm("Second", "10", activates="Main"), START])
    model, kind = model_of(path), "Os/OsAlarm"
    part = container(f"{kind}/OsAlarmAutostart", "s", params={"OsAlarmAutostartType": "RELATIVE"})
    other = written(tmp_path, package("E", configuration("Os", container(kind, "Second", part))), name="more.arxml")
    onto = put(path, model)
    other.write_bytes(onto.files["changed/more.arxml"])
    assert b"OsAlarmAutostart<" not in other.read_bytes()
    assert played(path, onto)[0] == []
