"""One application of an overlay to one import: platform, drops, tasks, chains, modes and transitions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Diagnostic, Location, about, sort_diagnostics
from halpipe.importers.common.stated import is_glob
from halpipe.importers.overlay.changes import Changes, show
from halpipe.importers.overlay.codes import MATCHES_NOTHING, NAMES_DROPPED
from halpipe.importers.overlay.entries import EVERYTHING, ModeEntry, Overlay, Patterns, expand
from halpipe.importers.overlay.tasks import TaskMerger, constraints_by_task
from halpipe.models import Anchor, Chain, Mode, Origin, Run
from halpipe.models.attributes import attributes

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from halpipe.core.durations import Duration
    from halpipe.core.settings import Stated
    from halpipe.importers.common.base import Coverage
    from halpipe.models import HealthRule, Resource, Task, TaskModel, Transition, Unit, Version

E = TypeVar("E", bound="Unit | Resource")


def platform_part(
    what: str,
    imported: tuple[E, ...],
    stated: Stated[tuple[E, ...]] | None,
    changes: Changes,
    assumed: Collection[str] = (),
) -> tuple[E, ...]:
    """Return the units or resources that hold: those of the overlay if it lists any, else the imported ones.

    Those that the importer `assumed` are none of the source, so that their end is not reported.
    """
    if stated is None:
        return imported
    own = [each for each in imported if each.name not in assumed]
    changes.replaced(f"platform {what}", own, stated.value, (each.name for each in own), stated.at)
    return stated.value


def keeping_interrupts(
    stated: Stated[tuple[Unit, ...]] | None, imported: tuple[Unit, ...]
) -> Stated[tuple[Unit, ...]] | None:
    """Return the overlay's list of units, in which a unit that states no interrupts has those of the source."""
    served = {unit.name: unit.interrupts for unit in imported}
    if stated is None or not any(served.values()):
        return stated
    units = (replace(u, interrupts=u.interrupts or served.get(u.name, ())) for u in stated.value)
    return replace(stated, value=tuple(units))


def with_interrupts(units: tuple[Unit, ...], overlay: Overlay, changes: Changes) -> tuple[Unit, ...]:
    """Return the units with the interrupts that the overlay states apart from them, in its order."""
    served = {unit.name: {i.name: i for i in unit.interrupts} for unit in units}
    for entry in overlay.interrupts:
        added = entry.interrupt
        for pattern in entry.units.value:
            for unit in changes.matching_units(pattern, served, entry.units.at, about(interrupt=added.name)):
                old = served[unit].get(added.name)
                if old is not None:
                    path = about(unit=unit, interrupt=added.name)
                    changes.overridden(path, "interrupt", old, added, added.at)
                served[unit][added.name] = added
    return tuple(replace(unit, interrupts=tuple(served[unit.name].values())) for unit in units)


def without(model: TaskModel, dropped: Collection[str], changes: Changes) -> TaskModel:
    """Return the model without the dropped tasks and without what the source says of them."""
    if not dropped:
        return model
    kept = [chain for chain in model.chains if not any(task in dropped for task in chain.tasks)]
    for chain in model.chains:
        if chain not in kept:
            gone = tuple(task for task in chain.tasks if task in dropped)
            changes.removed(f"went with its dropped tasks {show(gone)}", chain.at, about(chain=chain.name))
    modes = (replace(m, runs=tuple(run for run in m.runs if run.task not in dropped)) for m in model.modes)
    tasks = (_without_predecessors(task, dropped, changes) for task in model.tasks if task.name not in dropped)
    rules = tuple(rule for rule in model.health if rule.task not in dropped)
    for rule in model.health:
        if rule.task in dropped:
            changes.removed("went with its dropped task", rule.at, about(health_rule_of_task=rule.task))
    return replace(model, tasks=tuple(tasks), chains=tuple(kept), modes=tuple(modes), health=rules)


def _without_predecessors(task: Task, dropped: Collection[str], changes: Changes) -> Task:
    if not any(p.task in dropped for v in task.versions for p in v.precedences):
        return task
    versions: list[Version] = []
    for version in task.versions:
        kept = tuple(p for p in version.precedences if p.task not in dropped)
        if kept != version.precedences:
            gone = tuple(p.task for p in version.precedences if p.task in dropped)
            path = about(task=task.name, version=version.name)
            changes.removed(f"precedence after dropped tasks {show(gone)} is void", version.at, path)
        versions.append(replace(version, precedences=kept))
    return replace(task, versions=tuple(versions))


