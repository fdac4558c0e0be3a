"""Rules complete, version, unit and binding: which jobs there are, what they run and where (MODEL 3 and 8.1)."""

from __future__ import annotations

from collections import Counter
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.records import record
from halpipe.models import Binding, TaskModel, Version
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.sharing import NAMED
from halpipe.pipeline.verify.tables import ActiveTask, ModeTable, Placed, Rule, Switch

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


def check_complete(table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the indices present with those expected, task by task."""
    counts = _Counts(table)
    for name, active in table.mode.tasks.items():
        yield from _repeated(table, name)
        if active.period is not None:
            yield from _periodic(table, name, table.period // active.period)
        elif active.task.period is None and counts.of(name) is not None:
            yield from _on_demand(table, name, counts)


def _repeated(table: ModeTable, name: str) -> Iterator[Diagnostic]:
    counted = Counter(placed.job.index for placed in table.by_task.get(name, ()))
    repeated = {index for index, count in counted.items() if count > 1}
    for placed in table.by_task.get(name, ()):
        if placed.job.index in repeated:
            repeated.remove(placed.job.index)
            text = f"is given more than once, here to start at {placed.job.start}"
            yield codes.REPEATED_JOB(text, at=placed.job.at, path=table.path(placed), help="keep one of them")


def _periodic(table: ModeTable, name: str, count: int) -> Iterator[Diagnostic]:
    present = sorted({placed.job.index for placed in table.by_task.get(name, ())})
    inside = [index for index in present if 0 <= index < count]
    for placed in table.by_task.get(name, ()):
        if not 0 <= placed.job.index < count:
            text = f"the task has {count} jobs in the hyperperiod, with the indices 0 to {count - 1}"
            yield codes.SURPLUS_JOB(text, at=placed.job.at, path=table.path(placed), help="remove the job")
    if len(inside) < count:
        text = f"has {len(inside)} of its {count} jobs; missing: {_gaps(inside, count)}"
        yield codes.MISSING_JOB(text, at=table.at, path=about(table.path(), task=name), help="schedule the mode again")


def _gaps(present: Sequence[int], count: int) -> str:
    """Describe which of 0 .. count-1 are not in `present` (ascending), as ranges: count may be astronomical."""
    gaps = []
    expected = 0
    for index in (*present, count):
        if index > expected:
            gaps.append(str(expected) if index == expected + 1 else f"{expected} to {index - 1}")
        expected = index + 1
    return ", ".join(gaps)


class _Counts:
    """N of every task of the mode, and the index of every demand.

    (D) Demands on a task are ordered by demanding task (model order), index of the demanding job, and slot: the
    position of the constraint among those of the chosen version that name the task.
    """

    def __init__(self, table: ModeTable) -> None:
        self._table = table
        self._demands: dict[str, dict[str, int]] = {}
        for name, active in table.mode.tasks.items():
            for target, most in _demands(active).items():
                if target != name:
                    self._demands.setdefault(target, {})[name] = most
        self._known = _resolve(table, self._demands)
        placed = (placed for name in table.mode.tasks for placed in table.by_task.get(name, ()))
        used = {id(each.version): each.version for each in placed if each.version is not None}
        self._rows = {key: Counter(row.task for row in version.precedences) for key, version in used.items()}

    def of(self, name: str) -> int | None:
        """Return N, or None where a cycle or an unusable period hides it."""
        return self._known.get(name)

    def arising(self, name: str) -> set[int]:
        """Return the indices of the jobs of `name` whose demand arises under the versions chosen."""
        indices: set[int] = set()
        base = 0
        for demander, most in self._demands.get(name, {}).items():
            count = self._known[demander]
            for placed in self._table.by_task.get(demander, ()):
                job = placed.job.index
                if placed.version is not None and 0 <= job < count:
                    slots = self._rows[id(placed.version)][name]
                    indices.update(range(base + job * most, base + job * most + slots))
            base += count * most
        return indices


def _resolve(table: ModeTable, demands: dict[str, dict[str, int]]) -> dict[str, int]:
    """Return N of every task for which it can be told, demanding tasks first."""
    tasks = table.mode.tasks
    known = {name: table.period // active.period for name, active in tasks.items() if active.period is not None}
    asked = {name: demands.get(name, {}) for name, active in tasks.items() if active.task.period is None}
    try:
        order = [name for name in TopologicalSorter(asked).static_order() if name in asked]
    except CycleError:  # the model's fault
        return known
    for name in order:
        if asked[name].keys() <= known.keys():
            known[name] = sum(most * known[demander] for demander, most in asked[name].items())
    return known


def _demands(active: ActiveTask) -> dict[str, int]:
    """Return, for every task the versions name, the largest number of constraints on it in one version."""
    most = Counter[str]()
    for version in active.versions.values():
        most |= Counter(precedence.task for precedence in version.precedences)
    return most


def _on_demand(table: ModeTable, name: str, counts: _Counts) -> Iterator[Diagnostic]:
    arising = counts.arising(name)
    present = {placed.job.index for placed in table.by_task.get(name, ())}
    for placed in table.by_task.get(name, ()):
        if placed.job.index not in arising:
            text = "no demand arises for this job under the versions chosen"
            yield codes.SURPLUS_JOB(text, at=placed.job.at, path=table.path(placed), help="remove the job")
    missing = sorted(arising - present)
    if missing:
        text = f"{len(arising)} demands arise, {len(arising) - len(missing)} are served; missing jobs: "
        text += ", ".join(str(index) for index in missing[:NAMED]) + (" and more" if len(missing) > NAMED else "")
        path = about(table.path(), task=name)
        yield codes.MISSING_JOB(text, at=table.at, path=path, help="schedule one job for each demand")


COMPLETE = Rule(
    "complete",
    "Every periodic task has exactly one job for each of its periods in the hyperperiod; a job on demand is present if "
    "and only if its demand arises under the versions chosen.",
    check_complete,
)


def check_version(table: ModeTable | Switch) -> Iterator[Diagnostic]:
    """Check lambda of every job of a mode, or of a table against the mode to come."""
    for placed in table.jobs:
        if placed.version is None:
            available = ", ".join(f'"{name}"' for name in placed.active.versions) or "none"
            text = f'uses version "{placed.job.version}", which is not available'
            help = f"available versions: {available}"
            yield codes.WRONG_VERSION(text, at=placed.job.at, path=table.path(placed), help=help)


def check_unit(table: ModeTable | Switch) -> Iterator[Diagnostic]:
    """Check phi of every job of a mode or table."""
    platform = {unit.name for unit in table.model.units}
    valid: dict[int, set[str]] = {}
    for placed in table.jobs:
        version = placed.version
        if version is None:
            continue
        units = valid.setdefault(id(version), platform.intersection(version.units))
        if len(placed.job.units) != version.gang or len(set(placed.job.units) & units) != version.gang:
            text = _unit_fault(placed.job.units, version, units, platform)
            help = "valid units: " + (", ".join(u for u in version.units if u in platform) or "none")
            yield codes.WRONG_UNIT(text, at=placed.job.at, path=table.path(placed), help=help)


def _unit_fault(given: tuple[str, ...], version: Version, valid: set[str], platform: set[str]) -> str:
    """Say everything that is wrong with the units of a job."""
    faults = []
    distinct = list(dict.fromkeys(given))
    if len(distinct) != len(given):
        faults.append("names a unit more than once")
    if len(distinct) != version.gang:
        faults.append(f'has {len(distinct)} units where version "{version.name}" occupies {version.gang}')
    for unit in distinct:
        if unit not in platform:
            faults.append(f'is on unit "{unit}", which does not exist')
        elif unit not in valid:
            faults.append(f'is on unit "{unit}", which is not valid for version "{version.name}"')
    return "; ".join(faults)


VERSION = Rule("version", "Every job uses a version of its task that is available in the mode.", check_version)
UNIT = Rule(
    "unit",
    "Every job occupies exactly as many distinct units as the gang size of its version, all valid for the version.",
    check_unit,
)


UnitSet = frozenset[str]


@record
class Tables:
    """All tables of a schedule, for what holds across them."""

    model: TaskModel
    modes: tuple[ModeTable, ...]
    switches: tuple[Switch, ...]


def check_binding(table: ModeTable) -> Iterator[Diagnostic]:
    """Check the jobs of a mode against each other.

    (D) Where jobs use several sets, the one that most of them use is taken as meant, of equals the one used first.
    """
    for name, active in table.mode.tasks.items():
        if active.task.binding is not Binding.JOB:
            jobs = table.by_task.get(name, ())
            yield from _elsewhere(jobs, _usual(jobs), table, "most of its jobs")


def check_binding_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check the jobs of a table against the mode to come, or each other where the mode has no job of the task."""
    bound = [placed for placed in switch.jobs if placed.active.task.binding is not Binding.JOB]
    for name, jobs in _by_task(bound).items():
        there = switch.target.by_task.get(name, ())
        yield from _elsewhere(jobs, _usual(there or jobs), switch, about(mode=switch.target.name))


def check_binding_of_system(tables: Tables) -> Iterator[Diagnostic]:
    """Check the modes and tables against each other: the set that each uses for most of a task's jobs."""
    everywhere: list[tuple[ModeTable | Switch, dict[str, list[Placed]]]] = [(t, t.by_task) for t in tables.modes]
    everywhere += [(switch, _by_task(switch.jobs)) for switch in tables.switches]
    for task in tables.model.tasks:
        if task.binding is not Binding.SYSTEM:
            continue
        places = [(table, by_task[task.name]) for table, by_task in everywhere if task.name in by_task]
        usual = _usual([placed for _, jobs in places for placed in jobs])
        for table, jobs in places:
            here = _usual(jobs)
            if here != usual:
                path = about(table.path(), task=task.name)
                text = f"uses {_listed(here)} here and {_listed(usual)} elsewhere, but is bound in the whole system"
                yield codes.NOT_BOUND(
                    text, at=jobs[0].job.at, path=path, help="use one unit set in all modes and tables"
                )


def _by_task(jobs: Iterable[Placed]) -> dict[str, list[Placed]]:
    """Return the jobs of every task, in their order."""
    by_task: dict[str, list[Placed]] = {}
    for placed in jobs:
        by_task.setdefault(placed.job.task, []).append(placed)
    return by_task


def _usual(jobs: Iterable[Placed]) -> UnitSet:
    """Return the unit set that most of the jobs use, of equals the first; an empty one without jobs."""
    counted = Counter(frozenset(placed.job.units) for placed in jobs)
    return max(counted, key=lambda units: counted[units], default=frozenset())


def _elsewhere(jobs: Iterable[Placed], usual: UnitSet, table: ModeTable | Switch, whose: str) -> Iterator[Diagnostic]:
    for placed in jobs:
        units = frozenset(placed.job.units)
        if units != usual:
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
