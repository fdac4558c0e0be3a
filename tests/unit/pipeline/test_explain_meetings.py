"""What parts and groups of tasks have in common, by hand: pairs, chains of parts, and groups within their limits."""

from fractions import Fraction

import pytest
from split_helpers import points, split

from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.meetings import (
    Budget,
    Group,
    Part,
    _pairs,
    _part,
    _without_surplus,
    crowds,
    find_meeting,
    join,
    meet,
    meet_in_groups,
)
from halpipe.pipeline.validate.context import Context
from support import model, ms, task, version


def part(name, period, length, height=1):
    return Part(name, period, length, height)


def group(name, period, length):
    return Group((part(name, period, length),), period, length)


def facts_of(*tasks, units="u1 u2", resources=""):
    context = Context(model(*tasks, units=units, resources=resources))
    return mode_facts(context.active[0], context.units)


def named(found):
    return [tuple(each.task for each in pair) for pair in found]


# ------------------------------------------------------------------------------------------------ parts


@pytest.mark.parametrize(("steps", "left"), [(0, [False] * 3), (1, [True, False, False]), (2, [True, True, False])])
def test_a_budget_has_as_many_steps_as_it_is_given(steps, left):
    budget = Budget(steps)
    assert [budget.spend() for _ in left] == left


def test_what_parts_have_in_common_is_no_longer_than_any_of_them():
    """Of 12 ms, 9 and 7 are together for 2 at least; with 11 that is half of what exceeds 12."""
    found = meet([part("a", 12, 9), part("b", 12, 7), part("c", 24, 12)], Budget())
    assert [(step.gcd, step.together) for step in found] == [(0, 9), (12, 2), (12, 1)]
    assert [step.together for step in meet([part("a", 10, 10), part("b", 10, 3)], Budget())] == [10, 1]
    assert [step.together for step in meet([part("a", 60, 60), part("b", 6, 6)], Budget())] == [60, 6]
    assert [step.together for step in meet([part("a", 6, 6), part("b", 60, 60)], Budget())] == [6, 6]
    assert not meet([part("a", 12, 6), part("b", 12, 6)], Budget())


def test_a_meeting_takes_a_step_for_every_further_part():
    three = [part("a", 12, 11), part("b", 12, 11), part("c", 12, 11)]
    assert meet(three, Budget(2))
    assert not meet(three, Budget(1))


def test_pairs_are_the_longest_of_every_two_periods():
    parts = [part("a", 10, 6), part("b", 10, 5), part("c", 10, 4), part("d", 15, 7), part("e", 6, 3), part("f", 6, 3)]
    assert named(_pairs(parts, 1)) == [("d", "a"), ("d", "e"), ("a", "b"), ("a", "e"), ("e", "f")]


def test_pairs_are_of_parts_that_take_more_than_half_of_the_capacity():
    parts = [part("a", 10, 6, 2), part("b", 15, 5, 3), part("c", 6, 4, Fraction(21, 10))]
    assert named(_pairs(parts, 4)) == [("b", "c")]
    assert named(_pairs(parts, 3)) == [("a", "b"), ("a", "c"), ("b", "c")]


def test_what_fills_the_capacity_exactly_is_no_witness_though_others_are_beside_it():
    assert not find_meeting([part("a", 10, 6), part("b", 10, 6), part("c", 10, 1)], 2, Budget())
    assert not find_meeting([part("a", 10, 6, 2), part("b", 10, 6, 2), part("c", 90, 1)], 4, Budget())
    three = [part("a", 12, 11), part("b", 12, 11), part("c", 12, 11)]
    assert find_meeting(three, 2, Budget())
    assert not find_meeting(three, 3, Budget())


def test_a_set_grows_around_parts_though_the_longest_meets_none():
    """8 and 4 of 12, or of 18, leave each other room; 4 and 4 of 6 do not."""
    parts = [part("a", 36, 8), part("b", 12, 4), part("c", 18, 4, 2)]
    assert [step.part.task for step in find_meeting(parts, 2, Budget())] == ["b", "c"]
    assert not find_meeting(parts, 3, Budget())


def test_a_set_grows_around_the_busiest_part_though_longer_ones_meet_none():
    longer = [part(f"a{n}", 36, 8) for n in range(3)]
    parts = [*longer, part("b", 12, 4), part("c", 18, 4, 2)]
    assert [step.part.task for step in find_meeting(parts, 2, Budget())] == ["b", "c"]


