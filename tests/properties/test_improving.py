"""Improving a valid schedule makes nothing worse that counts, and moves nothing that is frozen."""

import random
from dataclasses import replace
from fractions import Fraction
from itertools import permutations, product
from unittest import mock

import pytest
import split_systems
import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.core.durations import greatest_common_divisor, milliseconds
from halpipe.models import Chain, Split
from halpipe.pipeline.checked import validate_model, verify_schedule
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.measure.objectives import Judge, Objective
from halpipe.pipeline.parts import has_whole_jobs
from halpipe.pipeline.solve import exact_goals, one_mode, optimise
from halpipe.pipeline.solve import schedule as search
from halpipe.pipeline.solve.exact import Effort
from halpipe.pipeline.solve.kernel.warmstart import named_jobs, taken_over
from halpipe.pipeline.solve.limits import stated_problem
from halpipe.pipeline.solve.optimise import lower_bound, value_text
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from profiles import examples
from support import chain, model, task, version

SEEDS = st.integers(0, 2**32)
FAST = examples(60)


def with_chains(system, rng):
    """Give a model two chains without limits, through tasks drawn."""
    names = [task.name for task in system.tasks]
    chains = [Chain(name=f"free{n}", tasks=tuple(rng.choices(names, k=rng.choice((1, 2, 3))))) for n in range(2)]
    return replace(system, chains=(*system.chains, *chains))


def drawn(seed, family):
    """Return a model that a schedule exists for by construction, with chains."""
    rng = random.Random(seed)
    system = with_chains(family.valid_system(rng)[0], rng)
    assume(not any(d.is_error for d in validate_model(system)))
    return system


def table(system, **options):
    """Return the schedule; nothing where none is found."""
    return found(system, **options).schedule


def found(system, **options):
    """Return what a search comes to, where that is a schedule."""
    scheduled = solved(system, **options)
    assume(scheduled.is_complete)
    return scheduled


def solved(system, **options):
    """Search with small budgets; what is called valid verifies."""
    with (
        mock.patch.object(optimise, "POLISH_BUDGET", 30),
        mock.patch.object(one_mode, "POLISH_TABLES", 4),
        mock.patch.object(exact_goals, "CHAINS_WORK", 0.05),
    ):
        scheduled = search.schedule_model(system, SearchOptions(budget=300, **options), lambda *_: True)
    if scheduled.is_complete:
        assert [d.message for d in verify_schedule(system, scheduled.schedule) if d.is_error] == []
    return scheduled


def sum_of_latencies(mode):
    """Return the weight of all latencies; where nothing gets through, more than any."""
    return sum(time.ns if time else 10**30 for chain in mode.chains for time in (chain.reaction, chain.age))


def check_chains(system):
    first, better = (table(system, optimise=aims).modes[0] for aims in ((), (Objective.CHAINS, Objective.COST)))
    assert sum_of_latencies(better) <= sum_of_latencies(first)
    assert better.cost.total <= first.cost.total


@FAST
@given(SEEDS)
def test_neither_chains_nor_cost_get_worse(seed):
    check_chains(drawn(seed, systems))


def test_a_chain_that_nothing_gets_through_keeps_no_search_busy():
    """It has no latency to shorten; asking for less of it was granted again and again, for ever."""
    slices = iter(range(2000))
    rng = random.Random(412093)
    system = with_chains(systems.valid_system(rng)[0], rng)
    scheduled = search.schedule_model(
        system,
        SearchOptions(budget=300, optimise=(Objective.CHAINS, Objective.COST)),
        lambda *_: next(slices, None) is not None,
    )
    assert None in [time for chain in scheduled.schedule.modes[0].chains for time in (chain.reaction, chain.age)]
    assert next(slices, None) is not None, "it went on for ever"


@pytest.mark.slow
@examples(40)
@given(SEEDS)
def test_neither_chains_nor_cost_of_split_jobs_get_worse(seed):
    check_chains(drawn(seed, split_systems))


@examples(40)
@given(SEEDS, st.sampled_from([Objective.COST, Objective.MARGIN]))
def test_improving_moves_nothing_that_is_frozen(seed, objective):
    system = drawn(seed, systems)
    shipped = table(system)
    name = random.Random(seed).choice([task.name for task in system.tasks])
    some = tuple(replace(m, jobs=tuple(j for j in m.jobs if j.task != name)) for m in shipped.modes)
    improved = table(system, optimise=(objective,), shipped=replace(shipped, modes=some))
    now = {(mode.name, job.task, job.index): job for mode in improved.modes for job in mode.jobs}
    for mode in some:
        for job in mode.jobs:
            assert now[mode.name, job.task, job.index].start == job.start


