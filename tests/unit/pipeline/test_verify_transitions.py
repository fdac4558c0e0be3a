"""The switch from one mode to another, on the line."""

from dataclasses import replace
from fractions import Fraction

import pytest
from verify_helpers import codes_found, errors, messages, only, plan_of, switch, table

from halpipe.models import Status
from halpipe.pipeline.verify import codes, verify
from support import access, after, chain, job, mode, model, ms, task, version

A = task("a", 10, version("v", 4, "u1 u2"), version("w", 4, "u1 u2"), slack=Fraction(1, 2))
B = task("b", 10, version("v", 4, "u1 u2"))


def two_modes(one=(A,), two=(A,), transitions=(("one", "two", 20),), **changes):
    tasks = tuple(dict.fromkeys((*one, *two)))
    return model(*tasks, units="u1 u2", modes=[mode("one", one), mode("two", two)], transitions=transitions, **changes)


def tables(system, first, second):
    """Jobs as (task, start, units) of each mode; all tasks have one job in 10 ms."""
    jobs = [[job(system, t, 0, start, units) for t, start, units in part] for part in (first, second)]
    return plan_of(system, table("one", 10, *jobs[0]), table("two", 10, *jobs[1]))


def only_a(first=0, second=0, **changes):
    system = two_modes(**changes)
    return system, tables(system, [("a", first, "u1")], [("a", second, "u1")])


def extra(system, start, units="u1", name="a", version=None, index=0):
    return replace(job(system, name, 0, start, units, version), index=index)


def test_tables_that_fit_end_to_end_need_no_table_between():
    system, plan = only_a()
    assert not errors(system, switch(plan, 0))


def test_allowed_switches_without_a_table_are_notes():
    system, plan = only_a(transitions=())
    found = verify(system, plan)
    assert [(d.code, d.path, d.is_error) for d in found] == [
        (codes.NO_TABLE.id, 'transition "one" to "two"', False),
        (codes.NO_TABLE.id, 'transition "two" to "one"', False),
    ]
    assert codes_found(*only_a()) == [codes.NO_TABLE.id]


def test_a_switch_that_was_not_found_is_a_warning():
    system, plan = only_a()
    found = verify(system, switch(plan, 0, status=Status.NOT_FOUND))
    assert [(d.code, str(d.severity)) for d in found] == [(codes.SWITCH_NOT_FOUND.id, "warning")]


def test_switches_that_are_not_allowed_or_given_twice():
    system, plan = only_a()
    assert codes.NOT_ALLOWED.id in codes_found(system, switch(plan, 0, source="two", target="one"))
    assert codes.NOT_ALLOWED.id in codes_found(system, switch(plan, 0, target="nowhere"))
    only(system, switch(switch(plan, 0), 0), codes.REPEATED_TABLE)


def test_length_keeps_its_limit():
    system, plan = only_a(transitions=(("one", "two", 3),), second=2)
    assert not errors(system, switch(plan, 3))
    system, plan = only_a(transitions=(("one", "two", 2),), second=2)
    assert "takes 3ms, the model allows at most 2ms" in only(system, switch(plan, 3), codes.TOO_LONG)
    negative = switch(plan, 0)
    table_ = replace(negative.transitions[0], length=ms(0) - ms(1), worst_latency=ms(9))
    assert codes.TOO_LONG.id in codes_found(system, replace(negative, transitions=(table_,)))


def test_worst_latency_is_the_hyperperiod_plus_the_length():
    system, plan = only_a()
    given = switch(plan, 0)
    lie = replace(given, transitions=(replace(given.transitions[0], worst_latency=ms(11)),))
    text = only(system, lie, codes.WRONG_FIGURE)
    assert "worst latency 11ms; hyperperiod and length make 10ms" in text


