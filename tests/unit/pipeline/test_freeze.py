"""Shipped jobs stay where they are; what is new is placed around them."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, parted, points, split

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.models import Anchor, Binding, Mode, ResourceKind, Run, Split
from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.shipped import check_shipped, overlaps, staying
from halpipe.pipeline.solve.codes import CANNOT_STAY
from halpipe.pipeline.solve.kernel.search import improved
from halpipe.pipeline.solve.kernel.warmstart import Earlier, rename_units, taken_over
from halpipe.pipeline.solve.optimise import polish_of
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.schedule import schedule_model as search
from support import access, after, job, mode, model, ms, schedule, task, version

UNITS = "u1 u2"


def base(*more, slack=0):
    sense = task("sense", 10, version("v", 3, UNITS, access("mem", 0, 1)), slack=slack)
    act = task("act", 20, version("v", 4, UNITS, after("sense", 0, 8, "end")))
    return model(sense, act, *more, units=UNITS, resources="mem")


def found(system, shipped=None, seed=1, budget=500):
    options = SearchOptions(seed=seed, budget=budget, shipped=shipped)
    return schedule_model(system, options, lambda *progress: True)


def placed(scheduled):
    return {(j.task, j.index): (j.start, j.units, j.version) for j in scheduled.schedule.modes[0].jobs}


def test_shipped_jobs_keep_start_and_units_and_new_ones_fit_in():
    shipped = found(base(slack=Fraction(1, 5)), seed=3)
    grown = base(task("extra", 10, version("v", 2, UNITS, access("mem", 0, 1))), slack=Fraction(1, 5))
    for seed in range(4, 9):
        again = found(grown, shipped.schedule, seed=seed)
        assert again.is_complete
        assert [d for d in verify_schedule(grown, again.schedule) if d.is_error] == []
        assert placed(shipped).items() <= placed(again).items()


def test_everything_shipped_needs_no_moves():
    shipped = found(base())
    again = found(base(), shipped.schedule, seed=9)
    assert again.is_complete
    assert again.moves == 0
    assert placed(again) == placed(shipped)


def test_a_task_whose_version_is_gone_is_placed_anew_and_reported():
    shipped = found(base())
    changed = base()
    renamed = replace(changed.tasks[1], versions=(replace(changed.tasks[1].versions[0], name="w"),))
    changed = replace(changed, tasks=(changed.tasks[0], renamed), modes=(mode("all", (changed.tasks[0], renamed)),))
    again = found(changed, shipped.schedule)
    assert again.is_complete
    assert [d.path for d in again.diagnostics if d.code == CANNOT_STAY.id] == ['mode "all" task "act"']
    assert placed(again)["sense", 0] == placed(shipped)["sense", 0]


def test_shipped_jobs_that_now_collide_are_a_proof_and_no_search():
    system = model(task("a", 10, version("v", 4, "u1")), task("b", 10, version("v", 4, "u1")), units="u1")
    shipped = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"))
    longer = model(task("a", 10, version("v", 6, "u1")), task("b", 10, version("v", 4, "u1")), units="u1")
    with pytest.raises(HalpipeError) as refused:
        found(longer, shipped)
    assert refused.value.exit is Exit.INFEASIBLE


def test_starts_between_the_natural_ticks_are_kept():
    system = base()
    off_grid = schedule(
        system,
        20,
        job(system, "sense", 0, "0.5ms", "u1"),
        job(system, "sense", 1, "10.5ms", "u1"),
        job(system, "act", 0, "4.25ms", "u2"),
    )
    again = found(system, off_grid)
    assert again.is_complete
    assert {j.start for j in again.schedule.modes[0].jobs} == {j.start for j in off_grid.modes[0].jobs}


def renamed(shipped, **changes):
    """Return a shipped schedule whose first job has been changed."""
    (table,) = shipped.modes
    return replace(shipped, modes=(replace(table, jobs=(replace(table.jobs[0], **changes), *table.jobs[1:])),))


@pytest.mark.parametrize("changes", [{"task": "of another system"}, {"index": 99}])
def test_shipped_jobs_without_a_place_in_the_model_are_no_success(changes):
    system = base()
    shipped = renamed(found(system).schedule, **changes)
    with pytest.raises(HalpipeError) as refused:
        check_shipped(system, shipped)
    assert [each.code for each in refused.value.diagnostics] == ["HAL0468"]
    assert refused.value.exit is Exit.FINDINGS


def test_a_shipped_mode_that_the_model_does_not_have_is_no_success():
    system = base()
    shipped = found(system).schedule
    other = replace(shipped, modes=(replace(shipped.modes[0], name="other"),))
    with pytest.raises(HalpipeError) as refused:
        check_shipped(system, other)
    assert {each.code for each in refused.value.diagnostics} == {"HAL0468"}


@pytest.mark.parametrize(("start", "is_possible"), [("2ms", False), ("3ms", True), ("9ms", False), ("8ms", True)])
def test_frozen_jobs_that_exclude_each_other_are_a_proof(start, is_possible):
    """One needs 3 ms from 0 on, the other 2 ms, round a cycle of 10 ms."""
    rows = [task("a", 10, version("v", "3ms", "u1"), slack=1), task("b", 10, version("v", "2ms", "u1"), slack=1)]
    system = model(*rows)
    shipped = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, start, "u1"))
    if is_possible:
        check_shipped(system, shipped)
        return
    with pytest.raises(HalpipeError) as refused:
        check_shipped(system, shipped)
    assert [each.code for each in refused.value.diagnostics] == ["HAL0469"]
    assert refused.value.exit is Exit.INFEASIBLE


def test_preemptive_jobs_that_are_all_shipped_stay_where_windows_from_releases_hold():
    wide = after("a", 0, 6, "release")
    split = Split(points=(ms("500us"),))
    first = task("a", 6, version("v", 1, "u1"), slack=1, offset=0)
    second = task("b", 6, replace(version("v", 1, "u1", wide), split=split), slack=1, offset=0)
    made = model(first, second)
    shipped = schedule(made, 6, job(made, "a", 0, 0, "u1"), job(made, "b", 0, 3, "u1"))
    assert not [d for d in verify_schedule(made, shipped) if d.is_error]
    again = found(made, shipped)
    assert again.is_complete
    assert placed(again) == {(j.task, j.index): (j.start, j.units, j.version) for j in shipped.modes[0].jobs}


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("offset", [None, 0])
def test_a_task_whose_slack_no_longer_allows_its_starts_is_placed_anew(split, offset):
    short = version("v", 1, "u1")
    short = replace(short, split=Split(points=(ms("500us"),))) if split else short
    was, now = (
        model(task("a", 10, short, slack=slack, offset=offset), task("b", 20, version("v", 1, "u1")))
        for slack in (1, Fraction(2, 10))
    )
    shipped = schedule(was, 20, job(was, "a", 0, 1, "u1"), job(was, "a", 1, 14, "u1"), job(was, "b", 0, 6, "u1"))
    assert not [d for d in verify_schedule(was, shipped) if d.is_error]
    again = found(now, shipped)
    assert again.is_complete
    assert [d.code for d in again.diagnostics if d.code == CANNOT_STAY.id] == [CANNOT_STAY.id]
    assert placed(again)["b", 0][0] == ms(6)
    closer = schedule(now, 20, job(now, "a", 0, 0, "u1"), job(now, "a", 1, 12, "u1"), job(now, "b", 0, 6, "u1"))
    kept = found(now, closer)
    assert placed(kept) == {(j.task, j.index): (j.start, j.units, j.version) for j in closer.modes[0].jobs}


def test_a_task_that_cannot_stay_where_it_was_excludes_no_other():
    """a starts 4 ms after its release, which its slack no longer allows; so it meets b at 5 ms no more."""
    rows = task("b", 20, version("v", 2, "u1"))
    was, now = (model(task("a", 10, version("v", 2, "u1"), slack=slack), rows) for slack in (1, Fraction(1, 10)))
    shipped = schedule(was, 20, job(was, "a", 0, 0, "u1"), job(was, "a", 1, 14, "u1"), job(was, "b", 0, 15, "u1"))
    with pytest.raises(HalpipeError):
        check_shipped(was, shipped)
    again = found(now, shipped)
    assert again.is_complete
    assert [d.path for d in again.diagnostics if d.code == CANNOT_STAY.id] == ['mode "all" task "a"']
    assert placed(again)["b", 0][0] == ms(15)


@pytest.mark.parametrize("split", [False, True])
def test_a_task_that_starts_between_the_ticks_that_are_asked_for_is_placed_anew(split):
    short = version("v", 2, UNITS)
    short = replace(short, split=Split(points=(ms(1),))) if split else short
    system = model(task("a", 10, short, slack=1), task("b", 10, short, slack=1), units=UNITS)
    shipped = schedule(system, 10, job(system, "a", 0, "1.5ms", "u1"), job(system, "b", 0, 3, "u1"))
    check_shipped(system, shipped, ms(1))
    options = SearchOptions(budget=50, tick=ms(1), shipped=shipped)
    again = schedule_model(system, options, lambda *_: True)
    assert again.is_complete
    assert not any(job.start % ms(1) for job in again.schedule.modes[0].jobs)
    assert placed(again)["b", 0] == (ms(3), ("u1",), "v")
    [why] = [d for d in again.diagnostics if d.code == CANNOT_STAY.id]
    assert 'task "a"' in why.path
    assert "between the ticks" in why.message
    near = schedule_model(system, replace(options, shipped=None, near=shipped), lambda *_: True)
    assert "a (starts between the ticks); no schedule moves fewer: proven" in near.diagnostics[-1].message


def test_a_task_that_cannot_stay_may_take_other_units():
    """a starts too late after its release, and u1, where it was, has no room for it but there."""
    fills = task("fills", 10, version("v", 8, "u1"), offset=0)
    was, now = (
        model(fills, task("a", 10, version("v", 2, UNITS), slack=slack, offset=5), units=UNITS) for slack in (1, 0)
    )
    shipped = schedule(was, 10, job(was, "fills", 0, 0, "u1"), job(was, "a", 0, 8, "u1"))
    again = found(now, shipped)
    assert again.is_complete
    assert placed(again) == {("fills", 0): (ms(0), ("u1",), "v"), ("a", 0): (ms(5), ("u2",), "v")}


def test_a_job_in_parts_of_a_version_that_is_split_no_more_is_placed_anew():
    system = model(task("a", 10, version("v", 4, "u1"), slack=1))
    shipped = schedule(system, 10, parted("a", 0, "u1", (0, 2, 0, 2), (3, 5, 2, 4)))
    assert [d.code for d in found(system, shipped).diagnostics] == [CANNOT_STAY.id]


def test_jobs_of_other_modes_than_those_asked_for_exclude_nothing():
    rows = [task("a", 10, version("v", 4, "u1"), slack=1), task("b", 10, version("v", 4, "u1"), slack=1)]
    system = model(*rows, modes=[mode("all", rows), mode("one", rows[:1])])
    shipped = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 2, "u1"))
    options = SearchOptions(budget=50, shipped=shipped)
    assert schedule_model(system, replace(options, modes=("one",)), lambda *_: True).is_complete
    with pytest.raises(HalpipeError):
        schedule_model(system, options, lambda *_: True)


@pytest.mark.parametrize("split", [False, True])
def test_a_gang_stays_on_no_units_whose_interrupts_leave_no_time(split):
    chosen = version("v", 2, "u1 u2 u3", gang=2)
    chosen = replace(chosen, split=Split(points=(ms(1),))) if split else chosen
    was = model(task("a", 12, chosen, slack=1), units="u1 u2 u3")
    now = interrupts(interrupts(was, "u1", (4, 2)), "u2", (4, 2))
    shipped = schedule(was, 12, job(was, "a", 0, 1, "u1 u2"))
    options = SearchOptions(budget=50, optimise=())
    again = schedule_model(now, replace(options, shipped=shipped), lambda *_: True)
    assert again.is_complete
    assert [d.code for d in again.diagnostics] == [CANNOT_STAY.id]
    near = schedule_model(now, replace(options, near=shipped), lambda *_: True)
    assert "a (has no time beside the interrupts of its units)" in near.diagnostics[-1].message


@pytest.mark.parametrize("split", [False, True])
def test_jobs_of_a_bound_task_stay_on_one_unit_set_alone(split):
    short = version("v", 2, UNITS)
    short = replace(short, split=Split(points=(ms(1),))) if split else short
    free = model(task("a", 5, short), task("b", 10, version("v", 2, UNITS)), units=UNITS)
    shipped = schedule(free, 10, job(free, "a", 0, 0, "u1"), job(free, "a", 1, 5, "u2"), job(free, "b", 0, 2, "u2"))
    bound = replace(free, tasks=(replace(free.tasks[0], binding=Binding.MODE), free.tasks[1]))
    assert found(free, shipped).diagnostics == ()
    again = found(bound, shipped)
    assert again.is_complete
    assert [d.path for d in again.diagnostics] == ['mode "all" task "a"']


def test_a_task_bound_in_the_whole_system_stays_where_all_modes_have_it():
    """In mode one its version takes u1 or u3; where it has shipped on u2, or on one unit in each mode, it is freed."""
    task_a = replace(task("a", 10, version("v", 2, "u1 u3"), version("w", 2, "u1 u2 u3")), binding=Binding.SYSTEM)
    runs = (Mode(name=name, runs=(Run(task="a", versions=(v,)),)) for name, v in (("one", "v"), ("two", "w")))
    system = model(task_a, units="u1 u2 u3", modes=runs)
    tables = [schedule(system, 10, job(system, "a", 0, 1, "u1", "v"), mode_name="one").modes[0]]
    for unit, stays in (("u1", True), ("u2", False), ("u3", False)):
        two = schedule(system, 10, job(system, "a", 0, 1, unit, "w"), mode_name="two")
        again = found(system, replace(two, modes=(*tables, *two.modes)))
        assert again.is_complete
        assert {d.path for d in again.diagnostics if d.code == CANNOT_STAY.id} == (
            set() if stays else {'mode "one" task "a"', 'mode "two" task "a"'}
        )
        alone = found(system, two)
        assert alone.is_complete
        assert [d.code for d in alone.diagnostics] == ([CANNOT_STAY.id] if unit == "u2" else [])


@pytest.mark.parametrize(("start", "stays"), [(9, True), (10, False)])
def test_a_task_with_a_let_stays_if_its_first_release_is_in_its_first_period(start, stays):
    system = model(replace(task("a", 10, version("v", 2), slack=Fraction(1, 4)), let=ms(10)), task("b", 20, version()))
    shipped = schedule(system, 20, *(job(system, "a", n, (start + 10 * n) % 20, "u1") for n in (0, 1)))
    again = found(system, shipped)
    assert again.is_complete
    assert [d.code for d in again.diagnostics] == ([] if stays else [CANNOT_STAY.id])


@pytest.mark.parametrize(("offset", "stays"), [(1, False), (2, True)])
def test_a_task_with_a_let_stays_if_it_ends_by_then(offset, stays):
    system = model(replace(task("a", 10, version("v", 2), slack=1, offset=offset), let=ms(5)))
    shipped = schedule(system, 10, job(system, "a", 0, 5, "u1"))
    assert [d.code for d in found(system, shipped).diagnostics] == ([] if stays else [CANNOT_STAY.id])


def overlapping(system, *jobs):
    """Return unit, begin, end and the jobs of every overlap, as tasks with indices."""
    expansion = expand(system, system.modes[0])
    return [
        (unit, begin, end, f"{one.task}{one.index}", f"{other.task}{other.index}")
        for unit, begin, end, one, other in overlaps(expansion, jobs)
    ]


def test_overlaps_name_the_unit_and_the_time_also_round_the_edge():
    rows = [task("a", 10, version("v", 4, UNITS, gang=2), slack=1), task("b", 20, version("v", 3, UNITS), slack=1)]
    system = model(*rows, units=UNITS)
    a, late, b = job(system, "a", 0, 1, UNITS), job(system, "a", 1, 11, UNITS), job(system, "b", 0, 4, "u2")
    assert overlapping(system, b, late, a) == [("u2", ms(4), ms(5), "a0", "b0")]
    around = job(system, "b", 0, 19, "u1")
    assert overlapping(system, around, late, a) == [("u1", ms(21), ms(22), "b0", "a0")]
    assert overlapping(system, job(system, "b", 0, 18, "u1"), a) == []
    assert overlapping(system, around) == []


def test_of_three_jobs_at_a_time_neighbours_are_named():
    rows = [task(name, 20, version("v", 4), slack=1) for name in "abc"]
    system = model(*rows)
    jobs = [job(system, name, 0, start, "u1") for name, start in (("a", 2), ("b", 2), ("c", 5))]
    assert [found[3:] for found in overlapping(system, *jobs)] == [("a0", "b0"), ("b0", "c0")]


@pytest.mark.parametrize(
    ("changes", "stays"),
    [
        ({}, True),
        ({"start": ms(20)}, False),
        ({"start": ms("19.9ms")}, True),
        ({"version": "w"}, False),
        ({"units": ("u3",)}, False),
        ({"units": ("u1", "u2")}, False),
        ({"index": 1, "task": "new"}, False),
    ],
)
def test_jobs_of_a_task_stay_if_all_of_them_can(changes, stays):
    system = model(task("b", 20, version("v", 3, UNITS), slack=1), units="u1 u2 u3")
    expansion, one = expand(system, system.modes[0]), replace(job(system, "b", 0, 4, "u2"), **changes)
    assert list(staying(expansion, [one])) == ([one] if stays else [])


def test_a_task_of_which_a_job_is_missing_or_in_parts_does_not_stay():
    system = model(task("a", 10, version("v", 4)), task("b", 20, version("v", 1)))
    expansion = expand(system, system.modes[0])
    whole = [job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u1"), job(system, "b", 0, 5, "u1")]
    assert list(staying(expansion, whole)) == whole
    assert list(staying(expansion, whole[1:])) == whole[2:]
    cut = parted("a", 0, "u1", (0, 2, 0, 2), (3, 5, 2, 4))
    assert list(staying(expansion, [cut, *whole[1:]])) == whole[2:]


def test_a_shipped_job_beyond_those_of_its_task_says_how_many_there_are():
    system = model(task("a", 10, version("v", 4)), task("b", 20, version("v", 1)))
    jobs = [job(system, "a", 0, 0, "u1"), replace(job(system, "a", 1, 10, "u1"), index=2)]
    with pytest.raises(HalpipeError) as refused:
        check_shipped(system, schedule(system, 20, *jobs))
    [finding] = refused.value.diagnostics
    assert "the task has 2 jobs in this mode" in finding.message
    check_shipped(system, schedule(system, 20, jobs[0], replace(jobs[1], index=1)))


@pytest.mark.parametrize(("start", "stays"), [(9, True), (10, False)])
def test_a_task_whose_jobs_lie_outside_the_hyperperiod_may_take_any_units(start, stays):
    """u1 is full from 0 to 9 ms: a job of another version that starts at its end has room on u2 alone."""
    fills, moves = task("fills", 10, version("v", 9, "u1")), task("moves", 10, version("v", 1 if stays else 2, UNITS))
    system = model(fills, moves, units=UNITS)
    there = job(system, "moves", 0, 9, "u1")
    there = replace(there, start=there.start + ms(start) - ms(9), end=there.end + ms(start) - ms(9))
    shipped = schedule(system, 10, job(system, "fills", 0, 0, "u1"), there)
    again = search(system, SearchOptions(budget=500, shipped=shipped), lambda *_: True)
    assert again.is_complete
    assert placed(again)["moves", 0][1] == (("u1",) if stays else ("u2",))
    assert [d.code for d in again.diagnostics] == ([] if stays else [CANNOT_STAY.id])


def test_phases_of_jobs_that_stay_count_from_the_offset_or_from_the_first_job():
    """A job of an offset is only ever later, even by more than half of the hyperperiod; others come earlier, too."""
    system = model(
        task("late", 20, version("v", 1, "u1"), offset=0, slack=1),
        task("fixed", 5, version("v", 1, "u2"), offset=2, slack=1),
        task("free", 5, version("v", 1, "u3"), slack=1),
        task("asks", 20, version("v", 1, "u4", after("h", 0, 19)), slack=1),
        task("zero", 5, version("v", 1, "u5"), offset=0, slack=1),
        task("wide", 10, version("v", 1, "u6"), slack=1),
        task("h", None, version("v", 1, "u4")),
        units="u1 u2 u3 u4 u5 u6",
    )
    starts = {"late": [19], "fixed": [2, 11, 12, 18], "free": [3, 7, 14, 18], "asks": [13]}
    starts |= {"zero": [3, 5, 10, 15], "wide": [8, 11], "h": [12]}
    units = dict(zip(starts, ("u1", "u2", "u3", "u4", "u5", "u6", "u4"), strict=True))
    jobs = [
        job(system, name, index, start, units[name])
        for name, found in starts.items()
        for index, start in enumerate(found)
    ]
    problem = build_problem(expand(system, system.modes[0]), system.units, [], tick=ms(1), grouped=False)
    state, _ = taken_over(problem, jobs, 1)
    assert state.start.tolist() == [start for found in starts.values() for start in found]
    assert state.phase.tolist() == [19, 2, 6, 2, 3, 3, 2, 4, 3, 13, 3, 0, 0, 0, 8, 1, 12]


@pytest.mark.parametrize(
    ("offset", "starts", "phases"),
    [
        (0, (3, 12), [3, 2]),
        (0, (0, 19), [0, 9]),
        (1, (3, 12), [3, 2]),
        (None, (0, 19), [0, 9]),
        (None, (9, 10), [9, 0]),
        (0, (18,), [18]),  # far from its offset, it is late, and not early
        (1, (19,), [19]),
        (None, (18,), [18]),
    ],
)
def test_phases_of_what_is_taken_over_lie_behind_an_offset_or_around_the_first_job(offset, starts, phases):
    cycle = 21 if len(starts) == 1 else 20  # an odd one has no half
    owner = model(
        task("a", cycle // len(starts), version(), offset=offset, slack=1),
        task("b", cycle, version("v", 1, "u2")),
        units=UNITS,
    )
    problem = build_problem(expand(owner, owner.modes[0]), owner.units, [], [])
    jobs = [job(owner, "a", index, start, "u1") for index, start in enumerate(starts)]
    state, _ = taken_over(problem, [*jobs, job(owner, "b", 0, 0, "u2")], 1)
    assert state.phase.tolist() == [*phases, 0]


@pytest.mark.parametrize(
    ("unit", "start", "is_taken"), [("u1", 4, True), ("u9", 4, False), ("u1", 3, False), ("u1", 20, False)]
)
def test_only_a_valid_schedule_on_units_that_there_are_is_taken_over(unit, start, is_taken):
    owner = model(task("a", 10, version("v", 4)), task("b", 10, version("v", 4)))
    problem = build_problem(expand(owner, owner.modes[0]), owner.units, [], [])
    jobs = [job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, start, unit)]
    assert (taken_over(problem, jobs, 1) is not None) == is_taken
    wanted = polish_of(owner, problem.expansion, (Objective.JITTER,), None, 1, lambda _: None, 1)
    assert (improved(problem, jobs, wanted, lambda *_: True) is not None) == is_taken


def test_units_of_a_group_are_named_as_before_by_most_jobs():
    """Three jobs on u1 were on u2 twice and on u3 once, the one on u2 there as well; v1 is of another group than u1."""
    group, names = "u1 u2 u3", ("a", "b", "c", "d", "e")
    tasks = [*(task(name, 10, version("v", 1, group)) for name in names), task("f", 10, version("v", 1, "v1 v2"))]
    owner = model(*tasks, units=f"{group} v1 v2")
    problem = build_problem(expand(owner, owner.modes[0]), owner.units, [], [])
    now = dict(enumerate((unit,) for unit in ("u1", "u2", "u3", "u1", "u1", "v1")))
    before = {"a": "u2", "b": "u2", "d": "u2", "e": "u3", "f": "u1"}
    renamed = rename_units(problem, now, Earlier(units={(name, 0): (unit,) for name, unit in before.items()}))
    assert [renamed[number] for number in range(6)] == [("u2",), ("u1",), ("u3",), ("u2",), ("u2",), ("v1",)]


def test_the_first_mode_that_runs_a_task_decides_where_later_ones_try_it_first():
    """By the least start within the period; a task that is bound in the whole system stays on its units."""
    tied = replace(task("tied", 20, version("v", 1, UNITS)), binding=Binding.SYSTEM)
    owner = model(
        task("a", 10, version(), slack=1), task("b", 10, version(), slack=1), task("h", None, version()), tied
    )
    placed = ("a", 0, 7, "u1"), ("a", 1, 15, "u1"), ("b", 0, 4, "u1"), ("b", 1, 12, "u1"), ("h", 0, 3, "u1")
    jobs = [job(owner, *each) for each in (*placed, ("tied", 0, 0, "u2"))]
    before = Earlier(phases={"b": ms(9)}, units={("a", 1): ("u2",)})
    found = before.and_then(expand(owner, owner.modes[0]), jobs)
    assert found.phases == {"a": ms(5), "b": ms(9), "tied": ms(0)}
    assert found.pins == {"tied": {1: frozenset({"u2"})}}
    units = {(name, index): (unit,) for name, index, _, unit in placed}
    assert found.units == units | {("a", 1): ("u2",), ("tied", 0): ("u2",)}


def test_jobs_of_which_one_is_in_parts_or_outside_are_not_taken_over():
    owner = model(task("a", 10, version("v", 4), slack=1), task("b", 20, version("v", 1)))
    problem = build_problem(expand(owner, owner.modes[0]), owner.units, [], [])
    last, whole = job(owner, "b", 0, 4, "u1"), [job(owner, "a", 0, 0, "u1"), job(owner, "a", 1, 10, "u1")]
    assert taken_over(problem, [*whole, last], 1) is not None
    assert taken_over(problem, [whole[0], job(owner, "a", 1, 20, "u1"), last], 1) is None
    assert taken_over(problem, [whole[0], parted("a", 1, "u1", (10, 14, 0, 4)), last], 1) is None


@pytest.mark.parametrize(("starts", "is_taken"), [((7, 17, 27), True), ((17, 27, 7), True), ((7, 18, 27), False)])
def test_jobs_from_whose_releases_others_count_are_taken_over_if_they_are_a_period_apart(starts, is_taken):
    counted = replace(after("a", 0, 29), anchor=Anchor.RELEASE)
    owner = model(
        task("a", 10, version(), slack=1),
        task("b", 30, version("v", 1, "u2", counted), offset=0, slack=1),
        units=UNITS,
    )
    problem = build_problem(expand(owner, owner.modes[0]), owner.units, [], [])
    jobs = [job(owner, "a", index, start, "u1") for index, start in enumerate(starts)]
    assert (taken_over(problem, [*jobs, job(owner, "b", 0, 0, "u2")], 1) is not None) == is_taken


@pytest.mark.parametrize("how", [points(2, max_gaps=1), Split(anywhere=True, max_gaps=1)])
def test_a_job_that_holds_a_lock_through_its_gap_stays(how):
    """It holds the lock from 2 to 7 ms, while another job runs in its gap; the memory is used after that."""
    wants = access("lock", 1, 4), access("memory", 4, 6, "1/2")
    system = model(
        task("long", 20, split(version("v", 6, "u1", *wants), how)),
        task("short", 20, version("v", 2), offset=3),
        task("other", 20, version("v", 1, "u2", access("lock", 0, 1)), slack=1),
        units=UNITS,
        resources="lock memory",
    )
    locks = replace(system.resources[0], kind=ResourceKind.LOCK), system.resources[1]
    system = replace(system, resources=locks)
    long = parted("long", 0, "u1", (1, 3, 0, 2), (5, 9, 2, 6))
    shipped = schedule(system, 20, long, job(system, "short", 0, 3, "u1"), job(system, "other", 0, 7, "u2"))
    again = found(system, shipped, budget=50)
    assert (again.is_complete, again.schedule.modes[0].jobs[0], again.diagnostics) == (True, long, ())
