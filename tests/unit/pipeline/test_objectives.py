"""The figures of the objectives by hand, and which of two schedules is the better one."""

from dataclasses import replace
from fractions import Fraction

import pytest
from placed_cases import place
from split_helpers import parted, points, split

from halpipe.models import Anchor, Split
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import MEASURES, Judge, Objective, Worth, whole_weights
from halpipe.pipeline.solve import exact_goals
from halpipe.pipeline.solve.optimise import (
    DELAYS,
    UNITS,
    Reached,
    chain_bounds,
    finish,
    lower_bound,
    polish_of,
    stages_of,
    value_text,
)
from support import after, chain, job, model, ms, task, version

JITTER, PREEMPTIONS, CHAINS, COST = Objective.JITTER, Objective.PREEMPTIONS, Objective.CHAINS, Objective.COST


def measured(objective, system, *jobs):
    return MEASURES[objective](system, place(system, *jobs))


@pytest.mark.parametrize(
    ("starts", "jitter"),
    [((2, 12, 22), 0), ((2, 15, 22), 3), ((2, 15, 24), 3), ((28, 12, 22), 4), ((29, 9, 22), 3)],
)
def test_jitter_is_the_largest_delay_less_the_least_of_each_periodic_task(starts, jitter):
    """The job before the release of the others lies at the end of the cycle of 30 ms."""
    system = model(task("a", 10, version(), slack=1), task("b", 30, version(), slack=1), task("h", None, version()))
    jobs = [job(system, "a", index, start, "u1") for index, start in enumerate(starts)]
    assert measured(JITTER, system, *jobs, job(system, "b", 0, 17, "u1")) == ms(jitter).ns
    other = [job(system, "b", 0, 17, "u1")]
    assert measured(JITTER, system, *other) == 0


def test_preemptions_are_the_gaps_of_all_jobs():
    cut = split(version("v", 6), points(2, 4))
    system = model(task("a", 20, cut), task("b", 20, cut), task("c", 20, version()))
    jobs = [parted("a", 0, "u1", (0, 2, 0, 2), (3, 5, 2, 4), (8, 10, 4, 6)), job(system, "c", 0, 2, "u1")]
    assert measured(PREEMPTIONS, system, *jobs) == 2
    assert measured(PREEMPTIONS, system, *jobs, parted("b", 0, "u1", (5, 7, 0, 2), (10, 14, 2, 6))) == 3
    assert measured(PREEMPTIONS, system, jobs[1]) == 0


def test_chains_are_the_weighted_sum_of_reaction_times_and_data_ages():
    heavy = replace(chain("c", "a"), weight=Fraction(3, 2))
    system = model(task("a", 10, version("v", 2)), chains=[heavy, chain("d", "a")])
    placed = job(system, "a", 0, 9, "u1")
    assert measured(CHAINS, system, placed) == (ms(12).ns + ms(2).ns) * Fraction(5, 2)
    assert whole_weights(system.chains) == (3, 2)


def test_a_schedule_is_better_if_it_is_as_good_as_the_best_and_nothing_is_worse_than_at_first():
    system = model(task("a", 20, version(), slack=1), task("b", 10, version(), slack=1))
    judge = Judge(system, expand(system, system.modes[0]), (JITTER, COST))

    def jobs(second):
        return [job(system, "a", 0, 3, "u1"), job(system, "b", 0, 0, "u1"), job(system, "b", 1, second, "u1")]

    late, later = judge.worth(jobs(12)), judge.worth(jobs(14))
    assert (late.values[0], later.values[0]) == (ms(2).ns, ms(4).ns)
    assert judge.better(jobs(12), later, later) == late
    assert judge.better(jobs(12), later, late) == late
    assert judge.better(jobs(14), later, late) is None
    assert judge.better(jobs(12), Worth((later.values[0], late.values[1] - 1)), later) is None


