"""Whatever the schedule, every exporter gives a well-formed document or coded diagnostics, never a traceback."""

import json
from fractions import Fraction
from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.graph import FORMAT as GRAPH
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.models import Job, ModeSchedule, Schedule, Status, TransitionTable
from support import access, after, model, task, version

SYSTEM = model(
    task("a", 20, version("v", "3ms", "u1 u2", access("r", 0, 2, "1/3"), access("lost", 0, 2))),
    task("b", None, version("v", None, "u1", after("a", 3, 30, "end"), after("lost", 0, 1), access("r", 1, 9))),
    task("<&>", 20, version("v", "1ms", "u2", access("r", 0, 1, "4/5"))),
    units="u1 u2",
    resources="r",
)


def times(least, most):
    """Exact times in [least, most) milliseconds, with odd denominators."""
    return st.fractions(least, most - Fraction(1, 7), max_denominator=7).map(lambda value: Duration(value * 10**6))


@st.composite
def jobs(draw, wild):
    start = draw(times(0, 20))
    return Job(
        task=draw(st.sampled_from(["a", "b", "<&>", "ghost"] if wild else ["a", "b", "<&>"])),
        index=draw(st.integers(0, 3)),
        start=start,
        end=start + draw(times(0, 40 if wild else 20)),
        version=draw(st.sampled_from(["v", "w"] if wild else ["v"])),
        units=draw(st.sampled_from([("u1",), ("u1", "u2"), ("u2",), *([()] if wild else [])])),
    )


@st.composite
def schedules(draw, wild):
    """A schedule that may break every rule of the model; a wild one does not even fit it."""
    tables = st.lists(jobs(wild), max_size=4).map(tuple)
    hyperperiod = draw(times(0, 40)) if wild else Duration(20 * 10**6)
    mode = ModeSchedule(name="all", hyperperiod=hyperperiod, status=Status.NOT_FOUND, jobs=draw(tables))
    switch = TransitionTable(
        source="all",
        target=draw(st.sampled_from(["all", "ghost"] if wild else ["all"])),
        length=draw(times(0, 40)),
        worst_latency=draw(times(0, 40)),
        status=Status.VALID,
        jobs=draw(tables),
    )
    return Schedule(model="m", model_sha256="", modes=(mode,), transitions=draw(st.sampled_from([(), (switch,)])))


def write(exporter, planned, **options):
    return exporter.write(SYSTEM, planned, exporter.options(**options))[""].decode()


@given(schedules(wild=False), st.booleans())
def test_any_schedule_that_fits_the_model_is_drawn(planned, cluster):
    reader = HTMLParser()
    reader.feed(write(REPORT, planned))
    assert reader.rawdata == ""
    events = json.loads(write(TRACE, planned))["traceEvents"]
    assert all(event.get("dur", 0) >= 0 for event in events)
    assert write(GRAPH, planned, cluster=cluster).startswith("digraph")


def verdict(exporter, planned):
    try:
        write(exporter, planned)
    except HalpipeError as refusal:
        return refusal.diagnostics
    return ()


@given(schedules(wild=True))
def test_any_other_schedule_is_refused_by_all_alike_with_reasons(planned):
    reasons = verdict(REPORT, planned)
    assert verdict(TRACE, planned) == verdict(GRAPH, planned) == reasons
    assert all(found.code in ("HAL0803", "HAL0804") and found.path and found.help for found in reasons)
