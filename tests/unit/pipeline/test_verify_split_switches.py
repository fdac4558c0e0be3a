"""What verify says of bound tasks and of split jobs across switches (MODEL 8)."""

from dataclasses import replace

import pytest
from split_helpers import parted, points, split
from verify_helpers import codes_found, errors, messages, only, plan_of, switch, table

from halpipe.models import Binding, Split
from halpipe.pipeline.verify import codes
from support import job, mode, model, ms, schedule, task, version

# ------------------------------------------------------------------------------------------------ binding


def bound(how, *units):
    owner = replace(task("a", 10, version("v", 2, "u1 u2 u3")), binding=how)
    system = model(owner, task("b", 10 * len(units), version("v", 1, "u4")), units="u1 u2 u3 u4")
    jobs = [job(system, "a", k, 10 * k, u) for k, u in enumerate(units)]
    return system, schedule(system, 10 * len(units), *jobs, job(system, "b", 0, 0, "u4"))


def test_an_unbound_task_moves_as_it_likes():
    assert not errors(*bound(Binding.JOB, "u1", "u2", "u3"))


@pytest.mark.parametrize("how", [Binding.MODE, Binding.SYSTEM])
def test_a_bound_task_keeps_to_its_unit(how):
    assert not errors(*bound(how, "u1", "u1", "u1"))
    found = only(*bound(how, "u1", "u2", "u2"), codes.NOT_BOUND)
    assert 'task "a" job 0: is on "u1", but its task is bound, and most of its jobs use "u2"' in found


def two_modes(how, first, second, *early, span=10):
    """Task a in two modes, on the units given, and in the table of length 10 between them."""
    owner = replace(task("a", 10, version("v", 2, "u1 u2"), slack=1), binding=how)
    system = model(
        owner, units="u1 u2", modes=[mode("one", [owner]), mode("two", [owner])], transitions=[("one", "two", 20)]
    )
    tables = [table(name, 10, job(system, "a", 0, 0, unit)) for name, unit in (("one", first), ("two", second))]
    jobs = [job(system, "a", 0, 0, unit) for unit in early]
    return system, switch(plan_of(system, *tables), span if early else 0, *jobs)


def test_modes_may_use_other_units_unless_the_whole_system_is_bound():
    assert not errors(*two_modes(Binding.MODE, "u1", "u2"))
    assert not errors(*two_modes(Binding.SYSTEM, "u1", "u1"))
    found = only(*two_modes(Binding.SYSTEM, "u1", "u2"), codes.NOT_BOUND)
    assert 'mode "two" task "a": uses "u2" here and "u1" elsewhere' in found


def test_a_table_uses_the_units_of_the_mode_to_come():
    assert not errors(*two_modes(Binding.MODE, "u1", "u2", "u2"))
    found = only(*two_modes(Binding.MODE, "u1", "u2", "u1"), codes.NOT_BOUND)
    assert found.startswith('transition "one" to "two"')
    assert not errors(*two_modes(Binding.JOB, "u1", "u2", "u1"))


# ------------------------------------------------------------------------------------------------ switches


def in_progress(gap_end, second_period=4):
    """Mode one leaves a job with a gap from 2 ms before the switch; mode two runs c every `second_period` ms."""
    how = Split(anywhere=True, max_gaps=1)
    a = task("a", 40, split(version("v", 4), how))
    c = task("c", second_period, version("v", 1))
    system = model(a, c, modes=[mode("one", [a]), mode("two", [c])], transitions=[("one", "two", 20)])
    outer = parted("a", 0, "u1", (36, 38, 0, 2), (gap_end, gap_end + 2, 2, 4))
    starts = [job(system, "c", 0, 1, "u1")]
    return system, switch(plan_of(system, table("one", 40, outer), table("two", second_period, *starts)), 0)


def test_jobs_in_progress_keep_their_parts():
    """The last part lies at 2 ms after the switch, between the jobs of c at 1, 5, 9 ..."""
    assert not errors(*in_progress(42))
    assert codes.OVERLAP.id in codes_found(*in_progress(44))


def test_the_line_is_as_long_as_jobs_in_progress_last():
    """In the gap lie many cycles of mode two; the last part meets the ninth."""
    assert not errors(*in_progress(40 + 30))
    assert messages(*in_progress(40 + 32), codes.OVERLAP)