@pytest.mark.parametrize(
    ("starts", "is_kept"),
    [((5, 10), True), ((10, 10), False), ((11, 10), False), ((5, 12), False)],  # of b, and of the second job of j
)
def test_what_the_exact_engine_finds_is_kept_if_it_is_better_and_nothing_is_worse_than_at_first(
    monkeypatch, starts, is_kept
):
    """At first a ends at 1 ms and b at 11 ms: 11 ms from a to b, and 20 ms more to a stimulus that was just missed."""
    tasks = [task("a", 20, version(), slack=1), task("b", 20, version("v", 1, "u2"), slack=1)]
    system = model(*tasks, task("j", 10, version("v", 1, "u3"), slack=1), units="u1 u2 u3", chains=[chain("c", "a b")])

    def jobs(second, last):
        placed = ("a", 0, 0, "u1"), ("b", 0, second, "u2"), ("j", 0, 0, "u3"), ("j", 1, last, "u3")
        return tuple(job(system, *each) for each in placed)

    other, bound, asked = jobs(*starts), Fraction(ms(1).ns), []

    def shortest(_model, _expansion, _jobs, now, least, effort):
        asked.append((now, list(least.values()), effort.seed))
        return exact_goals.Shortest(bound, other, stopped=True)

    monkeypatch.setattr(exact_goals, "shortest_chains", shortest)
    wanted = polish_of(system, expand(system, system.modes[0]), (CHAINS, JITTER), None, 1, lambda _: None, None)
    plain = finish(wanted, jobs(10, 10), 1, lambda: True, is_free=False)
    assert (plain.jobs, plain.stopped, asked) == (jobs(10, 10), False, [])
    end = finish(wanted, jobs(10, 10), 7, lambda: True, is_free=True)
    assert asked == [(ms(42).ns, [ms(22 + 2).ns], 7)]
    assert (end.jobs, end.stopped) == (other if is_kept else jobs(10, 10), True)
    rows = [(row.first, row.value, row.bound) for row in end.reached]
    assert rows == [(ms(42).ns, ms(32 if is_kept else 42).ns, bound), (0, 0, 0)]


def test_an_objective_may_cost_what_comes_after_it_but_nothing_before():
    stages = [*stages_of((Objective.MARGIN, COST, JITTER))]
    assert stages == [(Objective.MARGIN, 1), (DELAYS, 2), (UNITS, 2), (DELAYS, 2), (JITTER, 3)]


@pytest.mark.parametrize(
    ("objective", "value", "text"),
    [
        (COST, 0, "0"),
        (COST, "1/2", "0.5"),
        (COST, "-1/3", "-1/3"),
        (PREEMPTIONS, 3, "3"),
        (CHAINS, 1_500_000, "1.5ms"),
        (Objective.MARGIN, "-1/4", "25 %"),
    ],
)
def test_values_are_shown_in_their_units(objective, value, text):
    assert value_text(objective, Fraction(value)) == text


def test_bounds_of_objectives_are_those_of_the_model():
    """A reaction takes 20 ms and 2 ms, an age 2 ms; of a margin, the unit is full after 8 ms more."""
    heavy = replace(chain("c", "a"), weight=Fraction(3, 2))
    system = model(task("a", 20, version("v", 2)), task("b", 20, version("v", 2)), chains=[heavy, chain("d", "x a")])
    bounds = {each: lower_bound(each, system, expand(system, system.modes[0])) for each in Objective}
    assert bounds == {CHAINS: ms(36).ns, JITTER: 0, PREEMPTIONS: 0, COST: None, Objective.MARGIN: -4}


@pytest.mark.parametrize(
    ("objectives", "is_led"),
    [((CHAINS,), True), ((CHAINS, COST), True), ((CHAINS, JITTER), False), ((COST, CHAINS), False), ((), False)],
)
def test_chains_lead_where_nothing_but_the_bonuses_comes_after_them(objectives, is_led):
    system = model(task("a", 10, version()), task("b", 10, version()), chains=[chain("c", "a b"), chain("d", "a x")])
    judge = Judge(system, expand(system, system.modes[0]), objectives)
    assert judge.is_led_by_chains == is_led
    assert judge.chain_weights == (1,)


