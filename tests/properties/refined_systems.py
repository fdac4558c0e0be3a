"""Requirements of MODEL 10 for systems that have a schedule: some it keeps to the tick, some it misses by a tick."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import verify_oracle as oracle

from halpipe.core.durations import milliseconds
from halpipe.models import Anchor, Edge, Match, Precedence, ResourceKind

ANCHORS = (Anchor.START, Anchor.END, Anchor.RELEASE, Anchor.POINT)


def refined(rng, system, plan):
    """The system with some requirements more, of which most are kept by the schedule."""
    changes = [with_windows, with_let, with_locks, with_edge, with_events, with_offset]
    for change in rng.sample(changes, rng.randint(1, 3)):
        system = change(rng, system, plan)
    return system


def change_tasks(system, change):
    return replace(system, tasks=tuple(map(change, system.tasks)))


def with_windows(rng, system, plan):
    """Windows to an end, from a release or a point, or of the same cycle."""

    def window(task, row):
        if rng.random() < 0.3:
            return row
        before = next(t for t in system.tasks if t.name == row.task)
        anchors = [a for a in ANCHORS if a is not Anchor.RELEASE or before.period is not None or rng.random() < 0.05]
        anchor = rng.choice(anchors)
        shortest = min((int(v.wcet.in_unit("ms")) for v in before.versions), default=0)
        point = milliseconds(rng.randint(0, shortest)) if anchor is Anchor.POINT else None
        has_cycle = task.period is not None and before.period is not None
        match = rng.choice((Match.CYCLE, Match.WINDOW)) if has_cycle else Match.WINDOW
        low = milliseconds(rng.choice((0, 0, 1, 2)))
        high = milliseconds(rng.choice((3, 5, 8, 12, 24)))
        to = rng.choice((Anchor.START, Anchor.END))
        return replace(
            row, anchor=anchor, point=point, to=to, match=match, min=min(low, row.min), max=max(high, row.max)
        )

    def change(task):
        versions = [replace(v, precedences=tuple(window(task, p) for p in v.precedences)) for v in task.versions]
        return replace(task, versions=tuple(versions))

    return change_tasks(with_constraint(rng, system), change)


def with_constraint(rng, system):
    """One constraint more between two periodic tasks, in the order of the model, so that there is no circle."""
    periodic = [t for t in system.tasks if t.period is not None]
    if len(periodic) < 2 or any(p for t in system.tasks for v in t.versions for p in v.precedences):
        return system
    before, task = rng.sample(periodic, 2)
    row = Precedence(task=before.name, max=milliseconds(rng.choice((4, 8, 16))))

    def change(owner):
        versions = tuple(replace(v, precedences=(*v.precedences, row)) for v in owner.versions)
        return replace(owner, versions=versions) if owner is task else owner

    return change_tasks(system, change)


def with_let(rng, system, plan):
    def change(task):
        if task.period is None or rng.random() < 0.4:
            return task
        deadline = int((task.deadline or task.period).in_unit("ms"))
        return replace(task, let=milliseconds(rng.randint(max(1, deadline - 3), max(1, deadline))))

    return change_tasks(system, change)


def with_locks(rng, system, plan):
    """A resource that jobs hold alone, over the split points that lie in the phase."""
    if not system.resources:
        return system
    lock = rng.choice(system.resources).name

    def held(version, access):
        if access.resource != lock:
            return access
        return replace(access, bound=Fraction(1) if rng.random() < 0.97 else access.bound)

    def change(task):
        versions = [replace(v, accesses=tuple(held(v, a) for a in v.accesses)) for v in task.versions]
        return replace(task, versions=tuple(versions))

    resources = [replace(r, kind=ResourceKind.LOCK) if r.name == lock else r for r in system.resources]
    return replace(change_tasks(system, change), resources=tuple(resources))


def with_edge(rng, system, plan):
    def is_kept(mode):
        table = plan.mode(mode.name)
        return all(job.end <= table.hyperperiod for job in table.jobs)

    modes = (replace(m, edge=Edge.CLOSED) if is_kept(m) or rng.random() < 0.2 else m for m in system.modes)
    return replace(system, modes=tuple(modes))


def with_offset(rng, system, plan):
    """Offsets as the schedule has them, for some tasks; so that releases lie where jobs do not start."""

    def change(task):
        if task.period is None or rng.random() < 0.5:
            return task
        return replace(task, offset=milliseconds(rng.randrange(int(task.period.in_unit("ms")))), slack=Fraction(1))

    return change_tasks(system, change)


def with_events(rng, system, plan):
    def figure(chain, most):
        return milliseconds(max(1, rng.choice(most))) if most else None

    def change(chain):
        anchor = rng.choice((None, None, Anchor.RELEASE, Anchor.START, Anchor.END))
        chain = replace(chain, anchor=anchor, to=rng.choice((None, Anchor.START, Anchor.END)))
        table = plan.modes[0]
        tasks = oracle.tasks_of(system, table.name)
        if not all(name in tasks for name in chain.tasks) or oracle.refined_oracle.is_senseless(system):
            return chain
        total = oracle.hyperperiod(tasks)
        placed = [oracle.placed_at(system, tasks, j, "") for j in table.jobs if j.task in tasks]
        released = oracle.refined_oracle.released(system, tasks, total, placed)
        single = len(chain.tasks) == 1 and anchor is Anchor.END and chain.to is Anchor.START
        worst = (None,) * 3 if single else oracle.chain_latency(chain, released, total)
        limits = [None if w is None else milliseconds(max(1, w + rng.choice((-1, 0, 0, 0, 1)))) for w in worst]
        return replace(chain, max_latency=limits[0], max_reaction=limits[1], max_age=limits[2])

    return replace(system, chains=tuple(map(change, system.chains)))
