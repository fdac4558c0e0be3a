"""Timing constraints at runnables within the jobs of OsTasks: they count over whole jobs, which is reported."""

from itertools import chain

import pytest
from arxml_case import (
    assembly,
    component,
    composition,
    configuration,
    cse,
    data_observed,
    el,
    event_chain,
    every,
    extension,
    found,
    in_port,
    latency,
    mapped,
    named,
    observed,
    order,
    os_task,
    out_port,
    package,
    read,
    ref,
    refusal,
    rte,
    runnable,
    timing,
    write,
)

from halpipe.importers.arxml import codes
from halpipe.models import Match

# T calls A, B and C; U calls D and E; V calls F and G at one position, which states no order.
NAMES = {"A": ("T", "0"), "B": ("T", "1"), "C": ("T", "2"), "D": ("U", "0"), "E": ("U", "1"), "F": ("V", "0")}
NAMES["G"] = ("V", "0")
WRITES = {"A": ["first"], "B": ["out"], "E": ["late"]}
READS = {"A": ["in"], "C": ["same", "mixed"], "D": ["from"], "E": ["last"]}
JOINED = ["out from", "first last", "first same", "first mixed", "late mixed"]
TYPE = component(
    "P",
    *(every("0.01", f"E{name}", f"P/{name}") for name in NAMES),
    runnables=[
        runnable(name, *([f"P/{port}" for port in ports.get(name, ())] for ports in (WRITES, READS))) for name in NAMES
    ],
    ports=[*map(out_port, chain.from_iterable(WRITES.values())), *map(in_port, chain.from_iterable(READS.values()))],
)
joints = (assembly(f"j{i}", *(f"Top/p P/{port}" for port in pair.split())) for i, pair in enumerate(JOINED))
TYPES = package("T", TYPE, composition("Top", "p:P", *joints))
ECU = package(
    "E",
    configuration("Os", *map(os_task, "TUV")),
    configuration("Rte", rte(*(mapped(f"P/B/E{name}", *where) for name, where in NAMES.items()))),
)
EVENTS = [
    observed(name + what[0].lower(), f"P/{name}", what)
    for name in NAMES
    for what in ("ACTIVATED", "STARTED", "TERMINATED")
]
EVENTS += [data_observed("out", "P/out", "SENT")]
EVENTS += [data_observed(port, f"P/{port}", "RECEIVED") for ports in READS.values() for port in ports]


def given(tmp_path, *constraints, chains=(), granularity="ostask", orders=(), **options):
    parts = [TYPES, ECU, extension([*EVENTS, *chains], *constraints), timing(*orders)]
    return read(write(tmp_path, *parts), granularity=granularity, **options)


def chained(tmp_path, events, **options):
    chains = [event_chain("C", *events.split())]
    return given(tmp_path, latency("L", "C", 9_000), chains=chains, **options)


def distance(source, target, low=None, high=None):
    ends = [ref("SOURCE-REF", f"/Timing/X/{source}"), ref("TARGET-REF", f"/Timing/X/{target}")]
    limits = [cse(tag, value) for tag, value in (("MAXIMUM", high), ("MINIMUM", low)) if value is not None]
    return named("OFFSET-TIMING-CONSTRAINT", "O", *ends, *limits)


def together(*events, tolerance=5):
    refs = [ref("SCOPE-EVENT-REF", f"/Timing/X/{event}") for event in events]
    return named("SYNCHRONIZATION-TIMING-CONSTRAINT", "S", el("SCOPE-EVENT-REFS", *refs), cse("TOLERANCE", tolerance))


def windows(imported):
    return [
        (p.task, task.name, str(p.anchor), str(p.to), str(p.min), str(p.max), p.match)
        for task in imported.model.tasks
        for p in task.versions[0].precedences
    ]


