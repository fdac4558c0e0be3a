"""Which phases a table covers: circles of modes, lines of transitions, and what reaches from one into the other."""

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import pytest
from regulator_samples import gang, one_mode, switching, two_units

import regulator_switches
from halpipe.core.durations import milliseconds
from halpipe.exporters.regulator.frames import Framer, Row, _covered, grid_of
from halpipe.models import Interrupt, Split
from halpipe.pipeline.parts import job_of
from support import access, job, model, ms, task, version

WINDOW = milliseconds(1)


def frames(system, schedule, resource="mem", unspecified="read"):
    grid = grid_of(system, schedule, WINDOW)
    return Framer(system, schedule, resource, grid, unspecified).frames(), grid


def spans(frame, grid):
    """Every phase as (task, unit, direction, begin, end) in ms, and its bound."""
    return sorted(
        (p.job.task, *p.row, Fraction(p.begin, grid.window), Fraction(p.end, grid.window), p.bound)
        for p in frame.phases
    )


def test_a_mode_has_the_phases_of_its_jobs_on_its_circle():
    (frame,), grid = frames(*two_units())
    assert spans(frame, grid) == [
        ("reader", "u1", "read", 1, 5, Fraction(1, 4)),
        ("writer", "u2", "read", 0, 1, 1),  # a load reads; it begins at 10 ms, which is 0 of the circle
        ("writer", "u2", "write", 5, 7, Fraction(1, 2)),
    ]
    assert (frame.name, frame.kind, frame.span) == ("all", "mode", 10 * grid.window)


def test_only_the_regulated_resource_counts():
    t = task("t", 10, version("v", 4, "u1", access("mem", 0, 1), access("other", 1, 2)))
    system = model(t, units="u1", resources="mem other")
    (frame,), grid = frames(system, one_mode(system, 10, job(system, "t", 0, 0, "u1")), "other")
    assert spans(frame, grid) == [("t", "u1", "read", 1, 2, 1)]


def test_accesses_of_no_kind_go_where_the_platform_says():
    t = task("t", 10, version("v", 4, "u1", access("mem", 0, 1)))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    rows = [frames(system, schedule, unspecified=d)[0][0].phases[0].row for d in ("read", "write")]
    assert rows == [Row("u1", "read"), Row("u1", "write")]


def test_a_gang_shares_its_bound():
    (frame,), grid = frames(*gang())
    assert spans(frame, grid) == [
        ("both", "u1", "read", 1, 3, Fraction(3, 16)),
        ("both", "u2", "read", 1, 3, Fraction(3, 16)),
    ]


def test_ticks_divide_every_time_of_the_schedule():
    t = task("t", "100/3ms", version("v", 4, "u1", access("mem", "1/7us", 1)))
    system = model(t, units="u1", resources="mem")
    grid = grid_of(system, one_mode(system, "100/3ms", job(system, "t", 0, "0.3ms", "u1")), WINDOW)
    for time in (ms("100/3ms"), ms("1/7us"), ms("0.3ms"), WINDOW):
        assert grid.ns(grid.ticks(time.ns)) == time.fraction
    assert grid.window == grid.ticks(WINDOW.ns) == 10**6 * grid.per_ns > 10**6


def test_a_transition_has_the_tail_of_the_mode_before_its_own_jobs_and_the_first_cycle_after():
    (_, _, there, _), grid = frames(*switching())
    assert (there.name, there.length // grid.window, there.cycles) == ("fast->slow", 1, 1)
    assert there.span == 6 * grid.window
    assert spans(there, grid) == [
        ("a", "u1", "read", -3, 2, Fraction(1, 4)),  # started at 7 of 10 in the mode before
        ("b", "u2", "read", 0, 3, Fraction(1, 2)),  # of the table: reaches into the first cycle
        ("b", "u2", "read", 5, 8, Fraction(1, 2)),  # of the first cycle, which begins at 1; nothing wraps in
        ("b", "u2", "write", 2, 3, Fraction(1, 10)),
        ("b", "u2", "write", 7, 8, Fraction(1, 10)),
    ]


def test_a_plain_switch_has_a_table_where_something_is_still_at_work():
    (*_, back), grid = frames(*switching())
    assert (back.name, back.length, back.cycles, back.span // grid.window) == ("slow->fast", 0, 1, 10)
    assert ("b", "u2", "read", -1, 2, Fraction(1, 2)) in spans(back, grid)


def test_a_plain_switch_needs_no_table_where_nothing_wraps():
    system, schedule = switching()
    modes = tuple(
        replace(m, jobs=tuple(replace(j, start=ms(0), end=j.end - j.start) for j in m.jobs)) for m in schedule.modes
    )
    found, _ = frames(system, replace(schedule, modes=modes, transitions=schedule.transitions[1:]))
    assert [frame.name for frame in found] == ["fast", "slow"]


def continued(bound):
    """Both modes run the same task, placed alike, so that it wraps; in the second it claims `bound`."""
    t = task(
        "t", 10,
        version("full", 5, "u1", access("mem", 0, 5, "0.5")),
        version("other", 5, "u1", access("mem", 0, 5, bound)),
    )  # fmt: skip
    system, schedule = switching()
    modes = tuple(
        replace(mode, runs=(replace(mode.runs[0], task="t", versions=(name,)),))
        for mode, name in zip(system.modes, ("full", "other"), strict=True)
    )
    system = replace(system, tasks=(t,), modes=modes)
    tables = tuple(
        replace(m, hyperperiod=ms(10), jobs=(job(system, "t", 0, 7, "u1", name),))
        for m, name in zip(schedule.modes, ("full", "other"), strict=True)
    )
    switch = replace(schedule.transitions[1], source="fast", target="slow")
    return system, replace(schedule, modes=tables, transitions=(switch,))


def test_what_wraps_in_anyway_covers_for_a_job_that_is_still_at_work():
    for bound in ("0.5", "0.75"):
        found, _ = frames(*continued(bound))
        assert [frame.name for frame in found] == ["fast", "slow"]


def test_what_wraps_in_does_not_cover_for_a_job_that_needs_more():
    found, _ = frames(*continued("0.4"))
    assert [frame.name for frame in found] == ["fast", "slow", "fast->slow"]


def pausing():
    """Parts [8, 10) and [25, 28.5) of a job every 20 ms: 1 ms to resume, and an interrupt of 1 ms every 2 ms."""
    split = Split(points=(ms(1),), resume=ms("0.5ms"))
    phases = (access("mem", 0, 1, "0.25", "read"), access("mem", 1, 2, "0.5", "write"))
    t = task("t", 20, replace(version("v", 2, "u1", *phases), split=split), slack=1)
    system = model(t, units="u1", resources="mem")
    served = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(2), wcet=ms(1)),))
    system = replace(system, units=(served,))
    spans = [(ms(8), ms(0), ms(1)), (ms(25), ms(1), ms(2))]
    return system, one_mode(system, 20, job_of("t", 0, t.versions[0], ("u1",), spans, ((ms(2), ms(1)),)))


