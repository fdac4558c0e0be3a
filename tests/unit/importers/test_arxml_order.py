"""Precedence: execution order constraints, positions in OS tasks, arrival of data; cycles are cut and named."""

import random

import pytest
from arxml_case import (
    assembly,
    component,
    composition,
    configuration,
    delegation,
    el,
    event,
    every,
    found,
    in_port,
    mapped,
    named,
    on_data,
    order,
    orders,
    os_task,
    out_port,
    package,
    periods,
    read,
    ref,
    rte,
    runnable,
    timing,
    write,
)
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.durations import ZERO, Duration
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.system.values import Place
from halpipe.importers.arxml.tasks.order import Edge, without_cycles
from halpipe.models import Anchor


def pump(*names, period="0.01"):
    return component("Pump", *[every(period, f"E{name}", f"Pump/{name}") for name in names], runnables=" ".join(names))


# ------------------------------------------------------------------------------- execution order constraints


def test_an_execution_order_is_a_window_of_one_period_after_the_end(tmp_path):
    path = write(tmp_path, package("T", pump("A", "B")), timing(order("Eoc", "Pump/A Pump/B")))
    imported = read(path)
    (constraint,) = imported.model.task("Pump/B").versions[0].precedences
    assert (constraint.task, constraint.anchor) == ("Pump/A", Anchor.END)
    assert (constraint.min, constraint.max) == (ZERO, Duration.parse("10ms"))
    assert constraint.origin.path == "/Orders/T/Eoc"
    assert ("EXECUTION-ORDER-CONSTRAINT", 1, 1, 0) in imported.coverage.rows()


def test_tasks_of_different_periods_have_the_longer_one_as_window(tmp_path):
    slow = component("Slow", every("0.05", "E", "Slow/B"), runnables="B")
    imported = read(write(tmp_path, package("T", pump("A"), slow), timing(order("Eoc", "Pump/A Slow/B"))))
    (constraint,) = imported.model.task("Slow/B").versions[0].precedences
    assert constraint.max == Duration.parse("50ms")


def test_an_order_within_a_type_holds_within_each_instance(tmp_path):
    car = composition("Car", "l:Pump r:Pump")
    imported = read(write(tmp_path, package("T", pump("A", "B"), car), timing(order("Eoc", "Pump/A Pump/B"))))
    assert orders(imported) == {"l/A > l/B", "r/A > r/B"}


def test_events_are_ordered_as_runnables_are(tmp_path):
    steps = [
        named(
            "EOC-EVENT-REF",
            "a",
            ref("EVENT-REF", "/T/Pump/B/EA"),
            el("SUCCESSOR-REFS", ref("SUCCESSOR-REF", "/Orders/T/Eoc/b")),
        ),
        named("EOC-EVENT-REF", "b", ref("EVENT-REF", "/T/Pump/B/EB")),
    ]
    constraint = named("EXECUTION-ORDER-CONSTRAINT", "Eoc", el("ORDERED-ELEMENTS", *steps))
    path = write(tmp_path, package("T", pump("A", "B")), timing(constraint))
    assert orders(read(path)) == {"Pump/A > Pump/B"}
    assert orders(read(path, granularity="event")) == {"Pump/A@EA > Pump/B@EB"}


# -------------------------------------------------------------------------------------- positions in OS tasks


def hosted(*positions, period="0.01", offsets=()):
    """Runnables A, B, C ... in one OsTask, at these positions."""
    names = [chr(ord("A") + index) for index in range(len(positions))]
    shifts = dict(zip(names, offsets, strict=False))
    mappings = [
        mapped(f"Pump/B/E{name}", "Main", position, offset=shifts.get(name, ""))
        for name, position in zip(names, positions, strict=True)
    ]
    return package("T", pump(*names, period=period)), package(
        "E", configuration("Os", os_task("Main")), configuration("Rte", rte(*mappings))
    )


