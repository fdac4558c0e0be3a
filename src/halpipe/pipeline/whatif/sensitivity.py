"""Growth of a WCET until the schedule breaks, and until no schedule is found."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.core.options import Form, option
from halpipe.core.records import record
from halpipe.models import Anchor
from halpipe.models.modes import require_names
from halpipe.pipeline.measure.latency import Measure, members_of, worst_age, worst_latency, worst_reaction
from halpipe.pipeline.parts import parts_of, reserved_length, service_of
from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions
from halpipe.pipeline.validate.context import Context
from halpipe.pipeline.verify import verify
from halpipe.pipeline.whatif import codes
from halpipe.pipeline.whatif.excerpt import Section, Sections
from halpipe.pipeline.whatif.trial import (
    BUDGET,
    WINDOWS,
    Changed,
    Search,
    TrialOptions,
    bracket,
    time_limit,
    with_version_factor,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from fractions import Fraction

    from halpipe.models import Chain, Job, Precedence, Schedule, Task, TaskModel, Version
    from halpipe.pipeline.measure.placement import PlacedJob, Placement


MOST_VERIFIED = 1_000_000
"""Jobs that are verified, one after the other, to see how much all versions can grow."""

BESIDE = 8
"""Jobs that take as long to verify as what verify does beside them."""


@record(kw_only=True)
class SensitivityOptions(TrialOptions):
    """Tasks in question, all where none is named, and whether schedules are searched for."""

    tasks: tuple[str, ...] = option((), "This task only; repeatable.", name="task", metavar="NAME", form=Form.LIST)
    search: bool = option(False, "Look too for schedules with longer WCETs.", form=Form.SWITCH)

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others."""
        return () if self.search else ("step", "seed", "budget", "time_limit")


@record(kw_only=True)
class Searched:
    """The largest WCET with a schedule that was found, and the largest not proven impossible.

    Both are on a grid of shares of the WCET. None: without any limit, because the task can do without the version.
    """

    found: Duration | None
    bound: Duration | None
    failed: tuple[Duration, ...]
    is_cut: bool
    """Whether time ended the search."""


@record(kw_only=True)
class Sensitivity:
    """Margin of the WCET of a version; `growth` is None where the schedule does not use the version."""

    task: str
    version: str
    wcet: Duration
    growth: Duration | None
    reason: str
    searched: Searched | None = None


def sensitivities(model: TaskModel, schedule: Schedule, tasks: frozenset[str]) -> Iterator[Sensitivity]:
    """Yield one row for each version of the named tasks (or all), for a schedule that verifies.

    By `growth` more, and by anything less, the schedule still verifies, with every start where it is; by anything more
    it does not. Where jobs are split or interrupted, serve arrivals, or keep requirements of MODEL 10, and in switches,
    verify itself says so: by a tick more it does not. There the last segment of a preemptive job grows.
    """
    require_names(sorted(tasks), (task.name for task in model.tasks), "task")
    tick = common_tick(model, schedule)
    asked = {(t.name, v.name): v.wcet for t in model.tasks for v in t.versions if not tasks or t.name in tasks}
    limits = _limits(model, schedule, tick, [key for key, wcet in asked.items() if wcet is not None])
    for (task, version), wcet in asked.items():
        if wcet is None:
            continue
        limit = limits.get((task, version))
        yield Sensitivity(
            task=task,
            version=version,
            wcet=wcet,
            growth=None if limit is None else tick * limit.growth,
            reason="" if limit is None else limit.reason,
        )


