"""Worst case of a cause-effect chain: the jobs that the stimulus or the data passes through (MODEL 3).

The paths are found here on their own, not taken from the search; a test holds their lengths to the latencies that the
schedule states and verify has checked.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.common.palette import tone
from halpipe.exporters.common.timeline import Window
from halpipe.exporters.report.axis import decimal, elide, position, ticks
from halpipe.models import Anchor, Chain, ChainLatency, Job, ModeSchedule, Task, TaskModel
from halpipe.models.attributes import kept

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


ROW_HEIGHT = 24
AXIS_HEIGHT = 26


@record
class Hop:
    """A job on the way, on the line of the mode: its run, its reading and writing, and its events (MODEL 10.7)."""

    task: str
    start: Duration
    end: Duration
    read: Duration
    write: Duration
    begin: Duration
    finish: Duration

    def later(self, by: Duration) -> Hop:
        """Return the same job some cycles later."""
        times = (self.start, self.end, self.read, self.write, self.begin, self.finish)
        return Hop(self.task, *(time + by for time in times))


class _Ring:
    """The jobs of one task on the circle of the hyperperiod; numbers count them along the line, from 0 on."""

    def __init__(self, hops: list[Hop], hyperperiod: Duration) -> None:
        self.hyperperiod = hyperperiod
        self.hops = sorted(hops, key=lambda hop: hop.read.ns)
        self.reads = [hop.read.ns for hop in self.hops]
        # of jobs that write together, the one that read later is the newer
        order = sorted(((hop.write % hyperperiod).ns, hop.read.ns - hop.write.ns, n) for n, hop in enumerate(self.hops))
        self.writes = [(instant, number) for instant, _, number in order]

    def hop(self, number: int) -> Hop:
        cycle, place = divmod(number, len(self.hops))
        return self.hops[place].later(self.hyperperiod * cycle)

    def next(self, at: Duration) -> Hop:
        """Return the first job that reads at `at` or after."""
        cycle, phase = at // self.hyperperiod, at % self.hyperperiod
        return self.hop(cycle * len(self.hops) + bisect_left(self.reads, phase.ns))

    def latest(self, at: Duration) -> Hop:
        """Return the latest job that wrote at `at` or before."""
        rank = bisect_right(self.writes, ((at % self.hyperperiod).ns, len(self.hops))) - 1
        place = self.writes[rank % len(self.writes)][1]
        cycle = at // self.hyperperiod + rank // len(self.writes) - self.hops[place].write // self.hyperperiod
        return self.hop(cycle * len(self.hops) + place)


def worst_reaction(model: TaskModel, chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the stimulus that waits longest: it just misses the first hop, whose job is shown, too.

    Empty where some task of the chain has no job in the mode, or a release that the model does not state.
    """
    return _worst_forward(_rings(model, chain, table), lambda ring, n: [ring.hop(n), ring.hop(n + 1)])