OBJECTIVES = tuple(Objective)


def check_objectives(system, objectives, **options):
    """No named objective is worse than in the first schedule, and none is better than what is called the best."""
    first, better = table(system, optimise=(), **options), found(system, optimise=objectives, **options)
    judge = Judge(system, expand(system, system.modes[0]), objectives)
    before, after = (judge.worth(plan.modes[0].jobs) for plan in (first, better.schedule))
    assert all(now <= then for then, now in zip(before.values, after.values, strict=True))
    assert [reached.first for reached in better.reached] == list(before.values)
    assert [reached.value for reached in better.reached] == list(after.values)
    for reached in better.reached:
        assert reached.bound is None or reached.bound <= reached.value, str(reached)


@FAST
@given(SEEDS, st.permutations([*OBJECTIVES]))
def test_optimising_makes_no_objective_worse_and_no_bound_is_wrong(seed, order):
    check_objectives(drawn(seed, systems), tuple(order[: 1 + seed % 4]))


@examples(20)
@given(SEEDS, st.permutations([*OBJECTIVES]))
def test_optimising_what_the_exact_engine_has_found_makes_no_objective_worse(seed, order):
    pytest.importorskip("ortools")
    system = drawn(seed, systems)
    assume(has_whole_jobs(system))
    check_objectives(system, tuple(order[: 1 + seed % 4]), engine="exact")


@examples(60)
@given(SEEDS)
def test_the_annealer_takes_over_any_valid_schedule(seed):
    """What was valid by construction costs it nothing, and comes out as it went in: starts, versions and units."""
    system, plan = systems.valid_system(random.Random(seed))
    assume(has_whole_jobs(system))
    expansion, jobs = expand(system, system.modes[0]), plan.modes[0].jobs
    tick = greatest_common_divisor([natural_tick(expansion), *(job.start for job in jobs)])
    problem = stated_problem(system, expansion, tick, pinned={})
    state, units = taken_over(problem, jobs, 1)
    again = named_jobs(problem, state.best_start, state.best_option, units)
    assert sorted(map(_placed, again)) == sorted(map(_placed, jobs))


def _placed(job):
    return job.task, job.start.ns, job.end.ns, job.version, job.units


@pytest.mark.parametrize("engine", ["anneal", "exact"])
def test_whoever_finds_the_schedule_it_is_improved(engine):
    system = four_tasks()
    for objective in (Objective.JITTER, Objective.MARGIN):
        scheduled = solved(system, engine=engine, optimise=(objective,))
        assert scheduled.schedule.solver == engine
        (reached,) = scheduled.reached
        assert reached.value <= reached.first
    assert reached.value < reached.first, "the margin of neither is the best at first"


@pytest.mark.slow
@examples(8)
@given(SEEDS, st.permutations([*OBJECTIVES]))
def test_optimising_split_jobs_makes_no_objective_worse(seed, order):
    check_objectives(drawn(seed, split_systems), tuple(order[:2]))


@examples(40)
@given(SEEDS)
def test_bounds_hold_for_schedules_valid_by_construction(seed):
    rng = random.Random(seed)
    system, plan = systems.valid_system(rng)
    system = with_chains(system, rng)
    expansion = expand(system, system.modes[0])
    assert lower_bound(Objective.COST, system, expansion) is None
    for objective in set(OBJECTIVES) - {Objective.COST}:
        (value,) = Judge(system, expansion, (objective,)).worth(plan.modes[0].jobs).values
        assert lower_bound(objective, system, expansion) <= value


def four_tasks():
    rows = (("a", 8, 3), ("b", 16, 4), ("c", 8, 1), ("d", 16, 2))
    tasks = [task(name, period, version("v", wcet, "u1 u2")) for name, period, wcet in rows]
    chains = [replace(chain("one", "a b c"), weight=Fraction(2)), chain("two", "d c")]
    return model(*tasks, units="u1 u2", chains=chains)


def test_the_exact_engine_proves_an_optimum():
    pytest.importorskip("ortools")
    system = four_tasks()
    scheduled = search.schedule_model(system, SearchOptions(optimise=(Objective.CHAINS,)), lambda *_: True)
    (reached,) = scheduled.reached
    assert str(reached).endswith("; the best possible")
    assert reached.value == reached.bound < reached.first
    assert "HAL" not in "".join(d.code for d in verify_schedule(system, scheduled.schedule) if d.is_error)


TOTAL = 16
"""The hyperperiod of the four tasks."""


