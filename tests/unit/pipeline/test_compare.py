"""Comparison of a trace with its schedule: a faithful trace is clean, and every kind of deviation is found."""

import tracemalloc
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from random import Random

import pytest
from compare_cases import PIECES, PLAN, RACE, SLOW, compared, job, moved, play, switch, table
from hypothesis import given
from hypothesis import strategies as st
from split_helpers import parted

from halpipe.core.diagnostics import HalpipeError, Location, Severity
from halpipe.core.durations import ZERO, Duration
from halpipe.core.options import options_of
from halpipe.models import Schedule
from halpipe.models.modes import UNKNOWN_MODE
from halpipe.models.trace import Execution, Executions, Trace, column
from halpipe.pipeline.compare import CompareOptions, codes, compare, is_stated
from halpipe.pipeline.compare.codes import Kind
from halpipe.pipeline.compare.judging import Judge, Scope, _after_larger
from halpipe.pipeline.compare.tables import MOST_SILENT, Due, Starts
from support import access, model, ms, task, version


def deviations(seen, **options):
    return [d for d in compared(seen, **options).diagnostics if d.severity is Severity.ERROR]


def found(seen, **options):
    return {d.code for d in deviations(seen, **options)}


def test_a_faithful_trace_has_no_deviation():
    answer = compared(play(), origin=ZERO)
    assert answer.diagnostics == ()
    rows = {row.task: row for row in answer.rows}
    assert {task: row.seen for task, row in rows.items()} == {"a": 4, "b": 5, "c": 2}
    assert all(row.missing == row.extra == 0 for row in rows.values())
    assert all(row.least == row.worst == row.worst_end == ZERO for row in rows.values())
    assert (rows["a"].longest, rows["a"].reserved) == (ms(3), ms(3))


@given(st.integers(-(10**9), 10**9), st.booleans())
def test_the_zero_of_the_schedule_is_found(shift, stated):
    pieces = PIECES if stated else [("race", RACE)] * 3
    answer = compared(play(pieces, Duration(shift), stated=stated), mode="race")
    assert answer.origin == Duration(shift)
    assert [d.code for d in answer.diagnostics] == [codes.ALIGNED.id]


def test_the_zero_is_found_by_a_rare_task_that_runs_after_those_of_the_sample(monkeypatch):
    """Task "a" alone says that the table is longer than a millisecond; it first runs as the last of all."""
    monkeypatch.setattr("halpipe.pipeline.compare.matching.SAMPLE", 3)
    often = (job("b", n, f"{n}.5ms", f"{n}.75ms") for n in range(6))
    long = table("long", 6, *often, job("a", 0, "5ms", "5.25ms"))
    seen = [replace(execution, job=None) for execution in play([("long", long)])]
    plan = Schedule(model="m", model_sha256="", modes=(long,))
    answer = compare(plan, Trace(name="", executions=tuple(sorted(seen, key=lambda e: e.start.ns))), CompareOptions())
    assert answer.origin == ZERO
    assert [d.code for d in answer.diagnostics] == [codes.ALIGNED.id]


@pytest.mark.parametrize("numbered", [True, False])
def test_the_zero_is_found_though_the_first_job_starts_late_in_its_table(numbered):
    late = table("late", 6, job("a", 0, "1.75ms", 2), job("b", 0, "2.75ms", 3), job("a", 1, "3.75ms", 4))
    late = replace(late, jobs=(*late.jobs, job("b", 1, "5.75ms", 6)))
    seen = play([("late", late)] * 2)
    seen = seen if numbered else [replace(execution, job=None) for execution in seen]
    plan = Schedule(model="m", model_sha256="", modes=(late,))
    answer = compare(plan, Trace(name="", executions=tuple(sorted(seen, key=lambda e: e.start.ns))), CompareOptions())
    assert answer.origin == ZERO
    assert [d.code for d in answer.diagnostics] == [codes.ALIGNED.id]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("has_units", [True, False])
@pytest.mark.parametrize("latest_first", [True, False])
def test_jobs_of_a_task_that_start_at_once_are_matched_one_to_one(stated, has_units, latest_first):
    twice = table("all", 20, job("a", 0, 1, 3), job("a", 1, 1, 3, "c2"), job("b", 0, 8, 9))
    seen = [replace(execution, job=None) for execution in play([("all", twice)] * 2, stated=stated)]
    seen = sorted(seen, key=lambda e: (e.start.ns, e.units[::-1]), reverse=latest_first)
    seen = seen if has_units else [replace(execution, units=()) for execution in seen]
    plan = Schedule(model="m", model_sha256="", modes=(twice,))
    answer = compare(plan, Trace(name="", executions=tuple(seen)), CompareOptions(origin=ZERO))
    assert answer.diagnostics == ()
    assert [(row.seen, row.missing, row.extra) for row in answer.rows] == [(4, 0, 0), (2, 0, 0)]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("ran", [0, 1])
def test_of_jobs_that_start_at_once_the_one_on_the_other_unit_is_missing(stated, ran):
    """Units tell which of the two it was, though the trace has no numbers of jobs."""
    twice = table("all", 20, job("a", 0, 1, 3), job("a", 1, 1, 3, "c2"), job("b", 0, 8, 9))
    seen = [
        replace(e, job=None)
        for e in play([("all", twice)], stated=stated)
        if (e.task, e.units[0]) != ("a", f"c{2 - ran}")
    ]
    plan = Schedule(model="m", model_sha256="", modes=(twice,))
    answer = compare(plan, Trace(name="", executions=tuple(seen)), CompareOptions(origin=ZERO))
    assert [(d.code, d.path) for d in answer.diagnostics] == [
        (codes.MISSING_JOB.id, f'table "all", job {1 - ran} of task "a"')
    ]


@given(st.integers(0, 10**6), st.lists(st.integers(0, 400_000), min_size=12, max_size=12))
def test_with_jitter_no_job_is_early_and_one_is_on_time(shift, jitter):
    seen = play([("race", RACE)] * 3, Duration(shift), stated=False)
    late = [replace(e, start=e.start + Duration(j), end=e.end + Duration(j)) for e, j in zip(seen, jitter, strict=True)]
    answer = compared(late, mode="race", tolerance=ms(1))
    assert answer.origin == Duration(shift + min(jitter))
    assert min(row.least for row in answer.rows) == ZERO
    assert max(row.worst for row in answer.rows) == Duration(max(jitter) - min(jitter))
    assert [d for d in answer.diagnostics if d.is_error] == []


