"""Jobs with gaps as the readers and writers of schedules show them (MODEL 8.4), on the example of MODEL 8."""

import json
import re
from dataclasses import replace
from itertools import pairwise

import pytest
from exporter_samples import split

from halpipe.core.diagnostics import HalpipeError, Severity
from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.btf import FORMAT as BTF
from halpipe.exporters.btf import BtfOptions
from halpipe.exporters.common.selection import select
from halpipe.exporters.common.timeline import PhaseTimes, Window, resource_steps, unroll
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.report import ReportOptions
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.importers.traces.read import parse_traces
from halpipe.models import Status
from halpipe.pipeline.compare import CompareOptions, codes, compare
from halpipe.pipeline.diff import diff_schedules
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from support import ms


def the_job(planned, task):
    return next(job for job in planned.modes[0].jobs if job.task == task)


def with_parts(planned, task, **times):
    """Return the schedule with other times, in milliseconds, in the second part of a job."""
    job = the_job(planned, task)
    second = replace(job.parts[1], **{name: ms(value) for name, value in times.items()})
    changed = replace(job, parts=(job.parts[0], second, *job.parts[2:]))
    table = planned.modes[0]
    jobs = tuple(changed if other is job else other for other in table.jobs)
    return replace(planned, modes=(replace(table, jobs=jobs),))


def compared(planned, text, name):
    (trace,) = parse_traces(text.encode(), name).traces
    return [d for d in compare(planned, trace, CompareOptions(origin=ZERO)).diagnostics if d.severity is Severity.ERROR]


# ---------------------------------------------------------------------------------------------- the line of time


def test_phases_are_in_force_after_the_resumption_and_as_long_as_interrupts_may_take():
    system, planned = split()
    ((access, begin, end),) = PhaseTimes(system).of(the_job(planned, "slow"))
    assert (access.resource, begin, end) == ("memory", ms("20.1ms"), ms("21.6ms"))  # from 2.5 ms: 22.6 to 24.1
    steps = resource_steps(system, unroll(planned.modes[0]), Window(ZERO, ms(40)))["memory"]
    assert steps == [(ms(0), 0), (ms(1), 1), (ms(3), 0), (ms("22.6ms"), 1), (ms("24.1ms"), 0)]


def test_a_job_that_lasts_several_cycles_occurs_in_each():
    _, planned = split()
    moved = with_parts(planned, "detect", start=124, end=134).modes[0]
    job = replace(the_job(replace(planned, modes=(moved,)), "detect"), end=ms(134))
    starts = [p.start for p in unroll(replace(moved, jobs=(job,)))]
    assert starts == [ms("29.6ms") - ms(120), ms("29.6ms") - ms(80), ms("29.6ms") - ms(40), ms("29.6ms")]


def test_parts_that_do_not_follow_each_other_cannot_be_drawn():
    system, planned = split()
    with pytest.raises(HalpipeError) as refused:
        select(system, with_parts(planned, "slow", start=6), "", "report")
    assert [d.code for d in refused.value.diagnostics] == ["HAL0804"]


# ------------------------------------------------------------------------------------------------------- report


def test_the_report_draws_parts_and_counts_gaps():
    system, planned = split()
    reported = mode_report(system, expand(system, system.modes[0]), planned.modes[0].jobs, Status.VALID)
    planned = replace(planned, modes=(reported,))
    page = REPORT.write(system, planned, ReportOptions())[""].decode()
    drawn = json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])
    parts = {drawn["tasks"][row[0]]["name"]: row[8] for row in drawn["modes"][0]["jobs"] if row[8]}
    gaps = {name: [(a[1], b[0]) for a, b in pairwise(own)] for name, own in parts.items()}
    assert gaps == {"slow": [(7, 12.5), (18.6, 22.5)], "logger": [(8, 9)], "detect": [(39.6, 44)]}
    assert "run (1, 2 gaps)" in page
    assert "<td>29.6ms, 2 gaps</td>" in page  # of the list that is read without scripts
    assert "split at 4ms 9ms, 100us to resume" in page
    assert "can_rx 500us in 5ms" in page
    assert "8ms, polls arrivals 12ms apart" in page


