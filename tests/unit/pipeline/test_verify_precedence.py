"""Rule precedence, with the paper's own stack as the case that must wrap round."""

from dataclasses import replace

import pytest
from verify_helpers import codes_found, errors, messages, only, plan_of, switch, table

from halpipe.pipeline.verify import codes
from support import after, chain, job, mode, model, schedule, task, version


def follow(low, high, anchor="start", wcet=3):
    return model(
        task("a", 10, version("v", wcet)),
        task("b", 10, version("v", 1, "u2", after("a", low, high, anchor))),
        units="u1 u2",
    )


def at(system, first, second):
    return schedule(system, 10, job(system, "a", 0, first, "u1"), job(system, "b", 0, second, "u2"))


def test_the_window_is_closed_on_both_sides():
    system = follow(3, 5)
    assert all(not errors(system, at(system, 1, start)) for start in (4, 5, 6))
    text = only(system, at(system, 1, "6000001ns"), codes.OUT_OF_WINDOW)
    assert (
        'starts at 6.000001ms, 5.000001ms after the start of "a" job 0; the window is [3ms, 5ms]: 1ns too late' in text
    )
    text = only(system, at(system, 1, "3999999ns"), codes.OUT_OF_WINDOW)
    assert '2.999999ms after the start of "a" job 0; the window is [3ms, 5ms]: 1ns too early' in text


def test_from_the_end_of_the_predecessor():
    system = follow(0, 2, "end")
    assert all(not errors(system, at(system, 1, start)) for start in (4, 5, 6))
    assert "1ms after the start" not in only(system, at(system, 1, 3), codes.OUT_OF_WINDOW)
    assert '1ms before the end of "a" job 0' in only(system, at(system, 1, 3), codes.OUT_OF_WINDOW)
    assert "1ms too late" in only(system, at(system, 1, 7), codes.OUT_OF_WINDOW)


def test_of_predecessors_that_are_equally_far_off_the_one_before_is_named():
    """9 ms after one start and 1 ms before the next: 4 too many for [3, 5], and 4 too few."""
    system = follow(3, 5)
    assert "8ms after the start" in only(system, at(system, 0, 8), codes.OUT_OF_WINDOW)
    assert '9ms after the start of "a" job 0; the window is [3ms, 5ms]: 4ms too late' in only(
        system, at(system, 0, 9), codes.OUT_OF_WINDOW
    )
    assert '0ms after the start of "a" job 0; the window is [3ms, 5ms]: 3ms too early' in only(
        system, at(system, 4, 4), codes.OUT_OF_WINDOW
    )


def test_the_predecessor_may_lie_in_an_earlier_hyperperiod():
    system = follow(3, 5)
    assert not errors(system, at(system, 8, 1))  # 3 after the start at -2
    assert not errors(follow(23, 25), at(follow(23, 25), 8, 1))  # and two hyperperiods before that
    assert codes_found(follow(24, 25), at(follow(24, 25), 8, 1)) == [codes.OUT_OF_WINDOW.id]
    end = follow(0, 0, "end")
    assert not errors(end, at(end, 9, 2))  # the end at 12 is the end at 2


def test_any_job_of_the_predecessor_may_serve():
    system = model(
        task("a", 10, version("v", 1)),
        task("b", 20, version("v", 1, "u2", after("a", 4, 6))),
        units="u1 u2",
    )
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u1")]
    for start, good in [(5, True), (15, True), (3, False), (8, False), (13, False), (18, False)]:
        found = errors(system, schedule(system, 20, *jobs, job(system, "b", 0, start, "u2")))
        assert (not found) == good


def test_a_predecessor_that_is_absent():
    system = follow(3, 5)
    alone = model(*system.tasks, units="u1 u2", modes=[mode("all", system.tasks[1:])])
    plan = schedule(alone, 10, job(alone, "b", 0, 0, "u2"))
    text = only(alone, plan, codes.OUT_OF_WINDOW)
    assert 'needs a job of "a" whose start lies [3ms, 5ms] before it; there is none' in text