def test_starts_lie_in_the_table_and_jobs_are_numbered():
    system, plan = only_a()
    good = extra(system, 0)
    assert not errors(system, switch(plan, 10, good))
    late = switch(plan, 10, good, extra(system, 10, "u2", index=1))
    assert "starts at 10ms, outside [0, 10ms)" in " ".join(messages(system, late, codes.BAD_START))
    twice = switch(plan, 20, good, extra(system, 10))
    only(system, twice, codes.REPEATED_JOB)
    assert not errors(system, switch(plan, 20, good, extra(system, 10, index=1)))
    wrong = switch(plan, 10, replace(good, end=ms(5)))
    only(system, wrong, codes.WRONG_END)


def test_a_task_may_not_starve():
    system, plan = only_a(first=0, second=0)
    assert not errors(system, switch(plan, 5))  # 15 ms from start to start: (1 + 1/2) * 10
    text = only(system, switch(plan, "5000001ns"), codes.STARVED)
    assert 'starts at 5.000001ms after the switch, 15.000001ms after "a" job 0 of mode "one"; at most 15ms' in text
    assert "1ns too late" in text
    with_job = switch(plan, 20, extra(system, 5))
    assert not errors(system, with_job)
    assert codes.STARVED.id in codes_found(system, switch(plan, 20, extra(system, "4999999ns")))
    assert codes.STARVED.id in codes_found(system, switch(plan, 20, extra(system, "5000001ns")))


def test_a_task_may_not_run_against_itself():
    system = two_modes()
    plan = tables(system, [("a", 8, "u1")], [("a", 2, "u2")])  # until 2 after the switch, from 2
    assert not errors(system, switch(plan, 0))
    early = tables(system, [("a", 8, "u1")], [("a", "1999999ns", "u2")])
    assert 'while "a" job 0 of mode "one" runs until 2ms: 1ns too early' in only(
        system, switch(early, 0), codes.AGAINST_ITSELF
    )
    assert codes.AGAINST_ITSELF.id in codes_found(system, switch(plan, 4, extra(system, 1, "u2")))


def test_units_are_held_across_the_switch():
    system = two_modes((A,), (B,))
    plan = tables(system, [("a", 8, "u1")], [("b", 1, "u1")])
    text = only(system, switch(plan, 0), codes.OVERLAP)
    assert 'by "a" job 0 of mode "one" and "b" job 0 of mode "two" from 1ms to 2ms' in text
    assert not errors(system, switch(plan, 1))
    barely = tables(system, [("a", "6000001ns", "u1")], [("b", "0ms", "u1")])
    assert "from 0ms to 1ns: 1ns of overlap" in only(system, switch(barely, 0), codes.OVERLAP)
    other = tables(system, [("a", 8, "u1")], [("b", 1, "u2")])
    assert not errors(system, switch(other, 0))
    # what mode two wraps round to its beginning was never started the first time
    wrapped = tables(system, [("a", 8, "u1")], [("b", 8, "u1")])
    assert not errors(system, switch(wrapped, 0))


def test_what_is_wrong_within_a_mode_is_reported_by_the_mode_alone():
    system = two_modes((A, B), (A, B))
    fine = [("a", 0, "u1"), ("b", 1, "u2")]
    before = tables(system, [("a", 7, "u1"), ("b", 8, "u1")], [("a", 2, "u2"), ("b", 6, "u2")])
    assert 'mode "one" unit "u1"' in only(system, switch(before, 0), codes.OVERLAP)
    after = tables(system, fine, [("a", 0, "u1"), ("b", 1, "u1")])
    assert 'mode "two" unit "u1"' in only(system, switch(after, 0), codes.OVERLAP)
    # but what a job of the other mode adds to it belongs to the switch
    both = tables(system, [("a", 7, "u1"), ("b", 8, "u1")], [("a", 1, "u1"), ("b", 6, "u2")])
    found = messages(system, switch(both, 0), codes.OVERLAP)
    assert [line.split(' unit "u1"')[0] for line in found] == ['mode "one"', 'transition "one" to "two"']


