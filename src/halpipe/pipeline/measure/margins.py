"""Margins of WCETs: the least of a schedule, and the largest that any schedule of a mode can have.

The margin of a stay on a unit is the share of its own length by which it could last longer before the next one begins
there. All numbers are exact.
"""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from graphlib import TopologicalSorter
from itertools import combinations, pairwise, product
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.models import Anchor, Binding
from halpipe.pipeline.jobs import demand_ranges
from halpipe.pipeline.parts import reserved_length, service_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import TaskModel, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.measure.placement import Placement

    Rational = int | Fraction

LARGEST_MARGIN = Fraction(100)
"""Growth beyond a hundred times the WCET is of no interest; a job alone on its unit would have no bound."""


def least_margin(placement: Placement) -> Fraction:
    """Return by what share of its length every stay on a unit could last longer, at most `LARGEST_MARGIN`."""
    least, length = LARGEST_MARGIN, placement.hyperperiod
    stays: dict[str, list[tuple[int | Fraction, int | Fraction]]] = {}
    for job in placement.jobs:
        spans = [(start % length, end - start) for start, end in job.occupations() if start < end]
        for unit in dict.fromkeys(job.units) if spans else ():
            stays.setdefault(unit, []).extend(spans)
    for on_unit in stays.values():
        on_unit.sort()
        following = [*(start for start, _ in on_unit[1:]), on_unit[0][0] + length]
        for (start, own), then in zip(on_unit, following, strict=True):
            if then - start - own < own * least:
                least = Fraction(then - start - own) / own
    return least


def largest_margin(expansion: Expansion, model: TaskModel) -> Fraction:
    """Return by what share all stays could grow before units were too few for them, a job too long, or a window shut.

    A version stays for its WCET and the interrupts of that time. Parts of a job count each interrupt once or more
    often, so that they stay no shorter together.
    """
    return min(_Bound(expansion, model).growths()) - 1