def test_only_the_chosen_version_counts():
    versions = [version("follows", 1, "u2", after("a", 3, 5)), version("free", 1, "u2")]
    system = model(task("a", 10, version("v", 1)), task("b", 10, *versions), units="u1 u2")
    first = job(system, "a", 0, 0, "u1")
    assert not errors(system, schedule(system, 10, first, job(system, "b", 0, 9, "u2", "free")))
    only(system, schedule(system, 10, first, job(system, "b", 0, 9, "u2", "follows")), codes.OUT_OF_WINDOW)


def test_every_constraint_is_checked():
    system = model(
        task("a", 10, version("v", 1)),
        task("b", 10, version("v", 1, "u2", after("a", 1, 2), after("a", 3, 4), after("a", 5, 6))),
        units="u1 u2",
    )
    assert len(messages(system, at(system, 0, 3), codes.OUT_OF_WINDOW)) == 2


# ------------------------------------------------------------------------------------------------ the paper's stack

EVERY = "core1 core2 core3 core4"


def roboracer(slack=0, reaction=None, age=None):
    """Table II: 24 + 13 + 24 + 2 = 63 ms of work in a period of 25 ms, each task right after the one before."""
    return model(
        task("particle_filter", 25, version("full", 24, EVERY)),
        task("opponent_detection", 25, version("full", 13, EVERY, after("particle_filter", 0, 0, "end"))),
        task(
            "local_planning",
            25,
            version("full", 24, EVERY, after("particle_filter", 24, 75), after("opponent_detection", 0, 0, "end")),
        ),
        task(
            "pure_pursuit",
            25,
            version("full", 2, EVERY, after("particle_filter", 24, 75), after("local_planning", 0, 0, "end")),
            slack=slack,
        ),
        units=EVERY,
        chains=[chain("c", "particle_filter opponent_detection local_planning pure_pursuit", reaction, age)],
    )


def stack(system, pursuit=11):
    """0, 24, 37, 61 on the line are 0, 24, 12, 11 on the circle."""
    return schedule(
        system,
        25,
        job(system, "particle_filter", 0, 0, "core1"),
        job(system, "opponent_detection", 0, 24, "core2"),
        job(system, "local_planning", 0, 12, "core3"),
        job(system, "pure_pursuit", 0, pursuit, "core4"),
    )


def test_the_roboracer_stack_is_pipelined_over_three_hyperperiods():
    assert not errors(roboracer(), stack(roboracer()))


def test_it_passes_through_in_63_ms_and_reacts_a_period_later():
    exact = roboracer(reaction=25 + 63, age=63)
    assert not errors(exact, stack(exact))
    tight = roboracer(reaction="87999999ns", age="62999999ns")
    assert len(messages(tight, stack(tight), codes.CHAIN_LIMIT)) == 2


@pytest.mark.parametrize(("start", "text"), [(10, "1ms before the end"), (12, "1ms too late")])
def test_one_tick_off_the_end_of_the_stack(start, text):
    assert text in only(roboracer(), stack(roboracer(), start), codes.OUT_OF_WINDOW)


# ------------------------------------------------------------------------------------------------ switches


def cycles_apart():
    """Mode two looks back over 35 cycles at mode one, whose hyperperiod shares no divisor with its own but 10."""
    first = task("first", 10, version("v", 1), slack=1)
    then = task("then", 10, version("v", 1, "u2", after("first", 350, 360)), slack=1)
    slow = task("slow", 30, version("v", 1, "u3"))
    modes = [mode("one", [first, slow]), mode("two", [first, then])]
    system = model(first, then, slow, units="u1 u2 u3", modes=modes, transitions=[("one", "two", 20)])
    jobs = [replace(job(system, "first", 0, 10 * k, "u1"), index=k) for k in range(3)]
    one = table("one", 30, *jobs, job(system, "slow", 0, 0, "u3"))
    two = table("two", 10, job(system, "first", 0, 0, "u1"), job(system, "then", 0, 5, "u2"))
    return system, switch(plan_of(system, one, two), 0)


