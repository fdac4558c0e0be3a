"""Merged projects are played: each OsTask is started where the schedule says, once, whatever else is there."""

import pytest
from arxml_case import alarm, container, os_task
from test_arxml_onto import acts, model_of, old_table, planned, project, put

from halpipe.exporters.arxml import codes
from merged_os import Os, differences


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
