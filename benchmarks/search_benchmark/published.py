"""Readers of sets that others have published, and a plain first fit for them.

* PSCP and CC_Scheduling_WithJitter (CTU in Prague, GPL-3 data): rows `name = [...];`. Tasks on cores are strictly
  periodic or have a jitter that is a part of the period, messages of PSCP have that of their period. Data pass from
  job to job along edges, and are at their end within two periods of the start of the first job.
* tsnkit: streams and links as CSV. A frame takes each link of its way for its transmission time, without waiting.

What is ours (D): runnables of CC_Scheduling_WithJitter go to the core with the least load, the heaviest first. The
paper balances loads by an integer program. The two periods of a chain count from its start. In that paper they count
from the release of its first job, which is stricter.
"""

from __future__ import annotations

import csv
import json
import math
import re
from ast import literal_eval
from bisect import bisect_right, insort
from collections import deque
from dataclasses import replace
from fractions import Fraction
from graphlib import TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models import Anchor, Chain, Edge, Mode, Precedence, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

PUBLISHED: Mapping[str, str] = {
    "pscp": "all instances, since only those that the authors solved are published",
    "cc": "SMT at T/2, T/5, T/10, 0: set 1 89, 75, 69, 61 %; set 2 95, 81, 74, 67 %; 3-LS, set 5 at T/5: 89.1 %",
    "ems": "3-LS, 43 min (10 614 activities, 104 721 jobs)",
    "tsn": "its own list scheduler, on the machine of our run: 0.07, 0.71, 3.06 s for 20, 60, 120 streams",
}


@record
class Activity:
    """One task or message: times in units of the system's tick, and the activities before it in the same chain.

    With `lag`, it starts exactly so long after the end of the one before it.
    """

    unit: str
    period: int
    wcet: int
    jitter: Fraction
    before: tuple[int, ...] = ()
    lag: int | None = None


@record
class System:
    """Activities, the length of a tick in nanoseconds, and the limit of chains in periods, if any."""

    activities: tuple[Activity, ...]
    tick: int
    limit: int | None = 2
    is_closed: bool = False

    def chains(self) -> Iterator[list[int]]:
        """Yield paths from a first to a last activity, so that each such pair and each edge is on one."""
        after: list[list[int]] = [[] for _ in self.activities]
        for number, activity in enumerate(self.activities):
            for other in activity.before:
                after[other].append(number)
        covered: set[tuple[tuple[int, int], bool]] = set()
        for first, activity in enumerate(self.activities):
            if activity.before or not after[first]:
                continue
            for path in _paths(first, after):
                joined = {*((edge, True) for edge in pairwise(path)), ((path[0], path[-1]), False)}
                if not joined <= covered:
                    covered |= joined
                    yield path

    def model(self) -> TaskModel:
        """Return the system as a task model of one mode."""
        names = [f"t{number}" for number in range(len(self.activities))]
        tasks = []
        for name, each in zip(names, self.activities, strict=True):
            wait = each.lag is not None and [
                Precedence(task=names[other], min=self._time(each.lag), max=self._time(each.lag), anchor=Anchor.END)
                for other in each.before
            ]
            version = Version(name="v", wcet=self._time(each.wcet), units=(each.unit,), precedences=tuple(wait or ()))
            tasks.append(Task(name=name, period=self._time(each.period), slack=each.jitter, versions=(version,)))
        limit = self.limit
        chains = (
            ()
            if limit is None
            else tuple(
                Chain(
                    name=f"c{number}",
                    tasks=tuple(names[place] for place in path),
                    max_latency=self._time(limit * self.activities[path[0]].period),
                )
                for number, path in enumerate(self.chains())
            )
        )
        units = dict.fromkeys(each.unit for each in self.activities)
        edge = Edge.CLOSED if self.is_closed else Edge.OPEN
        mode = Mode(name="all", edge=edge, runs=tuple(Run(task=name, versions=("v",)) for name in names))
        return TaskModel(
            name="published",
            units=tuple(Unit(name=name) for name in units),
            tasks=tuple(tasks),
            chains=chains,
            modes=(mode,),
        )

    def _time(self, ticks: int) -> Duration:
        return Duration(ticks * self.tick)


def _paths(first: int, after: Sequence[Sequence[int]]) -> Iterator[list[int]]:
    """Yield all paths from an activity to one without successors."""
    waiting = [[first]]
    while waiting:
        path = waiting.pop()
        if not after[path[-1]]:
            yield path
        waiting += [[*path, other] for other in after[path[-1]]]


