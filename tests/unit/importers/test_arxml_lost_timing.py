"""Requirements of the timing extension that nothing is made of: each is reported, or kept in another way."""

from fractions import Fraction

import pytest
from arxml_case import (
    alarm,
    component,
    configuration,
    counter,
    cse,
    el,
    event_chain,
    every,
    extension,
    found,
    latency,
    mapped,
    named,
    observed,
    order,
    os_task,
    package,
    read,
    ref,
    rte,
    timing,
    triggering,
    write,
)

from halpipe.importers.arxml import codes
from halpipe.importers.arxml.codes import UNUSED_KIND

PUMP = component(
    "Pump", every("0.01", "A", "Pump/First"), every("0.01", "B", "Pump/Second"), runnables="First Second Third"
)
BEGIN, END = observed("Begin", "Pump/First", "ACTIVATED"), observed("End", "Pump/First", "TERMINATED")
START = observed("Start", "Pump/Second", "STARTED")


def pump(tmp_path, *more, **options):
    return read(write(tmp_path, package("T", PUMP), *more), **options)


def offset(source, target, *limits):
    ends = ref("SOURCE-REF", f"/Timing/X/{source}"), ref("TARGET-REF", f"/Timing/X/{target}")
    return named("OFFSET-TIMING-CONSTRAINT", "O", *ends, *limits)


def together(*events):
    refs = [ref("SCOPE-EVENT-REF", f"/Timing/X/{event}") for event in events]
    return named("SYNCHRONIZATION-TIMING-CONSTRAINT", "S", el("SCOPE-EVENT-REFS", *refs), cse("TOLERANCE", 1_000))


FIRST_START = observed("FirstStart", "Pump/First", "STARTED")
THIRD = observed("Third", "Pump/Third", "ACTIVATED")
DURING = event_chain("C", "Begin", "End")
NO_CODE = latency("L", "C", 5_000).replace(el("CSE-CODE", "0"), "")
SPORADIC = triggering("SPORADIC", "S", "Third", cse("MINIMUM-INTER-ARRIVAL-TIME", 4_000))
UNREADABLE = el("OFFSETS", cse("MULTIDIMENSIONAL-TIME", 0), cse("MULTIDIMENSIONAL-TIME", 3, 100))


@pytest.mark.parametrize(
    ("descriptions", "constraints", "code", "said"),
    [
        ([BEGIN, END, DURING], [latency("L", "C", 0)], UNUSED_KIND, "LATENCY-TIMING-CONSTRAINT"),
        ([BEGIN, END, DURING], [NO_CODE], codes.BAD_TIME, 'MAXIMUM with CSE-CODE ""'),
        ([FIRST_START, START], [offset("FirstStart", "Start")], UNUSED_KIND, "OFFSET-TIMING-CONSTRAINT"),
        ([BEGIN], [named("RESPONSE-TIME-CONSTRAINT", "R")], UNUSED_KIND, "RESPONSE-TIME-CONSTRAINT"),
        ([END], [triggering("PERIODIC", "P", "End", cse("PERIOD", 7_000))], UNUSED_KIND, "PERIODIC-EVENT-TRIGGERING"),
        (
            [THIRD],
            [triggering("PERIODIC", "P", "Third", cse("PERIOD", 20_000)), SPORADIC],
            UNUSED_KIND,
            "SPORADIC-EVENT-TRIGGERING",
        ),
        (
            [THIRD],
            [triggering("CONCRETE-PATTERN", "P", "Third", UNREADABLE, cse("PATTERN-PERIOD", 10_000))],
            codes.BAD_TIME,
            "no time between occurrences",
        ),
        (
            [BEGIN],
            [triggering("SPORADIC", "S", "Begin", cse("MINIMUM-INTER-ARRIVAL-TIME", 10_001))],
            codes.TRIGGERING_DIFFERS,
            "10.001ms",
        ),
        (
            [BEGIN],
            [
                triggering(
                    "PERIODIC",
                    "P",
                    "Begin",
                    cse("JITTER", 3_000),
                    cse("MINIMUM-INTER-ARRIVAL-TIME", 7_001),
                    cse("PERIOD", 10_000),
                )
            ],
            codes.TIMING_PART_LOST,
            "MINIMUM-INTER-ARRIVAL-TIME",
        ),
    ],
)
def test_a_requirement_that_nothing_is_made_of_is_reported(tmp_path, descriptions, constraints, code, said):
    (told,) = found(pump(tmp_path, extension(descriptions, *constraints)), code)
    assert said in told.message


@pytest.mark.parametrize(
    "kept",
    [
        triggering("SPORADIC", "S", "Begin", cse("MINIMUM-INTER-ARRIVAL-TIME", 10_000)),
        triggering("PERIODIC", "P", "Begin", cse("MINIMUM-INTER-ARRIVAL-TIME", 10_000), cse("PERIOD", 10_000)),
        named("PERIODIC-EVENT-TRIGGERING", "F", ref("EVENT-REF", "/N/F", "TD-EVENT-FRAME"), cse("PERIOD", 1)),
    ],
)
def test_a_requirement_that_is_kept_or_of_the_network_is_not_reported(tmp_path, kept):
    imported = pump(tmp_path, extension([BEGIN], kept))
    assert [found(imported, c) for c in (UNUSED_KIND, codes.TRIGGERING_DIFFERS, codes.TIMING_PART_LOST)] == [[], [], []]


HOSTED = package(
    "E",
    configuration("Os", counter(), os_task("Main"), alarm("Al", "10", activates="Main")),
    configuration("Rte", rte(mapped("Pump/B/A", "Main", "1"), mapped("Pump/B/B", "Main", "2"))),
)


def test_what_is_demanded_within_one_task_is_reported(tmp_path):
    within = [FIRST_START, START], offset("FirstStart", "Start", cse("MAXIMUM", 1_000)), together("FirstStart", "Start")
    told = found(pump(tmp_path, extension(within[0], *within[1:]), HOSTED, granularity="ostask"), codes.TIMING_LOST)
    assert [d.message for d in told] == [
        'is not imported: both events are of the task "Main"',
        'is not imported: all its events are of the task "Main"',
    ]


@pytest.mark.parametrize(("steps", "told"), [("Pump/First Pump/Second", 0), ("Pump/Second Pump/First", 1)])
def test_an_order_within_an_os_task_is_that_of_its_positions(tmp_path, steps, told):
    imported = pump(tmp_path, timing(order("Eo", steps)), HOSTED, granularity="ostask")
    messages = [d.message for d in found(imported, codes.ORDER_LOST)]
    assert messages == ['orders "Pump/Second" before "Pump/First", which "Main" runs the other way round'] * told
    assert found(imported, UNUSED_KIND) == []


def test_the_jitter_of_an_os_task_is_the_least_of_its_runnables(tmp_path):
    wanted = [
        triggering("PERIODIC", name, event, cse("JITTER", jitter), cse("PERIOD", 10_000))
        for name, event, jitter in (("P", "Begin", 5_000), ("Q", "Start", 1_000))
    ]
    imported = pump(tmp_path, extension([BEGIN, START], *wanted), HOSTED, granularity="ostask")
    assert imported.model.task("Main").slack == Fraction(1, 10)
    (second,) = found(imported, codes.TIMING_PART_LOST)
    assert 'JITTER of a call within the jobs of "Main"' in second.message
