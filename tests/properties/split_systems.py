"""Small systems with split jobs, interrupts, bound and polled tasks, and a schedule that is valid by construction.

Made backwards like those of `verify_systems`: jobs are cut and placed first, the model follows from where they stand.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import split_oracle
import verify_oracle as oracle
from verify_systems import UNITS, Builder, one_mode
from verify_systems import switching_system as switching

from halpipe.core.durations import milliseconds
from halpipe.models import Binding, Interrupt, Job, Part, Resource, Split, TaskModel, Unit
from support import access, mode, task, version


class SplitBuilder(Builder):
    """Places jobs in parts on a circle of ticks."""

    def __init__(self, rng):
        super().__init__(rng)
        self.total = rng.choice((12, 20, 24, 30))
        self.platform = tuple(self.unit(name) for name in UNITS)
        self.placed = []

    def unit(self, name):
        rows = [(self.rng.randint(4, 12), 1) for _ in range(self.rng.choice((0, 0, 1, 2)))]
        served = tuple(
            Interrupt(name=f"i{n}", distance=milliseconds(distance), wcet=milliseconds(c))
            for n, (distance, c) in enumerate(rows)
        )
        return Unit(name=name, interrupts=served)

    def add_periodic(self, name):
        """Add a task with all its jobs, or none."""
        rng = self.rng
        period = self.total // (rng.choice((1, 1, 2, 3)) if self.tasks else 1)
        if self.total % period:
            return
        slack = self.slack()
        gang = rng.choice((1, 1, 1, 2))
        wcet = rng.randint(1, max(1, period // 3))
        split = self.split(wcet)
        phase = rng.randrange(self.total)
        kept = {unit: set(cells) for unit, cells in self.held.items()}, list(self.placed)
        home = self.home(gang)
        found = []
        for index in range(self.total // period):
            release = phase + index * period
            starts = range(release, release + int(slack * period) + 1)
            made = self.try_job(name, index, wcet, split, starts, home, gang)
            if made is None:
                self.held, self.placed = kept
                return
            found.append(made)
        self.adopt(name, period, slack, phase, wcet, split, gang, found)

    def slack(self):
        return self.rng.choice((Fraction(0), Fraction(1, 2), Fraction(1), Fraction(1)))

    def home(self, gang):
        """Return the units of all jobs of a task; None if each may have others."""
        home = self.rng.sample(UNITS, gang) if self.rng.random() < 0.6 else None
        return list(UNITS[:gang]) if self.rng.random() < 0.5 else home

    def split(self, wcet):
        rng = self.rng
        resume = milliseconds(rng.choice((0, 0, 1)))
        kind = rng.random() if wcet > 1 else 1
        if kind < 0.4:
            points = sorted(rng.sample(range(1, wcet), rng.randint(1, min(4, wcet - 1))))
            return Split(points=tuple(map(milliseconds, points)), resume=resume)
        return Split(anywhere=True, max_gaps=4, resume=resume) if kind < 0.8 else Split()

    def try_job(self, name, index, wcet, split, starts, home, gang):
        """Cut and place one job where there is room for it."""
        rng = self.rng
        for _ in range(60):
            units = home or rng.sample(UNITS, gang)
            rows = split_oracle.interrupts(self.platform, frozenset(units))
            start = rng.choice(starts) % self.total
            points = range(1, wcet) if split.anywhere else [split_oracle.whole(p) for p in split.points]
            cuts = sorted(rng.sample(list(points), min(len(points), rng.choice((0, 1, 1, 2, 3)))))
            at, spans = start, []
            for number, (a, b) in enumerate(pairwise([0, *cuts, wcet])):
                lasting = split_oracle.finish(b - a + (split_oracle.whole(split.resume) if number else 0), rows)
                if lasting is None:
                    break
                spans.append((at, at + lasting, a, b))
                at += lasting + rng.choice((1, 2, 4, 7))
            else:
                made = job_of(name, index, units, spans)
                if self.has_room(made, wcet):
                    return made
        return None

    def has_room(self, made, wcet):
        pieces = split_oracle.pieces(self.as_model(), made, wcet)
        begin = oracle.ticks(made.start)
        cells = [(begin + t) % self.total for s, t, _, _ in pieces for t in range(s, t)]
        if len(set(cells)) < len(cells) or any(c in self.held[u] for c in cells for u in made.units):
            return False
        placed = oracle.At(begin, begin + pieces[-1][1], made.index, "", made, pieces)
        if split_oracle.crossing([*self.placed, placed], self.total):
            return False
        self.placed.append(placed)
        for unit in made.units:
            self.held[unit].update(cells)
        return True

    def as_model(self):
        return TaskModel(name="m", units=self.platform)

    def adopt(self, name, period, slack, phase, wcet, split, gang, found):
        """Derive the task from its jobs."""
        rng = self.rng
        used = sorted({u for j in found for u in j.units} | set(rng.sample(UNITS, rng.randint(0, 2))))
        spans = [(oracle.ticks(j.start), oracle.ticks(j.end)) for j in found]
        worst = max(
            (start - phase - j.index * period) % self.total + end - start
            for j, (start, end) in zip(found, spans, strict=True)
        )
        deadline = worst + rng.choice((0, 0, 1)) if worst > period or rng.random() < 0.4 else None
        offset = phase if phase < period and rng.random() < 0.3 else None
        owner = task(
            name,
            period,
            replace(version("v", wcet, " ".join(used), gang=gang), split=self.limited(split, found)),
            slack=slack,
            offset=offset,
            deadline=deadline,
        )
        if rng.random() < 0.3:
            owner = polled(rng, owner, spans, self.total)
        if len({frozenset(j.units) for j in found}) == 1:
            owner = replace(owner, binding=rng.choice(tuple(Binding)))
        self.tasks.append(owner)
        self.jobs += found

    def limited(self, split, found):
        """The split with limits that just allow the gaps there are."""
        rng = self.rng
        gaps = max(max(0, len(j.parts) - 1) for j in found) + rng.choice((0, 0, 1))
        if not split.anywhere:
            return replace(split, max_gaps=rng.choice((None, gaps))) if split.points else split
        lengths = [p.executed_to - p.executed_from for j in found if len(j.parts) > 1 for p in j.parts]
        return replace(split, max_gaps=gaps, min_part=rng.choice((None, min(lengths))) if lengths else None)

    def add_accesses(self):
        """Give phases to versions, in parts that no job interrupts, with as much of the resource as others leave."""
        for owner in self.rng.sample(self.tasks, min(2, len(self.tasks))):
            chosen = owner.versions[0]
            wcet = oracle.ticks(chosen.wcet)
            cuts = {split_oracle.whole(p.executed_to) for j in self.own(owner.name) for p in j.parts[:-1]}
            cuts |= {split_oracle.whole(p) for p in chosen.split.points}
            start = self.rng.randrange(wcet)
            end = min([c for c in cuts if c > start], default=wcet)
            end = self.rng.randint(start + 1, end)
            self.claim(owner, chosen, start, end)

    def claim(self, owner, chosen, start, end):
        phase = access("r", start, end)
        sums = self.cells_of(owner, chosen, phase)
        twice = max(sums.values(), default=1)
        others = {}
        for other in self.tasks:
            for v in other.versions:
                for a in v.accesses:
                    for cell, count in self.cells_of(other, v, a).items():
                        others[cell] = others.get(cell, Fraction(0)) + count * a.bound
        room = 1 - max((others.get(cell, Fraction(0)) for cell in sums), default=Fraction(0))
        bound = room / twice * self.rng.choice((1, Fraction(1, 2)))
        if bound > 0:
            versions = (replace(chosen, accesses=(*chosen.accesses, replace(phase, bound=bound))),)
            self.replace(owner, versions=versions)

    def cells_of(self, owner, chosen, phase):
        counted = {}
        for at in (a for a in self.placed if a.job.task == owner.name):
            begin, end = split_oracle.in_force(self.as_model(), at, chosen, phase)
            for t in range(at.start + begin, at.start + end):
                counted[t % self.total] = counted.get(t % self.total, 0) + 1
        return counted

    def add_on_demand(self):
        """None here: `verify_systems` has them."""


class CrowdedBuilder(SplitBuilder):
    """Few units, and slack of a period: jobs of one task follow each other closely, with deadlines beyond periods."""

    def slack(self):
        return Fraction(1)

    def home(self, gang):
        return list(UNITS[:gang])


def job_of(name, index, units, spans):
    parts = tuple(
        Part(start=milliseconds(s), end=milliseconds(t), executed_from=milliseconds(a), executed_to=milliseconds(b))
        for s, t, a, b in spans
    )
    return Job(
        task=name,
        index=index,
        start=parts[0].start,
        end=parts[-1].end,
        version="v",
        units=tuple(units),
        parts=parts if len(parts) > 1 else (),
    )


def polled(rng, owner, spans, total):
    """The task as one that serves arrivals, as far apart as its jobs allow."""
    ordered = sorted(spans)
    before = [ordered[-1][0] - total, *(start for start, _ in ordered[:-1])]
    distance = max(start - x for (start, _), x in zip(ordered, before, strict=True)) + rng.choice((0, 0, 1))
    late = max(end - x for (_, end), x in zip(ordered, before, strict=True)) + rng.choice((0, 0, 1))
    deadline = None if late <= distance else milliseconds(late)
    return replace(owner, distance=milliseconds(distance), deadline=deadline)


def valid_system(rng, kind=SplitBuilder):
    """A model with one mode and a schedule that is valid by construction."""
    while True:
        builder = kind(rng)
        tasks, jobs, chains = builder.build()
        if tasks and max(oracle.ticks(t.period) for t in tasks) == builder.total:
            break
    system = TaskModel(
        name="m",
        units=builder.platform,
        resources=(Resource(name="r"),),
        tasks=tasks,
        chains=chains,
        modes=(mode("one", tasks),),
    ).read_from("0" * 64)
    return system, one_mode(system, jobs, builder.total)


def crowded_system(rng):
    """The same with several jobs of a task on one unit, many of them with deadlines beyond their periods."""
    return valid_system(rng, CrowdedBuilder)


def switching_system(rng):
    """The same with a second mode, turned by some ticks, and the table between."""
    return switching(rng, valid_system)
