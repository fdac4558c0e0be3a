"""Every schedule in whole milliseconds of a small system with split jobs, until one is valid.

For what proofs and searches say: jobs are laid out in all ways that fit beside those before them, and the oracle is
asked about each table. Systems have one version for each task and no tasks on demand.
"""

from __future__ import annotations

from itertools import combinations, pairwise, product

import split_oracle
import verify_oracle as oracle
from split_systems import job_of
from verify_systems import one_mode

MOST = 20_000
"""Jobs that are laid out before it is given up."""


class TooManyError(Exception):
    """The system has more layouts than are looked at."""


def first_schedule(system):
    """Return a valid schedule whose instants are whole milliseconds; None if there is none."""
    return _Layouts(system).first()


class _Layouts:
    def __init__(self, system):
        self.system = system
        self.tasks = [system.task(run.task) for run in system.modes[0].runs]
        self.total = oracle.hyperperiod(oracle.tasks_of(system, system.modes[0].name))
        self.tried = 0

    def first(self):
        periods = [oracle.ticks(owner.period) for owner in self.tasks]
        jobs = [(number, index) for number, period in enumerate(periods) for index in range(self.total // period)]
        tables = (self._extend(jobs, phases, {}, []) for phases in product(*self._phases()))
        return next((table for table in tables if table is not None), None)

    def _phases(self):
        """All phases of every task; where there is no offset a table may be turned, so one task is put first."""
        if all(owner.offset is None for owner in self.tasks):
            return [[0], *([range(self.total)] * (len(self.tasks) - 1))]
        return [range(self.total) if t.offset is None else [oracle.ticks(t.offset)] for t in self.tasks]

    def _extend(self, left, phases, held, jobs):
        if not left:
            plan = one_mode(self.system, jobs, self.total)
            return None if oracle.broken(self.system, plan) else plan
        (number, index), *rest = left
        for job, cells in self._layouts(number, index, phases[number]):
            self.tried += 1
            if self.tried > MOST:
                raise TooManyError
            if all(not cells & held.get(unit, set()) for unit in job.units):
                more = held | {unit: held.get(unit, set()) | cells for unit in job.units}
                found = self._extend(rest, phases, more, [*jobs, job])
                if found is not None:
                    return found
        return None

    def _layouts(self, number, index, phase):
        """Yield a job wherever its slack and deadline let it be, with the ticks that it takes of its units."""
        owner = self.tasks[number]
        chosen = owner.versions[0]
        period, wcet = oracle.ticks(owner.period), oracle.ticks(chosen.wcet)
        release = phase + index * period
        late = int(owner.slack * period)
        latest = release + (late + self.total if owner.distance is not None else _deadline(owner))
        for units in combinations(chosen.units, chosen.gang):
            rows = split_oracle.interrupts(self.system.units, frozenset(units))
            for start in range(release, release + late + 1):
                for cuts in _cuts(chosen, wcet):
                    for spans in _spans(start, [0, *cuts, wcet], latest, rows, _resume(chosen)):
                        shift = start - start % self.total
                        at = [(s - shift, t - shift, a, b) for s, t, a, b in spans]
                        cells = {x % self.total for s, t, _, _ in spans for x in range(s, t)}
                        if len(cells) == sum(t - s for s, t, _, _ in spans):
                            yield job_of(owner.name, index, units, at), cells


def _deadline(owner):
    return oracle.ticks(owner.deadline or owner.period)


def _resume(chosen):
    return split_oracle.whole(chosen.split.resume)


def _cuts(chosen, wcet):
    """Every set of boundaries that the version may have, few first."""
    points = range(1, wcet) if chosen.split.anywhere else [split_oracle.whole(p) for p in chosen.split.points]
    most = len(points) if chosen.split.max_gaps is None else min(len(points), chosen.split.max_gaps)
    return [cuts for count in range(most + 1) for cuts in combinations(points, count)]


def _spans(start, bounds, latest, rows, resume):
    """Every way to lay out the parts between some boundaries that ends in time."""
    parts = list(pairwise(bounds))
    lengths = [split_oracle.finish(b - a + (resume if n else 0), rows) for n, (a, b) in enumerate(parts)]
    if None in lengths:
        return
    spare = latest - start - sum(lengths)
    gaps = len(parts) - 1
    for pauses in product(range(1, spare - gaps + 2), repeat=gaps) if spare >= gaps else ():
        if sum(pauses) <= spare:
            at, spans = start, []
            for (a, b), length, pause in zip(parts, lengths, (*pauses, 0), strict=True):
                spans.append((at, at + length, a, b))
                at += length + pause
            yield spans