@pytest.mark.parametrize(
    ("positions", "expected"),
    [
        (["1", "2", "3"], {"Pump/A > Pump/B", "Pump/B > Pump/C"}),
        (["30", "10", "20"], {"Pump/B > Pump/C", "Pump/C > Pump/A"}),
        (["1", "1", "2"], {"Pump/A > Pump/C", "Pump/B > Pump/C"}),
        (["1", "", "2"], {"Pump/A > Pump/C"}),
        (["", "", ""], set()),
    ],
    ids=["in order", "by number", "equal", "one missing", "none"],
)
def test_positions_order_an_os_task(tmp_path, positions, expected):
    assert orders(read(write(tmp_path, *hosted(*positions)))) == expected


def test_positions_order_neighbours_of_any_period_and_those_of_one_period(tmp_path):
    events = [every("0.01", "EA", "Pump/A"), every("0.02", "EB", "Pump/B"), every("0.01", "EC", "Pump/C")]
    _, ecu = hosted("1", "2", "3")
    imported = read(write(tmp_path, package("T", component("Pump", *events, runnables="A B C")), ecu))
    assert orders(imported) == {"Pump/A > Pump/B", "Pump/B > Pump/C", "Pump/A > Pump/C"}
    window = next(p for p in imported.model.task("Pump/B").versions[0].precedences)
    assert window.max == Duration.parse("20ms")


@pytest.mark.parametrize(
    ("offset", "period", "expected"),
    [("0.005", "0.01", set()), ("0.005", "0.015", {"Pump/A > Pump/B"}), ("0.001", "0.015", set())],
    ids=["never together", "together at 20 ms", "never, by the common divisor"],
)
def test_positions_order_only_what_is_ever_released_together(tmp_path, offset, period, expected):
    events = [every("0.01", "EA", "Pump/A"), every(period, "EB", "Pump/B")]
    _, ecu = hosted("1", "2", offsets=["", offset])
    imported = read(write(tmp_path, package("T", component("Pump", *events, runnables="A B")), ecu))
    assert orders(imported) == expected


def test_positions_are_inside_a_task_cut_by_os_task(tmp_path):
    imported = read(write(tmp_path, *hosted("1", "2", "3")), granularity="ostask")
    assert (periods(imported), orders(imported)) == ({"Main": "10ms"}, set())


# ------------------------------------------------------------------------------------------- arrival of data


def sender(name="Source", period="0.01"):
    return component(
        name, every(period, "T", f"{name}/Send"), runnables=[runnable("Send", [f"{name}/out"])], ports=[out_port("out")]
    )


SINK = component("Sink", on_data("D", "Sink/Use", "Sink/in"), runnables="Use", ports=[in_port("in")])
WIRE = assembly("w", "Car/a Source/out", "Car/b Sink/in")


def test_arrival_of_data_inherits_the_period_and_comes_after(tmp_path):
    car = composition("Car", "a:Source b:Sink", WIRE)
    imported = read(write(tmp_path, package("T", sender(), SINK, car)))
    assert periods(imported) == {"a/Send": "10ms", "b/Use": "10ms"}
    assert orders(imported) == {"a/Send > b/Use"}
    assert ("ASSEMBLY-SW-CONNECTOR", 1, 1, 0) in imported.coverage.rows()
    assert ("DATA-RECEIVED-EVENT", 1, 1, 0) in imported.coverage.rows()


def test_data_travels_through_nested_compositions(tmp_path):
    inner = composition(
        "Inner", "a:Source", delegation("d", "P", "Inner/a Source/out", "Inner/out"), ports=[out_port("out")]
    )
    outer = composition("Outer", "b:Sink", delegation("d", "R", "Outer/b Sink/in", "Outer/in"), ports=[in_port("in")])
    car = composition("Car", "x:Inner y:Outer", assembly("w", "Car/x Inner/out", "Car/y Outer/in"))
    imported = read(write(tmp_path, package("T", sender(), SINK, inner, outer, car)))
    assert orders(imported) == {"x/a/Send > y/b/Use"}
    assert ("DELEGATION-SW-CONNECTOR", 2, 2, 0) in imported.coverage.rows()


