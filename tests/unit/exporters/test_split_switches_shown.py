"""Switches with jobs that have gaps, as traces, pictures and other tools show them (MODEL 8.4)."""

import json
from dataclasses import replace

import pytest

import split_switches
from halpipe.core.diagnostics import Severity
from halpipe.core.durations import ZERO
from halpipe.exporters.btf import FORMAT as BTF
from halpipe.exporters.btf import BtfOptions
from halpipe.exporters.common.timeline import cycles_after, shows_context, unroll_switch
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.report import ReportOptions
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.importers.traces.read import parse_traces
from halpipe.models import ModeSchedule, Schedule, Split, Status
from halpipe.pipeline.compare import CompareOptions, codes, compare
from halpipe.pipeline.parts import job_of
from halpipe.pipeline.verify import verify
from support import job, mode, model, ms, task, version


@pytest.fixture
def switched():
    system = split_switches.system()
    plan = split_switches.plan(system)
    assert [d for d in verify(system, plan) if d.severity is Severity.ERROR] == []
    return system, plan


def long_gaps(length=0):
    """A job of "one" goes on 30 ms after its end; a cycle of "two" takes 4 ms."""
    long = task("long", 40, replace(version("v", 4), split=Split(anywhere=True, max_gaps=1)))
    short = task("short", 4, version("v", 1))
    modes = [mode("one", [long]), mode("two", [short])]
    system = model(long, short, modes=modes, transitions=[("one", "two", 20)])
    spans = [(ms(36), ZERO, ms(2)), (ms(70), ms(2), ms(4))]
    started = job_of("long", 0, long.versions[0], ("u1",), spans, ())
    tables = (("one", 40, started), ("two", 4, job(system, "short", 0, 1, "u1")))
    found = tuple(
        ModeSchedule(name=name, hyperperiod=ms(span), status=Status.VALID, jobs=(one,)) for name, span, one in tables
    )
    between = replace(split_switches.switch("one", "two", length), worst_latency=ms(40 + length))
    return system, Schedule(model="m", model_sha256="", modes=found, transitions=(between,))


def line_of(system, plan, context=True):
    table = plan.transitions[0]
    return unroll_switch(table, plan.mode(table.source), plan.mode(table.target), context=context)


def compared(plan, text, name):
    found = []
    for trace in parse_traces(text, name).traces:
        found += compare(plan, trace, CompareOptions(origin=ZERO)).diagnostics
    return [d for d in found if d.severity is Severity.ERROR]


# ---------------------------------------------------------------------------------------------- the line of time


def test_jobs_in_progress_are_drawn_to_their_ends():
    system, plan = long_gaps()
    assert [d for d in verify(system, plan) if d.severity is Severity.ERROR] == []
    window, found = line_of(system, plan)
    assert (window.start, window.end) == (-ms(40), ms(32))  # its last part is from 30 to 32 ms
    (late,) = [p for p in found if p.job.task == "long" and p.cycle == -1]
    assert late.stretches() == [(-ms(4), -ms(2)), (ms(30), ms(32))]
    shorts = [p for p in found if p.job.task == "short"]
    assert [(p.cycle, p.start) for p in shorts] == [(n, ms(4 * n + 1)) for n in range(8)]
    window, found = line_of(system, plan, context=False)
    assert (window.start, window.end) == (ZERO, ms(32))
    assert [p.job.task for p in found] == ["long"]


def test_a_table_that_outlasts_them_is_followed_by_one_cycle():
    _, plan = long_gaps(length=32)
    (table,) = plan.transitions
    assert cycles_after(table, *plan.modes) == 1
    assert cycles_after(replace(table, length=ms("28ms")), *plan.modes) == 1
    assert cycles_after(replace(table, length=ms("27.9ms")), *plan.modes) == 2


def test_jobs_of_the_table_are_drawn_to_their_ends():
    _, plan = long_gaps()
    shift = ms(20)
    own = plan.modes[0].jobs[0]
    parts = tuple(replace(p, start=p.start - shift, end=p.end - shift) for p in own.parts)
    (table,) = plan.transitions
    longer = replace(
        table, length=ms(20), jobs=(replace(own, start=own.start - shift, end=own.end - shift, parts=parts),)
    )
    assert cycles_after(longer, *plan.modes) == 8  # 50 to 52 ms, that is until 32 ms after the table


def test_all_cycles_count_for_what_is_too_much_to_draw(monkeypatch):
    _, plan = long_gaps()
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 9)  # one of "one", eight of "two"
    assert shows_context(plan)
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 8)
    assert not shows_context(plan)


# -------------------------------------------------------------------------------------------------------- traces


@pytest.mark.parametrize(
    ("format", "name", "options"), [(BTF, "t.btf", BtfOptions()), (TRACE, "t.json", TRACE.options())]
)
def test_what_a_trace_tells_of_switches_is_what_is_planned(switched, format, name, options):
    for system, plan in (switched, long_gaps()):
        text = format.write(system, plan, options)[""]
        assert compared(plan, text, name) == []


@pytest.mark.parametrize(
    ("format", "name", "options"), [(BTF, "t.btf", BtfOptions()), (TRACE, "t.json", TRACE.options())]
)
def test_a_job_of_a_table_that_goes_on_early_is_found(switched, format, name, options):
    system, plan = switched
    there, back = plan.transitions
    own = back.jobs[0]
    early = replace(own.parts[2], start=ms(9), end=ms("10.1ms"))
    moved = replace(back, jobs=(replace(own, parts=(*own.parts[:2], early), end=early.end), *back.jobs[1:]))
    text = format.write(system, replace(plan, transitions=(there, moved)), options)[""]
    assert codes.OUTSIDE_PARTS.id in {d.code for d in compared(plan, text, name)}


def test_btf_resumes_a_job_in_progress_in_the_table_and_in_the_mode_after(switched):
    lines = BTF.write(*switched, BtfOptions())[""].decode().splitlines()
    events = [line.split(",") for line in lines if line[0].isdigit()]
    marks = {row[1]: int(row[0]) for row in reversed(events) if row[1].startswith("STI_TABLE_")}
    assert (marks["STI_TABLE_one->two"], marks["STI_TABLE_two"]) == (40_000_000, 45_000_000)
    kept = [(int(row[0]), row[6]) for row in events if row[4] == "TASK_kept" and row[5] == "1"]
    assert kept == [
        (37_000_000, "activate"),
        (37_000_000, "start"),
        (38_000_000, "preempt"),
        (42_000_000, "resume"),
        (44_100_000, "preempt"),
        (52_000_000, "resume"),
        (53_100_000, "terminate"),
    ]


def test_the_trace_has_every_part_around_a_switch():
    text = TRACE.write(*long_gaps(), TRACE.options())[""].decode()
    events = json.loads(text)["traceEvents"]
    (process,) = [e["pid"] for e in events if e["name"] == "process_name" and e["args"]["name"] == "switch one to two"]
    slices = [e for e in events if e["ph"] == "X" and e["pid"] == process and e["name"] == "long"]
    assert [(e["ts"], e["dur"], e["args"]["part"]) for e in slices if e["args"]["played"] == 1] == [
        (36_000, 2000, 0),
        (70_000, 2000, 1),
    ]


# -------------------------------------------------------------------------------------------------------- report


def test_the_report_draws_the_cycles_that_a_job_in_progress_lasts():
    page = REPORT.write(*long_gaps(), ReportOptions())[""].decode()
    assert "first 8 cycles of two" in page
    assert "first cycle of two" in REPORT.write(*long_gaps(length=32), ReportOptions())[""].decode()
