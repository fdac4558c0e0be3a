"""Limits of the search: refusals of systems too large for the kernel, and reports of what is not tried."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, HalpipeError, about
from halpipe.core.suggest import counted, few
from halpipe.models import WHOLE
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.solve.codes import (
    ENDLESS,
    NO_OPTION,
    OPTIONS_CUT,
    TICK_DOES_NOT_DIVIDE,
    TOO_LARGE,
    TOO_MANY_STARTS,
)
from halpipe.pipeline.solve.lanes import MAX_OPTIONS_PER_VERSION
from halpipe.pipeline.solve.problem import Problem, build_problem
from halpipe.pipeline.validate import validate
from halpipe.pipeline.validate.context import Context, place
from halpipe.pipeline.validate.load import overloads

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.lanes import Pins
    from halpipe.pipeline.validate.load import Overload

DEFAULT_WORK = 60
"""Deterministic seconds of the exact engine: a count of work, about a second of it each, the same on every machine."""

MOST_UNLIMITED = 25_000
"""Jobs that a search places without a stated end: about 0.3 ms each, where nothing stands in the way."""

PAIRED = 4
"""Jobs of a pair of modes that take as long as one of a mode."""

LARGEST = 2**62
"""Costs and times stay below this."""


def refuse_endless(
    model: TaskModel, modes: Collection[str] = (), *, switches: bool = True, searches: int = 1, is_checked: bool = False
) -> None:
    """Refuse to schedule so many jobs that it can take long; `searches` times, the modes that are named, or all.

    Models that are not valid pass, unless that is checked: what is wrong with them is found before any search.
    """
    active = (mode for mode in Context(model).active if not modes or mode.mode.name in modes)
    jobs = {mode.mode.name: sum(mode.most_jobs.values()) for mode in active}
    if not switches:
        paired = 0
    elif model.transitions:
        paired = sum(jobs[p.source] + jobs[p.target] for p in model.transitions if {p.source, p.target} <= jobs.keys())
    else:
        paired = 2 * (len(jobs) - 1) * sum(jobs.values())
    work = searches * (sum(jobs.values()) + paired // PAIRED)
    if work > MOST_UNLIMITED and (is_checked or not any(found.is_error for found in validate(model))):
        text = f"{counted(sum(jobs.values()), 'job')} in {counted(len(jobs), 'mode')}"
        asked = (" with switches" if paired else "") + (f", in {searches} searches" if searches > 1 else "")
        text += f"{asked}, take as long as {work} jobs to place; more than {MOST_UNLIMITED} need a stated end"
        help = "say when to give up, such as --time-limit 300s (or, of all but `explain`, with --budget)"
        raise HalpipeError(ENDLESS(text, at=model.at, path=about(model=model.name), help=help))


def stated_problem(
    model: TaskModel, expansion: Expansion, tick: Duration | None, *, pinned: Mapping[str, Pins], **form: bool
) -> Problem:
    """Build the arrays of a mode, refusing what does not fit them; see `build_problem`."""
    check_tick(expansion, tick)
    resources = [resource.name for resource in model.resources]
    try:
        problem = build_problem(expansion, model.units, resources, model.chains, tick=tick, pinned=pinned, **form)
    except OverflowError:
        raise HalpipeError(too_large(expansion, tick or natural_tick(expansion))) from None
    first = problem.arrays.task_option
    refuse_stuck(expansion, [a.name for n, a in enumerate(expansion.tasks) if first[n] == first[n + 1]])
    check_range(problem)
    return problem


def check_range(problem: Problem) -> None:
    """Refuse a mode whose cost could overflow: a bound on the cost of the worst placement, in exact integers."""
    arrays = problem.arrays
    hyperperiod, jobs = arrays.hyperperiod, len(arrays.job_task)
    heaviest = max((height * arrays.lane_weight[lane] for lane, _, _, height in arrays.rect), default=1)
    sides = 1 + arrays.row_first[-1] + len(arrays.chain_limit)
    worst = hyperperiod * heaviest * jobs * arrays.rect_first[-1]
    worst += hyperperiod * arrays.unit_weight * jobs * sides
    hottest = 512 * 10_000 * problem.mean_wcet * arrays.unit_weight
    stated = max([0, *arrays.row.column(1), *arrays.chain_limit.flat, *arrays.chain_latency])
    if max(worst, hottest, stated) >= LARGEST:
        raise HalpipeError(too_large(problem.expansion, problem.tick))


def too_large(expansion: Expansion, tick: Duration) -> Diagnostic:
    """Return the error of a mode that the integers of the kernel cannot hold."""
    return TOO_LARGE(
        f"the hyperperiod has {expansion.hyperperiod // tick} ticks of {tick} and {expansion.job_count} jobs",
        at=expansion.mode.at,
        path=about(mode=expansion.mode.name),
        help="choose a coarser --tick, or round WCETs, periods and bounds to fewer digits",
    )


def cut_options(problem: Problem) -> list[Diagnostic]:
    """Say which gangs have more unit sets than are tried."""
    counts = Counter[tuple[str, str]]()
    for number, active in enumerate(problem.expansion.tasks):
        first, last = problem.arrays.task_option[number], problem.arrays.task_option[number + 1]
        versions = [option.version for option in problem.options[first:last]]
        counts.update((active.name, version.name) for version in versions if version is not None)
    return [
        OPTIONS_CUT(f"only {count} of its unit sets are tried", path=about(task=task, version=version))
        for (task, version), count in counts.items()
        if count >= MAX_OPTIONS_PER_VERSION
    ]


def check_tick(expansion: Expansion, tick: Duration | None) -> None:
    """Stop if a tick does not divide the periods and offsets of a mode."""
    if tick is None:
        return
    wrong = [
        TICK_DOES_NOT_DIVIDE(
            f"{what} {value} is not a multiple of the tick {tick}", at=task.at, path=about(task=task.name)
        )
        for task in (active.task for active in expansion.tasks)
        for what, value in (("period", task.period), ("offset", task.offset))
        if value is not None and value % tick
    ]
    if wrong:
        raise HalpipeError(*wrong)


def refuse_stuck(expansion: Expansion, names: list[str]) -> None:
    """Stop if some tasks have jobs, but no way to run them."""
    stuck = [
        NO_OPTION(
            f'no version available in mode "{expansion.mode.name}" can run',
            at=active.task.at,
            path=about(task=active.name),
            help="shorten its WCET, extend its deadline, or run its predecessors in the mode too",
        )
        for active in map(expansion.by_name.__getitem__, names)
        if active.jobs
    ]
    if stuck:
        raise HalpipeError(*stuck)


_FINEST = 101
"""One more than the parts of a tick that are tried when a coarser one is too long."""


def check_starts(model: TaskModel, tick: Duration) -> Iterator[Diagnostic]:
    """Yield the proofs that a tick leaves a set of units fewer instants to start at than they have jobs.

    A job starts at a multiple of the tick, and the next one of its unit at the first multiple at or after its end, so
    that the load of WCETs rounded up to ticks is a lower bound.
    """
    for over in overloads(Context(_rounded(model, tick))):
        fitting = next((tick / n for n in range(2, _FINEST) if _fits(model, over, tick / n)), None)
        finer = f"use a tick of {fitting} or a fraction of it" if fitting else "omit --tick"
        room = over.hyperperiod * len(over.units)
        jobs = sum(need.jobs for need in over.needs)
        text = (
            f"one job can start at each tick of {tick} on a unit: the {jobs} jobs of the tasks that can run only on "
            f"{few(sorted(over.units))} take {over.total} of the {room} in each hyperperiod of {over.hyperperiod}"
        )
        help = f"{finer}, or make one task of those that run one after the other (ARXML: --granularity ostask)"
        yield TOO_MANY_STARTS(text, at=place(over.mode.mode), path=over.mode.path, help=help)


def _rounded(model: TaskModel, tick: Duration) -> TaskModel:
    """Return the model with WCETs that are whole ticks, and without interrupts, which the rest of a tick may serve."""
    return replace(
        model,
        units=tuple(replace(unit, interrupts=()) for unit in model.units),
        tasks=tuple(
            replace(
                task,
                versions=tuple(
                    replace(v, wcet=v.wcet and tick * -(-v.wcet // tick), accesses=(), split=WHOLE)
                    for v in task.versions
                ),
            )
            for task in model.tasks
        ),
    )


def _fits(model: TaskModel, over: Overload, tick: Duration) -> bool:
    """Whether the jobs of an overload find room at a finer tick."""
    again = (found for found in overloads(Context(_rounded(model, tick))) if found.mode.path == over.mode.path)
    return all(found.units != over.units for found in again)
