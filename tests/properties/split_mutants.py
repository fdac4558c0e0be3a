"""Operators that put faults of split jobs into a system or its schedule; whether it is still valid, the oracle says."""

from __future__ import annotations

from dataclasses import replace

from verify_mutants import change_jobs, change_switch, change_task, change_versions
from verify_systems import TICK, UNITS, at

from halpipe.core.durations import ZERO
from halpipe.models import Binding, Interrupt, Part, Split

OPERATORS = {}


def operator(function):
    """Register an operator: (rng, model, schedule) -> (model, schedule), or None where it does not apply."""
    OPERATORS[function.__name__] = function
    return function


def change_parts(rng, plan, change, least=2):
    """Rewrite the parts of one job that has at least so many; its start and end follow."""
    which = rng.randrange(len(plan.modes))
    jobs = plan.modes[which].jobs
    found = [k for k, j in enumerate(jobs) if len(j.parts) >= least]
    if not found:
        return None
    place = rng.choice(found)
    parts = change(list(jobs[place].parts))
    if parts is None:
        return None

    def rewrite(all_jobs):
        all_jobs[place] = replace(all_jobs[place], parts=tuple(parts), start=parts[0].start, end=parts[-1].end)
        return all_jobs

    return change_jobs(plan, rewrite, which)


def change_part(rng, plan, change):
    def pick(parts):
        place = rng.randrange(len(parts))
        parts[place] = change(parts[place])
        return parts

    return change_parts(rng, plan, pick)


def result(system, plan):
    return None if plan is None else (system, plan)


@operator
def boundary_moved_in_execution(rng, system, plan):
    by = rng.choice((TICK, -TICK))

    def change(parts):
        place = rng.randrange(len(parts) - 1)
        parts[place] = replace(parts[place], executed_to=parts[place].executed_to + by)
        parts[place + 1] = replace(parts[place + 1], executed_from=parts[place + 1].executed_from + by)
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def boundary_moved_with_its_lengths(rng, system, plan):
    """A tick of execution goes from one part to the next, in the clock as well."""
    by = rng.choice((TICK, -TICK))

    def change(parts):
        place = rng.randrange(len(parts) - 1)
        one, two = parts[place], parts[place + 1]
        parts[place] = replace(one, executed_to=one.executed_to + by, end=one.end + by)
        parts[place + 1] = replace(two, executed_from=two.executed_from + by, start=two.start + by)
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def part_moved(rng, system, plan):
    by = rng.choice((TICK, -TICK))
    return result(system, change_part(rng, plan, lambda p: replace(p, start=p.start + by, end=p.end + by)))


@operator
def part_longer(rng, system, plan):
    return result(system, change_part(rng, plan, lambda p: replace(p, end=p.end + TICK)))


@operator
def part_shorter(rng, system, plan):
    """Also: its reserved length one interrupt too short."""
    return result(system, change_part(rng, plan, lambda p: replace(p, end=p.end - TICK)))


@operator
def parts_swapped(rng, system, plan):
    def change(parts):
        place = rng.randrange(len(parts) - 1)
        one, two = parts[place], parts[place + 1]
        parts[place] = replace(one, executed_from=two.executed_from, executed_to=two.executed_to)
        parts[place + 1] = replace(two, executed_from=one.executed_from, executed_to=one.executed_to)
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def part_left_out(rng, system, plan):
    def change(parts):
        parts.pop(rng.randrange(len(parts)))
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def parts_joined(rng, system, plan):
    """The gap between two parts is gone, and the rest moves up; what it interrupts may be in the way."""

    def change(parts):
        place = rng.randrange(len(parts) - 1)
        one, two = parts[place], parts[place + 1]
        joined = replace(one, executed_to=two.executed_to, end=one.end + (two.end - two.start))
        return [*parts[:place], joined, *parts[place + 2 :]]

    return result(system, change_parts(rng, plan, change))


