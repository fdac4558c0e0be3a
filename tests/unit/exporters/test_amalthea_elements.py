"""Standard elements of an AMALTHEA export, one by one: names, times, labels, semaphores, events and limits."""

from dataclasses import replace

import pytest
from lxml import etree

from halpipe.core.durations import Duration
from halpipe.exporters.amalthea import FORMAT, RELEASES, AmaltheaOptions
from halpipe.exporters.amalthea.document import Unique, add_time
from halpipe.models import AccessKind, Anchor, Chain, Precedence, Resource, ResourceKind, Split, Transfer
from support import access, after, chain, job, mode, model, ms, schedule, task, version

XSI = "{http://www.w3.org/2001/XMLSchema-instance}type"


def write(system, plan=None, **options):
    return etree.fromstring(FORMAT.write(system, plan, AmaltheaOptions(**options))[""])


def times(element, tag):
    return [child.get("value") + child.get("unit") for child in element.iterchildren(tag)]


def moving(start, end, kind, *transfers, resource="ram"):
    moved = tuple(Transfer(buffer=buffer, symbol="s", size=size) for buffer, size in transfers)
    return replace(access(resource, start, end, 1, AccessKind(kind)), transfers=moved)


def test_names_that_are_taken_have_numbers():
    unique = Unique()
    assert [unique(name) for name in ("a", "a", "b", "a", "a~2", "a")] == ["a", "a~2", "b", "a~3", "a~2~2", "a~4"]


@pytest.mark.parametrize(
    ("time", "value"),
    [
        *((text, text) for text in ("2s", "1500ms", "1ms", "7us", "9ns", "0s")),
        *(("1/3ns", "333ps"), ("5/2ns", "2500ps"), ("1/3000ns", "1ps")),
    ],
)
def test_a_time_has_the_largest_unit_in_which_it_is_whole(time, value):
    parent = etree.Element("e")
    add_time(parent, "limit", Duration.parse(time))
    assert times(parent, "limit") == [value]


def test_labels_have_the_size_of_their_largest_transfer_and_the_memory_of_their_first():
    reader = version("r", 4, "u1", moving(0, 1, "read", ("in", 8)), moving(2, 3, "write", ("out", 64)))
    writer = version("w", 4, "u1", moving(0, 1, "write", ("in", 16), resource="rom"), moving(2, 3, "read", ("out", 4)))
    system = model(task("a", 10, reader), task("b", 10, writer), resources="ram rom")
    root = write(system)
    assert {label.get("name"): times(label, "size") for label in root.iter("labels")} == {"in": ["16B"], "out": ["64B"]}
    found = {m.get("abstractElement"): m.get("memory") for m in root.iter("memoryMapping")}
    assert found == {f"{label}?type=Label": "ram?type=Memory" for label in ("in", "out")}


def items(root, runnable):
    """The items of a runnable in their order: class, what it refers to, and how."""
    (found,) = root.iterfind(f"swModel/runnables[@name='{runnable}']/activityGraph")
    rows = []
    for item in found.iterchildren("items"):
        target = (item.get("data") or item.get("semaphore") or "").partition("?")[0]
        ticks = [constant.get("value") for constant in item.iter("value", "default")]
        rows.append((item.get(XSI)[3:], target, item.get("access") or "".join(ticks), item.get("implementation")))
    return rows


def test_a_runnable_reads_works_and_writes():
    phases = (
        moving(3, 4, "write", ("out", 4)),
        moving(0, 1, "read", ("in", 4)),
        moving(1, 2, "load", ("code", 4)),
        access("spin", 1, 2),
        access("spin", "2500us", 3),
    )
    owner = task("a", 10, version("v", 4, "u1", *phases))
    system = replace(model(owner), resources=(Resource(name="ram"), Resource(name="spin", kind=ResourceKind.LOCK)))
    expected = [
        ("LabelAccess", "in", "read", None),
        ("LabelAccess", "code", "read", None),
        ("Ticks", "", "1000000", None),
        ("SemaphoreAccess", "spin", "request", None),
        ("Ticks", "", "1000000", None),
        ("SemaphoreAccess", "spin", "release", None),
        ("Ticks", "", "500000", None),
        ("SemaphoreAccess", "spin", "request", None),
        ("Ticks", "", "500000", None),
        ("SemaphoreAccess", "spin", "release", None),
        ("Ticks", "", "1000000", None),
        ("LabelAccess", "out", "write", None),
    ]
    assert items(write(system), "a/v") == expected
    (semaphore,) = write(system).iter("semaphores")
    assert (semaphore.get("name"), semaphore.get("maxValue")) == ("spin", "1")


