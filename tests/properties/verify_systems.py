"""Small systems with a schedule: valid by construction, or wild.

A valid one is made backwards: jobs are placed first, where there is room, and the model is derived from where they
stand: windows, limits, bounds, deadlines. No solver takes part. `rng` is any `random.Random`.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import verify_oracle as oracle

from halpipe.core.durations import milliseconds
from halpipe.core.grouping import grouped
from halpipe.models import (
    Anchor,
    Job,
    ModeSchedule,
    Resource,
    Schedule,
    Status,
    TaskModel,
    Transition,
    TransitionTable,
    Unit,
)
from support import access, after, chain, mode, ms, task, version

UNITS = ("a", "b", "c")
TICK = milliseconds(1)


def make_job(owner, index, start, chosen, units):
    begin = milliseconds(start)
    return Job(
        task=owner.name, index=index, start=begin, end=begin + chosen.wcet, version=chosen.name, units=tuple(units)
    )


# ------------------------------------------------------------------------------------------------ valid ones


class Builder:
    """Places jobs on a circle of `total` ticks and derives the model from them."""

    def __init__(self, rng):
        self.rng = rng
        self.total = rng.choice((6, 12, 12, 24))
        self.held = {unit: set() for unit in UNITS}
        self.tasks = []
        self.jobs = []

    def build(self):
        for number in range(self.rng.randint(1, 4)):
            self.add_periodic(f"t{number}")
        if self.rng.random() < 0.7:
            self.add_constraint()
        if self.rng.random() < 0.4:
            self.add_on_demand()
        if self.rng.random() < 0.8:
            self.add_accesses()
        chains = self.chains() if self.rng.random() < 0.7 and self.tasks else ()
        return tuple(self.tasks), tuple(self.jobs), chains

    def room(self, start, wcet, units):
        return all((start + t) % self.total not in self.held[u] for u in units for t in range(wcet))

    def hold(self, start, wcet, units):
        for unit in units:
            self.held[unit].update((start + t) % self.total for t in range(wcet))

    def place(self, starts, wcet, gang):
        """Find a start and units with room among `starts`, hold them, and return them; None where there are none."""
        starts = [s % self.total for s in starts]
        self.rng.shuffle(starts)
        for start in starts:
            free = [u for u in UNITS if self.room(start, wcet, [u])]
            if len(free) >= gang:
                units = self.rng.sample(free, gang)
                self.hold(start, wcet, units)
                return start, units
        return None

    def add_periodic(self, name):
        """Add a task with all its jobs, or none; the first always fits, and makes the hyperperiod."""
        rng = self.rng
        period = self.total // (rng.choice((1, 1, 2, 3)) if self.tasks else 1)
        slack = rng.choice((Fraction(0), Fraction(0), Fraction(1, 4), Fraction(1, 2), Fraction(1)))
        wcets = [rng.randint(1, max(1, period * 2 // 3)) for _ in range(rng.choice((1, 1, 2)))]
        gang = rng.choice((1, 1, 1, 2))
        phase = rng.randrange(self.total)
        before = {unit: set(held) for unit, held in self.held.items()}
        found = []
        for index in range(self.total // period):
            chosen = rng.randrange(len(wcets))
            release = phase + index * period
            spot = self.place(range(release, release + int(slack * period) + 1), wcets[chosen], gang)
            if spot is None:
                self.held = before
                return
            found.append((index, chosen, *spot))
        used = sorted({u for *_, units in found for u in units} | set(rng.sample(UNITS, rng.randint(0, 2))))
        used += [u for u in UNITS if u not in used][: max(0, gang - len(used))]
        versions = [version(f"v{k}", c, " ".join(used), gang=gang) for k, c in enumerate(wcets)]
        worst = max((start - phase - index * period) % self.total + wcets[k] for index, k, start, _ in found)
        deadline = worst + rng.choice((0, 0, 1)) if worst > period or rng.random() < 0.4 else None
        offset = phase if phase < period and rng.random() < 0.4 else None
        owner = task(name, period, *versions, slack=slack, offset=offset, deadline=deadline)
        self.tasks.append(owner)
        self.jobs += [make_job(owner, index, start, versions[k], units) for index, k, start, units in found]

    def own(self, name):
        return [j for j in self.jobs if j.task == name]

    def add_constraint(self):
        """Let a task follow an earlier one, in a window around the differences that its jobs happen to have."""
        if len(self.tasks) < 2:
            return
        first, second = sorted(self.rng.sample(range(len(self.tasks)), 2))
        before, owner = self.tasks[first], self.tasks[second]
        anchor = self.rng.choice((Anchor.START, Anchor.END))
        turns = self.rng.choice((0, 0, 1))
        gaps = []
        for j in self.own(owner.name):
            points = [oracle.ticks(k.start if anchor is Anchor.START else k.end) for k in self.own(before.name)]
            gaps.append(turns * self.total + min((oracle.ticks(j.start) - x) % self.total for x in points))
        low = max(0, min(gaps) - self.rng.choice((0, 0, 1)))
        high = max(gaps) + self.rng.choice((0, 0, 1))
        window = after(before.name, low, high, anchor)
        self.replace(owner, versions=tuple(replace(v, precedences=(*v.precedences, window)) for v in owner.versions))

    def replace(self, owner, **changes):
        self.tasks = [replace(t, **changes) if t.name == owner.name else t for t in self.tasks]

    def add_on_demand(self):
        """Let the jobs of one version of a task each demand a job of a new task, placed where there is room."""
        owner = self.rng.choice(self.tasks)
        chosen = self.rng.choice(owner.versions)
        wcet = self.rng.randint(1, 2)
        helper = task("help", None, version("v0", wcet, " ".join(UNITS)))
        jobs, gaps = [], []
        for j in self.own(owner.name):
            if j.version == chosen.name:
                spot = self.place(range(self.total), wcet, 1)
                if spot is None:
                    return
                jobs.append(make_job(helper, j.index, spot[0], helper.versions[0], spot[1]))
        for j in self.own(owner.name):
            if j.version == chosen.name:
                starts = [oracle.ticks(k.start) for k in jobs]
                gaps.append(min((oracle.ticks(j.start) - x) % self.total for x in starts))
        window = after("help", min(gaps, default=0), max(gaps, default=3))
        versions = tuple(replace(v, precedences=(*v.precedences, window)) if v is chosen else v for v in owner.versions)
        self.replace(owner, versions=versions)
        self.tasks.append(helper)
        self.jobs += jobs

    def add_accesses(self):
        """Give phases to versions, each with as much of the resource as all others leave it."""
        for owner in self.rng.sample(self.tasks, self.rng.randint(1, len(self.tasks))):
            for chosen in owner.versions:
                start, end = 0, oracle.ticks(chosen.wcet)
                if self.rng.random() < 0.4:
                    start = self.rng.randrange(end)
                    end = self.rng.randint(start + 1, end)
                room = 1 - self.claimed(owner.name, chosen.name, start, end)
                twice = self.stacked(owner.name, chosen.name, start, end)
                bound = room / twice * self.rng.choice((1, Fraction(1, 2), Fraction(2, 3)))
                if bound > 0:
                    current = next(t for t in self.tasks if t.name == owner.name)
                    phase = access("r", start, end, bound)
                    self.replace(
                        current,
                        versions=tuple(
                            replace(v, accesses=(*v.accesses, phase)) if v.name == chosen.name else v
                            for v in current.versions
                        ),
                    )

    def phases(self):
        owners = {t.name: t for t in self.tasks}
        for j in self.jobs:
            for a in owners[j.task].version(j.version).accesses:
                begin = oracle.ticks(j.start)
                for t in range(begin + oracle.ticks(a.start), begin + oracle.ticks(a.end)):
                    yield t % self.total, a.bound

    def cells(self, name, chosen, start, end):
        for j in self.own(name):
            if j.version == chosen:
                yield from ((oracle.ticks(j.start) + t) % self.total for t in range(start, end))

    def claimed(self, name, chosen, start, end):
        sums = {}
        for cell, bound in self.phases():
            sums[cell] = sums.get(cell, Fraction(0)) + bound
        return max((sums.get(c, Fraction(0)) for c in self.cells(name, chosen, start, end)), default=Fraction(0))

    def stacked(self, name, chosen, start, end):
        cells = list(self.cells(name, chosen, start, end))
        return max((cells.count(c) for c in cells), default=1)

    def chains(self):
        names = [t.name for t in self.tasks]
        steps = self.rng.sample(names, self.rng.randint(1, min(3, len(names))))
        placed = [oracle.At(oracle.ticks(j.start), oracle.ticks(j.end), j.index, "", j) for j in self.jobs]
        bare = chain("c", " ".join(steps))
        _, reaction, age = oracle.chain_latency(bare, placed, self.total)
        spare = self.rng.choice((0, 0, 1))
        found = (None if worst is None else worst + spare for worst in (reaction, age))
        limits = [None if self.rng.random() < 0.2 else limit for limit in found]
        return (chain("c", " ".join(steps), *limits),)


def valid_system(rng):
    """A model with one mode and a schedule that is valid by construction."""
    builder = Builder(rng)
    tasks, jobs, chains = builder.build()
    system = TaskModel(
        name="m",
        units=tuple(Unit(name=u) for u in UNITS),
        resources=(Resource(name="r"),),
        tasks=tasks,
        chains=chains,
        modes=(mode("one", tasks),),
    ).read_from("0" * 64)
    return system, one_mode(system, jobs, builder.total)


def one_mode(system, jobs, total):
    table = ModeSchedule(name="one", hyperperiod=milliseconds(total), status=Status.VALID, jobs=tuple(jobs))
    return Schedule(model=system.name, model_sha256=system.digest, modes=(table,))


def switching_system(rng, make=None):
    """A valid system with a second mode, the same turned by some ticks, and the table that makes the turn.

    The table goes on as mode one would, so that every rule holds across the switch: the line is mode one without end.
    Only an offset forbids the turn, so there are none; and only there no job may start before the one before has ended.
    """
    while True:
        system, plan = (make or valid_system)(rng)
        if not any(runs_against_itself(own, plan.modes[0].hyperperiod) for own in own_jobs(plan)):
            return turned(rng, system, plan)


def own_jobs(plan):
    return grouped((job.task, job) for job in plan.modes[0].jobs).values()


def runs_against_itself(jobs, total):
    ordered = sorted(jobs, key=lambda job: job.start)
    later = [*(job.start for job in ordered[1:]), ordered[0].start + total]
    return any(start < job.end for job, start in zip(ordered, later, strict=True))


def turned(rng, system, plan):
    """Add the second mode and the table to a valid system of one mode."""
    tasks = tuple(replace(t, offset=None) for t in system.tasks)
    table = plan.modes[0]
    total = oracle.ticks(table.hyperperiod)
    length = rng.randrange(total + 1)
    shift = milliseconds(length)
    later = tuple(at(j, milliseconds((oracle.ticks(j.start) - length) % total)) for j in table.jobs)
    early = tuple(j for j in table.jobs if j.start < shift)
    system = replace(
        system,
        tasks=tasks,
        modes=(mode("one", tasks), mode("two", tasks)),
        transitions=(Transition(source="one", target="two", max_length=shift),),
    )
    switch = TransitionTable(
        source="one",
        target="two",
        length=shift,
        worst_latency=shift + table.hyperperiod,
        status=Status.VALID,
        jobs=early,
    )
    return system, replace(plan, modes=(table, replace(table, name="two", jobs=later)), transitions=(switch,))


def at(job, start):
    """The job at another start, its parts as far from it as before."""
    by = start - job.start
    parts = tuple(replace(p, start=p.start + by, end=p.end + by) for p in job.parts)
    return replace(job, start=start, end=job.end + by, parts=parts)


# ------------------------------------------------------------------------------------------------ wild ones


def wild_system(rng):
    """A sound model and a schedule whose jobs are thrown anywhere."""
    total = rng.choice((4, 6, 8))
    names = [f"t{k}" for k in range(rng.randint(1, 3))]
    tasks = tuple(wild_task(rng, total, names, k) for k in range(len(names)))
    if all(t.period is None for t in tasks):
        tasks = (replace(tasks[0], period=milliseconds(total)), *tasks[1:])
    steps = " ".join(rng.sample(names, rng.randint(1, len(names))))
    limits = [rng.choice((None, rng.randint(1, 3 * total))) for _ in range(2)]
    system = TaskModel(
        name="m",
        units=tuple(Unit(name=u) for u in UNITS[:2]),
        resources=(Resource(name="r"),),
        tasks=tasks,
        chains=(chain("c", steps, *limits),),
        modes=(mode("one", tasks),),
    ).read_from("0" * 64)
    scope = oracle.tasks_of(system, "one")
    total = oracle.hyperperiod(scope)
    counts, _ = oracle.counts_and_demands(scope, total)
    jobs = []
    for owner in tasks:
        for index in range(counts[owner.name]):
            if owner.period is not None or rng.random() < 0.7:
                chosen = rng.choice(owner.versions)
                regular = index * oracle.ticks(owner.period) if owner.period else 0
                start = (regular + rng.choice((0, 0, 1, rng.randrange(total)))) % total
                units = rng.sample(chosen.units, chosen.gang)
                jobs.append(make_job(owner, index, start, chosen, units))
    return system, one_mode(system, jobs, total)


def wild_task(rng, total, names, number):
    versions = []
    for k in range(rng.choice((1, 1, 2))):
        wcet = rng.randint(1, 3)
        start = rng.randrange(wcet)
        phases = [access("r", start, rng.randint(start + 1, wcet), rng.choice(("1/3", "1/2", "2/3", "1")))]
        need = [
            after(rng.choice(names[:number]), low := rng.randint(0, 4), low + rng.randint(0, total), anchor)
            for anchor in ("start", "end")
            if number and rng.random() < 0.4
        ]
        gang = rng.choice((1, 1, 1, 2))
        units = "a b" if gang == 2 else rng.choice(("a", "b", "a b", "a b"))
        versions.append(version(f"v{k}", wcet, units, *phases[: rng.randint(0, 1)], *need, gang=gang))
    period = rng.choice((total, total // 2, None if number + 1 < len(names) else total))
    return task(
        names[number],
        period,
        *versions,
        slack=rng.choice((0, 0, Fraction(1, 3), Fraction(1, 2), 1)),
        offset=rng.choice((None, None, rng.randrange(total))) if period else None,
        deadline=rng.choice((None, None, rng.randint(1, total))) if period else None,
    )


def wild_switch(rng):
    """A wild system with a second wild mode and a table of jobs thrown anywhere."""
    system, plan = wild_system(rng)
    tasks = list(system.tasks)
    runs = [t for t in tasks if rng.random() < 0.8]
    if all(t.period is None for t in runs):
        runs = tasks
    two = mode("two", runs)
    pair = [("one", "two"), ("two", "one")][rng.randrange(2)]
    system = replace(
        system,
        modes=(*system.modes, two),
        transitions=(Transition(source=pair[0], target=pair[1], max_length=rng.choice((None, ms(4)))),),
    )
    scope = oracle.tasks_of(system, "two")
    total = oracle.hyperperiod(scope)
    first = plan.modes[0]
    names = {t.name for t in runs}
    jobs = tuple(
        at(j, milliseconds((oracle.ticks(j.start) + rng.choice((0, 0, 0, 1))) % total))
        for j in first.jobs
        if j.task in names
    )
    second = ModeSchedule(name="two", hyperperiod=milliseconds(total), status=Status.VALID, jobs=jobs)
    length = rng.randint(0, 5)
    early = []
    target = oracle.tasks_of(system, pair[1])
    for owner, versions in target.values() if length else ():
        if rng.random() < 0.5:
            chosen = rng.choice(list(versions.values()))
            early.append(make_job(owner, 0, rng.randrange(length), chosen, rng.sample(chosen.units, chosen.gang)))
    source_total = first.hyperperiod if pair[0] == "one" else second.hyperperiod
    switch = TransitionTable(
        source=pair[0],
        target=pair[1],
        length=milliseconds(length),
        worst_latency=source_total + milliseconds(length),
        status=Status.VALID,
        jobs=tuple(early),
    )
    return system, replace(plan, modes=(first, second), transitions=(switch,))
