"""One application of an overlay to one import."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import sort_diagnostics
from halpipe.importers.overlay import structure
from halpipe.importers.overlay.changes import Changes
from halpipe.importers.overlay.codes import MATCHES_NOTHING
from halpipe.importers.overlay.entries import Overlay
from halpipe.importers.overlay.patterns import EVERYTHING, Patterns
from halpipe.importers.overlay.tasks import TaskMerger, constraints_by_task

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Diagnostic, Location
    from halpipe.core.durations import Duration
    from halpipe.core.settings import Stated
    from halpipe.importers.common.base import Coverage
    from halpipe.models import Task, TaskModel


class OverlayUse:
    """What an importer asks of an overlay. It remembers what matched: an entry that matches nothing is an error."""

    def __init__(self, overlay: Overlay) -> None:
        self._overlay = overlay
        self._sources = Patterns((stated.value, period) for stated, period in overlay.sources)
        self._drops = Patterns((stated.value, stated) for stated in overlay.drops)
        self._named_sources = {stated.value for stated, _ in overlay.sources}
        self._tasks = Patterns((entry.pattern, entry) for entry in overlay.tasks)
        self._answers: dict[str, bool] = {}
        self._asked_sources: dict[str, None] = {}
        self._matched_sources: set[str] = set()
        self._matched_drops: set[str] = set()
        self._matched_tasks: set[str] = set()

    def drops(self, name: str) -> bool:
        """Return whether the element `name` is to be left out: listed under ``drop``, or a task with ``drop: true``.

        A source that is named stays where only a glob would drop it: its data comes from outside of what is kept.
        """
        if name not in self._answers:
            listed = [pattern for pattern, _ in self._drops.of(name)]
            self._matched_drops.update(listed)
            if name in self._named_sources and name not in listed:
                listed = []
            stated = ((pattern, entry.drop) for pattern, entry in self._tasks.of(name) if entry.drop is not None)
            pattern, drop = next(stated, ("", None))
            dropped = drop is not None and drop.value
            if dropped:
                self._matched_tasks.add(pattern)
            self._answers[name] = bool(listed) or dropped
        return self._answers[name]

    def source_period(self, name: str) -> Duration | None:
        """Return the period of the data source `name` (a topic that nothing periodic publishes), None if not stated."""
        self._asked_sources[name] = None
        found = self._sources.of(name)
        self._matched_sources.update(pattern for pattern, _ in found)
        return found[0][1] if found else None

    def states_interrupt(self, name: str) -> bool:
        """Return whether the overlay states when and how long the interrupt `name` comes, and on which units."""
        listed = self._overlay.units.value if self._overlay.units else ()
        apart = (entry.interrupt.name for entry in self._overlay.interrupts)
        return name in apart or any(i.name == name for unit in listed for i in unit.interrupts)

    def task_period(self, name: str) -> Duration | None:
        """Return the period that a task entry states for `name`, with which an element without one becomes a task."""
        stated = (entry.stated.get("period") for _, entry in self._tasks.of(name))
        return _first(stated)

    def task_wcet(self, name: str, *, is_known: bool) -> Duration | None:
        """Return the WCET that the task `name` gets from its entries; ``*`` changes none that is known."""
        found = ((pattern, entry.common.stated.get("wcet")) for pattern, entry in self._tasks.of(name))
        return _first(wcet for pattern, wcet in found if not (is_known and pattern == EVERYTHING))

    def work_wcet(self, name: str) -> Duration | None:
        """Return the WCET that an entry, but for ``*``, states of `name`, such as that of a runnable within a task."""
        for pattern, entry in self._tasks.of(name):
            if pattern != EVERYTHING and "wcet" in entry.common.stated:
                self._matched_tasks.add(pattern)
                return _first([entry.common.stated["wcet"]])
        return None

    def apply(self, model: TaskModel, coverage: Coverage) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return the imported model with everything that the overlay states, and what to tell of it.

        The diagnostics hold errors where the overlay does not fit the model: the caller reports them with its own and
        does not use the model. Values of ``*`` entries go to `coverage` as defaults.
        """
        overlay, changes = self._overlay, Changes(coverage)
        if overlay == Overlay():
            return model, ()
        dropped_now = {task.name for task in model.tasks if self.drops(task.name)}
        model = structure.without(model, dropped_now, changes)
        changes.tasks = frozenset(task.name for task in model.tasks)
        changes.dropped = tuple(name for name, dropped in self._answers.items() if dropped)
        units = structure.platform_part(
            "units", model.units, structure.keeping_interrupts(overlay.units, model.units), changes
        )
        units = structure.with_interrupts(units, overlay, changes)
        resources = structure.platform_part("resources", model.resources, overlay.resources, changes)
        merger = TaskMerger(
            changes=changes,
            units=tuple(unit.name for unit in units),
            resources=tuple(resource.name for resource in resources),
            units_at=overlay.units.at if overlay.units else None,
            stand_ins=frozenset(unit.name for unit in model.units if unit.origin is None),
            constraints=constraints_by_task(overlay, changes),
        )
        tasks = tuple(self._merged(task, merger) for task in model.tasks)
        before, after = {task.name: task for task in model.tasks}, {task.name: task for task in tasks}
        modes = structure.modes(model.modes, overlay, before, after, changes)
        result = replace(
            model,
            units=units,
            resources=resources,
            tasks=tasks,
            chains=structure.chains(model.chains, overlay, changes),
            modes=modes,
            transitions=structure.transitions(model.transitions, overlay, modes, changes),
            health=structure.health(model.health, overlay, modes, changes),
        )
        self._report_unmatched(changes)
        return result, tuple(sort_diagnostics(changes.findings.items))

    def _merged(self, task: Task, merger: TaskMerger) -> Task:
        ranked = self._tasks.of(task.name)
        self._matched_tasks.update(pattern for pattern, _ in ranked)
        return merger.merge(task, ranked)

    def _report_unmatched(self, changes: Changes) -> None:
        """Report every entry that matched nothing; an entry for tasks that are dropped did match."""
        for name in changes.dropped:
            self._matched_tasks.update(pattern for pattern, _ in self._tasks.of(name))
        tasks = sorted({*changes.tasks, *changes.dropped})
        entries = ((entry.pattern, entry.at) for entry in self._overlay.tasks)
        _report("tasks", "task", entries, self._matched_tasks, tasks, changes)
        sources = ((stated.value, stated.at) for stated, _ in self._overlay.sources)
        _report(
            "sources",
            "data source without a period",
            sources,
            self._matched_sources,
            self._asked_sources,
            changes,
        )
        drops = ((stated.value, stated.at) for stated in self._overlay.drops)
        _report("drop", "element", drops, self._matched_drops, sorted({*tasks, *self._answers}), changes)


def _first(found: Iterable[Stated[Duration] | None]) -> Duration | None:
    """Return the first value that is stated at all."""
    return next((stated.value for stated in found if stated is not None), None)


def _report(
    section: str,
    kind: str,
    entries: Iterable[tuple[str, Location]],
    matched: set[str],
    known: Iterable[str],
    changes: Changes,
) -> None:
    for pattern, at in entries:
        if pattern not in matched:
            help = changes.suggest(pattern, known, "remove the entry, or correct its name")
            changes.fault(MATCHES_NOTHING, f'"{pattern}" matches no {kind}', at, section, help)
