"""Schedules for every mode of a model: expand, search, measure (paper, section III)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core.durations import greatest_common_divisor
from halpipe.core.options import Form, option, positive_duration, time_limit_of
from halpipe.core.quantities import parse_signed, whole
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.models import Binding, Schedule, Status
from halpipe.pipeline.jobs import Expansion, common_sets, expand, natural_tick
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.parts import reserved_length, service_of
from halpipe.pipeline.solve.limits import DEFAULT_WORK
from halpipe.pipeline.solve.one_mode import ANNEAL, EXACT, Found, schedule_mode, units_of_bound
from halpipe.pipeline.solve.workers import Workers

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Task, TaskModel, Unit, Version
    from halpipe.pipeline.solve.checkpoint import Checkpoint
    from halpipe.pipeline.solve.kernel.warmstart import Earlier
    from halpipe.pipeline.solve.lanes import Pins
    from halpipe.pipeline.solve.optimise import Reached
    from halpipe.pipeline.solve.quantise import BurstGrid

DEFAULT_BUDGET = 20_000
"""Moves per task before the search gives up, where no budget is stated."""

UNBOUNDED = 10**12
"""A budget that no search comes to the end of."""

LEAST_MOVES = 1_000_000
"""Moves that a mode gets at least, where no budget is stated: small sets may be as hard as larger ones."""

SPARE = 80_000
"""Placements of jobs for a margin of all modes together, about 0.2 s."""

LEAST_TABLES, MOST_TABLED = 300, 10_000_000
"""Tables of a mode of preemptive jobs that are tried at least, without a budget; but no more jobs in all of them."""

SWITCHES = "switches"
"""Stands for the mode while tables between the modes are looked for; what is counted is mode pairs."""

OnProgress = Callable[[str, int, int, int], bool]
"""Called with mode, moves made, moves allowed and best cost so far; False stops the search.

It is called from several threads.
"""


def schedule_option(help: str, name: str = "") -> Any:
    """Return a field for a schedule, which users name by its file."""
    return option(None, help, name=name, metavar="FILE", is_path=True, takes=(Schedule,))


@record(kw_only=True)
class PlacementOptions:
    """Options of every search that places jobs: on a `tick`, as in an earlier schedule, on the `grid` of regulators."""

    seed: int = option(1, "Same model, options and seed: same bytes.", whole(0), metavar="N")
    tick: Duration | None = option(
        None,
        "Grid of the start times.",
        positive_duration,
        metavar="TIME",
        otherwise="the largest that loses nothing",
    )
    shipped: Schedule | None = schedule_option(
        "Schedule that has shipped: its jobs keep start, version and units.", name="freeze"
    )
    near: Schedule | None = schedule_option("Earlier schedule: as many jobs as can keep start, version and units.")
    grid: BurstGrid | None = option(
        None,
        "Regulator platform: starts and bounds that it can serve exactly.",
        name="quantise",
        metavar="FILE",
        is_path=True,
    )


@record(kw_only=True)
class SearchOptions(PlacementOptions):
    """Options of the search: the outcome depends on the model and on these alone.

    - `budget` counts moves per task; without it there are `DEFAULT_BUDGET`, and `LEAST_MOVES` in all.
    - `tick` replaces the natural tick; `modes` are those to schedule (none: all).
    - `attempt` gives other placements for the same seed, between which switches may exist that the first do not allow.
    - `engine` is ``anneal``, or ``exact`` for small systems, which knows neither budget nor tick.
    - `effort` bounds the exact engine, in its own deterministic seconds; None leaves its end to who follows progress.
    - The jobs of a `shipped` schedule stay where they are; of one that is `near`, as many as can. One that it should be
      `like` is tried first.
    - Tables of modes and switches that are `settled` stay as they are: nothing that they depend on has changed.
    - On a `grid`, starts and bounds are those that bandwidth regulators can serve exactly; the stages see to it: of the
      model on the grid, all starts are multiples of the `window`.
    - Objectives to `optimise` come one before the other, none worse than at first. A cost F of at most `target` is the
      end of it. Without any, the first schedule stays; where None are stated, its margin is raised with little effort,
      for which each mode may `spare` so many placements of jobs.
    - `on_better` gets a mode and its objectives, whenever a better schedule is found.
    - `keeper` saves the search on its way, or restores one that was saved.
    - `workers` are the threads for modes and groups of tasks; their number changes the time alone.
    """

    budget: int | None = option(
        None,
        "Moves per task before the search gives up.",
        whole(1),
        metavar="N",
        otherwise="20000, and a million in all; with a time limit, none",
    )
    time_limit: Duration | None = option(
        None,
        "Time after which the search gives up, such as 30s; what is found then depends on the machine.",
        time_limit_of,
        metavar="TIME",
        otherwise="none",
        compare=False,
    )
    modes: tuple[str, ...] = option(
        (), "Schedule this mode only; repeatable.", name="mode", metavar="NAME", form=Form.LIST, completes="modes"
    )
    attempt: int = 0
    engine: str = option(ANNEAL, "anneal; or exact, for small systems: CP-SAT.", Words(ANNEAL, EXACT))
    target: Fraction | None = option(
        None, "With cost among the objectives: stop once the cost F is at most this.", parse_signed, metavar="F"
    )
    optimise: tuple[Objective, ...] | None = option(
        None,
        f"Objectives after the first valid schedule, the most important first: {', '.join(Objective)}; or none.",
        Words(*Objective, mean=Objective),
        metavar="LIST",
        form=Form.LIST,
        splits=True,
        otherwise="a margin, with little effort",
    )
    spare: int = SPARE
    effort: float | None = DEFAULT_WORK
    like: Schedule | None = None
    settled: Schedule | None = None
    window: Duration | None = None
    keeper: Checkpoint | None = field(default=None, compare=False)
    on_better: Callable[[str, str], None] = field(default=lambda mode, text: None, compare=False)
    workers: Workers = field(default_factory=Workers, compare=False)

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others; stating one is refused."""
        idle = () if Objective.COST in (self.optimise or ()) else ("target",)
        return (*idle, *(("budget",) if self.engine == EXACT else ()))

    @property
    def is_open(self) -> bool:
        """Whether no budget is stated, so that whatever helps may be tried."""
        return self.budget in (None, UNBOUNDED)

    def on_grid(self) -> SearchOptions:
        """Return the same with the window of the grid; it is the tick where earlier jobs start beside it."""
        if self.grid is None:
            return self
        tables = (mode for schedule in (self.shipped, self.near) if schedule is not None for mode in schedule.modes)
        is_beside = any(job.start % self.grid.window for mode in tables for job in mode.jobs)
        tick = self.tick or (self.grid.window if is_beside else None)
        return replace(self, tick=tick, window=self.grid.window)

    def by_the_clock(self) -> SearchOptions:
        """Return the same for a search that a clock ends: nothing else does, unless a budget is stated."""
        return replace(self, effort=None, budget=self.budget or UNBOUNDED)

    def moves(self, tasks: int) -> int:
        """Return how many moves the search of a mode with so many tasks may make."""
        if self.budget is not None:
            return self.budget * max(1, tasks)
        return max(LEAST_MOVES, DEFAULT_BUDGET * tasks)

    def placements(self, tasks: int, jobs: int) -> int:
        """Return how many preemptive jobs the search of a mode with so many tasks and jobs may place."""
        if self.budget is not None:
            return self.budget * tasks
        return max(DEFAULT_BUDGET * tasks, min(LEAST_TABLES * jobs, MOST_TABLED))


