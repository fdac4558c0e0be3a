"""The driver of the kernel: names come back, phases are canonical, large gangs survive, Ctrl-C is answered."""

from dataclasses import replace

import pytest
from placed_cases import roborace

from halpipe.models import Status
from halpipe.pipeline.checked import explain_failure
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve import lanes
from halpipe.pipeline.solve.codes import NOT_FOUND
from halpipe.pipeline.solve.kernel import assign_units as dealing
from halpipe.pipeline.solve.one_mode import Found
from halpipe.pipeline.solve.schedule import SearchOptions, _Modes, schedule_model
from halpipe.pipeline.verify import verify
from support import access, after, chain, mode, model, ms, task, version


def found(system, progress=lambda *_: True, **options):
    return schedule_model(system, SearchOptions(**options), progress)


def check_valid(system, **options):
    """Return the jobs of the one mode, which must be found and verify."""
    plan = found(system, **options).schedule
    assert plan.modes[0].status is Status.VALID
    assert [d.message for d in verify(system, plan) if d.is_error] == []
    return plan.modes[0].jobs


def test_the_papers_stack_is_pipelined_over_three_hyperperiods():
    system = roborace(92, 67)
    jobs = {job.task: job for job in check_valid(system)}
    assert set(jobs) == {"particle_filter", "opponent_detection", "spliner", "pure_pursuit"}
    assert all(ms(0) <= job.start < ms(25) for job in jobs.values())


@pytest.mark.parametrize("seed", range(8))
def test_slack_below_a_fixed_offset_is_used(seed):
    """Job b must wait for job a, although its own unit is free, and only its slack lets it."""
    system = model(
        task("a", 10, version("v", 4), offset=0),
        task("b", 10, version("v", 4, "u2", after("a", 0, 1, "end")), offset=1, slack="1/2"),
        units="u1 u2",
    )
    starts = {job.task: job.start for job in check_valid(system, seed=seed)}
    assert starts["b"] in (ms(4), ms(5))


def test_the_phase_of_a_task_lies_in_its_first_period():
    """Whatever the moves of single jobs did to it."""
    tasks = [task(f"t{n}", 5, version("v", 2), slack="1/2") for n in range(2)]
    system = model(*tasks, task("long", 40, version("v", 3)))
    for seed in range(5):
        for job in check_valid(system, seed=seed):
            late = (job.start - ms(5) * job.index) % ms(40) if job.task != "long" else ms(0)
            assert late < ms("7.5ms")


def test_jobs_on_demand_serve_the_version_that_was_chosen():
    """Only the short version fits beside the others, and it needs its helper twice."""
    system = model(
        task("a", 10, version("long", 9), version("short", 1, "u1", after("h", 2, 6), after("h", 0, 4))),
        task("b", 10, version("v", 3)),
        task("h", None, version("v", 2)),
    )
    jobs = check_valid(system)
    assert sorted((job.task, job.index, job.version) for job in jobs) == [
        ("a", 0, "short"),
        ("b", 0, "v"),
        ("h", 0, "v"),
        ("h", 1, "v"),
    ]


def test_demands_keep_their_jobs_where_phases_drift():
    """Jobs of a task that demands others keep their numbers, for the numbers say which demand a job serves."""
    helped = version("helped", 2, "u1 u2", after("h", 2, 2))
    system = model(
        task("a", 4, version("v", 1, "u1 u2"), helped, slack=1, deadline=6),
        task("b", 12, version("v", 8, "u1"), offset=1),
        task("h", None, version("v", 1, "u2")),
        units="u1 u2",
    )
    for seed in range(20):
        check_valid(system, seed=seed)


def test_what_a_job_claims_twice_at_once_is_added_up():
    system = model(
        task("a", 10, version("v", 4, "u1", access("r", 0, 4, "2/5"), access("r", 0, 4, "2/5"))),
        task("b", 10, version("v", 6, "u2", access("r", 0, 6, "3/10"))),
        units="u1 u2",
        resources="r",
    )
    check_valid(system)


