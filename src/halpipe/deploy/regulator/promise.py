"""Promised bandwidth of each unit and direction in each window, computed exactly from model and schedule alone.

Times are nanoseconds as ``Fraction``. A row is a pair of unit and direction; its rate at an instant is the sum of the
bounds of its access phases in force, each shared equally by the units of a gang (paper, section IV).
"""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor, lcm
from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.deploy.regulator.reading import Platform
    from halpipe.models import Access, Job, ModeSchedule, TaskModel, TransitionTable

Row = tuple[str, str]
ZERO = Fraction(0)


@record
class Phase:
    """One access of one job on one row: in force on [start, end), with this share of the resource."""

    row: Row
    start: Fraction
    end: Fraction
    share: Fraction

    def moved(self, by: Fraction) -> Phase:
        """Return the phase `by` later."""
        return Phase(self.row, self.start + by, self.end + by, self.share)


@record
class Timeline:
    """The phases of a table of `span` nanoseconds; on a circle what passes the end comes in again at 0."""

    span: Fraction
    phases: tuple[Phase, ...]
    circular: bool

    def by_row(self) -> dict[Row, list[Phase]]:
        """Return the phases of every row that has any."""
        return grouped((phase.row, phase) for phase in self.phases)


def phases_of(model: TaskModel, platform: Platform, jobs: Iterable[Job]) -> Iterator[Phase]:
    """Yield the access phases of `jobs` on the regulated resource, at the times of the jobs' own table."""
    served = {unit.name: [(i.distance.fraction, i.wcet.fraction) for i in unit.interrupts] for unit in model.units}
    for job in jobs:
        interrupts = [interrupt for unit in dict.fromkeys(job.units) for interrupt in served.get(unit, ())]
        for access in model.task(job.task).version(job.version).accesses:
            if access.resource != platform.resource:
                continue
            kind = access.kind.value if access.kind is not None else platform.unspecified
            direction = "write" if kind == "write" else "read"
            share = Fraction(access.bound) / len(job.units)
            start, end = _in_force(model, job, access, interrupts)
            for unit in job.units:
                yield Phase((unit, direction), start, end, share)


def _in_force(
    model: TaskModel, job: Job, access: Access, interrupts: list[tuple[Fraction, Fraction]]
) -> tuple[Fraction, Fraction]:
    """Return when an access phase is in force: in the part that executes it, with room for the interrupts."""
    begin, executed, lost = job.start.fraction, ZERO, ZERO
    for part in job.parts[1:]:
        if part.executed_from <= access.start:
            begin, executed = part.start.fraction, part.executed_from.fraction
            lost = model.task(job.task).version(job.version).split.resume.fraction
    first, last = (lost + edge.fraction - executed for edge in (access.start, access.end))
    return begin + first, begin + _with_interrupts(last, interrupts)


def _with_interrupts(work: Fraction, interrupts: list[tuple[Fraction, Fraction]]) -> Fraction:
    """Return the shortest time in which some work is done beside as many interrupts as can come."""
    needed = work
    while (more := work + sum((ceil(needed / apart) * time for apart, time in interrupts), ZERO)) != needed:
        needed = more
    return needed


