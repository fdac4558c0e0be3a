"""Measured figures of chains, and WCETs of the model beside run times."""

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError, Severity
from halpipe.core.durations import ZERO, Duration
from halpipe.models import Anchor, ChainLatency, Interrupt, ModeSchedule, Status, TransitionTable
from halpipe.models.trace import Execution, Trace, column
from halpipe.pipeline.compare import CompareOptions, codes, compare
from halpipe.pipeline.compare.chains import FIGURES, _row
from halpipe.pipeline.measure.cost import with_latencies
from profiles import examples
from support import chain, job, mode, model, ms, schedule, task, version

SYSTEM = model(
    task("a", "10ms", version("v", "2ms", "u1")),
    task("b", "20ms", version("v", "3ms", "u1")),
    chains=[chain("c", "a b")],
)
PLAN = schedule(
    SYSTEM,
    "20ms",
    job(SYSTEM, "a", 0, "0ms", "u1"),
    job(SYSTEM, "a", 1, "10ms", "u1"),
    job(SYSTEM, "b", 0, "5ms", "u1"),
)


def ran(cycles, plan=PLAN):
    mode = plan.modes[0]
    return [
        Execution(task=j.task, start=j.start + mode.hyperperiod * n, end=j.end + mode.hyperperiod * n)
        for n in range(cycles)
        for j in mode.jobs
    ]


def compared(executions, system=SYSTEM, plan=PLAN, **options):
    ordered = tuple(sorted(executions, key=lambda execution: execution.start.ns))
    return compare(plan, Trace(name="", executions=ordered), CompareOptions(origin=ZERO, **options), system)


def figures(answer):
    return {row.figure: row for row in answer.chains}


def test_a_faithful_recording_has_the_verified_figures():
    """Job a of 0 is read at 5 (8), that of 10 at 25 (18); the one missed at 0 is seen at 10 and read at 25."""
    answer = compared(ran(4))
    rows = figures(answer)
    assert [rows[name].worst for name in FIGURES] == [ms("18ms"), ms("28ms"), ms("8ms")]
    assert [rows[name].verified for name in FIGURES] == [rows[name].worst for name in FIGURES]
    assert (rows["latency"].count, rows["latency"].least, rows["latency"].median) == (7, ms("8ms"), ms("8ms"))
    assert (rows["reaction"].count, rows["age"].count) == (6, 4)
    assert answer.diagnostics == ()


def test_quantiles_are_samples():
    """Three of 200 paths are long: the 99th of 100 samples is the shortest of them, the worst the longest."""
    seen = ran(200)
    late = [n for n, e in enumerate(seen) if e.task == "b" and e.start > ms("500ms")]
    for n, more in zip(late, ("3ms", "1ms", "2ms"), strict=False):
        seen[n] = replace(seen[n], end=seen[n].end + ms(more))
    age = figures(compared(seen))["age"]
    assert (age.median, age.p99, age.worst, age.count) == (ms("8ms"), ms("9ms"), ms("11ms"), 200)
    first = figures(compared(ran(200)[:-1]))["age"]
    assert first.count == 199


def exceeded(executions, system=SYSTEM, **options):
    found = [d for d in compared(executions, system, **options).diagnostics if d.code == codes.CHAIN_EXCEEDED.id]
    return [(d.severity, d.message) for d in found]


def test_a_job_that_comes_too_early_for_its_data_is_seen_in_the_chain():
    """Starting 4 ms early, b reads before a has written: data of 14 ms, and those of a wait for b 20 ms later."""
    seen = ran(4)
    position = next(n for n, e in enumerate(seen) if e.task == "b" and e.start == ms("45ms"))
    seen[position] = replace(seen[position], start=ms("41ms"), end=ms("44ms"))
    for tolerance, names in (("2ms", FIGURES), ("3ms", FIGURES[:2]), ("5ms", ())):  # 6, 10 and 10 ms too much
        found = exceeded(seen, tolerance=ms(tolerance))
        assert [message.partition(" of ")[0] for _, message in found] == list(names)
        assert all(severity is Severity.WARNING for severity, _ in found)


@pytest.mark.parametrize(("limit", "severity"), [("13ms", Severity.ERROR), ("14ms", Severity.WARNING)])
def test_more_than_the_limit_of_the_model_is_an_error(limit, severity):
    seen = ran(4)
    position = next(n for n, e in enumerate(seen) if e.task == "b" and e.start == ms("45ms"))
    seen[position] = replace(seen[position], start=ms("41ms"), end=ms("44ms"))
    system = replace(SYSTEM, chains=(replace(SYSTEM.chains[0], max_age=ms(limit)),))
    (found,) = [severity for severity, message in exceeded(seen, system) if message.startswith("age of 14ms")]
    assert found is severity


