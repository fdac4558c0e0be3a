"""Rule binding: tasks that keep to one set of units (MODEL 8.1), in a mode and the tables into it, or everywhere.

(D) Where jobs use several sets, the one that most of them use is taken as meant, of equals the one used first.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.models import Binding
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.verify.tables import ModeTable, Placed, Switch

UnitSet = frozenset[str]


@record
class Tables:
    """All tables of a schedule, for what holds across them."""

    model: TaskModel
    modes: tuple[ModeTable, ...]
    switches: tuple[Switch, ...]


def check_binding(table: ModeTable) -> Iterator[Diagnostic]:
    """Check the jobs of a mode against each other."""
    for name, active in table.mode.tasks.items():
        if active.task.binding is not Binding.JOB:
            jobs = table.by_task.get(name, ())
            yield from _elsewhere(jobs, _usual(jobs), table, "most of its jobs")


def check_binding_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check the jobs of a table against the mode to come, or each other where the mode has no job of the task."""
    by_task: dict[str, list[Placed]] = {}
    for placed in switch.jobs:
        if placed.active.task.binding is not Binding.JOB:
            by_task.setdefault(placed.job.task, []).append(placed)
    for name, jobs in by_task.items():
        there = switch.target.by_task.get(name, ())
        yield from _elsewhere(jobs, _usual(there or jobs), switch, about(mode=switch.target.name))


def check_binding_of_system(tables: Tables) -> Iterator[Diagnostic]:
    """Check the modes and tables against each other: the set that each uses for most of a task's jobs."""
    for task in tables.model.tasks:
        if task.binding is not Binding.SYSTEM:
            continue
        places: list[tuple[ModeTable | Switch, list[Placed]]] = [
            (table, table.by_task.get(task.name, [])) for table in tables.modes
        ]
        places += [(switch, [p for p in switch.jobs if p.job.task == task.name]) for switch in tables.switches]
        usual = _usual([placed for _, jobs in places for placed in jobs])
        for table, jobs in places:
            here = _usual(jobs)
            if here != usual and here is not None and usual is not None:
                path = about(table.path(), task=task.name)
                text = f"uses {_listed(here)} here and {_listed(usual)} elsewhere, but is bound in the whole system"
                yield codes.NOT_BOUND(
                    text, at=jobs[0].job.at, path=path, help="use one unit set in all modes and tables"
                )


def _usual(jobs: Iterable[Placed]) -> UnitSet | None:
    """Return the unit set that most of the jobs use, of equals the first; None without jobs."""
    counted = Counter(frozenset(placed.job.units) for placed in jobs)
    return max(counted, key=lambda units: counted[units]) if counted else None


def _elsewhere(
    jobs: Iterable[Placed], usual: UnitSet | None, table: ModeTable | Switch, whose: str
) -> Iterator[Diagnostic]:
    for placed in jobs:
        units = frozenset(placed.job.units)
        if usual is not None and units != usual:
            text = f"is on {_listed(units)}, but its task is bound, and {whose} use {_listed(usual)}"
            help = "move it there, or change the binding of the task"
            yield codes.NOT_BOUND(text, at=placed.job.at, path=table.path(placed), help=help)


def _listed(units: UnitSet) -> str:
    return ", ".join(f'"{unit}"' for unit in sorted(units)) or "no unit"


BINDING = Rule(
    "binding",
    "All jobs of a task with binding mode or system use the same units in the mode.",
    check_binding,
)
SYSTEM_BINDING = Rule(
    "system binding",
    "All jobs of a task with binding system use the same units in all modes and tables.",
    check_binding_of_system,
)
