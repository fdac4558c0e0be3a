"""Shipped schedules before a search: jobs without a place in the model, and kept jobs that exclude each other."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError, about, error
from halpipe.core.grouping import grouped
from halpipe.pipeline.jobs import Expansion, expand, start_in_time
from halpipe.pipeline.parts import renewed, service_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel, Unit

UNMATCHED = error(
    "HAL0468",
    "Shipped job without a place in the model",
    "Every job of the schedule given to --freeze has to stay. A job of a mode, a task or a number that the model does "
    "not have is that of another system, or of a renamed task.",
)
EXCLUDED = error(
    "HAL0469",
    "Frozen jobs exclude each other",
    "Jobs given to --freeze keep their starts, versions and units. With the WCETs of the model, two of them need one "
    "unit at the same time: that is a proof, no other seed or budget helps.",
)


def check_shipped(
    model: TaskModel, shipped: Schedule, tick: Duration | None = None, modes: Collection[str] = ()
) -> None:
    """Raise `HalpipeError` where not every shipped job is one of the model, or two of a mode cannot both stay."""
    refuse_unmatched(model, shipped)
    asked = shipped.alone(tuple(table for table in shipped.modes if not modes or table.name in modes))
    if excluded := excluded_jobs(model, asked, tick):
        raise HalpipeError(*excluded, exit=Exit.INFEASIBLE)


def refuse_unmatched(model: TaskModel, shipped: Schedule) -> None:
    """Raise `HalpipeError` where not every shipped job is one of the model."""
    expansions = {
        mode.name: expand(model, mode) for mode in model.modes if mode.name in {m.name for m in shipped.modes}
    }
    unmatched = [found for table in shipped.modes for found in _unmatched(expansions.get(table.name), table)]
    if unmatched:
        raise HalpipeError(*unmatched)


def excluded_jobs(model: TaskModel, shipped: Schedule, tick: Duration | None = None) -> list[Diagnostic]:
    """Return the pairs of shipped jobs of the model that cannot both stay, while each could; on a `tick`."""
    units = {unit.name: unit for unit in model.units}
    expansions = ((expand(model, model.mode(table.name)), table) for table in shipped.modes)
    return [found for each in expansions for found in _excluded(*each, units, tick)]


def _unmatched(expansion: Expansion | None, table: ModeSchedule) -> Iterator[Diagnostic]:
    for job in table.jobs:
        active = None if expansion is None else expansion.by_name.get(job.task)
        if active is not None and job.index < active.jobs:
            continue
        if expansion is None:
            text = "the model has no such mode"
        elif active is None:
            text = "the task does not run in this mode of the model"
        else:
            text = f"the task has {active.jobs} jobs in this mode of the model"
        help = "remove the job from the shipped schedule, rename it as in the model, or use --near in place of --freeze"
        yield UNMATCHED(text, at=job.at, path=about(mode=table.name, task=job.task, job=job.index), help=help)


def _excluded(
    expansion: Expansion, table: ModeSchedule, units: Mapping[str, Unit], tick: Duration | None
) -> Iterator[Diagnostic]:
    on_grid = (job for job in table.jobs if tick is None or not job.start % tick)
    for unit, start, end, job, other in overlaps(expansion, staying_in_time(expansion, on_grid, units)):
        text = f'and "{other.task}" job {other.index}, both frozen, need unit "{unit}" from {start} to {end}'
        help = f'remove the jobs of "{job.task}" or "{other.task}" from the shipped schedule, or use --near'
        path = about(mode=table.name, task=job.task, job=job.index)
        yield EXCLUDED(text, at=expansion.by_name[job.task].task.at, path=path, help=help)


def overlaps(expansion: Expansion, jobs: Iterable[Job]) -> Iterator[tuple[str, Duration, Duration, Job, Job]]:
    """Yield unit, begin and end of the overlaps of neighbours on a unit; jobs last at least their WCETs."""
    by_unit: dict[str, list[tuple[Duration, Duration, Job]]] = {}
    for job in jobs:
        version = expansion.by_name[job.task].task.version(job.version)
        if version.wcet is not None:
            for unit in job.units:
                by_unit.setdefault(unit, []).append((job.start, job.start + version.wcet, job))
    for unit, spans in by_unit.items():
        spans.sort(key=lambda span: (span[0], span[1], span[2].task))
        first, last = spans[0], spans[-1]
        cycle = expansion.hyperperiod
        around = [(last, (first[0] + cycle, *first[1:]))] if len(spans) > 1 else []
        for (_, end, job), (start, _, other) in [*pairwise(spans), *around]:
            if start < end:
                yield unit, start, end, job, other


def staying(expansion: Expansion, every: Iterable[Job]) -> Iterator[Job]:
    """Yield the jobs in one piece of tasks that stay: all their jobs are given, with versions and units they have."""
    for name, own in grouped((job.task, job) for job in every).items():
        active = expansion.by_name.get(name)
        units = {v.name: (frozenset(v.units), v.gang) for v in active.versions} if active is not None else {}
        if (
            active is not None
            and len(own) == active.jobs
            and all(
                job.version in units
                and not job.parts
                and job.start < expansion.hyperperiod
                and frozenset(job.units) <= units[job.version][0]
                and len(job.units) == units[job.version][1]
                for job in own
            )
        ):
            yield from own


def staying_in_time(expansion: Expansion, every: Iterable[Job], units: Mapping[str, Unit]) -> Iterator[Job]:
    """Yield of these jobs those of tasks that may start there with the lengths that their versions have now."""
    for name, own in grouped((job.task, job) for job in staying(expansion, every)).items():
        active, ordered = expansion.by_name[name], sorted(own, key=lambda job: job.index)
        now = [renewed(job, active.task.version(job.version), service_of(units, job.units)) for job in ordered]
        known = [job for job in now if job is not None]
        if len(known) == len(own) and start_in_time(expansion, active, known):
            yield from own