@operator
def gap_closed(rng, system, plan):
    def change(parts):
        place = rng.randrange(len(parts) - 1)
        one, two = parts[place], parts[place + 1]
        parts[place + 1] = replace(two, start=one.end, end=one.end + (two.end - two.start))
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def one_gap_more(rng, system, plan):
    """Cut a job once more, somewhere: what comes later moves by a tick or two."""
    which = rng.randrange(len(plan.modes))
    jobs = plan.modes[which].jobs
    found = [k for k, j in enumerate(jobs) if j.end - j.start > TICK]
    if not found:
        return None
    place, by = rng.choice(found), rng.choice((1, 2)) * TICK
    owner = jobs[place]
    wcet = next((v.wcet for v in system.task(owner.task).versions if v.name == owner.version), owner.end - owner.start)
    whole = Part(start=owner.start, end=owner.end, executed_from=ZERO, executed_to=wcet)
    parts = list(owner.parts or (whole,))
    cut = rng.randrange(len(parts))
    part = parts[cut]
    at_work = rng.randrange(1, max(2, int((part.executed_to - part.executed_from) / TICK))) * TICK
    first = replace(part, end=part.start + at_work, executed_to=part.executed_from + at_work)
    second = replace(part, start=first.end + by, end=part.end + by, executed_from=first.executed_to)
    later = [replace(p, start=p.start + by, end=p.end + by) for p in parts[cut + 1 :]]
    made = (*parts[:cut], first, second, *later)

    def rewrite(all_jobs):
        all_jobs[place] = replace(owner, parts=made, end=made[-1].end)
        return all_jobs

    return system, change_jobs(plan, rewrite, which)


@operator
def last_part_far_away(rng, system, plan):
    """The last part moves on by some ticks, perhaps across the next job: nesting breaks where nothing overlaps."""
    by = rng.randint(1, 12) * TICK

    def change(parts):
        parts[-1] = replace(parts[-1], start=parts[-1].start + by, end=parts[-1].end + by)
        return parts

    return result(system, change_parts(rng, plan, change))