# ---------------------------------------------------------------------------------------------------- BTF, trace


def test_btf_preempts_and_resumes_between_parts():
    system, planned = split()
    text = BTF.write(system, planned, BtfOptions(cycles=2))[""].decode()
    slow = [line.split(",") for line in text.splitlines() if ",T,TASK_slow,0," in line]
    assert [(int(row[0]), row[6]) for row in slow] == [
        (2_500_000, "activate"),
        (2_500_000, "start"),
        (7_000_000, "preempt"),
        (12_500_000, "resume"),
        (18_600_000, "preempt"),
        (22_500_000, "resume"),
        (29_600_000, "terminate"),
    ]
    assert compared(planned, text, "t.btf") == []


def test_the_trace_has_a_slice_for_each_part():
    system, planned = split()
    text = TRACE.write(system, planned, TRACE.options())[""].decode()
    slices = [e for e in json.loads(text)["traceEvents"] if e["ph"] == "X" and e["name"] == "slow"]
    assert [(e["ts"], e["dur"], e["args"]["part"]) for e in slices[:3]] == [
        (2500, 4500, 0),
        (12500, 6100, 1),
        (22500, 7100, 2),
    ]
    assert compared(planned, text, "t.json") == []


def test_a_slice_whose_job_is_no_name_is_read_without_a_traceback():
    event = {"ph": "X", "name": "slow", "ts": 2500, "dur": 4500, "pid": 1, "tid": 1, "args": {"job": [], "part": {}}}
    (trace,) = parse_traces(json.dumps([event]).encode(), "t.json").traces
    assert [e.job for e in trace.executions] == [None]


# --------------------------------------------------------------------------------------------------- compare, diff


def test_a_job_that_goes_on_in_its_gap_is_found():
    """The hold of MODEL 8.2: one piece ends early, and the next begins at once instead of at its instant."""
    system, planned = split()
    text = BTF.write(system, with_parts(planned, "slow", start=11), BtfOptions())[""].decode()
    found = compared(planned, text, "t.btf")
    assert codes.OUTSIDE_PARTS.id in [d.code for d in found]
    (outside,) = [d for d in found if d.code == codes.OUTSIDE_PARTS.id]
    assert "1.5ms outside its parts" in outside.message  # HAL1113


def test_a_job_that_is_done_early_may_stay_away_from_its_last_part():
    system, planned = split()
    short = with_parts(planned, "logger", start=8, end=8)
    job = the_job(short, "logger")
    done = replace(job, parts=(), end=ms(8))
    table = replace(short.modes[0], jobs=tuple(done if j is job else j for j in short.modes[0].jobs))
    text = BTF.write(system, replace(short, modes=(table,)), BtfOptions())[""].decode()
    assert compared(planned, text, "t.btf") == []


def test_a_preemption_that_is_not_scheduled_is_a_wrong_order():
    system, planned = split()
    text = BTF.write(system, planned, BtfOptions())[""].decode()
    whole = replace(the_job(planned, "logger"), parts=())
    table = replace(planned.modes[0], jobs=tuple(whole if j.task == "logger" else j for j in planned.modes[0].jobs))
    assert codes.WRONG_ORDER.id in [d.code for d in compared(replace(planned, modes=(table,)), text, "t.btf")]


def test_diff_tells_other_parts_from_a_move():
    _, planned = split()
    found = diff_schedules(planned, with_parts(planned, "logger", executed_from=6))
    assert [(change.job.task, change.kinds) for change in found.jobs] == [("logger", ("parts",))]
    moved = replace(planned, modes=(replace(planned.modes[0], jobs=tuple(map(_later, planned.modes[0].jobs))),))
    assert {kind for change in diff_schedules(planned, moved).jobs for kind in change.kinds} == {"moved"}


def _later(job):
    by = Duration(1)
    parts = tuple(replace(part, start=part.start + by, end=part.end + by) for part in job.parts)
    return replace(job, start=job.start + by, end=job.end + by, parts=parts)