@pytest.mark.parametrize(("anchor", "to", "offset"), [(None, None, 2), (None, Anchor.START, 0), (Anchor.END, None, 0)])
def test_a_chain_of_one_task_is_measured_between_the_instants_of_its_jobs(anchor, to, offset):
    """Jobs of a take 2 ms, each 10 ms; a reaction begins with the job that just missed the stimulus."""
    alone = replace(SYSTEM, chains=(replace(SYSTEM.chains[0], tasks=("a",), anchor=anchor, to=to),))
    rows = figures(compared(ran(4), alone))
    assert [rows[name].worst for name in FIGURES] == [ms(offset), ms(10 + offset), ms(offset)]
    assert [rows[name].count for name in FIGURES] == [8, 7, 8]


def test_events_of_a_chain_are_measured_where_they_are_recorded():
    ends = replace(SYSTEM, chains=(replace(SYSTEM.chains[0], anchor=Anchor.END, to=Anchor.START),))
    rows = figures(compared(ran(4), ends))
    assert [rows[name].worst for name in FIGURES] == [ms("13ms"), ms("23ms"), ms("3ms")]
    assert all(rows[name].verified == rows[name].worst for name in FIGURES)


@pytest.mark.parametrize("length", ["0ms", "10ms"])
def test_no_path_leads_through_a_mode_without_the_chain(length):
    """In the mode idle only a runs: data that wait for the next b, or a b that finds old data, are no paths.

    Nor are those of the tables of the switches, which are no tables of the chain.
    """
    idle = mode("idle", SYSTEM.tasks[:1])
    system = replace(SYSTEM, modes=(*SYSTEM.modes, idle))
    jobs = (job(SYSTEM, "a", 0, "0ms", "u1"),)
    table = ModeSchedule(name="idle", hyperperiod=ms("10ms"), status=Status.VALID, jobs=jobs)
    moved = (job(SYSTEM, "a", 0, "0ms", "u1"), job(SYSTEM, "b", 0, "5ms", "u1")) if length != "0ms" else ()
    switches = tuple(
        TransitionTable(
            source=s, target=t, length=ms(length), worst_latency=ms(length), status=Status.VALID, jobs=moved
        )
        for s, t in (("all", "idle"), ("idle", "all"))
    )
    plan = replace(PLAN, modes=(*PLAN.modes, table), transitions=switches)
    seen, now = [], ZERO
    away, back = ([each] if moved else [] for each in switches)
    tables = [plan.modes[0]] * 3 + away + [table] * 5 + back + [plan.modes[0]] * 3
    for cycle, played in enumerate(tables):
        for j in played.jobs:
            start, end = now + j.start, now + j.end
            seen.append(Execution(task=j.task, start=start, end=end, table=played.name, cycle=cycle, job=j.index))
        now += played.length if isinstance(played, TransitionTable) else played.hyperperiod
    rows = figures(compared(seen, system, plan))
    assert [rows[name].worst for name in FIGURES] == [ms("18ms"), ms("28ms"), ms("8ms")]
    assert [rows[name].count for name in FIGURES] == [10, 8, 6]


