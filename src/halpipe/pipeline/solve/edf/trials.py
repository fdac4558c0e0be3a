"""Tries of plans: the simulated table, its jobs and latencies in exact time, and how far it is from a valid one.

Jobs run by earliest deadline first over segments, on unrolled time, until one hyperperiod repeats the one before it
(MODEL 8.3). What happens from one instant to the next is in `native/edf.c`.
"""

from __future__ import annotations

import ctypes
import math
from fractions import Fraction
from operator import sub
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO
from halpipe.core.grouping import grouped
from halpipe.core.libraries import INTEGER, words
from halpipe.core.records import record
from halpipe.pipeline.jobs import natural_tick, start_in_time
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.parts import job_of
from halpipe.pipeline.solve.codes import TOO_MANY_PARTS
from halpipe.pipeline.solve.edf.fixed import window_excess
from halpipe.pipeline.solve.edf.native import FIRST_ROOM, LARGEST, Simulation, System, Told, function
from halpipe.pipeline.solve.edf.works import finer
from halpipe.pipeline.solve.limits import too_large

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, Job, TaskModel
    from halpipe.pipeline.solve.edf.plans import Plan, Span, Table
    from halpipe.pipeline.solve.edf.works import Mode, Way, Window, Work
    from halpipe.pipeline.solve.integers import Ints


MOST_CYCLES = 8
"""Hyperperiods after which a table that still changes is given up."""


