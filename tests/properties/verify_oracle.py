"""A second opinion on validity: MODEL 3 and 5 by brute force, tick by tick, for small systems in whole milliseconds.

It shares nothing with verify but the model classes: no sweep, no search, no modular shortcuts; every rule is the
sentence of the specification written as loops over all jobs, ticks and turns.
"""

from __future__ import annotations

import math
from collections import Counter
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import refined_oracle
import split_oracle

from halpipe.models import Anchor, Edge, Match, Status


class At(NamedTuple):
    """A job at an instant of an unrolled line; its pieces, each from s to t and from a to b, count from its start.

    `delay` is the time since its release, `lap` the hyperperiod for a job of the cycle before, `let` its logical
    execution time.
    """

    start: int
    end: int
    index: int
    part: str
    job: object
    pieces: tuple = ()
    delay: int = 0
    lap: int = 0
    let: int | None = None
    resume: int = 0
    rows: tuple = ()

    @property
    def read(self):
        return self.start if self.let is None else self.start - self.delay

    @property
    def write(self):
        return self.end if self.let is None else self.start - self.delay + self.let


def broken(model, schedule):
    """Return (rule, where) for everything broken; empty means valid."""
    found = set()
    if schedule.model != model.name:
        found.add(("file", ""))
    if model.digest and schedule.model_sha256 and model.digest != schedule.model_sha256:
        found.add(("file", ""))
    names = [m.name for m in schedule.modes]
    if sorted(names) != sorted(m.name for m in model.modes):
        return found | {("file", "")}
    for table in schedule.modes:
        found |= {(rule, table.name) for rule in _mode(model, table)}
    allowed = {(t.source, t.target): t.max_length for t in model.allowed_transitions()}
    pairs = [(t.source, t.target) for t in schedule.transitions]
    if len(set(pairs)) < len(pairs) or not set(pairs) <= set(allowed):
        return found | {("file", "")}
    for table in schedule.transitions:
        pair = (table.source, table.target)
        found |= {(rule, pair) for rule in _switch(model, schedule, table, allowed[pair])}
    if split_oracle.is_senseless(model) or refined_oracle.is_senseless(model):
        found.add(("file", ""))
    if split_oracle.hops_in_system(model, schedule):
        found.add(("binding", "system"))
    return found


@cache
def ticks(duration):
    value = duration.in_unit("ms")
    assert value.denominator == 1
    return int(value)


def tasks_of(model, mode_name):
    runs = {run.task: run.versions for run in model.mode(mode_name).runs}
    return {t.name: (t, {v: t.version(v) for v in runs[t.name]}) for t in model.tasks if runs.get(t.name)}


def hyperperiod(tasks):
    return math.lcm(*(ticks(t.period) for t, _ in tasks.values() if t.period is not None))


def counts_and_demands(tasks, total):
    """N of every task, and for every on-demand task the first index of each (demander, job)."""
    n, first = {}, {}

    def count(name):
        if name not in n:
            task, _ = tasks[name]
            if task.period is not None:
                n[name] = total // ticks(task.period)
            else:
                position = 0
                for other, (_, versions) in tasks.items():
                    most = max(sum(p.task == name for p in v.precedences) for v in versions.values())
                    if other == name or not most:
                        continue
                    for j in range(count(other)):
                        first[name, other, j] = position
                        position += most
                n[name] = position
        return n[name]

    for name in tasks:
        count(name)
    return n, first


def latency_jobs(jobs):
    return sorted(jobs, key=lambda a: (a.read, a.start, a.index))


def _mode(model, table):
    tasks = tasks_of(model, table.name)
    total = hyperperiod(tasks)
    if table.status is not Status.VALID:
        yield "file"
    if ticks(table.hyperperiod) != total:
        yield "file"
    for job in table.jobs:
        if job.task not in tasks or not 0 <= ticks(job.start) < total:
            yield "file"
        else:
            known = {v.name: v for v in tasks[job.task][0].versions}
            if job.version in known and not job.parts and ticks(job.end) != end_of(model, tasks, job):
                yield "file"
    jobs = [j for j in table.jobs if j.task in tasks]
    yield from _complete(tasks, total, jobs)
    yield from _assignment(model, tasks, jobs)
    placed = refined_oracle.released(model, tasks, total, [placed_at(model, tasks, j, "") for j in jobs])
    yield from _timing(tasks, total, placed)
    if any(name in tasks and not fits for name, fits in refined_oracle.phases(tasks, total, placed)):
        yield "periodic"
    if model.mode(table.name).edge is Edge.CLOSED and any(a.end > total for a in placed):
        yield "edge"
    yield from split_oracle.shapes(model, tasks, jobs)
    if split_oracle.crossing(placed, total):
        yield "nested"
    if any(split_oracle.hops(tasks, name, jobs) for name in tasks):
        yield "binding"
    if _overlap(placed, lambda t: t % total):
        yield "exclusive"
    if _overload(model, tasks, placed, lambda t: t % total):
        yield "access"
    if not all(_cyclic_precedence(tasks, total, placed, a) for a in placed):
        yield "precedence"
    for chain in model.chains:
        if all(t in tasks for t in chain.tasks):
            worst = chain_latency(chain, placed, total)
            limits = (chain.max_latency, chain.max_reaction, chain.max_age)
            if any(lim is not None and (w is None or w > ticks(lim)) for lim, w in zip(limits, worst, strict=True)):
                yield "chain"