def test_ticks_are_rounded_up_and_none_is_written_for_no_time():
    locked = version("v", "10/3ns", "u1", access("spin", "0ns", "4/3ns"), access("spin", "4/3ns", "10/3ns"))
    system = replace(model(task("a", 10, locked)), resources=(Resource(name="spin", kind=ResourceKind.LOCK),))
    assert [row[:3] for row in items(write(system), "a/v")] == [
        ("SemaphoreAccess", "spin", "request"),
        ("Ticks", "", "2"),
        ("SemaphoreAccess", "spin", "release"),
        ("SemaphoreAccess", "spin", "request"),
        ("Ticks", "", "2"),
        ("SemaphoreAccess", "spin", "release"),
    ]
    assert items(write(model(task("a", 10, replace(version(), wcet=None)))), "a/v") == []


def test_a_task_with_a_let_accesses_a_label_as_timed_though_it_moves_nothing():
    idle, busy = version("idle", 1), version("busy", 4, "u1", moving(0, 1, "read", ("in", 4)))
    root = write(model(replace(task("a", 10, idle, busy), let=ms(8)), task("b", 10, idle), resources="ram"))
    assert items(root, "a/idle")[0] == ("LabelAccess", "a%2Flet", "read", "timed")
    assert [row for row in items(root, "a/busy") if row[0] == "LabelAccess"] == [("LabelAccess", "in", "read", "timed")]
    assert [row[0] for row in items(root, "b/idle")] == ["Ticks"]
    assert {label.get("name"): times(label, "size") for label in root.iter("labels")} == {
        "a/let": ["1B"],
        "in": ["4B"],
    }
    other = write(model(replace(task("a", 10, busy), let=ms(8)), resources="ram"))
    assert [label.get("name") for label in other.iter("labels")] == ["in"]


@pytest.mark.parametrize(
    ("splits", "preemption"),
    [
        ((Split(), Split()), "non_preemptive"),
        ((Split(), Split(points=(ms("0.5ms"),))), "cooperative"),
        ((Split(points=(ms("0.5ms"),)), Split(anywhere=True)), "preemptive"),
    ],
)
def test_a_task_is_as_preemptive_as_its_versions(splits, preemption):
    versions = [replace(version(name), split=split) for name, split in zip("vw", splits, strict=True)]
    (found,) = write(model(task("a", 10, *versions))).iter("tasks")
    assert found.get("preemption") == preemption


@pytest.mark.parametrize("release", RELEASES)
def test_the_scheduler_is_a_table_in_every_release(release):
    root = write(model(task("a", 10, version())), release=release)
    text = "starts every job at the instants of a table"
    found = {element.get(name) for element in root.find("osModel").iter() for name in ("description", "value")}
    assert text in found
    (scheduler,) = root.iter("taskSchedulers")
    assert (scheduler.get("definition") is None) == (release == "1.2.0")
    assert (scheduler.find("schedulingAlgorithm") is None) == (release != "1.2.0")
    (allocation,) = root.iter("schedulerAllocation")
    assert allocation.get("executingPU") == allocation.get("responsibility") == "u1?type=ProcessingUnit"


def test_the_version_of_a_task_is_that_of_its_first_job_or_its_first():
    system = model(task("a", 10, version("v"), version("w")), task("b", 10, version("v")))
    for plan, chosen in ((None, "v"), (schedule(system, 10, job(system, "a", 0, 0, "u1", "w")), "w")):
        labels = {label.get("name"): label for label in write(system, plan).iter("modeLabels")}
        assert {name: label.get("initialValue") for name, label in labels.items()} == {
            "mode": "all",
            "a/version": chosen,
        }
        assert labels["a/version"].get("mode") == "a%2Fversion?type=EnumMode"
        (switched,) = write(system, plan).iterfind("swModel/tasks[@name='a']/activityGraph/items")
        conditions = {
            entry.get("name"): [(c.get("value"), c.get("relation")) for c in entry.iterfind("condition/entries")]
            for entry in switched.iterchildren("entries")
        }
        assert conditions == {"v": [("v", "EQUAL")], "w": [("w", "EQUAL")]}


def test_a_model_without_modes_has_its_stimuli_and_no_label_of_a_mode():
    root = write(replace(model(task("a", 10, version(), offset=3)), modes=()))
    assert [label.get("name") for label in root.iter("modeLabels")] == []
    (stimulus,) = root.iter("stimuli")
    assert (times(stimulus, "recurrence"), times(stimulus, "offset")) == (["10ms"], ["3ms"])
    assert stimulus.find("executionCondition") is None


def test_modes_without_a_table_have_what_the_model_states():
    first, second = task("a", 10, version()), task("b", None, version())
    modes = (mode("on", [first, second]), mode("off", [first]), mode("rest", [second]))
    system = model(first, second, modes=modes)
    plan = schedule(system, 10, job(system, "a", 0, 2, "u1"), mode_name="on")
    found = [
        (s.get("name"), times(s, "offset"), [e.get("value") for e in s.iterfind("executionCondition/entries")])
        for s in write(system, plan).iter("stimuli")
    ]
    assert found == [("a@on", ["2ms"], ["on"]), ("a", [], ["off"])]


