"""Priorities of the tasks: one that starts in a gap of a job interrupts it, so it stands above (MODEL 8.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.priorities import relation_of
from halpipe.exporters.linux.codes import NO_ORDER

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

MOST_LEVELS = 40


def levels_of(model: TaskModel, schedule: Schedule) -> dict[str, int]:
    """Return the level of each task, 0 the lowest; raise `HalpipeError` where none can be given.

    A thread has one priority wherever it runs, so the relations of all units count together.
    """
    above: dict[str, set[str]] = {task.name: set() for task in model.tasks}
    for lower in relation_of(model, schedule).values():
        for below, tasks in lower.items():
            for task in tasks:
                above[task].add(below)
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
