"""The constraint program of the exact engine: variables and constraints of one mode, rule by rule (MODEL 3).

Times are whole ticks. The tick divides every duration that bounds a start, slack * D and deadlines included; on such a
grid a system of orders and distances has a solution exactly if it has one at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import chain as concatenated
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.models import Anchor, Job
from halpipe.pipeline.jobs import demands_for

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Chain, Precedence, TaskModel, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.exactunits import Form

MAX_QUANTA = 10**9


class TooLarge(Exception):  # noqa: N818 - never leaves this module
    """The program grows beyond its bound."""


def exact_tick(expansion: Expansion) -> Duration:
    """Return the grid on which nothing is lost: it also divides what slacks and deadlines allow."""
    return greatest_common_divisor(duration for duration in _durations(expansion) if duration is not None)


def _durations(expansion: Expansion) -> Iterator[Duration | None]:
    for active in expansion.tasks:
        task = active.task
        yield from (task.period, task.offset, task.deadline)
        if task.period is not None:
            yield task.period * task.slack
        for version in active.versions:
            yield version.wcet
            for access in version.accesses:
                yield from (access.start, access.end)
            for row in version.precedences:
                yield from (row.min, row.max)


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


def build(
    cp_model: Any,
    expansion: Expansion,
    model: TaskModel,
    chains: Iterable[Chain],
    max_parts: int,
    form: type[Form],
    tick: Duration | None = None,
) -> Program | None:
    """Write down the program of an expanded mode; None where it would have more than `max_parts` parts.

    A `tick` takes the place of the one on which nothing is lost, which it divides.
    """
    program = Program(cp_model, expansion, max_parts, form, tick or exact_tick(expansion))
    try:
        program.state_jobs()
        program.state_demands()
        program.state_units([unit.name for unit in model.units])
        program.state_resources()
        program.state_precedence()
        for chain in chains:
            program.state_chain(chain)
    except TooLarge:
        return None
    return program


class Program:
    """The variables of a mode and its constraints; one method per rule."""

    def __init__(self, cp_model: Any, expansion: Expansion, max_parts: int, form: type[Form], tick: Duration) -> None:
        self.cp = cp_model.CpModel()
        self.form = form
        self.expansion = expansion
        self.tick = tick
        self.total = expansion.hyperperiod // self.tick
        self.tasks: dict[str, list[JobVars]] = {}
        self.phases: dict[str, Any] = {}
        self._left = max_parts
        self._far = 0  # how far the times of the chain at hand may lie from 0

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

    def _int(self, low: int, high: int) -> Any:
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

    def _turned_to_zero(self) -> ActiveTask | None:
        """Return the task whose phase may be taken as 0: without offsets, a valid schedule may be turned."""
        periodic = [active for active in self.expansion.tasks if active.task.period is not None]
        if self.form.names_matter or any(active.task.offset is not None for active in periodic):
            return None
        return max(periodic, key=lambda active: active.task.period or ZERO, default=None)

    def _phase(self, active: ActiveTask, is_zero: bool) -> Any:
        """Return s; s and s + D differ in the numbers of the jobs only, so it lies in [0, D)."""
        task = active.task
        if task.period is None or is_zero:
            return 0
        if task.offset is not None:
            return self.ticks(task.offset % task.period)
        return self._int(0, self.ticks(task.period) - 1)

    def _job(self, active: ActiveTask, index: int) -> JobVars:
        late = {version.name: self.lateness(active, version) for version in active.versions}
        most = max(late.values(), default=0)
        delay = self._int(0, most) if active.task.period is not None and most > 0 else 0
        theta, latest = self._theta(active, index, delay, most)
        job = JobVars(active, index, theta, 1 if not active.demands else self.literal(), latest)
        lone = len(active.versions) == 1
        for version in active.versions:
            chosen = job.present if lone else self.literal()
            job.versions.append((version, chosen))
            if late[version.name] < 0 or not self._fits(version):
                self.cp.add(chosen == 0)
            elif 0 <= late[version.name] < most:
                self.cp.add(delay <= late[version.name]).only_enforce_if(chosen)
        if not lone:
            self.cp.add(sum(chosen for _, chosen in job.versions) == job.present)
        job.wcet = self._wcet(job)
        if not self.form.is_circle:
            self.cp.add(job.theta + job.wcet <= self.total)
        return job

    def lateness(self, active: ActiveTask, version: Version) -> int:
        """Return the largest delta that slack and deadline allow; negative where not even 0 is allowed."""
        task = active.task
        if task.period is None or version.wcet is None:
            return 0
        deadline = task.period if task.deadline is None else task.deadline
        return min(self.ticks(task.period * task.slack), self.ticks(deadline) - self.ticks(version.wcet))

    def _fits(self, version: Version) -> bool:
        """Tell whether the version can run at all: within the hyperperiod, with its predecessors."""
        by_name = self.expansion.by_name
        has_all = all(row.task in by_name and by_name[row.task].jobs for row in version.precedences)
        return has_all and version.wcet is not None and 0 < self.ticks(version.wcet) <= self.total

    def _theta(self, active: ActiveTask, index: int, delay: Any, most: int) -> tuple[Any, int]:
        """Return the start in [0, t_P), s + j * D + delta, taken back once where it passes the end; and its maximum."""
        task = active.task
        if task.period is None:
            return self._int(0, self.total - 1), self.total - 1
        period = self.ticks(task.period)
        phase = self.phases[active.name]
        start = phase + index * period + delay
        latest = (phase if isinstance(phase, int) else period - 1) + index * period + max(0, most)
        if latest < self.total and isinstance(delay, int):
            return start, latest
        theta = self._int(0, self.total - 1)  # a variable of its own: an interval starts at one, plus a constant
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
                wanting = [c for v, c in demander.versions if demands_for(v, active.name) > demand.slot]
                self.cp.add(job.present == sum(wanting))

    # ---- unit, exclusive

    def state_units(self, units: list[str]) -> None:
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

    def _state_window(self, active: ActiveTask, taken: list[tuple[JobVars, Any]], row: Precedence) -> None:
        low, high = self.ticks(row.min), self.ticks(row.max)
        high = min(high, low + self.total - 1)
        before = self.expansion.by_name[row.task]
        wcet = 0 if row.anchor is Anchor.START else self.uniform_wcet(before)
        if before.task.period is None or not self.is_strict(before) or wcet is None:
            for job, chosen in taken:
                self._state_served(job, chosen, row, low, high)
            return
        # Its instants are a period apart, so that one number of periods says which of them is meant.
        period, phase = self.ticks(before.task.period), self.phases[row.task]
        point, latest = phase + wcet, (phase if isinstance(phase, int) else period - 1) + wcet
        if (
            active.task.period is not None
            and self.is_strict(active)
            and active.task.period % before.task.period == ZERO
        ):
            # All jobs lie in the same way to those of the predecessor, so that the window of one is that of all.
            first = taken[0][0]
            held = taken[0][1] if len(taken) == 1 or isinstance(taken[0][1], int) else self.literal()
            for _, chosen in taken:
                if held is not chosen and not isinstance(held, int):
                    self.cp.add_implication(chosen, held)
            self._within(first.theta, first.latest, point, latest, low, high, period, held)
            return
        for job, chosen in taken:
            self._within(job.theta, job.latest, point, latest, low, high, period, chosen)

    def _state_served(self, job: JobVars, chosen: Any, row: Precedence, low: int, high: int) -> None:
        """Say which job of a predecessor without a strict period serves this one."""
        serving = []
        for other in self.tasks[row.task]:
            serves = self.literal()
            serving.append(serves)
            point = other.theta + (other.wcet if row.anchor is Anchor.END else 0)
            self._within(job.theta, job.latest, point, 2 * self.total, low, high, self.total, serves)
            self.cp.add(other.present == 1).only_enforce_if(serves)
        self.cp.add_bool_or(serving).only_enforce_if(chosen)

    def _within(
        self, start: Any, latest: int, point: Any, latest_point: int, low: int, high: int, period: int, when: Any
    ) -> None:
        """Let start - point lie in [low, high], up to some multiple of `period`; both begin at 0 at the earliest."""
        least, most = -((latest - low) // period), (high + latest_point) // period
        turns = self._int(least, max(least, most))  # of windows that are empty, the constraint says so
        self.cp.add_linear_constraint(start - point + period * turns, low, high).only_enforce_if(when)

    # ---- chain

    def state_chain(self, chain: Chain) -> None:
        """Follow every job's data through the chain: forward for the reaction time, back for the data age."""
        if (chain.max_reaction is None and chain.max_age is None) or not all(t in self.tasks for t in chain.tasks):
            return
        if chain.max_reaction is not None:
            self._limit(self._reactions(chain), self.ticks(chain.max_reaction))
        if chain.max_age is not None:
            self._limit(self._ages(chain), self.ticks(chain.max_age))

    def minimise(self, chains: Mapping[Chain, int], most: int, floors: Iterable[tuple[Sequence[Chain], int]]) -> None:
        """Ask for the least sum of reaction times and data ages, each times a whole weight, of at most `most` ticks.

        `floors` say of groups of chains that their part of the sum is no less, which the solver need not prove.
        """
        parts: dict[Chain, Any] = {}
        for chain, weight in chains.items():
            parts[chain] = 0
            for latencies in (self._reactions(chain), self._ages(chain)):
                worst = self._int(0, 2 * self.total * (len(chain.tasks) + 2))
                self._limit(latencies, worst)
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

    def _limit(self, latencies: Iterable[tuple[Any, Any]], limit: Any) -> None:
        latencies = list(latencies)
        self.cp.add_bool_or([present for _, present in latencies])
        for latency, present in latencies:
            self.cp.add(latency <= limit).only_enforce_if(present)

    def _reactions(self, chain: Chain) -> Iterator[tuple[Any, Any]]:
        """Yield the reaction time from each job of the first task, and whether the job is there."""
        self._far = 2 * self.total * (len(chain.tasks) + 2)  # every step waits and runs at most a hyperperiod each
        for job in self._distinct(chain, chain.tasks[0]):
            time = job.theta + 1
            for task in chain.tasks:
                time = self._next_end(time, task, job.present)
            yield time - job.theta, job.present

    def _ages(self, chain: Chain) -> Iterator[tuple[Any, Any]]:
        """Yield the data age at each job of the last task, and whether the job is there."""
        self._far = 2 * self.total * (len(chain.tasks) + 2)
        for job in self._distinct(chain, chain.tasks[-1]):
            time = job.theta
            for task in chain.tasks[-2::-1]:
                time = self._last_start(time, task, job.present)
            yield job.theta + job.wcet - time, job.present

    def _distinct(self, chain: Chain, task: str) -> list[JobVars]:
        """Return the jobs of a task that see the chain differently: fewer than all where its tasks are rigid."""
        members = [self.expansion.by_name[name] for name in chain.tasks]
        if not all(map(self._is_rigid, members)):
            return self.tasks[task]
        periods = [self.ticks(member.task.period or ZERO) for member in members]
        return self.tasks[task][: math.lcm(*periods) // self.ticks(self.expansion.by_name[task].task.period or ZERO)]

    def _is_rigid(self, active: ActiveTask) -> bool:
        """Tell whether the jobs of a task are exactly a period apart and equally long."""
        return active.jobs > 0 and self.is_strict(active) and self.uniform_wcet(active) is not None

    def _next_end(self, since: Any, task: str, when: Any) -> Any:
        """Return the end of the first job of `task` that starts at or after `since`; of equal ones the first in number.

        (D) of verify: where jobs of one task start together, the lower index is the earlier one.
        """
        active = self.expansion.by_name[task]
        if self._is_rigid(active):
            return since + self._turned(self.phases[task] - since, active) + self.uniform_wcet(active)
        jobs = self.tasks[task]
        waits = [self._remainder(job.theta - since) for job in jobs]
        keys = [wait * len(jobs) + number for number, wait in enumerate(waits)]
        ends = [since + wait + job.wcet for job, wait in zip(jobs, waits, strict=True)]
        return self._chosen(jobs, keys, ends, when, self.total * len(jobs))

    def _last_start(self, until: Any, task: str, when: Any) -> Any:
        """Return the start of the job of `task` that ended last at or before `until`; of equal ones the later start."""
        active = self.expansion.by_name[task]
        if self._is_rigid(active):
            wcet = self.uniform_wcet(active)
            return until - self._turned(until - self.phases[task] - wcet, active) - wcet
        jobs = self.tasks[task]
        longest = max((self.ticks(v.wcet or ZERO) for job in jobs for v, _ in job.versions), default=0)
        ages = [self._remainder(until - job.theta - job.wcet) for job in jobs]
        keys = [age * (longest + 1) + job.wcet for job, age in zip(jobs, ages, strict=True)]
        starts = [until - age - job.wcet for job, age in zip(jobs, ages, strict=True)]
        return self._chosen(jobs, keys, starts, when, self.total * (longest + 1) + longest)

    def _turned(self, time: Any, active: ActiveTask) -> Any:
        """Return `time` modulo the period of a task."""
        return self._remainder(time, self.ticks(active.task.period or ZERO))

    def _remainder(self, time: Any, modulus: int = 0) -> Any:
        """Return `time` modulo the hyperperiod, or what is given."""
        modulus = modulus or self.total
        most = self._far // modulus + 2
        rest, turns = self._int(0, modulus - 1), self._int(-most, most)
        self.cp.add(rest == time + modulus * turns)
        return rest

    def _chosen(self, jobs: list[JobVars], keys: list[Any], values: list[Any], when: Any, most: int) -> Any:
        """Return the value of the present job with the smallest key."""
        best, value = self._int(0, most), self._int(-self._far, self._far)
        picks = []
        for job, key, its in zip(jobs, keys, values, strict=True):
            pick = self.literal()
            picks.append(pick)
            self.cp.add(best == key).only_enforce_if(pick)
            self.cp.add(value == its).only_enforce_if(pick)
            self.cp.add(job.present == 1).only_enforce_if(pick)
            self.cp.add(best <= key).only_enforce_if([job.present, when])
        self.cp.add(sum(picks) == when)
        return value

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
