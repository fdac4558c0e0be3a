"""Look-up tables of the checks, built once per model, and the form of a check."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from halpipe.core.diagnostics import NOWHERE, Code, Diagnostic, Fix, Location, Path, Subject, about
from halpipe.core.durations import ZERO, Duration, least_common_multiple
from halpipe.core.records import record
from halpipe.core.suggest import nearest
from halpipe.models import Access, Mode, ResourceKind, Run, Task, TaskModel, Version
from halpipe.pipeline.jobs import demand_ranges

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from types import ModuleType


Named = TypeVar("Named")

_MAX_COMPARISONS = 30_000
"""Names compared for suggestions in one validation; a model full of unknown names must not take minutes."""

_MAX_BITS = 4096
"""Size of a hyperperiod, in periods of the most frequent task, beyond which it is not computed any further."""


@record
class Check:
    """One thing that is checked: a sentence for the manual, the codes it may report, and the procedure."""

    name: str
    sentence: str
    codes: tuple[Code, ...]
    run: Callable[[Context], Iterable[Diagnostic]]

    def __call__(self, context: Context) -> Iterable[Diagnostic]:
        """Return what is found in a model."""
        return self.run(context)


def check(name: str, *codes: Code) -> Callable[[Callable[[Context], Iterable[Diagnostic]]], Check]:
    """Make a check of a procedure; the first paragraph of its docstring is its sentence in the manual."""
    return lambda run: Check(name, " ".join((run.__doc__ or "").partition("\n\n")[0].split()), codes, run)


def checks_of(*modules: ModuleType) -> tuple[Check, ...]:
    """Return the checks of modules, in the order of their definition."""
    return tuple(value for module in modules for value in vars(module).values() if isinstance(value, Check))


@record
class ActiveTask:
    """A task of a mode, with the versions available there that exist."""

    task: Task
    run: Run
    versions: tuple[Version, ...]

    @property
    def is_periodic(self) -> bool:
        """Whether the task has releases of its own; one with a useless period has neither releases nor demands."""
        return self.task.period is not None and self.task.period > ZERO


@dataclass(frozen=True)
class ActiveMode:
    """A mode with the tasks that run in it (T_n), by name, in the order of its runs."""

    mode: Mode
    tasks: dict[str, ActiveTask]

    @property
    def path(self) -> str:
        """Name of the mode in messages."""
        return about(mode=self.mode.name)

    @cached_property
    def named(self) -> dict[str, dict[str, tuple[int, int]]]:
        """For every task, how often its versions name each other task of the mode: at least, at most."""
        return {
            name: {
                other: counts
                for other, counts in demand_ranges(active.versions).items()
                if other in self.tasks and other != name
            }
            for name, active in self.tasks.items()
        }

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The tasks, predecessors first; empty where the relation has a cycle."""
        try:
            return tuple(TopologicalSorter(self.named).static_order())
        except CycleError:
            return ()

    @cached_property
    def hyperperiod(self) -> Duration | None:
        """The least common multiple t_P of the periods; None where it is out of reach or nothing is periodic."""
        periods = {active.task.period for active in self.tasks.values() if active.task.period and active.is_periodic}
        found = shortest = min(periods, default=ZERO)
        for period in sorted(periods):
            found = least_common_multiple((found, period))
            if (found // shortest).bit_length() > _MAX_BITS:
                return None
        return found or None

    @cached_property
    def least_jobs(self) -> dict[str, int]:
        """N of every task in a hyperperiod if each demanding job uses the version that demands least."""
        return self._job_counts(0)

    @cached_property
    def most_jobs(self) -> dict[str, int]:
        """N of every task in a hyperperiod if each demanding job uses the version that demands most."""
        return self._job_counts(1)

    def _job_counts(self, bound: Literal[0, 1]) -> dict[str, int]:
        """Return N of every task in a hyperperiod (paper, section III); zeros where there is none.

        Where the relation has a cycle the counts are lower bounds.
        """
        counts = dict.fromkeys(self.tasks, 0)
        on_demand = {name for name, active in self.tasks.items() if active.task.period is None}
        for name in reversed(self.order or tuple(self.tasks)):
            active = self.tasks[name]
            if active.task.period is not None and active.is_periodic and self.hyperperiod:
                counts[name] = self.hyperperiod // active.task.period
            for other in on_demand and on_demand & self.named[name].keys():
                counts[other] += self.named[name][other][bound] * counts[name]
        return counts


@dataclass
class Context:
    """The model with its elements by name; where a name is defined twice, the first counts."""

    model: TaskModel
    _compared: int = 0
    _suggested: dict[tuple[str, str], list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.units = by_name(self.model.units)
        self.resources = by_name(self.model.resources)
        self.tasks = by_name(self.model.tasks)
        self.modes = by_name(self.model.modes)
        self.versions = {name: by_name(task.versions) for name, task in self.tasks.items()}

    @cached_property
    def active(self) -> tuple[ActiveMode, ...]:
        """Every mode with its active tasks."""
        return tuple(ActiveMode(mode, self._running(mode)) for mode in self.modes.values())

    def _running(self, mode: Mode) -> dict[str, ActiveTask]:
        tasks: dict[str, ActiveTask] = {}
        for run in mode.runs:
            task = self.tasks.get(run.task)
            if task is None or run.task in tasks:
                continue
            known = self.versions[run.task]
            versions = tuple(known[name] for name in dict.fromkeys(run.versions) if name in known)
            if versions:
                tasks[run.task] = ActiveTask(task, run, versions)
        return tasks

    @cached_property
    def versions_of_tasks(self) -> list[tuple[Task, Version]]:
        """Every version with its task."""
        return [(task, version) for task in self.model.tasks for version in task.versions]

    @property
    def accesses_of_versions(self) -> Iterator[tuple[Task, Version, Access]]:
        """Every access phase with its version and task; kept, so many would burden the garbage collector."""
        return ((task, version, access) for task, version in self.versions_of_tasks for access in version.accesses)

    def is_lock(self, resource: str) -> bool:
        """Tell whether a resource is a lock."""
        return resource in self.resources and self.resources[resource].kind is ResourceKind.LOCK

    def suggest(self, kind: str, name: str, known: Collection[str]) -> str:
        """Say which known name was probably meant, or what to do; `kind` says what is named."""
        otherwise = f"declare the {kind}, or correct the name"
        near = self._near(kind, name, known)
        return "did you mean " + " or ".join(f'"{one}"' for one in near) + "?" if near else otherwise

    def fix(self, kind: str, name: str, known: Collection[str], at: Location) -> Fix | None:
        """Return the change of a name to the known one that was probably meant, if there is one."""
        near = self._near(kind, name, known)
        return Fix(at, name, near[0]) if near else None

    def _near(self, kind: str, name: str, known: Collection[str]) -> list[str]:
        key = (kind, name)
        if key not in self._suggested:
            self._compared += len(known)
            self._suggested[key] = nearest(name, known) if self._compared <= _MAX_COMPARISONS else []
        return self._suggested[key]


def by_name(elements: Iterable[Named]) -> dict[str, Named]:
    """Return the elements by their names; the first counts."""
    found: dict[str, Named] = {}
    for element in elements:
        found.setdefault(element.name, element)  # type: ignore[attr-defined]
    return found


def repeated(names: Iterable[str]) -> list[str]:
    """Return the names that occur more than once, in order."""
    return [name for name, count in Counter(names).items() if count > 1]


def place(*elements: Any) -> Location:
    """Return where the first of `elements` (innermost first) stands in the model file, or else in its source."""
    for element in elements:
        if element.at.file:
            return element.at  # type: ignore[no-any-return]
        origin = getattr(element, "origin", None)
        if origin is not None and origin.file:
            return origin.location  # type: ignore[no-any-return]
    return NOWHERE


def task_path(task: Task) -> Path:
    """Return how messages name a task: as `about` does, in less time, for checks ask for that of every task."""
    return Path(f'task "{task.name}"', (Subject("task", task.name),))


def version_path(task: Task, version: Version) -> Path:
    """Return how messages name a version; see `task_path`."""
    subjects = (Subject("task", task.name), Subject("version", version.name))
    return Path(f'task "{task.name}" version "{version.name}"', subjects)
