"""What the search calls valid verifies, what can be scheduled is found, and the bytes depend on the seed alone."""

import random

import pytest
import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st
from scheduler_systems import random_model

from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.core.durations import milliseconds
from halpipe.exporters.native import format_schedule
from halpipe.importers.native import parse_schedule
from halpipe.models import Status
from halpipe.pipeline.checked import validate_model
from halpipe.pipeline.solve.kernel import assign_units as dealing
from halpipe.pipeline.solve.kernel import slices
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.verify import verify
from profiles import examples, volume

SEEDS = st.integers(0, 2**32)
FAST = examples(100)
BUDGET = 2000
"""Moves per task: a tenth of the default, which is plenty for a handful of tasks."""


def go_on(*_):
    return True


def found(system, seed=1, **options):
    options.setdefault("budget", BUDGET)
    return schedule_model(system, SearchOptions(seed=seed, **options), go_on).schedule


def violations(system, plan):
    """Verify what a reader of the written file gets."""
    written = format_schedule(plan)
    return [render_text(d) for d in verify(system, parse_schedule(written, "plan.xml")) if d.is_error]


def is_sound(system):
    return not any(d.is_error for d in validate_model(system))


def is_valid(plan):
    return all(table.status is Status.VALID for table in plan.modes)


def check(system, plan):
    """A valid table verifies and its cost is at most zero; any other has a cost above zero and all its tasks."""
    if is_valid(plan):
        assert violations(system, plan) == []
        assert plan.modes[0].cost.total <= 0
    else:
        assert plan.modes[0].cost.total > 0
        periodic = {task.name for task in system.tasks if task.period is not None}
        assert periodic <= {job.task for job in plan.modes[0].jobs}


def schedulable(seed):
    """Return a model that a schedule exists for by construction, or None where its unused versions are unsound."""
    system, _ = systems.valid_system(random.Random(seed))
    return system if is_sound(system) else None


# ------------------------------------------------------------------------------------------------ soundness


@FAST
@given(SEEDS)
def test_what_the_search_calls_valid_verifies(seed):
    system = random_model(seed)
    assume(is_sound(system))
    check(system, found(system, seed % 7, budget=300))


@FAST
@given(SEEDS, st.sampled_from([None, milliseconds(1) / 2, milliseconds(1)]))
def test_what_is_valid_on_a_coarse_grid_is_valid_exactly(seed, tick):
    """WCETs, phases and windows lie between the ticks; the grid rounds them, and verify does not."""
    system = random_model(seed, grain=5)
    assume(is_sound(system))
    try:
        plan = found(system, budget=300, tick=tick)
    except HalpipeError as failure:  # the grid leaves some task no version
        assume({d.code for d in failure.diagnostics} != {"HAL0405"})
        raise
    if is_valid(plan):
        assert violations(system, plan) == []


# ------------------------------------------------------------------------------------------------ completeness


def count_unsolved(seeds, **options):
    """Search for every schedulable model; return those without a schedule, and how many there were."""
    unsolved, tried = [], 0
    for seed in seeds:
        system = schedulable(seed)
        if system is not None:
            tried += 1
            plan = found(system, **options)
            check(system, plan)
            if not is_valid(plan):
                unsolved.append(seed)
    return unsolved, tried


@pytest.mark.slow
def test_schedules_are_found_where_they_exist():
    count = volume(100)
    unsolved, tried = count_unsolved(range(count))
    assert tried > count * 5 // 6
    assert len(unsolved) <= tried // 100, unsolved


@pytest.mark.slow
def test_schedules_are_found_where_they_exist_at_length():
    count = volume(250)
    unsolved, tried = count_unsolved(range(count), budget=20_000)
    assert tried > count * 5 // 6
    assert len(unsolved) <= tried // 500, unsolved


@pytest.mark.slow
@pytest.mark.parametrize("grain", [1, 3])
def test_soundness_at_length(grain):
    solved, count = 0, volume(200)
    for seed in range(count):
        system = random_model(seed, grain)
        if is_sound(system):
            plan = found(system, budget=500)
            check(system, plan)
            solved += is_valid(plan)
    assert solved > count // 10


# ------------------------------------------------------------------------------------------------ determinism


def text_of(system, seed=1):
    return format_schedule(found(system, seed))


def modest(seeds):
    """Yield schedulable models that take the search some moves."""
    for seed in seeds:
        system = schedulable(seed)
        if system is not None and len(system.tasks) > 2:
            yield system


@pytest.mark.slow
@pytest.mark.parametrize("slice_work", [1, 140, 20_000])
def test_the_bytes_do_not_depend_on_the_slices(monkeypatch, slice_work):
    """Slices of 1 move, of some, and of many."""
    expected = [text_of(system) for system in modest(range(40))]
    monkeypatch.setattr(slices, "SLICE_WORK", slice_work)
    assert [text_of(system) for system in modest(range(40))] == expected


def test_other_seeds_give_other_schedules():
    for system in modest(range(12)):
        assert text_of(system, 1) == text_of(system, 1)
    pairs = [(found(system, 1), found(system, 2)) for system in modest(range(12))]
    assert any(one.modes != other.modes for one, other in pairs)


@examples(60)
@given(SEEDS, st.integers(0, 12))
def test_a_search_that_is_stopped_returns_every_job(seed, count):
    """Stopped after any number of moves, in the construction too, the placement is complete and its cost stated."""
    system = random_model(seed)
    assume(is_sound(system))
    calls = []

    def stop(*progress):
        calls.append(progress)
        return len(calls) <= count

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(slices, "SLICE_WORK", 1)
        scheduled = schedule_model(system, SearchOptions(budget=BUDGET), stop)
    if any(chain.max_reaction or chain.max_age or chain.max_latency for chain in system.chains):
        pass  # the construction along chains counts its moves in one piece
    elif scheduled.stopped:
        assert scheduled.moves == count + 1
        assert [moves for _, moves, _, _ in calls][: count + 1] == list(range(1, count + 2))
    else:
        assert len(calls) <= count + 2  # after the stop, one call tells how it ended: valid when completed
        assert is_valid(scheduled.schedule)
    check(system, scheduled.schedule)


@examples(60)
@given(SEEDS, st.integers(1, 3))
def test_a_budget_too_small_to_place_all_jobs_is_survived(seed, budget):
    system = random_model(seed)
    assume(is_sound(system))
    check(system, found(system, budget=budget))


@pytest.mark.slow
def test_units_that_cannot_be_dealt_out_are_searched_one_by_one(monkeypatch):
    deal = dealing.assign_units
    refused = []

    def refuse(arcs, units, hyperperiod):
        if units == 1:
            return deal(arcs, units, hyperperiod)
        refused.append(units)
        return None

    monkeypatch.setattr(dealing, "assign_units", refuse)
    unsolved, tried = count_unsolved(range(100))
    assert len(refused) > tried // 3
    assert len(unsolved) <= tried // 50, unsolved
