"""From an expanded mode to the integer arrays the solvers work on. Names end here and indices begin.

Units, gangs, resources and fractional bounds become one thing: a job under an *option* (a version with a choice of
groups of units) is a set of rectangles on the lanes. All times are ticks, all heights are multiples of the lane's
quantum.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from graphlib import TopologicalSorter
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.models import Anchor, Edge, Match
from halpipe.pipeline.jobs import Expansion, demand_ranges
from halpipe.pipeline.parts import reserved_length
from halpipe.pipeline.solve.construction import construction_order
from halpipe.pipeline.solve.integers import Row, Table, ints
from halpipe.pipeline.solve.lanes import Lanes, is_bound

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Chain, Precedence, Task, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask
    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.lanes import Choice, Pins

Rect = tuple[int, int, int, int]
_EndsLate = tuple[Duration, Duration]
Columns = dict[str, Any]
"""Arrays and tables by their names in `Arrays`."""

NO_TICK = -1

CHAIN_COLUMNS = (
    "chain_first", "chain_task", "chain_limit", "chain_latency", "chain_event",
    "task_chain_first", "task_chain", "task_coupled", "partner_first", "partner",
)  # fmt: skip
"""What in `Arrays` depends on which chains count."""

START, END, RELEASE, POINT, DATA = range(5)
"""The instants of jobs as the kernel knows them; `DATA` of a chain: where jobs read, or write."""

INSTANT = {Anchor.START: START, Anchor.END: END, Anchor.RELEASE: RELEASE, Anchor.POINT: POINT, None: DATA}

SAME_CYCLE = 5
"""Column of a row that is 1 where both jobs are of one cycle."""

ANY_SET = -1
"""Stands for the unit set of an option that goes with every other."""

WINDOW_WEIGHT = 12
"""What a tick of distance from a window weighs against a tick of overlap on a unit."""


@record
class Arrays:
    """A mode in integers. ``x_first`` arrays are offsets: row i owns ``x[x_first[i]:x_first[i + 1]]``."""

    hyperperiod: int
    lane_capacity: Ints  # quanta
    lane_weight: Ints  # cost of one tick times one quantum of excess
    lane_first: Ints  # room for the breakpoints of each lane's profile
    guide_first: Ints  # stretches into which each lane is cut to find breakpoints
    guide_shift: Ints  # of 2**shift ticks each
    owner_first: Ints  # room for the rectangles on each lane
    task_job: Ints  # first job of every task
    task_period: Ints  # D, or the hyperperiod for tasks on demand
    task_cyclic: Ints  # 1: periodic, 0: on demand
    task_reach: Ints  # latest end of a job after its release: bounds a search by job index
    task_option: Ints  # first option of every task
    task_coupled: Ints  # 1: has windows, demands or limited chains in common with others
    task_sets: Ints  # of a task whose jobs keep to one set of units: how many it may choose from; 1 for others
    task_let: Ints  # logical execution time, or NO_TICK
    task_first: Ints  # 1: its phase lies in its first period
    job_task: Ints
    job_entry: Ints
    entry_job: Ints  # first job of every entry; an entry is what moves as one: a periodic task or one demand job
    entry_offset: Ints  # fixed phase, or NO_TICK
    option_wcet: Ints
    option_late: Ints  # largest delta that slack and deadline allow
    option_present: Ints  # 0 for the option of a demand job not to run
    option_set: Ints  # of a bound task: number of the unit set, from 0 on; ANY_SET where the choice is free
    option_recency: Ints  # of jobs that end on the same tick, the one with more ended last, or started later
    rect_first: Ints  # per option
    rect: Table  # lane, offset, length, height
    row_first: Ints  # per option, by the tasks that they name
    row: Table  # predecessor task, min, max - min, origin, 1 if to the end, 1 if of the same cycle, first of event_at
    event_at: Ints  # for every point that a row counts from, per option of the task: how long after the start it lies
    consumer_first: Ints  # per task: tasks whose options have rows that name it
    consumer: Ints
    partner_first: Ints  # per task: windows to aim at
    partner: Table  # other task, lag, width, sign (+1 this task after the other), 1 if from the end of the earlier
    demand_job: Ints  # per job: the job that demands it, or -1
    demand_slot: Ints
    dependent_first: Ints  # per job: the jobs it may demand
    dependent: Ints
    chain_first: Ints  # limited chains only
    chain_task: Ints
    chain_limit: Table  # reaction, age; NO_TICK where unlimited
    chain_latency: Ints  # NO_TICK where unlimited
    chain_event: Table  # from and to which instant of a job they count
    task_chain_first: Ints
    task_chain: Ints
    construction: Ints  # entries, in the order in which they are placed first
    unit_weight: int  # cost of one tick of distance from a window or beyond a limit
    missing_cost: int  # cost of a demand not met, or of a chain that carries no data to its end
    is_closed: int  # 1: no job may be in progress at the end of the hyperperiod


@record
class Option:
    """Option of a job: a version and the number of units of each group that it takes (empty: not to run)."""

    version: Version | None
    groups: Choice


@dataclass(frozen=True)
class Problem:
    """A mode ready to solve, with what is needed to give the answer its names back."""

    expansion: Expansion
    tick: Duration
    groups: tuple[tuple[str, ...], ...]
    options: tuple[Option, ...]
    arrays: Arrays
    mean_wcet: int
    services: Mapping[str, Service[Duration]]
    """The interrupts of every unit."""

    def with_construction(self, order: Ints) -> Problem:
        """Return the problem with its entries constructed in another order."""
        return replace(self, arrays=replace(self.arrays, construction=order))

    def with_chains(self, other: Problem) -> Problem:
        """Return the problem with the chains that another one of the same mode counts, and what comes of them."""
        columns = {name: getattr(other.arrays, name) for name in CHAIN_COLUMNS}
        return replace(self, arrays=replace(self.arrays, **columns))


def build_problem(
    expansion: Expansion,
    units: Sequence[Unit],
    resources: Sequence[str],
    chains: Iterable[Chain] = (),
    *,
    tick: Duration | None = None,
    grouped: bool = True,
    every_chain: bool = False,
    pinned: Mapping[str, Pins] | None = None,
) -> Problem:
    """Turn an expanded mode of a validated model into arrays.

    `tick` replaces the natural one; then WCETs and access phases are rounded outward and windows inward, so
    that what is valid on the grid is valid exactly. `grouped` puts interchangeable units on one lane; without
    it every unit has its own, as it does where tasks are bound to units. Of `chains` those count that have a limit
    (with `every_chain`: all) and only active tasks. `pinned` tasks stay on the units named.
    """
    counted = [c for c in chains if every_chain or (c.max_latency, c.max_reaction, c.max_age) != (None,) * 3]
    grouped = grouped and not any(map(is_bound, expansion.tasks))
    return _Builder(expansion, Lanes(expansion, units, resources, tick, grouped, pinned or {}), counted).build()


class _Builder:
    """Fills the arrays, one method per family of columns."""

    def __init__(self, expansion: Expansion, lanes: Lanes, chains: Iterable[Chain]) -> None:
        self.expansion = expansion
        self.lanes = lanes
        self.hyperperiod = self.lanes.ticks(expansion.hyperperiod)
        self.task_index = {active.name: index for index, active in enumerate(expansion.tasks)}
        self.chains = [chain for chain in chains if all(name in self.task_index for name in chain.tasks)]
        self.options: list[Option] = []
        self.points: dict[tuple[int, Duration], int] = {}

    def build(self) -> Problem:
        capacities, weight = self.lanes.capacities, self.lanes.unit_weight
        option = self._options()
        option["event_at"] = ints(self._events(option["task_option"]))
        jobs = self._jobs()
        windows = self._windows()
        chains = self._chains()
        mean = max(1, self.lanes.ticks(self.expansion.mean_wcet))
        arrays = Arrays(
            hyperperiod=self.hyperperiod,
            lane_capacity=ints(capacities),
            lane_weight=ints(self.lanes.weights),
            **self._lane_room(len(capacities), option),
            **jobs,
            **option,
            **windows,
            **self._demands(),
            **chains,
            task_coupled=self._coupled(windows, chains),
            construction=self._construction(windows),
            unit_weight=WINDOW_WEIGHT * weight,
            missing_cost=WINDOW_WEIGHT * weight * mean,
            is_closed=int(self.expansion.mode.edge is Edge.CLOSED),
        )
        lanes, options = self.lanes, tuple(self.options)
        return Problem(self.expansion, lanes.tick, lanes.groups, options, arrays, mean, lanes.services)

    # ---- options, and room for them

    def _options(self) -> Columns:
        made: list[tuple[Option, int, int, int, int, _EndsLate, list[Rect], list[Row]]] = []
        task_sets, task_option = [], [0]
        for active in self.expansion.tasks:
            numbers: dict[Choice, int] = {}
            chooses_once = is_bound(active)
            for version in active.versions:
                found = (self._row(row) for row in version.precedences)
                constraints = sorted(found, key=itemgetter(0))  # the kernel finds a task by halves
                if any(predecessor < 0 or width < 0 for predecessor, _, width, *_ in constraints):
                    continue
                known: dict[Service[Duration], tuple[int, int, list[Rect], _EndsLate]] = {}
                for choice in self.lanes.choices(active, version):
                    service = self.lanes.service(choice)
                    if service not in known:
                        times, phases = self.lanes.times(active, version, service), self.lanes.phases(version, service)
                        known[service] = (*times, phases, self._recency(version, service))
                    length, slip, claims, recency = known[service]
                    if slip < 0 or length > self.hyperperiod:
                        continue
                    number = numbers.setdefault(choice, len(numbers)) if chooses_once else ANY_SET
                    rects = [(group, 0, length, count) for group, count in choice] + claims
                    made.append((Option(version, choice), length, slip, 1, number, recency, rects, constraints))
            task_sets.append(max(1, len(numbers)))
            if active.name in self._uncertain:
                made.append((Option(None, ()), 0, 0, 0, ANY_SET, (ZERO, ZERO), [], []))
            task_option.append(len(made))
        columns = zip(*made, strict=True) if made else [()] * 8
        self.options, wcet, late, present, sets, recencies, claimed, rows = map(list, columns)
        ranks = {key: number for number, key in enumerate(sorted(set(recencies), reverse=True))}
        rect_first, rect = _table(claimed, 4)
        row_first, row = _table(rows, 7)
        return {
            "task_option": ints(task_option),
            "option_wcet": ints(wcet),
            "option_late": ints(late),
            "option_present": ints(present),
            "option_set": ints(sets),
            "task_sets": ints(task_sets),
            "option_recency": ints(map(ranks.__getitem__, recencies)),
            "rect_first": rect_first,
            "rect": rect,
            "row_first": row_first,
            "row": row,
        }

    def _recency(self, version: Version, service: Service[Duration]) -> _EndsLate:
        """Return what the end lacks of a whole tick, and the execution time: what lacks least ends last."""
        assert version.wcet is not None, "validated models state every WCET"
        wcet = reserved_length(version.wcet, service)
        return self.lanes.tick * self.lanes.ticks_up(wcet) - wcet, wcet

    def _row(self, row: Precedence) -> tuple[int, ...]:
        """Return a window as the kernel has it; a width below zero can never be met."""
        predecessor = self.task_index.get(row.task, -1)
        low, high = self.lanes.ticks_up(row.min), self.lanes.ticks(row.max)
        # On the grid, jobs end up to one tick later than they do.
        is_off = row.point and (self.has_odd_interrupts or row.point % self.lanes.tick)
        if (row.anchor is Anchor.END and self._rounds_up(predecessor)) or is_off:
            high -= 1
        if row.to is Anchor.END and self.has_rounded:
            low += 1
        is_cycle = row.match is Match.CYCLE
        width = high - low if is_cycle else min(high - low, self.hyperperiod - 1)
        event = self._event(predecessor, row.point) if row.anchor is Anchor.POINT and row.point is not None else 0
        return predecessor, low, width, INSTANT[row.anchor], int(row.to is Anchor.END), int(is_cycle), event

    @cached_property
    def has_rounded(self) -> bool:
        """Whether some job may last no multiple of the tick."""
        return any(self._rounds_up(task) for task in range(len(self.expansion.tasks)))

    def _event(self, task: int, point: Duration) -> int:
        """Return where the instants of a point of a task begin, one for each of its options."""
        if task < 0:
            return 0
        if (task, point) not in self.points:
            self.points[task, point] = sum(self._count(self.expansion.tasks[other]) for other, _ in self.points)
        return self.points[task, point]

    def _count(self, active: ActiveTask) -> int:
        """Return at least as many as a task has options."""
        return 1 + sum(len(self.lanes.choices(active, version)) for version in active.versions)

    def _events(self, first: Ints) -> Iterator[int]:
        """Yield how long after the start of a job a point lies, under each option of its task."""
        for task, point in self.points:
            active = self.expansion.tasks[task]
            own = self.options[first[task] : first[task + 1]]
            times = [reserved_length(point, self.lanes.service(option.groups)) for option in own]
            count = self._count(active)
            yield from [*map(self.lanes.ticks_up, times), *[0] * count][:count]

    def _rounds_up(self, task: int) -> bool:
        versions = self.expansion.tasks[task].versions if task >= 0 else ()
        return any(version.wcet and (self.has_odd_interrupts or version.wcet % self.lanes.tick) for version in versions)

    @cached_property
    def has_odd_interrupts(self) -> bool:
        """Whether some interrupt lasts no multiple of the tick."""
        return any(interrupt.wcet % self.lanes.tick for interrupt in self.expansion.interrupts)

    @cached_property
    def _uncertain(self) -> set[str]:
        """Names of the tasks on demand with jobs that depend on choices, and of those on demand of these."""
        found: set[str] = set()
        ranges = {active.name: demand_ranges(active.versions) for active in self.expansion.tasks}
        demanders = {active.name: {demand.task for demand in active.demands} for active in self.expansion.tasks}
        for name in TopologicalSorter(demanders).static_order():
            counts = (ranges[other][name] for other in demanders[name])
            if not found.isdisjoint(demanders[name]) or any(least != most for least, most in counts):
                found.add(name)
        return found

    def _lane_room(self, lanes: int, option: Columns) -> Columns:
        """Size every lane's profile: each rectangle that may land there adds at most three breakpoints."""
        room = [0] * lanes
        rect_first, rect, task_option = option["rect_first"], option["rect"], option["task_option"]
        for index, active in enumerate(self.expansion.tasks):
            most: dict[int, int] = {}
            for o in range(task_option[index], task_option[index + 1]):
                here: dict[int, int] = {}
                for lane, *_ in rect.rows(rect_first[o], rect_first[o + 1]):
                    here[lane] = here.get(lane, 0) + 1
                for lane, count in here.items():
                    most[lane] = max(most.get(lane, 0), count)
            for lane, count in most.items():
                room[lane] += count * active.jobs
        # A stretch for about four breakpoints: shorter ones find them hardly quicker, and all must be kept up to date.
        shift = [max(0, self.hyperperiod.bit_length() - max(0, r.bit_length() - 2)) for r in room]
        stretches = [((self.hyperperiod - 1) >> s) + 1 for s in shift]
        return {
            "lane_first": ints([0, *itertools.accumulate(3 * r + 4 for r in room)]),
            "guide_first": ints([0, *itertools.accumulate(stretches)]),
            "guide_shift": ints(shift),
            "owner_first": ints([0, *itertools.accumulate(room)]),
        }

    # ---- tasks, entries and jobs

    def _jobs(self) -> Columns:
        task_job, entry_job = [0], [0]
        entry_offset: list[int] = []
        job_task, job_entry, period, cyclic, reach = [], [], [], [], []
        in_first = self.expansion.in_first
        for index, active in enumerate(self.expansion.tasks):
            task = active.task
            job_task += [index] * active.jobs
            if task.period is not None:
                job_entry += [len(entry_offset)] * active.jobs
                entry_job.append(entry_job[-1] + active.jobs)
                entry_offset.append(NO_TICK if task.offset is None else self._phase_of(task))
            else:
                for _ in range(active.jobs):
                    job_entry.append(len(entry_offset))
                    entry_job.append(entry_job[-1] + 1)
                    entry_offset.append(NO_TICK)
            task_job.append(task_job[-1] + active.jobs)
            period.append(self.hyperperiod if task.period is None else self.lanes.ticks(task.period))
            cyclic.append(int(task.period is not None))
            reach.append(self._reach(active))
        return {
            "task_job": ints(task_job),
            "task_period": ints(period),
            "task_cyclic": ints(cyclic),
            "task_let": ints(
                NO_TICK if a.task.let is None else self.lanes.ticks(a.task.let) for a in self.expansion.tasks
            ),
            "task_first": ints(int(a.jobs > 1 and a.name in in_first) for a in self.expansion.tasks),
            "task_reach": ints(reach),
            "job_task": ints(job_task),
            "job_entry": ints(job_entry),
            "entry_job": ints(entry_job),
            "entry_offset": ints(entry_offset),
        }

    def _reach(self, active: ActiveTask) -> int:
        """Return the latest end of a job after its release, in ticks."""
        lengths, slips = [0], [0]
        for version in active.versions:
            for service in dict.fromkeys(self.lanes.service(choice) for choice in self.lanes.choices(active, version)):
                length, slip = self.lanes.times(active, version, service)
                lengths.append(length)
                slips.append(slip)
        return max(lengths) + max(slips)

    def _phase_of(self, task: Task) -> int:
        assert task.offset is not None
        assert task.period is not None
        return self.lanes.ticks(task.offset % task.period)

    def _construction(self, windows: Columns) -> Ints:
        """Order the entries: heavy ones first, and one after the other what has windows in common."""
        loads = []
        for active in self.expansion.tasks:
            length = self.lanes.length(active.versions[0]) * active.versions[0].gang
            loads.append(length * active.jobs if active.task.period is not None else length)
        counts = [1 if active.task.period is not None else active.jobs for active in self.expansion.tasks]
        entries = list(itertools.accumulate(counts, initial=0))
        order = construction_order(loads, _links(windows))
        return ints(entry for task in order for entry in range(entries[task], entries[task + 1]))

    # ---- precedence, demands, chains

    def _windows(self) -> Columns:
        consumers: list[list[tuple[int]]] = [[] for _ in self.expansion.tasks]
        partners: list[dict[tuple[int, ...], None]] = [{} for _ in self.expansion.tasks]
        for index, active in enumerate(self.expansion.tasks):
            for version in active.versions:
                for constraint in version.precedences:
                    other, low, width, origin, to_end, *_ = self._row(constraint)
                    if other < 0:
                        continue
                    if (index,) not in consumers[other]:
                        consumers[other].append((index,))
                    # Places to aim at only: of a window to an end, as if the job took its first version.
                    low -= self.lanes.length(version) if to_end else 0
                    low += self.lanes.ticks(constraint.point) if constraint.point is not None else 0
                    width, from_end = min(width, self.hyperperiod - 1), int(origin == END)
                    partners[index][(other, low, max(0, width), 1, from_end)] = None
                    partners[other][(index, low, max(0, width), -1, from_end)] = None
        near = max(1, self.hyperperiod // 64)
        for chain in self.chains:
            for earlier, later in itertools.pairwise(self.task_index[name] for name in chain.tasks):
                if earlier != later:
                    partners[later][(earlier, 0, near, 1, 1)] = None
                    partners[earlier][(later, 0, near, -1, 1)] = None
        consumer_first, consumer = _table(consumers, 1)
        partner_first, partner = _table([list(p) for p in partners], 5)
        return {
            "consumer_first": consumer_first,
            "consumer": consumer.flat,
            "partner_first": partner_first,
            "partner": partner,
        }

    def _coupled(self, windows: Columns, chains: Columns) -> Ints:
        """Mark the tasks that have anything to do with others; demands always come with windows."""
        steps = (itertools.pairwise(first) for first in (windows["partner_first"], chains["task_chain_first"]))
        if self.expansion.mode.edge is Edge.CLOSED:
            return ints(1 for _ in self.expansion.tasks)
        return ints(int(a < b or c < d) for (a, b), (c, d) in zip(*steps, strict=True))

    def _demands(self) -> Columns:
        first_job = dict(
            zip(
                (active.name for active in self.expansion.tasks),
                itertools.accumulate((active.jobs for active in self.expansion.tasks), initial=0),
                strict=False,
            )
        )
        demand_job, demand_slot = [], []
        dependents: list[list[tuple[int]]] = [[] for _ in range(self.expansion.job_count)]
        for active in self.expansion.tasks:
            if not active.demands:
                demand_job += [-1] * active.jobs
                demand_slot += [0] * active.jobs
            for demand in active.demands:
                demander = first_job[demand.task] + demand.index
                dependents[demander].append((len(demand_job),))
                demand_job.append(demander)
                demand_slot.append(demand.slot)
        dependent_first, dependent = _table(dependents, 1)
        return {
            "demand_job": ints(demand_job),
            "demand_slot": ints(demand_slot),
            "dependent_first": dependent_first,
            "dependent": dependent.flat,
        }

    def _chains(self) -> Columns:
        members, limits = [], []
        touching: list[list[tuple[int]]] = [[] for _ in self.expansion.tasks]
        for number, chain in enumerate(self.chains):
            indices = [self.task_index[name] for name in chain.tasks]
            members.append([(index,) for index in indices])
            bounds = (chain.max_reaction, chain.max_age)
            limits.append([NO_TICK if bound is None else self._within(chain, bound) for bound in bounds])
            for index in dict.fromkeys(indices):
                touching[index].append((number,))
        latencies = [NO_TICK if c.max_latency is None else self._within(c, c.max_latency) for c in self.chains]
        events = [[(INSTANT[chain.anchor], INSTANT[chain.to])] for chain in self.chains]
        chain_first, chain_task = _table(members, 1)
        task_chain_first, task_chain = _table(touching, 1)
        return {
            "chain_first": chain_first,
            "chain_task": chain_task.flat,
            "chain_limit": Table.of(limits, 2),
            "chain_latency": ints(latencies),
            "chain_event": _table(events, 2)[1],
            "task_chain_first": task_chain_first,
            "task_chain": task_chain.flat,
        }

    def _within(self, chain: Chain, bound: Duration) -> int:
        """Return a limit in ticks; where it counts from an end, less what the end lacks of the grid."""
        return self.lanes.ticks(bound) - int(chain.anchor is Anchor.END and self.has_rounded)


def _links(windows: Columns) -> list[dict[int, int]]:
    """Return for each task those that it has windows with, and how wide the narrowest of them is."""
    links: list[dict[int, int]] = []
    partner = windows["partner"]
    for begin, end in itertools.pairwise(windows["partner_first"]):
        widths: dict[int, int] = {}
        for other, _, width, _, _ in partner.rows(begin, end):
            widths[other] = min(width, widths.get(other, width))
        links.append(widths)
    return links


def _table(rows: Sequence[Sequence[tuple[int, ...]]], width: int) -> tuple[Ints, Table]:
    """Lay lists of tuples end to end; return the offsets and the table of all tuples."""
    first = ints([0, *itertools.accumulate(len(row) for row in rows)])
    return first, Table.of(itertools.chain.from_iterable(rows), width)