@pytest.mark.parametrize(
    ("value", "bound", "text"),
    [
        (12_000_000, 10_000_000, "at first 20ms; at most 20 % above the best possible (10ms or more)"),
        (10_000_001, 10_000_000, "at first 20ms; at most 0.1 % above the best possible (10ms or more)"),
        (13_335_000, 10_000_000, "at first 20ms; at most 33.4 % above the best possible (10ms or more)"),
        (10_000_000, 10_000_000, "at first 20ms; the best possible"),
        (10_000_000, 0, "at first 20ms; the best possible is at least 0ms"),
        (10_000_000, None, "at first 20ms; how good it can be is not known"),
    ],
)
def test_what_is_reached_is_said_with_what_is_possible_rounded_up_to_a_tenth(value, bound, text):
    most = None if bound is None else Fraction(bound)
    reached = Reached("m", CHAINS, Fraction(20_000_000), Fraction(value), most)
    assert str(reached).endswith(text)


@pytest.mark.parametrize(
    ("split", "anchor", "to", "uncounted"),
    [
        (False, Anchor.END, None, 4),
        (False, None, Anchor.START, 2),
        (False, Anchor.END, Anchor.START, 6),
        (False, Anchor.START, Anchor.END, 0),
        (True, Anchor.END, None, 9),
    ],
)
def test_what_a_chain_does_not_count_is_no_part_of_its_bounds(split, anchor, to, uncounted):
    """From the end of its first job on, or to the start of its last one; a job in parts may last to its deadline."""
    longer = version("longer", 4)
    longer = replace(longer, split=Split(points=(ms(1),))) if split else longer
    first, last = task("a", 30, longer, version("v", 3), deadline=9), task("b", 30, version("v", 2))
    owner = model(first, last, chains=[replace(chain("c", "a b"), anchor=anchor, to=to)])
    [(_, bounds)] = chain_bounds(owner, expand(owner, owner.modes[0]))
    assert bounds == (ms(35 - uncounted).ns, ms(max(0, 5 - uncounted)).ns)


@pytest.mark.parametrize(
    ("rows", "reaction", "age"),
    [
        ([(10, 1, 0), (15, 2, 0)], 3 + 10 + 10, 3 + 5),  # 15 ms less the common 5 ms; 10 ms less them
        ([(10, 1, 0), (10, 2, 0)], 3 + 10, 3),
        ([(10, 1, 0), (10, 2, 0), (15, 4, 0)], 7 + 10 + 10, 7 + 5),
        ([(15, 4, 0), (10, 1, 0), (10, 2, 0)], 7 + 15 + 5, 7 + 10),
        ([(10, 1, 0), (15, 2, "1/5")], 3 + 10 + 10 - 3, 3 + 5 - 3),  # less what the slack of either gives
        ([(10, 1, "1/5"), (15, 2, 0)], 3 + 10 + 10 - 2 - 2, 3 + 5 - 2),
        ([(10, 1, 1), (15, 2, 1)], 3 + 10, 3),
        ([(30, 1, 1), (10, 2, 0)], 3 + 30, 3 + 20),  # one job has no slack to give
        ([(None, 1, 0), (30, 2, 0)], 3, 3),
        ([(30, 2, 0), (None, 1, 0)], 3 + 30, 3),
    ],
)
def test_no_chain_is_quicker_than_its_work_and_what_its_periods_leave_apart(rows, reaction, age):
    names = "abc"[: len(rows)]
    needs = after("a" if rows[0][0] is None else "b", 0, 9)
    tasks = [
        task(name, period, version("longer", wcet + 1), version("v", wcet), slack=slack)
        for name, (period, wcet, slack) in zip(names, rows, strict=True)
    ]
    owner = model(*tasks, task("z", 30, version("v", 1, "u1", *([needs] if None in {row[0] for row in rows} else []))))
    owner = replace(owner, chains=(chain("c", " ".join(names)), chain("d", "a gone")))
    [(found, bounds)] = chain_bounds(owner, expand(owner, owner.modes[0]))
    assert found.name == "c"
    assert bounds == (ms(reaction).ns, ms(age).ns)
