"""Operators that put a fault into a system or its schedule; whether the result is still valid, the oracle says."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import verify_oracle as oracle
from verify_systems import TICK, UNITS, at, make_job

from halpipe.core.durations import milliseconds
from halpipe.models import (
    Anchor,
    Status,
    Transition,
)
from support import ms

OPERATORS = {}


def operator(function):
    """Register an operator: (rng, model, schedule) -> (model, schedule), or None where it does not apply."""
    OPERATORS[function.__name__] = function
    return function


def change_jobs(plan, change, which=0):
    """Rewrite the jobs of one mode."""
    modes = list(plan.modes)
    modes[which] = replace(modes[which], jobs=tuple(change(list(modes[which].jobs))))
    return replace(plan, modes=tuple(modes))


def change_one(rng, plan, change):
    """Rewrite one job of some mode."""

    def pick(jobs):
        place = rng.randrange(len(jobs))
        return [change(j) if k == place else j for k, j in enumerate(jobs)]

    return change_jobs(plan, pick, rng.randrange(len(plan.modes)))


def change_versions(system, change):
    """Rewrite every version of the model."""
    tasks = tuple(replace(t, versions=tuple(change(v) for v in t.versions)) for t in system.tasks)
    return replace(system, tasks=tasks)


def change_windows(rng, system, change):
    """Rewrite one precedence constraint."""
    windows = [(v, k) for t in system.tasks for v in t.versions for k in range(len(v.precedences))]
    if not windows:
        return None
    chosen, place = rng.choice(windows)
    changed = change(chosen.precedences[place])
    if changed is None:
        return None
    kept = [changed if k == place else p for k, p in enumerate(chosen.precedences)]
    return change_versions(system, lambda v: replace(v, precedences=tuple(kept)) if v is chosen else v)


def moved(plan, job, by):
    total = plan.modes[0].hyperperiod
    return at(job, (job.start + by) % total)


@operator
def start_one_tick_later(rng, system, plan):
    return system, change_one(rng, plan, lambda j: moved(plan, j, TICK))


@operator
def start_one_tick_earlier(rng, system, plan):
    return system, change_one(rng, plan, lambda j: moved(plan, j, -TICK))


@operator
def start_anywhere(rng, system, plan):
    total = oracle.ticks(plan.modes[0].hyperperiod)
    return system, change_one(rng, plan, lambda j: at(j, milliseconds(rng.randrange(total))))


@operator
def start_out_of_range(rng, system, plan):
    return system, change_one(rng, plan, lambda j: at(j, j.start + plan.modes[0].hyperperiod))


@operator
def start_negative(rng, system, plan):
    return system, change_one(rng, plan, lambda j: at(j, j.start - plan.modes[0].hyperperiod))


@operator
def wrong_end(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, end=j.end + TICK))


@operator
def one_tick_of_overlap(rng, system, plan):
    """Put a job on the unit of another one and let it begin in that one's last tick."""
    jobs = plan.modes[0].jobs
    if len(jobs) < 2:
        return None
    victim, other = rng.sample(range(len(jobs)), 2)
    total = plan.modes[0].hyperperiod
    start = (jobs[other].end - TICK) % total
    units = jobs[other].units[: len(jobs[victim].units)]

    def change(found):
        found[victim] = replace(at(found[victim], start), units=units)
        return found

    return system, change_jobs(plan, change)


@operator
def swap_units(rng, system, plan):
    jobs = plan.modes[0].jobs
    if len(jobs) < 2:
        return None
    one, two = rng.sample(range(len(jobs)), 2)

    def change(found):
        found[one], found[two] = (
            replace(found[one], units=found[two].units),
            replace(found[two], units=found[one].units),
        )
        return found

    return system, change_jobs(plan, change)


@operator
def wrong_unit(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, units=(rng.choice(UNITS), *j.units[1:])))


@operator
def unknown_unit(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, units=("nowhere", *j.units[1:])))