def chains(imported: tuple[Chain, ...], overlay: Overlay, changes: Changes) -> tuple[Chain, ...]:
    """Return the chains: the overlay's replace imported ones of the same name and join the others."""
    found = {chain.name: chain for chain in imported}
    for chain in overlay.chains.values():
        path = about(chain=chain.name)
        known = [changes.knows_task(task, chain.at, path) for task in chain.tasks]
        old = found.get(chain.name)
        if old is not None:
            for one in attributes(Chain):
                before, after = getattr(old, one.field), getattr(chain, one.field)
                if before != one.default:
                    changes.overridden(path, one.name, before, after, chain.at)
        if all(known):
            found[chain.name] = chain
    return tuple(found.values())


def modes(
    imported: tuple[Mode, ...],
    overlay: Overlay,
    before: Mapping[str, Task],
    after: Mapping[str, Task],
    changes: Changes,
) -> tuple[Mode, ...]:
    """Return the overlay's modes, or, where it states none, the imported ones with the versions there are now."""
    if not overlay.modes:
        return tuple(replace(m, runs=tuple(_updated(run, before, after) for run in m.runs)) for m in imported)
    built = tuple(_mode(entry, after, changes) for entry in overlay.modes.values())
    changes.replaced("modes", imported, built, (m.name for m in imported), built[0].at)
    return built


def _updated(run: Run, before: Mapping[str, Task], after: Mapping[str, Task]) -> Run:
    """Return an imported run: one that had every version has every version; others keep those that are left."""
    if run.task not in after:
        return run
    new = tuple(v.name for v in after[run.task].versions)
    left = tuple(name for name in run.versions if name in new)
    had_all = {v.name for v in before[run.task].versions} <= set(run.versions)
    return replace(run, versions=new if had_all or not left else left)


def _mode(entry: ModeEntry, tasks: Mapping[str, Task], changes: Changes) -> Mode:
    path = about(mode=entry.name)
    chosen = _chosen(entry, tasks, path, changes)
    versions = Patterns((stated.value, (stated, names)) for stated, names in entry.versions)
    matched = {pattern for name in chosen for pattern, _ in versions.of(name)}
    for stated, _ in entry.versions:
        if stated.value not in matched:
            message = f'versions of "{stated.value}": no such task in this mode'
            help = changes.suggest(stated.value, chosen, "name a task that the mode runs")
            changes.findings.report(MATCHES_NOTHING, message, stated.at, path, help)
    runs = (_run(tasks[name], chosen[name], versions, path, changes) for name in tasks if name in chosen)
    origin = Origin(entry.at.file, entry.at.line, str(path))
    return Mode(name=entry.name, **entry.stated, runs=tuple(runs), origin=origin, at=entry.at)


def _chosen(entry: ModeEntry, tasks: Mapping[str, Task], path: str, changes: Changes) -> dict[str, Stated[str]]:
    """Return the tasks that the mode runs, each with the pattern that chose it."""
    chosen: dict[str, Stated[str]] = {}
    for stated in entry.tasks:
        if is_glob(stated.value):
            matching = expand(stated.value, tasks)
            chosen.update((name, stated) for name in matching if name not in chosen)
            if not matching:
                _report_glob(stated.value, stated, path, changes)
        elif changes.knows_task(stated.value, stated.at, path):
            chosen[stated.value] = stated
    return chosen


def _report_glob(pattern: str, stated: Stated[str], path: str, changes: Changes) -> None:
    only_dropped = bool(expand(pattern, changes.dropped))
    code, what = (NAMES_DROPPED, "only dropped tasks") if only_dropped else (MATCHES_NOTHING, "no task")
    help = changes.suggest(pattern, sorted(changes.tasks), "correct the glob, or remove it")
    changes.findings.report(code, f'tasks "{pattern}" match {what}', stated.at, path, help)


def _run(
    task: Task,
    chosen: Stated[str],
    versions: Patterns[tuple[Stated[str], tuple[str, ...]]],
    path: str,
    changes: Changes,
) -> Run:
    available = tuple(version.name for version in task.versions)
    stated = next((entry for _, entry in versions.of(task.name)), None)
    if stated is None:
        return Run(task=task.name, versions=available, at=chosen.at)
    place, names = stated
    for name in names:
        if name not in available:
            otherwise = f'task "{task.name}" has: {show(available)}'
            changes.unknown(f'version of task "{task.name}"', name, available, place.at, path, otherwise)
    return Run(task=task.name, versions=tuple(n for n in names if n in available), at=place.at)


