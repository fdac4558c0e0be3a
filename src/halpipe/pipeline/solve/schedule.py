"""Schedules for every mode of a model: expand, search, measure (paper, section III)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from halpipe import __version__
from halpipe.diagnostics import Diagnostic, HalpipeError, about
from halpipe.durations import greatest_common_divisor
from halpipe.models import Binding, Schedule, Status
from halpipe.pipeline.jobs import Expansion, expand, natural_tick
from halpipe.pipeline.measure.metrics import mode_report
from halpipe.pipeline.parts import has_whole_jobs
from halpipe.pipeline.solve.codes import (
    CANNOT_STAY,
    EXACT_ABSENT,
    OTHER_ANSWERED,
)
from halpipe.pipeline.solve.goals import POLISH_BUDGET, Finished, Goals, Quality, polish_of
from halpipe.pipeline.solve.limits import (
    DEFAULT_WORK,
    check_range,
    check_tick,
    cut_options,
    refuse_stuck,
    too_large,
)
from halpipe.pipeline.solve.problem import Problem, build_problem
from halpipe.pipeline.solve.workers import Workers

if TYPE_CHECKING:
    from collections.abc import Mapping
    from fractions import Fraction

    from halpipe.durations import Duration
    from halpipe.models import Job, ModeSchedule, TaskModel
    from halpipe.pipeline.measure.objectives import Objective
    from halpipe.pipeline.solve.goals import Polish
    from halpipe.pipeline.solve.kernel.run_in_slices import Keeper
    from halpipe.pipeline.solve.kernel.search import Outcome
    from halpipe.pipeline.solve.kernel.warmstart import Earlier
    from halpipe.pipeline.solve.optimise import Reached
    from halpipe.pipeline.solve.quantise import BurstGrid

DEFAULT_BUDGET = 20_000
"""Moves per task before the search gives up, where no budget is stated."""

UNBOUNDED = 10**12
"""A budget that no search comes to the end of."""

LEAST_MOVES = 1_000_000
"""Moves that a mode gets at least, where no budget is stated: small sets may be as hard as larger ones."""

DEFAULT_PORTFOLIO = 4
"""Searches of a mode that take turns."""

POLISH_TABLES = 170
"""Whole tables of split jobs that are tried at least to improve a valid one."""


CONSTRUCTING = -1
"""Stands for the best cost while there is no whole placement yet."""

SWITCHES = "switches"
"""Stands for the mode while tables between the modes are looked for; what is counted is mode pairs."""

OnProgress = Callable[[str, int, int, int], bool]
"""Called with mode, moves made, moves allowed and best cost so far; False stops the search.

It is called from several threads.
"""

EXACT, PACKING = "exact", "packing"
"""Engines other than the annealer, by their names in a schedule."""

TURN_SEED = 1000
"""Between the seeds of the exact engine's turns; within one, it counts on from its own."""