@operator
def drop_gang_member(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, units=j.units[1:]))


@operator
def add_gang_member(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, units=(*j.units, rng.choice(UNITS))))


@operator
def duplicate_job(rng, system, plan):
    return system, change_jobs(plan, lambda jobs: [*jobs, rng.choice(jobs)])


@operator
def remove_job(rng, system, plan):
    def change(jobs):
        jobs.pop(rng.randrange(len(jobs)))
        return jobs

    return system, change_jobs(plan, change, rng.randrange(len(plan.modes)))


@operator
def wrong_index(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, index=j.index + rng.choice((-1, 1))))


@operator
def swap_indices(rng, system, plan):
    """Swapping the indices of two jobs of one task moves each by a period."""
    jobs = plan.modes[0].jobs
    pairs = [(a, b) for a in range(len(jobs)) for b in range(a) if jobs[a].task == jobs[b].task]
    if not pairs:
        return None
    a, b = rng.choice(pairs)

    def change(found):
        found[a], found[b] = replace(found[a], index=found[b].index), replace(found[b], index=found[a].index)
        return found

    return system, change_jobs(plan, change)


@operator
def other_version(rng, system, plan):
    """Take another version with its own WCET; demands and windows may change."""

    def change(job):
        chosen = rng.choice(system.task(job.task).versions)
        return replace(job, version=chosen.name, end=job.start + chosen.wcet)

    return system, change_one(rng, plan, change)


@operator
def unknown_version(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, version="none"))


@operator
def version_not_available(rng, system, plan):
    """Take a version that is in use away from the mode."""
    used = rng.choice(plan.modes[0].jobs)
    first, *others = system.modes
    runs = []
    for run in first.runs:
        kept = tuple(v for v in run.versions if (run.task, v) != (used.task, used.version))
        if not kept:
            return None
        runs.append(replace(run, versions=kept))
    return replace(system, modes=(replace(first, runs=tuple(runs)), *others)), plan


@operator
def job_of_a_task_not_in_the_mode(rng, system, plan):
    """Take the task away from the mode, so that its jobs do not belong to it."""
    first, *others = system.modes
    kept = tuple(run for run in first.runs if run.task != rng.choice(first.runs).task)
    periodic = {t.name for t in system.tasks if t.period is not None}
    if not periodic.intersection(run.task for run in kept):
        return None
    return replace(system, modes=(replace(first, runs=kept), *others)), plan


@operator
def unknown_task(rng, system, plan):
    return system, change_one(rng, plan, lambda j: replace(j, task="nobody"))


@operator
def bound_too_large_by_a_thousandth(rng, system, plan):
    phases = [(v, k) for t in system.tasks for v in t.versions for k, a in enumerate(v.accesses) if a.bound < 1]
    if not phases:
        return None
    chosen, place = rng.choice(phases)
    changed = [
        replace(a, bound=a.bound + Fraction(1, 1000)) if k == place else a for k, a in enumerate(chosen.accesses)
    ]
    return change_versions(system, lambda v: replace(v, accesses=tuple(changed)) if v is chosen else v), plan


@operator
def phase_one_tick_longer(rng, system, plan):
    phases = [(v, k) for t in system.tasks for v in t.versions for k in range(len(v.accesses))]
    if not phases:
        return None
    chosen, place = rng.choice(phases)
    changed = [
        replace(a, start=max(a.start - TICK, ms("0ms")), end=min(a.end + TICK, chosen.wcet)) if k == place else a
        for k, a in enumerate(chosen.accesses)
    ]
    return change_versions(system, lambda v: replace(v, accesses=tuple(changed)) if v is chosen else v), plan


@operator
def window_closes_one_tick_earlier(rng, system, plan):
    found = change_windows(rng, system, lambda p: replace(p, max=p.max - TICK) if p.max > p.min else None)
    return found and (found, plan)