def wcet(tasks, job):
    return next((ticks(v.wcet) for v in tasks[job.task][0].versions if v.name == job.version), 0)


def placed_at(model, tasks, job, part, shift=0):
    """A job at its place on a line, moved by `shift`."""
    begin, pieces = ticks(job.start), split_oracle.pieces(model, job, wcet(tasks, job))
    at = At(begin + shift, begin + shift + pieces[-1][1], job.index, part, job, pieces)
    resume = next((ticks(v.split.resume) for v in tasks[job.task][0].versions if v.name == job.version), 0)
    return at._replace(resume=resume, rows=split_oracle.rows_of(model, job))


def end_of(model, tasks, job):
    return placed_at(model, tasks, job, "").end


def version(tasks, job):
    return tasks[job.task][1].get(job.version)


def _complete(tasks, total, jobs):
    n, first = counts_and_demands(tasks, total)
    for name, (task, _) in tasks.items():
        present = sorted(j.index for j in jobs if j.task == name)
        if task.period is not None:
            expected = list(range(n[name]))
        else:
            expected = []
            for j in {(j.task, j.index): j for j in jobs}.values():
                if (name, j.task, j.index) in first and version(tasks, j):
                    slots = sum(p.task == name for p in version(tasks, j).precedences)
                    expected += [first[name, j.task, j.index] + slot for slot in range(slots)]
            expected = sorted(set(expected))
        if present != expected:
            yield "complete"


def _assignment(model, tasks, jobs):
    platform = {u.name for u in model.units}
    for job in jobs:
        v = version(tasks, job)
        if v is None:
            yield "version"
        elif not len(job.units) == len(set(job.units)) == v.gang or not set(job.units) <= platform & set(v.units):
            yield "unit"


