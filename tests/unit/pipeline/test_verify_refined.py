"""Instants, cycles, closed edges, locks and logical execution times (MODEL 10): each kept, and missed by 1 ms."""

from dataclasses import replace
from fractions import Fraction

import pytest
from verify_helpers import codes_found, errors, only, plan_of, switch, table

from halpipe.models import Anchor, Chain, Edge, Match, Part, Precedence, ResourceKind, Split
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.verify.chains import measured
from support import access, job, mode, model, ms, schedule, task, version

CAMERA = task("camera", 20, version("v", 4, "u1"), offset=0, slack=1, deadline=30)


def row(high=5, low=0, **changes):
    return Precedence(task="camera", min=ms(low), max=ms(high), **changes)


def answered(constraint, period=20, **changes):
    return model(CAMERA, task("brake", period, version("v", 2, "u2", constraint), slack=1, **changes), units="u1 u2")


def at(system, camera, brake, index=0):
    brakes = [replace(job(system, "brake", 0, start, "u2"), index=k) for k, start in enumerate(brake)]
    return schedule(system, 20, job(system, "camera", 0, camera, "u1"), *brakes)


@pytest.mark.parametrize(
    ("constraint", "good", "bad"),
    [
        (row(to=Anchor.END, anchor=Anchor.END), 7, 8),  # from 4 to 9 ms: within 5 ms
        (row(anchor=Anchor.RELEASE), 5, 6),  # released at 0
        (row(anchor=Anchor.RELEASE, to=Anchor.END), 3, 4),
        (row(anchor=Anchor.POINT, point=ms(3)), 8, 9),
        (row(anchor=Anchor.POINT, point=ms(0)), 5, 6),
    ],
)
def test_windows_count_from_and_to_their_instants(constraint, good, bad):
    system = answered(constraint)
    assert not errors(system, at(system, 0, [good]))
    assert "too late" in only(system, at(system, 0, [bad]), codes.OUT_OF_WINDOW)


def test_a_release_stays_where_it_is_when_the_job_starts_later():
    system = answered(row(anchor=Anchor.RELEASE))
    assert not errors(system, at(system, 3, [5]))
    only(system, at(system, 3, [6]), codes.OUT_OF_WINDOW)


def test_a_window_does_not_tell_the_cycle_and_match_does():
    """Brake at 0, camera at 5 ms: within 20 ms after the camera of the cycle before."""
    window, cycle = answered(row(20)), answered(row(20, match=Match.CYCLE))
    assert not errors(window, at(window, 5, [0]))
    only(cycle, at(cycle, 5, [0]), codes.OUT_OF_WINDOW)
    assert not errors(cycle, at(cycle, 5, [5]))


def test_a_predecessor_of_the_same_cycle_that_does_not_run_is_missing():
    system = answered(row(20, match=Match.CYCLE))
    alone = replace(system, modes=(mode("all", system.tasks[1:]),))
    plan = at(alone, 5, [5])
    plan = replace(plan, modes=(replace(plan.modes[0], jobs=plan.modes[0].jobs[1:]),))
    assert "which is missing" in only(alone, plan, codes.OUT_OF_WINDOW)


def test_jobs_of_a_shorter_period_belong_to_the_cycle_in_which_they_are_released():
    system = answered(row(15, match=Match.CYCLE), period=10)
    assert not errors(system, at(system, 0, [0, 15]))
    only(system, at(system, 0, [1, 16]), codes.OUT_OF_WINDOW)


def test_a_delayed_job_of_the_cycle_before_counts_where_it_belongs():
    """The camera is released at 15 and starts at 23, which the table has at 3; the brake at 10 is too early for it."""
    camera = replace(CAMERA, offset=ms(15))
    system = replace(
        answered(row(20, match=Match.CYCLE)), tasks=(camera, answered(row(20, match=Match.CYCLE)).tasks[1])
    )
    only(system, at(system, 3, [10]), codes.OUT_OF_WINDOW)