@pytest.mark.parametrize(("most", "is_refused"), [(3, False), (2, True)])
def test_cycles_that_look_at_another_instant_are_counted_to_the_limit(monkeypatch, most, is_refused):
    """Three cycles of 10 ms look at three instants of a mode of 30 ms; after them all is repeated."""
    monkeypatch.setattr("halpipe.pipeline.verify.precedence.MAX_LINE", most)
    system, plan = cycles_apart()
    assert [text for text in errors(system, plan) if "in too many cycles" in text] == errors(system, plan)
    assert bool(errors(system, plan)) == is_refused


def test_what_no_job_of_a_mode_finds_is_the_matter_of_the_mode():
    """In no cycle of mode two is there a first 5 to 6 ms before then, nor is there in mode one."""
    first = task("first", 10, version("v", 1), slack=1)
    then = task("then", 10, version("v", 1, "u2", after("first", 15, 16)), slack=1)
    modes = [mode("one", [first, then]), mode("two", [first, then])]
    system = model(first, then, units="u1 u2", modes=modes, transitions=[("one", "two", 20)])
    one = table("one", 10, job(system, "first", 0, 0, "u1"), job(system, "then", 0, 5, "u2"))
    two = table("two", 10, job(system, "first", 0, 0, "u1"), job(system, "then", 0, 7, "u2"))
    found = messages(system, switch(plan_of(system, one, two), 0), codes.OUT_OF_WINDOW)
    assert [text.split(" task")[0] for text in found] == ['mode "two"']


def test_ends_in_the_mode_before_count_for_the_first_cycle():
    """first ends 1 ms before the switch; then starts at 2 after it, or at 4 with a table of 2 ms."""
    first = task("first", 10, version("v", 2), slack=1)
    then = task("then", 10, version("v", 1, "u2", after("first", 2, 4, "end")), slack=1)
    modes = [mode("one", [first, then]), mode("two", [first, then])]
    system = model(first, then, units="u1 u2", modes=modes, transitions=[("one", "two", 20)])
    made = [table(n, 10, job(system, "first", 0, 7, "u1"), job(system, "then", 0, 2, "u2")) for n in ("one", "two")]
    assert not errors(system, switch(plan_of(system, *made), 0))
    assert "starts at 4ms after the switch" in only(system, switch(plan_of(system, *made), 2), codes.OUT_OF_WINDOW)


def test_the_last_cycle_that_looks_at_the_mode_before_is_looked_at():
    """then starts at 5, 15, 25, and needs a start 25 to 26 ms before: at -20, -10, and from -1 to 0, where none is."""
    first = task("first", 10, version("v", 2), slack=1)
    then = task("then", 10, version("v", 1, "u2", after("first", 25, 26)), slack=1)
    modes = [mode("one", [first]), mode("two", [first, then])]
    system = model(first, then, units="u1 u2", modes=modes, transitions=[("one", "two", 20)])
    for phase, told in ((0, ['"two" task "then" job 0 of mode "two": starts at 25ms after the switch']), (9, [])):
        one = table("one", 10, job(system, "first", 0, phase, "u1"))
        two = table("two", 10, job(system, "first", 0, 9, "u1"), job(system, "then", 0, 5, "u2"))
        found = messages(system, switch(plan_of(system, one, two), 0), codes.OUT_OF_WINDOW)
        assert [text.split(" to ")[1].split(" and ")[0] for text in found] == told


def test_a_job_of_the_mode_before_that_would_start_after_the_switch_does_not_serve():
    """first starts at 3 in every cycle; in the table, where there is none, then finds nothing at 3."""
    first = task("first", 10, version("v", 2), slack=1)
    then = task("then", 10, version("v", 1, "u2", after("first", 4, 4)), slack=1)
    modes = [mode("one", [first, then]), mode("two", [first, then])]
    system = model(first, then, units="u1 u2", modes=modes, transitions=[("one", "two", 20)])
    made = [table(n, 10, job(system, "first", 0, 3, "u1"), job(system, "then", 0, 7, "u2")) for n in ("one", "two")]
    early = job(system, "then", 0, 7, "u2")
    text = only(system, switch(plan_of(system, *made), 10, early), codes.OUT_OF_WINDOW)
    assert 'the nearest, "first" job 0, lies 14ms before' in text
    assert not errors(system, switch(plan_of(system, *made), 10, early, job(system, "first", 0, 3, "u1")))