@record
class Scheduled:
    """The schedule and what became of the search for it."""

    schedule: Schedule
    diagnostics: tuple[Diagnostic, ...]
    moves: int
    stopped: bool
    unimproved: bool = False
    """Whether it was stopped while it improved valid schedules."""
    reached: tuple[Reached, ...] = ()
    """What became of the objectives to optimise, by mode."""

    @property
    def is_complete(self) -> bool:
        """Whether every mode asked for has a valid schedule."""
        return not self.stopped and all(mode.status is Status.VALID for mode in self.schedule.modes)


def schedule_model(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Search a schedule for every mode of a validated model; a mode without one has status ``not-found``."""
    chosen = [mode for mode in model.modes if not options.modes or mode.name in options.modes]
    expansions = [expand(model, mode) for mode in chosen]
    common = _common_units(model, options.seed + options.attempt) | _shipped_units(model, options.shipped)
    by_number = _Modes(model, expansions, options, on_progress, common).search()
    found = [by_number[number] for number in sorted(by_number)]
    schedule = Schedule(
        model=model.name,
        model_sha256=model.digest,
        generator=f"halpipe {__version__}",
        solver=", ".join(sorted({each.engine for each in found})) or options.engine,
        seed=options.seed,
        tick=options.tick or _common_tick(expansions),
        modes=tuple(each.table for each in found),
    )
    return Scheduled(
        schedule,
        tuple(diagnostic for each in found for diagnostic in each.diagnostics),
        sum(each.moves for each in found),
        stopped=any(each.stopped for each in found),
        unimproved=any(each.unimproved for each in found),
        reached=tuple(reached for each in found for reached in each.reached),
    )


@record
class _Modes:
    """The modes of a model, each searched as soon as the modes are finished from whose placement it starts."""

    model: TaskModel
    expansions: list[Expansion]
    options: SearchOptions
    on_progress: OnProgress
    common: dict[str, Pins]

    def search(self) -> dict[int, Found]:
        """Return what became of every mode, by number; of fewer if the search is stopped.

        What a mode starts from is the same as if the modes were searched in order, so the result is, too.
        """
        settled = {} if self.options.settled is None else {table.name: table for table in self.options.settled.modes}
        names = [expansion.mode.name for expansion in self.expansions]
        found = {number: Found(settled[name], []) for number, name in enumerate(names) if name in settled}
        waiting, cut = [number for number in range(len(names)) if number not in found], set[int]()
        while waiting and not any(each.stopped for each in found.values()):
            starts = {number: start for number in waiting if (start := self._start(number, found)) is not None}
            cut |= {number for number, each in found.items() if each.unimproved}
            cut |= {number for number in starts if any(self._follows(number, other) for other in cut)}
            ready = [(number, start, number in cut) for number, start in starts.items()]
            ready = ready if self.options.engine != EXACT else ready[:1]
            results = self.options.workers.each(self._search_one, ready, lambda each: each.stopped)
            found.update(zip(starts, results, strict=False))
            waiting = [number for number in waiting if number not in found]
        return found

    def _follows(self, number: int, other: int) -> bool:
        """Whether a mode starts from where an earlier one has their common tasks."""
        names = self.expansions[other].by_name.keys()
        return other < number and not names.isdisjoint(self.expansions[number].by_name)

    def _search_one(self, ready: tuple[int, Earlier, bool]) -> Found:
        number, earlier, follows_cut = ready
        options = replace(self.options, spare=self.options.spare // len(self.expansions))
        if follows_cut:  # a resumed search ends the improvement that was cut short, and starts this mode from there
            options = replace(options, keeper=None)
        return schedule_mode(self.model, self.expansions[number], options, number, self.on_progress, earlier)

    def _alike(self, expansion: Expansion) -> Earlier:
        """Return where the schedule that is tried first has the tasks of a mode."""
        from halpipe.pipeline.solve.kernel.warmstart import Earlier

        modes = () if self.options.like is None else self.options.like.modes
        found = [job for mode in modes if mode.name == expansion.mode.name for job in mode.jobs]
        start = Earlier().and_then(expansion, [job for job in found if job.task in expansion.by_name])
        return replace(start, pins=start.pins | self.common)

    def _start(self, number: int, found: dict[int, Found]) -> Earlier | None:
        """Return where earlier modes put the tasks of this one; None while one that matters is not finished."""
        jobs = {active.name: active.jobs for active in self.expansions[number].tasks}
        earlier = self._alike(self.expansions[number])
        for before in range(number):
            expansion = self.expansions[before]
            shared = [active for active in expansion.tasks if active.name in jobs]
            if not shared:
                continue
            if before not in found:
                return None
            if found[before].table.status is Status.VALID:
                earlier = earlier.and_then(expansion, found[before].table.jobs)
                for active in shared:  # where all its jobs have been, no later mode has a say
                    if not active.demands and active.jobs >= jobs[active.name]:
                        del jobs[active.name]
        return earlier


def _common_tick(expansions: list[Expansion]) -> Duration | None:
    ticks = [natural_tick(expansion) for expansion in expansions]
    return greatest_common_divisor(ticks) if ticks else None


def _common_units(model: TaskModel, turn: int) -> dict[str, Pins]:
    """Return the units that serve in every mode, of tasks bound in the whole system to which modes give unlike ones.

    Of sets for gangs one is taken in `turn`: any of its units serve in every mode, those of several sets do not.
    """
    units = {unit.name: unit for unit in model.units}
    bound = [task for task in model.tasks if task.binding is Binding.SYSTEM]
    narrowed = _fitting if any(unit.interrupts for unit in model.units) else lambda _, version, units: version
    listed = {task.name: {v.name: narrowed(task, v, units) for v in task.versions} for task in bound}
    modes: dict[str, list[list[Version]]] = {name: [] for name in listed}
    for run in (run for mode in model.modes for run in mode.runs if run.task in listed):
        modes[run.task].append([listed[run.task][name] for name in run.versions])
    found: dict[str, Pins] = {}
    for task, versions in modes.items():
        if len({frozenset((v.gang, frozenset(v.units)) for v in each) for each in versions}) > 1:
            common = {v.gang: sorted(map(sorted, common_sets(versions, v.gang))) for v in versions[0]}
            found[task] = {
                gang: frozenset().union(*sets) if gang == 1 else frozenset(sets[turn % len(sets)])
                for gang, sets in common.items()
                if sets
            }
    return found


def _fitting(task: Task, version: Version, units: Mapping[str, Unit]) -> Version:
    """Return a version with those of its units on which a job of it ends in time."""
    if version.wcet is None or task.period is None:
        return version
    room = task.deadline or task.distance or task.period
    room = min(room if task.distance is None else room - task.period, task.let or room)
    found = (name for name in version.units if reserved_length(version.wcet, service_of(units, [name])) <= room)
    return replace(version, units=tuple(found) or version.units)


def _shipped_units(model: TaskModel, shipped: Schedule | None) -> dict[str, Pins]:
    """Return the units of the tasks bound in the whole system whose jobs have shipped in some mode, on one set."""
    return {task: {len(units): units} for task, units in units_of_bound(model, shipped).items() if units}