@pytest.mark.parametrize("cycle", [0, 3, 99])
def test_a_job_of_a_table_that_the_schedule_does_not_have_writes_data_too(cycle):
    """Whatever cycle it states, also one behind all that were played."""
    seen = [replace(e, table="all", cycle=n // 3) for n, e in enumerate(ran(4))]
    late = {"a": 81, "b": 84}
    seen += [Execution(task=t, start=ms(at), end=ms(at + 1), table="pit", cycle=cycle) for t, at in late.items()]
    rows = figures(compared(seen))
    assert (rows["age"].count, rows["age"].least, rows["age"].worst) == (5, ms(4), ms(8))


@pytest.mark.parametrize(("task", "counts"), [("a", [8, 7, 4]), ("b", [8, 7, 5])])
def test_a_job_that_is_not_scheduled_has_a_part_as_a_job_of_its_own_task(task, counts):
    """Data of one more of a, at 33 ms, reach the next b; one more of b, at 73 ms, finds the datum of the last a."""
    at = {"a": ms(33), "b": ms(73)}[task]
    rows = figures(compared([*ran(4), Execution(task=task, start=at, end=at + Duration(1))]))
    assert [rows[name].count for name in FIGURES] == counts


def test_a_chain_of_which_a_task_did_not_run_has_no_path():
    rows = figures(compared([e for e in ran(4) if e.task == "a"]))
    assert [rows[name].count for name in FIGURES] == [0, 0, 0]


def test_a_job_without_a_message_has_no_part_in_a_chain():
    """Data of 0 and 10 ms wait for the next b, and an actuator does not see those of b."""
    seen = ran(4)
    first = next(n for n, e in enumerate(seen) if e.task == "b")
    for has_data, counts, latency in ((None, [7, 6, 4], 18), (True, [7, 6, 4], 18), (False, [7, 6, 3], 28)):
        seen[first] = replace(seen[first], has_data=has_data)
        rows = figures(compared(seen))
        assert [rows[name].count for name in FIGURES] == counts
        assert rows["latency"].worst == ms(latency)


def with_let(lets=("10ms", "20ms"), **changes):
    lets = dict(zip("ab", map(ms, lets), strict=True))
    tasks = tuple(replace(t, let=lets[t.name], offset=ZERO, slack=Fraction(1, 2)) for t in SYSTEM.tasks)
    return replace(SYSTEM, tasks=tasks, chains=(replace(SYSTEM.chains[0], **changes),))


@pytest.mark.parametrize("late", [0, 2])
def test_data_of_a_logical_execution_time_are_read_and_written_at_its_instants(late):
    """Job b starts at 5 ms and is released at 0, when that of 10 ms before has written; starts change nothing."""
    seen = [replace(e, start=e.start + ms(late), end=e.end + ms(late)) for e in ran(4)]
    answer = compared(seen, with_let(anchor=Anchor.RELEASE), tolerance=ms(late))
    rows = figures(answer)
    assert [rows[name].worst for name in FIGURES] == [ms("40ms"), ms("50ms"), ms("30ms")]
    assert all(rows[name].verified == rows[name].worst for name in FIGURES)
    assert answer.diagnostics == ()


@pytest.mark.parametrize(("over", "age"), [(0, "30ms"), (1, "40ms")])
def test_a_job_that_ends_after_its_write_leaves_the_datum_before(over, age):
    """That of 30 ms is written at 40 ms, where b reads; one nanosecond later it is the datum of 20 ms."""
    seen = ran(4)
    position = next(n for n, e in enumerate(seen) if e.task == "a" and e.start == ms("30ms"))
    seen[position] = replace(seen[position], end=ms("40ms") + Duration(over))
    assert figures(compared(seen, with_let()))["age"].worst == ms(age)


@pytest.mark.parametrize(
    ("system", "is_measured"),
    [
        (with_let(), True),
        (with_let(anchor=Anchor.START), False),
        (with_let(to=Anchor.END), False),
        (with_let((None, None), anchor=Anchor.RELEASE), False),
        (with_let((None, "20ms")), True),
        (with_let((None, "20ms"), anchor=Anchor.START), True),
        (with_let((None, "20ms"), anchor=Anchor.RELEASE), False),
        (with_let((None, "20ms"), to=Anchor.END), False),
        (with_let(("10ms", None), anchor=Anchor.RELEASE), True),
        (with_let(("10ms", None), anchor=Anchor.START), False),
        (with_let(("10ms", None), to=Anchor.END), True),
        (with_let(("10ms", None), to=Anchor.RELEASE), False),
    ],
)
def test_chains_from_instants_that_are_not_recorded_are_not_measured(system, is_measured):
    answer = compared(ran(4), system)
    assert bool(answer.chains) is is_measured
    assert [d.code for d in answer.diagnostics] == ([] if is_measured else [codes.NOT_MEASURED.id])


SPANS = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 9)), min_size=1, max_size=7, unique_by=lambda s: s[0])


def simulated(members, begin, end):
    """Let time pass over the jobs of a chain: registers hold what was written last, data wait for the next to read.

    `begin` and `end` say whether starts (0) or ends (1) of the first and the last job count. At one instant, jobs write
    before others read. A datum remembers the job of the first task that made it, and the job that just missed it.
    """
    steps = [(span[1], 0, place, span) for place, spans in enumerate(members) for span in spans]
    steps += [(span[0], 1, place, span) for place, spans in enumerate(members) for span in spans]
    waiting, register = [[] for _ in members], [None for _ in members]
    held, missed, last = {}, None, len(members) - 1
    found = {name: [] for name in FIGURES}
    for _, reads, place, span in sorted(steps):
        if reads and place == 0:
            held[place, span] = ([("latency", span)] + ([("reaction", missed)] if missed else []), span)
            missed = span
        elif reads:
            held[place, span] = (waiting[place], register[place - 1])
            waiting[place] = []
        elif place == last:
            data, origin = held[place, span]
            for name, first in [*data, *([("age", origin)] if origin else [])]:
                found[name].append(span[end] - first[begin])
        else:
            data, origin = held[place, span]
            waiting[place + 1] += data
            register[place] = origin
    return {name: sorted(values) for name, values in found.items()}