def worst_latency(model: TaskModel, chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the data of a job of the first task that takes longest to the last; empty as above."""
    return _worst_forward(_rings(model, chain, table), lambda ring, n: [ring.hop(n)])


def latency_of(model: TaskModel, chain: Chain, table: ModeSchedule, stated: ChainLatency) -> Duration | None:
    """Return the worst latency: as the schedule states it where the model refers to it, else by the jobs."""
    if stated.latency is not None or stated.reaction is None:
        return stated.latency
    way = worst_latency(model, chain, table)
    return way[-1].finish - way[0].begin if way else None


def worst_age(model: TaskModel, chain: Chain, table: ModeSchedule) -> list[Hop]:
    """Return the way of the data that is oldest when the last job ends; empty as above."""
    rings = _rings(model, chain, table)
    ways = []
    for number in range(len(rings[-1].hops) if rings else 0):
        way = [rings[-1].hop(number)]
        for ring in reversed(rings[:-1]):
            way.append(ring.latest(way[-1].read))
        ways.append(way[::-1])
    return _worst(ways)


def _worst_forward(rings: list[_Ring], begin: Callable[[_Ring, int], list[Hop]]) -> list[Hop]:
    ways = [begin(rings[0], number) for number in range(len(rings[0].hops) if rings else 0)]
    for way in ways:
        for ring in rings[1:]:
            way.append(ring.next(way[-1].write))
    return _worst(ways)


def _worst(ways: Iterable[list[Hop]]) -> list[Hop]:
    return max(ways, key=lambda way: way[-1].finish.ns - way[0].begin.ns, default=[])


def _rings(model: TaskModel, chain: Chain, table: ModeSchedule) -> list[_Ring]:
    found = []
    for name in chain.tasks:
        jobs = table.by_task().get(name, ())
        hops = [_hop(chain, model.task(name), job, table.hyperperiod) for job in jobs]
        known = [hop for hop in hops if hop is not None]
        if not known or len(known) < len(hops):
            return []
        found.append(_Ring(known, table.hyperperiod))
    return found


def _hop(chain: Chain, task: Task, job: Job, hyperperiod: Duration) -> Hop | None:
    """Return the passage of data through a job; None where it counts from a release that the model does not state."""
    start, release = job.start, None
    if task.let is not None or (chain.anchor is Anchor.RELEASE and task.name == chain.tasks[0]):
        if task.period is None or task.offset is None:
            return None
        release = task.offset % task.period + task.period * job.index
        start = job.start if job.start >= release else job.start + hyperperiod  # over the edge
    end = start + (job.end - job.start)
    read, write = start, end
    if task.let is not None and release is not None:
        read, write = release, release + task.let
    instants = {None: read, Anchor.START: start, Anchor.END: end, Anchor.RELEASE: start if release is None else release}
    finish = {None: write, Anchor.START: start, Anchor.END: end}
    return Hop(task.name, start, end, read, write, instants[chain.anchor], finish[chain.to])


def _tones(tasks: tuple[Task, ...]) -> dict[str, int]:
    return {task.name: tone(number) for number, task in enumerate(tasks)}


def path_chart(
    model: TaskModel, id: str, title: str, way: list[Hop], limit: Duration | None, *, missed: bool
) -> dict[str, Any]:
    """Return the picture of a way, from its begin; with `missed`, its first job is the one that came too early."""
    begin, finish, shown = way[0].begin, way[-1].finish, way[1:] if missed else way
    zero = min((begin, *(time for hop in shown for time in (hop.read, hop.start))), key=lambda time: time.ns)
    ends = [finish, *(time for hop in shown for time in (hop.write, hop.end)), *([begin + limit] if limit else [])]
    window = Window(ZERO, max(ends, key=lambda time: time.ns) - zero)
    tones = kept(model.tasks, _tones)
    ready, bars = begin, []
    for number, hop in enumerate(shown):
        place = {"tone": tones[hop.task], "y": AXIS_HEIGHT + ROW_HEIGHT * number}
        bars.append(place | _bar(hop, ready, zero, window))
        ready = hop.write
    return {
        "id": id,
        "title": title,
        "bars": bars,
        "ticks": ticks(window),
        "height": AXIS_HEIGHT + ROW_HEIGHT * len(bars) + 4,
        "limit": "" if limit is None else decimal(_place(begin + limit - zero, window), 4),
    }


def _bar(hop: Hop, ready: Duration, zero: Duration, window: Window) -> dict[str, str]:
    """Return a hop as it is drawn, with the wait before it; places are per cent of the time shown."""
    begin = min(ready, hop.read)
    instants = (hop.start, hop.end, begin, hop.read, hop.write)
    low, high, wait, read, write = (_place(at - zero, window) for at in instants)
    title = f"{hop.task}: waits {hop.read - begin}, starts at {hop.start - zero}, runs {hop.end - hop.start}"
    let = (hop.read, hop.write) != (hop.start, hop.end)
    title += f", reads at {hop.read - zero} and writes at {hop.write - zero}" if let else ""
    places = {"x": low, "width": high - low, "wait_x": wait, "wait_width": read - wait}
    places |= {"let_x": read, "let_width": write - read if let else Fraction(0)}
    drawn = {name: decimal(place, 4) for name, place in places.items()}
    return {"task": elide(hop.task, 24), "title": title} | drawn


def _place(at: Duration, window: Window) -> Fraction:
    return position(at.ns, window.length.ns)
