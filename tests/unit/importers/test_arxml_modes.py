"""Execution modes from the modes in which events are disabled."""

import pytest
from arxml_case import (
    assembly,
    component,
    composition,
    configuration,
    disabled,
    el,
    event,
    every,
    found,
    in_port,
    mapped,
    mode_group,
    module,
    os_task,
    out_port,
    package,
    read,
    ref,
    rte,
    write,
)

from halpipe.importers.arxml import codes

POWER = mode_group("Power", "Sleep Run", "Run Sleep", "Run Run")  # the last mode is the initial one


def runs(imported):
    return {mode.name: {run.task for run in mode.runs} for mode in imported.model.modes}


def pump(**disabled_in):
    """A pump with one runnable per argument, disabled in those modes."""
    events = [
        every("0.01", f"E{name}", f"Pump/{name}", *([disabled(*modes.split())] if modes else []))
        for name, modes in disabled_in.items()
    ]
    return component("Pump", *events, runnables=" ".join(disabled_in))


def test_without_disabled_events_there_is_one_mode(tmp_path):
    imported = read(write(tmp_path, package("T", POWER, pump(A=""))))
    assert runs(imported) == {"default": {"Pump/A"}}
    assert ("MODE-DECLARATION-GROUP", 1, 0, 1) in imported.coverage.rows()


def test_one_group_makes_its_modes_the_initial_one_first(tmp_path):
    imported = read(write(tmp_path, package("T", POWER, pump(A="Power/Sleep", B=""))))
    assert runs(imported) == {"Run": {"Pump/A", "Pump/B"}, "Sleep": {"Pump/B"}}
    assert [mode.name for mode in imported.model.modes] == ["Run", "Sleep"]
    assert imported.model.modes[1].origin.path == "/T/Power/Sleep"
    assert {(t.source, t.target) for t in imported.model.transitions} == {("Run", "Sleep")}
    assert ("MODE-DECLARATION", 2, 2, 0) in imported.coverage.rows()
    assert ("MODE-TRANSITION", 2, 1, 1) in imported.coverage.rows()


def test_a_group_without_transitions_allows_every_one(tmp_path):
    group = mode_group("Power", "Sleep Run")
    assert read(write(tmp_path, package("T", group, pump(A="Power/Sleep")))).model.transitions == ()


def test_several_groups_each_switch_on_their_own(tmp_path):
    door = mode_group("Door", "Open Closed")
    imported = read(write(tmp_path, package("T", POWER, door, pump(A="Power/Sleep", B="Door/Open", C=""))))
    everything = {"Pump/A", "Pump/B", "Pump/C"}
    assert runs(imported) == {
        "default": everything,
        "Power.Run": everything,
        "Power.Sleep": {"Pump/B", "Pump/C"},
        "Door.Closed": everything,
        "Door.Open": {"Pump/A", "Pump/C"},
    }
    moves = {(t.source, t.target) for t in imported.model.transitions}
    assert ("Power.Run", "Power.Sleep") in moves
    assert ("Power.Sleep", "Power.Run") not in moves
    assert {("Door.Open", "Door.Closed"), ("Door.Closed", "Door.Open")} <= moves
    assert {("default", "Power.Sleep"), ("Power.Sleep", "default")} <= moves
    assert found(imported, codes.SEVERAL_GROUPS)


def test_a_task_of_several_events_runs_while_any_of_them_does(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "A", "Pump/Step", disabled("Power/Sleep", "Power/Off")),
        every("0.01", "B", "Pump/Step", disabled("Power/Off")),
        runnables="Step",
    )
    group = mode_group("Power", "Sleep Off Run")
    imported = read(write(tmp_path, package("T", group, pump)))
    assert runs(imported) == {"Run": {"Pump/Step"}, "Sleep": {"Pump/Step"}}
    assert [note.message for note in found(imported, codes.EMPTY_MODE)] == ['no task runs in mode "Off"']


def test_modules_are_disabled_too(tmp_path):
    off = el("DISABLED-IN-MODE-IREFS", el("DISABLED-IN-MODE-IREF", ref("TARGET-MODE-REF", "/T/Power/Sleep")))
    com = module(
        "Com",
        event("BSW-TIMING-EVENT", "T", "Com/Main", off, el("PERIOD", "0.005")),
        event("BSW-TIMING-EVENT", "U", "Com/Other", el("PERIOD", "0.005")),
        entities="Main Other",
    )
    assert runs(read(write(tmp_path, package("T", POWER, com)))) == {
        "Run": {"BSW/Com/Main", "BSW/Com/Other"},
        "Sleep": {"BSW/Com/Other"},
    }


def test_the_order_of_an_os_task_passes_through_what_a_mode_disables(tmp_path):
    maps = [mapped(f"Pump/B/E{name}", "Main", str(at)) for at, name in enumerate("ABCD")]
    ecu = package("E", configuration("Os", os_task("Main")), configuration("Rte", rte(*maps)))
    path = write(tmp_path, package("T", POWER, pump(A="", B="Power/Sleep", C="Power/Sleep", D="")), ecu)
    model = read(path).model
    last = model.task("Pump/D")
    before = {version.name: [p.task for p in version.precedences] for version in last.versions}
    assert before == {"default": ["Pump/C"], "default.Sleep": ["Pump/A"]}
    used = {mode.name: run.versions for mode in model.modes for run in mode.runs if run.task == "Pump/D"}
    assert used == {"Run": ("default",), "Sleep": ("default.Sleep",)}
    assert [version.name for version in model.task("Pump/A").versions] == ["default"]


@pytest.mark.parametrize(("second", "told"), [("one M/out", 0), ("two M/out", 1)])
def test_providers_that_switch_one_group_independently_are_reported(tmp_path, second, told):
    def user(name, mode):
        target = ref("CONTEXT-PORT-REF", f"/T/{name}/in"), ref("TARGET-MODE-DECLARATION-REF", f"/T/Power/{mode}")
        irefs = el("DISABLED-MODE-IREFS", el("DISABLED-MODE-IREF", *target))
        return component(name, every("0.01", "E", f"{name}/R", irefs), runnables="R", ports=[in_port("in")])

    links = assembly("a", "Top/one M/out", "Top/x X/in"), assembly("b", f"Top/{second}", "Top/y Y/in")
    top = composition("Top", "one:M two:M x:X y:Y", *links)
    users = user("X", "Run"), user("Y", "Sleep")
    imported = read(write(tmp_path, package("T", POWER, component("M", ports=[out_port("out")]), *users, top)))
    messages = [d.message for d in found(imported, codes.SEVERAL_MACHINES)]
    assert [("2 providers" in m, "/T/M/out" in m) for m in messages] == [(True, True)] * told