def test_a_phase_beyond_the_first_period_numbers_the_jobs_wrongly():
    brake = task("brake", 10, version("v", 2, "u2", row(20, match=Match.CYCLE)))
    system = model(CAMERA, brake, units="u1 u2")
    assert codes.NOT_PERIODIC.id in codes_found(system, at(system, 0, [12, 2]))
    assert not errors(system, at(system, 0, [2, 12]))


# ------------------------------------------------------------------------------------------------ edges


def closed(edge=Edge.CLOSED):
    return replace(model(CAMERA, modes=[replace(mode("all", [CAMERA]), edge=edge)]))


def test_nothing_is_in_progress_over_a_closed_edge():
    system = closed()
    assert not errors(system, schedule(system, 20, job(system, "camera", 0, 16, "u1")))
    only(system, schedule(system, 20, job(system, "camera", 0, 17, "u1")), codes.OVER_THE_EDGE)
    assert not errors(closed(Edge.OPEN), schedule(system, 20, job(system, "camera", 0, 17, "u1")))


def test_a_switch_into_a_closed_mode_waits_for_what_is_in_progress():
    other = task("other", 20, version("v", 5, "u2"))
    modes = [mode("one", [other]), replace(mode("two", [CAMERA]), edge=Edge.CLOSED)]
    system = model(CAMERA, other, units="u1 u2", modes=modes, transitions=(("one", "two", 9),))
    one = table("one", 20, job(system, "other", 0, 17, "u2"))
    plan = plan_of(system, one, table("two", 20, job(system, "camera", 0, 0, "u1")))
    only(system, switch(plan, 1), codes.OVER_THE_EDGE)
    assert not errors(system, switch(plan, 2))


# ------------------------------------------------------------------------------------------------ locks


def locking(kind=ResourceKind.LOCK, points=(2, 4)):
    held = replace(version("v", 6, "u1", access("spin", 1, 5)), split=Split(points=tuple(map(ms, points))))
    log, plan = task("log", 20, held, slack=1), task("plan", 20, version("v", 3, "u2", access("spin", 1, 2)), slack=1)
    short = task("short", 20, version("v", 3, "u1"), slack=1)
    system = model(log, plan, short, units="u1 u2", resources="spin")
    return replace(system, resources=tuple(replace(r, kind=kind) for r in system.resources))


def interrupted(system, plan):
    """log runs 0..2, 5..9; short runs in its gap."""
    parts = tuple(
        Part(start=ms(s), end=ms(t), executed_from=ms(a), executed_to=ms(b))
        for s, t, a, b in ((0, 2, 0, 2), (5, 9, 2, 6))
    )
    log = replace(job(system, "log", 0, 0, "u1"), end=ms(9), parts=parts)
    return schedule(system, 20, log, job(system, "plan", 0, plan, "u2"), job(system, "short", 0, 2, "u1"))


@pytest.mark.parametrize(("start", "is_free"), [(7, True), (6, False), (2, False), (19, True)])
def test_a_lock_is_held_through_a_gap(start, is_free):
    """Held from 1 to 8 ms; plan takes it from 1 to 2 ms after its start."""
    system = locking()
    assert (codes.OVERLOAD.id not in codes_found(system, interrupted(system, start))) == is_free


def test_a_memory_access_has_no_gap():
    assert codes.MODEL_FAULT.id in codes_found(locking(ResourceKind.MEMORY), interrupted(locking(), 12))


def test_a_lock_with_a_bound_is_a_fault_of_the_model():
    system = model(task("a", 20, version("v", 2, "u1", access("spin", 0, 1, Fraction(1, 2)))), resources="spin")
    system = replace(system, resources=tuple(replace(r, kind=ResourceKind.LOCK) for r in system.resources))
    only(system, schedule(system, 20, job(system, "a", 0, 0, "u1")), codes.MODEL_FAULT)


# ------------------------------------------------------------------------------------------------ LET and chains