def test_what_has_room_is_no_effort():
    budget = Budget(3)
    assert not find_meeting([part("a", 10, 10, 2), part("b", 10, 10, 1)], 3, budget)
    assert budget.steps == 3


def test_surplus_is_what_the_capacity_is_passed_without():
    parts = [part("a", 10, 9, 1), part("b", 10, 9, 2), part("c", 10, 9, 2)]
    assert [step.part.task for step in _without_surplus(parts, 3)] == ["b", "c"]
    assert [step.part.task for step in _without_surplus(parts, 4)] == ["a", "b", "c"]


# ------------------------------------------------------------------------------------------------ groups


def test_what_two_groups_have_in_common_recurs_with_both():
    found = join(group("a", 10, 7), group("b", 15, 4))
    assert (found.names, found.period, found.length, found.over) == (("a", "b"), 30, 3, 6)
    assert join(group("a", 60, 60), group("b", 6, 2)).length == 2
    assert join(group("a", 60, 60), group("b", 6, 6)).length == 6
    assert join(group("a", 10, 2), group("b", 15, 5)).length == 1
    assert join(group("a", 10, 2), group("b", 15, 4)) is None


def test_a_common_time_below_one_tick_is_none():
    assert join(group("a", 10, 6), group("b", 10, 5)) is None
    assert join(group("a", 10, 6), group("b", 10, 6)).length == 1


@pytest.mark.parametrize("order", [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]])
def test_groups_are_joined_in_any_order(order):
    """The first two leave 6 of 30 ms, which the third meets; neither of them leaves the other much beside it."""
    rows = [part("a", 10, 9), part("b", 15, 8), part("c", 6, 5)]
    found = meet_in_groups([rows[n] for n in order], Budget())
    assert sorted(found.names) == ["a", "b", "c"]
    assert meet_in_groups(rows, Budget()).names == ("c", "a", "b")
    assert meet_in_groups(rows[:1], Budget()).names == ("a",)
    assert meet_in_groups([*rows, part("d", 7, 0)], Budget()) is None


def test_of_one_rate_those_are_joined_first_that_just_meet():
    rows = [part("a", 12, 11), part("b", 12, 10), part("c", 12, 10), part("d", 18, 18)]
    found = meet_in_groups(rows, Budget())
    assert (found.names, found.length) == (("d", "a", "b", "c"), 1)


def test_parts_that_need_not_meet_are_no_group():
    assert meet_in_groups([part("a", 10, 5), part("b", 10, 5)], Budget()) is None
    assert meet_in_groups([part("a", 10, 6), part("b", 10, 6)], Budget(0)) is None


# ------------------------------------------------------------------------------------------------ tasks in a crowd


@pytest.mark.parametrize(("count", "is_found"), [(16, True), (17, False)])
def test_crowds_are_looked_for_on_up_to_sixteen_units(count, is_found):
    units = " ".join(f"u{n}" for n in range(count))
    tasks = [task(name, 10, version("v", 9, units, gang=8)) for name in "abc"]
    assert bool([*crowds(facts_of(*tasks, units=units))]) == is_found


def test_of_a_task_counts_what_every_job_runs_beside_the_held_units():
    both = [version("v", 3, "u1 u2", gang=2), version("w", 4, "u2")]
    tasks = [
        task("either", 10, *both),
        task("late", 10, version("v", 3, "u2"), slack="3/10"),
        task("later", 10, version("v", "3000001ns", "u2"), slack="3/10"),
        task("paused", 10, version("v", 3, "u2"), split(version("w", 3, "u2"), points(1))),
    ]
    facts = facts_of(*tasks)
    free, held = ({name: _part(own, units) for name, own in facts.tasks.items()} for units in (set(), {"u1"}))
    assert {name: (p.length, p.height) for name, p in free.items() if p} == {
        "either": (facts.ticks(ms(3)), 1),
        "later": (1, 1),
    }
    assert {name: (p.length, p.height) for name, p in held.items() if p} == {
        "either": (facts.ticks(ms(4)), 1),
        "later": (1, 1),
    }
    assert [_part(own, {"u1", "u2"}) for own in facts.tasks.values()] == [None] * 4
