"""Plans of preemptive modes: the first one, each move to another, releases of tasks on demand, and jobs that stay."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, parted, points, split

from halpipe.models import ResourceKind, Split
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.edf.fixed import Claim, FixedJob, Walls, fix, window_excess
from halpipe.pipeline.solve.edf.plans import (
    Moves,
    Table,
    adopted,
    allowed_ways,
    first_plan,
    fits,
    fixed_phase,
    releases_of,
    together,
)
from halpipe.pipeline.solve.edf.search import Memory, State
from halpipe.pipeline.solve.edf.works import finer, lenient, works_of
from halpipe.pipeline.solve.integers import ints
from support import access, after, chain, job, model, ms, task, version


class Draws:
    """Numbers that were chosen before, each one that could be drawn; -1 is the largest of them."""

    def __init__(self, *numbers):
        self.numbers = list(numbers)

    def below(self, limit):
        number = self.numbers.pop(0)
        number = limit - 1 if number == -1 else number
        assert 0 <= number < limit
        return number


def mode_of(owner, *shipped, tick=None):
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, tick or natural_tick(expansion))
    fixed, changed = fix(mode, {(each.task, each.index): each for each in shipped})
    return replace(mode, fixed=fixed), changed


def begun(owner, *shipped):
    """The mode, its ways, and the plan to begin with."""
    mode, _ = mode_of(owner, *shipped)
    allowed = allowed_ways(mode, {})
    return mode, allowed, first_plan(mode, allowed)


# ------------------------------------------------------------------------------------------------ releases


def on_demand(period=20):
    """`a` demands `h` once or twice, and `h` demands `g`."""
    once = version("once", 1, "u1", after("h", 2, 6))
    twice = version("twice", 1, "u1", after("h", 3, 7, "end"), after("h", 0, 5))
    return model(
        task("g", None, version("v", 1, "u1")),
        task("h", None, version("v", 2, "u1", after("g", 1, 4)), version("short", 1, "u1", after("g", 1, 4))),
        task("a", period, once, twice, slack=1),
        task("long", 20, version("v", 1, "u1")),
    )


def named_releases(owner, *shipped, version_of_a="once", phase=0, holds=(0, 0, 0, 0)):
    mode, allowed, plan = begun(owner, *shipped)
    chosen = next(way for way in allowed[2] if way.version.name == version_of_a)
    plan = replace(plan, ways=(*plan.ways[:2], chosen, plan.ways[3]), phases=(0, 0, phase, 0), holds=holds)
    return {work.name: found for work, found in zip(mode.works[:3], releases_of(mode, plan), strict=False)}


def test_jobs_on_demand_are_released_with_the_job_that_the_chosen_version_demands_them_for():
    found = named_releases(on_demand(), phase=3, holds=(6, 5, 4, 0))
    assert found == {"a": [(7, 0)], "h": [(12, 0)], "g": [(18, 0)]}


def test_a_version_that_demands_two_jobs_releases_both():
    found = named_releases(on_demand(), version_of_a="twice", phase=3, holds=(0, 5, 0, 0))
    assert found == {"a": [(3, 0)], "h": [(8, 0), (8, 1)], "g": [(8, 0), (8, 1)]}


def test_jobs_for_one_that_stays_are_released_when_its_windows_open():
    """`a` starts at 10 ms: its first row opens 7 ms before, less the shorter version, its second one 5 ms before."""
    owner = on_demand()
    found = named_releases(owner, job(owner, "a", 0, 10, "u1", "twice"), version_of_a="twice")
    assert found == {"a": [], "h": [(2, 0), (5, 1)], "g": [(2, 0), (5, 1)]}
    found = named_releases(owner, job(owner, "a", 0, 2, "u1", "once"))
    assert found == {"a": [], "h": [(16, 0)], "g": [(16, 0)]}


def test_each_job_that_stays_demands_its_own():
    """Jobs of `a` stay at 8 and 19 ms, one with each version; the jobs for a second demand of the first are not."""
    owner = on_demand(period=10)
    shipped = (job(owner, "a", 0, 8, "u1", "once"), job(owner, "a", 1, 19, "u1", "twice"))
    found = named_releases(owner, *shipped, job(owner, "long", 0, 0, "u1"), version_of_a="twice")
    assert found == {"a": [], "h": [(2, 0), (11, 2), (14, 3)], "g": [(2, 0), (11, 2), (14, 3)]}


def test_releases_of_one_task_lie_within_a_hyperperiod_of_the_first():
    often = version("v", 1, "u1", after("h", 0, 5))
    owner = model(task("a", 10, often, slack=1), task("b", 20, often, slack=1), task("h", None, version("v", 1)))
    mode, _, plan = begun(owner)
    found = releases_of(mode, replace(plan, phases=(4, 38, 0)))
    assert found == [[(4, 0), (14, 1)], [(38, 0)], [(4, 0), (14, 1), (18, 2)]]


# ------------------------------------------------------------------------------------------------ tables


def test_a_table_counts_the_jobs_that_have_started():
    """Of two tasks with two jobs and one, the second job of the first has not started; the last task has no jobs."""
    parts = ints([0, 0, 0, 0, 9, 11, 0, 2, 4, 5, 0, 1, 6, 8, 1, 3])
    indices, firsts, counts = ints([1, 0, 0]), ints([2, 0, 1]), ints([2, 0, 1])
    instants = {"releases": ints([3, 13, 8]), "starts": ints([4, 0, 9]), "ends": ints([8, 0, 11])}
    table = Table(ints([0, 2, 3, 3]), indices, *instants.values(), firsts, counts, parts, (0, 0, 0), closed=False)
    assert (len(table), table.part_count) == (2, 3)
    assert [table.is_whole(number) for number in range(3)] == [False, True, False]
    jobs = [list(table.jobs(number)) for number in range(3)]
    assert jobs == [[(1, ((4, 5, 0, 1), (6, 8, 1, 3)))], [(0, ((9, 11, 0, 2),))], []]
    assert [table.slips(number) for number in range(3)] == [[1], [1], []]


# ------------------------------------------------------------------------------------------------ the first plan


def test_the_heaviest_tasks_come_first_where_least_is_to_do():
    """Interrupts count; a task that has no choice comes before those that have one."""
    owner = model(
        task("light", 20, version("v", 2, "u1 u2 u3")),
        task("heavy", 20, version("v", 9, "u1 u2 u3")),
        task("bound", 20, version("v", 6, "u1")),
        task("gang", 20, version("v", 1, "u2 u3", gang=2)),
        task("either", 20, version("v", 10, "u1 u3"), version("short", 1, "u1 u3")),
        units="u1 u2 u3",
    )
    owner = interrupts(owner, "u2", (20, 4))
    mode, _, plan = begun(owner)
    assert [tuple(mode.units[unit] for unit in way.units) for way in plan.ways] == [
        ("u1",),
        ("u3",),
        ("u1",),
        ("u2", "u3"),
        ("u1",),
    ]


def test_a_gang_goes_where_the_busiest_of_its_units_has_least_to_do():
    """A heavier task that has a choice, too, comes first, and takes the idle unit."""
    gang = version("x", 2, "u1 u2", gang=2), version("y", 2, "u3 u4", gang=2)
    others = [task(f"on{unit}", 20, version("v", wcet, f"u{unit}")) for unit, wcet in ((2, 5), (3, 6), (4, 6))]
    roams = task("roams", 20, version("v", 7, "u1 u2 u3"))
    _, _, plan = begun(model(task("gang", 20, *gang), roams, *others, units="u1 u2 u3 u4"))
    assert [way.units for way in plan.ways[:2]] == [(2, 3), (0,)]


def test_deadlines_lead_back_along_windows():
    """c ends by 12 ms; b ends 1 ms before it starts, and starts 2 ms after a starts; each takes 3 ms."""
    owner = model(
        task("a", 20, version("v", 3), slack=1),
        task("b", 20, version("v", 3, "u1", after("a", 2, 20)), slack=1),
        task("c", 20, version("v", 3, "u1", after("b", 1, 20, "end")), slack=1, deadline=12),
        task("other", 10, version("v", 1, "u1", after("c", 1, 20, "end")), slack=1, deadline=4),
        task("early", 20, version("v", 3), slack="1/10"),
        task("asked", None, version("v", 1)),
        task("asks", 20, version("v", 2, "u1", after("asked", 1, 5)), slack=1, deadline=15),
    )
    _, _, plan = begun(owner)
    assert plan.urgency == (6, 8, 12, 4, 5, 13, 15)
    assert (plan.holds, plan.phases, plan.fresh) == ((0,) * 7, (0,) * 7, True)


def test_deadlines_that_lead_round_in_a_circle_end():
    owner = model(
        task("a", 20, version("v", 1, "u1", after("b", 1, 9)), slack=1),
        task("b", 20, version("v", 1, "u1", after("a", 1, 9)), slack=1),
    )
    assert begun(owner)[2].urgency == (18, 18)


def test_phases_begin_at_offsets_and_where_jobs_stay():
    owner = model(
        task("fixed", 10, version("v", 1), offset=3),
        task("stays", 10, version("v", 1), slack=1),
        task("free", 10, version("v", 1)),
        task("long", 30, version("v", 1)),
    )
    stays = [job(owner, "stays", index, start, "u1") for index, start in enumerate((8, 15, 27))]
    mode, allowed, plan = begun(owner, *stays)
    assert plan.phases == (3, 5, 0, 0)
    assert [fixed_phase(mode, number) for number in range(4)] == [None, 5, None, None]
    assert [len(ways) for ways in allowed] == [1] * 4


def test_a_plan_is_adopted_on_the_same_units_with_the_same_versions_where_they_are_left():
    owner = model(
        task("a", 10, version("v", 2, "u1 u2"), version("w", 1, "u1 u2")),
        task("b", 10, version("v", 1, "u1 u2")),
        units="u1 u2",
    )
    mode, allowed, plan = begun(owner)
    plan = replace(plan, ways=(allowed[0][3], allowed[1][1]))
    fewer = [allowed[0], allowed[1][:1]]
    ways = adopted(plan, fewer).ways
    assert [(way.version.name, mode.units[way.units[0]]) for way in ways] == [("w", "u2"), ("v", "u1")]


def test_units_that_others_pinned_are_kept_unless_none_would_be_left():
    owner = model(task("a", 10, version("v", 1, "u1 u2 u3"), version("both", 1, "u2 u3", gang=2)), units="u1 u2 u3")
    mode, _ = mode_of(owner)

    def left(**pinned):
        [ways] = allowed_ways(mode, pinned)
        return [tuple(mode.units[unit] for unit in way.units) for way in ways]

    assert left(a={1: frozenset({"u2", "u3"})}) == [("u2",), ("u3",)]
    assert left(a={1: frozenset({"u2"}), 2: frozenset({"u2", "u3"})}) == [("u2",), ("u2", "u3")]
    assert left(a={3: frozenset({"u1"})}) == left() == [("u1",), ("u2",), ("u3",), ("u2", "u3")]


@pytest.mark.parametrize(("wcet", "expected"), [(4, True), (5, False)])
def test_a_plan_fits_where_no_unit_has_more_work_than_time(wcet, expected):
    """2 of 10 ms and `wcet` of 5 ms, and for interrupts 1 of 20 ms and 1 of 20 ms beside them, or just too much."""
    owner = model(task("a", 20, version("v", 2)), task("b", 5, version("v", wcet)))
    mode, _, plan = begun(interrupts(owner, "u1", (20, 1), (20, 1)))
    assert fits(mode, plan) is expected


def test_tasks_of_a_chain_with_one_period_come_together_where_they_fit():
    """On the unit of the heaviest of them; what has another period stays, and so does what would be too much."""
    owner = model(
        task("a", 10, version("v", 1, "u1 u2")),
        task("heavy", 10, version("v", 6, "u1 u2")),
        task("slow", 20, version("v", 2, "u1 u2")),
        task("much", 10, version("v", 4, "u1 u2")),
        task("lone", 10, version("v", 1, "u1")),
        units="u1 u2",
    )
    mode, allowed, plan = begun(owner)
    on = dict(zip("12", ({"u1"}, {"u2"}), strict=True))
    way = {(number, unit): next(w for w in allowed[number] if mode.units[w.units[0]] in on[unit])
           for number in range(5) for unit in "12" if (number, unit) != (4, "2")}  # fmt: skip
    plan = replace(plan, ways=(way[0, "1"], way[1, "2"], way[2, "1"], way[3, "1"], way[4, "1"]))
    found = together(mode, plan, allowed, [chain("c", "a heavy much lone slow gone")])
    assert [mode.units[w.units[0]] for w in found.ways] == ["u2", "u2", "u1", "u1", "u1"]


# ------------------------------------------------------------------------------------------------ moves


def moving():
    """A task whose phase is free, one with an offset, two with windows to it, one on demand, one that stays."""
    owner = model(
        task("free", 16, version("v", 3, "u1 u2"), slack="1/2"),
        task("offset", 16, version("v", 2, "u1"), offset=3, slack=1),
        task("next", 16, version("v", 2, "u2", after("free", 2, 6)), offset=8),
        task("end", 8, version("v", 1, "u2", after("free", 1, 4, "end"), after("asked", 1, 2)), slack=1),
        task("asked", None, version("v", 1, "u1")),
        task("stays", 16, version("v", 1, "u2")),
        units="u1 u2",
    )
    mode, allowed, plan = begun(owner, job(owner, "stays", 0, 15, "u2"))
    assert mode.hyperperiod == 16
    return mode, allowed, replace(plan, urgency=(11, 12, 4, 8, 16, 1))


FREE, OFFSET, NEXT, END, ASKED, STAYS = range(6)

URGENT, ELSEWHERE, SHIFTED, HELD = 0, 3, 5, 7
"""Kinds of moves of `repaired`: the first of each that looks at no neighbour."""

KEEP, TOGGLE = 1, 0
"""Draws for whether a job waits for the job of its predecessor."""


def repaired(kind, *draws, task=FREE, late=None, chains=(), change=lambda plan: plan):
    """Return the plan before a repair around a late task, and after it."""
    mode, allowed, plan = moving()
    script = Draws(0, kind, *draws)
    before = change(plan)
    found = Moves(mode, allowed, chains, script).repaired(before, late or [number == task for number in range(6)])
    assert not script.numbers
    return before, found


def test_a_late_task_becomes_more_urgent():
    before, found = repaired(URGENT, KEEP, 2)
    assert found == replace(before, urgency=(11 * 4 // 8, *before.urgency[1:]))
    before, found = repaired(URGENT, KEEP, 5)
    assert found.urgency[FREE] == 11 * 7 // 8


@pytest.mark.parametrize(("task", "length", "most"), [(FREE, 3, 16), (ASKED, 1, 16)])
def test_a_late_task_gets_any_deadline_that_it_can_meet(task, length, most):
    before, found = repaired(URGENT, KEEP, 1, -1, task=task)
    assert found.urgency[task] == length + most - 1
    assert (found.phases, found.holds, found.ways) == (before.phases, before.holds, before.ways)


def test_now_and_then_jobs_no_longer_wait_for_their_predecessors():
    assert repaired(URGENT, TOGGLE, 2)[1].fresh is False
    assert repaired(URGENT, KEEP, 2)[1].fresh is True


def test_a_late_task_goes_to_other_units_or_becomes_urgent_where_there_are_none():
    before, found = repaired(ELSEWHERE, KEEP, 1)
    assert [way.units for way in found.ways[:1]] == [(1,)]
    assert found.ways[1:] == before.ways[1:]
    before, found = repaired(ELSEWHERE, KEEP, 2, task=OFFSET)
    assert found.urgency[OFFSET] == before.urgency[OFFSET] * 4 // 8
    assert found.ways == before.ways


@pytest.mark.parametrize(
    ("draws", "phase"),
    [
        ((9, 0, 0), 0),
        ((9, 0, 1), 9),  # anywhere in the period
        ((-1, 0, 1), 15),
        ((9, 0, 2), 8 - 2),  # `next` starts 2 ms after it at least, and 6 ms at most
        ((9, 0, 3), 8 - 6),
        ((9, 0, 4), 5 - 3 - 1),  # `end` starts 1 ms after its end of 3 ms at least, at most 4 ms
        ((9, 0, 5), 0),  # never below zero
        ((9, 0, 6), 4 - 2),  # near its phase of 4 ms: within an eighth of the period
        ((9, -1, 6), 4 + 2),
    ],
)
def test_a_task_with_a_free_phase_is_shifted_to_where_windows_open(draws, phase):
    def change(plan):
        return replace(plan, phases=(4, 3, 8, 2, 0, 15), holds=(7, 0, 0, 3, 0, 0))

    before, found = repaired(SHIFTED, KEEP, *draws, change=change)
    assert found == replace(before, phases=(phase, 3, 8, 2, 0, 15), holds=(0, 0, 0, 3, 0, 0))


def test_a_task_is_shifted_to_its_own_windows():
    """`end` counts from the end of `free`, at 4 + 7 + 3 ms, and from the start of `asked`."""

    def change(plan):
        return replace(plan, phases=(4, 3, 8, 2, 6, 15), holds=(7, 0, 0, 3, 1, 0))

    found = [repaired(SHIFTED, KEEP, 0, 0, number, task=END, change=change)[1].phases[END] for number in range(2, 6)]
    assert found == [15, 18, 8, 9]


@pytest.mark.parametrize(("draws", "hold"), [((-1, 0), 0), ((-1, 1), 15), ((-1, 2), 12)])
def test_a_task_with_an_offset_is_held_in_place_of_shifted(draws, hold):
    """Up to its slack of 16 ms, less a tick; `end` may come 1 ms after its end at the earliest, and is at 2 + 16 ms."""
    mode, allowed, plan = moving()
    row = replace(plan.ways[END].windows[0], task=OFFSET)
    ways = (*plan.ways[:END], replace(plan.ways[END], windows=(row,)), *plan.ways[END + 1 :])
    plan = replace(plan, ways=ways, phases=(0, 3, 8, 2, 0, 15))
    script = Draws(0, SHIFTED, KEEP, *draws)
    found = Moves(mode, allowed, (), script).repaired(plan, [number == OFFSET for number in range(6)])
    assert found == replace(plan, holds=(0, hold, 0, 0, 0, 0))


def test_a_job_is_held_for_what_its_slack_allows_only():
    """`free` may slip by 8 ms: of the openings at 6, 2, 1 and -2 ms from its phase on, the last is 14 ms away."""

    def held(number, end, drawn=8):
        change = lambda plan: replace(plan, phases=(0, 3, 8, end, 0, 15))  # noqa: E731
        return repaired(HELD, KEEP, drawn, number, change=change)[1].holds[FREE]

    assert [held(number, end=5) for number in range(5)] == [0, 8, 6, 2, 1]
    assert [held(number, end=12, drawn=7) for number in range(6)] == [0, 7, 6, 2, 8, 5]
    _, found = repaired(HELD, KEEP, 2, task=NEXT)  # without slack it becomes urgent
    assert found.urgency[NEXT] == 4 * 4 // 8
    assert repaired(HELD, KEEP, -1, 1, task=ASKED)[1].holds[ASKED] == 16  # a job on demand has all of the hyperperiod


@pytest.mark.parametrize(
    ("kind", "draws", "task", "changed"),
    [
        (0, (2,), FREE, "urgency"),
        (1, (1, 2), OFFSET, "urgency"),
        (2, (2,), FREE, "urgency"),
        (3, (1,), FREE, "ways"),
        (4, (1, 2), OFFSET, "urgency"),
        (5, (9, 0, 1), FREE, "phases"),
        (6, (1, 15, 1), OFFSET, "holds"),
        (7, (8, 1), FREE, "holds"),
        (8, (2, 15, 1), ASKED, "holds"),
        (9, (8, 1), FREE, "holds"),
    ],
)
def test_four_of_ten_repairs_are_of_a_task_beside_the_late_one(kind, draws, task, changed):
    """`free` runs on u1, as `offset` and `asked` do; the one that stays never moves."""
    before, found = repaired(kind, KEEP, *draws)
    differing = {
        name for name in ("ways", "phases", "urgency", "holds") if getattr(found, name) != getattr(before, name)
    }
    assert differing == {changed}
    assert [n for n in range(6) if getattr(found, changed)[n] != getattr(before, changed)[n]] == [task]


@pytest.mark.parametrize(("late", "drawn"), [("a", "ab"), ("b", "ab"), ("c", "cd"), ("d", "d")])
def test_beside_a_task_is_what_shares_a_unit_a_resource_or_one_of_its_windows(late, drawn):
    owner = model(
        task("a", 16, version("v", 3, "u1", access("r", 0, 1)), slack=1),
        task("b", 16, version("v", 2, "u2", access("r", 1, 2), access("s", 0, 1)), slack=1),
        task("c", 16, version("v", 2, "u3", after("d", 1, 9)), slack=1),
        task("d", 16, version("v", 1, "u4"), slack=1),
        units="u1 u2 u3 u4",
        resources="r s",
    )
    mode, allowed, plan = begun(owner)
    for number, other in enumerate(drawn):
        draws = Draws(0, 1, KEEP, number, 1, 15)
        found = Moves(mode, allowed, (), draws).repaired(plan, [name == late for name in "abcd"])
        assert [name for n, name in enumerate("abcd") if found.urgency[n] != plan.urgency[n]] == [other]
    with pytest.raises(AssertionError):  # there are no others to draw
        Moves(mode, allowed, (), Draws(0, 1, KEEP, len(drawn))).repaired(plan, [name == late for name in "abcd"])


def test_where_no_task_is_late_those_of_chains_are_repaired_and_else_any_that_moves():
    chains = [chain("c", "offset next")]
    mode, allowed, plan = moving()
    for given, chosen in ((chains, NEXT), ((), OFFSET)):
        found = Moves(mode, allowed, given, Draws(1, URGENT, KEEP, 2)).repaired(plan, [0, 0, 0, 0, 0, 9])
        assert [n for n in range(6) if found.urgency[n] != plan.urgency[n]] == [chosen]


# ------------------------------------------------------------------------------------------------ variations


def varied(*draws, slow=(), chains=None, change=lambda plan: plan):
    mode, allowed, plan = moving()
    script = Draws(*draws)
    before = change(plan)
    given = [chain("c", "gone free next end asked gone")] if chains is None else chains
    found = Moves(mode, allowed, given, script).varied(before, slow)
    assert not script.numbers
    return before, found


def test_a_task_is_put_beside_the_next_or_the_last_of_its_chain():
    assert varied(0, 0, 0, 0, chains=[chain("c", "free next")])[1].ways[FREE].units == (1,)  # where `next` is
    assert varied(0, 0, 0, 1, chains=[chain("c", "offset free next")], slow=[FREE])[1].ways[FREE].units == (1,)
    before, found = varied(0, 1, 2, 0)  # `next` cannot go to u1, where `free` is
    assert found == before


def test_a_task_that_stands_alone_in_its_chain_goes_elsewhere():
    before, found = varied(0, 0, 2, 1, chains=[chain("c", "free")])
    assert (before.ways[FREE].units, found.ways[FREE].units) == ((0,), (1,))


def test_slow_tasks_are_varied_first_if_they_may_move():
    before, found = varied(0, 0, 6, 3, slow=[STAYS, NEXT])
    assert [n for n in range(6) if found.urgency[n] != before.urgency[n]] == [NEXT]
    before, found = varied(0, 3, 6, 3, slow=[STAYS])
    assert [n for n in range(6) if found.urgency[n] != before.urgency[n]] == [ASKED]


def test_variations_are_one_or_two():
    before, found = varied(2, 0, 3, 1, 1, 6, 3)
    assert found.ways[FREE].units == (1,)
    assert found.urgency[NEXT] != before.urgency[NEXT]
    before, found = varied(1, 0, 4, 1)
    assert found.ways[FREE].units == (1,)


def test_two_tasks_swap_their_units_as_far_as_they_may():
    _, found = varied(0, 0, 5, 2)  # `free` goes to u2, `next` cannot go to u1
    assert (found.ways[FREE].units, found.ways[NEXT].units) == ((1,), (1,))


def test_a_variation_may_shift_a_phase():
    assert varied(0, 0, 7, 9, 0, 1)[1].phases[FREE] == 9


# ------------------------------------------------------------------------------------------------ jobs that stay


def interruptible(**changes):
    """A task of 9 ms with points at 3 and 6 ms and a phase within its second piece, on one of two units."""
    how = points(3, 6, max_gaps=1) if "how" not in changes else changes["how"]
    long = split(version("v", changes.get("wcet", 9), changes.get("units", "u1 u2"), access("r", 4, 5, "1/2")), how)
    return model(task("long", 40, long, slack=1), task("short", 20, version("v", 2)), units="u1 u2", resources="r")


SHIPPED = parted("long", 0, "u2", (1, 4, 0, 3), (6, 12, 3, 9))


def test_a_job_that_stays_keeps_its_parts_and_claims_what_they_take():
    mode, changed = mode_of(interruptible(), SHIPPED)
    assert changed == ()
    [kept] = mode.fixed.jobs
    assert (kept.job, kept.start, kept.end, kept.spans) == (SHIPPED, 1, 12, ((1, 4), (6, 12)))
    assert kept.claims == (Claim(0, 7, 8, 1),)
    assert (mode.fixed.tasks, kept.way.units, kept.units) == ({0}, (1,), (1,))


def test_a_job_that_stays_takes_each_tick_that_it_touches():
    mode, _ = mode_of(interruptible(), SHIPPED, tick=ms(5))
    [kept] = mode.fixed.jobs
    assert kept.spans == ((0, 1), (1, 3))
    assert kept.claims == (Claim(0, 1, 2, 1),)


@pytest.mark.parametrize(
    ("owner", "shipped"),
    [
        (interruptible(), replace(SHIPPED, version="w")),
        (interruptible(units="u1"), SHIPPED),
        (interruptible(), replace(SHIPPED, units=("u9",))),
        (interruptible(), replace(SHIPPED, units=("u1", "u2"))),
        (interruptible(wcet=10), SHIPPED),
        (interruptible(), parted("long", 0, "u2", (40, 43, 0, 3), (45, 51, 3, 9))),
        (interruptible(), parted("long", 0, "u2", (1, 10, 0, 9))),
        (interruptible(), parted("long", 0, "u2", (1, 4, 0, 3), (5, 5, 3, 3), (6, 12, 3, 9))),
        (interruptible(), parted("long", 0, "u2", (1, 4, 0, 3), (5, 4, 3, 2), (6, 13, 2, 9))),
        (interruptible(), parted("long", 0, "u2", (1, 4, 0, 3), (6, 9, 3, 6), (10, 13, 6, 9))),
        (interruptible(), parted("long", 0, "u2", (1, 5, 0, 3), (6, 12, 3, 9))),
        (
            interruptible(how=Split(anywhere=True)),
            parted("long", 0, "u2", (1, "5.5ms", 0, "4.5ms"), (6, "10.5ms", "4.5ms", 9)),
        ),
    ],
    ids=[
        "version",
        "units",
        "unknown unit",
        "gang",
        "length",
        "cycle",
        "one part",
        "empty",
        "negative",
        "gaps",
        "part",
        "phase",
    ],
)
def test_a_job_that_the_model_no_longer_allows_does_not_stay(owner, shipped):
    mode, changed = mode_of(owner, shipped)
    assert (mode.fixed.jobs, changed) == ((), ("long",))


def test_a_task_stays_with_all_its_jobs_or_with_none():
    owner = interruptible()
    one, two = job(owner, "short", 0, 3, "u1"), job(owner, "short", 1, 23, "u1")
    assert [each.job.index for each in mode_of(owner, one, two)[0].fixed.jobs] == [0, 1]
    assert mode_of(owner, one)[1] == ("short",)
    assert mode_of(owner, SHIPPED)[1] == ()


def test_a_job_in_one_piece_stays_with_the_length_that_its_version_has_now():
    owner = interruptible()
    shorter = replace(job(owner, "short", 0, 3, "u1"), end=ms(4))
    mode, _ = mode_of(owner, shorter, job(owner, "short", 1, 23, "u1"))
    assert [(str(each.job.start), str(each.job.end)) for each in mode.fixed.jobs] == [("3ms", "5ms"), ("23ms", "25ms")]


def test_a_unit_is_occupied_by_jobs_that_stay_or_lies_in_the_innermost_of_their_gaps():
    """On a circle of 20 ms: one job passes its end, two lie in its gaps, and the second of them has a gap itself."""
    spans = [((4, 6), (10, 12), (18, 21)), ((7, 8),), ((13, 14), (16, 17))]
    walls = Walls([FixedJob(0, None, None, (0,), each, ()) for each in spans], 20)
    assert walls.rows() == [
        (0, True, False, 0, 0),
        (1, False, False, 0, 0),
        (4, True, False, 0, 0),
        (6, False, True, 6, 10),
        (7, True, True, 6, 10),
        (8, False, True, 6, 10),
        (10, True, False, 0, 0),
        (12, False, True, 12, 18),
        (13, True, True, 12, 18),
        (14, False, True, 14, 16),
        (16, True, True, 12, 18),
        (17, False, True, 12, 18),
        (18, True, False, 0, 0),
    ]
    assert walls.begins[:3] == [-36, -30, -22]
    assert {begin % 20 for begin in walls.begins} == {4, 10, 18, 7, 13, 16}


@pytest.mark.parametrize(
    ("starts", "missed"),
    [
        ([5], {}),
        ([4], {}),  # 6 ms before, at most
        ([3], {1: 1}),
        ([9], {1: 15}),  # 1 ms before is too late: it serves 21 ms after, which is 15 ms too many
        ([3, 8], {}),
        ([], {1: 20}),
    ],
)
def test_windows_of_jobs_that_stay_blame_the_task_that_misses_them(starts, missed):
    owner = model(
        task("stays", 20, version("v", 1, "u1", after("other", 2, 6)), slack=1), task("other", 20, version(), slack=1)
    )
    mode, _ = mode_of(owner, job(owner, "stays", 0, 10, "u1"))
    found = window_excess(mode.fixed.jobs, {1: [(start, start + 1) for start in starts]}, 20)
    assert {task: by for task, by in found.items() if by} == missed
    assert found.keys() == {1}


def test_windows_from_an_end_count_from_there():
    owner = model(
        task("stays", 20, version("v", 1, "u1", after("other", 2, 6, "end"), after("other", 0, 3)), slack=1),
        task("other", 20, version(), slack=1),
    )
    mode, _ = mode_of(owner, job(owner, "stays", 0, 10, "u1"))
    assert window_excess(mode.fixed.jobs, {1: [(2, 3)]}, 20) == {1: 1 + 5}


def test_phases_of_locks_are_cut_at_points_and_those_of_others_are_not():
    held = Fraction(1)
    owner = model(
        task("a", 20, split(version("v", 9, "u1", access("lock", 2, 7, held)), points(3, 6)), slack=1), resources="lock"
    )
    lock = replace(owner.resources[0], kind=ResourceKind.LOCK)
    mode, _ = mode_of(replace(owner, resources=(lock,)))
    assert [(phase.begin, phase.end) for phase in mode.works[0].ways[0].phases] == [(2, 3), (3, 6), (6, 7)]


def test_a_job_that_stays_holds_a_lock_through_its_gaps_and_each_resource_by_its_own_bound():
    """The lock from 1 ms after the start to 2 ms after the gap, then two thirds of the memory."""
    wants = access("lock", 1, 4), access("memory", 4, 6, "2/3")
    owner = model(task("a", 20, split(version("v", 6, "u1", *wants), points(2))), resources="lock memory")
    locks = replace(owner.resources[0], kind=ResourceKind.LOCK), owner.resources[1]
    shipped = parted("a", 0, "u1", (1, 3, 0, 2), (5, 9, 2, 6))
    mode, changed = mode_of(replace(owner, resources=locks), shipped)
    assert (mode.fixed.jobs[0].claims, changed) == ((Claim(0, 2, 7, 1), Claim(1, 7, 9, 2)), ())
    assert mode_of(owner, shipped)[1] == ("a",)  # what is no lock has no gap inside


# ------------------------------------------------------------------------------------------------ the grid


@pytest.mark.parametrize(
    ("tick", "part"), [("8ns", 1), ("16ns", 2), ("12ns", 3), ("6ns", 3), ("7ns", 7), ("1/2ns", Fraction(1, 16))]
)
def test_a_finer_tick_is_an_eighth_or_as_fine_as_whole_nanoseconds_allow(tick, part):
    assert finer(ms(tick)).ns == part


def test_deadlines_of_longer_jobs_are_those_of_the_jobs_that_they_stand_for():
    """Half as long again, versions of 8 and 4 ms take 4 and 2 ms more: the deadline is 4 ms later than stated."""
    poll = replace(task("poll", 20, version("v", 2), slack=1, deadline=30), distance=ms(25))
    owner = model(task("a", 20, version("v", 8), version("short", 4), slack=1, deadline=15), poll)
    expansion = expand(owner, owner.modes[0])
    longer = works_of(owner, expansion, ms(1), Fraction(3, 2))
    found = lenient(longer)
    assert [(work.deadline, work.arrivals) for work in longer.works] == [(15, None), (10, (25, 30))]
    assert [(work.deadline, work.arrivals) for work in found.works] == [(15 + 4, None), (10 + 1, (25, 30 + 1))]
    assert (longer.is_lenient, found.is_lenient) == (False, True)


# ------------------------------------------------------------------------------------------------ what is kept


class Kept:
    """What a checkpoint has of one search."""

    def __init__(self, **facts):
        self.facts = facts

    def note(self, facts):
        self.facts = facts

    def noted(self):
        return self.facts or None


def stood():
    """Where a search stands, with a plan for each kind, and the ways of its mode."""
    _, allowed, plan = moving()
    other = replace(plan, ways=(allowed[FREE][1], *plan.ways[1:]), phases=(7, 3, 8, 2, 0, 15), fresh=False)
    first = replace(plan, holds=(1, 2, 3, 4, 5, 6), urgency=(6, 5, 4, 3, 2, 1))
    return State(70, 5 << 32 | 9, other, plan, (first,), 60), allowed


def test_a_search_goes_on_from_where_it_stood():
    state, allowed = stood()
    kept = Kept()
    Memory(kept, allowed).keep(state)
    assert Memory(kept, allowed).recalled() == state
    without = replace(state, first=(), began=0, draws=2**64 - 1)
    Memory(kept, allowed).keep(without)
    assert Memory(kept, allowed).recalled() == without


def test_without_a_checkpoint_nothing_is_kept():
    state, allowed = stood()
    Memory(None, allowed).keep(state)
    assert Memory(None, allowed).recalled() is None
    assert Memory(Kept(), allowed).recalled() is None


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("counts", lambda values: values[:-1]),
        ("counts", None),
        ("current", lambda values: values[:-1]),
        ("current", lambda values: ints([values[0], 2, *values[2:]])),  # the first task has two ways
        ("current", lambda values: ints([values[0], -1, *values[2:]])),
        ("best", lambda values: values[:-1]),
        ("best", None),
    ],
)
def test_what_does_not_fit_the_mode_is_not_gone_on_from(name, change):
    state, allowed = stood()
    kept = Kept()
    memory = Memory(kept, allowed)
    memory.keep(state)
    values = kept.facts.pop(name)
    if change is not None:
        kept.facts[name] = change(values)
    assert memory.recalled() is None
