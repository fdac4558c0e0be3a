"""Rule complete: the right jobs are present (MODEL 3; paper, section III, N_theta)."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule
from halpipe.pipeline.verify.sweep import NAMED

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Version
    from halpipe.pipeline.verify.tables import ActiveTask, ModeTable


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
                    slots = _slots(placed.version, name)
                    indices.update(range(base + job * most, base + job * most + slots))
            base += count * most
        return indices


def _resolve(table: ModeTable, demands: dict[str, dict[str, int]]) -> dict[str, int]:
    """Return N of every task for which it can be told, demanding tasks first."""
    known: dict[str, int] = {}
    waiting: dict[str, int] = {}
    served: dict[str, list[str]] = {}
    ready: list[str] = []
    for name, active in table.mode.tasks.items():
        if active.period is not None:
            known[name] = table.period // active.period
            ready.append(name)
        elif active.task.period is None:
            waiting[name] = len(demands.get(name, {}))
            if not waiting[name]:
                known[name] = 0
                ready.append(name)
        for demander in demands.get(name, {}):
            served.setdefault(demander, []).append(name)
    while ready:
        for name in served.get(ready.pop(), ()):
            if name in waiting:
                waiting[name] -= 1
                if waiting[name] == 0:
                    known[name] = sum(most * known[demander] for demander, most in demands[name].items())
                    ready.append(name)
    return known


def _demands(active: ActiveTask) -> dict[str, int]:
    """Return, for every task the versions name, the largest number of constraints on it in one version."""
    most: dict[str, int] = {}
    for version in active.versions.values():
        for target, count in Counter(p.task for p in version.precedences).items():
            most[target] = max(most.get(target, count), count)
    return most


def _slots(version: Version, name: str) -> int:
    return sum(precedence.task == name for precedence in version.precedences)


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