def _limits(
    model: TaskModel, schedule: Schedule, tick: Duration, asked: list[tuple[str, str]]
) -> dict[tuple[str, str], Limit]:
    """Return the limit of each version that has a job: first what the modes allow, then what the switches do."""
    sections = Sections(model, schedule, tick)
    whole = _has_undisturbed_jobs(model) and not any(True for _ in model.refinements())
    modes = {name: FixedStarts(each, sections.chains) for name, each in sections.placements.items()} if whole else {}
    found = {key: limit for key in asked if (limit := _in_modes(modes, *key)) is not None}
    longest = {mode.name: mode.hyperperiod // tick for mode in schedule.modes}
    cap = max(longest.values(), default=0)
    judge = _Judge(tick, whole=whole)
    judged = [] if whole else zip(sections.modes(), longest.values(), strict=True)
    for section, most in (*judged, *((switch, cap) for switch in sections.switches())):
        for key in filter(section.__contains__, asked):
            found[key] = judge.tightened(found.get(key) or Limit(most, "length of the hyperperiod"), section, key)
    return found


def _in_modes(modes: dict[str, FixedStarts], task: str, version: str) -> Limit | None:
    limits = []
    for name, starts in modes.items():
        limit = starts.limit(task, version)
        if limit is not None:
            limits.append(Limit(limit.growth, f'mode "{name}": {limit.reason}' if len(modes) > 1 else limit.reason))
    return min(limits, key=lambda limit: limit.growth, default=None)


def _has_undisturbed_jobs(model: TaskModel) -> bool:
    """Return whether jobs are neither split nor interrupted, and none serves arrivals."""
    splits = (version.split.is_allowed for task in model.tasks for version in task.versions)
    served = any(unit.interrupts for unit in model.units)
    return not (served or any(splits) or any(task.distance is not None for task in model.tasks))


def grown(
    model: TaskModel, schedule: Schedule, task: str, version: str, growth: Duration
) -> tuple[TaskModel, Schedule]:
    """Return model and schedule with a longer WCET of a version, every start where it was, and no figures reported.

    Of a job with gaps the last part grows.
    """
    units = {unit.name: unit for unit in model.units}

    def longer(v: Version) -> Version:
        return replace(v, wcet=v.wcet + growth) if v.name == version and v.wcet is not None else v

    def later(job: Job) -> Job:
        if (job.task, job.version) != (task, version):
            return job
        *before, last = parts_of(job, model.task(task).version(version))
        done = last.executed_to + growth
        resume = model.task(task).version(version).split.resume if before else ZERO
        end = last.start + reserved_length(resume + done - last.executed_from, service_of(units, job.units))
        parts = (*before, replace(last, executed_to=done, end=end)) if before else ()
        return replace(job, end=end, parts=parts)

    tasks = tuple(replace(t, versions=tuple(map(longer, t.versions))) if t.name == task else t for t in model.tasks)
    modes = tuple(
        replace(
            mode, jobs=tuple(map(later, mode.jobs)), cost=None, margin=None, unit_loads=(), resource_loads=(), chains=()
        )
        for mode in schedule.modes
    )
    tables = tuple(replace(table, jobs=tuple(map(later, table.jobs))) for table in schedule.transitions)
    return replace(model, tasks=tasks), replace(schedule, modes=modes, transitions=tables)


# ------------------------------------------------------------------------------------------------ what verify says


class _Judge:
    """Asks verify, which is the only one to know all rules, about excerpts; `whole`: jobs are in one piece.

    Growth into the next job on a unit is known to break a rule. Whole jobs without requirements of MODEL 10 that meet
    nothing, and whose task is tied to none, break none.
    """

    def __init__(self, tick: Duration, *, whole: bool) -> None:
        self._tick, self._whole, self._verified = tick, whole, 0

    def tightened(self, limit: Limit, section: Section, key: tuple[str, str]) -> Limit:
        """Return the limit of a version, or a tighter one that a mode or a switch gives."""
        room = section.room(*key)
        if self._whole and (room.free is None or room.free >= limit.growth):
            return limit
        if self._whole and room.units is not None and room.free == room.units:
            return Limit(room.units, section.met(room))
        excerpt = section.around(key[0], room)

        def breaks(growth: int, halves: int = 0) -> str:
            return self._fault(grown(*excerpt, *key, self._tick * (2 * growth + halves) / 2))

        most = limit.growth if room.units is None else min(room.units, limit.growth)
        most = next((growth for growth in section.turns(*key, most) if breaks(growth, 1)), most)
        good = bisect_left(range(1, most), True, key=lambda growth: bool(breaks(growth))) if breaks(most) else most
        return limit if good == limit.growth else Limit(good, breaks(good + 1) or breaks(good, 1))

    def _fault(self, system: tuple[TaskModel, Schedule]) -> str:
        schedule = system[1]
        jobs = [len(mode.jobs) for mode in schedule.modes] + [len(table.jobs) for table in schedule.transitions]
        self._verified += BESIDE + sum(jobs)
        if self._verified > MOST_VERIFIED:
            text = f"the growth of all versions takes more than {MOST_VERIFIED} jobs to verify"
            raise HalpipeError(codes.TOO_MANY_JOBS(text, help="name the tasks in question with --task"))
        return next((f"{found.path}: {found.message}" for found in verify(*system) if found.is_error), "")


# ------------------------------------------------------------------------------------------------ search


def with_searches(
    model: TaskModel,
    rows: Iterable[Sensitivity],
    options: SensitivityOptions,
    on_progress: OnProgress,
    go_on: Callable[[], bool] = lambda: True,
) -> list[Sensitivity]:
    """Return the rows with what searches find beyond the schedule, until `on_progress` and `go_on` end them."""
    chosen = SearchOptions(seed=options.seed, budget=options.budget or BUDGET, optimise=())
    search = Search(chosen, on_progress, go_on)
    return [replace(row, searched=searched(model, row, search, options.step)) for row in rows]


def searched(model: TaskModel, row: Sensitivity, search: Search, step: Fraction) -> Searched:
    """Look how far the WCET can grow if everything may move, in steps of a share of the WCET."""
    task = model.task(row.task)
    without = _longest(model, task, row.wcet, step) + 1  # so long that the version cannot be chosen any more
    least = without - (row.growth or ZERO) // (row.wcet * step)

    def factor(number: int) -> Fraction:
        return 1 + step * (without - number)

    def changed(number: int) -> Changed:
        return with_version_factor(model, row.task, row.version, factor(number))

    result = bracket(
        least,
        lambda number: search.proves(changed(number), WINDOWS),
        lambda number: search.finds(changed(number)),
        known=least,
    )

    def wcet(number: int | None) -> Duration | None:
        return row.wcet * factor(number) if number else None

    failed = tuple(w for w in map(wcet, result.failed) if w is not None)
    return Searched(found=wcet(result.found), bound=wcet(result.possible), failed=failed, is_cut=result.is_cut)


def _longest(model: TaskModel, task: Task, wcet: Duration, step: Fraction) -> int:
    """Return how many steps longer than now a WCET may be that deadline and hyperperiods allow."""
    hyperperiods = [mode.hyperperiod or ZERO for mode in Context(model).active if task.name in mode.tasks]
    limit = time_limit(task)
    most = max(hyperperiods, default=ZERO)
    return ((most if limit is None else limit) - wcet) // (wcet * step)


# ------------------------------------------------------------------------------------------------ growth, starts fixed
# Every rule of MODEL 3 that a WCET enters gives a limit of its own: the next start on the unit, the deadline, windows
# that count from the end, limits of chains. Access phases keep their distance from the start, so they say nothing. All
# limits are exact, and at a limit the schedule is still valid.


class Limit(NamedTuple):
    """Largest WCET, in ticks, and the limit beyond it."""

    growth: int
    reason: str


def common_tick(model: TaskModel, schedule: Schedule) -> Duration:
    """Return the largest duration that divides every time that a rule compares."""
    times: list[Duration] = [time for unit in model.units for i in unit.interrupts for time in (i.distance, i.wcet)]
    for task in model.tasks:
        times += [time for time in (task.period, task.offset, task.deadline, task.distance, task.let) if time]
        times += [task.period * task.slack] if task.period is not None else []
        for version in task.versions:
            times += [version.wcet] if version.wcet is not None else []
            times += [*version.split.points, version.split.resume, version.split.min_part or version.split.resume]
            times += [time for row in version.precedences for time in (row.min, row.max, row.point) if time]
            times += [time for access in version.accesses for time in (access.start, access.end)]
    times += [t for c in model.chains for t in (c.max_latency, c.max_reaction, c.max_age) if t is not None]
    jobs = [*(job for mode in schedule.modes for job in mode.jobs), *(j for t in schedule.transitions for j in t.jobs)]
    times += [job.start for job in jobs]
    times += [time for job in jobs for part in job.parts for time in (part.start, part.executed_to)]
    times += [table.length for table in schedule.transitions]
    return greatest_common_divisor(times)


@dataclass(frozen=True)
class FixedStarts:
    """The jobs of one mode, in ticks, each at its start; the schedule of the mode is valid."""

    placement: Placement
    chains: dict[str, list[Chain]]
    """Those with a limit, by task."""

    def limit(self, task: str, version: str) -> Limit | None:
        """Return the tightest limit for a version; None where no job uses it."""
        growing = [job for job in self.placement.by_task.get(task, ()) if job.version.name == version]
        if not growing:
            return None
        limits = [*self._next_on_units(growing), *self._deadline(growing), *self._windows(growing)]
        tightest = min(limits, key=lambda limit: limit.growth)
        return min([tightest, *self._chains(growing, tightest.growth)], key=lambda limit: limit.growth)

    @property
    def _circle(self) -> int:
        return self.placement.hyperperiod

    def _text(self, ticks: int) -> str:
        return str(self.placement.tick * ticks)

    # ---- units

    @cached_property
    def _by_unit(self) -> dict[str, tuple[list[int], list[PlacedJob]]]:
        found = grouped((unit, (job.start, job)) for job in self.placement.jobs for unit in job.units)
        ordered = {unit: sorted(jobs, key=lambda pair: pair[0]) for unit, jobs in found.items()}
        return {unit: ([s for s, _ in jobs], [job for _, job in jobs]) for unit, jobs in ordered.items()}

    def _next_on_units(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        for job in growing:
            for unit in job.units:
                starts, jobs = self._by_unit[unit]
                place = (bisect_left(starts, job.start) + 1) % len(starts)
                distance = (starts[place] - job.start) % self._circle or self._circle
                then = jobs[place]
                reason = f'unit "{unit}": "{then.active.name}" job {then.index} starts at {self._text(then.start)}'
                yield Limit(distance - job.length, reason)

    # ---- deadlines

    def _deadline(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        """Take the phase that leaves most: every phase that suits the slack and the other versions may be meant."""
        task = growing[0].active.task
        limit = time_limit(task)
        if task.period is None or limit is None:
            return
        tick, version = self.placement.tick, growing[0].version.name
        deadline, period, slack = limit // tick, task.period // tick, task.period * task.slack // tick
        jobs = self.placement.by_task[task.name]
        latest = [((job.start - job.index * period) % self._circle, job) for job in jobs]
        best: Limit | None = None
        for phase in self._phases(task, sorted({at for at, _ in latest}), slack):
            rooms = [(deadline - (at - phase) % self._circle - job.length, job) for at, job in latest]
            if all(room >= 0 for room, _ in rooms):
                room, job = min(((r, j) for r, j in rooms if j.version.name == version), key=lambda pair: pair[0])
                if best is None or room > best.growth:
                    best = Limit(room, f"deadline {limit} of job {job.index}")
        if best is not None:
            yield best

    def _phases(self, task: Task, latest: list[int], slack: int) -> Iterator[int]:
        """Yield the phases at which every job lies within its slack."""
        if task.offset is not None and task.period is not None:
            yield task.offset % task.period // self.placement.tick
            return
        for place, phase in enumerate(latest):
            if (latest[place - 1] - phase) % self._circle <= slack:  # the one before is the furthest behind
                yield phase

    # ---- windows

    def _windows(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        """Look at every window that counts from the end of the growing jobs' task."""
        name, version = growing[0].active.name, growing[0].version.name
        moving = sorted(job.end % self._circle for job in growing)
        others = [job for job in self.placement.by_task[name] if job.version.name != version]
        resting = sorted(job.end % self._circle for job in others)
        for job, row in self._needing_end.get(name, ()):
            top = job.start - row.min // self.placement.tick
            width = (row.max - row.min) // self.placement.tick
            if not resting or next(self._before(resting, top)) > width:
                reason = f'window of "{job.active.name}" job {job.index}: [{row.min}, {row.max}] from the end'
                yield Limit(self._reach(moving, top, width), reason)

    @cached_property
    def _needing_end(self) -> dict[str, list[tuple[PlacedJob, Precedence]]]:
        found: dict[str, list[tuple[PlacedJob, Precedence]]] = defaultdict(list)
        for job in self.placement.jobs:
            for row in job.version.precedences:
                if row.anchor is Anchor.END:
                    found[row.task].append((job, row))
        return found

    def _before(self, instants: list[int], top: int) -> Iterator[int]:
        """Yield how far instants lie before `top`, the nearest first, through one hyperperiod."""
        top %= self._circle
        place = bisect_left(instants, top + 1)
        for step in range(1, len(instants) + 1):
            yield (top - instants[place - step]) % self._circle

    def _reach(self, moving: list[int], top: int, width: int) -> int:
        """Return how far the ends may move before none of them lies in [top - width, top] for a moment.

        Each is inside from `distance - width` to `distance`; as long as the next one comes in before, all is well.
        """
        reach = 0
        distances = list(self._before(moving, top))
        for distance in (*distances, distances[0] + self._circle):
            if distance - width > reach:
                return reach
            reach = max(reach, distance)
        return reach

    # ---- chains

    def _chains(self, growing: list[PlacedJob], cap: int) -> Iterator[Limit]:
        by_task = self.placement.by_task
        for chain in self.chains.get(growing[0].active.name, ()):
            if not all(name in by_task for name in chain.tasks):
                continue
            stated = (
                ("latency", chain.max_latency, worst_latency),
                ("reaction time", chain.max_reaction, worst_reaction),
                ("data age", chain.max_age, worst_age),
            )
            for what, limit, measure in stated:
                if limit is not None:
                    most = self._chain_reach(chain, measure, limit // self.placement.tick, growing, cap)
                    if most < cap:
                        cap = most
                        yield Limit(most, f'chain "{chain.name}": {what} {limit}')

    def _chain_reach(self, chain: Chain, measure: Measure, limit: int, growing: list[PlacedJob], cap: int) -> int:
        """Return the largest growth up to `cap` within the limit, by bisection: latencies grow with it."""
        name, version = growing[0].active.name, growing[0].version.name
        tasks = tuple(self.placement.expansion.by_name[each] for each in dict.fromkeys(chain.tasks))
        expansion = replace(self.placement.expansion, tasks=tasks)

        def keeps(growth: int) -> bool:
            jobs = tuple(
                replace(job, length=job.length + growth)
                if (job.active.name, job.version.name) == (name, version)
                else job
                for member in tasks
                for job in self.placement.by_task[member.name]
            )
            members = members_of(replace(self.placement, expansion=expansion, jobs=jobs), chain)
            latency = None if members is None else measure(members, self._circle)
            return latency is not None and latency <= limit

        return cap if keeps(cap) else bisect_left(range(1, cap), True, key=lambda growth: not keeps(growth))