@pytest.mark.parametrize(
    ("events", "anchors", "is_inner"),
    [
        ("As Et", (None, None), False),
        ("Ba Et", ("release", None), False),  # all calls of a job are activated at its release
        ("Ct Ds", ("end", "start"), False),
        ("in Et", (None, None), False),  # A reads it
        ("As Dt", (None, None), True),
        ("Bs Et", (None, None), True),
        ("Bt Et", (None, None), True),  # from the end of T, it would be laxer
        ("As Es", (None, None), True),  # to the start of U, it would be laxer
        ("out Et", (None, None), True),
        ("As out", (None, None), True),
        ("At Bs", (None, None), True),
        ("Fs Et", (None, None), True),
    ],
)
def test_a_chain_at_a_runnable_within_a_job_counts_over_the_job(tmp_path, events, anchors, is_inner):
    imported = chained(tmp_path, events)
    (made,) = imported.model.chains
    assert (made.anchor and str(made.anchor), made.to and str(made.to)) == anchors
    assert str(made.max_reaction or made.max_latency) == "9ms"
    assert len(found(imported, codes.WHOLE_JOB)) == is_inner


@pytest.mark.parametrize(
    ("events", "is_inner"), [("As Ct", False), ("Ba Ct", False), ("Bs Bt", True), ("As Bt", True), ("Bs Ct", True)]
)
def test_a_latency_within_one_job_is_a_deadline_of_all_of_it(tmp_path, events, is_inner):
    imported = chained(tmp_path, events)
    assert str(imported.model.task("T").deadline) == "9ms"
    assert len(found(imported, codes.WHOLE_JOB)) == is_inner


@pytest.mark.parametrize("events", ["Bs At", "Ct As", "Bt Bs", "Fs Gt", "As Ct Bs", "Ds Ct Bs"])
def test_a_chain_against_the_order_of_calls_is_lost(tmp_path, events):
    """Its last event is one of a later job, so that the limit is none of one job."""
    first, *rest = events.split()
    segments = [event_chain("M", first, rest[0])] * (len(rest) > 1)
    chains = [event_chain("C", first, rest[-1], *["M"] * len(segments)), *segments]
    imported = given(tmp_path, latency("L", "C", 9_000), chains=chains)
    assert len(found(imported, codes.TIMING_LOST)) == 1
    assert imported.model.chains == ()
    assert imported.model.task("T").deadline is None


@pytest.mark.parametrize(
    ("port", "tasks", "is_inner", "is_lost"),
    [
        ("last", [("T", "U")], False, False),  # from A, the first of T, to E, the last of U
        ("from", [("T", "U")], True, False),
        ("same", [], False, True),
        ("mixed", [("U", "T")], True, True),
    ],
)
def test_the_age_of_data_counts_over_whole_jobs_of_two_tasks(tmp_path, port, tasks, is_inner, is_lost):
    age = named("AGE-CONSTRAINT", "Age", ref("SCOPE-REF", f"/Timing/X/{port}"), cse("MAXIMUM", 9_000))
    imported = given(tmp_path, age)
    assert [(made.tasks, str(made.max_age)) for made in imported.model.chains] == [(pair, "9ms") for pair in tasks]
    assert [len(found(imported, code)) for code in (codes.WHOLE_JOB, codes.TIMING_LOST)] == [is_inner, is_lost]


END_TO_START, START_TO_END = ("end", "start"), ("start", "end")


@pytest.mark.parametrize(
    ("source", "target", "limits", "instants"),
    [
        ("Ct", "Ds", {"low": 1_000, "high": 4_000}, [END_TO_START]),
        ("Bt", "Ds", {"low": 1_000, "high": 4_000}, [END_TO_START, ("start", "start")]),
        ("As", "Es", {"low": 1_000, "high": 4_000}, [("start", "start"), START_TO_END]),
        ("Bs", "Es", {"low": 1_000, "high": 4_000}, [END_TO_START, START_TO_END]),
        ("Bt", "Es", {"high": 4_000}, [END_TO_START, START_TO_END]),
        ("Bs", "Es", {"low": 1_000}, [END_TO_START]),
        ("As", "Es", {"low": 1_000}, [("start", "start")]),
    ],
)
def test_a_distance_holds_wherever_its_events_are_within_the_jobs(tmp_path, source, target, limits, instants):
    imported = given(tmp_path, distance(source, target, **limits))
    low, high = ("1ms" if "low" in limits else "0ms"), ("4ms" if "high" in limits else "11ms")
    match = Match.WINDOW if len(instants) == 1 else Match.CYCLE
    assert windows(imported) == [("T", "U", *pair, low, high, match) for pair in instants]
    assert len(found(imported, codes.WHOLE_JOB)) == ((source, target) != ("Ct", "Ds"))