class Simulator:
    """Simulates plans of one mode."""

    def __init__(self, mode: Mode) -> None:
        """Write down the mode; raise `HalpipeError` if its times have too many ticks."""
        self._mode = mode
        self._room = dict(FIRST_ROOM)
        try:
            self._system = System(mode, MOST_CYCLES)
        except OverflowError:
            raise HalpipeError(too_large(mode.expansion, mode.tick)) from None

    def table(self, plan: Plan) -> Table:
        """Return the table that a plan leads to."""
        while True:
            told = Told(self._system, plan, self._room["open"])
            start_up = self._start_up(plan, told)
            simulation = Simulation(self._system, told, self._room)
            closed = self._close(simulation, start_up)
            lacking = simulation.memory.lacks_room
            if not lacking:
                return simulation.table(closed=closed)
            self._room.update((name, 2 * self._room[name]) for name in lacking)

    def _start_up(self, plan: Plan, told: Told) -> int:
        """Return after how many hyperperiods every window has a predecessor to look back at."""
        windows = (window for way in plan.ways for window in way.windows)
        instant = max((earliest_expected(plan, told, window) for window in windows), default=0)
        cycles = -(-instant // self._mode.hyperperiod)
        if (cycles + MOST_CYCLES + 1) * self._mode.hyperperiod > LARGEST:
            raise HalpipeError(too_large(self._mode.expansion, self._mode.tick))
        return cycles

    def _close(self, simulation: Simulation, start_up: int) -> bool:
        """Go on to the first hyperperiod that repeats the one before it; return whether there is one."""
        cycle, closed, end = self._mode.hyperperiod, False, 0
        for turn in range(1, start_up + MOST_CYCLES + 1):
            end = turn * cycle
            simulation.memory.turn(end - cycle, end)
            simulation.run(end)
            repeats = simulation.is_like_before(end, turn)
            closed = turn > start_up and (repeats or (turn == 1 and simulation.is_quiescent(end)))
            if closed or simulation.memory.lacks_room:
                break
        simulation.finish(end)
        return closed


def earliest_expected(plan: Plan, told: Told, window: Window) -> int:
    """Return before when no job may expect a predecessor in a window, since none has run yet."""
    first = told.first_release(window.task)
    if not window.least or first is None:
        return 0
    return first + (plan.ways[window.task].length if window.from_end else 0) + window.least


def lateness(mode: Mode, table: Table) -> list[int]:
    """Return by how many ticks the jobs of each task start and end too late, all together, under their best phase."""
    return [
        _lateness(work, table, task, mode.hyperperiod) if work.is_cyclic and table.is_whole(task) else late
        for task, (work, late) in enumerate(zip(mode.works, table.late, strict=True))
    ]


def _lateness(work: Work, table: Table, task: int, cycle: int) -> int:
    """Return that of a task with a period, all of whose jobs have started."""
    own = slice(table.places[task], table.places[task + 1])
    starts, ends, releases = table.starts[own], table.ends[own], table.releases[own]
    slips = list(map(sub, starts, releases))
    shift = 0 if work.phase is not None else min(slips, default=0)
    if work.arrivals is not None:
        late = _beyond(slips, shift + work.slip)
        return late + _arrival_lateness(sorted(zip(starts, ends, strict=True)), work.arrivals, cycle)
    return _beyond(slips, shift + work.latest) + _beyond(list(map(sub, ends, releases)), shift + work.deadline)


def _beyond(delays: list[int], most: int) -> int:
    """Return by how much delays are longer than they may be, all together."""
    if max(delays, default=most) <= most:
        return 0
    return sum(max(0, delay - most) for delay in delays)


def _arrival_lateness(spans: list[tuple[int, int]], arrivals: tuple[int, int], cycle: int) -> int:
    """Return by how much jobs start and end too late after the start of the job before, round the hyperperiod."""
    apart, answer = arrivals
    before = [spans[-1][0] - cycle, *(start for start, _ in spans[:-1])]
    pairs = zip(before, spans, strict=True)
    return sum(max(0, start - since - apart) + max(0, end - since - answer) for since, (start, end) in pairs)


def followed(mode: Mode, plan: Plan, table: Table) -> tuple[int, ...]:
    """Return the phases of a table's first starts, for tasks whose phase is free."""
    return tuple(
        phase if work.phase is not None or not work.is_cyclic else phase + min(table.slips(task), default=0)
        for task, (work, phase) in enumerate(zip(mode.works, plan.phases, strict=True))
    )


def named(mode: Mode, plan: Plan, table: Table) -> tuple[Job, ...]:
    """Return the jobs of a table with their names, in exact time, and those that stay."""
    services = {way.units: _service(mode, way) for way in plan.ways}
    jobs = []
    for task, (work, way) in enumerate(zip(mode.works, plan.ways, strict=True)):
        units = tuple(mode.units[unit] for unit in way.units)
        for index, spans in sorted(table.jobs(task)):
            exact = [_exact(mode, way, span) for span in spans]
            jobs.append(job_of(work.name, index, way.version, units, exact, services[way.units]))
    return tuple(jobs) + tuple(each.job for each in mode.fixed.jobs)


def _service(mode: Mode, way: Way) -> tuple[tuple[Duration, Duration], ...]:
    return tuple(interrupt for unit in way.units for interrupt in mode.services[unit])


def _exact(mode: Mode, way: Way, span: Span) -> tuple[Duration, Duration, Duration]:
    """Return the start of a part, and what it executes, in exact time."""
    start, _, first, last = span
    return mode.tick * start, _executed(mode, way, first), _executed(mode, way, last)


def _executed(mode: Mode, way: Way, where: int) -> Duration:
    """Return an execution time of the grid in exact time: a split point where the version has a list of them."""
    if not way.anywhere:
        ends = (0, *way.ends)
        return way.bounds[ends.index(where)]
    if where >= way.wcet or mode.growth == 1:
        return way.bounds[-1] if where >= way.wcet else mode.tick * where
    return _shortened(mode, way, where)


def _shortened(mode: Mode, way: Way, where: int) -> Duration:
    """Return what is executed where an execution of more was cut: an edge of a phase that was rounded to there, if any.

    All else is rounded down to a finer tick.
    """
    step, part = way.bounds[-1] / way.wcet, finer(mode.tick)
    edges = (edge for access in way.version.accesses for edge in (access.start, access.end))
    edge = max((edge for edge in edges if edge <= step * where), default=ZERO)
    return edge if edge > step * (where - 1) else max(edge, part * (step * where // part))


def missed_by_fixed(mode: Mode, table: Table) -> dict[int, int]:
    """Return by how much tasks miss the windows of jobs that stay."""
    if not any(each.way.windows for each in mode.fixed.jobs):
        return {}
    instants: dict[int, list[tuple[int, int]]] = {}
    for task in range(len(mode.works)):
        instants[task] = [(spans[0][0], spans[-1][1]) for _, spans in table.jobs(task)]
    for each in mode.fixed.jobs:
        instants[each.task].append((each.start, each.end))
    return window_excess(mode.fixed.jobs, instants, mode.hyperperiod)


Ticks = int | Fraction
Latency = tuple[Ticks, Ticks]
"""Reaction time and data age."""

NEVER = 2**60
"""Stands for the latency of a chain that carries no data to its end: longer than any."""


class ChainTimes:
    """Measures the chains of a mode all of whose tasks run in it."""

    def __init__(self, mode: Mode, chains: Sequence[Chain]) -> None:
        """Look up the tasks of the chains."""
        self._mode = mode
        number = {work.name: task for task, work in enumerate(mode.works)}
        self.chains = tuple(chain for chain in chains if number.keys() >= set(chain.tasks))
        self._tasks = [[number[name] for name in chain.tasks] for chain in self.chains]
        is_on_grid = mode.growth == 1 and natural_tick(mode.expansion) % mode.tick == ZERO
        self._is_exact = not self.chains or (is_on_grid and not mode.fixed.jobs)

    def of(self, plan: Plan, table: Table) -> list[Latency]:
        """Return the latencies of the chains in a table that is closed; NEVER where no data reach the end."""
        if not self._is_exact:
            return self._named(plan, table)
        members = {task: _Member(table, task) for tasks in self._tasks for task in tasks}
        return [self._of([members[task] for task in tasks]) for tasks in self._tasks]

    def _of(self, members: list[_Member]) -> Latency:
        if any(not member.starts for member in members):
            return NEVER, NEVER
        reaction, age = INTEGER(), INTEGER()
        chain = words(word for member in members for word in member.words)
        cycle = INTEGER(self._mode.hyperperiod)
        pointers = ctypes.byref(reaction), ctypes.byref(age)
        function("latency")(ctypes.byref(chain), INTEGER(len(members)), cycle, *pointers)
        return reaction.value, age.value

    def _named(self, plan: Plan, table: Table) -> list[Latency]:
        placement = Placement.of(self._mode.expansion, named(self._mode, plan, table), self._mode.platform)
        found = chain_latencies(placement, self.chains)
        return [(self._ticks(latency.reaction), self._ticks(latency.age)) for latency in found]

    def _ticks(self, time: Duration | None) -> Ticks:
        return NEVER if time is None else time / self._mode.tick


class _Member:
    """A task of a chain, as the library sees it."""

    def __init__(self, table: Table, task: int) -> None:
        own = slice(table.places[task], table.places[task + 1])
        self.starts, self._ends = table.starts[own], table.ends[own]
        self._first = self.starts.index(min(self.starts)) if self.starts else 0

    @property
    def words(self) -> list[int | Ints]:
        """The fields of the library's struct."""
        return [len(self.starts), self._first, self.starts, self._ends]


MAX_PARTS = 10_000_000
"""Parts of all jobs in a hyperperiod (MODEL 8.3)."""


@record
class Try:
    """A plan and its table. `excess` is zero if no job is late, and no chain beyond its limit."""

    plan: Plan
    table: Table
    late: tuple[int, ...]
    excess: int
    slow: tuple[int, ...] = ()
    """The tasks of chains that are too long, where no job is late."""


@record
class Effort:
    """Effort of search and improvement, in jobs placed; `go_on` gets the jobs placed and the least excess."""

    budget: int
    polish: int
    go_on: Callable[[int, int], bool]


class Trials:
    """Tries plans of one mode, and counts the jobs that were placed."""

    def __init__(self, mode: Mode, model: TaskModel, effort: Effort) -> None:
        """Begin without any."""
        self.mode = mode
        self.model = model
        self.effort = effort
        self.placed = 0
        self.stopped = False
        self._simulator = Simulator(mode)
        ways = [way for work in mode.works for way in work.ways]
        times = (time for way in ways for time in (*way.bounds, way.version.split.resume))
        is_longer = mode.growth > 1 or any(time % mode.tick for time in times)
        # What is shortened, or was rounded up, begins and ends before what is simulated.
        is_shortened = mode.is_lenient or (is_longer and any(way.phases or way.windows for way in ways))
        self._is_refined = is_shortened or bool(mode.expansion.locks) or any(True for _ in model.refinements())
        self._times = ChainTimes(mode, model.chains)
        self.limited = [chain for chain in model.chains if chain.max_reaction is not None or chain.max_age is not None]
        self._limits = ChainTimes(mode, self.limited)

    def evaluate(self, plan: Plan) -> Try:
        """Try a plan."""
        table = self._simulator.table(plan)
        self._refuse_crowds(table)
        self.placed += max(1, len(table))
        missed = missed_by_fixed(self.mode, table)
        late = tuple(late + missed.get(task, 0) for task, late in enumerate(lateness(self.mode, table)))
        excess = sum(late)
        slow: tuple[int, ...] = ()
        if not table.closed:
            excess += self.mode.hyperperiod
        elif not excess:
            excess, slow = self._chain_excess(plan, table)
            excess += self._beside_fixed(plan, table)
        if not self.effort.go_on(self.placed, excess):
            self.stopped = True
        return Try(plan, table, late, excess, slow)

    def jobs(self, found: Try) -> tuple[Job, ...]:
        """Return the jobs of a table with their names, in exact time."""
        return named(self.mode, found.plan, found.table)

    def latencies(self, found: Try) -> list[Latency]:
        """Return the latencies of the chains all of whose tasks run in the mode, in the order of the model."""
        return self._times.of(found.plan, found.table)

    def _refuse_crowds(self, table: Table) -> None:
        """Stop where jobs have more parts than a schedule may have (MODEL 8.3)."""
        parts = table.part_count
        if parts > MAX_PARTS:
            mode = self.mode.expansion.mode
            help = "state max-gaps, or a longer min-part, or periods with a shorter hyperperiod"
            text = f"its jobs have {parts} parts in a hyperperiod, {MAX_PARTS} are allowed"
            raise HalpipeError(TOO_MANY_PARTS(text, at=mode.at, path=f'mode "{mode.name}"', help=help))

    def _beside_fixed(self, plan: Plan, table: Table) -> int:
        """Return what a table still costs: with jobs that stay, or by rules that no simulation keeps (MODEL 10)."""
        if not self.mode.fixed.jobs and not self._is_refined:
            return 0
        late, jobs, expansion = 0, named(self.mode, plan, table), self.mode.expansion
        if self.mode.is_lenient:  # the deadlines of the simulation are not those of jobs in one piece
            own = grouped((job.task, job) for job in jobs)
            late = sum(not start_in_time(expansion, expansion.by_name[name], each) for name, each in own.items())
        placement = Placement.of(expansion, jobs, self.mode.platform)
        return late + max(0, math.ceil(cost_terms(self.model, placement).total))

    def _chain_excess(self, plan: Plan, table: Table) -> tuple[int, tuple[int, ...]]:
        """Return by how much chains are too long, and the tasks of those that are."""
        excess = 0
        slow: set[str] = set()
        for chain, (reaction, age) in zip(self._limits.chains, self._limits.of(plan, table), strict=True):
            beyond = self._beyond(reaction, chain.max_reaction) + self._beyond(age, chain.max_age)
            excess += beyond
            slow.update(chain.tasks if beyond else ())
        return excess, tuple(task for task, work in enumerate(self.mode.works) if work.name in slow)

    def _beyond(self, latency: Ticks, limit: Duration | None) -> int:
        return 0 if limit is None else max(0, math.ceil(latency - limit / self.mode.tick))