def test_the_table_shares_units_with_both_modes():
    system = two_modes((A,), (A, B))
    plan = tables(system, [("a", 6, "u2")], [("a", 6, "u2"), ("b", 0, "u1")])
    text = only(system, switch(plan, 2, extra(system, 1, "u1")), codes.OVERLAP)
    assert 'held by "a" job 0 of the table and "b" job 0 of mode "two" from 2ms to 5ms' in text
    assert not errors(system, switch(plan, 2, extra(system, 1, "u2")))


def test_resources_are_shared_across_the_switch():
    c = task("c", 10, version("v", 4, "u1", access("r", "0ms", "4ms", "2/3")))
    d = task("d", 10, version("v", 4, "u2", access("r", "0ms", "4ms", "2/3")))
    system = two_modes((c,), (d,), resources="r")
    plan = tables(system, [("c", 8, "u1")], [("d", 1, "u2")])
    text = only(system, switch(plan, 0), codes.OVERLOAD)
    assert 'from 1ms to 2ms by "c" job 0 of mode "one" and "d" job 0 of mode "two": 1/3 too much' in text
    assert not errors(system, switch(plan, 1))


@pytest.mark.parametrize(("phase", "end"), [((80, 90), "85ms"), ((79, 80), None)])
def test_a_job_in_progress_may_take_a_resource_cycles_later(phase, end):
    """Here in the eighth cycle of mode two, or at an end of a claim there."""
    c = task("c", 100, version("v", 90, "u1", access("r", *phase)))
    d = task("d", 10, version("v", 5, "u2", access("r", "0ms", "5ms")))
    system = two_modes((c,), (d,), resources="r")
    plan = plan_of(
        system, table("one", 100, job(system, "c", 0, 95, "u1")), table("two", 10, job(system, "d", 0, 0, "u2"))
    )
    if end:
        text = only(system, switch(plan, 0), codes.OVERLOAD)
        assert f'from 80ms to {end} by "c" job 0 of mode "one" and "d" job 0 of mode "two": 1 too much' in text
    else:
        text = only(system, switch(plan, 4), codes.OVERLOAD)
        assert "from 74ms to 75ms" in text
        assert not errors(system, switch(plan, 9))


@pytest.mark.parametrize(("version", "units", "code"), [("w", "u1", "WRONG_VERSION"), ("v", "u1 u2", "WRONG_UNIT")])
def test_the_table_uses_versions_and_units_of_the_mode_to_come(version, units, code):
    system, plan = only_a()
    two = system.modes[1]
    fewer = replace(two, runs=(replace(two.runs[0], versions=("v",)),))
    system = replace(system, modes=(system.modes[0], fewer))
    only(system, switch(plan, 10, extra(system, "0ms", units, version=version)), getattr(codes, code))


def test_a_task_that_leaves_is_not_started():
    system = two_modes((A, B), (A,))
    plan = tables(system, [("a", 0, "u1"), ("b", 0, "u2")], [("a", 0, "u1")])
    found = switch(plan, 10, extra(system, "0ms"), extra(system, "0ms", "u2", "b"))
    assert 'task "b" job 0: starts at 0ms' in only(system, found, codes.STARTED_AFTER_LEAVING)
    assert not errors(system, switch(plan, 0))


# ------------------------------------------------------------------------------------------------ precedence

FIRST = task("first", 10, version("v", 2, "u1"), slack=1)


def following(low, high, anchor="start"):
    return task("then", 10, version("v", 2, "u2", after("first", low, high, anchor)), slack=1)