def mode_timeline(model: TaskModel, platform: Platform, mode: ModeSchedule) -> Timeline:
    """Return the circle of a mode."""
    span = mode.hyperperiod.fraction
    phases = (phase.moved(-(phase.start // span) * span) for phase in phases_of(model, platform, mode.jobs))
    return Timeline(span, tuple(phases), circular=True)


def transition_timeline(
    model: TaskModel,
    platform: Platform,
    source: ModeSchedule,
    table: TransitionTable,
    target: ModeSchedule,
    least: int = 0,
) -> tuple[Timeline, int]:
    """Return the line of a switch, and how many cycles of the new mode it covers.

    0 is the end of the old mode's last hyperperiod. Jobs of the old mode run to their end; from `length` on the new
    mode's jobs are started, and what would be wrapped into its first cycle was never started. The table continues until
    the new mode's own table has at least what the line has, on every row at every instant; for `least` cycles anyway.
    """
    length, period = table.length.fraction, target.hyperperiod.fraction
    leaving = list(_before(phases_of(model, platform, source.jobs), source.hyperperiod.fraction, ZERO))
    early = [*leaving, *phases_of(model, platform, table.jobs)]
    entering = list(phases_of(model, platform, target.jobs))
    absent = [phase.moved(length) for phase in _before(entering, period, ZERO)]
    cycles = max(least, ceil((_last_excess(early, absent, length) - length) / period))
    later = [p.moved(length + n * period) for n in range(cycles) for p in entering]
    span = length + cycles * period
    return Timeline(span, tuple(p for p in (*early, *later) if p.start < span), circular=False), cycles


def _before(phases: Iterable[Phase], period: Fraction, instant: Fraction) -> Iterator[Phase]:
    """Yield the phases of jobs of earlier cycles that are still in force after `instant`, whole."""
    for phase in phases:
        earlier = phase.moved(-period)
        while earlier.end > instant:
            yield earlier
            earlier = earlier.moved(-period)


def _last_excess(more: Iterable[Phase], less: Iterable[Phase], origin: Fraction) -> Fraction:
    """Return the end of the last interval after `origin` in which a row has a higher rate in `more` than in `less`."""
    steps: dict[Row, dict[Fraction, Fraction]] = {}
    for phases, sign in ((more, 1), (less, -1)):
        for phase in phases:
            if phase.end > origin:
                row = steps.setdefault(phase.row, {})
                for instant, change in ((max(phase.start, origin), phase.share), (phase.end, -phase.share)):
                    row[instant] = row.get(instant, ZERO) + sign * change
    last = origin
    for row in steps.values():
        rate, instants = ZERO, sorted(row)
        for begin, end in pairwise(instants):
            rate += row[begin]
            if rate > 0:
                last = max(last, end)
    return last


# ------------------------------------------------------------------------------------------------ windows


def windows_of(timeline: Timeline, platform: Platform) -> Fraction:
    """Return the number of windows of a table; a fraction where they do not fit."""
    return timeline.span / platform.window_ns


def whole_bursts(timeline: Timeline, platform: Platform, phases: Iterable[Phase], windows: int) -> list[int]:
    """Return the bursts of every window of a row when the promise of each window is rounded up to whole bursts."""
    volumes, scale = promised_bursts(timeline, platform, phases, windows)
    return [-(-(after - before) // scale) for before, after in pairwise(volumes)]


def promised_bursts(
    timeline: Timeline, platform: Platform, phases: Iterable[Phase], windows: int
) -> tuple[list[int], int]:
    """Return the volume promised to a row up to the end of every window, as integers over one common denominator.

    Numerator by numerator: ``volume[k] / denominator`` bursts are promised in [0, k windows).
    """
    width = platform.window_ns
    per_window = platform.promise_bytes / platform.burst_bytes
    steps: dict[int, Fraction] = defaultdict(Fraction)  # change of the volume of a whole window
    parts: dict[int, Fraction] = defaultdict(Fraction)  # volume beside that, in windows that a phase touches in part
    for begin, end, share in _inside(timeline, phases):
        volume = share * per_window
        first, last = begin / width, end / width
        whole_from, whole_to = ceil(first), floor(last)
        if whole_from > whole_to:  # inside one window
            parts[whole_to] += (last - first) * volume
            continue
        parts[whole_from - 1] += (whole_from - first) * volume
        parts[whole_to] += (last - whole_to) * volume
        steps[whole_from] += volume
        steps[whole_to] -= volume
    scale = lcm(*(value.denominator for value in (*steps.values(), *parts.values())))
    level, total, volumes = 0, 0, [0]
    for window in range(windows):
        if window in steps:
            level += int(steps[window] * scale)
        total += level + (int(parts[window] * scale) if window in parts else 0)
        volumes.append(total)
    return volumes, scale


def _inside(timeline: Timeline, phases: Iterable[Phase]) -> Iterator[tuple[Fraction, Fraction, Fraction]]:
    """Yield the parts of phases as they lie in [0, span)."""
    span = timeline.span
    for phase in phases:
        if not timeline.circular:
            begin, end = max(phase.start, ZERO), min(phase.end, span)
            if begin < end:
                yield begin, end, phase.share
            continue
        begin = phase.start
        while begin < phase.end:
            turn = floor(begin / span) * span
            end = min(phase.end, turn + span)
            yield begin - turn, end - turn, phase.share
            begin = end


def rate_steps(timeline: Timeline, phases: Iterable[Phase]) -> list[tuple[Fraction, Fraction]]:
    """Return the rate of a row as (instant, rate from there on), as shares of the resource; from 0 on."""
    changes: dict[Fraction, Fraction] = {ZERO: ZERO}
    for begin, end, share in _inside(timeline, phases):
        changes[begin] = changes.get(begin, ZERO) + share
        changes[end] = changes.get(end, ZERO) - share
    rate, found = ZERO, []
    for instant in sorted(changes):
        rate += changes[instant]
        if instant < timeline.span:
            found.append((instant, rate))
    return found
