"""Learning from a recording: WCETs by quantile and margin, and the periods and offsets at which tasks ran.

What a recording shows is a lower bound of the truth, so a WCET is only ever raised. A period that contradicts the model
is learned, too; one that agrees is stated in a comment.
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import field, replace
from fractions import Fraction
from itertools import pairwise
from statistics import median_low
from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.durations import Duration
from halpipe.core.options import option
from halpipe.core.quantities import format_rational, parse_share
from halpipe.core.records import record
from halpipe.core.samples import quantile, quantile_of, with_margin
from halpipe.core.suggest import counted
from halpipe.models.trace import column, groups
from halpipe.pipeline.compare import CompareOptions, Comparison

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.models import TaskModel
    from halpipe.models.trace import Instant

_LEAST_STARTS = 4
_FEW = 30
"""Jobs below which a comment warns."""


@record(kw_only=True)
class LearnOptions(CompareOptions):
    """`quantile` of the run times, and the `margin` that is added to it, as shares."""

    quantile: Fraction = option(
        Fraction(1), "With --learn: the share of the jobs that a learned WCET covers.", quantile_of, metavar="SHARE"
    )
    margin: Fraction = option(
        Fraction(1, 5), "With --learn: the share that is added to it.", parse_share, metavar="SHARE"
    )


@record(kw_only=True)
class LearnedVersion:
    """Run times of a version: `wcet` is what is learned, `stated` that of the model, `raises` whether it is more."""

    task: str
    version: str
    jobs: int
    longest: Duration
    wcet: Duration
    stated: Duration | None

    @property
    def raises(self) -> bool:
        """Whether the model states less, or nothing."""
        return self.stated is None or self.wcet > self.stated


@record(kw_only=True)
class LearnedPeriod:
    """Starts of a task: `jitter` is how far they vary, `stated` the period of the model."""

    task: str
    period: Duration
    offset: Duration
    jitter: Duration
    stated: Duration | None
    is_known: bool

    @property
    def differs(self) -> bool:
        """Whether the model states another period."""
        return self.is_known and self.stated is not None and self.stated != self.period


@record(kw_only=True)
class Learned:
    """Everything that recordings teach of the tasks of a schedule, and of others that ran.

    `distances` has the least distance of two starts of other tasks that keep no period.
    """

    versions: tuple[LearnedVersion, ...]
    periods: tuple[LearnedPeriod, ...]
    distances: Mapping[str, Duration] = field(default_factory=dict)

    def corrected(self, model: TaskModel) -> TaskModel:
        """Return a model with the WCETs and periods that are learned."""
        wcets = {(each.task, each.version): each.wcet for each in self.versions if each.raises}
        periods = {each.task: each for each in self.periods if each.differs}
        tasks = []
        for task in model.tasks:
            versions = tuple(replace(v, wcet=wcets.get((task.name, v.name), v.wcet)) for v in task.versions)
            found = periods.get(task.name)
            task = replace(task, versions=versions)
            tasks.append(task if found is None else replace(task, period=found.period, offset=found.offset))
        return replace(model, tasks=tuple(tasks))

    def overlay(self, source: str) -> str:
        """Return an overlay with what is learned; the rest stands in comments."""
        lines = ["halpipe-overlay: 1", f"# Learned from {' '.join(source.split())}.", "tasks:"]
        versions, periods = defaultdict(list), {each.task: each for each in self.periods}
        for each in self.versions:
            versions[each.task].append(each)
        known = [name for name in {**versions, **periods} if name in versions or periods[name].is_known]
        for name in sorted(known):
            lines += _entry(name, versions[name], periods.get(name))
        if all(line.lstrip().startswith("#") for line in lines[3:]):
            lines[2] = "tasks: {}"
        others = sorted((seen for seen in self.periods if not seen.is_known), key=lambda seen: seen.task)
        if others:
            lines.append("# Not in the schedule; uncomment the tasks that the source leaves without a period:")
        lines += [f"#  {json.dumps(o.task)}: {{period: {o.period}, offset: {o.offset}}}" for o in others]
        if self.distances:
            lines.append("# Not in the schedule, and without a period; starts were at least so far apart:")
        lines += [f"#  {json.dumps(task)}: {distance}" for task, distance in sorted(self.distances.items())]
        return "\n".join(lines) + "\n"


def _entry(name: str, versions: Sequence[LearnedVersion], period: LearnedPeriod | None) -> list[str]:
    inner = []
    if period is not None:
        vary = f"starts vary by {period.jitter}"
        if period.differs:
            inner += [f"    period: {period.period}  # {vary}; the model states {period.stated}"]
            inner += [f"    offset: {period.offset}"]
        else:
            inner.append(f"    # runs every {period.period}, from {period.offset} on; {vary}")
    raised = [each for each in versions if each.raises]
    if raised:
        inner.append("    versions:")
    for each in versions:
        stated = "no WCET" if each.stated is None else str(each.stated)
        few = "; few jobs" if each.jobs < _FEW else ""
        mark = "" if each.raises else "# "
        note = f"{counted(each.jobs, 'job')}, longest {each.longest}; the model states {stated}{few}"
        inner.append(f"      {mark}{json.dumps(each.version)}: {{wcet: {each.wcet}}}  # {note}")
    states = any(not line.lstrip().startswith("#") for line in inner)
    return [f"  {'' if states else '# '}{json.dumps(name)}:", *inner]


def learn(comparisons: Iterable[Comparison], options: LearnOptions, model: TaskModel | None = None) -> Learned:
    """Return what the recordings of some comparisons teach, beside what `model` states."""
    busy: dict[tuple[str, str], list[Instant]] = defaultdict(list)
    stated = {(t.name, v.name): v.wcet for t in model.tasks for v in t.versions} if model else {}
    periods: dict[str, LearnedPeriod] = {}
    distances: dict[str, Instant] = {}
    for comparison in comparisons:
        known, ran, seen = {row.task for row in comparison.rows}, comparison.ran, comparison.matching.executions
        start, length = ran.start, ran.length
        starts = {task: start[places].tolist() for task, places in ran.by_task().items()}
        ended = np.flatnonzero(ran.has_end)
        for number, places in groups(ran.job[ended]):
            job = comparison.matching.jobs[number][1].job
            busy[job.task, job.version] += length[ended[places]].tolist()
        for number, places in groups(np.asarray(seen.task)[comparison.others]):
            starts[seen.names[number]] = column(seen.start)[comparison.others[places]].tolist()
        for task, found in starts.items():
            cycle = None if model is None or task not in known else model.task(task).period
            if (period := _period(task, found, comparison.origin, cycle, task in known)) is not None:
                periods[task] = period
            elif task not in known and len(found) > 1:
                least = min(after - before for before, after in pairwise(sorted(found)))
                distances[task] = min(least, distances.get(task, least))
    versions = []
    for (task, version), times in sorted(busy.items()):
        times.sort()
        covered = quantile(times, options.quantile)
        wcet = with_margin(covered, options.margin)
        versions.append(
            LearnedVersion(
                task=task,
                version=version,
                jobs=len(times),
                longest=Duration(times[-1]),
                wcet=wcet,
                stated=stated.get((task, version)),
            )
        )
    irregular = {task: Duration(least) for task, least in distances.items() if task not in periods}
    return Learned(versions=tuple(versions), periods=tuple(periods.values()), distances=irregular)


def _period(
    task: str, starts: list[Instant], origin: Duration, stated: Duration | None, is_known: bool
) -> LearnedPeriod | None:
    """Return the roundest period that all starts keep within a quarter of it; None where there is none.

    A job in ten may be missing. The period of the model is preferred, since starts may vary within it. A rounder period
    may make starts vary twice as much as their mean distance does, and by a twentieth: else 30 ms would fit four starts
    each 32 ms.
    """
    if len(starts) < _LEAST_STARTS:
        return None
    at = sorted(map(Fraction, starts))
    typical = median_low([later - earlier for earlier, later in pairwise(at)])
    candidates = [] if stated is None else [stated.fraction]
    candidates += [Fraction(round(typical / 10**digits) * 10**digits) for digits in range(10, -1, -1)]
    for period in candidates:
        if not period:
            continue
        counts = [round((start - at[0]) / period) for start in at]
        spare = [start - at[0] - count * period for start, count in zip(at, counts, strict=True)]
        if len({*counts}) < len(counts) or counts[-1] + 1 > len(counts) + len(counts) / 10:
            continue
        mean = (at[-1] - at[0]) / counts[-1]
        steady = [start - count * mean for start, count in zip(at, counts, strict=True)]
        limit = min(period / 4, 2 * (max(steady) - min(steady)) + period / 20)
        if max(spare) - min(spare) <= (period / 4 if stated is not None and period == stated.fraction else limit):
            offset = (at[0] + min(spare) - origin.fraction) % period
            jitter = Duration(max(spare) - min(spare))
            return LearnedPeriod(
                task=task,
                period=Duration(period),
                offset=Duration(offset),
                jitter=jitter,
                stated=stated,
                is_known=is_known,
            )
    return None


def described(options: LearnOptions, source: str) -> str:
    """Return the source of an overlay with the rule by which it was learned."""
    share = "the longest job" if options.quantile == 1 else f"{format_rational(options.quantile * 100)} % of the jobs"
    return f"{source}; a WCET covers {share} and {format_rational(options.margin * 100)} % more"