class _Bound:
    """Limits of the growth of stays, one more than their margin, in every schedule of a mode; times in nanoseconds."""

    def __init__(self, expansion: Expansion, model: TaskModel) -> None:
        self.hyperperiod = expansion.hyperperiod.ns
        self.by_name = {each.name: each for each in expansion.tasks if all(version.wcet for version in each.versions)}
        self.model, self.units = model, {unit.name: unit for unit in model.units if unit.interrupts}
        self.jobs = _least_jobs(expansion)
        self.cyclic = [each for each in self.by_name.values() if each.task.period is not None]
        self.stays = {name: min(map(self.least, each.versions)) for name, each in self.by_name.items()}

    def growths(self) -> Iterator[Fraction]:
        """Yield a bound for each limit."""
        yield 1 + LARGEST_MARGIN
        every = self.by_name.values()
        units = {name for active in every for version in active.versions for name in version.units}
        work = sum(self.jobs[each.name] * min(self.least(v) * v.gang for v in each.versions) for each in every)
        if work:
            yield Fraction(len(units) * self.hyperperiod, work)
        for active in self.cyclic:  # round the hyperperiod, or in each period where all its jobs are on one unit
            is_free = active.task.binding is Binding.JOB
            yield Fraction(self.hyperperiod if is_free else _period(active), self.stay(active))
        yield from self.of_units()
        yield from self.of_windows()
        yield from self.of_chains()

    def stay(self, active: ActiveTask) -> Rational:
        """Return how long a job of a task stays at least."""
        return self.stays[active.name]

    def least(self, version: Version) -> Rational:
        """Return the least stay of a version: on all its units, or on the one with the fewest interrupts."""
        work = version.wcet or ZERO
        if self.units.keys().isdisjoint(version.units):
            return work.ns
        names = tuple(dict.fromkeys(version.units))
        found = []
        for chosen in (names,) if version.gang == len(names) else ((name,) for name in names):
            with suppress(ValueError):  # no time is enough there
                service = service_of(self.units, [name for name in chosen if name in self.units])
                found.append(reserved_length(work, service).ns)
        return min(found, default=work.ns)

    def of_units(self) -> Iterator[Fraction]:
        """Yield by what stays could grow before a unit had too much of what runs there alone, or two jobs met."""
        by_unit: dict[str, list[ActiveTask]] = {}
        for active in self.by_name.values():
            sets = {(frozenset(version.units), version.gang) for version in active.versions}
            if len(sets) == 1:
                units, gang = sets.pop()
                for unit in units if gang == len(units) else ():
                    by_unit.setdefault(unit, []).append(active)
        for own in by_unit.values():
            if work := sum(self.stay(each) * self.jobs[each.name] for each in own):
                yield Fraction(self.hyperperiod, work)
            cyclic = (each for each in own if each.task.period is not None)
            whole = sorted((each for each in cyclic if not _is_split(each)), key=self.stay, reverse=True)
            strict = grouped((_period(each), each) for each in whole if not each.task.slack)
            tops = [(period, each) for period, alike in strict.items() for each in alike[:2]]
            for (period, each), (other, its) in combinations(tops, 2):
                cycle = greatest_common_divisor([Duration(period), Duration(other)])
                yield Fraction(cycle.ns, self.stay(each) + self.stay(its))
            for each, its in product(whole, whole[:2]):  # a job in one piece lies between two of another task
                if its is not each:
                    yield _period(each) * (1 + each.task.slack) / Fraction(self.stay(each) + self.stay(its))

    def of_windows(self) -> Iterator[Fraction]:
        """Yield by what a stay could grow where a window makes another job begin soon after it."""
        for active in self.cyclic:  # whose jobs there are, whatever versions others have
            gaps = [self.gaps(version) for version in active.versions]
            for name in set(gaps[0]).intersection(*gaps):
                before = self.by_name[name]
                alike = ceil(Fraction(active.jobs, before.jobs or active.jobs))  # in the window of one job before them
                yield from self.followed(before, active, max(found[name] for found in gaps), alike)

    def gaps(self, version: Version) -> dict[str, Rational]:
        """Return how long at most after the end of a job on one of its units this version starts, by task.

        A job in parts may enclose the other one. A window to an end may be empty but for a job that ends where the
        other one starts: then that has no gap either.
        """
        found: dict[str, Rational] = {}
        for row in version.precedences:
            before, is_end = self.by_name.get(row.task), row.to is Anchor.END
            is_start = row.anchor is Anchor.START and before is not None and not _is_split(before)
            if before and (is_start or row.anchor is Anchor.END) and not (is_end and _is_cut(version)):
                gap = row.max.ns - self.least(version) * is_end - self.stay(before) * is_start
                found[row.task] = min(found.get(row.task, gap), gap)
        return found

    def of_chains(self) -> Iterator[Fraction]:
        """Yield by what a stay could grow where a chain makes the next job begin soon after it.

        In a reaction time, what comes too late for a job of any of the tasks waits for the next one, a period later.
        """
        cyclic = {each.name: each for each in self.cyclic if each.task.let is None} if self.model.chains else {}
        for chain in self.model.chains:
            members = [cyclic[name] for name in chain.tasks if name in cyclic]
            if len(members) == len(chain.tasks) and not (chain.anchor or chain.to):
                limits = (chain.max_latency, 0), (chain.max_age, 0), (chain.max_reaction, max(map(_period, members)))
                work = sum(map(self.stay, members))
                gaps = [limit.ns - less - work for limit, less in limits if limit]
                for before, active in pairwise(members if gaps else ()):
                    yield from self.followed(before, active, min(gaps))

    def followed(self, before: ActiveTask, active: ActiveTask, gap: Rational, alike: int = 1) -> Iterator[Fraction]:
        """Yield by what a stay could grow before so many jobs on one of its units that start so long after its end."""
        if all(_share_units(version, before) for version in active.versions) and (gap <= 0 or not _is_split(before)):
            is_one = _is_split(active) or not all(_share_units(version, active) for version in active.versions)
            own, between = self.stay(before), 0 if is_one else (alike - 1) * self.stay(active)
            yield max(Fraction(1), Fraction(own + max(0, gap), own + between))


def _least_jobs(expansion: Expansion) -> dict[str, int]:
    """Return how many jobs each task has at least, whatever versions the jobs that demand them have."""
    found = {each.name: each.jobs for each in expansion.tasks if each.task.period is not None}
    asked = {each.name: {demand.task for demand in each.demands} for each in expansion.tasks if each.name not in found}
    for name in TopologicalSorter(asked).static_order():
        if name not in found:
            ranges = {other: demand_ranges(expansion.by_name[other].versions) for other in asked[name]}
            found[name] = sum(found[other] * ranges[other][name][0] for other in asked[name])
    return found


def _share_units(version: Version, other: ActiveTask) -> bool:
    """Return whether a version has a unit in common with each version of another task, on whichever units both run."""
    return all(len({*version.units, *its.units}) < version.gang + its.gang for its in other.versions)


def _is_cut(version: Version) -> bool:
    return version.split.is_allowed and version.split.max_gaps != 0


def _is_split(active: ActiveTask) -> bool:
    return any(map(_is_cut, active.versions))


def _period(active: ActiveTask) -> Rational:
    assert active.task.period is not None, "it was asked for"
    return active.task.period.ns


def least_wcet(active: ActiveTask) -> Duration:
    """Return the shortest WCET of the versions of a task."""
    return min((version.wcet for version in active.versions if version.wcet is not None), default=ZERO)