@pytest.mark.parametrize("stated", [True, False])
def test_a_stray_start_does_not_move_the_zero_of_the_schedule(stated):
    seen = play([("race", RACE)] * 8, ms(7), stated=stated)
    stray = moved(seen, 9, start=-500_000, end=-500_000)
    answer = compared(stray, **({} if stated else {"mode": "race"}))
    assert answer.origin == ms(7)
    assert answer.counts == {Kind.EARLY: 1}
    assert "1 start before the planned instant" in answer.diagnostics[0].message


@pytest.mark.parametrize(("cycles", "is_left_out"), [(25, False), (75, True)])
def test_two_strays_of_two_hundred_starts_do_not_move_the_zero_and_of_fewer_they_do(cycles, is_left_out):
    """At most one in a hundred is left out, and one at least."""
    seen = play([("race", RACE)] * cycles, ms(7))
    for position, early in ((9, 500_000), (17, 499_000)):
        seen = moved(seen, position, start=-early, end=-early)
    assert compared(seen).origin == (ms(7) if is_left_out else ms("6.5ms"))


def test_a_task_alone_on_time_is_no_stray():
    seen = [replace(each, start=each.start + ms(1), end=each.end + ms(1)) for each in play([("race", RACE)] * 8)]
    on_time = [replace(each, start=each.start - ms(1)) if each.task == "c" else each for each in seen]
    assert compared(on_time).origin == ZERO


@given(st.integers(1, 900_000), st.integers(0, 900_000))
def test_a_late_job_is_late_by_what_the_tolerance_does_not_forgive(late, tolerance):
    seen = moved(play(), 2, start=late, end=late)
    expected = {codes.WRONG_START.id, codes.LATE_END.id} if late > tolerance else set()
    assert found(seen, origin=ZERO, tolerance=Duration(tolerance)) == expected


@pytest.mark.parametrize(("late", "is_rounded"), [(Fraction(1, 3), True), (1, False)])
def test_less_than_a_nanosecond_is_explained_by_the_unit_of_the_trace(late, is_rounded):
    """A trace in whole nanoseconds has no fractions of them, unlike the schedule that it plays."""
    seen = moved(play(), 2, start=late, end=late)
    deviating = deviations(seen, origin=ZERO)
    assert {each.code for each in deviating} == {codes.WRONG_START.id, codes.LATE_END.id}
    assert {"--tolerance 1ns" in each.help for each in deviating} == {is_rounded}
    assert not found(seen, origin=ZERO, tolerance=Duration(1))


def test_an_early_job_is_a_deviation_though_it_ends_in_time():
    assert found(moved(play(), 2, start=-1, end=-1), origin=ZERO) == {codes.WRONG_START.id}


def test_an_overrun_is_told_with_its_amount():
    late, overrun = sorted(deviations(moved(play(), 2, end=500_000), origin=ZERO), key=lambda found: found.code)
    assert (late.code, overrun.code) == (codes.LATE_END.id, codes.OVERRUN.id)
    assert "runs for 2.5ms, 500us more than the 2ms of its version v (cycle 0)" in overrun.message
    assert overrun.path == 'table "race", job 0 of task "b"'


def test_preemption_is_no_overrun():
    assert found(moved(play(), 2, end=1_000_000, busy=ms(2)), origin=ZERO) == {codes.LATE_END.id}


@pytest.mark.parametrize(
    ("start", "end", "outside"), [(0, 3, None), (5, 8, None), (3, 6, "2ms"), (1, 4, "1ms"), (8, 11, "2ms")]
)
def test_a_job_with_gaps_that_runs_in_one_piece_fits_one_of_its_parts(start, end, outside):
    """Its parts are 0 to 3 ms and 5 to 9 ms; of the part that it fits best, the amount outside counts."""
    plan = replace(PLAN, modes=(table("t", 20, parted("a", 0, "c1", (0, 3, 0, 3), (5, 9, 3, 7))),), transitions=())
    seen = Execution(task="a", units=("c1",), start=ms(start), end=ms(end), busy=ms(end - start), table="t", cycle=0)
    found = compare(plan, Trace(name="", executions=(seen,)), CompareOptions(origin=ZERO, tolerance=ms(0)))
    told = [each.message for each in found.diagnostics if each.code == codes.OUTSIDE_PARTS.id]
    assert len(told) == (outside is not None)
    near = start if start == 3 else end  # before the second part, or after one of them
    assert all(f"runs {outside} outside its parts, near {ms(near)}" in message for message in told)


@pytest.mark.parametrize("origin", [0, 7])
@pytest.mark.parametrize(("start", "near"), [(6, 10), (4, 4)])
def test_stretches_are_judged_from_the_zero_of_the_schedule(origin, start, near):
    plan = replace(PLAN, modes=(table("t", 20, parted("a", 0, "c1", (0, 3, 0, 3), (5, 9, 3, 7))),), transitions=())
    spans = ((ms(origin), ms(origin + 3)), (ms(origin + start), ms(origin + start + 4)))
    begin, end = spans[0][0], spans[1][1]
    seen = Execution(task="a", units=("c1",), start=begin, end=end, busy=ms(7), table="t", cycle=0, stretches=spans)
    found = compare(plan, Trace(name="", executions=(seen,)), CompareOptions(origin=ms(origin)))
    [message] = [each.message for each in found.diagnostics if each.code == codes.OUTSIDE_PARTS.id]
    assert message.startswith(f"runs 1ms outside its parts, near {ms(near)}")


def test_starts_of_a_task_are_the_nearest_ones_in_any_cycle():
    """Three jobs of a task, unevenly apart: each is matched with its own, also round the end of the cycle."""
    three = table("t", 20, job("a", 0, 0, 1), job("a", 1, 3, 4), job("a", 2, 12, 13))
    seen = [replace(execution, units=()) for execution in play([("t", three)] * 3, stated=False)]
    plan = Schedule(model="m", model_sha256="", modes=(three,))
    answer = compare(plan, Trace(name="", executions=tuple(seen)), CompareOptions(origin=ZERO))
    assert answer.diagnostics == ()


def test_a_job_that_ends_early_is_welcome():
    assert found(moved(play(), 2, end=-1_000_000), origin=ZERO) == set()


def test_a_job_whose_end_is_unknown_is_judged_by_its_start():
    seen = play()
    seen[-1] = replace(seen[-1], end=None)
    assert found(seen, origin=ZERO) == set()


@pytest.mark.parametrize("data", [True, False, None])
def test_a_job_without_a_message_is_a_deviation_though_it_ran_in_time(data):
    told = deviations(moved(play(), 1, has_data=data))
    assert [d.code for d in told] == ([codes.NO_DATA.id] if data is False else [])


