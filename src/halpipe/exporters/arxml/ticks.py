"""Instants in ticks of a counter, and the hold points of OsTasks; nothing is rounded.

Hold points are the preemption points in use, and the begin of each access phase (MODEL 8.2, run time). An OsTask waits
there for an event, which the schedule table sets: where the job has a gap, when its next part begins; at an access
phase, when the phase begins; otherwise when the job starts, so that it does not wait at all. Where an access phase
begins after a gap, and to go on may take time, it waits twice: to go on it may need less than that time. A model that
splits no job and serves no interrupts holds none."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about
from halpipe.core.durations import (
    ZERO,
    Duration,
    greatest_common_divisor,
    least_common_multiple,
    milliseconds,
    seconds,
)
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.exporters.arxml.codes import BAD_COUNTER, NOT_ON_TICK
from halpipe.exporters.arxml.document import seconds_text
from halpipe.exporters.common.timeline import PhaseTimes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.arxml.options import ArxmlOptions
    from halpipe.models import Job, Part, Schedule, TaskModel, Version


@record
class Hold:
    """A position in the execution of a version, at which the OsTask waits.

    With `is_second` it has gone on after a gap, and waits for its access phase.
    """

    version: str
    position: Duration
    is_second: bool = False


class Holds:
    """All positions at which the jobs of a schedule are held, and until when."""

    def __init__(self, model: TaskModel, schedule: Schedule) -> None:
        self._times = PhaseTimes(model)
        jobs = schedule.all_jobs()
        self._by_task: dict[str, dict[Hold, None]] = defaultdict(dict)
        splits = any(version.split.is_allowed for version in self._times.versions.values())
        if splits or any(unit.interrupts for unit in model.units):
            for job in jobs:
                for hold in self._positions(job):
                    self._by_task[job.task].setdefault(hold)
        self._has_gap = {(job.task, job.version) for job in jobs if job.parts}

    def of(self, task: str, versions: tuple[str, ...]) -> list[Hold]:
        """Return where the jobs of a task in some versions are held, in order."""
        found = [hold for hold in self._by_task.get(task, ()) if hold.version in versions]
        return sorted(found, key=lambda h: (versions.index(h.version), h.position.ns, h.is_second))

    def is_preempted(self, task: str, versions: tuple[str, ...]) -> bool:
        """Return whether jobs of a task are interrupted anywhere, so that only priorities can do it."""
        kept = ((task, version) for version in versions if self._times.versions[task, version].split.anywhere)
        return any(key in self._has_gap for key in kept)

    def instants(self, job: Job) -> list[tuple[Hold, Duration]]:
        """Return until when a job is held at each position of its version, on the time of its table."""
        if not self._by_task.get(job.task):
            return []
        version = self._times.versions[job.task, job.version]
        phases = {access.start: job.start + begin for access, begin, _ in self._times.of(job)}
        gaps = {part.executed_from: part.start for part in _gaps(version, job)}
        first, second = phases | gaps, phases
        return [
            (hold, (second if hold.is_second else first).get(hold.position, job.start))
            for hold in self.of(job.task, (job.version,))
        ]

    def _positions(self, job: Job) -> list[Hold]:
        version = self._times.versions[job.task, job.version]
        found = [access.start for access in version.accesses if access.start > ZERO]
        gaps = [part.executed_from for part in _gaps(version, job)]
        twice = set(found) & set(gaps) if version.split.resume > ZERO else set()
        holds = [Hold(job.version, position) for position in (*found, *gaps)]
        return holds + [Hold(job.version, position, is_second=True) for position in sorted(twice)]


def _gaps(version: Version, job: Job) -> list[Part]:
    """Return the parts before which a job waits: where others interrupt it, only those that begin an access phase."""
    begins = {access.start for access in version.accesses}
    return [part for part in job.parts[1:] if not version.split.anywhere or part.executed_from in begins]


_LONGEST = seconds(1)
_LEAD = milliseconds(10)
_DEFAULT = Duration(10**6)
_TRIED = 1000


@record
class Counter:
    """The counter of every core: its tick, OsCounterMinCycle, OsCounterMaxAllowedValue."""

    tick: Duration
    min_cycle: int
    max_value: int

    def ticks(self, time: Duration) -> int:
        """Return a time that is a multiple of the tick, in ticks."""
        count = time / self.tick
        assert count.denominator == 1
        return count.numerator


def begin_of(counters: Sequence[Counter]) -> Duration:
    """Return the instant at which tables on some counters begin together: whole ticks of each, after its minimal cycle.

    Never 0, which some OS takes as now, and others as after all values of the counter. That is what becomes of a value
    that the counter has passed when its OS starts the tables, so leave it 10 ms if they are in its range.
    """
    step = least_common_multiple(counter.tick for counter in counters)
    least = max(-(-(counter.tick * counter.min_cycle) // step) for counter in counters)
    most = min((counter.tick * counter.max_value) // step for counter in counters)
    return step * max(least, min(-(-_LEAD // step), most))


def choose_counter(schedule: Schedule, options: ArxmlOptions, holds: Holds) -> Counter:
    """Return the counter for all instants of a schedule; raise `HalpipeError` with all that does not fit a given one.

    Without a given tick it is the largest of which all instants are multiples, and at most a second.
    """
    _check(options)
    found = list(_instants(schedule, holds))
    largest = greatest_common_divisor(time for _, _, time in found) or _DEFAULT
    if largest > _LONGEST:
        largest = greatest_common_divisor([largest, _LONGEST])
    if options.tick is not None:
        _check_tick(options.tick, largest, found)
    tick = largest if options.tick is None else options.tick
    return Counter(tick, options.min_cycle, options.max_value)


def _check(options: ArxmlOptions) -> None:
    findings = Findings()
    tick = options.tick
    if tick is not None and not ZERO < tick <= _LONGEST:
        help = "choose a tick above 0 and up to 1s, such as 1us"
        findings.report(BAD_COUNTER, f"a tick of {tick} is impossible", help=help)
    if options.max_value >= 2**64:
        help = "take the value of the counter of your target, 1073741823 for most"
        findings.report(BAD_COUNTER, f"the maximal value {options.max_value} needs more than 64 bits", help=help)
    if options.max_points is not None and options.max_points < 1:
        help = "take the limit of your target, or none"
        findings.report(BAD_COUNTER, f"{options.max_points} expiry points are no table", help=help)
    if not 1 <= options.min_cycle <= options.max_value:
        message = f"the minimal cycle {options.min_cycle} is not from 1 to the maximal value {options.max_value}"
        help = "take the values of the counter of your target, 1 and 1073741823 for most"
        findings.report(BAD_COUNTER, message, help=help)
    findings.stop_on_errors()


def _instants(schedule: Schedule, holds: Holds) -> Iterator[tuple[str, str, Duration]]:
    """Yield (table, what, time) for everything that must be a whole number of ticks."""
    for mode in schedule.modes:
        path = about(mode=mode.name)
        yield path, "the hyperperiod", mode.hyperperiod
        yield from _starts(path, mode.jobs, holds)
    for table in schedule.transitions:
        path = about(transition_from=(table.source, table.target))
        yield path, "the length", table.length
        yield from _starts(path, table.jobs, holds)


def _starts(path: str, jobs: tuple[Job, ...], holds: Holds) -> Iterator[tuple[str, str, Duration]]:
    for job in jobs:
        yield path, f'the start of job {job.index} of task "{job.task}"', job.start
        for hold, until in holds.instants(job):
            yield path, f'where job {job.index} of task "{job.task}" resumes at {hold.position}', until


def _check_tick(tick: Duration, largest: Duration, found: list[tuple[str, str, Duration]]) -> None:
    off: dict[str, list[str]] = {}
    for path, what, time in found:
        if time % tick:
            below = tick * (time // tick)
            text = f"{what}, {time}, is between {below} and {below + tick}"
            off.setdefault(path, []).append(text)
    help = f"the nearest tick that fits is {_nearest(tick, largest)}; or schedule again with --tick {tick}"
    findings = Findings()
    for path, texts in off.items():
        shown = few(texts, 3, quote="", between="; ")
        findings.report(NOT_ON_TICK, f"{shown}: no multiple of the tick {tick}", path=path, help=help)
    findings.stop_on_errors()


def _nearest(tick: Duration, largest: Duration) -> Duration:
    """Return the longest tick up to `tick` that divides `largest`, of those that are decimals if there are any."""
    least = math.ceil(largest / tick)
    near = (largest / parts for parts in range(least, min(2 * least, least + _TRIED)))
    found = next(filter(_is_decimal, near), None)
    if found is None and _is_decimal(largest):
        found = largest / (1 << (least - 1).bit_length())
    return found or largest / least


def _is_decimal(time: Duration) -> bool:
    return seconds_text(time)[1]