def timed(**changes):
    """Two tasks of 10 and 20 ms with logical execution times of 5 and 20 ms, and a chain."""
    first = replace(task("a", 10, version("v", 2, "u1"), offset=0, slack=1), let=ms(5))
    second = replace(task("b", 20, version("v", 3, "u2"), offset=0, slack=1), let=ms(20))
    return replace(model(first, second, units="u1 u2"), chains=(Chain(name="c", tasks=("a", "b"), **changes),))


def placed(system, first=(0, 10), second=0):
    firsts = [replace(job(system, "a", 0, start, "u1"), index=k) for k, start in enumerate(first)]
    return schedule(system, 20, *firsts, job(system, "b", 0, second, "u2"))


def test_a_job_ends_within_its_logical_execution_time():
    system = timed()
    assert not errors(system, placed(system, (3, 13)))
    assert "its LET is 5ms" in only(system, placed(system, (3, 14)), codes.LATE)


def figures(system, plan):
    from halpipe.core.diagnostics import Findings
    from halpipe.pipeline.verify import reading

    clock, found = reading.make_clock(system, plan), Findings()
    modes = reading.active_modes(system, clock, found)
    (mode_table,) = reading.mode_tables(system, plan, modes, clock, found).values()
    ticks = list(measured(mode_table, system.chains[0]))
    return [None if t is None else t[0] // clock.ticks(ms(1)) for t in ticks]


def test_the_three_figures_under_let_do_not_depend_on_the_schedule():
    """a writes at 5 and 15, b reads at 20 and writes at 40; of 0 -> 40 and 10 -> 40, of just missed 10 -> 60."""
    for first, second in (((0, 10), 0), ((3, 11), 16)):
        system = timed()
        assert figures(system, placed(system, first, second)) == [40, 50, 30]


def test_the_three_figures_of_implicit_communication():
    """a at 0 and 10 ends at 2 and 12; b at 4 ends at 7: 0 -> 7, 10 -> 27; just missed 0: 27, 10: 27 (20 -> 27)."""
    system = timed()
    system = replace(system, tasks=tuple(replace(t, let=None) for t in system.tasks))
    assert figures(system, placed(system, second=4)) == [17, 27, 7]


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({}, 17),
        ({"anchor": Anchor.RELEASE}, 17),
        ({"anchor": Anchor.END}, 15),
        ({"to": Anchor.START}, 14),
        ({"anchor": Anchor.END, "to": Anchor.START}, 12),
    ],
)
def test_events_say_from_where_to_where_latencies_count(changes, limit):
    kept, missed = (timed(max_latency=ms(most), **changes) for most in (limit, limit - 1))
    kept, missed = (replace(s, tasks=tuple(replace(t, let=None) for t in s.tasks)) for s in (kept, missed))
    assert not errors(kept, placed(kept, second=4))
    assert "latency" in only(missed, placed(missed, second=4), codes.CHAIN_LIMIT)


def test_a_job_of_a_table_is_released_when_it_starts():
    short = replace(task("a", 20, version("v", 2, "u1"), version("w", 6, "u1"), slack=1), let=ms(5))
    modes = [mode("one", [short]), mode("two", [short])]
    system = model(short, modes=modes, transitions=(("one", "two", 20),))
    plan = plan_of(system, *(table(name, 20, job(system, "a", 0, 0, "u1")) for name in ("one", "two")))
    assert not errors(system, switch(plan, 10, job(system, "a", 0, 5, "u1")))
    only(system, switch(plan, 11, job(system, "a", 0, 5, "u1", "w")), codes.LATE)


@pytest.mark.parametrize(
    "system",
    [
        answered(row(to=Anchor.RELEASE)),
        answered(row(anchor=Anchor.POINT)),
        answered(row(anchor=Anchor.POINT, point=ms(5))),
        timed(anchor=Anchor.POINT),
        timed(to=Anchor.RELEASE),
    ],
)
def test_instants_that_jobs_do_not_have_are_faults_of_the_model(system):
    assert codes.MODEL_FAULT.id in [d.code for d in verify(system, schedule(system, 20))]