def test_predecessors_come_from_the_mode_before():
    then = following(4, 6)
    system = two_modes((FIRST, then), (FIRST, then))
    plan = tables(system, [("first", 7, "u1"), ("then", 2, "u2")], [("first", 7, "u1"), ("then", 2, "u2")])
    assert not errors(system, switch(plan, 0))
    assert not errors(system, switch(plan, 1))
    text = only(system, switch(plan, 2), codes.OUT_OF_WINDOW)
    assert 'starts at 4ms after the switch and needs a job of "first" whose start lies [4ms, 6ms] before' in text
    assert 'the nearest, "first" job 0, lies 7ms before' in text
    # a job in the table serves as well
    served = extra(system, "0ms", "u1", "first")
    assert not errors(system, switch(plan, 2, served))
    # and the jobs of the table have predecessors of their own
    assert not errors(system, switch(plan, 4, served, extra(system, 1, "u2", "then")))
    early = switch(plan, 4, served, extra(system, "0ms", "u2", "then"))
    assert 'task "then" job 0 of the table: starts at 0ms' in only(system, early, codes.OUT_OF_WINDOW)


def test_predecessors_may_lie_more_than_two_cycles_back():
    then = following(31, 31)
    system = two_modes((FIRST, then), (FIRST, then))
    plan = tables(system, [("first", 0, "u1"), ("then", 1, "u2")], [("first", 0, "u1"), ("then", 1, "u2")])
    assert not errors(system, switch(plan, 0))


@pytest.mark.parametrize("last", [23, 24, 28])
def test_a_predecessor_may_be_missed_in_the_third_cycle_first(last):
    """Two cycles find theirs at -27 and -17 ms; the third looks for one from -7 to -6 ms."""
    first = replace(FIRST, slack=Fraction(1, 2))
    then, other = following(35, 36), task("other", 30, version("v", 1, "u2"))
    system = two_modes((first, other), (first, then))
    before = [replace(job(system, "first", 0, at, "u1"), index=n) for n, at in enumerate((3, 13, last))]
    one = table("one", 30, *before, job(system, "other", 0, 0, "u2"))
    two = table("two", 10, job(system, "first", 0, 4, "u1"), job(system, "then", 0, 9, "u2"))
    plan = switch(plan_of(system, one, two), 0)
    if last == 28:
        assert "starts at 29ms after the switch" in only(system, plan, codes.OUT_OF_WINDOW)
    else:
        assert not errors(system, plan)


@pytest.mark.parametrize(("phase", "misses"), [(0, False), (3, True)])
def test_a_window_may_reach_back_over_millions_of_cycles(phase, misses):
    """All of them look at one instant of the mode before, as both repeat alike."""
    then = following(20_000_000, 20_000_002)
    system = two_modes((FIRST, then), (FIRST, then))
    plan = tables(system, [("first", 0, "u1"), ("then", 0, "u2")], [("first", phase, "u1"), ("then", phase, "u2")])
    if misses:
        assert "starts at 3ms after the switch" in only(system, switch(plan, 0), codes.OUT_OF_WINDOW)
    else:
        assert not errors(system, switch(plan, 0))


def test_windows_that_differ_in_too_many_cycles_are_refused():
    slow, then = task("slow", 999_983, version("v", 1, "u1")), following(10**12, 10**12 + 10)
    system = two_modes((FIRST, slow), (FIRST, then))
    one = table("one", 999_983, job(system, "slow", 0, 0, "u1"))
    two = table("two", 10, job(system, "first", 0, 0, "u1"), job(system, "then", 0, 5, "u2"))
    found = errors(system, switch(plan_of(system, one, two), 0))
    assert any("looks at another instant of the old mode in too many cycles" in text for text in found)


def test_a_task_that_enters_may_start_early_where_needed():
    then = following(4, 6)
    system = two_modes((A,), (A, FIRST, then))
    plan = tables(system, [("a", 5, "u2")], [("a", 5, "u2"), ("first", 9, "u1"), ("then", 3, "u2")])
    assert codes_found(system, switch(plan, 0)) == [codes.OUT_OF_WINDOW.id]
    assert not errors(system, switch(plan, 3, extra(system, "0ms", "u1", "first")))
    assert not errors(system, switch(plan, 3, extra(system, 2, "u1", "first")))
    found = codes_found(system, switch(plan, 3, extra(system, "2000001ns", "u1", "first")))
    assert found == [codes.OUT_OF_WINDOW.id, codes.STARTED_EARLY.id]