def test_a_limit_of_zero_is_a_limit():
    system = model(task("a", 10, version()), chains=[chain("c", "a", reaction=0)])
    assert found(system, budget=10).schedule.modes[0].status is Status.NOT_FOUND


def test_a_chain_through_a_task_without_jobs_is_not_kept():
    system = model(task("a", 10, version()), task("h", None, version()), chains=[chain("c", "h", 90)])
    assert found(system, budget=10).schedule.modes[0].status is Status.NOT_FOUND


def test_gangs_too_large_for_all_their_sets_go_on_unit_by_unit(monkeypatch):
    monkeypatch.setattr(lanes, "MAX_OPTIONS_PER_VERSION", 3)
    monkeypatch.setattr(
        dealing, "assign_units", lambda arcs, units, _: None if units > 1 else {a.job: (0,) for a in arcs}
    )
    names = " ".join(f"u{n}" for n in range(6))
    system = model(*(task(f"t{n}", 10, version("v", 3, names, gang=4)) for n in range(3)), units=names)
    check_valid(system)


def test_every_mode_is_searched_and_the_chosen_ones_only_if_asked():
    a, b = task("a", 10, version()), task("b", 5, version())
    system = model(a, b, modes=[mode("one", [a]), mode("two", [a, b])])
    assert [table.name for table in found(system).schedule.modes] == ["one", "two"]
    assert [table.name for table in found(system, modes=("two",)).schedule.modes] == ["two"]


def test_a_mode_waits_for_those_before_it_up_to_the_one_that_has_all_jobs_of_its_tasks():
    """Of jobs on demand, another mode may have others."""
    a, long, other = task("a", 10, version()), task("long", 20, version()), task("other", 20, version())
    asks, h = task("asks", 20, version("v", 1, "u1", after("h", 0, 9))), task("h", None, version())
    runs = {"half": [a], "full": [a, long], "again": [a, long], "last": [a, other], "one": [asks, h], "two": [asks, h]}
    modes = [mode(name, tasks) for name, tasks in {**runs, "three": [asks, h]}.items()]
    system = model(a, long, other, asks, h, modes=modes)
    tables = found(system).schedule.modes
    search = _Modes(system, [expand(system, each) for each in modes], SearchOptions(), lambda *_: True, {})
    known = {number: Found(table, []) for number, table in enumerate(tables)}
    failed = Found(replace(tables[1], status=Status.NOT_FOUND), [])
    assert search._start(3, {}) is search._start(3, {0: known[0]}) is None  # of the two jobs of a, one is known
    assert search._start(3, {0: known[0], 1: known[1]}) == search._start(3, known)
    assert search._start(3, {0: known[0], 1: failed}) is None
    assert search._start(6, {4: known[4]}) is None
    assert search._start(6, {4: known[4], 5: known[5]}) == search._start(6, known)


def test_a_search_that_is_stopped_leaves_the_modes_after_it():
    a = task("a", 10, version("v", 6))
    b = task("b", 10, version("v", 6))
    system = model(a, b, modes=[mode("one", [a, b]), mode("two", [a])])
    done = found(system, lambda *_: False)
    assert done.stopped
    assert [table.name for table in done.schedule.modes] == ["one"]
    assert len(done.schedule.modes[0].jobs) == 2


def test_a_failed_search_says_what_is_still_broken():
    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)))
    done = found(system, budget=50)
    table = done.schedule.modes[0]
    assert table.status is Status.NOT_FOUND
    assert (table.cost.overlap, done.moves) == (1, 50 * 2)  # 12 ms of work in 10 ms: a tick of 2 ms
    assert NOT_FOUND.id in [d.code for d in explain_failure(system, done, interrupted=False)]


def test_progress_counts_moves_up_to_the_budget():
    told = []

    def progress(name, moves, budget, best):
        told.append((name, moves, budget, best))
        return True

    system = model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)))
    found(system, progress, budget=3000)
    assert {(name, budget) for name, _, budget, _ in told} == {("all", 6000)}
    assert told[-1][1] == 6000
    assert [moves for _, moves, _, _ in told] == sorted(moves for _, moves, _, _ in told)
    assert all(best >= 0 for _, _, _, best in told)
