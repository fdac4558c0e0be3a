"""Loads, latencies and costs of schedules with parts, bound tasks, interrupts and sporadic arrivals (MODEL 8)."""

from dataclasses import replace
from fractions import Fraction
from random import Random

import pytest
from split_cases import split_example, with_job, with_part
from split_helpers import points, split

from halpipe.models import Binding, Interrupt, ResourceKind, Split, Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import cost_terms, mode_report
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.measure.splitting import _Boundaries, _Spans, parts_cost
from halpipe.pipeline.parts import job_of
from support import access, job, model, ms, task, version


def report(system, jobs):
    return mode_report(system, expand(system, system.modes[0]), jobs, Status.VALID)


def cost(system, jobs):
    return cost_terms(system, Placement.of(expand(system, system.modes[0]), jobs, system.units))


def test_the_example_costs_nothing_and_has_the_loads_and_latencies_it_states():
    system, jobs = split_example()
    found = report(system, jobs)
    assert (found.cost.overlap, found.cost.access, found.cost.precedence, found.cost.unit) == (0, 0, 0, 0)
    assert found.cost.total <= 0
    busy = {load.unit: load.busy for load in found.unit_loads}
    assert busy == {"core1": ms("27.7ms"), "core2": ms(17), "gpu": ms(28)}  # 4 * 2.5 + 4.5 + 6.1 + 7.1; 12 + 5; 20 + 8
    assert found.resource_loads[0].mean == Fraction(15 + 20, 400)  # slow from 22.6 to 24.1, logger 2 ms
    assert [(c.reaction, c.age) for c in found.chains] == [(ms("91.5ms"), ms("51.5ms"))]


@pytest.mark.parametrize(
    ("task", "part", "changes", "broken"),
    [
        ("slow", 0, {"end": "6.9ms"}, 1),  # reserved one tick too few
        ("slow", 1, {"end": "18.7ms"}, 1),
        ("detect", 0, {"executed_to": "9.9ms"}, 1 + 1 + 1),  # no point, another length, and what follows begins later
        ("detect", 1, {"executed_to": "20.1ms"}, 1 + 1),  # beyond C, and another length
        ("detect", 1, {"start": "39.6ms", "end": "49.6ms"}, 1 + 40),  # no gap is left; and the camera is not nested
        ("logger", 1, {"executed_from": "7.1ms"}, 1 + 1),  # something is never executed; another length
    ],
)
def test_broken_parts_cost_their_distance(task, part, changes, broken):
    system, jobs = split_example()
    found = cost(system, with_part(jobs, task, part, **changes))
    assert found.precedence == broken
    assert found.total > 0


def test_too_many_gaps_and_too_short_parts_cost():
    system, jobs = split_example()
    logger = system.task("logger")

    def limited(**limits):
        split = replace(logger.versions[0].split, **limits)
        changed = replace(logger, versions=(replace(logger.versions[0], split=split),))
        return replace(system, tasks=tuple(changed if t is logger else t for t in system.tasks))

    assert cost(limited(max_gaps=1), jobs).precedence == 0
    assert cost(limited(max_gaps=0), jobs).precedence > 0
    assert cost(limited(min_part=ms(5)), jobs).precedence == 0
    assert cost(limited(min_part=ms("5.1ms")), jobs).precedence == 1


def test_an_access_phase_must_not_have_a_gap_inside():
    system, jobs = split_example()
    over_knock = 10  # the second part, longer than in the example, has the third job of knock inside it

    def found(bound, end_of_first, end_of_second):
        first = with_part(jobs, "logger", 0, executed_to=bound, end=end_of_first)
        return cost(system, with_part(first, "logger", 1, executed_from=bound, end=end_of_second)).precedence

    assert found(2, 3, 19) == over_knock
    assert found("1.5ms", "2.5ms", "19.5ms") == over_knock + 5  # the phase lasts to 2 ms


def split_job(system, name, start, second):
    chosen = system.task(name).versions[0]
    spans = [(ms(start), ms(0), ms(5)), (ms(second), ms(5), ms(10))]
    return job_of(name, 0, chosen, ("u1",), spans, ())


def test_spans_that_cross_cost_the_way_to_the_nearest_gap():
    tasks = [task(name, 40, replace(version("v", 10), split=Split(points=(ms(5),)))) for name in "ab"]
    system = model(*tasks)
    inside = [split_job(system, "a", 0, 30), split_job(system, "b", 5, 25)]
    assert cost(system, inside).total <= 0
    crossed = [split_job(system, "a", 0, 12), split_job(system, "b", 5, 17)]  # to 17: the gap of a ends at 12
    found = cost(system, crossed)
    assert found.overlap == 0
    assert found.precedence == 10  # ms: b is over at 22


def test_jobs_nest_round_the_end_of_the_hyperperiod():
    tasks = [
        task("a", 40, replace(version("v", 10), split=Split(points=(ms(5),)))),
        task("b", 40, version("v", 10)),
    ]
    system = model(*tasks)
    wrapped = split_job(system, "a", 30, 52)
    assert cost(system, [wrapped, job(system, "b", 0, 2, "u1")]).total <= 0
    assert cost(system, [wrapped, job(system, "b", 0, 3, "u1")]).overlap > 0


