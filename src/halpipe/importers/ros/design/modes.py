"""One model of the models of a system's modes: a task that differs between modes has a version for each difference."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.models import Mode, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings, Location


@record
class ModeModel:
    """The model of one mode alone, where each task has one version, and the place that declares the mode."""

    mode: str
    model: TaskModel
    at: Location


@dataclass(slots=True)
class _Merger:
    findings: Findings
    tasks: dict[str, Task] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)

    def add(self, part: ModeModel) -> Mode:
        """Take the tasks of one mode; return the mode with the versions that run in it."""
        names = {task.name: self._name(task, part) for task in part.model.tasks}
        self.units.update({unit.name: unit for unit in part.model.units if unit.name not in self.units})
        runs = []
        for task in part.model.tasks:
            name = names[task.name]
            (only,) = task.versions
            renamed = tuple(replace(p, task=names[p.task]) for p in only.precedences)
            runs.append(Run(task=name, versions=(self._version(name, task, replace(only, precedences=renamed), part),)))
        return Mode(name=part.mode, runs=tuple(runs), at=part.at)

    def _name(self, task: Task, part: ModeModel) -> str:
        """Return the name of a task in the whole model: another one where its period is another one than before."""
        first = self.tasks.get(task.name)
        if first is None or first.period == task.period:
            return task.name
        name = f"{task.name}@{part.mode}"
        text = f'has period {task.period} in mode "{part.mode}", {first.period} before; there it is the task "{name}"'
        at = task.origin.location if task.origin else part.at
        self.findings.add(
            codes.MODE_PERIOD(text, at=at, path=about(task=task.name), help="use the new name in the overlay, too")
        )
        return name

    def _version(self, name: str, task: Task, version: Version, part: ModeModel) -> str:
        """Add the version to the task unless one that is equal is there; return the name of it."""
        known = self.tasks.get(name)
        if known is None:
            self.tasks[name] = replace(task, name=name, versions=(version,))
            return version.name
        for other in known.versions:
            if replace(version, name=other.name) == other:
                return other.name
        self.tasks[name] = replace(known, versions=(*known.versions, replace(version, name=part.mode)))
        return part.mode


def merge_modes(parts: Sequence[ModeModel], findings: Findings) -> TaskModel:
    """Return the model of all modes, the first of which keeps its names; `parts` has at least one."""
    merger = _Merger(findings)
    modes = tuple(merger.add(part) for part in parts)
    first = parts[0].model
    return replace(first, units=tuple(merger.units.values()), tasks=tuple(merger.tasks.values()), modes=modes)