def _timing(tasks, total, placed):
    """Try every phase in half ticks."""
    for name, (task, _) in tasks.items():
        if task.period is None:
            continue
        period = ticks(task.period)
        deadline = period if task.deadline is None else ticks(task.deadline)
        own = [a for a in placed if a.job.task == name and 0 <= a.index < total // period]
        phases = [Fraction(s, 2) for s in range(2 * total)]
        if task.offset is not None:
            phases = [Fraction(ticks(task.offset) % period)]
        in_slack = in_time = False
        for s in phases:
            deltas = [(a.start - s - a.index * period) % total for a in own]
            slack_ok = all(d <= task.slack * period for d in deltas)
            in_slack |= slack_ok
            known = {v.name for v in task.versions}
            deadline = min(deadline, ticks(task.let)) if task.let and task.distance is None else deadline
            ends = [d + a.end - a.start for d, a in zip(deltas, own, strict=True) if a.job.version in known]
            in_time |= slack_ok and all(end <= deadline for end in ends)
        if not in_slack:
            yield "periodic"
        if task.distance is not None and task.let and refined_oracle.outlasts(task, own, total):
            yield "deadline"
        if task.distance is not None:
            if split_oracle.waits(task, [a for a in placed if a.job.task == name], total):
                yield "deadline"
        elif in_slack and not in_time:
            yield "deadline"


def _overlap(placed, cell):
    held = Counter()
    for a in placed:
        for unit in set(a.job.units):
            for begin, end, _, _ in a.pieces:
                for t in range(a.start + begin, a.start + end):
                    held[unit, cell(t)] += 1
    return any(count > 1 for count in held.values())


def _overload(model, tasks, placed, cell):
    claimed = {}
    for a in placed:
        v = version(tasks, a.job)
        for access in v.accesses if v else ():
            is_lock = access.resource in refined_oracle.locks(model)
            begin, end = (refined_oracle.held if is_lock else split_oracle.in_force)(model, a, v, access)
            for t in range(a.start + begin, a.start + end):
                key = (access.resource, cell(t))
                claimed[key] = claimed.get(key, 0) + access.bound
    return any(bound > 1 for bound in claimed.values())


def _cyclic_precedence(tasks, total, placed, a):
    v = version(tasks, a.job)
    for p in v.precedences if v else ():
        low, high = ticks(p.min), ticks(p.max)
        longest = max((b.end for b in placed), default=0)
        turns = range(-2 - longest // total, (high + 2 * longest) // total + 3)
        own, others = refined_oracle.own(p, a), [b for b in placed if b.job.task == p.task]
        if p.match is Match.CYCLE:
            if not refined_oracle.has_same_cycle(tasks, p, a, others):
                return False
        elif not any(low <= own + m * total - refined_oracle.theirs(p, b) <= high for b in others for m in turns):
            return False
    return True


def chain_latency(chain, placed, total):
    turns = 2 * len(chain.tasks) + 3 + sum(a.let or 0 for a in placed if a.index == 0) // total
    line = [
        a._replace(start=a.start + q * total, end=a.end + q * total, part=str(q))
        for q in range(-turns, turns + 1)
        for a in placed
    ]
    figures = []
    for paths, side in ((latencies_of, 0), (reactions_of, 0), (ages_of, 1)):
        found = [pair for pair in paths(chain, line) if pair[side].part == "0"]
        figures.append(max((length(chain, *pair) for pair in found), default=None))
    return tuple(figures)


def length(chain, first, last):
    """The time from the event of the first job to the event of the last one."""
    begin = first.read if chain.anchor is None else refined_oracle.instant(first, chain.anchor)
    return (last.write if chain.to is None else refined_oracle.instant(last, chain.to)) - begin


def follow(chain, line, reached):
    """The job of the last task that a job of the first leads to."""
    for name in chain.tasks[1:]:
        later = [a for a in line if a.job.task == name and a.read >= reached.write]
        if not later:
            return None
        reached = latency_jobs(later)[0]
    return reached


def latencies_of(chain, line):
    """(job of the first task, last job) of every path."""
    for first in (a for a in line if a.job.task == chain.tasks[0]):
        last = follow(chain, line, first)
        if last is not None:
            yield first, last


def reactions_of(chain, line):
    """(job missed, last job) of every stimulus."""
    own = latency_jobs(a for a in line if a.job.task == chain.tasks[0])
    for missed in own:
        later = [a for a in own if a.read > missed.read]
        last = follow(chain, line, later[0]) if later else None
        if last is not None:
            yield missed, last


def order_of(placed):
    """The order of jobs of one task that read and write together: by release, then by number."""
    return refined_oracle.instant(placed, Anchor.RELEASE), placed.index


def ages_of(chain, line):
    """(first job, last job) of every output."""
    for last in (a for a in line if a.job.task == chain.tasks[-1]):
        reached = last
        for name in reversed(chain.tasks[:-1]):
            earlier = [a for a in line if a.job.task == name and a.write <= reached.read]
            if not earlier:
                break
            reached = max(earlier, key=lambda a: (a.write, a.read, -a.start, *order_of(a)))
        else:
            yield reached, last


# ------------------------------------------------------------------------------------------------ switches


def _switch(model, schedule, table, max_length):
    source, target = tasks_of(model, table.source), tasks_of(model, table.target)
    length = ticks(table.length)
    period = hyperperiod(source), hyperperiod(target)
    if length < 0 or (max_length is not None and table.length > max_length):
        yield "length"
    if ticks(table.worst_latency) != period[0] + length:
        yield "length"
    if len({(j.task, j.index) for j in table.jobs}) < len(table.jobs):
        yield "length"
    jobs = [j for j in table.jobs if j.task in target]
    if len(jobs) < len(table.jobs):
        yield "file"
    for job in jobs:
        known = {v.name: v for v in target[job.task][0].versions}
        if not 0 <= ticks(job.start) < length:
            yield "file"
        if job.version in known and not job.parts and ticks(job.end) != end_of(model, target, job):
            yield "file"
    yield from split_oracle.shapes(model, target, jobs)
    if any(split_oracle.hops(target, name, [*schedule.mode(table.target).jobs, *jobs]) for name in target):
        yield "binding"
    yield from _assignment(model, target, jobs)
    if model.mode(table.target).edge is Edge.CLOSED:
        last_ends = [a.end for a in _line(model, schedule, table, jobs, period, 2) if a.part != "m"]
        if max(last_ends, default=0) > length:
            yield "edge"
    for job in jobs:
        task = target[job.task][0]
        if (
            task.let
            and wcet(target, job)
            and placed_at(model, target, job, "").end - ticks(job.start) > ticks(task.let)
        ):
            yield "edge"
    far = _line(model, schedule, table, jobs, period, _reach(model, period))
    line = _line(model, schedule, table, jobs, period, 2)
    everything = {t.name: (t, {v.name: v for v in t.versions}) for t in model.tasks}
    last = max((a.end for a in line if a.part != "m" and returns_late(everything, a)), default=0)
    if last > length + 2 * period[1]:
        line = _line(model, schedule, table, jobs, period, (last - length) // period[1] + 1)
    if _overlap(line, lambda t: t):
        yield "exclusive"
    if split_oracle.crossing_on_line(line):
        yield "nested"
    if _overload(model, everything, line, lambda t: t):
        yield "access"
    settled = length + (_reach(model, period) - 1) * period[1]  # the last cycle lacks what follows it
    from_here = (a for a in far if a.part != "n" and a.start < settled)
    if not all(_line_precedence(target, far, a, a.start < length + period[1]) for a in from_here):
        yield "precedence"
    yield from _continuity(source, target, line)
    yield from _entering(source, target, far)
    yield from _line_chains(model, source, target, far, length)


def returns_late(tasks, a):
    """Whether a job may take something that it did not hold when it started."""
    v = version(tasks, a.job)
    return len(a.pieces) > 1 or bool(v and v.accesses)


def _reach(model, period):
    longest = max((ticks(p.max) for t in model.tasks for v in t.versions for p in v.precedences), default=0)
    steps = max((len(c.tasks) for c in model.chains), default=0)
    lets = sum(ticks(t.let) for t in model.tasks if t.let)
    return 2 * steps + 4 + (longest + lets) // min(period)


def _line(model, schedule, table, jobs, period, turns):
    length = ticks(table.length)
    line = []
    for name, part, shifts in (
        (table.source, "n", [q * period[0] for q in range(-turns, 0)]),
        (table.target, "m", [length + q * period[1] for q in range(turns)]),
    ):
        tasks = tasks_of(model, name)
        own = [placed_at(model, tasks, j, part) for j in schedule.mode(name).jobs if j.task in tasks]
        own = refined_oracle.released(model, tasks, hyperperiod(tasks), own)
        line += [a._replace(start=a.start + shift, end=a.end + shift) for shift in shifts for a in own]
    target = tasks_of(model, table.target)
    return line + [with_let(target, placed_at(model, target, j, "table")) for j in jobs]


def with_let(tasks, a):
    task = tasks[a.job.task][0]
    return a._replace(let=ticks(task.let) if task.let and task.period else None)


def _line_precedence(target, far, a, is_in_first_cycle):
    v = version(target, a.job)
    return all(
        any(
            ticks(p.min) <= refined_oracle.own(p, a) - refined_oracle.theirs(p, b) <= ticks(p.max)
            for b in far
            if b.job.task == p.task
        )
        for p in (v.precedences if v else ())
        if p.match is not Match.CYCLE or a.part == "table" or (a.lap and is_in_first_cycle)
    )


def _continuity(source, target, line):
    for name in source.keys() & target.keys():
        task, _ = source[name]
        own = sorted((a for a in line if a.job.task == name), key=lambda a: (a.start, a.index))
        for number, after in enumerate(own):
            if any(b.end > after.start for b in own[:number] if not b.part == after.part != "table"):
                yield "itself"
        for before, after in pairwise(own):
            if before.part == after.part != "table":
                continue
            if task.period is not None and after.start - before.start > (1 + task.slack) * ticks(task.period):
                yield "starved"
            if task.distance is not None and split_oracle.too_late(task, before, after):
                yield "deadline"


def _entering(source, target, line):
    for a in line:
        if a.part == "table" and a.job.task not in source and version(target, a.job):
            needed = any(
                ticks(p.min) <= refined_oracle.own(p, b) - refined_oracle.theirs(p, a) <= ticks(p.max)
                for b in line
                if b.part != "n" and version(target, b.job)
                for p in version(target, b.job).precedences
                if p.task == a.job.task
            )
            if not needed:
                yield "early"


def _line_chains(model, source, target, far, until):
    for chain in model.chains:
        if not all(name in source and name in target for name in chain.tasks):
            continue
        limits = (chain.max_latency, chain.max_reaction, chain.max_age)
        for paths, limit in zip((latencies_of, reactions_of, ages_of), limits, strict=True):
            for first, last in paths(chain, far) if limit is not None else ():
                if last.start >= 0 and first.start < until and length(chain, first, last) > ticks(limit):
                    yield "chain"
