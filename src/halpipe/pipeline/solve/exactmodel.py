"""The constraint program of the exact engine: variables and constraints of one mode, rule by rule (MODEL 3 and 10).

Times are whole ticks. The tick divides every duration that bounds a start, slack * D and deadlines included; on such a
grid a system of orders and distances has a solution exactly if it has one at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import chain as concatenated
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.models import Anchor, Edge, Job, Match
from halpipe.pipeline.jobs import demands_of
from halpipe.pipeline.solve.exactchains import Figures, TooLarge, state_chain
from halpipe.pipeline.solve.solver import solver_library

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Chain, Precedence, TaskModel, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.exactunits import Form

MAX_QUANTA = 10**9

MAX_PARTS = 200_000
"""Variables and intervals of a program; what bounds them is memory."""


def exact_tick(expansion: Expansion) -> Duration:
    """Return the grid on which nothing is lost: it also divides what slacks and deadlines allow."""
    return greatest_common_divisor(duration for duration in _durations(expansion) if duration is not None)


def _durations(expansion: Expansion) -> Iterator[Duration | None]:
    for active in expansion.tasks:
        task = active.task
        yield from (task.period, task.offset, task.deadline, task.let, task.distance)
        if task.period is not None:
            yield task.period * task.slack
        for version in active.versions:
            yield version.wcet
            for access in version.accesses:
                yield from (access.start, access.end)
            for row in version.precedences:
                yield from (row.min, row.max, row.point)


@dataclass(slots=True)
class JobVars:
    """One job: its start theta, and which of its versions, on which units, it takes."""

    active: ActiveTask
    index: int
    theta: Any
    present: Any
    latest: int
    """The greatest value that theta may have."""
    versions: list[tuple[Version, Any]] = field(default_factory=list)
    wcet: Any = 0
    delay: Any = 0
    most_late: int = 0
    """The greatest value that the delay may have."""
    lap: Any = None
    """Whether the start is counted a hyperperiod later, once that is asked."""


def build(
    expansion: Expansion,
    model: TaskModel,
    chains: Iterable[Chain],
    form: type[Form],
    tick: Duration | None = None,
) -> Program | None:
    """Write down the program of an expanded mode; None where it would have more than `MAX_PARTS` parts.

    A `tick` takes the place of the one on which nothing is lost, which it divides.
    """
    program = Program(expansion, form, tick or exact_tick(expansion))
    try:
        program.state_jobs()
        program.state_demands()
        program.state_units(model.units)
        program.state_resources()
        program.state_precedence()
        for chain in chains:
            state_chain(program, chain)
    except TooLarge:
        return None
    return program


class Program:
    """The variables of a mode and its constraints; one method per rule."""

    def __init__(self, expansion: Expansion, form: type[Form], tick: Duration) -> None:
        self.cp = solver_library().CpModel()
        self.form = form
        self.expansion = expansion
        self.tick = tick
        self.total = expansion.hyperperiod // self.tick
        self.tasks: dict[str, list[JobVars]] = {}
        self.phases: dict[str, Any] = {}
        self.later: dict[str, Any] = {}
        """By how much the first release of a task is later than its phase."""
        self.released = expansion.released | expansion.in_first
        self._left = MAX_PARTS

    def ticks(self, duration: Duration) -> int:
        """Return whole ticks; exact for all that the tick divides, rounded down for limits."""
        return duration // self.tick

    def spend(self, parts: int = 1) -> None:
        """Count parts; raise `TooLarge` beyond the bound."""
        self._left -= parts
        if self._left < 0:
            raise TooLarge

    def require(self, parts: int) -> None:
        """Raise `TooLarge` if so many more parts are beyond the bound, before any of them is made."""
        if self._left < parts:
            raise TooLarge

    def integer(self, low: int, high: int) -> Any:
        """Return a new variable for a whole number."""
        self.spend()
        return self.cp.new_int_var(low, high, "")

    def literal(self) -> Any:
        """Return a new variable that is true or false."""
        self.spend()
        return self.cp.new_bool_var("")

    # ---- version, periodic, deadline

    def state_jobs(self) -> None:
        """Every job has a start; periodic ones at their phase, their number of periods, and their delay."""
        anchor = self._turned_to_zero() if self.form.is_circle else None
        for active in self.expansion.tasks:
            self.phases[active.name] = self._phase(active, active is anchor)
            self.tasks[active.name] = [self._job(active, index) for index in range(active.jobs)]
            self._state_release(active)
            self._state_arrivals(active)

    def _state_arrivals(self, active: ActiveTask) -> None:
        """Let each job of a polling task come soon enough for arrivals just after the start of the one before it."""
        task = active.task
        if task.distance is None:
            return
        period, distance = self.ticks(task.period or ZERO), self.ticks(task.distance)
        deadline = distance if task.deadline is None else self.ticks(task.deadline)
        jobs = self.tasks[active.name]
        for before, job in zip((jobs[-1], *jobs[:-1]), jobs, strict=True):
            apart = period + job.delay - before.delay
            self.cp.add(apart <= distance)
            self.cp.add(apart + job.wcet <= deadline)

    def _state_release(self, active: ActiveTask) -> None:
        """Let some job start at its release, where releases count: the phase is the latest that suits all jobs.

        (D) of verify: of a task that a cycle names, another phase has to lie in the first period, unless it has a LET.
        """
        self.later[active.name] = 0
        jobs = self.tasks[active.name]
        if not self.expansion.is_released_at_start(active) or any(isinstance(job.delay, int) for job in jobs):
            return
        if active.name in self.expansion.in_first and active.task.let is None:
            self.later[active.name] = self.integer(0, max(job.most_late for job in jobs))
        punctual = [self.literal() for _ in jobs]
        for literal, job in zip(punctual, jobs, strict=True):
            self.cp.add(job.delay >= self.later[active.name])
            self.cp.add(job.delay == self.later[active.name]).only_enforce_if(literal)
        self.cp.add_bool_or(punctual)

    @property
    def is_closed(self) -> bool:
        """Whether no job may be in progress at the edge of the table."""
        return self.expansion.mode.edge is Edge.CLOSED

    def _turned_to_zero(self) -> ActiveTask | None:
        """Return the task whose phase may be taken as 0: without offsets, a valid schedule may be turned."""
        periodic = [active for active in self.expansion.tasks if active.task.period is not None]
        is_fixed = self.is_closed or bool(self.expansion.in_first)
        if is_fixed or self.form.names_matter or any(active.task.offset is not None for active in periodic):
            return None
        return max(periodic, key=lambda active: active.task.period or ZERO, default=None)

    def _phase(self, active: ActiveTask, is_zero: bool) -> Any:
        """Return s; s and s + D differ in the numbers of the jobs only, so it lies in [0, D)."""
        task = active.task
        if task.period is None or is_zero:
            return 0
        if task.offset is not None:
            return self.ticks(task.offset % task.period)
        return self.integer(0, self.ticks(task.period) - 1)

    def _job(self, active: ActiveTask, index: int) -> JobVars:
        late = [self.lateness(active, version) for version in active.versions]  # interrupts may make several of a name
        most = max(late, default=0)
        if active.jobs == 1 and active.name in self.released and active.task.offset is None:
            most = min(most, 0)  # a job alone starts at its release
        delay = self.integer(0, most) if active.task.period is not None and most > 0 else 0
        theta, latest = self._theta(active, index, delay, most)
        present = self.literal() if active.demands else 1
        job = JobVars(active, index, theta, present, latest, delay=delay, most_late=max(0, most))
        lone = len(active.versions) == 1
        for version, room in zip(active.versions, late, strict=True):
            chosen = job.present if lone else self.literal()
            job.versions.append((version, chosen))
            if room < 0 or not self._fits(version):
                self.cp.add(chosen == 0)
            elif 0 <= room < most:
                self.cp.add(delay <= room).only_enforce_if(chosen)
        if not lone:
            self.cp.add(sum(chosen for _, chosen in job.versions) == job.present)
        job.wcet = self._wcet(job)
        if self.is_closed or not self.form.is_circle:
            self.cp.add(job.theta + job.wcet <= self.total)
        return job

    def lateness(self, active: ActiveTask, version: Version) -> int:
        """Return the largest delta that slack and deadline allow; negative where not even 0 is allowed."""
        task = active.task
        if task.period is None or version.wcet is None:
            return 0
        deadline = task.period if task.deadline is None else task.deadline
        limits = (task.let, deadline if task.distance is None else None)  # of arrivals: see there
        rooms = [self.ticks(limit) - self.ticks(version.wcet) for limit in limits if limit is not None]
        return min([self.ticks(task.period * task.slack), *rooms])

    def _fits(self, version: Version) -> bool:
        """Tell whether the version can run at all: within the hyperperiod, with its predecessors."""
        has_all = all(row.task in self.expansion.by_name for row in version.precedences)
        return has_all and version.wcet is not None and 0 < self.ticks(version.wcet) <= self.total

    def _theta(self, active: ActiveTask, index: int, delay: Any, most: int) -> tuple[Any, int]:
        """Return the start in [0, t_P), s + j * D + delta, taken back once where it passes the end; and its maximum."""
        task = active.task
        if task.period is None:
            return self.integer(0, self.total - 1), self.total - 1
        period = self.ticks(task.period)
        phase = self.phases[active.name]
        start = phase + index * period + delay
        latest = (phase if isinstance(phase, int) else period - 1) + index * period + max(0, most)
        if latest < self.total and isinstance(delay, int):
            return start, latest
        theta = self.integer(0, self.total - 1)  # a variable of its own: an interval starts at one, plus a constant
        self.cp.add(theta == start - self.total * (self.literal() if latest >= self.total else 0))
        return theta, self.total - 1

    def round_the_circle(
        self, job: JobVars, offset: int, length: int, literal: Any, *, always: bool = False
    ) -> list[Any]:
        """Return a job's part, where `literal` holds, as intervals that show all of it on [0, t_P).

        What may pass the end of the hyperperiod is there twice, a hyperperiod apart; with `always`, all is.
        """
        passes = self.form.is_circle and (always or job.latest + offset + length > self.total)
        starts = [job.theta + offset + shift for shift in ((0, -self.total) if passes else (0,))]
        self.spend(len(starts))
        if isinstance(literal, int):
            return [self.cp.new_fixed_size_interval_var(start, length, "") for start in starts]
        return [self.cp.new_optional_fixed_size_interval_var(start, length, literal, "") for start in starts]

    def _wcet(self, job: JobVars) -> Any:
        wcets = {self.ticks(version.wcet or ZERO) for version, _ in job.versions}
        if len(wcets) == 1:
            return wcets.pop()
        return sum(self.ticks(version.wcet or ZERO) * chosen for version, chosen in job.versions)

    def uniform_wcet(self, active: ActiveTask) -> int | None:
        """Return the WCET that all versions have, or None."""
        wcets = {self.ticks(version.wcet or ZERO) for version in active.versions}
        return wcets.pop() if len(wcets) == 1 else None

    def is_strict(self, active: ActiveTask) -> bool:
        """Tell whether the starts of a task are exactly a period apart."""
        return active.task.period is not None and all(self.lateness(active, v) <= 0 for v in active.versions)

    # ---- complete

    def state_demands(self) -> None:
        """A job on demand is present iff the version chosen by its demander demands it."""
        for active in self.expansion.tasks:
            for job, demand in zip(self.tasks[active.name], active.demands, strict=False):
                demander = self.tasks[demand.task][demand.index]
                wanting = [c for v, c in demander.versions if demands_of(v)[active.name] > demand.slot]
                self.cp.add(job.present == sum(wanting))

    # ---- unit, exclusive

    def state_units(self, units: Sequence[Unit]) -> None:
        """Say on which units jobs run, in the form of this program."""
        self.placement = self.form(self, units)
        self.placement.state()

    # ---- access

    def state_resources(self) -> None:
        """At every instant the bounds of the phases in force on a resource sum to at most 1."""
        phases: dict[str, list[tuple[JobVars, Any, Any]]] = {}
        for job in concatenated.from_iterable(self.tasks.values()):
            for version, chosen in job.versions:
                for access in version.accesses:
                    phases.setdefault(access.resource, []).append((job, chosen, access))
        for claims in phases.values():
            quanta = math.lcm(*(access.bound.denominator for _, _, access in claims))
            if quanta > MAX_QUANTA:
                raise TooLarge
            intervals, heights = [], []
            for job, chosen, access in claims:
                start, end = self.ticks(access.start), self.ticks(access.end)
                # Twice, whether it may pass the end or not: sets of 60 tasks take a fiftieth of the time.
                parts = self.round_the_circle(job, start, end - start, chosen, always=True)
                intervals += parts
                heights += [int(access.bound * quanta)] * len(parts)
            if all(2 * height > quanta for height in heights):
                self.cp.add_no_overlap(intervals)
            else:
                self.cp.add_cumulative(intervals, heights, quanta)

    # ---- precedence

    def state_precedence(self) -> None:
        """Every constraint of the version that a job takes has a predecessor in its window."""
        for active in self.expansion.tasks:
            for place, version in enumerate(active.versions):
                if self._fits(version):
                    taken = [(job, job.versions[place][1]) for job in self.tasks[active.name]]
                    for row in version.precedences:
                        self._state_window(active, taken, row)

    def instant(self, job: JobVars, anchor: Anchor, point: Duration | None = None) -> Any:
        """Return an instant of a job, counted on from its start."""
        if anchor is Anchor.RELEASE:
            return job.theta - job.delay + self.later[job.active.name]
        if anchor is Anchor.POINT and point is not None:
            return job.theta + self.ticks(point)
        return job.theta + (job.wcet if anchor is Anchor.END else 0)

    def _state_window(self, active: ActiveTask, taken: list[tuple[JobVars, Any]], row: Precedence) -> None:
        low, high = self.ticks(row.min), self.ticks(row.max)
        before = self.expansion.by_name[row.task]
        if row.match is Match.CYCLE:
            for job, chosen in taken:
                number = int(job.index * (active.task.period or ZERO) / (before.task.period or ZERO))
                self._state_same_cycle(job, self.tasks[row.task][number], row, chosen)
            return
        high = min(high, low + self.total - 1)
        after = self._rigid_instant(before, row)
        if after is None:
            for job, chosen in taken:
                self._state_served(job, chosen, row, low, high)
            return
        # Its instants are a period apart, so that one number of periods says which of them is meant.
        period, phase = self.ticks(before.task.period or ZERO), self.phases[row.task]
        point, latest = phase + after, (phase if isinstance(phase, int) else period - 1) + after
        if row.anchor is Anchor.RELEASE:
            point, latest = point + self.later[row.task], latest + period
        if (
            active.task.period is not None
            and self.is_strict(active)
            and (row.to is Anchor.START or self.uniform_wcet(active) is not None)
            and active.task.period % (before.task.period or ZERO) == ZERO
        ):
            # All jobs lie in the same way to those of the predecessor, so that the window of one is that of all.
            held = taken[0][1] if len(taken) == 1 or isinstance(taken[0][1], int) else self.literal()
            for _, chosen in taken:
                if held is not chosen and not isinstance(held, int):
                    self.cp.add_implication(chosen, held)
            taken = [(taken[0][0], held)]
        for job, chosen in taken:
            self._within(*self._own(job, row), point, latest, low, high, period, chosen)

    def _rigid_instant(self, before: ActiveTask, row: Precedence) -> int | None:
        """Return how long after its phase the instants of a task begin, where they are exactly a period apart."""
        if before.task.period is None or not (self.is_strict(before) or row.anchor is Anchor.RELEASE):
            return None
        if row.anchor is Anchor.END:
            return self.uniform_wcet(before)
        return self.ticks(row.point or ZERO)

    def _own(self, job: JobVars, row: Precedence) -> tuple[Any, int]:
        """Return the instant of a job that is to lie in a window, and its greatest value."""
        longest = max(self.ticks(version.wcet or ZERO) for version, _ in job.versions)
        return self.instant(job, row.to), job.latest + (longest if row.to is Anchor.END else 0)

    def _state_served(self, job: JobVars, chosen: Any, row: Precedence, low: int, high: int) -> None:
        """Say which job of a predecessor without rigid instants serves this one."""
        serving = []
        for other in self.tasks[row.task]:
            serves = self.literal()
            serving.append(serves)
            point = self.instant(other, row.anchor, row.point)
            self._within(*self._own(job, row), point, 2 * self.total, low, high, self.total, serves)
            self.cp.add(other.present == 1).only_enforce_if(serves)
        self.cp.add_bool_or(serving).only_enforce_if(chosen)

    def _state_same_cycle(self, job: JobVars, other: JobVars, row: Precedence, chosen: Any) -> None:
        """Compare unreduced instants of two jobs of one cycle."""
        between = self.instant(job, row.to) + self._lap(job) - self.instant(other, row.anchor, row.point)
        low, high = self.ticks(row.min), self.ticks(row.max)
        self.cp.add_linear_constraint(between - self._lap(other), low, high).only_enforce_if(chosen)

    def _lap(self, job: JobVars) -> Any:
        """Return the hyperperiod where the start of a job lies before the first instant of its period, else 0."""
        period = job.active.task.period or ZERO
        first = self.ticks(period * job.index + (job.active.task.offset or ZERO) % period)
        if not first or job.latest < self.total - 1:  # only starts that are reduced have that latest value
            return 0
        if job.lap is None:
            job.lap = self.literal()
            self.cp.add(job.theta >= first).only_enforce_if(job.lap.negated())
            self.cp.add(job.theta < first).only_enforce_if(job.lap)
        return self.total * job.lap

    def _within(
        self, start: Any, latest: int, point: Any, latest_point: int, low: int, high: int, period: int, when: Any
    ) -> None:
        """Let start - point lie in [low, high], up to some multiple of `period`.

        Starts begin at 0 at the earliest, points at the release of a job at 0.
        """
        least, most = -((latest - low) // period), (high + latest_point) // period
        least -= -(-self.total // period)  # a delay is shorter than the hyperperiod
        turns = self.integer(least, max(least, most))  # of windows that are empty, the constraint says so
        self.cp.add_linear_constraint(start - point + period * turns, low, high).only_enforce_if(when)

    # ---- chain

    def minimise(self, chains: Mapping[Chain, int], most: int, floors: Iterable[tuple[Sequence[Chain], int]]) -> None:
        """Ask for the least sum of reaction times and data ages, each times a whole weight, of at most `most` ticks.

        `floors` say of groups of chains that their part of the sum is no less, which the solver need not prove.
        """
        parts: dict[Chain, Any] = {}
        for chain, weight in chains.items():
            figures = Figures(self, chain)
            parts[chain] = 0
            for latencies in (figures.reactions(), figures.ages()):
                worst = self.integer(0, 2 * self.total * (len(chain.tasks) + 2))
                figures.limit(latencies, worst)
                parts[chain] += weight * worst
        for group, floor in floors:
            self.cp.add(sum(parts[chain] for chain in group) >= floor)
        total = sum(parts.values())
        self.cp.add(total <= most)
        self.cp.minimize(total)

    def suggest(self, jobs: Iterable[Job]) -> None:
        """Let the search begin at a schedule."""
        by_key = {(job.active.name, job.index): job for job in concatenated.from_iterable(self.tasks.values())}
        hints: dict[int, tuple[Any, int]] = {}
        for placed in jobs:
            job, start = by_key[placed.task, placed.index], self.ticks(placed.start)
            values = [(job.theta, start), *((chosen, int(v.name == placed.version)) for v, chosen in job.versions)]
            if placed.index == 0 and job.active.task.period is not None:
                values.append((self.phases[placed.task], start % self.ticks(job.active.task.period)))
            hints |= {v.index: (v, value) for v, value in values if type(v).__name__ == "IntVar"}
        for variable, value in hints.values():
            self.cp.add_hint(variable, value)

    # ---- answer

    def jobs(self, solver: Any) -> list[Job] | None:
        """Return the jobs of a solution with names and exact times; None where they cannot be assigned to units."""
        units = self.placement.deal(solver)
        if units is None:
            return None
        return [
            self._named(job, version, int(solver.value(job.theta)), units[job.active.name, job.index])
            for job in concatenated.from_iterable(self.tasks.values())
            for version, chosen in job.versions
            if solver.value(chosen)
        ]

    def _named(self, job: JobVars, version: Version, theta: int, units: tuple[str, ...]) -> Job:
        start = self.tick * theta
        end = start + (version.wcet or ZERO)
        return Job(task=job.active.name, index=job.index, start=start, end=end, version=version.name, units=units)