def test_jobs_of_one_task_do_not_interrupt_each_other():
    split = replace(version("v", 4, "u1 u2"), split=Split(points=(ms(2),)))
    system = model(task("a", 20, split, slack=1, deadline=40), task("b", 40, version("v", 2)), units="u1 u2")
    chosen = system.tasks[0].versions[0]

    def jobs(second, unit):
        spans = [(ms(0), ms(0), ms(2)), (ms(second), ms(2), ms(4))]
        return [job_of("a", 0, chosen, ("u1",), spans, ()), job(system, "a", 1, 20, unit)]

    assert cost(system, jobs(18, "u1")).precedence == 0
    assert cost(system, jobs(24, "u1")).precedence == 2  # of 2 ms: all of the job in the gap
    assert cost(system, jobs(24, "u2")).precedence == 0


def test_a_span_longer_than_the_hyperperiod_meets_its_own_copy():
    system = model(task("a", 20, replace(version("v", 4), split=Split(points=(ms(2),))), slack=1, deadline=40))
    spans = [(ms(0), ms(0), ms(2)), (ms(22), ms(2), ms(4))]
    found = cost(system, [job_of("a", 0, system.tasks[0].versions[0], ("u1",), spans, ())])
    assert found.precedence == 2


@pytest.mark.parametrize("binding", list(Binding))
def test_bound_tasks_cost_a_mean_wcet_for_each_job_elsewhere(binding):
    bound = replace(task("a", 10, version("v", 3, "u1 u2")), binding=binding)
    system = model(bound, task("b", 30, version("v", 3, "u2")), units="u1 u2")
    jobs = [job(system, "a", n, 10 * n, unit) for n, unit in enumerate(("u1", "u2", "u1"))]
    found = cost(system, [*jobs, job(system, "b", 0, 3, "u2")])
    assert found.precedence == (0 if binding is Binding.JOB else 3)


def test_arrivals_wait_from_the_start_before_to_start_and_end():
    polled = replace(task("a", 10, version("v", 2), slack=1), distance=ms(12))
    system = model(polled, task("b", 20, version("v", 1, "u2")), units="u1 u2")

    def found(second, deadline=None):
        limited = replace(polled, deadline=ms(deadline))
        changed = replace(system, tasks=(limited, system.tasks[1]))
        other = job(changed, "b", 0, 0, "u2")
        return cost(changed, [job(changed, "a", 0, 0, "u1"), job(changed, "a", 1, second, "u1"), other]).precedence

    assert found(10) == 0
    assert found(11) == 1  # 11 to start, but 13 until it ends
    assert found(13) == 1 + 3
    assert found(10, deadline=11) == 1 + 1


def test_a_deadline_limits_the_whole_span():
    def found(deadline):
        split = replace(version("v", 4), split=Split(points=(ms(2),)))
        system = model(task("a", 20, split, deadline=deadline), task("b", 20, version("v", 1)))
        spans = [(ms(0), ms(0), ms(2)), (ms(7), ms(2), ms(4))]
        jobs = [job_of("a", 0, system.tasks[0].versions[0], ("u1",), spans, ()), job(system, "b", 0, 3, "u1")]
        return cost(system, jobs).precedence

    assert found(9) == 0
    assert found(8) == 1


def test_interrupts_lengthen_jobs_in_one_piece():
    system = model(task("a", 20, version("v", 8)), task("b", 20, version("v", 2)))
    unit = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(2)),))
    interrupted = replace(system, units=(unit,))
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "b", 0, 10, "u1")]
    assert cost(interrupted, jobs).overlap == 0
    assert report(interrupted, jobs).unit_loads[0].busy == ms(10 + 4)
    earlier = [jobs[0], job(system, "b", 0, 9, "u1")]
    assert cost(system, earlier).overlap == 0
    assert cost(interrupted, earlier).overlap == 1


def test_interrupts_that_fill_a_unit_make_it_useless():
    system = model(task("a", 20, version("v", 8)))
    unit = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(10)),))
    assert cost(replace(system, units=(unit,)), [job(system, "a", 0, 0, "u1")]).unit == 1


def test_moving_a_part_onto_another_job_overlaps():
    system, jobs = split_example()
    moved = with_part(jobs, "slow", 1, start="12.4ms", end="18.5ms")
    assert cost(system, moved).overlap == 1
    late = with_job(jobs, "detect", start=ms("29.5ms"))
    assert cost(system, late).precedence > 0