@operator
def job_put_into_a_gap_or_across(rng, system, plan):
    """A job moves to where another one has a gap, on its units."""
    jobs = plan.modes[0].jobs
    outer = [j for j in jobs if len(j.parts) > 1]
    if not outer or len(jobs) < 2:
        return None
    around = rng.choice(outer)
    place = rng.choice([k for k, j in enumerate(jobs) if j is not around])
    gap = rng.choice(around.parts[:-1]).end + rng.choice((0, 0, 1)) * TICK
    total = plan.modes[0].hyperperiod
    start = gap - total * (gap // total)

    def rewrite(found):
        found[place] = replace(at(found[place], start), units=around.units[: len(found[place].units)])
        return found

    return system, change_jobs(plan, rewrite)


@operator
def job_onto_the_one_before(rng, system, plan):
    """A job of a task with several begins while the one before it is under way, or just when it ends."""
    jobs = plan.modes[0].jobs
    pairs = [(k, j) for k, own in enumerate(jobs) for j in jobs if j.task == own.task and j is not own]
    if not pairs:
        return None
    place, before = rng.choice(pairs)
    total, end = plan.modes[0].hyperperiod, max(before.end, before.start + TICK)
    begin = before.start + rng.randrange(int((end - before.start) / TICK) + 1) * TICK
    start = begin - total * (begin // total)

    def rewrite(found):
        found[place] = replace(at(found[place], start), units=before.units)
        return found

    return system, change_jobs(plan, rewrite)


@operator
def units_of_one_job_changed(rng, system, plan):
    """A task on two units: allowed unless it is bound."""
    which = rng.randrange(len(plan.modes))
    place = rng.randrange(len(plan.modes[which].jobs))

    def rewrite(found):
        found[place] = replace(found[place], units=tuple(rng.sample(UNITS, len(found[place].units))))
        return found

    return system, change_jobs(plan, rewrite, which)


@operator
def bound_more_firmly(rng, system, plan):
    return change_task(system, rng.choice(system.tasks), binding=rng.choice((Binding.MODE, Binding.SYSTEM))), plan


@operator
def switch_table_on_other_units(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].jobs:
        return None
    names = list(UNITS)
    rng.shuffle(names)
    other = dict(zip(UNITS, names, strict=True))
    jobs = [replace(j, units=tuple(other[u] for u in j.units)) for j in plan.transitions[0].jobs]
    return system, change_switch(plan, jobs=tuple(jobs))


@operator
def switch_table_part_moved(rng, system, plan):
    if not plan.transitions:
        return None
    jobs = list(plan.transitions[0].jobs)
    found = [k for k, j in enumerate(jobs) if len(j.parts) > 1]
    if not found:
        return None
    place, by = rng.choice(found), rng.randint(1, 8) * TICK
    last = jobs[place].parts[-1]
    parts = (*jobs[place].parts[:-1], replace(last, start=last.start + by, end=last.end + by))
    jobs[place] = replace(jobs[place], parts=parts, end=parts[-1].end)
    return system, change_switch(plan, jobs=tuple(jobs))


def change_split(rng, system, change):
    found = [v for t in system.tasks for v in t.versions if v.split.is_allowed]
    if not found:
        return None
    chosen = rng.choice(found)
    return change_versions(system, lambda v: replace(v, split=change(v.split)) if v is chosen else v)


def with_model(system, plan):
    return None if system is None else (system, plan)


@operator
def not_split_any_more(rng, system, plan):
    return with_model(change_split(rng, system, lambda s: Split()), plan)


@operator
def one_gap_less_allowed(rng, system, plan):
    return with_model(change_split(rng, system, lambda s: replace(s, max_gaps=max(0, (s.max_gaps or 1) - 1))), plan)


@operator
def a_split_point_less(rng, system, plan):
    def change(split):
        if len(split.points) < 2:
            return split
        gone = rng.choice(split.points)
        return replace(split, points=tuple(p for p in split.points if p != gone))

    return with_model(change_split(rng, system, change), plan)


@operator
def resuming_takes_longer(rng, system, plan):
    return with_model(change_split(rng, system, lambda s: replace(s, resume=s.resume + TICK)), plan)


@operator
def longer_parts_demanded(rng, system, plan):
    def change(split):
        return replace(split, min_part=(split.min_part or ZERO) + TICK) if split.anywhere else split

    return with_model(change_split(rng, system, change), plan)


@operator
def one_interrupt_more(rng, system, plan):
    chosen = rng.choice(system.units)
    more = (*chosen.interrupts, Interrupt(name="more", distance=rng.randint(3, 30) * TICK, wcet=TICK))
    units = tuple(replace(u, interrupts=more) if u is chosen else u for u in system.units)
    return replace(system, units=units), plan


@operator
def interrupts_come_closer(rng, system, plan):
    served = [u for u in system.units if u.interrupts]
    if not served:
        return None
    chosen = rng.choice(served)
    first, *others = chosen.interrupts
    closer = (replace(first, distance=max(TICK, first.distance - rng.randint(1, 8) * TICK)), *others)
    units = tuple(replace(u, interrupts=closer) if u is chosen else u for u in system.units)
    return replace(system, units=units), plan


@operator
def arrivals_come_closer(rng, system, plan):
    polled = [t for t in system.tasks if t.distance is not None and t.distance > t.period]
    if not polled:
        return None
    chosen = rng.choice(polled)
    return change_task(system, chosen, distance=chosen.distance - TICK), plan


@operator
def arrivals_are_due_earlier(rng, system, plan):
    polled = [t for t in system.tasks if t.distance is not None]
    if not polled:
        return None
    chosen = rng.choice(polled)
    due = chosen.distance if chosen.deadline is None else chosen.deadline
    return change_task(system, chosen, deadline=due - TICK), plan