# ------------------------------------------------------------------------------------------------ readers


def _values(text: str) -> dict[str, Any]:
    return {name: json.loads(value) for name, value in re.findall(r"(\w+)\s*=\s*(\d+|\[.*?\])\s*(?:;|\n)", text)}


def control(text: str) -> System:
    """Read an instance of PSCP: microseconds, activities on the last units are messages with a free jitter."""
    data = _values(text)
    links = data["nRes"] - data["nNetworks"]
    rows = zip(
        data["assignmentToResources"],
        data["periods"],
        data["processingTimes"],
        data["precedenceAdjList"],
        strict=True,
    )
    activities = (
        Activity(f"u{unit}", period, wcet, Fraction(unit > links), tuple(before)) for unit, period, wcet, before in rows
    )
    return System(tuple(activities), 1000)


def co_scheduled(text: str, cores: int, part: int) -> System:
    """Read an instance of CC_Scheduling_WithJitter: jitters are a `part` of the period, none for 0.

    A label that passes from one core to another is a message on the link of the receiving core.
    """
    data = _values(text)
    jitter = Fraction(1, part) if part else Fraction(0)
    periods, wcets = data["periods"], data["processingTimesRunnables"]
    home = _balanced([Fraction(wcet, period) for wcet, period in zip(wcets, periods, strict=True)], cores)
    before: list[list[int]] = [[] for _ in periods]
    messages: list[Activity] = []
    sent: set[tuple[int, int, int]] = set()
    for (sender, *labels, receiver), wcet in zip(
        data["senderLabelReceiverOrderCriticalChains"], data["communicationTimeForOrderCriticalMessages"], strict=True
    ):
        one, other = sender - 1, receiver - 1
        fresh = {(home[one], home[other], label) for label in labels if label} - sent
        if home[one] == home[other] or not fresh:
            before[other].append(one)
            continue
        sent |= fresh
        before[other].append(len(periods) + len(messages))
        messages.append(Activity(f"link{home[other]}", periods[one], wcet, jitter, (one,)))
    places = [0] * len(periods)
    for sender, label, receiver in data["senderLabelReceiverNonOrderCriticalChains"]:
        one, other = sender - 1, receiver - 1
        wcet = data["processingTimesOfMessages"][one][places[one]]
        places[one] += 1
        key = (home[one], home[other], label)
        if home[one] != home[other] and key not in sent:
            sent.add(key)
            messages.append(Activity(f"link{home[other]}", periods[one], wcet, jitter))
    runnables = [
        Activity(f"core{home[n]}", period, wcet, jitter, tuple(dict.fromkeys(before[n])))
        for n, (period, wcet) in enumerate(zip(periods, wcets, strict=True))
    ]
    return System((*runnables, *messages), 1000)


def _balanced(loads: Sequence[Fraction], cores: int) -> list[int]:
    """Return a core for each load: the one with the least so far, the heaviest load first."""
    whole, home = [Fraction(0)] * cores, [0] * len(loads)
    for number in sorted(range(len(loads)), key=lambda number: -loads[number]):
        home[number] = whole.index(min(whole))
        whole[home[number]] += loads[number]
    return home


def scaled(system: System, percent: int) -> System:
    """Return the system with so much load on each of its units: all times on a unit grow alike, rounded down."""
    loads: dict[str, Fraction] = {}
    for each in system.activities:
        loads[each.unit] = loads.get(each.unit, Fraction(0)) + Fraction(each.wcet, each.period)
    activities = (
        replace(each, wcet=max(1, int(each.wcet * Fraction(percent, 100) / loads[each.unit])))
        for each in system.activities
    )
    return replace(system, activities=tuple(activities))


def streams(topology: str, table: str) -> System:
    """Read links and streams of tsnkit: nanoseconds, rates in Gbit/s; each stream takes the shortest way."""
    links = {literal_eval(row["link"]): row for row in csv.DictReader(topology.splitlines())}
    activities: list[Activity] = []
    for row in csv.DictReader(table.splitlines()):
        for target in literal_eval(row["dst"]):
            before: tuple[int, ...] = ()
            lag = 0
            for link in _way(int(row["src"]), target, list(links)):
                wcet = int(row["size"]) * 8 // int(links[link]["rate"])
                unit = f"l{link[0]}_{link[1]}"
                wait = lag if before else None
                activities.append(Activity(unit, int(row["period"]), wcet, Fraction(0), before, wait))
                before, lag = (len(activities) - 1,), int(links[link]["t_proc"]) + int(links[link]["t_prop"])
    return System(tuple(activities), 1, limit=None, is_closed=True)