def test_periods_run_along_chains_of_arrivals(tmp_path):
    relay = component(
        "Relay",
        on_data("D", "Relay/Pass", "Relay/in"),
        runnables=[runnable("Pass", ["Relay/out"])],
        ports=[in_port("in"), out_port("out")],
    )
    wires = [assembly("v", "Car/a Source/out", "Car/m Relay/in"), assembly("w", "Car/m Relay/out", "Car/b Sink/in")]
    car = composition("Car", "a:Source m:Relay b:Sink", *wires)
    imported = read(write(tmp_path, package("T", sender(), relay, SINK, car)))
    assert set(periods(imported).values()) == {"10ms"}
    assert orders(imported) == {"a/Send > m/Pass", "m/Pass > b/Use"}


def test_a_loop_of_arrivals_has_no_period(tmp_path):
    loop = component(
        "Loop",
        every("0.01", "T", "Loop/Tick"),
        on_data("D", "Loop/Pass", "Loop/in"),
        runnables=["<RUNNABLE-ENTITY><SHORT-NAME>Tick</SHORT-NAME></RUNNABLE-ENTITY>", runnable("Pass", ["Loop/out"])],
        ports=[in_port("in"), out_port("out")],
    )
    wires = [assembly("v", "Car/a Loop/out", "Car/b Loop/in"), assembly("w", "Car/b Loop/out", "Car/a Loop/in")]
    imported = read(write(tmp_path, package("T", loop, composition("Car", "a:Loop b:Loop", *wires))))
    assert periods(imported) == {"a/Tick": "10ms", "b/Tick": "10ms"}


def test_senders_of_one_period_and_of_none_count_as_one_period(tmp_path):
    server = component(
        "Server",
        event("OPERATION-INVOKED-EVENT", "Call", "Server/Serve"),
        runnables=[runnable("Serve", ["Server/out"])],
        ports=[out_port("out")],
    )
    wires = [WIRE, assembly("v", "Car/s Server/out", "Car/b Sink/in")]
    car = composition("Car", "a:Source s:Server b:Sink", *wires)
    assert periods(read(write(tmp_path, package("T", sender(), server, SINK, car))))["b/Use"] == "10ms"


def test_connectors_alone_order_nothing(tmp_path):
    reader = component(
        "Sink", every("0.01", "T", "Sink/Use"), runnables=[runnable("Use", reads=["Sink/in"])], ports=[in_port("in")]
    )
    imported = read(write(tmp_path, package("T", sender(), reader, composition("Car", "a:Source b:Sink", WIRE))))
    assert orders(imported) == set()
    (note,) = found(imported, codes.DATA_FLOW)
    assert "a/Send to b/Use" in note.message


# ---------------------------------------------------------------------------------------------------- cycles


def test_the_weaker_source_yields(tmp_path):
    types, ecu = hosted("1", "2", "3")
    imported = read(write(tmp_path, types, ecu, timing(order("Eoc", "Pump/C Pump/A"))))
    assert orders(imported) == {"Pump/C > Pump/A", "Pump/A > Pump/B"}
    (cut,) = found(imported, codes.CYCLE)
    assert '"Pump/B" before "Pump/C" is left out' in cut.message
    assert '"Pump/C" before "Pump/A" before "Pump/B"' in cut.message


def edge(first, second):
    return Edge(str(first), str(second), Place("/x", "X", Location()))


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda pair: pair[0] != pair[1]), unique=True))
def test_what_is_kept_is_a_maximal_order(pairs):
    findings = Findings()
    kept = without_cycles([edge(*pair) for pair in pairs], findings)
    assert len(kept) + len(findings.items) == len(pairs)
    successors = {}
    for e in kept:
        successors.setdefault(e.first, set()).add(e.second)

    def reaches(start, end):
        seen, todo = set(), [start]
        while todo:
            name = todo.pop()
            if name == end:
                return True
            if name not in seen:
                seen.add(name)
                todo.extend(successors.get(name, ()))
        return False

    for first, second in pairs:
        is_kept = any((e.first, e.second) == (str(first), str(second)) for e in kept)
        assert reaches(str(second), str(first)) != is_kept


def test_cutting_does_not_depend_on_chance():
    pairs = [(a, b) for a in range(6) for b in range(6) if a != b]
    random.Random(1).shuffle(pairs)
    results = {tuple(without_cycles([edge(*pair) for pair in pairs], Findings())) for _ in range(3)}
    assert len(results) == 1
