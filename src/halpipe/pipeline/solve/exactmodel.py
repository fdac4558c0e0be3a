"""The constraint program of the exact engine: variables and constraints of one mode, rule by rule (MODEL 3).

Times are whole ticks. The tick divides every duration that bounds a start, slack * D and deadlines included; on such a
grid a system of orders and distances has a solution exactly if it has one at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import chain as concatenated
from typing import TYPE_CHECKING, Any

from halpipe.durations import ZERO, Duration, greatest_common_divisor
from halpipe.models import Anchor, Job
from halpipe.pipeline.jobs import demands_for

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Chain, Precedence, TaskModel, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion

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
    versions: list[tuple[Version, Any]] = field(default_factory=list)
    units: list[tuple[Version, str, Any]] = field(default_factory=list)
    wcet: Any = 0


def build(
    cp_model: Any, expansion: Expansion, model: TaskModel, chains: Iterable[Chain], max_parts: int
) -> Program | None:
    """Write down the program of an expanded mode; None where it would have more than `max_parts` parts."""
    program = Program(cp_model, expansion, max_parts)
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

    def __init__(self, cp_model: Any, expansion: Expansion, max_parts: int) -> None:
        self.cp = cp_model.CpModel()
        self.expansion = expansion
        self.tick = exact_tick(expansion)
        self.total = expansion.hyperperiod // self.tick
        self.tasks: dict[str, list[JobVars]] = {}
        self.phases: dict[str, Any] = {}
        self._left = max_parts
        self._far = 0  # how far the times of the chain at hand may lie from 0

    def ticks(self, duration: Duration) -> int:
        """Return whole ticks; exact for all that the tick divides, rounded down for limits."""
        return duration // self.tick

    def _spend(self, parts: int = 1) -> None:
        self._left -= parts
        if self._left < 0:
            raise TooLarge

    def _int(self, low: int, high: int) -> Any:
        self._spend()
        return self.cp.new_int_var(low, high, "")

    def _bool(self) -> Any:
        self._spend()
        return self.cp.new_bool_var("")

    # ---- version, periodic, deadline

    def state_jobs(self) -> None:
        """Every job has a start; periodic ones at their phase, their number of periods, and their delay."""
        anchor = self._turned_to_zero()
        for active in self.expansion.tasks:
            self.phases[active.name] = self._phase(active, active is anchor)
            self.tasks[active.name] = [self._job(active, index) for index in range(active.jobs)]

    def _turned_to_zero(self) -> ActiveTask | None:
        """Return the task whose phase may be taken as 0: without offsets, a valid schedule may be turned."""
        periodic = [active for active in self.expansion.tasks if active.task.period is not None]
        if any(active.task.offset is not None for active in periodic):
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
        job = JobVars(active, index, self._theta(active, index, delay, most), 1 if not active.demands else self._bool())
        lone = len(active.versions) == 1
        for version in active.versions:
            chosen = job.present if lone else self._bool()
            job.versions.append((version, chosen))
            if late[version.name] < 0 or not self._fits(version):
                self.cp.add(chosen == 0)
            elif 0 <= late[version.name] < most:
                self.cp.add(delay <= late[version.name]).only_enforce_if(chosen)
        if not lone:
            self.cp.add(sum(chosen for _, chosen in job.versions) == job.present)
        job.wcet = self._wcet(job)
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

    def _theta(self, active: ActiveTask, index: int, delay: Any, most: int) -> Any:
        """Return the start in [0, t_P): s + j * D + delta, taken back once where it passes the end."""
        task = active.task
        if task.period is None:
            return self._int(0, self.total - 1)
        period = self.ticks(task.period)
        phase = self.phases[active.name]
        start = phase + index * period + delay
        latest = (phase if isinstance(phase, int) else period - 1) + index * period + max(0, most)
        if latest < self.total and isinstance(delay, int):
            return start
        theta = self._int(0, self.total - 1)  # a variable of its own: an interval starts at one, plus a constant
        self.cp.add(theta == start - self.total * (self._bool() if latest >= self.total else 0))
        return theta

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
        """A job takes as many of its version's units as its gang; the jobs of a unit never overlap on the circle."""
        on_unit: dict[str, list[Any]] = {name: [] for name in units}
        first_use = _FirstUse(self.expansion, units)
        for job in concatenated.from_iterable(self.tasks.values()):
            reach = first_use.reach(job)
            for version, chosen in job.versions:
                names = [name for name in dict.fromkeys(version.units) if name in on_unit]
                taken = [chosen if len(names) == version.gang == 1 else self._bool() for _ in names]
                if taken != [chosen]:
                    self.cp.add(sum(taken) == version.gang * chosen)
                for name, literal in zip(names, taken, strict=True):
                    job.units.append((version, name, literal))
                    on_unit[name] += self._twice(job.theta, self.ticks(version.wcet or ZERO), literal)
                    if not first_use.allows(name, reach):
                        self.cp.add(literal == 0)
        for intervals in on_unit.values():
            self.cp.add_no_overlap(intervals)
        self._state_group_loads(first_use.groups)

    def _twice(self, start: Any, length: int, literal: Any) -> list[Any]:
        """Return a job's part as two intervals a hyperperiod apart: on [0, t_P) they show all of it."""
        self._spend(2)
        return [
            self.cp.new_optional_fixed_size_interval_var(start + shift, length, literal, "")
            for shift in (0, -self.total)
        ]

    def _state_group_loads(self, groups: list[list[str]]) -> None:
        """Say once more, for units that are treated alike, how many jobs they hold at once: it shortens proofs."""
        for group in groups:
            if len(group) < 2:
                continue
            intervals, heights = [], []
            for job in concatenated.from_iterable(self.tasks.values()):
                for version, chosen in job.versions:
                    if set(version.units) == set(group):
                        intervals += self._twice(job.theta, self.ticks(version.wcet or ZERO), chosen)
                        heights += [version.gang] * 2
            self.cp.add_cumulative(intervals, heights, len(group))

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
                intervals += self._twice(job.theta + start, end - start, chosen)
                heights += [int(access.bound * quanta)] * 2
            if all(2 * height > quanta for height in heights):
                self.cp.add_no_overlap(intervals)
            else:
                self.cp.add_cumulative(intervals, heights, quanta)

    # ---- precedence

    def state_precedence(self) -> None:
        """Every constraint of the version that a job takes has a predecessor in its window."""
        for job in concatenated.from_iterable(self.tasks.values()):
            for version, chosen in job.versions:
                if self._fits(version):
                    for row in version.precedences:
                        self._state_window(job, chosen, row)

    def _state_window(self, job: JobVars, chosen: Any, row: Precedence) -> None:
        low, high = self.ticks(row.min), self.ticks(row.max)
        high = min(high, low + self.total - 1)
        before = self.expansion.by_name[row.task]
        wcet = 0 if row.anchor is Anchor.START else self.uniform_wcet(before)
        if before.task.period is not None and self.is_strict(before) and wcet is not None:
            # Its instants are a period apart, so that one number of periods says which of them is meant.
            period = self.ticks(before.task.period)
            self._within(job.theta, self.phases[row.task] + wcet, low, high, period, [chosen])
            return
        serving = []
        for other in self.tasks[row.task]:
            serves = self._bool()
            serving.append(serves)
            point = other.theta + (other.wcet if row.anchor is Anchor.END else 0)
            self._within(job.theta, point, low, high, self.total, [serves])
            self.cp.add(other.present == 1).only_enforce_if(serves)
        self.cp.add_bool_or(serving).only_enforce_if(chosen)

    def _within(self, start: Any, point: Any, low: int, high: int, period: int, when: list[Any]) -> None:
        """Let start - point lie in [low, high], up to some multiple of `period`."""
        reach = (2 * self.total + high) // period + 2
        turns = self._int(-reach, reach)
        self.cp.add_linear_constraint(start - point + period * turns, low, high).only_enforce_if(when)

    # ---- chain

    def state_chain(self, chain: Chain) -> None:
        """Follow every job's data through the chain: forward for the reaction time, back for the data age."""
        if (chain.max_reaction is None and chain.max_age is None) or not all(t in self.tasks for t in chain.tasks):
            return
        first, last = self.tasks[chain.tasks[0]], self.tasks[chain.tasks[-1]]
        self._far = 2 * self.total * (len(chain.tasks) + 2)  # every step waits and runs at most a hyperperiod each
        if chain.max_reaction is not None:
            self.cp.add_bool_or([job.present for job in first])
            for job in first:
                time = job.theta + 1
                for task in chain.tasks:
                    time = self._next_end(time, task, job.present)
                self._limit(time - job.theta, chain.max_reaction, job.present)
        if chain.max_age is not None:
            self.cp.add_bool_or([job.present for job in last])
            for job in last:
                time = job.theta
                for task in chain.tasks[-2::-1]:
                    time = self._last_start(time, task, job.present)
                self._limit(job.theta + job.wcet - time, chain.max_age, job.present)

    def _limit(self, latency: Any, limit: Duration, present: Any) -> None:
        self.cp.add(latency <= self.ticks(limit)).only_enforce_if(present)

    def _next_end(self, since: Any, task: str, when: Any) -> Any:
        """Return the end of the first job of `task` that starts at or after `since`; of equal ones the first in number.

        (D) of verify: where jobs of one task start together, the lower index is the earlier one.
        """
        jobs = self.tasks[task]
        waits = [self._remainder(job.theta - since) for job in jobs]
        keys = [wait * len(jobs) + number for number, wait in enumerate(waits)]
        ends = [since + wait + job.wcet for job, wait in zip(jobs, waits, strict=True)]
        return self._chosen(jobs, keys, ends, when, self.total * len(jobs))

    def _last_start(self, until: Any, task: str, when: Any) -> Any:
        """Return the start of the job of `task` that ended last at or before `until`; of equal ones the later start."""
        jobs = self.tasks[task]
        longest = max((self.ticks(v.wcet or ZERO) for job in jobs for v, _ in job.versions), default=0)
        ages = [self._remainder(until - job.theta - job.wcet) for job in jobs]
        keys = [age * (longest + 1) + job.wcet for job, age in zip(jobs, ages, strict=True)]
        starts = [until - age - job.wcet for job, age in zip(jobs, ages, strict=True)]
        return self._chosen(jobs, keys, starts, when, self.total * (longest + 1) + longest)

    def _remainder(self, time: Any) -> Any:
        """Return `time` modulo the hyperperiod."""
        most = self._far // self.total + 2
        rest, turns = self._int(0, self.total - 1), self._int(-most, most)
        self.cp.add(rest == time + self.total * turns)
        return rest

    def _chosen(self, jobs: list[JobVars], keys: list[Any], values: list[Any], when: Any, most: int) -> Any:
        """Return the value of the present job with the smallest key."""
        best, value = self._int(0, most), self._int(-self._far, self._far)
        picks = []
        for job, key, its in zip(jobs, keys, values, strict=True):
            pick = self._bool()
            picks.append(pick)
            self.cp.add(best == key).only_enforce_if(pick)
            self.cp.add(value == its).only_enforce_if(pick)
            self.cp.add(job.present == 1).only_enforce_if(pick)
            self.cp.add(best <= key).only_enforce_if([job.present, when])
        self.cp.add(sum(picks) == when)
        return value

    # ---- answer

    def jobs(self, solver: Any) -> Iterator[Job]:
        """Yield the jobs of a solution with names and exact times."""
        for job in concatenated.from_iterable(self.tasks.values()):
            for version, chosen in job.versions:
                if solver.value(chosen):
                    start = self.tick * int(solver.value(job.theta))
                    yield Job(
                        task=job.active.name,
                        index=job.index,
                        start=start,
                        end=start + (version.wcet or ZERO),
                        version=version.name,
                        units=tuple(name for v, name, x in job.units if v is version and solver.value(x)),
                    )