def test_budgets_follow_the_phases_through_the_parts():
    (frame,), grid = frames(*pausing())
    assert spans(frame, grid) == [
        ("t", "u1", "read", 8, 10, Fraction(1, 4)),  # L(1) = 2
        ("t", "u1", "write", Fraction(11, 2), Fraction(17, 2), Fraction(1, 2)),  # from 25.5 to 25 + L(1.5)
    ]


@pytest.mark.parametrize("seed", range(60))
def test_a_switch_has_a_table_until_the_one_of_the_mode_after_grants_what_is_in_force(seed):
    system, schedule = regulator_switches.drawn(seed)
    found, grid = frames(system, schedule)
    cycles = regulator_switches.cycles_needed(system, schedule)
    length = int(schedule.transitions[0].length.in_unit("ms"))
    assert len(found) == 2 + bool(cycles or length)
    for frame in found[2:]:
        assert (frame.cycles, frame.length) == (cycles, length * grid.window)
        for instant in range(frame.span // grid.window):
            tick, due = instant * grid.window, Counter()
            for phase in frame.phases:
                if phase.begin <= tick < phase.end:
                    due[phase.row] += phase.bound
            assert due == regulator_switches.line(system, schedule, instant)


def test_what_a_transition_has_is_exact_to_the_tick():
    """A job of the mode before ends a tick after it, and one of the transition begins a tick into it."""
    system, schedule = switching()
    first = replace(schedule.modes[0], jobs=(job(system, "a", 0, "5.000001ms", "u1"),))
    switch = replace(schedule.transitions[0], jobs=(job(system, "b", 0, "0.000001ms", "u2"),))
    modes, transitions = (first, schedule.modes[1]), (switch, schedule.transitions[1])
    found, grid = frames(system, replace(schedule, modes=modes, transitions=transitions))
    tick = Fraction(1, grid.window)
    there = spans(found[2], grid)
    assert tick * 10**6 == 1
    assert ("a", "u1", "read", -5 + tick, tick, Fraction(1, 4)) in there
    assert ("b", "u2", "write", 2 + tick, 3 + tick, Fraction(1, 10)) in there


@pytest.mark.parametrize(
    ("needed", "cover", "is_covered"),
    [
        ((2, 8), (3, 8), True),  # before 4 nothing counts
        ((5, 8), (5, 8), True),
        ((5, 8), (4, 9), True),
        ((5, 8), (6, 8), False),
        ((5, 8), (5, 7), False),
        ((2, 8), (5, 8), False),
    ],
)
def test_a_phase_is_covered_by_one_that_is_in_force_from_an_instant_on(needed, cover, is_covered):
    (frame,), _ = frames(*two_units())
    phase = frame.phases[0]
    several = [replace(phase, begin=begin, end=end) for begin, end in (needed, cover)]
    assert _covered(several[:1], several[1:], 4) == is_covered
    more = replace(several[0], bound=phase.bound * 2)
    assert not _covered([more], several[1:], 4)


def test_a_switch_has_what_is_left_of_the_jobs_of_every_cycle_before_it():
    """Jobs of `slow` read 11 ms after their starts, which are 5 ms apart: the last two are still to read."""
    system, schedule = switching()
    long = task("b", 5, version("v", 12, "u2", access("mem", 11, 12, "0.5", "read")))
    system = replace(system, tasks=(system.tasks[0], long))
    slow = replace(schedule.modes[1], jobs=(job(system, "b", 0, 0, "u2"),))
    modes, transitions = (schedule.modes[0], slow), schedule.transitions[1:]
    (*_, back), grid = frames(system, replace(schedule, modes=modes, transitions=transitions))
    assert [(task, begin, end) for task, _, _, begin, end, _ in spans(back, grid) if task == "b"] == [
        ("b", 1, 2),
        ("b", 6, 7),
    ]