@pytest.mark.parametrize(
    ("events", "instants", "whole", "is_inner"),
    [
        ("As Ds", [("start", "start")], [], False),
        ("Ct Ds Es", [("end", "start"), ("end", "end")], ["U"], True),
        ("As Ct Ds", [("start", "start")], ["T"], False),
        ("Bs Ds", [("start", "start")], ["T"], True),
        ("As Dt", [("start", "start"), ("start", "end")], ["U"], True),
        ("Bs Bt Es", [("start", "start"), ("start", "end")], ["T", "U"], True),
    ],
)
def test_synchronised_events_hold_wherever_they_are_within_the_jobs(tmp_path, events, instants, whole, is_inner):
    imported = given(tmp_path, together(*events.split()))
    assert windows(imported) == [("T", "U", *pair, "0ms", "5us", Match.CYCLE) for pair in instants]
    assert [(made.tasks, str(made.max_latency)) for made in imported.model.chains] == [((t,), "5us") for t in whole]
    assert len(found(imported, codes.WHOLE_JOB)) == is_inner


def test_events_within_jobs_are_never_at_once(tmp_path):
    (lost,) = found(given(tmp_path, together("Bs", "Ds", tolerance=0)), codes.TIMING_LOST)
    assert "its events are apart within jobs of T" in lost.message


def test_a_distance_from_what_not_each_job_calls_is_lost(tmp_path):
    events = every("0.02", "EA", "P/A"), every("0.01", "EB", "P/B"), every("0.01", "ED", "P/D")
    types = package("T", component("P", *events, runnables="A B D"))
    constraints = distance("As", "Ds", 1_000, 4_000), distance("Ds", "As", 1_000, 4_000)
    for constraint, is_lost in zip(constraints, (True, False), strict=True):
        parts = [types, ECU, extension([event for event in EVENTS if ">/T/P/B/" in event], constraint)]
        imported = read(write(tmp_path, *parts), granularity="ostask")
        assert len(found(imported, codes.TIMING_LOST)) == is_lost


@pytest.mark.parametrize(("steps", "is_inner"), [("C D", False), ("B D", True), ("C E", True), ("B C", False)])
def test_an_order_of_runnables_within_jobs_orders_the_jobs(tmp_path, steps, is_inner):
    first, second = steps.split()
    imported = given(tmp_path, orders=[order("O", f"P/{first} P/{second}")])
    assert len(windows(imported)) == (steps != "B C")
    assert len(found(imported, codes.WHOLE_JOB)) == is_inner


@pytest.mark.parametrize("granularity", ["runnable", "event"])
def test_tasks_of_one_runnable_keep_its_events(tmp_path, granularity):
    constraints = [distance("Bt", "Es", 1_000, 4_000), together("Bs", "Ds"), latency("L", "C", 9_000)]
    chains = [event_chain("C", "Bs", "Et")]
    imported = given(tmp_path, *constraints, chains=chains, granularity=granularity, orders=[order("O", "P/B P/E")])
    assert not found(imported, codes.WHOLE_JOB)


@pytest.mark.parametrize("constraint", [distance("Bt", "Ds", high=4_000), together("Bs", "Ds"), latency("L", "C", 9)])
def test_strict_refuses_what_counts_over_the_whole_job(tmp_path, constraint):
    parts = [TYPES, ECU, extension([*EVENTS, event_chain("C", "As", "Dt")], constraint)]
    failure = refusal(write(tmp_path, *parts), granularity="ostask", strict=True)
    assert failure.exit == 5
    assert codes.WHOLE_JOB.id in {diagnostic.code for diagnostic in failure.diagnostics}
