"""Schedules on the grid of bandwidth regulators: whole windows, whole bursts, so that their export is exact.

A regulator grants whole bursts per window. `quantise` turns a model into one in which every time is a multiple of the
window and every bound a number of bursts out of those that a window has room for, each rounded to the safe side: WCETs
and access phases outward, precedence windows and deadlines inward, bounds up, room down by what regulators overshoot.
A schedule of that model is one of the original, too, when WCETs are put back (`restore`), and verify decides so.

Why it is safe, where it is not obvious:

* A version claims of each window the highest sum of its bounds there, so that the original keeps the rule at every
  instant; and at least what the rule *whole* of the export grants it: the bytes promised within the window, read and
  written, rounded up to bursts. Two jobs of a unit share no window, since starts are on the grid.
* A burst that was shown at the end of a window may pass in the next one, whatever the budget there. So a version claims
  one more window, with a burst, after each stretch of a row. Where that would be after its end, a burst of the row is
  kept for ever, and claims count what they have above it.
* The deadline becomes, over the versions, the smallest C' + floor(deadline - C), with C' the rounded WCET: a start on
  the grid keeps it exactly if it keeps the original.
* A job really ends up to a window before its rounded end, so that windows from the end of a predecessor shrink at the
  far side by the largest such difference.
* Starts are on the grid, so that a job starts after the real end of another exactly if it starts after the rounded one:
  chains run through the same jobs, and their latencies only seem longer.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, about
from halpipe.core.durations import ZERO, Duration, divisors, greatest_common_divisor
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.models import AccessKind, Anchor
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.parts import has_whole_jobs
from halpipe.pipeline.solve import codes
from halpipe.pipeline.solve.codes import GRID_BOUND, GRID_PERIOD, GRID_RESOURCE, GRID_ROOM, GRID_WINDOW

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Access, Job, ModeSchedule, Precedence, Schedule, Task, TaskModel, Version


@record(kw_only=True)
class BurstGrid:
    """The grid of a platform called `name`: a `window`, a multiple of `cycle`; sizes in bytes per window.

    A bound of 1 on `resource` (empty: the only one) promises `promise`; of `capacity`, `reserve` is kept for each unit
    and direction that may use it, for both directions of such units, or for all that are `regulated` (`reserves`:
    ``used``, ``units``, ``all``). With `carries`, a burst shown in one window may pass in the next. Budgets are whole
    bursts of `burst` bytes. Accesses of no kind write if `writes`.
    """

    name: str
    window: Duration
    cycle: Duration
    resource: str
    promise: Fraction
    capacity: int
    burst: int
    reserve: int
    writes: bool = False
    reserves: str = "used"
    regulated: tuple[str, ...] = ()
    carries: bool = False

    def up(self, duration: Duration) -> Duration:
        """Return the next multiple of the window from `duration` on."""
        return self.window * -(-duration // self.window)

    def down(self, duration: Duration) -> Duration:
        """Return the last multiple of the window up to `duration`."""
        return self.window * (duration // self.window)


def served_model(model: TaskModel, grid: BurstGrid, tick: Duration | None) -> TaskModel:
    """Return the model on the grid, as `quantise` does; refuse preemptive jobs and a tick off the grid, too."""
    path = about(model=model.name)
    if not has_whole_jobs(model):
        help = "omit --quantise; the export rounds budgets to the safe side"
        raise HalpipeError(
            codes.GRID_WHOLE("has jobs that may be split or interrupted", at=model.at, path=path, help=help)
        )
    if tick is not None and tick % grid.window:
        near = grid.window * max(1, round(tick / grid.window))
        message = f"the tick {tick} is not a multiple of the window {grid.window} of platform {grid.name}"
        raise HalpipeError(codes.GRID_TICK(message, at=model.at, path=path, help=f"omit --tick, or use {near}"))
    return quantise(model, grid)


def quantise(model: TaskModel, grid: BurstGrid) -> TaskModel:
    """Return the model on the grid; raise `HalpipeError` with everything that cannot be put there, and the numbers."""
    rounding = _Rounding(model, grid)
    tasks = tuple(map(rounding.task, model.tasks))
    rounding.findings.stop_on_errors()
    return replace(model, tasks=tasks)


def restore(model: TaskModel, schedule: Schedule) -> Schedule:
    """Return a schedule of the quantised model as one of the original: real ends, and figures of the original."""

    def mode(table: ModeSchedule) -> ModeSchedule:
        return mode_report(model, expand(model, model.mode(table.name)), with_ends(model, table.jobs), table.status)

    return replace(
        schedule,
        modes=tuple(mode(table) for table in schedule.modes),
        transitions=tuple(replace(table, jobs=with_ends(model, table.jobs)) for table in schedule.transitions),
    )


def with_ends(model: TaskModel, jobs: tuple[Job, ...]) -> tuple[Job, ...]:
    """Return jobs that last as long as their versions in a model; a job without a version there stays as it is."""
    wcets = {(task.name, version.name): version.wcet or ZERO for task in model.tasks for version in task.versions}
    lengths = (wcets.get((job.task, job.version), job.end - job.start) for job in jobs)
    return tuple(replace(job, end=job.start + length) for job, length in zip(jobs, lengths, strict=True))


def too_tight(model: TaskModel, grid: BurstGrid) -> Diagnostic:
    """Return the error that a model has no schedule as the regulators serve it."""
    help = "use longer windows, less overshoot, lower bounds, or omit --quantise"
    return codes.GRID_TIGHT(describe(model, grid), at=model.at, path=about(model=model.name), help=help)


def describe(model: TaskModel, grid: BurstGrid) -> str:
    """Return what the grid makes of the model, in numbers, for people whose model no longer fits."""
    rounding = _Rounding(model, grid)
    full = format_rational(Fraction(int(grid.promise / grid.burst * 100), 100))
    what = "overshoot and bursts carried over" if grid.carries else "overshoot"
    return (
        f"windows of {grid.window} have room for {rounding.free} bursts of {grid.burst} bytes ({grid.capacity} bytes "
        f"less {rounding.kept} for {what}), a bound of 1 is {full}; bounds are rounded up to whole bursts, WCETs and "
        "access phases to whole windows"
    )


# ----------------------------------------------------------------------------------------------- the grid


def _resource(model: TaskModel, grid: BurstGrid) -> str:
    names = [resource.name for resource in model.resources]
    if grid.resource in names:
        return grid.resource
    if not grid.resource and len(names) == 1:
        return names[0]
    help = did_you_mean(grid.resource, names, "name one in the platform, as resource: ...")
    message = f'platform "{grid.name}" regulates "{grid.resource}"; the model has: {", ".join(names) or "no resource"}'
    raise HalpipeError(GRID_RESOURCE(message, at=model.at, path=about(model=model.name), help=help))


def _off_grid(model: TaskModel, grid: BurstGrid) -> Iterator[Diagnostic]:
    """Report the periods and offsets that are no multiples of the window; they cannot be rounded."""
    active = {run.task for mode in model.modes for run in mode.runs}
    stated = [
        (task, what, value)
        for task in model.tasks
        if task.name in active
        for what, value in (("period", task.period), ("offset", task.offset))
        if value
    ]
    for task, what, value in stated:
        if value % grid.window:
            message = f"{what} {value} is not a multiple of the window {grid.window} of platform {grid.name}"
            help = _near(grid, [value for _, _, value in stated])
            yield GRID_PERIOD(message, at=task.at, path=about(task=task.name), help=help)


def _near(grid: BurstGrid, values: list[Duration]) -> str:
    common = greatest_common_divisor(values)
    fitting = divisors(common, grid.cycle)
    near = [w for w in fitting if w < grid.window][-1:] + [w for w in fitting if w > grid.window][:1]
    if not near:
        exact = common / (round(common / grid.window) or 1)
        return f'state "window: {exact}", which divides all periods and offsets and need not be whole cycles'
    named = " or ".join(f"{w / grid.cycle} cycles ({w})" for w in near)
    return f"the nearest windows that divide all periods and offsets are {named}"


# ----------------------------------------------------------------------------------------------- the tasks


class _Rounding:
    """Rounding of a model to a grid, one method for each kind of value; `findings` list what cannot be rounded.

    A window has `free` bursts, beyond the bytes that are `kept`: for overshoot, and for a burst of every row (a unit
    and a direction, True: write) in the `ending` window of some version, so that it outlives it.
    """

    def __init__(self, model: TaskModel, grid: BurstGrid) -> None:
        self.grid = grid
        self.resource = _resource(model, grid)
        self.shrink = {  # by how much a job of the task may really end before its end on the grid
            task.name: max((grid.up(v.wcet) - v.wcet for v in task.versions if v.wcet is not None), default=ZERO)
            for task in model.tasks
        }
        versions = [version for task in model.tasks for version in task.versions]
        used = [(v, access) for v in versions for access in v.accesses if access.resource == self.resource]
        rows = {(unit, self._writes(access)) for version, access in used for unit in version.units}
        last = [(v, a) for v, a in used if v.wcet is not None and grid.up(a.end) >= grid.up(v.wcet)]
        ending = {(unit, self._writes(access)) for version, access in last for unit in version.units}
        self.ending = ending if grid.carries else set()
        reserved = {
            "used": len(rows),
            "units": 2 * len({unit for unit, _ in rows}),
            "all": 2 * len({*grid.regulated} & {unit.name for unit in model.units}),
        }[grid.reserves]
        self.kept = grid.reserve * reserved + grid.burst * len(self.ending)
        self.free = (grid.capacity - self.kept) // grid.burst
        self.room = max(1, self.free)
        self.findings = Findings()
        self.findings.extend(_off_grid(model, grid))
        if self.free < 1:
            self.findings.add(self._no_room(model, len(rows)))

    def _writes(self, access: Access) -> bool:
        return self.grid.writes if access.kind is None else access.kind == AccessKind.WRITE

    def _no_room(self, model: TaskModel, rows: int) -> Diagnostic:
        grid = self.grid
        message = (
            f"a window of {grid.window} carries {grid.capacity} bytes, of which {self.kept} are kept for what {rows} "
            f"units and directions may move above their budgets; that leaves no burst of {grid.burst} bytes"
        )
        least = Fraction(self.kept + grid.burst, grid.capacity) * (grid.window / grid.cycle)
        help = f"use a window of at least {ceil(least)} cycles"
        return GRID_ROOM(message, at=model.at, path=about(platform=grid.name), help=help)

    def task(self, task: Task) -> Task:
        versions = tuple(self._version(task, version) for version in task.versions)
        slack = self.grid.down(task.period * task.slack) / task.period if task.period else task.slack
        return replace(task, versions=versions, deadline=self._deadline(task), slack=slack)

    def _deadline(self, task: Task) -> Duration | None:
        if task.deadline is None:
            return None
        wcets = [version.wcet for version in task.versions if version.wcet is not None]
        kept = [self.grid.up(wcet) + self.grid.down(task.deadline - wcet) for wcet in wcets if wcet <= task.deadline]
        return min(kept, default=task.deadline)

    def _version(self, task: Task, version: Version) -> Version:
        path = about(task=task.name, version=version.name)
        return replace(
            version,
            wcet=None if version.wcet is None else self.grid.up(version.wcet),
            accesses=tuple(self._accesses(version, path)),
            precedences=tuple(self._precedence(row, path) for row in version.precedences),
        )

    def _accesses(self, version: Version, path: str) -> Iterator[Access]:
        """Yield phases on whole windows that claim what the version needs of each resource in each window."""
        for resource in dict.fromkeys(access.resource for access in version.accesses):
            accesses = [access for access in version.accesses if access.resource == resource]
            edges = self._edges(accesses)
            if resource == self.resource and self.grid.carries and version.wcet is not None:
                edges = self._with_seams(accesses, edges, self.grid.up(version.wcet))
            claims = {edge: self._highest(accesses, edge) for edge in edges}
            if resource == self.resource:
                bursts = {edge: self._bursts(accesses, edge, version) for edge in claims}
                self._check_bursts(accesses, bursts, path)
                claims = {edge: max(claims[edge], Fraction(bursts[edge], self.room)) for edge in claims}
            for start, end in pairwise(claims):
                if claims[start]:
                    yield replace(
                        accesses[0],
                        start=start,
                        end=end,
                        bound=claims[start],
                        kind=None,
                        transfers=(),
                    )

    def _edges(self, accesses: list[Access]) -> list[Duration]:
        """Return the window edges around all starts and ends, in order: from each to the next all windows are alike."""
        instants = [instant for access in accesses for instant in (access.start, access.end)]
        return sorted({edge for instant in instants for edge in (self.grid.down(instant), self.grid.up(instant))})

    def _highest(self, accesses: list[Access], start: Duration) -> Fraction:
        """Return the highest sum of bounds at any instant of the window at `start`."""
        instants = [start, *(a.start for a in accesses if start < a.start < start + self.grid.window)]
        return max(sum((a.bound for a in accesses if a.start <= t < a.end), Fraction(0)) for t in instants)

    def _with_seams(self, accesses: list[Access], edges: list[Duration], end: Duration) -> list[Duration]:
        """Return the edges with one a window after the end of each phase, up to the end of the version."""
        after = {self.grid.up(access.end) + self.grid.window for access in accesses}
        return sorted({*edges, *(edge for edge in after if edge <= end)})

    def _bursts(self, accesses: list[Access], start: Duration, version: Version) -> int:
        """Return the bursts of the window at `start` for all units of a gang, beyond those that are kept for its rows.

        Reads and writes are each rounded up; one that has none may use what the window before has left waiting.
        """
        total = 0
        before = self._rounded(accesses, start - self.grid.window, version.gang)
        for writes, bursts in enumerate(self._rounded(accesses, start, version.gang)):
            if not self.grid.carries:
                total += bursts
            elif all((unit, bool(writes)) in self.ending for unit in version.units):
                total += max(0, bursts - 1)
            else:
                total += bursts or min(1, before[writes])
        return version.gang * total

    def _rounded(self, accesses: list[Access], start: Duration, gang: int) -> list[int]:
        """Return the bursts of one unit in the window at `start`: reads, and writes."""
        volumes = [Fraction(0), Fraction(0)]
        for access in accesses:
            overlap = min(access.end, start + self.grid.window) - max(access.start, start)
            if overlap > ZERO:
                volumes[self._writes(access)] += access.bound / gang * self.grid.promise * (overlap / self.grid.window)
        return [ceil(volume / self.grid.burst) for volume in volumes]

    def _check_bursts(self, accesses: list[Access], bursts: dict[Duration, int], path: str) -> None:
        """Report the first window that needs more than there is room for."""
        most = max(bursts.values())
        if most > self.room:
            start = next(edge for edge in bursts if bursts[edge] == most)
            access = next(a for a in accesses if a.end > start and a.start < start + self.grid.window)
            self.findings.add(self._too_wide(access, most, path))

    def _too_wide(self, access: Access, bursts: int, path: str) -> Diagnostic:
        grid = self.grid
        message = (
            f"bound {format_rational(access.bound)} comes to {bursts} bursts of {grid.burst} bytes in a window of "
            f"{grid.window}; there is room for {self.room} after what is kept for overshoot"
        )
        capacity = ceil((grid.capacity + (bursts - self.room) * grid.burst) / grid.window.in_unit("s"))
        bound = access.bound * self.room / bursts
        shown = Fraction(int(bound * 1000), 1000) or bound
        help = f"bind it to at most {format_rational(shown)}, or let the platform have a capacity of {capacity}B/s"
        return GRID_BOUND(message, at=access.at, path=path, help=help)

    def _precedence(self, row: Precedence, path: str) -> Precedence:
        shrink = self.shrink.get(row.task, ZERO) if row.anchor is Anchor.END else ZERO
        low, high = self.grid.up(row.min), self.grid.down(row.max - shrink)
        if low <= high:
            return replace(row, min=low, max=high)
        message = (
            f'window [{row.min}, {row.max}] from the {row.anchor} of "{row.task}" has no distance that is a multiple '
            f"of {self.grid.window}" + (f", its end being known to {shrink} only" if shrink else "")
        )
        help = f"widen it to [{row.min}, {low + shrink}], or use a shorter window in platform {self.grid.name}"
        self.findings.add(GRID_WINDOW(message, at=row.at, path=path, help=help))
        return row