def test_a_task_that_enters_may_be_needed_by_a_later_cycle():
    """The job of `then` at 16 ms looks back to 0 to 2 ms; that at 6 ms finds nothing, as before any other start."""
    system = two_modes((A,), (A, FIRST, following(14, 16)))
    plan = tables(system, [("a", 5, "u2")], [("a", 5, "u2"), ("first", 9, "u1"), ("then", 3, "u2")])
    for start in ("0ms", "2ms"):
        assert codes.STARTED_EARLY.id not in codes_found(system, switch(plan, 3, extra(system, start, "u1", "first")))
    late = switch(plan, 3, extra(system, "2000001ns", "u1", "first"))
    assert codes.STARTED_EARLY.id in codes_found(system, late)


def test_a_task_that_enters_may_be_needed_by_a_job_of_the_table():
    """Mode two needs nothing, as then is free there. The job of the table needs a start 4 to 6 ms before its own."""
    then = task("then", 10, version("v", 2, "u2", after("first", 4, 6)), version("free", 2, "u2"), slack=1)
    system = two_modes((A,), (A, FIRST, then))
    two = [job(system, "a", 0, 5, "u1"), job(system, "first", 0, 1, "u1"), job(system, "then", 0, 7, "u2", "free")]
    plan = plan_of(system, table("one", 10, job(system, "a", 0, 5, "u1")), table("two", 10, *two))
    for start, is_needed in ((2, True), (0, True), ("2000001ns", False)):
        early = [extra(system, ms(start), "u1", "first"), extra(system, 6, "u2", "then", "v")]
        found = messages(system, switch(plan, 9, *early), codes.STARTED_EARLY)
        tasks = [text.split(" job")[0].split(" task ")[1] for text in found]
        assert tasks == (['"then"'] if is_needed else ['"first"', '"then"'])


def test_a_need_from_the_end_counts_from_the_end():
    then = following(4, 6, "end")
    system = two_modes((A,), (A, FIRST, then))
    plan = tables(system, [("a", 5, "u2")], [("a", 5, "u2"), ("first", 7, "u1"), ("then", 3, "u2")])
    assert not errors(system, switch(plan, 4, extra(system, 1, "u1", "first")))
    assert codes.STARTED_EARLY.id in codes_found(system, switch(plan, 4, extra(system, 2, "u1", "first")))


def test_a_task_that_enters_may_not_start_early_without_need():
    system = two_modes((A,), (A, B))
    plan = tables(system, [("a", 0, "u1")], [("a", 0, "u1"), ("b", 0, "u2")])
    found = switch(plan, 10, extra(system, "0ms"), extra(system, "0ms", "u2", "b"))
    assert 'task "b" job 0 of the table: starts at 0ms' in only(system, found, codes.STARTED_EARLY)


# ------------------------------------------------------------------------------------------------ chains


def test_chains_keep_their_limits_across_the_switch():
    c = task("c", 10, version("v", 2, "u1"), slack=1)
    d = task("d", 10, version("v", 2, "u2"), slack=1)
    # steady: c@0 to 2, d@2 to 4: age 4, reaction 14
    for length, reaction, age in [(0, 14, 4), (3, 17, 4), (9, 23, 4)]:
        system = two_modes((c, d), (c, d), chains=[chain("k", "c d", reaction, age)])
        plan = tables(system, [("c", 0, "u1"), ("d", 2, "u2")], [("c", 0, "u1"), ("d", 2, "u2")])
        assert not errors(system, switch(plan, length))
        if length:
            tight = replace(system, chains=(chain("k", "c d", reaction - 1, age),))
            text = only(tight, switch(plan, length), codes.CHAIN_LIMIT)
            assert f'reaction time {reaction}ms for "c" job 0 of mode "one" at -10ms' in text
            assert "across the switch" in text