def transitions(
    imported: tuple[Transition, ...], overlay: Overlay, now: tuple[Mode, ...], changes: Changes
) -> tuple[Transition, ...]:
    """Return the overlay's transitions, or, where it states none, the imported ones between modes that are left."""
    names = {mode.name for mode in now}
    if not overlay.transitions:
        for t in imported:
            if not {t.source, t.target} <= names:
                changes.removed("its modes are replaced", t.at, about(transition=(t.source, t.target)))
        return tuple(t for t in imported if {t.source, t.target} <= names)
    valid = []
    for t in overlay.transitions.values():
        path = about(transition=(t.source, t.target))
        missing = [name for name in (t.source, t.target) if name not in names]
        for name in missing:
            changes.unknown("mode", name, sorted(names), t.at, path, "add it under modes")
        if not missing:
            valid.append(t)
    at = next(iter(overlay.transitions.values())).at
    changes.replaced("transitions", imported, valid, (f"{t.source} to {t.target}" for t in imported), at)
    return tuple(valid)


def health(
    imported: tuple[HealthRule, ...], overlay: Overlay, now: tuple[Mode, ...], changes: Changes
) -> tuple[HealthRule, ...]:
    """Return the overlay's health rules, or, where it states none, the imported ones whose modes are left."""
    names = {mode.name for mode in now} | {""}
    if not overlay.health:
        for rule in imported:
            if rule.mode not in names:
                changes.removed("its mode is replaced", rule.at, about(health_rule_of_task=rule.task))
        return tuple(rule for rule in imported if rule.mode in names)
    for rule in overlay.health:
        path = about(health_rule_of_task=rule.task)
        changes.knows_task(rule.task, rule.at, path)
        if rule.mode not in names:
            changes.unknown("mode", rule.mode, sorted(names - {""}), rule.at, path, "add it under modes")
    changes.replaced("health rules", imported, overlay.health, (r.task for r in imported), overlay.health[0].at)
    return overlay.health


class OverlayUse:
    """Overlay during an import. It remembers its matches: an entry that matches nothing is an error."""

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

    @property
    def names_units(self) -> bool:
        """Whether the overlay lists the units, so that none need be assumed."""
        return self._overlay.units is not None

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
        model = without(model, dropped_now, changes)
        changes.tasks = frozenset(task.name for task in model.tasks)
        changes.dropped = tuple(name for name, dropped in self._answers.items() if dropped)
        assumed = [d for d in coverage.defaulted_values if (d.element, d.what) == ("platform", "units")]
        if overlay.units is not None:  # the units that an importer stands in are gone
            coverage.defaulted_values[:] = [d for d in coverage.defaulted_values if d not in assumed]
        stated = keeping_interrupts(overlay.units, model.units)
        units = platform_part("units", model.units, stated, changes, {d.value for d in assumed})
        units = with_interrupts(units, overlay, changes)
        resources = platform_part("resources", model.resources, overlay.resources, changes)
        merger = TaskMerger(
            changes=changes,
            units=tuple(unit.name for unit in units),
            resources=tuple(resource.name for resource in resources),
            units_at=overlay.units.at if overlay.units else None,
            stand_ins=frozenset(unit.name for unit in model.units if unit.origin is None),
            constraints=constraints_by_task(overlay, changes),
            pointed=_pointed(model),
        )
        tasks = tuple(self._merged(task, merger) for task in model.tasks)
        before, after = {task.name: task for task in model.tasks}, {task.name: task for task in tasks}
        now = modes(model.modes, overlay, before, after, changes)
        result = replace(
            model,
            units=units,
            resources=resources,
            tasks=tasks,
            chains=chains(model.chains, overlay, changes),
            modes=now,
            transitions=transitions(model.transitions, overlay, now, changes),
            health=health(model.health, overlay, now, changes),
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


def _pointed(model: TaskModel) -> frozenset[str]:
    rows = (row for task in model.tasks for version in task.versions for row in version.precedences)
    return frozenset(row.task for row in rows if row.anchor is Anchor.POINT)


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
            changes.findings.report(MATCHES_NOTHING, f'"{pattern}" matches no {kind}', at, section, help)