class _FirstUse:
    """Of units that are treated alike, only the order in which jobs first use them may be fixed: it changes names only.

    The first job takes the first units of a group, and every later one at most as many further as its gang needs.
    """

    def __init__(self, expansion: Expansion, units: list[str]) -> None:
        versions = [version for active in expansion.tasks for version in active.versions]
        members: dict[tuple[int, ...], list[str]] = {}
        for name in units:
            users = tuple(number for number, version in enumerate(versions) if name in version.units)
            if users:
                members.setdefault(users, []).append(name)
        self.groups = list(members.values())
        self._place = {name: (number, at) for number, group in enumerate(self.groups) for at, name in enumerate(group)}
        self._seen = [0] * len(self.groups)

    def reach(self, job: JobVars) -> list[int]:
        """Return how many units of every group the jobs up to this one can have used."""
        gangs = [0] * len(self.groups)
        for version, _ in job.versions:
            for group in {self._place[name][0] for name in version.units if name in self._place}:
                gangs[group] = max(gangs[group], version.gang)
        self._seen = [seen + gang for seen, gang in zip(self._seen, gangs, strict=True)]
        return self._seen

    def allows(self, name: str, reach: list[int]) -> bool:
        """Tell whether the unit is among the first that may be in use by now."""
        group, place = self._place[name]
        return place < reach[group]
