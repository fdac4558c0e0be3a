"""Versions of tasks, their preemption points and locks: one version for each execution time that differs by unit.

A runnable states which exclusive areas it may enter, or runs inside of, but not when; so its jobs hold the lock from
start to end (MODEL 10.5), a listed default. Each component instance has areas of its own. Jobs of one unit that are not
split are apart anyway. Locks take WCETs, which an overlay may state, so they are added once the overlay is applied."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import Diagnostic, Findings, Location, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.options import BUDGET, ArxmlImportOptions
from halpipe.importers.arxml.system.timing import ANALYSED
from halpipe.importers.common.names import legal, unique_name
from halpipe.importers.common.pieces import cuts
from halpipe.models import WHOLE, Access, Resource, ResourceKind, Split, Task, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.arxml.system.values import ExecutionTime, Place, System
    from halpipe.importers.arxml.tasks.activation import Draft
    from halpipe.importers.arxml.tasks.platform import Platform
    from halpipe.importers.common.base import Coverage

FULL = "FULL"


class Splitter:
    """Finds split points, and remembers which tasks are cut within runnables."""

    def __init__(self, options: ArxmlImportOptions) -> None:
        self._longest = options.pieces
        self._overlay = options.overlay
        self._cut: dict[str, Draft] = {}

    def stated(self, draft: Draft, runnable: Sequence[str]) -> Duration | None:
        """Return the WCET that the overlay states for a runnable within an OsTask, by any of its names; the longest.

        What runs as a runnable of a component and as an entity of its BSW module has two.
        """
        if self._overlay is None or draft.place.kind != "OsTask":
            return None
        found = [self._overlay.work_wcet(name) for name in runnable if name != draft.name]
        return max((time for time in found if time is not None), default=None)

    def split(self, draft: Draft, lengths: Sequence[Duration]) -> Split:
        """Return where jobs of a draft with runnables of some lengths may be interrupted.

        Where the overlay states the WCET of the whole, it says nothing of the runnables, and theirs do not count.
        """
        if draft.os_task is None or draft.os_task.schedule != FULL:
            return WHOLE
        whole = None if self._overlay is None else self._overlay.task_wcet(draft.name, is_known=bool(lengths))
        if whole is not None:
            lengths = [whole]
        points: list[Duration] = []
        end = ZERO
        for length in lengths:
            begin, end = end, end + length
            within = cuts(self._longest, begin, end, draft.name, draft.place.at)
            if within:
                self._cut[draft.name] = draft
            points += [*within, end]
        inner = sorted({point for point in points if ZERO < point < end})
        return Split(points=tuple(inner)) if inner else WHOLE

    def report(self, findings: Findings) -> None:
        """Report the tasks that are cut within runnables."""
        if self._cut:
            message = f"{len(self._cut)} preemptive tasks are cut within runnables: {listed(list(self._cut))}"
            help = "state where they may be interrupted in an overlay, or the longest piece with --pieces"
            first = next(iter(self._cut.values()))
            findings.report(codes.CUT_RUNNABLES, message, at=first.place.at, help=help)


VERSION = "default"


class Variant(NamedTuple):
    """A version to be, without its precedence, and the execution times that it comes from."""

    version: Version
    times: tuple[ExecutionTime, ...] = ()


def make_variants(
    system: System, drafts: Sequence[Draft], platform: Platform, options: ArxmlImportOptions, findings: Findings
) -> dict[str, tuple[Variant, ...]]:
    """Return the versions of every task, by its name.

    The jobs of an OsTask that is preemptive may be interrupted between its runnables, and within long ones.
    """
    times: dict[str, dict[str | None, ExecutionTime]] = {}
    for time in system.execution_times:
        times.setdefault(time.runnable, {})[time.hardware] = time
    splitter = Splitter(options)
    variants = {draft.name: _variants(draft, platform, times, splitter) for draft in drafts}
    if options.wcet == BUDGET:
        variants |= _budgets(drafts, variants, splitter, findings)
    splitter.report(findings)
    _report_units(drafts, variants, platform, findings)
    return variants


def _budgets(
    drafts: Sequence[Draft], variants: dict[str, tuple[Variant, ...]], splitter: Splitter, findings: Findings
) -> dict[str, tuple[Variant, ...]]:
    """Return versions with the execution budget of the OsTask, for tasks of which no execution time is stated.

    It bounds each call of the OsTask, too, though several tasks of one OsTask are then longer than it together.
    """
    found: dict[str, tuple[Variant, ...]] = {}
    for draft in drafts:
        budget = draft.os_task.budget if draft.os_task else None
        first = variants[draft.name][0].version
        if budget is not None and first.wcet is None:
            split = splitter.split(draft, [budget])
            found[draft.name] = (Variant(replace(first, wcet=budget, split=split)),)
    if found:
        message = f"the execution budgets of OsTasks are the WCETs of {len(found)} tasks: {listed(list(found))}"
        first_of = next(draft for draft in drafts if draft.name in found)
        findings.report(codes.BUDGETS, message, at=first_of.place.at)
    return found


def used_times(variants: dict[str, tuple[Variant, ...]]) -> list[Place]:
    """Return the execution times that versions were made of."""
    return [time.place for found in variants.values() for variant in found for time in variant.times]


def report_kinds(variants: dict[str, tuple[Variant, ...]], at: Location, findings: Findings) -> None:
    """Report how many execution times are no analysed bounds."""
    places = dict.fromkeys(place for place in used_times(variants) if place.kind != ANALYSED)
    if places:
        kinds = sorted({place.kind for place in places})
        findings.report(codes.NOT_ANALYSED, f"{len(places)} execution times are of the kinds {', '.join(kinds)}", at=at)


def _variants(
    draft: Draft, platform: Platform, times: dict[str, dict[str | None, ExecutionTime]], splitter: Splitter
) -> tuple[Variant, ...]:
    units = platform.units_of(draft)
    runnables = grouped((member.work, member.name) for member in draft.members)
    groups: dict[tuple[Duration, Split], list[tuple[str, tuple[ExecutionTime, ...]]]] = {}
    for unit in units:
        found = [_time(times.get(path, {}), platform.hardware.get(unit, ())) for _, path in runnables]
        known = tuple(time for time in found if time is not None)
        pieces = [
            splitter.stated(draft, names) if time is None else time.time
            for time, names in zip(found, runnables.values(), strict=True)
        ]
        lengths = [piece for piece in pieces if piece is not None]
        if len(lengths) == len(pieces):
            key = (sum(lengths, ZERO), splitter.split(draft, lengths))
            groups.setdefault(key, []).append((unit, known))
    if not groups:
        return (Variant(Version(name=VERSION, units=units, split=splitter.split(draft, ()))),)
    taken: dict[str, int] = {}
    result = []
    for (wcet, split), group in groups.items():
        name = unique_name(_name(group[0][1]) if len(groups) > 1 else VERSION, taken)
        used = tuple(dict.fromkeys(time for _, times_of in group for time in times_of))
        origin = used[0].place.origin if len(used) == 1 else None
        units = tuple(unit for unit, _ in group)
        result.append(Variant(Version(name=name, wcet=wcet, units=units, split=split, origin=origin), used))
    return tuple(result)


def _time(times: dict[str | None, ExecutionTime], levels: Sequence[Sequence[str]]) -> ExecutionTime | None:
    """Return the longest time on the nearest hardware; where that of the unit is not known, the longest of all."""
    known = ([times[path] for path in level if path in times] for level in levels) if levels else [times.values()]
    return max(next(filter(None, known), ()), key=lambda time: time.time, default=times.get(None))


def _name(times: tuple[ExecutionTime, ...]) -> str:
    hardware = next((time.hardware for time in times if time.hardware), None)
    return legal(hardware.rpartition("/")[2]) if hardware else VERSION


def _report_units(
    drafts: Sequence[Draft],
    variants: dict[str, tuple[Variant, ...]],
    platform: Platform,
    findings: Findings,
) -> None:
    for draft in drafts:
        kept = {unit for variant in variants[draft.name] for unit in variant.version.units}
        left = [unit for unit in platform.units_of(draft) if unit not in kept]
        if left:
            message = f"does not run on {listed(left)}, for which no execution time is stated"
            findings.report(codes.UNIT_WITHOUT_TIME, message, at=draft.place.at, path=about(task=draft.name))


@record
class Lock:
    """An exclusive area of one component instance, or an OsResource: its name, and the tasks that may hold it."""

    name: str
    place: Place
    tasks: tuple[str, ...]


def find_locks(system: System, drafts: Sequence[Draft]) -> tuple[Lock, ...]:
    """Return what two tasks or more may hold."""
    labels = {instance.context: instance.label for instance in system.instances}
    held: dict[tuple[str, Place], dict[str, None]] = {}
    for draft in drafts:
        for member in draft.members:
            for area in member.runnable.areas if member.runnable else ():
                label = f"{labels.get(member.context, '')}/{area.name}".lstrip("/")
                held.setdefault((label, area), {})[draft.name] = None
        for resource in draft.os_task.resources if draft.os_task else ():
            held.setdefault((resource.name, resource), {})[draft.name] = None
    for place, takers in system.configuration.spinlocks:
        for draft in drafts:
            if draft.os_task is not None and draft.os_task.place.path in takers:
                held.setdefault((place.name, place), {})[draft.name] = None
    return tuple(Lock(legal(n), place, tuple(tasks)) for (n, place), tasks in held.items() if len(tasks) > 1)


@record
class Locking:
    """Puts locks on a model whose WCETs are known, and accounts for the time that they are held."""

    locks: tuple[Lock, ...]
    coverage: Coverage

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with a resource for each lock that two of its tasks could hold at once."""
        findings = Findings()
        tasks = {task.name: task for task in model.tasks}
        taken = {resource.name: 1 for resource in model.resources}
        made: list[tuple[Lock, Resource]] = []
        for lock in self.locks:
            members = [name for name in lock.tasks if name in tasks]
            if len(members) < 2 or _are_apart([tasks[name] for name in members]):
                continue
            unknown = [name for name in members if not all(version.wcet for version in tasks[name].versions)]
            if unknown:
                message = f"is not imported, since {listed(unknown)} have no WCET: jobs that hold it may overlap"
                lock.place.report(findings, codes.LOCK_LOST, message, help="state the WCETs in an overlay")
                continue
            resource = Resource(name=unique_name(lock.name, taken), kind=ResourceKind.LOCK, origin=lock.place.origin)
            made.append((lock, resource))
            for name in members:
                tasks[name] = _holding(tasks[name], resource.name)
                element = f'task "{name}"'
                self.coverage.defaulted(element, f'lock "{resource.name}"', "held by whole jobs", lock.place.at)
        if made:
            message = f"{len(made)} locks are held by whole jobs: {listed([resource.name for _, resource in made])}"
            findings.report(codes.LOCKS_HELD, message, at=made[0][0].place.at)
        resources = (*model.resources, *(resource for _, resource in made))
        return replace(model, resources=resources, tasks=tuple(tasks.values())), tuple(findings.items)


def _are_apart(tasks: Sequence[Task]) -> bool:
    """Whether no two jobs of some tasks can be in progress at once: all have one unit, and none is split."""
    versions = [version for task in tasks for version in task.versions]
    units = {version.units for version in versions}
    return len(units) == 1 and len(next(iter(units))) == 1 and not any(v.split.is_allowed for v in versions)


def _holding(task: Task, lock: str) -> Task:
    """Return the task with a lock held from the start of each job to its end."""
    return replace(
        task,
        versions=tuple(
            replace(v, accesses=(*v.accesses, Access(resource=lock, start=ZERO, end=v.wcet))) if v.wcet else v
            for v in task.versions
        ),
    )