def test_a_job_that_never_ends_is_late_once_its_end_is_over():
    seen = play()
    ended = Execution(task="a", units=("c1",), start=seen[0].start, end=None, table="race", cycle=0, job=0)
    assert codes.LATE_END.id in {d.code for d in deviations([ended, *seen[1:]])}
    last = max(seen, key=lambda execution: execution.end.ns)
    open_end = [replace(e, end=None) if e is last else e for e in seen]
    assert deviations(open_end) == []


@pytest.mark.parametrize(("tolerance", "is_late"), [(ms(2), False), (ms("1.999999ms"), True)])
def test_a_job_that_never_ends_is_late_by_what_the_tolerance_does_not_forgive(tolerance, is_late):
    """The last one ends 2 ms after its end was due."""
    seen = play([("race", RACE)])[:2]
    open_end = [replace(seen[0], end=None), replace(seen[1], start=ms(3), end=ms(5), units=("c2",))]
    answer = compared(open_end, origin=ZERO, tolerance=tolerance)
    assert (answer.counts[Kind.ENDLESS] > 0) == is_late


@pytest.mark.parametrize("seed", range(20))
def test_the_nearest_start_of_a_task_is_the_earlier_of_two(seed):
    rng = Random(seed)
    starts = sorted(rng.sample(range(40), rng.randint(1, 6)))
    due = [Due.of(job("a", number, start, start + 1), (number,)) for number, start in enumerate(starts)]
    found = Starts(range(len(due)), due)
    at = [rng.randrange(-5, 50) * 10**6 for _ in range(30)]
    expected = [min(range(len(starts)), key=lambda n, t=t: (abs(starts[n] * 10**6 - t), n)) for t in at]
    assert found.nearest(column(at)).tolist() == expected
    cycle, number = found.nearest_of_cycles(column(at), 40 * 10**6)
    line = [(turn, n) for turn in range(-3, 4) for n in range(len(starts))]
    nearest = [min(line, key=lambda p, t=t: (abs((p[0] * 40 + starts[p[1]]) * 10**6 - t), p)) for t in at]
    assert [*zip(cycle.tolist(), number.tolist(), strict=True)] == nearest


def test_of_a_run_that_was_whole_every_job_is_due():
    """Of a part of a run only the jobs within what was recorded are."""
    part = play([("race", RACE)] * 2)[3:-2]
    trace = Trace(name="", executions=tuple(part))
    lost = {
        is_whole: compare(PLAN, trace, CompareOptions(origin=ZERO), scope=Scope(is_whole=is_whole)).counts[Kind.MISSING]
        for is_whole in (False, True)
    }
    assert lost == {False: 1, True: 5}


def test_deviations_are_counted_by_the_table_in_which_they_are():
    """A late job in the first, one that did not run in the second, and one late for two reasons in the last."""
    seen = play([("race", RACE)] * 3)
    seen = moved(moved(seen, 2, start=1, end=0), 10, start=1, end=1)
    answer = compared([e for n, e in enumerate(seen) if n != 5], origin=ZERO)
    assert answer.counts == {Kind.LATE: 2, Kind.LATE_END: 1, Kind.MISSING: 1}
    assert answer.by_line.tolist() == [1, 1, 2]


def test_what_the_scope_has_no_code_for_is_not_reported():
    seen = play([("race", RACE)] * 3)
    late = [*moved(seen[:1], 0, start=1, end=1), *seen[1:5], *seen[6:], replace(seen[0], start=ms(7), end=ms(8))]
    trace = Trace(name="", executions=tuple(sorted(late, key=lambda e: e.start.ns)))
    for kind in (Kind.MISSING, Kind.EXTRA, Kind.LATE):
        scope = Scope(codes={kind: codes.NO_DATA})
        answer = compare(PLAN, trace, CompareOptions(origin=ZERO), scope=scope)
        assert (answer.counts, [d.code for d in answer.diagnostics]) == ({kind: 1}, [codes.NO_DATA.id])


def test_deviations_of_some_executions_are_marked_with_their_amounts():
    seen = sorted(moved(moved(play(), 2, start=500_000, end=2_000_000), 1, units=("c9",)), key=lambda e: e.start.ns)
    matching = compared(seen, origin=ZERO).matching
    row = next(n for n, e in enumerate(seen) if e.task == "b")
    judge = Judge(ZERO, "", Scope())
    assert {kind: (amount, text) for kind, amount, text in judge.mark(matching, [row])[row]} == {
        Kind.LATE: (500_000, "starts 500us late: at 4.5ms instead of 4ms"),
        Kind.OVERRUN: (1_500_000, "runs for 3.5ms, 1.5ms more than the 2ms of its version v"),
        Kind.LATE_END: (2_000_000, "ends 2ms late: at 8ms instead of 6ms"),
    }
    assert {*judge.mark(matching, range(len(seen)))} == {row, next(n for n, e in enumerate(seen) if e.units == ("c9",))}
    assert judge.mark(matching, []) == {}


def test_another_unit():
    assert found(moved(play(), 2, units=("c9",)), origin=ZERO) == {codes.WRONG_UNIT.id}
    assert found(moved(play(), 2, units=()), origin=ZERO) == set()


def test_names_with_the_prefixes_of_viewers_are_the_names_of_the_schedule():
    seen = [replace(e, task=f"TASK_{e.task}", units=tuple(f"Core_{u}" for u in e.units)) for e in play()]
    assert compared(seen, origin=ZERO).diagnostics == ()


@pytest.mark.parametrize("stated", [True, False])
def test_a_job_that_did_not_run(stated):
    pieces = PIECES if stated else [("race", RACE)] * 3
    seen = play(pieces, stated=stated)
    (missing,) = deviations(seen[:5] + seen[6:], origin=ZERO, mode="race")
    assert (missing.code, missing.path) == (codes.MISSING_JOB.id, 'table "race", job 1 of task "a"')
    assert "cycle 1" in missing.message


def after_a_gap(cycles):
    """The race, nothing for some cycles, and the race again."""
    race = [("race", RACE)]
    return [*play(race, stated=False), *play(race, RACE.hyperperiod * (1 + cycles), stated=False)]


@pytest.mark.parametrize("cycles", [1, 7, 24_999])
def test_jobs_of_silent_cycles_are_missing(cycles):
    answer = compared(after_a_gap(cycles), mode="race")
    assert {row.task: row.missing for row in answer.rows} == {"a": 2 * cycles, "b": cycles, "c": cycles}