def test_data_may_not_get_too_old_across_the_switch():
    c = task("c", 10, version("v", 2, "u1"), slack=1)
    d = task("d", 10, version("v", 2, "u2"), slack=1)
    system = two_modes((c, d), (c, d), chains=[chain("k", "c d", None, 14)])
    plan = tables(system, [("c", 0, "u1"), ("d", 2, "u2")], [("c", 5, "u1"), ("d", 4, "u2")])
    # d at L + 4 reads c@-10: ends at L + 6, so the age is 16 + L
    text = only(system, switch(plan, 0), codes.CHAIN_LIMIT)
    assert 'data age 16ms for "d" job 0 of mode "two" at 4ms, the limit is 14ms: 2ms too long' in text


def test_chains_of_tasks_that_run_in_only_one_mode_are_left_alone():
    system = two_modes((A, B), (A,), chains=[chain("k", "a b", 14, 100)])
    plan = tables(system, [("a", 0, "u1"), ("b", 4, "u2")], [("a", 0, "u1")])
    assert len(messages(system, switch(plan, 0), codes.CHAIN_LIMIT)) == 1  # mode one's own, 18 ms
    system = two_modes((A,), (A, B), chains=[chain("k", "a b", 18, 100)])
    plan = tables(system, [("a", 0, "u1")], [("a", 0, "u1"), ("b", 4, "u2")])
    assert not errors(system, switch(plan, 5))


def relayed(first, second, chains):
    """Modes of c and d, by where their jobs start: once or twice each, in a hyperperiod of 10 or 20 ms."""
    c = task("c", 10, version("v", 2, "u1 u3"), version("long", 10, "u1"), slack=1, deadline=30)
    d = task("d", 10, version("v", 2, "u2"), slack=1, deadline=30)
    slow = task("slow", 20, version("v", 1, "u4"))
    parts = [part if len(part) == 2 else [*part, ("slow", "0ms", "u4")] for part in (first, second)]
    runs = [(c, d) if len(part) == 2 else (c, d, slow) for part in parts]
    modes = [mode(name, tasks) for name, tasks in zip(("one", "two"), runs, strict=True)]
    system = model(c, d, slow, units="u1 u2 u3 u4", modes=modes, transitions=(("one", "two", 20),), chains=chains)
    made = []
    for name, part in zip(("one", "two"), parts, strict=True):
        jobs = [job(system, task_, 0, *where) for task_, *where in part]
        numbered = [replace(j, index=[k.task for k in jobs[:n]].count(j.task)) for n, j in enumerate(jobs)]
        made.append(table(name, 10 if len(part) == 2 else 20, *numbered))
    return system, switch(plan_of(system, *made), 0)


def test_a_chain_may_cross_a_switch_from_three_cycles_before():
    """Missed by c at -29, seen at -19, out at -9, where d starts no more: it reads at 5 in the mode to come."""
    first, second = [("c", 1, "u1", "long"), ("d", "0ms", "u2")], [("c", 1, "u1", "long"), ("d", 5, "u2")]
    system, plan = relayed(first, second, [chain("k", "c d", 36)])
    assert messages(system, plan, codes.CHAIN_LIMIT) == []
    system, plan = relayed(first, second, [chain("k", "c d", 35)])
    assert 'reaction time 36ms for "c" job 0 of mode "one" at -29ms' in only(system, plan, codes.CHAIN_LIMIT)


