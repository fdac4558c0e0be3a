"""Witnesses about what jobs share: units and resources that are needed by too many at the same time."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from heapq import nsmallest
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models import Binding
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import Witness
from halpipe.pipeline.explain.meetings import Budget, Part, find_meeting
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts, Usable
    from halpipe.pipeline.explain.meetings import Step

MAX_CLASSES = 40
"""Unit sets of a mode that are looked at, the smallest first."""


# ------------------------------------------------------------------------------------------------ versions without gap


def prune(facts: ModeFacts) -> tuple[ModeFacts, list[Diagnostic], list[Witness]]:
    """Take away the versions that never find a gap on their unit; a task that loses all of them is a witness.

    Then the facts are returned as they were before it did.
    """
    notes: list[Diagnostic] = []
    for _ in range(len(facts.tasks)):
        blocked = _blocked(facts)
        if not blocked:
            break
        tasks = dict(facts.tasks)
        for name, reasons in blocked.items():
            left = tasks[name].without(reasons)
            if left is None:
                return facts, notes, [_no_gap(facts, tasks[name], reasons)]
            notes += [_never_fits(facts, tasks[name], version, reason) for version, reason in reasons.items()]
            tasks[name] = left
        facts = replace(facts, tasks=tasks)
    return facts, notes, []


@record
class _Gap:
    """The longest time that the jobs of a task leave free on a unit."""

    unit: str
    owner: TaskFacts
    length: int


def _blocked(facts: ModeFacts) -> dict[str, dict[str, _Gap]]:
    """Return, for every task, its versions that need a unit without a gap for them."""
    gaps: dict[str, list[_Gap]] = {}
    for task in facts.tasks.values():
        if task.period:
            slip = task.late if task.jobs > 1 else 0  # the one job of a hyperperiod recurs with the same delay
            for unit in sorted(task.sure_units()):
                gaps.setdefault(unit, []).append(_Gap(unit, task, task.period + slip - task.least))
    for unit, found in gaps.items():
        gaps[unit] = sorted(found, key=lambda gap: (gap.length, gap.owner.name))[:2]
    blocked: dict[str, dict[str, _Gap]] = {}
    for task in facts.tasks.values():
        for version in task.versions:
            gap = _obstacle(task, version, gaps)
            if gap is not None:
                blocked.setdefault(task.name, {})[version.version.name] = gap
    return blocked


def _obstacle(task: TaskFacts, version: Usable, gaps: dict[str, list[_Gap]]) -> _Gap | None:
    if len(version.units) != version.version.gang:
        return None
    for unit in sorted(version.units):
        for gap in gaps.get(unit, ()):
            if gap.owner.name != task.name and gap.length < version.piece:
                return gap
    return None


def _no_gap(facts: ModeFacts, task: TaskFacts, reasons: dict[str, _Gap]) -> Witness:
    parts = []
    for name, gap in reasons.items():
        needed = _needed(facts, _by_name(task, name))
        parts.append(f'{_version(task, name)} needs {needed} on "{gap.unit}", where {_gap(facts, gap)}')
    help = f"necessary: {'; or '.join(_ways_out(facts, task, name, gap) for name, gap in reasons.items())}"
    path = about(facts.mode.path, task=task.name)
    found = codes.NO_GAP("; ".join(parts), at=place(task.task), path=path, help=help)
    return Witness(found, tuple(dict.fromkeys((task.name, *(gap.owner.name for gap in reasons.values())))))


def _ways_out(facts: ModeFacts, task: TaskFacts, name: str, gap: _Gap) -> str:
    """Say what would have to change for the version to fit; slack only where the deadline has room for it."""
    owner, usable = gap.owner, _by_name(task, name)
    over = usable.piece - gap.length
    deadline = facts.ticks(owner.task.deadline) if owner.task.deadline is not None else owner.period
    slack = ""
    if owner.jobs > 1 and owner.late + over <= min(owner.period, deadline - owner.most):
        slack = f', a slack of "{owner.name}" of {format_rational(Fraction(owner.late + over, owner.period))}'
    which = f'"{name}" of "{task.name}"' if len(task.task.versions) > 1 else f'"{task.name}"'
    cut = _cut(facts, usable, gap)
    split = f", {which} cut into pieces of at most {facts.text(cut)} (split)" if cut else ""
    ways = f'{facts.text(over)} less WCET of {which} or of "{owner.name}"'
    if facts.services.get(gap.unit):
        ways = f'{facts.text(over)} less WCET or interrupts of {which} or of "{owner.name}"'
    elif usable.pauses:
        ways = f'{facts.text(over)} less in one piece of {which}, or less WCET of "{owner.name}"'
    return f"{ways}{slack}{split}, or another unit for one of them"


def _cut(facts: ModeFacts, usable: Usable, gap: _Gap) -> int:
    """Return the longest piece that finds its place in the gap, resumption and interrupts included; 0 for none.

    Access phases are not cut.
    """
    served = [row for unit in usable.units for row in facts.services.get(unit, ())]
    lost = facts.ticks(usable.version.split.resume) + sum(-(-gap.length // distance) * c for distance, c in served)
    room = gap.length - lost
    return max(0, room) if all(facts.ticks(a.end - a.start) <= room for a in usable.version.accesses) else 0


def _needed(facts: ModeFacts, usable: Usable) -> str:
    """Say what the version needs in one go."""
    return facts.text(usable.piece) + (" in one go" if usable.pauses else "")


def _gap(facts: ModeFacts, gap: _Gap) -> str:
    owner = gap.owner
    late = f" + {facts.text(owner.late)} of slack" if owner.late and owner.jobs > 1 else ""
    sum_text = f"{facts.text(owner.period)}{late} - {facts.text(owner.least)}"
    return f'the jobs of "{owner.name}" leave at most {facts.text(gap.length)} free ({sum_text})'


def _never_fits(facts: ModeFacts, task: TaskFacts, version: str, gap: _Gap) -> Diagnostic:
    path = about(facts.mode.path, task=task.name, version=version)
    needed = _needed(facts, _by_name(task, version))
    text = f'can never be chosen: it needs {needed} on "{gap.unit}", where {_gap(facts, gap)}'
    help = "nothing to do, unless the version is meant to be used"
    return codes.VERSION_NEVER_FITS(text, at=place(task.task), path=path, help=help)


def _version(task: TaskFacts, name: str) -> str:
    return f'version "{name}"' if len(task.task.versions) > 1 else "it"


def _by_name(task: TaskFacts, name: str) -> Usable:
    return next(v for v in task.versions if v.version.name == name)


# ------------------------------------------------------------------------------------------------ units


def units_met(facts: ModeFacts, model: TaskModel) -> Iterator[Witness]:
    """Look, in every set of units, for tasks that run there only, and that certainly meet on too few of them."""
    budget = Budget()
    found: list[frozenset[str]] = []
    for units, tasks in _classes(facts):
        if any(smaller <= units for smaller in found):
            continue
        parts = [Part(t.name, t.period, t.core, min(v.version.gang for v in t.versions)) for t in tasks]
        steps = find_meeting(parts, len(units), budget)
        if steps:
            found.append(units)
            yield _units_short(facts, model, sorted(units), steps)


def _classes(facts: ModeFacts) -> list[tuple[frozenset[str], list[TaskFacts]]]:
    """Return the unit sets of the mode, small ones first, each with the tasks confined to it and surely running."""
    own = grouped((task.units, task) for task in facts.tasks.values() if task.core > 0 and task.period)
    everything = frozenset().union(*own)
    sets = sorted({*own, everything}, key=lambda units: (len(units), sorted(units)))[:MAX_CLASSES]
    return [(units, [t for inner, tasks in own.items() if inner <= units for t in tasks]) for units in sets if units]


def _units_short(facts: ModeFacts, model: TaskModel, units: list[str], steps: tuple[Step, ...]) -> Witness:
    needed = sum(step.part.height for step in steps)
    names = [step.part.task for step in steps]
    what = f"{len(units)} unit{'s' if len(units) > 1 else ''} {few(units)}"
    text = f"{few(names, 12)} can run only on {what} and need {needed} of them at the same time, whatever their "
    text += f"phases: {_argument(facts, steps)}"
    types = dict.fromkeys(unit.type for unit in model.units if unit.name in units and unit.type)
    kind = f" of type {' or '.join(few([t]) for t in types)}" if types else ""
    short = format_rational(Fraction(needed) - len(units))
    help = f"necessary: {short} more unit{kind} for them, {_relief(facts, steps)}, or jobs that may be split"
    found = codes.TASKS_MEET(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, _names(steps))


def _names(steps: tuple[Step, ...]) -> tuple[str, ...]:
    """Return the tasks that meet, each once."""
    return tuple(dict.fromkeys(step.part.task for step in steps))


def _argument(facts: ModeFacts, steps: tuple[Step, ...]) -> str:
    """Spell the sums out, so that they can be checked with pencil and paper."""
    first = steps[0].part
    lines: list[str] = []
    period = first.period
    before = first.length
    for step in steps[1:]:
        part = step.part
        text = f'{facts.text(part.length)} of "{part.task}" + {facts.text(before)} '
        text += f'of "{first.task}"' if not lines else "of those together"
        text += f" > {facts.text(step.gcd)} = gcd({facts.text(part.period)}, {facts.text(period)})"
        if step is not steps[-1]:
            text += f", so they are together for at least {facts.text(step.together)}"
        lines.append(text)
        period, before = math.lcm(period, part.period), step.together
    certain = [s.part.task for s in steps if s.part.task in facts.tasks and facts.tasks[s.part.task].late]
    note = f" (of {few(certain)} only what slack does not move is counted)" if certain else ""
    return "; ".join(lines) + note


def _relief(facts: ModeFacts, steps: tuple[Step, ...]) -> str:
    """Say by how much the sum of the last step must shrink; slack counts as much as WCET."""
    last = steps[-1]
    amount = facts.text(last.part.length + steps[-2].together - last.gcd)
    if len(steps) == 2:
        return f"{amount} less of WCET or more of slack, of the two together"
    return f'less WCET or more slack, such as {amount} of "{last.part.task}"'


# ------------------------------------------------------------------------------------------------ resources


def resources_met(facts: ModeFacts) -> Iterator[Witness]:
    """Look for access phases on a resource that certainly meet, with bounds that sum to more than 1."""
    parts: dict[str, list[Part]] = {}
    for task in facts.tasks.values():
        if task.period and len(task.versions) == 1 and not task.versions[0].pauses:
            for access in task.versions[0].version.accesses:
                length = int((access.end.ns - access.start.ns) * facts.scale) - task.late
                if length > 0:
                    parts.setdefault(access.resource, []).append(Part(task.name, task.period, length, access.bound))
    budget = Budget()
    for resource in sorted(parts):
        steps = find_meeting(parts[resource], 1, budget)
        if steps:
            yield _resource_short(facts, resource, steps)


def _resource_short(facts: ModeFacts, resource: str, steps: tuple[Step, ...]) -> Witness:
    total = sum((Fraction(step.part.height) for step in steps), Fraction(0))
    names = list(dict.fromkeys(step.part.task for step in steps))
    text = f'access phases of {few(names, 12)} on resource "{resource}" meet, whatever the phases of the tasks, and '
    text += f"their bounds sum to {format_rational(total)}: {_argument(facts, steps)}"
    relief = _relief(facts, steps).replace("WCET", "access time")
    help = f"necessary: lower bounds that sum to at most 1, {relief}, or jobs that may be split before their phases"
    found = codes.PHASES_MEET(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, _names(steps))


# ------------------------------------------------------------------------------------------------ bound tasks

MAX_ITEMS = 32
"""Tasks that are looked at, those with the largest loads."""

EFFORT = 20_000
"""Units tried for tasks in one search."""


@record
class _Item:
    """A task that keeps to one of some units; its jobs take `load` of it, `core` of every `period` at one time."""

    task: TaskFacts
    load: Fraction
    units: tuple[str, ...]

    def excludes(self, other: _Item) -> bool:
        """Return whether the jobs of two tasks must meet if they are on one unit."""
        return self.task.core + other.task.core > math.gcd(self.task.period, other.task.period)


def packings(facts: ModeFacts) -> Iterator[Witness]:
    """Look for a set of tasks that each stay on one unit, of which no assignment keeps every unit at most full.

    Every assignment is tried, with bounds, up to an effort; of equal units only one is. Two strictly periodic tasks
    whose jobs must meet share no unit. What is left out of the set that is named makes it assignable.
    """
    items = list(_items(facts))
    if not _is_impossible(items):
        return
    for item in reversed(items.copy()):
        rest = [other for other in items if other is not item]
        if _is_impossible(rest):
            items = rest
    if len(items) > 2:  # two tasks and single units have witnesses of their own
        yield _witness(facts, items)


def _items(facts: ModeFacts) -> Iterator[_Item]:
    single = [task for task in facts.tasks.values() if task.period and all(v.version.gang == 1 for v in task.versions)]
    bound = [task for task in single if task.task.binding is not Binding.JOB or len(task.units) == 1]
    cycle = math.lcm(*{task.period for task in bound})
    for task in nsmallest(MAX_ITEMS, bound, key=lambda task: (-task.least * (cycle // task.period), task.name)):
        yield _Item(task, Fraction(task.least, task.period), tuple(sorted(task.units)))


def _is_impossible(items: list[_Item]) -> bool:
    """Return whether no assignment exists; False where the effort was spent."""
    budget = Budget(EFFORT)
    held: dict[str, list[_Item]] = {unit: [] for item in items for unit in item.units}
    users = {unit: frozenset(item.task.name for item in items if unit in item.units) for unit in held}
    return not _assign(items, 0, held, users, budget) and budget.steps >= 0


def _assign(
    items: list[_Item],
    number: int,
    held: dict[str, list[_Item]],
    users: dict[str, frozenset[str]],
    budget: Budget,
) -> bool:
    """Assign the items from `number` on; True also where the effort is spent, since nothing is known then."""
    if number == len(items):
        return True
    item, empty = items[number], set()
    for unit in item.units:
        others = held[unit]
        if not others and users[unit] in empty:
            continue
        empty |= set() if others else {users[unit]}
        if sum((other.load for other in others), item.load) > 1 or any(item.excludes(other) for other in others):
            continue
        if not budget.spend():
            return True
        others.append(item)
        if _assign(items, number + 1, held, users, budget):
            return True
        others.pop()
    return False


def _witness(facts: ModeFacts, items: list[_Item]) -> Witness:
    names = [item.task.name for item in items]
    units = sorted({unit for item in items for unit in item.units})
    takes = ", ".join(
        f'"{item.task.name}" takes {facts.text(item.task.least)} of every {facts.text(item.task.period)}'
        for item in items
    )
    text = f"{takes}; each stays on one of its units, and no assignment to {few(units)} keeps every unit at most full"
    pairs = sum(one.excludes(other) for at, one in enumerate(items) for other in items[at + 1 :])
    if pairs:
        text += f" ({pairs} pairs share no unit: their times exceed the gcd of their periods)"
    help = "necessary: another unit, shorter WCETs, or a binding by job for some of them"
    found = codes.NO_ASSIGNMENT(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, tuple(names))
