"""What the RTE calls: twins of RTE and BSW, several events of one call, events that nothing calls or that arrive."""

import pytest
from arxml_case import (
    alarm,
    assembly,
    component,
    composition,
    configuration,
    container,
    counter,
    el,
    event,
    every,
    found,
    in_port,
    mapped,
    module,
    named,
    on_data,
    os_task,
    out_port,
    package,
    periods,
    read,
    ref,
    rte,
    runnable,
    write,
)

from halpipe.core.durations import Duration
from halpipe.importers.arxml import FORMAT, codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.overlay import OverlayUse, read_overlays


def symbol(tag, name, function):
    inner = el("SYMBOL", function) if tag == "RUNNABLE-ENTITY" else ref("IMPLEMENTED-ENTRY-REF", f"/Entries/{function}")
    return named(tag, name, inner)


def twins(bsw_period="0.01", bsw_position="3", function="Com_Main", task="Main"):
    """A service component and a module whose functions may be one, both mapped to OsTasks."""
    entity = symbol("RUNNABLE-ENTITY", "Run", "Com_Main")
    swc = component("ComSwc", every("0.01", "E", "ComSwc/Run"), runnables=[entity])
    behavior = named(
        "BSW-INTERNAL-BEHAVIOR",
        "B",
        el("ENTITYS", symbol("BSW-SCHEDULABLE-ENTITY", "Main", function)),
        el("EVENTS", event("BSW-TIMING-EVENT", "E", "Com/Main", el("PERIOD", bsw_period))),
    )
    bsw = named("BSW-MODULE-DESCRIPTION", "Com", el("INTERNAL-BEHAVIORS", behavior))
    bsw_mapping = container("Rte/RteBswModuleInstance", "Com", mapped("Com/B/E", task, bsw_position, bsw=True))
    mappings = configuration("Rte", rte(mapped("ComSwc/B/E", "Main", "3")), bsw_mapping)
    return package("T", swc, bsw), package("E", configuration("Os", os_task("Main"), os_task("Other")), mappings)


@pytest.mark.parametrize("granularity", ["runnable", "event", "ostask"])
def test_one_function_at_one_position_is_one_call(tmp_path, granularity):
    imported = read(write(tmp_path, *twins()), granularity=granularity)
    assert list(periods(imported).values()) == ["10ms"]
    assert found(imported, codes.SAME_FUNCTION)


def test_the_call_is_the_runnable(tmp_path):
    imported = read(write(tmp_path, *twins()))
    assert list(periods(imported)) == ["ComSwc/Run"]
    assert ("BSW-SCHEDULABLE-ENTITY", 1, 1, 0) in imported.coverage.rows()


@pytest.mark.parametrize(
    "other",
    [{"bsw_period": "0.02"}, {"bsw_position": "4"}, {"function": "Com_Other"}, {"task": "Other"}],
    ids=["period", "position", "function", "OsTask"],
)
def test_what_differs_is_a_call_of_its_own(tmp_path, other):
    assert len(periods(read(write(tmp_path, *twins(**other))))) == 2


def hosted(*rates, offsets=()):
    """Events E0, E1, ... of one runnable in one OsTask."""
    pump = component("Pump", *[every(p, f"E{i}", "Pump/Step") for i, p in enumerate(rates)], runnables="Step")
    shifts = dict(enumerate(offsets))
    maps = [mapped(f"Pump/B/E{i}", "Main", str(i), offset=shifts.get(i, "")) for i in range(len(rates))]
    return package("T", pump), package("E", configuration("Os", os_task("Main")), configuration("Rte", rte(*maps)))


@pytest.mark.parametrize(
    ("rates", "offsets", "expected"),
    [
        (["0.02", "0.01"], (), {"10ms"}),
        (["0.02", "0.01"], ("0.01", ""), {"10ms"}),
        (["0.02", "0.01"], ("0.005", ""), {"10ms", "20ms"}),
        (["0.01", "0.015"], (), {"10ms", "15ms"}),
    ],
    ids=["contained", "contained with an offset", "between", "neither contains the other"],
)
def test_several_events_of_a_runnable_in_one_os_task_are_one_call(tmp_path, rates, offsets, expected):
    imported = read(write(tmp_path, *hosted(*rates, offsets=offsets)))
    assert set(periods(imported).values()) == expected
    assert len(imported.model.tasks) == len(expected)
    assert bool(found(imported, codes.SEVERAL_RATES)) == (len(expected) > 1)


def unmapped(path, *, bsw=False):
    infix, parent = ("Bsw", "RteBswModuleInstance") if bsw else ("", "RteSwComponentInstance")
    refs = [(f"Rte{infix}EventRef", f"/T/{path}")]
    return container(f"Rte/{parent}/Rte{infix}EventToTaskMapping", path.replace("/", "_"), refs=refs)