@pytest.mark.parametrize("cycles", [25_001, 10**30])
def test_a_pause_of_many_cycles_is_told_as_a_whole(cycles):
    answer = compared(after_a_gap(cycles), mode="race")
    assert {row.task: row.missing for row in answer.rows} == {"a": 0, "b": 0, "c": 0}
    (pause,) = [d for d in answer.diagnostics if d.severity is Severity.ERROR]
    assert pause.code == codes.PAUSE.id
    assert f"nothing ran in the {cycles} cycles after cycle 0" in pause.message


def of_race(*cycles):
    """The race in some cycles, without labels."""
    return [e for n in cycles for e in play([("race", RACE)], RACE.hyperperiod * n, stated=False)]


@pytest.mark.parametrize(("most", "missing"), [(8, 8), (7, 4), (4, 4), (3, 0)])
def test_single_silent_cycles_are_counted_up_to_the_limit_together(most, missing, monkeypatch):
    monkeypatch.setattr("halpipe.pipeline.compare.tables.MOST_SILENT", most)
    answer = compared(of_race(0, 2, 4), mode="race", origin=ZERO)
    assert (answer.counts[Kind.MISSING], answer.counts[Kind.PAUSE]) == (missing, 2 - missing // 4)


@pytest.mark.parametrize(("gaps", "after"), [([3, 10**12, 2, 10**9], 4), ([3, 10**9, 2, 10**12], 10**9 + 8)])
def test_of_several_gaps_the_longest_are_pauses(gaps, after):
    race = [("race", RACE)]
    seen, now = play(race, stated=False), 1
    for gap in gaps:
        seen += play(race, RACE.hyperperiod * (now + gap), stated=False)
        now += gap + 1
    answer = compared(seen, mode="race")
    assert {row.task: row.missing for row in answer.rows} == {"a": 10, "b": 5, "c": 5}
    (pause,) = [d for d in answer.diagnostics if d.code == codes.PAUSE.id]
    assert f"1000000000000 cycles after cycle {after}" in pause.message
    assert "2 times" in pause.message


@pytest.mark.parametrize("stated", [True, False])
def test_a_job_that_ran_twice(stated):
    seen = play([("race", RACE)] * 3, stated=stated)
    again = replace(seen[0], start=ms(7), end=ms(8))
    assert codes.EXTRA_JOB.id in found([*seen, again], origin=ZERO, mode="race")


@pytest.mark.parametrize(("starts", "extra"), [((3, 5), 5), ((3, 6), 6), ((2, 5), 2), ((2, 3), 2)])
def test_of_two_executions_the_closer_one_is_the_job_and_of_two_as_close_the_first(starts, extra):
    seen = [each for each in play([("race", RACE)]) if each.task != "b"]
    label = {"task": "b", "units": ("c1",), "table": "race", "cycle": 0, "job": 0}
    twice = [Execution(start=ms(start), end=ms(start + 1), **label) for start in starts]
    messages = [found.message for found in deviations([*seen, *twice], origin=ZERO) if found.code == codes.EXTRA_JOB.id]
    assert messages == [f"ran at {extra}ms of the trace, where no job of it is due"]


@pytest.mark.parametrize(("end", "missing"), [(15, 1), (7, 1), (6, 0), (None, 0)])
def test_a_job_is_due_if_it_would_end_before_the_last_end_of_the_trace(end, missing):
    mode = table("all", 20, job("a", 0, 0, 15), job("b", 0, 4, 6, "c2"))
    seen = Execution(task="a", units=("c1",), start=ZERO, end=None if end is None else ms(end))
    answer = compare(replace(PLAN, modes=(mode,), transitions=()), Trace(name="", executions=(seen,)), CompareOptions())
    assert answer.counts[Kind.MISSING] == missing


def test_a_job_that_is_due_at_the_first_instant_of_the_trace_is_missing():
    mode = table("all", 20, job("a", 0, 3, 15), job("b", 0, 3, 6, "c2"), job("c", 0, 2, 6, "c3"))
    seen = Execution(task="a", units=("c1",), start=ms(3), end=ms(15))
    plan = replace(PLAN, modes=(mode,), transitions=())
    answer = compare(plan, Trace(name="", executions=(seen,)), CompareOptions(origin=ZERO))
    assert [d.path for d in answer.diagnostics if d.is_error] == ['table "all", job 0 of task "b"']


@pytest.mark.parametrize(("table", "origin"), [("slow", 3), ("", 0)])
def test_where_no_job_is_known_the_zero_is_the_first_instant_or_that_of_the_trace(table, origin):
    """Task a has no job in the slow mode; the first instant is known to be in the table that a trace names."""
    label = {"table": table, "cycle": 0} if table else {}
    seen = [Execution(task="a", units=("c1",), start=ms(at), end=ms(at + 1), **label) for at in (3, 5)]
    answer = compared(seen, mode="slow")
    assert (answer.origin, answer.counts[Kind.EXTRA]) == (ms(origin), 2)


@pytest.mark.parametrize("origin", [ZERO, ms(7), ZERO - ms(3)])
@pytest.mark.parametrize("by", [ZERO, ms(2), ZERO - ms(2)])
def test_the_instant_that_a_recorder_planned_is_that_of_the_schedule(origin, by):
    seen = play(origin=origin)
    trace = Trace(name="", executions=tuple(sorted(moved(seen, 1, planned=seen[1].start + by), key=lambda e: e.start)))
    scope = Scope(codes={Kind.PLAN: codes.WRONG_START})
    answer = compare(PLAN, trace, CompareOptions(origin=origin), scope=scope)
    assert answer.counts == ({Kind.PLAN: 1} if by else {})
    text = f"was due at {seen[1].start + by} by its recorder, and is at {seen[1].start} by the schedule"
    assert [d.message.startswith(text) for d in answer.diagnostics] == [True] * bool(by)


def test_jobs_of_one_unit_in_another_order_and_at_once():
    seen = play()
    swapped = moved(moved(seen, 0, start=4_000_000, end=3_500_000), 2, start=-4_000_000, end=-4_000_000)
    assert codes.WRONG_ORDER.id in found(swapped, origin=ZERO)
    at_once = moved(seen, 0, end=1_500_000)
    assert codes.WRONG_ORDER.id in found(at_once, origin=ZERO)
    for end, is_over in ((500_000, False), (1_000_000, False), (1_000_001, True)):  # the next one starts after 1 ms
        for tolerance in (ZERO, ms(5)):
            assert (codes.WRONG_ORDER.id in found(moved(seen, 0, end=end), origin=ZERO, tolerance=tolerance)) is is_over


def test_a_gang_may_be_recorded_unit_by_unit():
    seen = play()
    parts = [replace(e, units=(unit,)) for e in seen for unit in e.units]
    assert len(parts) > len(seen)
    assert compared(parts, origin=ZERO).diagnostics == ()
    spans = [replace(e, stretches=((e.start, e.end),)) for e in parts]
    assert compared(spans, origin=ZERO).diagnostics == ()
    cut = [replace(e, stretches=((e.start, e.start + ms(1)),)) if e.units == ("c3",) else e for e in spans]
    row = next(n for n, e in enumerate(sorted(cut, key=lambda e: e.start.ns)) if e.task == "c")
    for ran, kept in ((spans, 1), (cut, 0)):  # only what all its units did is what the gang did
        gang = compared(ran, origin=ZERO).matching.match(row).execution
        assert (len(gang.stretches), gang.units) == (kept, ("c2", "c3"))
    late = [replace(e, start=e.start + Duration(1)) if e.units == ("c3",) else e for e in parts]
    assert found(late, origin=ZERO) == {codes.WRONG_START.id}
    alone = [e for e in parts if e.units != ("c3",)]
    assert found(alone, origin=ZERO) == {codes.WRONG_UNIT.id}
    trace = Trace(name="", executions=Executions.of(tuple(sorted(parts, key=lambda e: e.start.ns))))
    answers = [compare(PLAN, trace, CompareOptions(origin=ZERO)) for _ in range(2)]  # which leaves the trace as it was
    assert answers[0].rows == answers[1].rows
    assert [answer.diagnostics for answer in answers] == [(), ()]


def test_a_task_that_is_not_scheduled():
    stranger = Execution(task="aa", units=("c1",), start=ms(8), end=ms(9), table="race", cycle=0)
    (unknown,) = deviations([*play(), stranger], origin=ZERO)
    assert unknown.code == codes.UNKNOWN_TASK.id
    assert 'did you mean "a"' in unknown.help


def test_what_is_not_scheduled_is_reported_where_it_is_first():
    """Of a task at its first execution in the trace, of a table at the first one that names it."""
    stranger = Execution(task="aa", units=("c1",), start=ms(8), end=ms(9), table="race", cycle=0)
    placed = [replace(e, at=Location("t.csv", line)) for line, e in enumerate(play(), 1)]
    twice = [replace(stranger, start=ms(8 + n), end=ms(9 + n), at=Location("t.csv", 90 + n)) for n in (0, 1)]
    (unknown,) = deviations([*placed, *twice], origin=ZERO)
    assert (unknown.at.line, "ran 2 times" in unknown.message) == (90, True)
    seen = [replace(e, table="pit") if e.table == "slow" else e for e in placed]
    [table] = [d for d in deviations(seen, origin=ZERO) if d.code == codes.UNKNOWN_TABLE.id]
    assert table.at.line == 1 + next(place for place, e in enumerate(seen) if e.table == "pit")


def test_a_wrong_sequence_says_how_many_cycles_lie_between():
    pieces = [("race", RACE), ("race", RACE), ("slow", SLOW)]
    [wrong] = [d for d in deviations(play(pieces), origin=ZERO) if d.code == codes.WRONG_SEQUENCE.id]
    assert wrong.message.startswith('cycle 2 is "slow", 1 after "race" in cycle 1')


def test_cycles_before_the_first_that_ran_are_counted_from_zero():
    """Where the mode is known in which the run began, its silent cycles have the numbers from 0 on."""
    late = [replace(e, start=e.start + ms(40), end=e.end + ms(40), cycle=e.cycle + 2) for e in play([("race", RACE)])]
    trace = Trace(name="", executions=tuple(late))
    answer = compare(PLAN, trace, CompareOptions(origin=ZERO), scope=Scope(is_whole=True))
    gone = [d.message for d in answer.diagnostics if d.code == codes.MISSING_JOB.id]
    assert {message.partition("(cycle ")[2][0] for message in gone} == {"0"}
    assert answer.counts == {Kind.MISSING: 2 * len(RACE.jobs)}


def test_a_table_that_is_not_scheduled():
    seen = [replace(e, table="pit") if e.table == "slow" else e for e in play()]
    assert codes.UNKNOWN_TABLE.id in found(seen, origin=ZERO)
    for length in (60, 61):
        named = [replace(e, table="t" * length) if e.table == "slow" else e for e in play()]
        told = [d for d in deviations(named, origin=ZERO) if d.code == codes.UNKNOWN_TABLE.id]
        assert {d.message for d in told} == {f'the schedule has no table "{"t" * 60}"'}
    two = [replace(e, table="pit" if n % 2 else "pot") if e.table == "slow" else e for n, e in enumerate(play())]
    [first] = [d for d in deviations(two, origin=ZERO) if d.code == codes.UNKNOWN_TABLE.id]
    name = next(e.table for e in two if e.table[0] == "p")
    assert first.message == f'the schedule has no table "{name}"; 2 times, this is the worst'


@pytest.mark.parametrize(
    ("pieces", "allowed"),
    [
        (PIECES, True),
        ([("slow", SLOW), ("slow->race", PLAN.transitions[1]), ("race", RACE)], True),
        ([("slow", SLOW), ("race", RACE)], True),  # a switch of length zero need not be counted
        ([("race", RACE), ("slow", SLOW)], False),  # this one has a table
        ([("race->slow", PLAN.transitions[0]), ("race", RACE)], False),
        ([("slow", SLOW), ("race->slow", PLAN.transitions[0])], False),
    ],
)
def test_the_order_of_the_tables(pieces, allowed):
    seen = found(play(pieces), origin=ZERO)
    assert (codes.WRONG_SEQUENCE.id not in seen) is allowed
    assert seen == set() or not allowed


@pytest.mark.parametrize(
    ("lost", "missing"),
    [
        ({1}, {"race": 4}),
        ({1, 2}, {"race": 4, "race->slow": 1}),
        ({2}, {"race->slow": 1}),
        ({3}, {"slow": 1}),
        ({3, 4}, {"slow": 1}),
    ],
)
def test_the_jobs_of_silent_cycles_are_missing_at_their_instants(lost, missing):
    """A cycle without jobs is one of the mode before it, or the switch to the mode after it; a mode is kept long."""
    pieces = [("race", RACE), ("race", RACE), ("race->slow", PLAN.transitions[0]), *[("slow", SLOW)] * 3]
    answer = compared([e for e in play(pieces) if e.cycle not in lost], origin=ZERO)
    gone = [d for d in answer.diagnostics if d.code == codes.MISSING_JOB.id]
    tables = Counter(d.path.split('"')[1] for d in gone)
    assert (tables, {d.code for d in answer.diagnostics}) == (missing, {codes.MISSING_JOB.id})
    assert sum(row.missing for row in answer.rows) == sum(e.cycle in lost for e in play(pieces))


def test_the_jobs_of_many_silent_cycles_are_missing_each_at_its_instant():
    seen = [each for each in play([("race", RACE)] * 6) if each.cycle in (0, 5)]
    answer = compared(seen, origin=ZERO)
    assert {row.task: row.missing for row in answer.rows} == {"a": 8, "b": 4, "c": 4}
    gone = [d.message for d in answer.diagnostics if d.code == codes.MISSING_JOB.id]
    assert any("20ms" in message for message in gone)


def test_a_switch_without_jobs_is_no_cycle_of_a_third_mode():
    """From b to c leads a switch of length zero, which leaves no trace but its number; and so do those by way of a."""
    modes = tuple(table(name, length, job("b", 0, 5, 7)) for name, length in (("a", 20), ("b", 25), ("c", 25)))
    ways = tuple(switch(one.name, other.name, 0) for one in modes for other in modes if one is not other)
    plan = Schedule(model="m", model_sha256="", modes=modes, transitions=ways)
    seen = play([("b", modes[1]), ("b->c", ways[3]), ("c", modes[2])])
    assert [e.cycle for e in seen] == [0, 2]
    answer = compare(plan, Trace(name="", executions=tuple(seen)), CompareOptions(origin=ZERO))
    assert answer.diagnostics == ()


@pytest.mark.parametrize(
    ("silent", "code"), [(MOST_SILENT // 4, codes.MISSING_JOB), (MOST_SILENT // 4 + 1, codes.PAUSE)]
)
def test_many_silent_cycles_of_a_trace_that_counts_them_are_a_pause(silent, code):
    pieces = [("race", RACE)] * 2
    first, second = (play(pieces)[i * 4 : i * 4 + 4] for i in (0, 1))
    by = ms(20) * silent
    second = [replace(e, cycle=e.cycle + silent, start=e.start + by, end=e.end + by) for e in second]
    assert found([*first, *second], origin=ZERO) == {code.id}


def test_jobs_that_need_one_resource_do_not_run_together():
    """Task b takes the resource from 4 ms to 6 ms, on another unit than a, which has it until 3 ms."""
    owner = model(
        task("a", 20, version("v", 3, "c1", access("r", 0, 3))),
        task("b", 20, version("v", 2, "c2", access("r", 0, 2))),
        task("c", 20, version("v", 4, "c3")),
        units="c1 c2 c3",
        resources="r",
    )
    plan = Schedule(
        model=owner.name,
        model_sha256="",
        modes=(table("all", 20, job("a", 0, 0, 3), job("b", 0, 4, 6, "c2"), job("c", 0, 4, 8, "c3")),),
    )
    seen = [Execution(task=j.task, units=j.units, start=j.start, end=j.end) for j in plan.modes[0].jobs]
    for late, is_found in ((ms(2), False), (ms(2) + Duration(1), True)):
        trace = Trace(name="", executions=(replace(seen[0], end=seen[0].end + late), *seen[1:]))
        answer = compare(plan, trace, CompareOptions(origin=ZERO, tolerance=ms(1)), owner)
        messages = [d.message for d in answer.diagnostics if d.code == codes.EXCLUSION.id]
        expected = ['task "a" ran at the same time for 1.000001ms with resource "r", at 0ms (cycle 0)'] * is_found
        assert messages == expected


def test_two_tables_in_one_cycle():
    seen = [replace(e, table="slow") if i == 2 else e for i, e in enumerate(play())]
    assert codes.WRONG_SEQUENCE.id in found(seen, origin=ZERO)


def test_several_modes_and_no_labels_need_a_word():
    seen = play([("race", RACE)], stated=False)
    for options, code in [({}, codes.NEEDS_MODE), ({"mode": "rice"}, UNKNOWN_MODE)]:
        with pytest.raises(HalpipeError) as refused:
            compared(seen, **options)
        assert [d.code for d in refused.value.diagnostics] == [code.id]
        assert "race" in refused.value.diagnostics[0].help


@pytest.mark.parametrize(("ran", "mode", "is_refused"), [("race", "race", False), ("race", "slow", True)])
def test_a_mode_that_is_asked_for_beside_labels_is_the_one_that_ran(ran, mode, is_refused):
    trace = Trace(name="", executions=tuple(sorted(play([(ran, RACE)]), key=lambda each: each.start.ns)))
    if not is_refused:
        assert [d.code for d in compare(PLAN, trace, CompareOptions(mode=mode)).diagnostics if d.is_error] == []
        return
    with pytest.raises(HalpipeError) as refused:
        compare(PLAN, trace, CompareOptions(mode=mode))
    assert "compare with a trace of race" in refused.value.diagnostics[0].message


def test_a_mode_without_cycles_is_the_mode_that_ran_and_several_need_a_column():
    seen = [replace(e, cycle=None) for e in play([("race", RACE)] * 2)]
    assert [d.code for d in compared(seen).diagnostics if d.is_error] == []
    mixed = [replace(e, cycle=None) for e in play()]
    with pytest.raises(HalpipeError) as refused:
        compared([replace(e, at=Location("t.csv", n)) for n, e in enumerate(mixed, 1)])
    [missing] = refused.value.diagnostics
    assert ("add a column cycle" in missing.help, missing.at.line) == (True, 1)


@pytest.mark.parametrize(("changes", "expected"), [({}, True), ({"table": ""}, False), ({"cycle": None}, False)])
def test_tables_are_stated_where_each_execution_has_table_and_cycle(changes, expected):
    seen = play([("race", RACE)])
    for place in range(len(seen)):
        assert is_stated(Executions.of(moved(seen, place, **changes))) is expected
    assert is_stated(Executions.of(replace(e, cycle=0) for e in seen))


def test_an_origin_is_an_instant_or_found():
    [origin] = [each for each in options_of(CompareOptions) if each.name == "origin"]
    assert (origin.from_text("3ms"), origin.from_text("auto")) == (ms(3), None)


def test_the_only_callback_of_a_node_is_the_task_called_after_the_node():
    jobs = tuple(replace(job, task="/n") for job in SLOW.jobs)
    plan = replace(PLAN, modes=(replace(SLOW, jobs=jobs),), transitions=())
    seen = [Execution(task="/n/callback_0", start=j.start, end=j.end) for j in jobs]
    found = compare(plan, Trace(name="", executions=tuple(seen)), CompareOptions())
    assert [d.code for d in found.diagnostics if d.is_error] == []


def test_deviations_of_one_job_are_one_finding_with_the_worst_and_how_often():
    seen = [replace(e, start=e.start + Duration(e.cycle + 1), end=e.end) if e.task == "c" else e for e in play()]
    (late,) = deviations(seen, origin=ZERO)
    assert "starts 2ns late" in late.message
    assert "2 times, this is the worst" in late.message


def test_cost_grows_with_the_trace_and_not_with_its_square():
    """Counted, not timed: how often an execution is asked for its start."""
    counts = []
    for cycles in (20, 40):
        reads = 0

        class Counting(Execution):
            def __getattribute__(self, name):
                nonlocal reads
                reads += name == "start"
                return super().__getattribute__(name)

        seen = play([("race", RACE)] * cycles, stated=False)
        counted = [Counting(task=e.task, units=e.units, start=e.start, end=e.end) for e in seen]
        compared(counted, mode="race")
        counts.append(reads)
    assert counts[1] < counts[0] * 2.5


def shared(seen, schedule=PLAN):
    return compare(schedule, Trace(name="", executions=tuple(seen), is_shared=True), CompareOptions(origin=ZERO))


def test_other_programs_of_a_computer_are_no_deviation():
    others = [Execution(task="kworker/0:1", units=("cpu0",), start=ms(1), end=ms(2))]
    (only,) = shared([*play(), *others]).diagnostics
    assert (only.code, only.severity) == (codes.UNSCHEDULED.id, Severity.NOTE)
    assert "kworker/0:1" in only.message
    many = [replace(others[0], task=f"p{number}") for number in range(7)]
    assert [each.message for each in shared([*play(), *many]).diagnostics] == [
        "not in the schedule: 7 programs: p0, p1, p2, p3, p4 and 2 more"
    ]
    assert [*shared([*play(), *others]).others] == []  # they teach nothing of tasks
    assert len(compared([*play([("race", RACE)], stated=False), *others], mode="race").others) == 1
    foreign = compare(PLAN, Trace(name="", executions=tuple(others), is_shared=True), CompareOptions(mode="race"))
    assert [*foreign.others] == []
    assert codes.UNKNOWN_TASK.id in {d.code for d in foreign.diagnostics}


def test_cpus_of_a_computer_count_where_the_schedule_has_their_names():
    on_cpus = [replace(e, units=("cpu0",)) for e in play()]
    assert shared(on_cpus).diagnostics == ()
    assert codes.WRONG_UNIT.id in {d.code for d in shared([replace(play()[0], units=("c2",)), *play()[1:]]).diagnostics}


def test_linux_keeps_the_first_characters_of_the_name_of_a_thread():
    name = "a_task_with_a_long_name"
    one = Schedule(model="m", model_sha256="", generator="t", modes=(table("run", ms(10), job(name, 0, ms(0), ms(1))),))
    seen = [Execution(task=name[:15], units=("cpu0",), start=ms(0), end=ms(1))]
    assert shared(seen, one).diagnostics == ()


def test_the_first_characters_of_two_names_are_the_name_of_neither():
    names = [f"a_task_with_a_long_name_{number}" for number in range(2)]
    jobs = [job(name, 0, ms(5 * number), ms(5 * number + 1)) for number, name in enumerate(names)]
    plan = Schedule(model="m", model_sha256="", generator="t", modes=(table("run", ms(10), *jobs),))
    seen = [Execution(task=names[0][:15], units=("cpu0",), start=ms(0), end=ms(1))]
    assert {row.task: row.seen for row in shared(seen, plan).rows} == dict.fromkeys(names, 0)


@pytest.mark.parametrize("silent", [30_000, 10**12])
def test_a_pause_in_which_the_mode_was_switched_is_one_pause(silent):
    """The jobs of the mode are too many to count, and so is that of the switch behind them."""
    first, last = play([("race", RACE)]), play([("slow", SLOW)])
    by = ms(20) * (silent - 1) + ms(25)
    last = [replace(e, cycle=silent + 1, start=e.start + by, end=e.end + by) for e in last]
    answer = compared([*first, *last], origin=ZERO)
    assert answer.counts[Kind.PAUSE] == 1
    [pause] = [d.message for d in answer.diagnostics if d.code == codes.PAUSE.id]
    assert pause == f"nothing ran in the {silent} cycles after cycle 0, whose jobs are not counted as missing"


@pytest.mark.parametrize("first_read", [0, 4])
def test_a_pause_is_reported_where_the_first_execution_after_it_stands(first_read):
    """Line 5 of the file has the start of the second race, whichever race a reader adds first."""
    seen = sorted(after_a_gap(25_001), key=lambda e: e.start.ns)
    rows = [replace(e, at=Location("t.csv", line)) for line, e in enumerate(seen, 1)]
    trace = Trace(name="", executions=Executions.of(rows[first_read:] + rows[:first_read]))
    [pause] = [d for d in compare(PLAN, trace, CompareOptions(mode="race")).diagnostics if d.is_error]
    assert (pause.code, pause.at) == (codes.PAUSE.id, Location("t.csv", 5))


def test_lateness_of_all_starts_has_its_median_its_99_per_cent_and_its_worst():
    """Of 200 starts, two are more than 3 us late, and one of them is the worst."""
    late = [*[1000] * 197, 3000, 4000, 5000]
    seen = [
        replace(e, start=e.start + Duration(by)) for e, by in zip(play([("race", RACE)] * 50), late[::-1], strict=True)
    ]
    assert compared(seen, origin=ZERO).starts == (Duration(1000), Duration(3000), Duration(5000))
    assert compare(PLAN, Trace(name="", executions=()), CompareOptions(mode="race")).starts == ()


def test_a_job_runs_in_a_gap_of_the_job_of_which_it_is_scheduled_in_the_gap():
    """Job b of cycle 0 runs in the gap that a has in cycle 2 for the b of cycle 2, which did not run."""
    parts = parted("a", 0, "c1", (0, 3, 0, 3), (5, 9, 3, 7))
    plan = Schedule(model="m", model_sha256="", modes=(table("t", 20, parts, job("b", 0, 3, 5)),))
    ran = [replace(e, busy=ms(7)) if e.task == "a" else e for e in play([("t", plan.modes[0])] * 3)]
    seen = {(e.task, e.cycle): e for e in ran}
    assert compare(plan, Trace(name="", executions=tuple(ran)), CompareOptions(origin=ZERO)).diagnostics == ()
    seen["b", 0] = replace(seen.pop(("b", 2)), cycle=0)
    late = sorted(seen.values(), key=lambda e: e.start.ns)
    answer = compare(plan, Trace(name="", executions=tuple(late)), CompareOptions(origin=ZERO))
    assert (answer.counts[Kind.OVERLAP], answer.counts[Kind.ORDER]) == (1, 1)
    [worst] = [d.message for d in answer.diagnostics if d.code == codes.WRONG_ORDER.id]
    assert worst.startswith('task "a" ran at the same time on a unit, at 40ms (cycle 0)')


@pytest.mark.parametrize("seed", range(20))
def test_of_each_place_below_one_before_it_the_last_of_the_largest_is_found(seed):
    rng = Random(seed)
    values, limits = ([rng.randint(0, 6) for _ in range(seed)] for _ in range(2))
    expected = []
    for at in range(1, seed):
        largest = max(values[:at])
        if limits[at] < largest:
            expected.append((max(n for n in range(at) if values[n] == largest), at))
    before, places = _after_larger(column(values), column(limits))
    assert [*zip(before.tolist(), places.tolist(), strict=True)] == expected


@pytest.mark.parametrize(("gap", "is_left_out"), [(10_000, False), (10_001, True)])
def test_a_stray_lies_further_before_the_others_than_the_first_of_these_before_the_median(gap, is_left_out):
    one = Schedule(model="m", model_sha256="", modes=(table("t", 10, job("a", 0, 0, 1), job("b", 0, 5, 6)),))
    seen = play([("t", one.modes[0])] * 10, ms(7))
    late = [0, *[10_000] * 6, -gap, *[10_000] * 12]
    seen = [replace(e, start=e.start + Duration(by)) for e, by in zip(seen, late, strict=True)]
    answer = compare(one, Trace(name="", executions=tuple(seen)), CompareOptions())
    assert answer.origin == ms(7) - Duration(0 if is_left_out else gap)


@pytest.mark.parametrize(
    ("cycles", "of_rare", "is_left_out"), [(3, 0, True), (3, 1, False), (4, 1, True), (6, 2, False), (7, 2, True)]
)
def test_strays_are_of_tasks_that_ran_more_than_three_times_as_often(cycles, of_rare, is_left_out):
    """Of 204 starts and more two may be strays; r ran once in each cycle."""
    often = (job("a", n, n, f"{n}.5ms") for n in range(67))
    one = Schedule(model="m", model_sha256="", modes=(table("t", 100, *often, job("r", 0, 80, 81)),))
    seen = play([("t", one.modes[0])] * cycles, ms(7))
    rare = [n for n, e in enumerate(seen) if e.task == "r" and e.cycle > 0]
    for place, early in zip((*rare[:of_rare], 100, 101), (500_000, 499_000), strict=False):
        seen = moved(seen, place, start=-early, end=-early)
    ordered = tuple(sorted(seen, key=lambda e: e.start.ns))
    answer = compare(one, Trace(name="", executions=ordered), CompareOptions())
    assert answer.origin == (ms(7) if is_left_out else ms("6.5ms"))


@pytest.mark.parametrize(("most", "missing"), [(3, 3), (2, 0)])
def test_silent_cycles_of_one_job_are_counted_up_to_the_limit(most, missing, monkeypatch):
    monkeypatch.setattr("halpipe.pipeline.compare.tables.MOST_SILENT", most)
    one = Schedule(model="m", model_sha256="", modes=(SLOW,))
    seen = [e for e in play([("slow", SLOW)] * 5, stated=False) if not ms(10) <= e.start < ms(40)]
    answer = compare(one, Trace(name="", executions=tuple(seen)), CompareOptions(origin=ZERO))
    assert (answer.counts[Kind.MISSING], answer.counts[Kind.PAUSE]) == (missing, not missing)


@pytest.mark.parametrize(("starts", "is_left_out"), [(9, False), (10, True)])
def test_a_recording_of_fewer_than_ten_executions_has_no_strays(starts, is_left_out):
    one = Schedule(model="m", model_sha256="", modes=(table("t", 10, job("a", 0, 0, 1), job("b", 0, 5, 6)),))
    seen = play([("t", one.modes[0])] * 5, ms(7))[:starts]
    seen[3] = replace(seen[3], start=seen[3].start - ms(1))
    answer = compare(one, Trace(name="", executions=tuple(seen)), CompareOptions())
    assert answer.origin == (ms(7) if is_left_out else ms(6))


def test_a_job_of_a_long_recording_takes_little_memory():
    """A recording of ten million events has 3.3 million jobs, for which 1 GB has to do."""
    seen, cycles = Executions("t"), 1000
    for cycle in range(cycles):
        for planned in RACE.jobs:
            start = (RACE.hyperperiod * cycle + planned.start).ns
            seen.add(planned.task, planned.units, start, start + 1, 1)
    seen.sort()
    plan = replace(PLAN, modes=(RACE,), transitions=())
    tracemalloc.start()
    answer = compare(plan, Trace(name="", executions=seen), CompareOptions())
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sum(row.seen for row in answer.rows) == cycles * len(RACE.jobs) == len(seen)
    assert most / len(seen) < 400


@pytest.mark.parametrize("factor", [2**61, Fraction(1, 7)])
@pytest.mark.parametrize("stated", [True, False])
def test_instants_that_no_column_of_64_bits_holds_are_compared_exactly(stated, factor):
    """Columns of whole numbers below 2**61, and those of objects, give the same figures."""

    def scaled(value):
        return Duration(value.ns * factor)

    def of_jobs(jobs):
        return tuple(replace(each, start=scaled(each.start), end=scaled(each.end)) for each in jobs)

    seen = play([("race", RACE)] * 4, stated=stated)
    seen[1] = replace(seen[1], start=seen[1].start + ms(1), end=seen[1].end + ms(2))
    seen[6] = replace(seen[6], end=None)
    large = [
        replace(each, start=scaled(each.start), end=each.end and scaled(each.end)) for each in seen if each != seen[4]
    ]
    mode = replace(RACE, hyperperiod=scaled(RACE.hyperperiod), jobs=of_jobs(RACE.jobs))
    plans = replace(PLAN, modes=(RACE,), transitions=()), replace(PLAN, modes=(mode,), transitions=())
    runs = [each for each in seen if each != seen[4]], large
    small, found = (
        compare(plan, Trace(name="", executions=Executions.of(run)), CompareOptions())
        for plan, run in zip(plans, runs, strict=True)
    )
    assert small.counts == found.counts
    assert {Kind.LATE, Kind.LATE_END, Kind.MISSING} <= {kind for kind, count in small.counts.items() if count}
    for before, after in zip(small.rows, found.rows, strict=True):
        for name in ("least", "median", "worst", "worst_end", "longest", "reserved"):
            value = getattr(before, name)
            assert getattr(after, name) == (value and scaled(value)), (before.task, name)
