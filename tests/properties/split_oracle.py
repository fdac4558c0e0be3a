"""The second opinion on MODEL 8: interrupts served tick by tick, gaps and spans compared pair by pair.

Like `verify_oracle`, of which it is a part, it shares nothing with verify but the model classes.
"""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from functools import cache
from itertools import pairwise

from halpipe.models import Binding, ResourceKind


def whole(duration):
    """A duration in milliseconds, of which these systems are made."""
    value = duration.in_unit("ms")
    assert value.denominator == 1
    return int(value)


@cache
def interrupts(platform, names):
    rows = [i for unit in platform if unit.name in names for i in unit.interrupts]
    return tuple((whole(i.distance), whole(i.wcet)) for i in rows)


@cache
def finish(work, rows):
    """When `work` is over at the latest, if every interrupt comes at 0 and then as often as it may; None for never."""
    if sum((Fraction(c, distance) for distance, c in rows), Fraction(0)) >= 1:
        return None
    clock = pending = 0
    while work:
        pending += sum(c for distance, c in rows if clock % distance == 0)
        if pending:
            pending -= 1
        else:
            work -= 1
        clock += 1
    return clock


def rows_of(model, job):
    return interrupts(model.units, frozenset(job.units))


def pieces(model, job, wcet):
    """The parts of a job as (s, t, a, b), s and t from its start; one that is not split ends as late as it may."""
    if job.parts and wcet:
        begin = whole(job.start)
        found = [
            (whole(p.start) - begin, whole(p.end) - begin, whole(p.executed_from), whole(p.executed_to))
            for p in job.parts
        ]
        found = sorted(p for p in found if 0 <= p[0] < p[1])
        if found:
            return tuple(found)
    end = finish(wcet, rows_of(model, job))
    return ((0, max(0, whole(job.end) - whole(job.start)) if end is None else end, 0, wcet),)


def is_senseless(model):
    """Whether the model cuts an access phase of a version in use, or polls less often than arrivals come."""
    for task, version in {(run.task, name) for mode in model.modes for run in mode.runs for name in run.versions}:
        owner = model.task(task)
        if owner.distance is not None and (owner.period is None or owner.period > owner.distance):
            return True
        chosen = owner.version(version)
        phases = [a for a in chosen.accesses if not is_lock(model, a.resource)]
        if any(a.start < point < a.end for a in phases for point in chosen.split.points):
            return True
    return False


def is_lock(model, name):
    return any(r.name == name and r.kind is ResourceKind.LOCK for r in model.resources)


def shapes(model, tasks, jobs):
    """Whether the parts of every job are as its version allows."""
    for job in jobs:
        version = tasks[job.task][1].get(job.version)
        if version is None:
            continue
        if finish(1, rows_of(model, job)) is None or (job.parts and not well_cut(model, job, version)):
            yield "parts"


def well_cut(model, job, version):
    split, rows = version.split, rows_of(model, job)
    wcet, parts = whole(version.wcet), job.parts
    executed = [(whole(p.executed_from), whole(p.executed_to)) for p in parts]
    lasting = [(whole(p.start), whole(p.end)) for p in parts]
    cuts = [b for _, b in executed[:-1]]
    phases = [(whole(a.start), whole(a.end)) for a in version.accesses if not is_lock(model, a.resource)]
    if split.anywhere:
        permitted = {t for t in range(1, wcet) if not any(p < t < q for p, q in phases)}
    else:
        permitted = {whole(p) for p in split.points}
    resume = whole(split.resume)
    lengths = [finish(b - a + (resume if n else 0), rows) for n, (a, b) in enumerate(executed)] if executed else []
    return (
        executed[0][0] == 0
        and executed[-1][1] == wcet
        and all(a < b for a, b in executed)
        and all(b == a for (_, b), (a, _) in pairwise(executed))
        and lasting[0][0] == whole(job.start)
        and lasting[-1][1] == whole(job.end)
        and all(t < s for (_, t), (s, _) in pairwise(lasting))
        and [t - s for s, t in lasting] == lengths
        and set(cuts) <= permitted
        and (split.max_gaps is None or len(cuts) <= split.max_gaps)
        and (not cuts or split.min_part is None or min(b - a for a, b in executed) >= whole(split.min_part))
    )


def in_force(model, at, version, access):
    """From when to when a phase is in force, from the job's start; nothing where a gap lies in it."""
    first, last, rows = whole(access.start), whole(access.end), rows_of(model, at.job)
    for number, (begin, _, a, b) in enumerate(at.pieces):
        if len(at.pieces) == 1 or (a <= first and last <= b):
            lost = whole(version.split.resume) if number else 0
            a = a if len(at.pieces) > 1 else 0
            done = finish(lost + last - a, rows)
            return begin + lost + first - a, begin + (lost + last - a if done is None else done)
    return 0, 0


# ------------------------------------------------------------------------------------------------ nested


def fits(inner, outer, shift):
    """Whether `inner`, moved by `shift`, lies in one gap of `outer`."""
    gaps = [(outer.start + t, outer.start + s) for (_, t, _, _), (s, _, _, _) in pairwise(outer.pieces)]
    return any(begin <= inner.start + shift and inner.end + shift <= end for begin, end in gaps)


def nested(one, other, shift=0):
    """Whether two jobs, the second moved by `shift`, are as rule nested asks; whole ones are rule exclusive's."""
    if not set(one.job.units) & set(other.job.units) or len(one.pieces) == len(other.pieces) == 1:
        return True
    if one.start == one.end or other.start == other.end:
        return True
    if one.end <= other.start + shift or other.end + shift <= one.start:
        return True
    if one.job.task == other.job.task:
        return False
    return fits(other, one, shift) or fits(one, other, -shift)


def crossing(placed, total):
    turns = max((a.end - a.start for a in placed), default=0) // total + 2
    for number, one in enumerate(placed):
        for other in placed[number:]:
            for turn in range(-turns, turns + 1):
                if not (one is other and turn == 0) and not nested(one, other, turn * total):
                    return True
    return False


def crossing_on_line(line):
    return any(not nested(one, other) for n, one in enumerate(line) for other in line[n + 1 :])


# ------------------------------------------------------------------------------------------------ arrivals, binding


def too_late(task, before, after):
    """Whether an arrival just after the start of `before` is not served in time by `after`."""
    distance = whole(task.distance)
    deadline = distance if task.deadline is None else whole(task.deadline)
    return after.start - before.start > distance or after.end - before.start > deadline


def waits(task, own, total):
    """Whether some arrival is served too late, on the circle of one mode."""
    ordered = sorted(own, key=lambda a: (a.start, a.index))
    if not ordered:
        return False
    last = ordered[-1]
    first = last._replace(start=last.start - total, end=last.end - total)
    return any(too_late(task, before, after) for before, after in pairwise([first, *ordered]))


def hops(tasks, name, jobs):
    """Whether a bound task uses several sets of units within these jobs."""
    if tasks[name][0].binding is Binding.JOB:
        return False
    return len({frozenset(j.units) for j in jobs if j.task == name}) > 1


def hops_in_system(model, schedule):
    """Whether a task that is bound in the whole system uses several sets of units anywhere."""
    used = set()
    tables = [*((m.name, m.jobs) for m in schedule.modes), *((t.target, t.jobs) for t in schedule.transitions)]
    for name, jobs in tables:
        running = {run.task for run in model.mode(name).runs if run.versions}
        used |= {(j.task, frozenset(j.units)) for j in jobs if j.task in running}
    sets = Counter(task for task, _ in used)
    return any(task.binding is Binding.SYSTEM and sets[task.name] > 1 for task in model.tasks)