@pytest.mark.parametrize(
    ("how", "bound", "distance"),
    [
        (points(2, 5), 2, 0),
        (points(2, 5), 1, 1),
        (points(2, 5), 4, 1),
        (points(2, 5), 9, 4),
        (Split(), 3, 10),
        (Split(anywhere=True), 1, 1),  # the phases last from 0 to 3, and from 6 to 8, where another one begins
        (Split(anywhere=True), 2, 1),
        (Split(anywhere=True), 3, 0),
        (Split(anywhere=True), 5, 0),
        (Split(anywhere=True), 7, 1),
        (Split(anywhere=True), 8, 0),
        (Split(anywhere=True), 9, 1),
    ],
)
def test_a_preemption_costs_its_distance_from_the_nearest_point_allowed(how, bound, distance):
    phases = [access("r", 2, 3, "1/2"), access("r", 0, 3, "1/2"), access("r", 6, 8), access("r", 8, 10)]
    system = model(task("a", 40, split(version("v", 10, "u1", *phases), how)), resources="r")
    chosen = system.tasks[0].versions[0]
    spans = [(ms(0), ms(0), ms(bound)), (ms(20), ms(bound), ms(10))]
    found = Placement.of(expand(system, system.modes[0]), [job_of("a", 0, chosen, ("u1",), spans, ())], system.units)
    assert parts_cost(found, found.jobs[0]) == distance


@pytest.mark.parametrize(("kind", "distance"), [(ResourceKind.MEMORY, 2), (ResourceKind.LOCK, 0)])
def test_a_preemption_inside_a_lock_costs_nothing(kind, distance):
    system = model(task("a", 40, split(version("v", 10, "u1", access("r", 2, 7)), Split(anywhere=True))), resources="r")
    system = replace(system, resources=(replace(system.resources[0], kind=kind),))
    spans = [(ms(0), ms(0), ms(4)), (ms(20), ms(4), ms(10))]
    parts = job_of("a", 0, system.tasks[0].versions[0], ("u1",), spans, ())
    found = Placement.of(expand(system, system.modes[0]), [parts], system.units)
    assert parts_cost(found, found.jobs[0]) == distance


@pytest.mark.parametrize(("gaps", "costs"), [(3, 0), (2, 0), (1, 8), (0, 16)])
def test_each_preemption_too_many_costs_a_mean_wcet(gaps, costs):
    system = model(task("a", 40, split(version("v", 8), points(2, 4, max_gaps=gaps))))
    spans = [(ms(0), ms(0), ms(2)), (ms(9), ms(2), ms(4)), (ms(20), ms(4), ms(8))]
    found = cost(system, [job_of("a", 0, system.tasks[0].versions[0], ("u1",), spans, ())])
    assert found.precedence == costs


@pytest.mark.parametrize("seed", range(20))
def test_all_spans_that_meet_one_are_found_round_the_circle(seed):
    rng, circle = Random(seed), 20
    system = model(task("a", 20, version()))
    first = Placement.of(expand(system, system.modes[0]), [job(system, "a", 0, 0, "u1")]).jobs[0]
    spans = [replace(first, index=n, start=rng.randrange(20), length=rng.randint(1, 45)) for n in range(5)]
    for one in spans:
        found = {(other.index, shift) for other, shift in _Spans(list(spans)).meeting(one, circle)}
        assert found == {
            (other.index, shift)
            for other in spans
            for shift in range(-200, 201, circle)
            if other.start + shift < one.end and one.start < other.end + shift and (other is not one or shift)
        }


def test_one_job_in_parts_makes_the_deadlines_of_all_jobs_of_its_task_count():
    """The job in one piece starts 8 ms after the release of the other one, which ends in time."""
    cut = split(version("v", 4), points(2))
    system = model(task("a", 20, cut, deadline=10, slack=1), task("b", 40, version("v", 1)))
    spans = [(ms(0), ms(0), ms(2)), (ms(5), ms(2), ms(4))]
    parts = job_of("a", 0, system.tasks[0].versions[0], ("u1",), spans, ())
    assert cost(system, [parts, job(system, "a", 1, 28, "u1"), job(system, "b", 0, 3, "u1")]).precedence == 2
    assert cost(system, [parts, job(system, "a", 1, 26, "u1"), job(system, "b", 0, 3, "u1")]).precedence == 0


def test_a_preemption_outside_the_execution_costs_its_distance_from_the_inside():
    boundaries = _Boundaries.of(split(version("v", 10), Split(anywhere=True)), ms(1))
    assert [boundaries.distance(bound) for bound in (-3, 0, 1, 9, 10, 12)] == [4, 1, 0, 0, 1, 3]


@pytest.mark.parametrize("bound", range(-2, 16))
def test_a_boundary_is_as_far_off_as_the_nearest_one_that_is_allowed(bound):
    """Anywhere outside the phases from 2 to 7 and from 9 to 11 of 13 ticks, or at one of three points."""
    phases = (access("r", 2, 5), access("r", 4, 7), access("r", 9, 11))
    free = _Boundaries.of(split(version("v", 13, "u1", *phases), Split(anywhere=True)), ms(1))
    allowed = [n for n in range(1, 13) if not (2 < n < 7 or 9 < n < 11)]
    assert free.distance(bound) == min(abs(bound - n) for n in allowed)
    cut = _Boundaries.of(split(version("v", 13), points(3, 8, 12)), ms(1))
    assert cut.distance(bound) == min(abs(bound - n) for n in (3, 8, 12))
