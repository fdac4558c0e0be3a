"""The second opinion on MODEL 10: instants, cycles, locks and logical execution times, tried one by one.

Like `verify_oracle`, of which it is a part, it shares nothing with verify but the model classes.
"""

from __future__ import annotations

from fractions import Fraction

from split_oracle import finish, rows_of, whole

from halpipe.models import Anchor, Match, ResourceKind

EVENTS = (Anchor.START, Anchor.END)
NOWHERE = -(10**9)
"""Stands for an instant that a job does not have: no window reaches so far."""


def locks(model):
    return {r.name for r in model.resources if r.kind is ResourceKind.LOCK}


def is_senseless(model):
    """Whether a requirement of a version in use refers to an instant that jobs do not have."""
    for mode in model.modes:
        running = {run.task: run.versions for run in mode.runs if run.versions}
        for name, versions in running.items():
            task = model.task(name)
            if task.let and (task.period is None or task.let > (task.deadline or task.period)):
                return True
            for version in map(task.version, versions):
                if any(a.resource in locks(model) and a.bound != 1 for a in version.accesses):
                    return True
                if any(is_odd(model, running, task, row) for row in version.precedences):
                    return True
    for chain in model.chains:
        is_back = len(chain.tasks) == 1 and (chain.anchor, chain.to) == (Anchor.END, Anchor.START)
        has_none = chain.anchor is Anchor.RELEASE and model.task(chain.tasks[0]).period is None
        if is_back or has_none or chain.anchor is Anchor.POINT or chain.to not in (None, *EVENTS):
            return True
    return False


def is_odd(model, running, task, row):
    if row.to not in EVENTS or (row.anchor is Anchor.POINT) != (row.point is not None):
        return True
    if row.task not in running:
        return False
    before = model.task(row.task)
    if row.match is Match.CYCLE and None in (task.period, before.period):
        return True
    if row.anchor is Anchor.RELEASE and before.period is None:
        return True
    return row.anchor is Anchor.POINT and any(row.point > before.version(v).wcet for v in running[row.task])


# ------------------------------------------------------------------------------------------------ releases


def suitable(task, own, total):
    """Every phase on a fine grid that suits all jobs of a task, with their delays."""
    period = whole(task.period)
    limits = [whole(d) for d in (task.deadline or task.period, task.let) if d is not None]
    if task.distance is not None:
        limits = [whole(task.let)] if task.let else []
    slack = task.slack * period
    tried = {Fraction(s, 2) for s in range(2 * total)}
    tried |= {(a.start - a.index * period - slack) % total for a in own}
    if task.offset is not None:
        tried = {Fraction(whole(task.offset) % period)}
    for phase in sorted(tried):
        delays = [(a.start - phase - a.index * period) % total for a in own]
        if all(
            d <= slack and all(d + a.end - a.start <= most for most in limits) for d, a in zip(delays, own, strict=True)
        ):
            yield phase, delays


def released(model, tasks, total, placed):
    """The jobs with the time since their releases: the latest phase that suits, which some job takes up at once."""
    delays = {}
    for name, (task, _) in tasks.items():
        own = [a for a in placed if a.job.task == name and task.period is not None]
        fitting = (
            [found for _, found in suitable(task, own, total) if task.offset is not None or 0 in found] if own else []
        )
        delays[name] = dict(zip(map(id, own), fitting[0] if fitting else [0] * len(own), strict=True))
    found = []
    for a in placed:
        task = tasks[a.job.task][0]
        delay = int(delays[a.job.task].get(id(a), 0))
        period = whole(task.period) if task.period is not None else 0
        first = a.index * period + (whole(task.offset) % period if period and task.offset is not None else 0)
        let = whole(task.let) if task.let and period else None
        found.append(a._replace(delay=delay, lap=total if a.start < first else 0, let=let))
    return found


def phases(tasks, total, placed):
    """For each task that a cycle or a LET names, whether its phase lies in its first period."""
    named = {name for name, (task, _) in tasks.items() if task.let}
    for name, (_, versions) in tasks.items():
        rows = [row for version in versions.values() for row in version.precedences if row.match is Match.CYCLE]
        named |= {name, *(row.task for row in rows)} if rows else set()
    for name in named & tasks.keys():
        task = tasks[name][0]
        own = [a for a in placed if a.job.task == name]
        found = list(suitable(task, own, total)) if own and task.period else []
        if task.let:
            found = [pair for pair in found if task.offset is not None or 0 in pair[1]][:1]
        if found:  # else rules periodic and deadline say so
            yield name, any(phase < whole(task.period) for phase, _ in found)


def outlasts(task, own, total):
    """Whether no phase lets all jobs of a task that serves arrivals end within its LET."""
    return bool(own) and not any(True for _ in suitable(task, own, total))


# ------------------------------------------------------------------------------------------------ instants


def instant(a, anchor):
    return {Anchor.START: a.start, Anchor.END: a.end, Anchor.RELEASE: a.start - a.delay}[anchor]


def own(row, a):
    return instant(a, row.to)


def theirs(row, a):
    """The instant of a predecessor from which a window counts."""
    if row.anchor is not Anchor.POINT:
        return instant(a, row.anchor)
    point = whole(row.point)
    for number, (begin, _, done_from, done_to) in enumerate(a.pieces):
        if done_from <= point <= done_to:
            done = finish((a.resume if number else 0) + point - done_from, a.rows)
            return a.start + begin + (0 if done is None else done)
    return NOWHERE


def has_same_cycle(tasks, row, a, others):
    if row.task not in tasks:
        return False
    number = a.index * whole(tasks[a.job.task][0].period) // whole(tasks[row.task][0].period)
    low, high = whole(row.min), whole(row.max)
    ages = [own(row, a) + a.lap - theirs(row, b) - b.lap for b in others if b.index == number]
    return any(low <= age <= high for age in ages)


# ------------------------------------------------------------------------------------------------ locks


def held(model, at, version, access):
    """When a lock is held, from the job's start: from the tick before which so much is done, to the last, by ticks."""
    first, last, rows = whole(access.start), whole(access.end), rows_of(model, at.job)
    begin = end = None
    for number, (start, _, a, b) in enumerate(at.pieces):
        lost = whole(version.split.resume) if number else 0
        if a <= first < b:
            begin = start + lost + first - a
        if a < last <= b:
            done = finish(lost + last - a, rows)
            end = start + (lost + last - a if done is None else done)
    return (0, 0) if begin is None or end is None else (begin, end)