def test_nesting_across_a_switch():
    how = Split(anywhere=True, max_gaps=1)
    a, b = (task(name, 20, split(version("v", 4), how)) for name in "ab")
    system = model(a, b, modes=[mode("one", [a]), mode("two", [b])], transitions=[("one", "two", 20)])
    outer = parted("a", 0, "u1", (16, 18, 0, 2), (26, 28, 2, 4))

    def plan(*inner):
        return switch(plan_of(system, table("one", 20, outer), table("two", 20, parted("b", 0, "u1", *inner))), 0)

    assert not errors(system, plan((0, 2, 0, 2), (4, 6, 2, 4)))
    assert not errors(system, plan((8, 10, 0, 2), (12, 14, 2, 4)))
    found = only(system, plan((0, 2, 0, 2), (9, 11, 2, 4)), codes.NOT_NESTED)
    assert found.startswith('transition "one" to "two" unit "u1"')


def crossing_modes(*early, second=((0, 2, 0, 2), (4, 6, 2, 4))):
    """Tasks a and b, split once each, on one unit: both run in mode two, and only b, from 17 to 30 ms, in mode one."""
    how = Split(anywhere=True, max_gaps=1)
    a, b = (task(name, 20, split(version("v", 4), how), slack=1) for name in "ab")
    system = model(a, b, modes=[mode("one", [b]), mode("two", [a, b])], transitions=[("one", "two", 40)])
    one = table("one", 20, parted("b", 0, "u1", (17, 19, 0, 2), (28, 30, 2, 4)))
    two = table("two", 20, parted("a", 0, "u1", *second), parted("b", 0, "u1", (8, 10, 0, 2), (12, 14, 2, 4)))
    return system, switch(plan_of(system, one, two), 20, *early)


def test_jobs_of_the_table_are_nested_in_each_other():
    first = parted("b", 0, "u1", (11, 13, 0, 2), (15, 17, 2, 4))
    assert not messages(*crossing_modes(first, parted("a", 0, "u1", (13, 15, 0, 4))), codes.NOT_NESTED)
    across = parted("a", 0, "u1", (13, 15, 0, 2), (17, 19, 2, 4))
    (text,) = messages(*crossing_modes(first, across), codes.NOT_NESTED)
    assert text.startswith(
        'transition "one" to "two" unit "u1": "a" job 0 of the table lasts from 13ms to 19ms and "b"'
    )


def test_jobs_of_one_mode_that_are_not_nested_are_its_own_matter():
    found = messages(*crossing_modes(second=((6, 8, 0, 2), (10, 12, 2, 4))), codes.NOT_NESTED)
    assert [text.split(" unit")[0] for text in found] == ['mode "two"']


def test_jobs_are_nested_in_the_one_in_progress_that_ends_last():
    """c is over 1 ms after the switch and a after 8: b, from 2 to 4 and from 9 to 11, lies across its last part."""
    how = Split(anywhere=True, max_gaps=1)
    a, b = (task(name, 20, split(version("v", 4), how)) for name in "ab")
    c = task("c", 20, version("v", 3, "u2"))
    modes = [mode("one", [a, c]), mode("two", [b])]
    system = model(a, b, c, units="u1 u2", modes=modes, transitions=[("one", "two", 20)])
    outer = parted("a", 0, "u1", (16, 18, 0, 2), (26, 28, 2, 4))
    one = table("one", 20, outer, job(system, "c", 0, 18, "u2"))
    two = table("two", 20, parted("b", 0, "u1", (2, 4, 0, 2), (9, 11, 2, 4)))
    assert "neither lies in one gap" in only(system, switch(plan_of(system, one, two), 0), codes.NOT_NESTED)


def test_arrivals_are_served_across_a_switch():
    owner = replace(task("a", 10, version("v", 1), slack=1), distance=ms(14))
    system = model(owner, modes=[mode("one", [owner]), mode("two", [owner])], transitions=[("one", "two", 20)])

    def plan(start):
        tables = [table("one", 10, job(system, "a", 0, 0, "u1")), table("two", 10, job(system, "a", 0, start, "u1"))]
        return switch(plan_of(system, *tables), 0)

    assert not errors(system, plan(3))
    found = only(system, plan(4), codes.ARRIVAL_LATE)
    assert found.startswith('transition "one" to "two"')


def test_parts_of_a_table():
    how = points(2)
    a = task("a", 10, split(version("v", 4), how), slack=1)
    system = model(a, modes=[mode("one", [a]), mode("two", [a])], transitions=[("one", "two", 20)])
    tables = [table(name, 10, job(system, "a", 0, 0, "u1")) for name in ("one", "two")]
    good = parted("a", 0, "u1", (0, 2, 0, 2), (4, 6, 2, 4))
    assert not errors(system, switch(plan_of(system, *tables), 10, good))
    bad = parted("a", 0, "u1", (0, 3, 0, 3), (5, 6, 3, 4))
    assert only(system, switch(plan_of(system, *tables), 10, bad), codes.WRONG_GAP).startswith("transition")