def _way(source: int, target: int, links: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the links of a shortest way."""
    came: dict[int, tuple[int, int]] = {}
    open_nodes = deque([source])
    while target not in came:
        node = open_nodes.popleft()
        for link in links:
            if link[0] == node and link[1] not in came and link[1] != source:
                came[link[1]] = link
                open_nodes.append(link[1])
    way = [came[target]]
    while way[0][0] != source:
        way.insert(0, came[way[0][0]])
    return way


# ------------------------------------------------------------------------------------------------ first fit


def first_fit(system: System) -> list[int] | None:
    """Return a start for the first job of every activity; None if one of them finds no room.

    Periods that divide others come first, of these the longest, and tasks of chains after their predecessors; what
    does not wait is placed with the first of its chain. All jobs are strictly periodic, although jitter may be allowed.
    Nothing is placed twice.
    """
    starts: dict[int, int] = {}
    begins: list[int] = [0] * len(system.activities)
    busy: dict[str, list[tuple[int, int]]] = {each.unit: [] for each in system.activities}
    whole = math.lcm(*(each.period for each in system.activities))
    follower = {each.before[0]: n for n, each in enumerate(system.activities) if each.lag is not None and each.before}
    for number in _order(system):
        if number in starts:
            continue
        first = system.activities[number]
        row, offset = [(number, 0)], 0
        while row[-1][0] in follower:
            here, following = system.activities[row[-1][0]], follower[row[-1][0]]
            offset += here.wcet + (system.activities[following].lag or 0)
            row.append((following, offset))
        earliest = max((starts[b] + system.activities[b].wcet for b in first.before), default=0)
        start = _first_phase(system, busy, row, earliest, whole)
        if start is None:
            return None
        for member, later in row:
            each, at_first = system.activities[member], start + later
            starts[member] = at_first
            begins[member] = min((begins[other] for other in each.before), default=at_first)
            if system.limit and each.before and at_first + each.wcet - begins[member] > system.limit * each.period:
                return None
            for turn in range(whole // each.period):
                at = (at_first + turn * each.period) % whole
                insort(busy[each.unit], (at, min(whole, at + each.wcet)))
                if at + each.wcet > whole:
                    insort(busy[each.unit], (0, at + each.wcet - whole))
    return [starts[number] for number in range(len(starts))]


def _order(system: System) -> Iterator[int]:
    graph = TopologicalSorter({number: each.before for number, each in enumerate(system.activities)})
    graph.prepare()
    linked = {other for each in system.activities for other in each.before}
    level: dict[int, int] = {}
    for period in sorted({each.period for each in system.activities}):
        level[period] = 1 + max((level[other] for other in level if period % other == 0), default=0)
    waiting: list[tuple[int, int, bool, int, int]] = []
    while graph.is_active():
        for number in graph.get_ready():
            each = system.activities[number]
            is_alone = not each.before and number not in linked
            insort(waiting, (level[each.period], -each.period, is_alone, -each.wcet, number))
        number = waiting.pop(0)[-1]
        yield number
        graph.done(number)


def _first_phase(
    system: System,
    busy: Mapping[str, Sequence[tuple[int, int]]],
    row: Sequence[tuple[int, int]],
    earliest: int,
    whole: int,
) -> int | None:
    """Return the first start from `earliest` on, within a period, at which all jobs of a row find their units free.

    A row lists activities that start so long after the first of them.
    """
    start = earliest
    while start < earliest + system.activities[row[0][0]].period:
        moved = start
        for number, later in row:
            each = system.activities[number]
            for turn in range(whole // each.period):
                at = (moved + later + turn * each.period) % whole
                passes = system.is_closed and at + each.wcet > whole
                moved += whole - at if passes else _blocked(busy[each.unit], at, each.wcet, whole)
        if moved == start:
            return start
        start = moved
    return None


def _blocked(busy: Sequence[tuple[int, int]], at: int, length: int, whole: int) -> int:
    """Return by how much a job that starts at `at` has to wait for the first that is in its way; 0 if none is."""
    place = bisect_right(busy, (at, whole + 1))
    if place and busy[place - 1][1] > at:
        return busy[place - 1][1] - at
    if place < len(busy) and busy[place][0] < at + length:
        return busy[place][1] - at
    if at + length > whole and busy and busy[0][0] < at + length - whole:
        return busy[0][1] + whole - at
    return 0
