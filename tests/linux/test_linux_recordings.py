"""Recordings of Linux bundles: a faithful one is sound, and each fault of one is found."""

from dataclasses import replace

import pytest
from test_linux_bundle import two_modes

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.deploy.linux import codes
from halpipe.deploy.linux.judging import judge, read_recording
from halpipe.models.trace import Execution


def recorded(one, table, cycle, start, end):
    labels = {"task": one.task, "job": one.index, "table": table, "cycle": cycle}
    times = {"start": Duration(start), "end": Duration(end), "planned": Duration(start - 10)}
    return Execution(**labels, **times, units=one.units, has_data=True)


def ran(execution, start=None, end=None):
    times = {"start": start, "end": end}
    return replace(execution, **{name: Duration(time) for name, time in times.items() if time is not None})


def faithful(cycles=3):
    owner, tables = two_modes()
    names = ["both"] * cycles + ["both->one", "one", "one->both", "both"]
    lengths = {"both": 10, "one": 10, "both->one": 0, "one->both": 5}
    jobs = {m.name: m.jobs for m in tables.modes} | {f"{t.source}->{t.target}": t.jobs for t in tables.transitions}
    at, seen = 0, []
    for cycle, name in enumerate(names):
        for one in jobs[name]:
            start = at + int(one.start.fraction)
            seen.append(recorded(one, name, cycle, start + 10, start + 500_000))
        at += lengths[name] * 1_000_000
    return owner, tables, seen


def found(owner, tables, seen, is_timed=True):
    return sorted(d.code for d in judge(owner, tables, seen, is_timed=is_timed).diagnostics)


def test_a_faithful_recording_is_sound():
    owner, tables, seen = faithful()
    judgement = judge(owner, tables, seen, is_timed=True)
    assert (judgement.diagnostics, judgement.tables, judgement.switches) == ((), 7, 2)
    assert judgement.start_errors == (Duration(10),) * 3


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (lambda seen: seen[:2] + seen[3:], codes.MISSING_JOB),
        (lambda seen: [*seen, seen[2]], codes.FOREIGN_JOB),
        (lambda seen: [*seen, replace(seen[2], job=7)], codes.FOREIGN_JOB),
        (lambda seen: [ran(seen[0], 4_700_000, 4_800_000), *seen[1:]], codes.WRONG_ORDER),
        (lambda seen: [ran(seen[0], end=4_300_000), *seen[1:]], codes.OVERLAP),
        (lambda seen: [ran(seen[0], end=2_000_001), *seen[1:]], codes.LATE_JOB),
        (lambda seen: [replace(seen[0], planned=Duration(1)), *seen[1:]], codes.FOREIGN_JOB),
        (lambda seen: [*seen[:2], ran(seen[2], int(seen[2].start.ns) - 11), *seen[3:]], codes.EARLY_JOB),
        (lambda seen: [r for r in seen if r.cycle != 1], codes.MISSING_JOB),
        (lambda seen: [r for r in seen if r.cycle > 0], codes.MISSING_JOB),
        (lambda seen: [replace(seen[0], has_data=False), *seen[1:]], codes.NO_DATA),
        (lambda seen: [*seen[:-1], replace(seen[-1], end=None)], codes.ENDLESS_JOB),
        (
            lambda seen: [replace(r, table="both") if r.table == "one->both" else r for r in seen],
            codes.FOREIGN_JOB,
        ),
    ],
)
def test_every_fault_of_a_recording_is_found(fault, code):
    owner, tables, seen = faithful()
    assert code.id in found(owner, tables, fault(seen))


def test_without_rights_only_order_and_completeness_count():
    owner, tables, seen = faithful()
    late = [ran(seen[0], end=2_000_001), *seen[1:]]
    assert found(owner, tables, late, is_timed=False) == []


ROW = b"task,job,mode,cycle,start,end,units,busy,planned,data\na,0,m,%d,0,1,u,1,0,1\n"
DAMAGED = [b"", b"a,b\n", ROW.splitlines()[0], b"\xff", b"a" * 200_000, ROW % 10**20, ROW % -1]


@pytest.mark.parametrize("data", DAMAGED)
def test_recordings_that_cannot_be_read(data):
    with pytest.raises(HalpipeError) as caught:
        read_recording(data)
    assert caught.value.diagnostics[0].code == codes.NOT_RUN.id