@examples(600)
@given(st.lists(SPANS, min_size=1, max_size=4), st.sampled_from([(0, 1), (0, 0), (1, 1), (1, 0)]))
def test_measured_figures_are_those_of_an_own_simulator(drawn, instants):
    members = [sorted((start, start + length) for start, length in spans) for spans in drawn]
    begin, end = instants if len(members) > 1 else (0, 1)
    names = "abcd"[: len(members)]
    events = {"anchor": Anchor.END if begin else None, "to": None if end else Anchor.START}
    system = model(*(task(n, "1ms", version("v", "1ns", "u1")) for n in names), chains=[chain("c", " ".join(names))])
    system = replace(system, chains=(replace(system.chains[0], **events),))
    plan = schedule(system, "1ms", *(job(system, n, 0, f"{k}ns", "u1") for k, n in enumerate(names)))
    seen = [
        Execution(task=name, start=Duration(start), end=Duration(end))
        for name, spans in zip(names, members, strict=True)
        for start, end in spans
    ]
    rows = figures(compared(seen, system, plan))
    for name, values in simulated(members, begin, end).items():
        row = rows[name]
        assert row.count == len(values)
        if values:
            expected = (values[0], values[(len(values) - 1) // 2], values[-(-99 * len(values) // 100) - 1], values[-1])
            assert (row.least.ns, row.median.ns, row.p99.ns, row.worst.ns) == expected


def test_the_verified_figures_come_from_the_schedule():
    assert figures(compared(ran(1)))["latency"].verified == with_latencies(SYSTEM, PLAN).modes[0].chains[0].latency


@pytest.mark.parametrize(
    ("latencies", "worst"), [(["3ms", "5ms", "4ms"], "5ms"), (["3ms", None], None), ([None, None], None)]
)
def test_a_figure_is_verified_where_that_of_each_mode_is(latencies, worst):
    verified = [ChainLatency(name="c", latency=ms(each)) for each in latencies]
    assert _row(SYSTEM.chains[0], "latency", column([1]), verified).verified == ms(worst)


def test_run_times_stand_beside_the_wcet_and_the_reserved_length():
    unit = replace(SYSTEM.units[0], interrupts=(Interrupt(name="rx", distance=ms("10ms"), wcet=ms("1ms")),))
    system = replace(SYSTEM, units=(unit,))
    longer = tuple(replace(j, end=j.end + ms("1ms")) for j in PLAN.modes[0].jobs)
    plan = replace(PLAN, modes=(replace(PLAN.modes[0], jobs=longer),))
    row = compared(ran(2, plan), system, plan).rows[0]
    assert (row.longest, row.reserved, row.wcet) == (ms("3ms"), ms("3ms"), ms("2ms"))
    assert compare(plan, Trace(name="", executions=tuple(ran(1, plan))), CompareOptions()).rows[0].wcet is None


def test_a_task_that_was_not_due_is_listed():
    answer = compared([e for e in ran(1) if e.task == "a"][:1])
    assert [(row.task, row.seen, row.missing) for row in answer.rows] == [("a", 1, 0), ("b", 0, 0)]
    (found,) = [d for d in answer.diagnostics if d.code == codes.DID_NOT_RUN.id]
    assert found.message.endswith(": b")


@pytest.mark.parametrize(
    "other",
    [
        replace(SYSTEM, name="other"),
        replace(SYSTEM, tasks=SYSTEM.tasks[:1]),
        replace(SYSTEM, modes=(replace(SYSTEM.modes[0], name="other"),)),
    ],
)
def test_another_model_is_refused(other):
    refuse(other, PLAN)


@pytest.mark.parametrize(("model", "schedule", "is_other"), [("x", "y", True), ("x", "x", False), ("", "y", False)])
def test_a_model_of_other_content_is_refused_where_both_are_known(model, schedule, is_other):
    owner, plan = SYSTEM.read_from(model), replace(PLAN, model_sha256=schedule)
    if is_other:
        refuse(owner, plan)
    else:
        assert compared(ran(1), owner, plan).diagnostics == ()


def refuse(other, plan):
    with pytest.raises(HalpipeError) as refused:
        compared(ran(1), other, plan)
    assert [d.code for d in refused.value.diagnostics] == [codes.OTHER_MODEL.id]
