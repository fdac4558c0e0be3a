"""Inflated execution times, instants of access phases, and phases of tasks by hand (MODEL 8.2 and 10.5)."""

from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, parted, points, split

from halpipe.core.durations import ZERO
from halpipe.models import Binding, Resource, ResourceKind, Split
from halpipe.pipeline.parts import (
    has_whole_jobs,
    interrupt_load,
    is_exact_model,
    job_of,
    latest_phase,
    parts_of,
    phase_instants,
    reserved_length,
    service_of,
)
from support import access, model, ms, task, version


@pytest.mark.parametrize(
    ("work", "length"),
    [(0, 0), (1, 3), (8, 10), (9, 13), (10, 14)],  # 2 ms in each 10 ms that begin
)
def test_a_length_covers_the_interrupts_that_begin_in_it(work, length):
    assert reserved_length(work, ((10, 2),)) == length
    assert reserved_length(ms(work), ((ms(10), ms(2)),)) == ms(length)


@pytest.mark.parametrize("work", [1, 3, 4, 7, 20])
def test_a_length_is_the_least_that_work_and_interrupts_fill(work):
    service = ((10, 4), (15, 6))  # four fifths of the time
    fits = [length for length in range(1, 400) if length == work + sum(c * -(-length // t) for t, c in service)]
    assert reserved_length(work, service) == min(fits)
    assert interrupt_load(service) == Fraction(4, 5)


@pytest.mark.parametrize("service", [((10, 10),), ((10, 5), (20, 10)), ((10, 11),)])
def test_interrupts_that_take_all_the_time_leave_no_length(service):
    with pytest.raises(ValueError, match="fill the unit"):
        reserved_length(1, service)


def test_the_members_of_a_gang_suffer_the_interrupts_of_all_their_units_once():
    system = interrupts(
        interrupts(model(task("a", 10, version()), units="u1 u2 u3"), "u1", (9, 1)), "u3", (5, 1), (7, 2)
    )
    units = {unit.name: unit for unit in system.units}
    assert service_of(units, ["u1", "u2", "u1"]) == ((ms(9), ms(1)),)
    assert service_of(units, ["u3", "u1"]) == ((ms(5), ms(1)), (ms(7), ms(2)), (ms(9), ms(1)))


CUT = split(version("v", 10, "u1", access("r", 1, 3), access("r", 4, 6)), points(4, 6, resume=ms(1)))
JOB = parted("a", 0, "u1", (0, 4, 0, 4), (10, 13, 4, 6), (20, 25, 6, 10))


def phase(number, job=JOB, service=(), **more):
    begin, end = phase_instants(CUT.accesses[number], parts_of(job, CUT), CUT.split.resume, service, **more)
    return begin, end


def test_a_phase_lies_in_one_part_after_the_preemption_overhead():
    assert phase(0) == (ms(1), ms(3))
    assert phase(1) == (ms(11), ms(13))
    assert phase(1, service=((ms(2), ms("0.5ms")),)) == (ms(11), ms(14))


def test_a_phase_of_a_job_in_one_piece_counts_from_its_start():
    whole = replace(JOB, parts=(), start=ms(5), end=ms(15))
    assert parts_of(whole, CUT)[0].executed_to == ms(10)
    assert [phase(0, whole), phase(1, whole)] == [(ms(6), ms(8)), (ms(9), ms(11))]
    assert [phase(0, whole, is_lock=True), phase(1, whole, is_lock=True)] == [(ms(6), ms(8)), (ms(9), ms(11))]


def test_a_gap_inside_a_phase_is_refused_but_for_a_lock_which_is_held_through_it():
    job = parted("a", 0, "u1", (0, 2, 0, 2), (10, 14, 2, 5), (20, 26, 5, 10))
    for number in (0, 1):
        with pytest.raises(ValueError, match="a gap of the job"):
            phase(number, job)
    assert phase(0, job, is_lock=True) == (ms(1), ms(12))
    assert phase(1, job, is_lock=True) == (ms(13), ms(22))
    twice = parted("a", 0, "u1", (0, 2, 0, 2), (10, 19, 2, 10))
    assert phase(0, twice, is_lock=True) == (ms(1), ms(12))


def test_a_lock_is_taken_in_the_part_that_begins_with_it_and_left_in_the_one_that_ends_with_it():
    """At a gap that lies at its first or last instant it is not held."""
    assert phase(0, is_lock=True) == (ms(1), ms(3))
    assert phase(1, is_lock=True) == (ms(11), ms(13))
    assert phase(1, service=((ms(2), ms("0.5ms")),), is_lock=True) == (ms(11), ms(14))


@pytest.mark.parametrize(
    ("offsets", "phase"),
    [
        ([3], 3),
        ([3, 8], 3),  # half of the circle of 10: the first
        ([0, 5], 0),
        ([3, 7], 3),
        ([3, 9], 9),
        ([1, 2, 9], 9),
        ([1, 3, 5], 1),
        ([2, 6, 9], 6),
    ],
)
def test_the_phase_of_a_task_is_where_the_widest_gap_of_its_offsets_ends(offsets, phase):
    assert latest_phase(offsets, 10) == phase
    assert latest_phase([ms(offset) for offset in offsets], ms(10)) == ms(phase)


PLAIN = model(task("a", 10, version("v", 2, "u1", access("r", 0, 1))), task("b", 10, version()), resources="r")


def with_task(**changes):
    return replace(PLAIN, tasks=(replace(PLAIN.tasks[0], **changes), PLAIN.tasks[1]))


@pytest.mark.parametrize(
    ("system", "is_whole", "is_exact"),
    [
        (PLAIN, True, True),
        (replace(PLAIN, resources=(Resource(name="r", kind=ResourceKind.LOCK),)), True, True),
        (interrupts(PLAIN, "u1", (5, 1)), False, False),
        (with_task(distance=ms(20)), False, False),
        (with_task(binding=Binding.MODE), False, False),
        (with_task(versions=(split(PLAIN.tasks[0].versions[0], Split(anywhere=True)),)), False, False),
        (with_task(let=ms(10)), True, False),
    ],
)
def test_models_of_whole_jobs_are_told_from_those_with_parts_and_with_refined_requirements(system, is_whole, is_exact):
    assert (has_whole_jobs(system), is_exact_model(system)) == (is_whole, is_exact)
    assert reserved_length(ZERO, ((ms(5), ms(1)),)) == ZERO


def test_parts_after_the_first_pay_for_the_preemption_and_all_for_interrupts():
    """In each 5 ms that begin, a millisecond of interrupts; and one for each time that the job goes on."""
    spans = [(ms(0), ms(0), ms(4)), (ms(10), ms(4), ms(6)), (ms(20), ms(6), ms(10))]
    plain, served = (job_of("a", 3, CUT, ("u1",), spans, service) for service in ((), ((ms(5), ms(1)),)))
    assert [(part.start, part.end) for part in plain.parts] == [(ms(0), ms(4)), (ms(10), ms(13)), (ms(20), ms(25))]
    assert [part.end for part in served.parts] == [ms(5), ms(14), ms(27)]
    assert (served.index, served.start, served.end) == (3, ms(0), ms(27))
    assert job_of("a", 0, CUT, ("u1",), [(ms(3), ms(0), ms(10))], ()).parts == ()