def test_a_path_whose_last_job_starts_with_the_switch_crosses_it():
    """After c at -20: c at -10 to -8, d at 0. That d belongs to mode two; mode one by itself takes till 3."""
    first, second = (
        [("c", "0ms", "u1"), ("d", 1, "u2")],
        [("c", "0ms", "u1"), ("c", 10, "u1"), ("d", "0ms", "u2"), ("d", 4, "u2")],
    )
    system, plan = relayed(first, second, [chain("k", "c d", 21)])
    assert not [text for text in errors(system, plan) if codes.CHAIN_LIMIT.id not in text]
    assert [text.split(" for ")[0] for text in messages(system, plan, codes.CHAIN_LIMIT)] == [
        'mode "one" chain "k": reaction time 23ms',
        'mode "two" chain "k": reaction time 22ms',
        'transition "one" to "two" chain "k": reaction time 22ms',
    ]


def test_a_path_that_begins_with_the_mode_to_come_is_its_own_matter():
    system, plan = relayed(
        [("c", "0ms", "u1"), ("d", 2, "u2")], [("c", "0ms", "u1"), ("d", 6, "u2")], [chain("k", "c d", None, 7)]
    )
    (text,) = messages(system, plan, codes.CHAIN_LIMIT)
    assert text.startswith('mode "two" chain "k": data age 8ms')


def test_of_jobs_a_nanosecond_apart_before_a_switch_the_second_is_the_next():
    """Missed by c at -10 ms, a stimulus is seen at 5; missed a nanosecond before, by c at -10 ms."""
    first = [("c", "9999999ns", "u1"), ("c", 10, "u3"), ("d", 5, "u2"), ("d", 15, "u2")]
    system, plan = relayed(first, [("c", 5, "u1"), ("d", 9, "u2")], [chain("k", "c d", 21)])
    assert not [text for text in messages(system, plan, codes.CHAIN_LIMIT) if text.startswith("transition")]


def test_chains_of_three_tasks_are_traced_through_all_of_them():
    """e at 6 reads d at 3, which reads c at 0; after the switch e at 6 reads d at 3 and c of mode one, at -10."""
    tasks = [task(name, 10, version("v", 2, f"u{n}"), slack=1) for n, name in enumerate("cde", 1)]
    starts = {"c": ["0ms", 4], "d": [3, 3], "e": [6, 6]}
    for limit, told in ((18, 0), (17, 1)):
        system = model(
            *tasks,
            units="u1 u2 u3",
            modes=[mode("one", tasks), mode("two", tasks)],
            transitions=(("one", "two", 20),),
            chains=[chain("k", "c d e", None, limit)],
        )
        made = [
            table(name, 10, *(job(system, t, 0, starts[t][n], f"u{i}") for i, t in enumerate("cde", 1)))
            for n, name in enumerate(("one", "two"))
        ]
        found = [
            text
            for text in messages(system, switch(plan_of(system, *made), 0), codes.CHAIN_LIMIT)
            if text.startswith("transition")
        ]
        assert len(found) == told, found


# ------------------------------------------------------------------------------------------------ not neighbours


def long_and_short():
    """A job of the old mode runs from 20 to 45 ms, a short one of its task starts at 30; the switch is at 40."""
    long, short = version("long", 25, "u1"), version("short", 2, "u2")
    owner, other = task("t", 10, long, short, slack=1, deadline=40), task("s", 40, version("v", 1, "u3"), slack=1)
    modes = [mode("one", (owner, other)), mode("two", (owner, other))]
    system = model(owner, other, units="u1 u2 u3", modes=modes, transitions=(("one", "two", 20),))
    ticking = [job(system, "t", k, 10 * k, "u2", "short") for k in range(4)]
    lasting = [job(system, "t", 2, 20, "u1", "long") if k == 2 else one for k, one in enumerate(ticking)]
    still = job(system, "s", 0, 0, "u3")
    return system, plan_of(system, table("one", 40, *lasting, still), table("two", 40, *ticking, still))


def test_a_job_does_not_start_before_one_has_ended_that_is_not_its_neighbour():
    system, plan = long_and_short()
    assert only(system, switch(plan, 0), codes.AGAINST_ITSELF).endswith("5ms too early")
    assert not errors(system, switch(plan, 5))
