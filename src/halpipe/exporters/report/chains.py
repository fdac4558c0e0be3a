"""Worst case of a cause-effect chain: the jobs that the stimulus or the data passes through (MODEL 3).

The paths are found here on their own, not taken from the search; a test holds their lengths to the latencies that the
schedule states and verify has checked.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.exporters.common.palette import tone
from halpipe.exporters.common.timeline import Window
from halpipe.exporters.report.axis import Tick, ticks
from halpipe.exporters.report.numbers import decimal, position

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, ChainLatency, Job, ModeSchedule, TaskModel

ROW_HEIGHT = 24
AXIS_HEIGHT = 26


@record
class Hop:
    """A job on the way: of which task, from when to when on the line of the mode."""

    task: str
    start: Duration
    end: Duration


@record
class HopBar:
    """A hop as it is drawn, with the wait before it; places are per cent of the time shown."""

    task: str
    tone: int
    y: int
    x: str
    width: str
    wait_x: str
    wait_width: str
    title: str


@record
class PathChart:
    """The way of a stimulus, or of data, through a chain: a row for each job."""

    id: str
    title: str
    bars: tuple[HopBar, ...]
    ticks: tuple[Tick, ...]
    height: int
    limit: str


class _Ring:
    """The jobs of one task on the circle of the hyperperiod; numbers count them along the line, from 0 on."""

    def __init__(self, jobs: list[Job], hyperperiod: Duration) -> None:
        self.hyperperiod = hyperperiod
        self.jobs = sorted(jobs, key=lambda job: job.start.ns)
        self.starts = [job.start.ns for job in self.jobs]
        self.ends = sorted(((job.end % hyperperiod).ns, place) for place, job in enumerate(self.jobs))

    def hop(self, number: int) -> Hop:
        cycle, place = divmod(number, len(self.jobs))
        job, shift = self.jobs[place], self.hyperperiod * cycle
        return Hop(job.task, job.start + shift, job.end + shift)

    def next(self, at: Duration) -> Hop:
        """Return the first job that starts at `at` or after."""
        cycle, phase = at // self.hyperperiod, at % self.hyperperiod
        return self.hop(cycle * len(self.jobs) + bisect_left(self.starts, phase.ns))

    def latest(self, at: Duration) -> Hop:
        """Return the latest job that ended at `at` or before."""
        phase = at % self.hyperperiod
        rank = bisect_right(self.ends, (phase.ns, len(self.jobs))) - 1
        place = self.ends[rank % len(self.ends)][1]
        cycle = at // self.hyperperiod + rank // len(self.ends) - self.jobs[place].end // self.hyperperiod
        return self.hop(cycle * len(self.jobs) + place)


def worst_reaction(chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the stimulus that waits longest: it just misses the first hop, whose job is shown, too.

    Empty where some task of the chain has no job in the mode.
    """
    rings = _rings(chain, table)
    ways = []
    for number in range(len(rings[0].jobs) if rings else 0):
        way = [rings[0].hop(number), rings[0].hop(number + 1)]
        for ring in rings[1:]:
            way.append(ring.next(way[-1].end))
        ways.append(way)
    return max(ways, key=_length, default=[])


def worst_latency(chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the data of a job of the first task that takes longest to the last; empty as above."""
    rings = _rings(chain, table)
    ways = []
    for number in range(len(rings[0].jobs) if rings else 0):
        way = [rings[0].hop(number)]
        for ring in rings[1:]:
            way.append(ring.next(way[-1].end))
        ways.append(way)
    return max(ways, key=_length, default=[])


def latency_of(chain: Chain, table: ModeSchedule, stated: ChainLatency) -> Duration | None:
    """Return the worst latency: as the schedule states it where the model refers to it, else by the jobs."""
    if stated.latency is not None or stated.reaction is None:
        return stated.latency
    way = worst_latency(chain, table)
    return way[-1].end - way[0].start if way else None


def worst_age(chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the data that is oldest when the last job ends; empty where some task has no job."""
    rings = _rings(chain, table)
    ways = []
    for number in range(len(rings[-1].jobs) if rings else 0):
        way = [rings[-1].hop(number)]
        for ring in reversed(rings[:-1]):
            way.append(ring.latest(way[-1].start))
        ways.append(way[::-1])
    return max(ways, key=_length, default=[])


def _rings(chain: Chain, table: ModeSchedule) -> list[_Ring]:
    found = [[job for job in table.jobs if job.task == name] for name in chain.tasks]
    return [_Ring(jobs, table.hyperperiod) for jobs in found] if all(found) else []


def _length(way: list[Hop]) -> int | Fraction:
    return (way[-1].end - way[0].start).ns


def path_chart(
    model: TaskModel, id: str, title: str, way: list[Hop], limit: Duration | None, *, missed: bool
) -> PathChart:
    """Return the picture of a way, from its beginning; with `missed`, its first job is the one that came too early."""
    zero, last = way[0].start, way[-1].end
    length = max(last - zero, limit or ZERO)
    window = Window(ZERO, length)
    tones = {task.name: tone(number) for number, task in enumerate(model.tasks)}
    ready, bars = ZERO, []
    for number, hop in enumerate(way[1:] if missed else way):
        start, end = hop.start - zero, hop.end - zero
        bars.append(_bar(hop.task, start, end, ready, window, tones[hop.task], AXIS_HEIGHT + ROW_HEIGHT * number))
        ready = end
    height = AXIS_HEIGHT + ROW_HEIGHT * len(bars) + 4
    shown = "" if limit is None else decimal(_place(limit, window), 4)
    return PathChart(id, title, tuple(bars), tuple(ticks(window, fine=False)), height, shown)


def _bar(task: str, start: Duration, end: Duration, ready: Duration, window: Window, colour: int, y: int) -> HopBar:
    low, high, wait = (_place(at, window) for at in (start, end, ready))
    title = f"{task}: waits {start - ready}, starts at {start}, runs {end - start}"
    return HopBar(
        task, colour, y, decimal(low, 4), decimal(high - low, 4), decimal(wait, 4), decimal(low - wait, 4), title
    )


def _place(at: Duration, window: Window) -> Fraction:
    return position(at.ns, window.length.ns)