def test_the_units_of_a_task_come_in_the_order_of_the_model():
    system = model(task("a", 10, version("v", 1, "u3 u1 u2")), units="u1 u2 u3")
    (allocation,) = write(system).iter("taskAllocation")
    assert allocation.get("affinity").split() == [f"u{n}?type=ProcessingUnit" for n in (1, 2, 3)]
    jobs = (job(system, "a", 0, 0, "u3"), job(system, "a", 1, 10, "u2"))
    (allocation,) = write(system, schedule(system, 20, *jobs)).iter("taskAllocation")
    assert allocation.get("affinity").split() == [f"u{n}?type=ProcessingUnit" for n in (2, 3)]


# --------------------------------------------------------------------------------------------------- constraints


def links(root):
    """Each chain: its ends, and the pairs of events between."""
    return {
        found.get("name"): (
            found.get("stimulus").partition("?")[0],
            found.get("response").partition("?")[0],
            [(item[0].get("name"), item[0].get("stimulus").partition("?")[0]) for item in found.iterchildren("items")],
        )
        for found in root.iter("eventChains")
    }


def test_a_chain_goes_from_event_to_event():
    tasks = [task(name, 10, version()) for name in "abc"]
    whole = Chain(name="whole", tasks=("a", "b", "c"), max_age=ms(30), anchor=Anchor.RELEASE, to=Anchor.START)
    lone = Chain(name="lone", tasks=("a",), max_age=ms(30))
    assert links(write(model(*tasks, chains=[whole, lone]))) == {
        "whole": ("a%2Factivate", "c%2Fstart", [("whole.1", "a%2Factivate"), ("whole.2", "b%2Fstart")]),
        "lone": ("a%2Fstart", "a%2Fterminate", []),
    }


@pytest.mark.parametrize(
    ("reaction", "limit"), [("30ms", "20ms"), ("10.000001ms", "1ns"), ("10ms", "1ps"), ("5ms", "1ps")]
)
def test_a_reaction_counts_from_each_event_and_is_never_less_than_a_picosecond(reaction, limit):
    system = model(task("a", 10, version()), chains=[chain("c", "a", reaction=reaction)])
    (found,) = write(system).iterfind("constraintsModel/timingConstraints")
    assert (found.get("type"), times(found, "maximum")) == ("Reaction", [limit])


def windows(root):
    found = root.iterfind("constraintsModel/timingConstraints[@source]")
    return [
        (
            w.get("name"),
            *(w.get(end).partition("?")[0] for end in ("source", "target")),
            times(w, "lower"),
            times(w, "upper"),
        )
        for w in found
    ]


def test_windows_are_between_events_of_tasks_or_of_the_runnables_of_one_of_several_versions():
    rows = (
        Precedence(task="a", anchor=Anchor.POINT, point=ms(2), min=ms(1), max=ms(5)),
        Precedence(task="a", anchor=Anchor.END, to=Anchor.END, min=ms(0), max=ms(6)),
    )
    follower = replace(version("v"), precedences=rows)
    lone = model(task("a", 10, version("v", 4)), task("b", 10, follower))
    assert windows(write(lone)) == [
        ("a/b", "a%2Fstart", "b%2Fstart", ["3ms"], ["7ms"]),
        ("a/b~2", "a%2Fterminate", "b%2Fterminate", ["0s"], ["6ms"]),
    ]
    several = model(task("a", 10, version("v", 4)), task("b", 10, follower, version("w")))
    assert windows(write(several)) == [
        ("a/b/v", "a%2Fstart", "b%2Fv%2Fstart", ["3ms"], ["7ms"]),
        ("a/b/v~2", "a%2Fterminate", "b%2Fv%2Fterminate", ["0s"], ["6ms"]),
    ]


def test_each_event_is_written_once():
    rows = [after("a", 0, 8), after("a", 0, 9)]
    system = model(task("a", 10, version()), task("b", 10, version("v", 1, "u1", *rows)))
    assert [event.get("name") for event in write(system).iter("events")] == ["b/start", "a/start"]


@pytest.mark.parametrize(
    ("deadline", "let", "limit"), [(9, None, "9ms"), (9, 8, "8ms"), (7, 8, "7ms"), (None, 8, "8ms")]
)
def test_a_response_time_is_limited_by_deadline_and_let(deadline, let, limit):
    owner = replace(task("a", 10, version(), deadline=deadline), let=ms(let))
    (found,) = write(model(owner, task("b", 10, version()))).iter("requirements")
    assert (found.get("process"), times(found[0], "limitValue")) == ("a?type=Task", [limit])
