"""Priorities of the tasks: one that starts in a gap of a job interrupts it, so it stands above (MODEL 8.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.exporters.linux.codes import NO_ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.durations import Duration
    from halpipe.models import Job, Schedule, TaskModel

MOST_LEVELS = 40


def levels_of(model: TaskModel, schedule: Schedule) -> dict[str, int]:
    """Return the level of each task, 0 the lowest; raise `HalpipeError` where none can be given."""
    above: dict[str, set[str]] = {task.name: set() for task in model.tasks}
    for mode in schedule.modes:
        _relate(model, mode.jobs, mode.hyperperiod, above)
    for table in schedule.transitions:
        _relate(model, table.jobs, None, above)
    levels: dict[str, int] = {}
    path: list[str] = []

    def level(task: str) -> int:
        if task in path:
            names = " above ".join(f'"{name}"' for name in [*path[path.index(task) :], task])
            help = "schedule without `anywhere` for one of them, or with a list of split points"
            raise HalpipeError(NO_ORDER(f"the relation closes a cycle: {names}", at=model.at, help=help))
        if task not in levels:
            path.append(task)
            levels[task] = 1 + max((level(below) for below in sorted(above[task])), default=-1)
            path.pop()
        return levels[task]

    most = max((level(task.name) for task in model.tasks), default=0)
    if most > MOST_LEVELS:
        help = "let fewer tasks interrupt each other"
        raise HalpipeError(
            NO_ORDER(f"{most + 1} levels are needed, {MOST_LEVELS + 1} there are", at=model.at, help=help)
        )
    return levels


def _relate(model: TaskModel, jobs: Sequence[Job], length: Duration | None, above: dict[str, set[str]]) -> None:
    """Note for each task the ones below it: those in whose gaps, on a unit of both, a job of it starts."""
    for below in jobs:
        if not below.parts or not model.task(below.task).version(below.version).split.anywhere:
            continue
        gaps = [(one.end, two.start) for one, two in zip(below.parts, below.parts[1:], strict=False)]
        for job in jobs:
            if job is below or not set(job.units) & set(below.units):
                continue
            turns = range(2 + int((below.end - below.start).fraction // length.fraction)) if length else range(1)
            starts = [job.start + length * turn if length else job.start for turn in turns]
            if any(low <= start < high for start in starts for low, high in gaps):
                above[job.task].add(below.task)