@operator
def window_opens_one_tick_later(rng, system, plan):
    found = change_windows(rng, system, lambda p: replace(p, min=p.min + TICK, max=max(p.max, p.min + TICK)))
    return found and (found, plan)


@operator
def window_from_the_other_end(rng, system, plan):
    other = {Anchor.START: Anchor.END, Anchor.END: Anchor.START}
    found = change_windows(rng, system, lambda p: replace(p, anchor=other.get(p.anchor, p.anchor)))
    return found and (found, plan)


@operator
def one_more_demand(rng, system, plan):
    """Repeat a constraint, so that it demands one job more of a task on demand."""
    windows = [v for t in system.tasks for v in t.versions if v.precedences]
    if not windows:
        return None
    chosen = rng.choice(windows)
    more = replace(chosen, precedences=(*chosen.precedences, chosen.precedences[-1]))
    return change_versions(system, lambda v: more if v is chosen else v), plan


@operator
def superfluous_on_demand_job(rng, system, plan):
    helpers = [t for t in system.tasks if t.period is None]
    if not helpers:
        return None
    index = rng.randrange(4)
    total = oracle.ticks(plan.modes[0].hyperperiod)
    extra = make_job(helpers[0], index, rng.randrange(total), helpers[0].versions[0], [rng.choice(UNITS)])
    return system, change_jobs(plan, lambda jobs: [*jobs, extra])


@operator
def less_slack(rng, system, plan):
    """Take the smallest amount off the slack of a task that makes a difference in whole ticks."""
    loose = [t for t in system.tasks if t.period is not None and t.slack * t.period.fraction >= TICK.fraction]
    if not loose:
        return None
    chosen = rng.choice(loose)
    less = Fraction(int(chosen.slack * oracle.ticks(chosen.period)) - 1, oracle.ticks(chosen.period))
    return change_task(system, chosen, slack=less), plan


def change_task(system, chosen, **changes):
    return replace(system, tasks=tuple(replace(t, **changes) if t is chosen else t for t in system.tasks))


@operator
def another_offset(rng, system, plan):
    chosen = rng.choice([t for t in system.tasks if t.period is not None])
    now = chosen.offset if chosen.offset is not None else ms("0ms")
    return change_task(system, chosen, offset=now + TICK), plan


@operator
def tighter_deadline(rng, system, plan):
    chosen = rng.choice([t for t in system.tasks if t.period is not None])
    now = chosen.deadline if chosen.deadline is not None else chosen.period
    return change_task(system, chosen, deadline=now - rng.randint(1, 2) * TICK), plan


@operator
def tighter_chain(rng, system, plan):
    limited = [c for c in system.chains if c.max_reaction is not None or c.max_age is not None]
    if not limited:
        return None
    changed = tuple(
        replace(
            c,
            max_reaction=c.max_reaction and c.max_reaction - TICK,
            max_age=c.max_age and c.max_age - TICK,
        )
        for c in limited
    )
    return replace(system, chains=changed), plan


@operator
def wrong_hyperperiod(rng, system, plan):
    modes = list(plan.modes)
    modes[-1] = replace(modes[-1], hyperperiod=modes[-1].hyperperiod * rng.choice((2, Fraction(1, 2))))
    return system, replace(plan, modes=tuple(modes))


@operator
def another_period(rng, system, plan):
    chosen = rng.choice([t for t in system.tasks if t.period is not None])
    return change_task(system, chosen, period=chosen.period * rng.choice((2, 3))), plan


@operator
def another_model(rng, system, plan):
    return system, replace(plan, **rng.choice(({"model": "other"}, {"model_sha256": "1" * 64})))


@operator
def mode_missing(rng, system, plan):
    return system, replace(plan, modes=plan.modes[1:], transitions=())


@operator
def mode_twice(rng, system, plan):
    return system, replace(plan, modes=(*plan.modes, plan.modes[0]))


