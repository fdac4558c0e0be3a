"""Priority levels of threads under SCHED_FIFO: a task that starts in a gap of a job preempts it (MODEL 8.2)."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.priorities import levels_of, relation_of
from halpipe.exporters.linux.codes import NO_ORDER

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

HIGHEST = 99
"""The highest priority of Linux (sched(7)); the conductor has the one above those of the threads."""


def thread_levels(model: TaskModel, schedule: Schedule, priority: int) -> dict[str, int]:
    """Return the level of each task, 0 for `priority`; raise `HalpipeError` if there are none, or too many.

    A thread has one priority wherever it runs, so the relations of all units count together.
    """
    everywhere: dict[str, set[str]] = defaultdict(set)
    for above in relation_of(model, schedule).values():
        for low, highs in above.items():
            everywhere[low] |= highs
    related = levels_of({"": everywhere})[""]
    levels = {task.name: related.get(task.name, 0) for task in model.tasks}
    count = max(levels.values(), default=0) + 1
    if priority + count > HIGHEST:
        text = f"{count} levels from {priority} on and the conductor need priorities up to {priority + count}"
        help = (
            f"state --priority {HIGHEST - count} or lower" if count < HIGHEST else "let fewer tasks preempt each other"
        )
        raise HalpipeError(NO_ORDER(f"{text}; the highest is {HIGHEST}", at=model.at, help=help))
    return levels