def latencies_of(runs, names):
    """Return reaction time and data age along a chain, by following each job; `runs` are starts and ends by task."""
    reactions, ages = [], []
    for begin, _ in runs[names[0]]:
        time = begin + 1
        for name in names:
            time = min((end for start, end in runs[name] if start >= time), default=10**6)
        if 0 <= begin < TOTAL:
            reactions.append(time - begin)
    for begin, until in runs[names[-1]]:
        time = begin
        for name in names[-2::-1]:
            time = max((start for start, end in runs[name] if end <= time), default=-(10**6))
        if 0 <= begin < TOTAL:
            ages.append(until - time)
    return max(reactions), max(ages)


def least_sum_by_trying_all_phases(rows, chains, units):
    """Return the least weighted sum of latencies of periodic tasks of which no more than `units` run at a time."""
    sums = []
    for phases in product([0], *(range(period) for period, _ in list(rows.values())[1:])):  # a table may be turned
        runs = {
            name: [(start, start + wcet) for start in range(phase - 4 * TOTAL, 5 * TOTAL, period)]
            for (name, (period, wcet)), phase in zip(rows.items(), phases, strict=True)
        }
        spans = [span for each in runs.values() for span in each]
        if all(sum(start <= time < end for start, end in spans) <= units for time in range(TOTAL)):
            sums.append(sum(weight * sum(latencies_of(runs, names)) for weight, names in chains))
    return min(sums)


def test_the_bound_of_a_pair_of_chains_is_what_trying_all_phases_finds():
    pytest.importorskip("ortools")
    rows = {"a": (8, 3), "b": (16, 4), "c": (8, 1), "d": (16, 2)}
    expected = least_sum_by_trying_all_phases(rows, [(2, "abc"), (1, "dc")], 2)
    system = four_tasks()
    expansion = expand(system, system.modes[0])
    least = dict.fromkeys(system.chains, Fraction(0))
    [(pair, bound)] = exact_goals._pairs(system, expansion, least, Effort()).items()
    assert pair == system.chains
    assert bound == expected * Fraction(milliseconds(1).ns)


def test_each_chain_counts_in_one_pair_at_most():
    one, two, three, four = least = dict.fromkeys([chain(name, "a b") for name in "pqrs"], Fraction(10))
    assert exact_goals._best_gain({}, least) == 0
    pairs = {
        (one, two): Fraction(25),
        (two, three): Fraction(29),
        (three, four): Fraction(27),
        (one, four): Fraction(21),
    }
    assert exact_goals._best_gain(pairs, least) == 9 + 1


@pytest.mark.parametrize("seed", [1, 2])
def test_the_number_of_workers_changes_nothing_that_is_optimised(seed):
    system, aims = four_tasks(), (Objective.CHAINS, Objective.MARGIN)
    one, two, eight = (solved(system, seed=seed, optimise=aims, workers=Workers(count)) for count in (1, 2, 8))
    assert one.schedule == two.schedule == eight.schedule
    assert one.reached == two.reached == eight.reached


def test_each_better_schedule_is_told():
    """Margins are found by the search alone, so that what is told last is what is reached."""
    system, told = four_tasks(), []
    scheduled = solved(system, optimise=(Objective.MARGIN,), on_better=lambda mode, text: told.append((mode, text)))
    (reached,) = scheduled.reached
    assert reached.value < reached.first
    assert told[-1] == (system.modes[0].name, f"margin {value_text(reached.objective, reached.value)}")


@pytest.mark.slow
def test_each_better_schedule_of_split_jobs_is_told():
    rows = (("a", 10, 4, 2), ("b", 20, 4, 2), ("c", 10, 1, None))
    tasks = [
        task(
            n,
            period,
            replace(version("v", wcet, "u1 u2"), split=Split(points=(milliseconds(at),) if at else ())),
            slack=1,
        )
        for n, period, wcet, at in rows
    ]
    system, told = model(*tasks, units="u1 u2", chains=[chain("one", "a b c"), chain("two", "c b")]), []
    options = SearchOptions(optimise=(Objective.CHAINS,), on_better=lambda mode, text: told.append((mode, text)))
    (reached,) = search.schedule_model(system, options, lambda *_: True).reached
    assert reached.value < reached.first
    assert told[-1] == (system.modes[0].name, f"chains {value_text(reached.objective, reached.value)}")


def test_goals_name_what_they_weigh():
    """Every stage may look only at objectives that are judged."""
    for count in (1, 2, 3):
        for objectives in permutations(Objective, count):
            stages = list(optimise.stages_of(objectives))
            assert stages
            assert all(leading <= count for _, leading in stages)