@operator
def not_found(rng, system, plan):
    return system, replace(plan, modes=(replace(plan.modes[0], status=Status.NOT_FOUND), *plan.modes[1:]))


def change_switch(plan, **changes):
    return replace(plan, transitions=(replace(plan.transitions[0], **changes),)) if plan.transitions else None


@operator
def switch_one_tick_longer(rng, system, plan):
    if not plan.transitions:
        return None
    table = plan.transitions[0]
    longer = change_switch(plan, length=table.length + TICK, worst_latency=table.worst_latency + TICK)
    return replace(system, transitions=()), longer


@operator
def switch_one_tick_shorter(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].length:
        return None
    table = plan.transitions[0]
    return system, change_switch(plan, length=table.length - TICK, worst_latency=table.worst_latency - TICK)


@operator
def switch_longer_than_allowed(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].length:
        return None
    limit = plan.transitions[0].length - TICK
    return replace(system, transitions=(replace(system.transitions[0], max_length=limit),)), plan


@operator
def switch_not_allowed(rng, system, plan):
    if not plan.transitions:
        return None
    return replace(system, transitions=(Transition(source="two", target="one"),)), plan


@operator
def switch_without_a_job(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].jobs:
        return None
    jobs = list(plan.transitions[0].jobs)
    jobs.pop(rng.randrange(len(jobs)))
    return system, change_switch(plan, jobs=tuple(jobs))


@operator
def switch_job_moved(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].jobs:
        return None
    jobs = list(plan.transitions[0].jobs)
    place = rng.randrange(len(jobs))
    jobs[place] = at(jobs[place], max(ms("0ms"), jobs[place].start + rng.choice((TICK, -TICK))))
    return system, change_switch(plan, jobs=tuple(jobs))


@operator
def switch_job_on_another_unit(rng, system, plan):
    if not plan.transitions or not plan.transitions[0].jobs:
        return None
    jobs = list(plan.transitions[0].jobs)
    place = rng.randrange(len(jobs))
    jobs[place] = replace(jobs[place], units=(rng.choice(UNITS), *jobs[place].units[1:]))
    return system, change_switch(plan, jobs=tuple(jobs))


@operator
def switch_to_a_mode_turned_by_a_tick(rng, system, plan):
    """Mode two itself stays valid; only the seam is off by one tick."""
    if not plan.transitions:
        return None
    total = plan.modes[1].hyperperiod
    by = rng.choice((TICK, total - TICK))
    return system, change_jobs(plan, lambda jobs: [at(j, (j.start + by) % total) for j in jobs], 1)


@operator
def task_leaves_with_the_switch(rng, system, plan):
    """Mode two loses a task; a job of it in the table is then forbidden, and its successors lose their predecessor."""
    return _without_a_task(rng, system, plan, 1)


@operator
def task_enters_with_the_switch(rng, system, plan):
    """Mode one loses a task; a job of it in the table is then early, and needs a reason."""
    return _without_a_task(rng, system, plan, 0)


def _without_a_task(rng, system, plan, which):
    if not plan.transitions:
        return None
    gone = rng.choice(system.modes[which].runs).task
    kept = tuple(run for run in system.modes[which].runs if run.task != gone)
    changed = replace(system.modes[which], runs=kept)
    modes = tuple(changed if k == which else m for k, m in enumerate(system.modes))
    smaller = replace(system, modes=modes)
    scope = oracle.tasks_of(smaller, changed.name)
    if all(t.period is None for t, _ in scope.values()):
        return None
    total = milliseconds(oracle.hyperperiod(scope))
    if total != plan.modes[which].hyperperiod:
        return None
    return smaller, change_jobs(plan, lambda jobs: [j for j in jobs if j.task != gone], which)


@operator
def wrong_worst_latency(rng, system, plan):
    if not plan.transitions:
        return None
    return system, change_switch(plan, worst_latency=plan.transitions[0].worst_latency + TICK)