def test_timing_events_that_no_os_task_calls_are_no_tasks(tmp_path):
    pump = component("Pump", every("0.01", "E", "Pump/Step"), runnables="Step")
    com = module("Com", event("BSW-TIMING-EVENT", "E", "Com/Main", el("PERIOD", "0.005")), entities="Main")
    rest = container("Rte/RteBswModuleInstance", "Com", unmapped("Com/B/E", bsw=True))
    parts = configuration("Rte", rte(mapped("Pump/B/E", "Main", "1")), rest)
    path = write(tmp_path, package("T", pump, com), package("E", configuration("Os", os_task("Main")), parts))
    imported = read(path)
    assert list(periods(imported)) == ["Pump/Step"]
    (told,) = found(imported, codes.NOT_CALLED)
    assert "BSW/Com/Main" in told.message
    reasons = {e.name: e.reason for e in imported.coverage.ignored_elements}
    assert "no OsTask calls it" in reasons["/E/Rte/Com/Com_B_E"]
    assert periods(read(path, sources={"BSW/Com/Main": "5ms"}))["BSW/Com/Main"] == "5ms"


def test_a_configuration_that_maps_nothing_yet_calls_everything(tmp_path):
    pump = component("Pump", every("0.01", "E", "Pump/Step"), runnables="Step")
    parts = package("E", configuration("Rte", rte(unmapped("Pump/B/E"))))
    assert list(periods(read(write(tmp_path, package("T", pump), parts)))) == ["Pump/Step"]


def test_a_mapping_to_an_os_task_of_another_file_is_a_call(tmp_path):
    first, second = hosted("0.01"), hosted("0.01")[1].replace("<SHORT-NAME>Os<", "<SHORT-NAME>Os2<")
    lost = second.replace("/E/Os/Main", "/E/Elsewhere/Main").replace("<SHORT-NAME>Rte<", "<SHORT-NAME>Rte2<")
    imported = read(write(tmp_path, first[0], lost))
    assert list(periods(imported)) == ["Pump/Step"]
    assert found(imported, codes.DANGLING)


SOURCE = component(
    "Source",
    every("0.01", "E", "Source/Make"),
    runnables=[runnable("Make", writes=["Source/out"])],
    ports=[out_port("out")],
)
SINK = component("Sink", on_data("D", "Sink/Use", "Sink/in"), runnables="Use", ports=[in_port("in")])
CAR = composition("Car", "a:Source b:Sink", assembly("c", "Car/a Source/out", "Car/b Sink/in"))


def test_the_period_of_a_sender_is_never_taken_silently(tmp_path):
    imported = read(write(tmp_path, package("T", SOURCE, SINK, CAR)))
    assert periods(imported) == {"a/Make": "10ms", "b/Use": "10ms"}
    (told,) = found(imported, codes.INHERITED)
    assert "b/Use" in told.message
    assert ('task "b/Use"', "period", "10ms") in {
        (default.element, default.what, default.value) for default in imported.coverage.defaulted_values
    }


def test_what_an_os_task_runs_on_arrival_has_no_period(tmp_path):
    maps = rte(mapped("Source/B/E", "Main", "0"), mapped("Sink/B/D", "Main", "1"))
    ecu = package("E", configuration("Os", os_task("Main")), configuration("Rte", maps))
    path = write(tmp_path, package("T", SOURCE, SINK, CAR), ecu)
    imported = read(path)
    assert periods(imported) == {"a/Make": "10ms"}
    assert "b/Use" in found(imported, codes.NO_PERIOD)[0].message
    assert periods(read(path, sources={"b/Use": "10ms"})) == {"a/Make": "10ms", "b/Use": "10ms"}


@pytest.mark.parametrize(
    ("stated", "wcet"),
    [({"ComSwc/Run": 2}, "2ms"), ({"BSW/Com/Main": 3}, "3ms"), ({"ComSwc/Run": 2, "BSW/Com/Main": 3}, "3ms")],
)
def test_the_time_of_a_function_may_be_stated_by_either_name(tmp_path, stated, wcet):
    """Of two names with two times the longer one counts."""
    folder = write(tmp_path, *twins())
    overlay = tmp_path / "overlay.yaml"
    lines = "".join(f"  {name}: {{wcet: {time}ms}}\n" for name, time in stated.items())
    overlay.write_text("halpipe-overlay: 1\ntasks:\n" + lines)
    used = OverlayUse(read_overlays([str(overlay)]))
    imported = FORMAT.read([str(folder)], ArxmlImportOptions(overlay=used, granularity="ostask"))
    (owner,) = imported.model.tasks
    assert owner.versions[0].wcet == Duration.parse(wcet)


@pytest.mark.parametrize(("cycle", "told"), [("10", 0), ("5", 0), ("25", 1), ("20", 1)])
def test_an_alarm_that_activates_an_os_task_between_its_calls_is_reported(tmp_path, cycle, told):
    pump = component("Pump", every("0.01", "A", "Pump/Step"), runnables="Step")
    alarms = alarm("Al", "10", activates="Main"), alarm("Other", cycle, activates="Main")
    maps = configuration("Rte", rte(mapped("Pump/B/A", "Main", "1")))
    ecu = package("E", configuration("Os", counter(), os_task("Main"), *alarms), maps)
    messages = [d.message for d in found(read(write(tmp_path, package("T", pump), ecu)), codes.TRIGGERING_DIFFERS)]
    assert messages == [f"activates /E/Os/Main every {cycle}ms, whose calls are due every 10ms"] * told