EXACT_JOBS = 200
"""Jobs of a mode up to which packing and, where it is installed, the exact engine take turns with the annealer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions:
    """What the user may choose: the outcome depends on the model and on these alone.

    - `budget` counts moves per task; without it there are `DEFAULT_BUDGET`, and `LEAST_MOVES` in all.
    - `tick` replaces the natural tick; `modes` are those to schedule (none: all).
    - `attempt` gives other placements for the same seed, between which switches may exist that the first do not allow.
    - `quality` says what the search goes on for once a schedule is valid, until its cost is at most `target`.
    - `engine` is ``anneal``, or ``exact`` for small systems, which knows neither budget nor tick.
    - `effort` bounds the exact engine, in its own deterministic seconds; None leaves its end to who follows progress.
    - The jobs of a `shipped` schedule stay where they are; of one that is `near`, as many as can. One that it should be
      `like` is tried first.
    - On a `grid`, starts and bounds are those that bandwidth regulators can serve exactly; the stages see to it.
    - `portfolio` searches of a mode take turns once the first has not succeeded quickly.
    - The objectives to `optimise` take the place of `quality`: one before the other, none worse than at first.
    - `on_better` is told of a mode how far its objectives are, whenever a better schedule is found.
    - `keeper` saves the search on its way, or goes on with one that was saved.
    - `workers` are the threads for modes and searches; their number changes the time alone.
    """

    seed: int = 1
    budget: int | None = None
    tick: Duration | None = None
    modes: tuple[str, ...] = ()
    attempt: int = 0
    quality: Quality = Quality.FIRST
    target: Fraction | None = None
    engine: str = "anneal"
    effort: float | None = DEFAULT_WORK
    shipped: Schedule | None = None
    near: Schedule | None = None
    like: Schedule | None = None
    grid: BurstGrid | None = None
    portfolio: int = DEFAULT_PORTFOLIO
    optimise: tuple[Objective, ...] = ()
    keeper: Keeper | None = field(default=None, compare=False)
    on_better: Callable[[str, str], None] = field(default=lambda mode, text: None, compare=False)
    workers: Workers = field(default_factory=Workers, compare=False)

    @property
    def is_open(self) -> bool:
        """Whether no budget is stated, so that whatever helps may be tried."""
        return self.budget in (None, UNBOUNDED)

    def by_the_clock(self) -> SearchOptions:
        """Return the same for a search that a clock ends: nothing else does, unless a budget is stated."""
        return replace(self, effort=None, budget=self.budget or UNBOUNDED)

    def moves(self, tasks: int) -> int:
        """Return how many moves the search of a mode with so many tasks may make."""
        if self.budget is not None:
            return self.budget * max(1, tasks)
        return max(LEAST_MOVES, DEFAULT_BUDGET * tasks)


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class _Found:
    """What became of one mode."""

    table: ModeSchedule
    diagnostics: list[Diagnostic]
    moves: int = 0
    stopped: bool = False
    unimproved: bool = False
    engine: str = "anneal"
    reached: tuple[Reached, ...] = ()


def schedule_model(model: TaskModel, options: SearchOptions, on_progress: OnProgress) -> Scheduled:
    """Search a schedule for every mode of a validated model; a mode without one has status ``not-found``."""
    chosen = [mode for mode in model.modes if not options.modes or mode.name in options.modes]
    expansions = [expand(model, mode) for mode in chosen]
    by_number = _Modes(model, expansions, options, on_progress).search()
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


@dataclass(frozen=True, slots=True)
class _Modes:
    """The modes of a model, each searched as soon as the modes are finished from whose placement it starts."""

    model: TaskModel
    expansions: list[Expansion]
    options: SearchOptions
    on_progress: OnProgress

    def search(self) -> dict[int, _Found]:
        """Return what became of every mode, by number; of fewer if the search is stopped.

        What a mode starts from is the same as if the modes were searched in order, so the result is, too.
        """
        found: dict[int, _Found] = {}
        waiting = list(range(len(self.expansions)))
        while waiting and not any(each.stopped for each in found.values()):
            starts = {number: start for number in waiting if (start := self._start(number, found)) is not None}
            ready = list(starts.items()) if self.options.engine != EXACT else list(starts.items())[:1]
            results = self.options.workers.each(self._search_one, ready, lambda each: each.stopped)
            found.update(zip(starts, results, strict=False))
            waiting = [number for number in waiting if number not in found]
        return found

    def _search_one(self, ready: tuple[int, Earlier]) -> _Found:
        number, earlier = ready
        return _schedule_mode(self.model, self.expansions[number], self.options, number, self.on_progress, earlier)

    def _alike(self, expansion: Expansion) -> Earlier:
        """Return where the schedule that is tried first has the tasks of a mode."""
        from halpipe.pipeline.solve.kernel.warmstart import Earlier

        modes = () if self.options.like is None else self.options.like.modes
        found = [job for mode in modes if mode.name == expansion.mode.name for job in mode.jobs]
        return Earlier().and_then(expansion, [job for job in found if job.task in expansion.by_name])

    def _start(self, number: int, found: dict[int, _Found]) -> Earlier | None:
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


def _schedule_mode(
    model: TaskModel,
    expansion: Expansion,
    options: SearchOptions,
    number: int,
    on_progress: OnProgress,
    earlier: Earlier,
) -> _Found:
    if options.engine == EXACT:
        return _solve_mode(model, expansion, options, number, on_progress)
    if any(version.split.is_allowed for active in expansion.tasks for version in active.versions):
        return _schedule_parts(model, expansion, options, number, on_progress, earlier)
    from halpipe.pipeline.solve.exact import is_installed
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept
    from halpipe.pipeline.solve.kernel.search import Effort, search
    from halpipe.pipeline.solve.relay import Memory, Turn, relay

    name = expansion.mode.name
    shipped = _shipped(expansion, options)
    tick = options.tick or _grid(expansion, shipped)
    pinned = _pinned(expansion, earlier)
    problem = _problem(model, expansion, tick, pinned=pinned)
    polish = _polish(model, expansion, options, number)
    budget, tasks = options.moves(len(expansion.tasks)), len(expansion.tasks)
    may_ask = options.is_open and tick is None and expansion.job_count <= EXACT_JOBS and has_whole_jobs(model)
    asks_exact = may_ask and is_installed()
    keeper = Memory(options.keeper) if may_ask else options.keeper

    def chained() -> Problem:
        return _problem(model, expansion, tick, every_chain=True, pinned=pinned)

    def finished(jobs: tuple[Job, ...], *, is_cut: bool = False) -> Finished:
        if polish is None or not options.optimise:
            return Finished(jobs)
        from halpipe.pipeline.solve.optimise import finish

        is_free = not shipped and tick is None and not pinned and not is_cut
        return finish(
            polish,
            jobs,
            _mode_seed(options.seed, number, options.attempt),
            lambda: on_progress(name, 0, budget, 0),
            is_free=is_free,
        )

    def look(moves: int) -> Outcome:
        return search(
            problem,
            lambda: _problem(model, expansion, tick, grouped=False, pinned=pinned),
            _mode_seed(options.seed, number, options.attempt),
            moves,
            lambda made, best: on_progress(name, made, budget, best),
            earlier,
            None if polish is None else (polish, chained),
            shipped,
            None if keeper is None else Kept(keeper, f"{options.attempt}/{number}"),
            Effort(options.portfolio, options.workers),
        )

    def seed_of(turn: Turn) -> int:
        return (_mode_seed(options.seed, number, options.attempt) + turn.number * TURN_SEED) % 2**31

    def ask_packing(outcome: Outcome, turn: Turn) -> tuple[Job, ...] | None:
        from halpipe.pipeline.solve.packing import pack

        go_on = lambda: on_progress(name, outcome.moves, budget, outcome.cost)  # noqa: E731
        return pack(model, expansion, seed_of(turn), turn.fillings, go_on)

    def ask_exact(outcome: Outcome, turn: Turn) -> tuple[Job, ...] | None:
        from halpipe.pipeline.solve.exact import Effort as ExactEffort
        from halpipe.pipeline.solve.exact_member import solve_after

        go_on = lambda: on_progress(name, outcome.moves, budget, outcome.cost)  # noqa: E731
        effort = ExactEffort(work=turn.work, seed=seed_of(turn), go_on=go_on, workers=options.workers.count)
        return solve_after(model, expansion, effort)

    if may_ask:
        others = {PACKING: ask_packing, **({EXACT: ask_exact} if asks_exact else {})}
        outcome, engine, jobs = relay(look, others, replace(options, budget=None).moves(tasks), budget)
    else:
        outcome, engine, jobs = look(budget), "", ()
    notes = cut_options(problem) + _changed(expansion, outcome.changed)
    path, at = f'mode "{name}"', expansion.mode.at
    if engine:
        notes.append(OTHER_ANSWERED(f"the answer is that of: {engine}", at=at, path=path))
        end = finished(jobs)
        table = mode_report(model, expansion, end.jobs, Status.VALID)
        return _Found(table, notes, outcome.moves, unimproved=end.stopped, engine=engine, reached=end.reached)
    if may_ask and not asks_exact and outcome.cost:
        help = "pip install 'halpipe[exact]'"
        notes.append(EXACT_ABSENT("the exact engine was not asked", at=at, path=path, help=help))
    on_progress(name, outcome.moves, budget, outcome.cost)
    status = Status.VALID if outcome.cost == 0 else Status.NOT_FOUND
    if outcome.cost:
        return _Found(mode_report(model, expansion, outcome.jobs, status), notes, outcome.moves, outcome.stopped)
    end = finished(outcome.jobs, is_cut=outcome.unimproved)
    table = mode_report(model, expansion, end.jobs, status)
    cut = outcome.unimproved or end.stopped
    return _Found(table, notes, outcome.moves, outcome.stopped, cut, reached=end.reached)


def _schedule_parts(
    model: TaskModel,
    expansion: Expansion,
    options: SearchOptions,
    number: int,
    on_progress: OnProgress,
    earlier: Earlier,
) -> _Found:
    """Schedule a mode in which jobs may be split: by earliest deadline first over their parts (MODEL 8.3)."""
    from halpipe.pipeline.solve.edf.fixed import fix
    from halpipe.pipeline.solve.edf.search import Effort, search
    from halpipe.pipeline.solve.edf.works import works_of
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept

    name = expansion.mode.name
    check_tick(expansion, options.tick)
    mode = works_of(model, expansion, options.tick or natural_tick(expansion))
    fixed, changed = fix(mode, _shipped(expansion, options))
    mode = replace(mode, fixed=fixed)
    refuse_stuck(
        expansion, [active.name for active, work in zip(expansion.tasks, mode.works, strict=True) if not work.ways]
    )
    tasks = max(1, len(expansion.tasks))
    budget = (options.budget or DEFAULT_BUDGET) * tasks
    polish = _polish(model, expansion, options, number)
    found = search(
        mode,
        model,
        _mode_seed(options.seed, number, options.attempt),
        _pinned(expansion, earlier),
        Effort(
            budget,
            max(POLISH_BUDGET * tasks, POLISH_TABLES * expansion.job_count),
            lambda placed, excess: on_progress(name, placed, budget, excess),
        ),
        polish,
        None if options.keeper is None else Kept(options.keeper, f"{options.attempt}/{number}"),
    )
    on_progress(name, found.placed, budget, found.excess)
    table = mode_report(model, expansion, found.jobs, Status.NOT_FOUND if found.excess else Status.VALID)
    notes = _changed(expansion, changed, "number of jobs, version, units or parts")
    end = Finished(found.jobs)
    if options.optimise and polish is not None and not found.excess:
        from halpipe.pipeline.solve.optimise import finish

        end = finish(polish, found.jobs, 0, lambda: True, is_free=False)
    return _Found(table, notes, found.placed, found.stopped, found.unimproved, reached=end.reached)


def _pinned(expansion: Expansion, earlier: Earlier) -> dict[str, tuple[str, ...]]:
    """Return the units of the tasks that keep to them in all modes, where earlier modes have settled them."""
    bound = {active.name for active in expansion.tasks if active.task.binding is Binding.SYSTEM}
    return {task: units for (task, _), units in earlier.units.items() if task in bound}


def _shipped(expansion: Expansion, options: SearchOptions) -> dict[tuple[str, int], Job]:
    """Return the jobs of this mode that have shipped, by task and index; of tasks that still run here."""
    modes = options.shipped.modes if options.shipped is not None else ()
    jobs = (job for mode in modes if mode.name == expansion.mode.name for job in mode.jobs)
    return {(job.task, job.index): job for job in jobs if job.task in expansion.by_name}


def _grid(expansion: Expansion, shipped: dict[tuple[str, int], Job]) -> Duration | None:
    """Return a tick on which the shipped jobs lie too; None if the natural one does."""
    if not shipped:
        return None
    return greatest_common_divisor([natural_tick(expansion), *(job.start for job in shipped.values())])


def _changed(
    expansion: Expansion, tasks: tuple[str, ...], what: str = "number of jobs, version or units"
) -> list[Diagnostic]:
    path = about(mode=expansion.mode.name)
    text = f"cannot stay as shipped: {what} have changed; it was placed anew"
    return [CANNOT_STAY(text, at=expansion.by_name[task].task.at, path=about(path, task=task)) for task in tasks]


def _solve_mode(
    model: TaskModel, expansion: Expansion, options: SearchOptions, number: int, on_progress: OnProgress
) -> _Found:
    from halpipe.pipeline.solve.exact import Effort
    from halpipe.pipeline.solve.exact_member import solve_alone

    effort = Effort(
        work=options.effort,
        workers=options.workers.count,
        seed=_mode_seed(options.seed, number, options.attempt) % 2**31,
        go_on=lambda: on_progress(expansion.mode.name, 0, 1, CONSTRUCTING),
    )
    jobs = solve_alone(model, expansion, options.tick, effort)
    return _Found(mode_report(model, expansion, jobs, Status.VALID), [], engine=EXACT)


def _polish(model: TaskModel, expansion: Expansion, options: SearchOptions, number: int) -> Polish | None:
    """Return what to improve once the mode is valid: nothing unless asked for."""
    goals = Goals.of(options.quality, options.optimise)
    if goals is None:
        return None
    from halpipe.pipeline.solve.optimise import telling

    seed = _mode_seed(options.seed, number, options.attempt) + 1
    tell = partial(options.on_better, expansion.mode.name)
    return polish_of(model, expansion, goals, options.target, seed, telling(goals, tell))


def _mode_seed(seed: int, number: int, attempt: int) -> int:
    """Give every mode and attempt its own stream of pseudo-random numbers."""
    return seed + number * 0x5DEECE66D + attempt * 0x2545F4914F


def _problem(
    model: TaskModel,
    expansion: Expansion,
    tick: Duration | None,
    *,
    grouped: bool = True,
    every_chain: bool = False,
    pinned: Mapping[str, tuple[str, ...]],
) -> Problem:
    """Build the arrays, refusing what does not fit them."""
    check_tick(expansion, tick)
    resources = [resource.name for resource in model.resources]
    try:
        problem = build_problem(
            expansion,
            model.units,
            resources,
            model.chains,
            tick=tick,
            grouped=grouped,
            every_chain=every_chain,
            pinned=pinned,
        )
    except OverflowError:
        raise HalpipeError(too_large(expansion, tick or natural_tick(expansion))) from None
    _check_options(problem)
    check_range(problem)
    return problem


def _check_options(problem: Problem) -> None:
    arrays = problem.arrays
    refuse_stuck(
        problem.expansion,
        [
            active.name
            for number, active in enumerate(problem.expansion.tasks)
            if arrays.task_option[number] == arrays.task_option[number + 1]
        ],
    )


def _common_tick(expansions: list[Expansion]) -> Duration | None:
    ticks = [natural_tick(expansion) for expansion in expansions]
    return greatest_common_divisor(ticks) if ticks else None
