"""Witnesses about precedence windows: what they say of the phases of tasks, up to multiples of common divisors.

Every constraint of a task i on a task x, both periodic, bounds the difference of their phases s_i - s_x modulo
gcd(D_i, D_x). Round a cycle of such bounds the differences sum to zero, modulo the greatest common divisor of all the
periods on it.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models import Anchor
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import Witness
from halpipe.pipeline.solve.construction import Groups
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.core.diagnostics import Location
    from halpipe.core.durations import Duration
    from halpipe.models import Chain, Precedence, TaskModel
    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts, Usable

MAX_PAIRS = 20_000
"""Pairs of tasks on one unit that are compared."""

ORIGIN = ""
"""The instant 0, from which offsets count, as a node among the tasks."""


@record
class Bound:
    """s_later - s_earlier lies in [low, high] modulo `modulus`; `says` tells where that comes from."""

    later: str
    earlier: str
    low: int
    high: int
    modulus: int
    says: Callable[[], str]


def contradictions(facts: ModeFacts) -> Iterator[Witness]:
    """Find windows that are too narrow for the periods, and those that contradict each other or a shared unit."""
    bounds = [*_windows(facts), *_offsets(facts)]
    narrow = [bound for bound in bounds if _is_too_narrow(facts, bound)]
    for bound in narrow:
        yield _narrow(facts, bound)
    if not narrow:
        yield from _cycles(facts, bounds)


# ------------------------------------------------------------------------------------------------ bounds


def _windows(facts: ModeFacts) -> Iterator[Bound]:
    """Return what the constraints say; of several versions, what all of them say."""
    for task in facts.tasks.values():
        if not task.period:
            continue
        first = task.versions[0].version.precedences
        for slot, row in enumerate(first):
            other = facts.tasks.get(row.task)
            if other is None or not other.period or row.task == task.name:
                continue
            nth = sum(r.task == row.task for r in first[:slot])
            rows = [_nth(version.version.precedences, row.task, nth) for version in task.versions]
            spans = [_span(facts, other, r) for r in rows if r is not None]
            if len(spans) == len(rows):
                low = min(span[0] for span in spans) - task.late
                high = max(span[1] for span in spans) + other.late
                modulus = math.gcd(task.period, other.period)
                if high - low < max(modulus, other.period - modulus):  # wider ones say nothing
                    yield Bound(task.name, row.task, low, high, modulus, partial(_window_text, task, other, row))


def _nth(rows: Iterable[Precedence], task: str, number: int) -> Precedence | None:
    named = [row for row in rows if row.task == task]
    return named[number] if number < len(named) else None


def _span(facts: ModeFacts, other: TaskFacts, row: Precedence) -> tuple[int, int]:
    """Return between which distances from the predecessor's start the job starts."""
    low, high = int(row.min.ns * facts.scale), int(row.max.ns * facts.scale)
    if row.anchor is Anchor.END:
        return low + other.least, high + other.most
    return low, high


def _window_text(task: TaskFacts, other: TaskFacts, row: Precedence) -> str:
    return f'"{task.name}" starts [{row.min}, {row.max}] after the {row.anchor} of "{other.name}"'


def _offsets(facts: ModeFacts) -> Iterator[Bound]:
    for task in facts.tasks.values():
        if task.period and task.task.offset is not None:
            offset = int(task.task.offset.ns * facts.scale)
            yield Bound(task.name, ORIGIN, offset, offset, task.period, partial(_offset_text, task))


def _offset_text(task: TaskFacts) -> str:
    return f'"{task.name}" has the offset {task.task.offset}'


# ------------------------------------------------------------------------------------------------ one window


def _is_too_narrow(facts: ModeFacts, bound: Bound) -> bool:
    """Tell whether the window cannot hold all distances that occur: the multiples of gcd(D_i, D_x) within D_x."""
    if bound.earlier == ORIGIN:
        return False
    return bound.high - bound.low < facts.tasks[bound.earlier].period - bound.modulus


def _narrow(facts: ModeFacts, bound: Bound) -> Witness:
    task, other = facts.tasks[bound.later], facts.tasks[bound.earlier]
    least = other.period - bound.modulus
    text = f"{bound.says()}, but its jobs lie in {other.period // bound.modulus} different places between those of "
    text += f'"{other.name}", {facts.text(bound.modulus)} = gcd({facts.text(task.period)}, {facts.text(other.period)}) '
    text += f"apart; that takes a window {facts.text(least)} wide, and it is {facts.text(bound.high - bound.low)} wide"
    text += " with the slack of both" if task.late or other.late else ""
    help = f"necessary: a window (or slack) wider by {facts.text(least - bound.high + bound.low)}, or equal periods"
    path = about(facts.mode.path, task=task.name)
    found = codes.WINDOW_TOO_NARROW(text, at=_line(task, other), path=path, help=help)
    return Witness(found, (bound.later, bound.earlier))


def _line(task: TaskFacts, other: TaskFacts) -> Location:
    """Return where the constraint of `task` on `other` stands."""
    for usable in task.versions:
        for row in usable.version.precedences:
            if row.task == other.name:
                return place(row, usable.version, task.task)
    return place(task.task)


# ------------------------------------------------------------------------------------------------ cycles


def _cycles(facts: ModeFacts, bounds: list[Bound]) -> Iterator[Witness]:
    """Put the narrowest bounds into a forest; every other one closes a cycle with a path in it."""
    forest = _Forest(facts)
    closing = [bound for bound in sorted(bounds, key=_width) if not forest.add(bound)]
    for bound in closing:
        yield from _contradiction(facts, forest.path(bound.later, bound.earlier), bound)
    for bound in _apart(facts, forest):
        yield from _contradiction(facts, forest.path(bound.later, bound.earlier), bound)


def _width(bound: Bound) -> tuple[int, str, str]:
    return bound.high - bound.low, bound.later, bound.earlier


class _Forest:
    """Trees of bounds between their nodes."""

    def __init__(self, facts: ModeFacts) -> None:
        self._near: dict[str, list[tuple[str, Bound]]] = {name: [] for name in (*facts.tasks, ORIGIN)}
        self.trees = Groups[str]()

    def add(self, bound: Bound) -> bool:
        """Join two trees; return False where the bound lies within one."""
        if not self.trees.join(bound.earlier, bound.later):
            return False
        self._near[bound.later].append((bound.earlier, bound))
        self._near[bound.earlier].append((bound.later, bound))
        return True

    def path(self, later: str, earlier: str) -> list[Bound]:
        """Return the bounds on the way from `earlier` to `later`."""
        came: dict[str, tuple[str, Bound] | None] = {earlier: None}
        ahead = [earlier]
        for name in ahead:
            if name == later:
                break
            for other, bound in self._near[name]:
                if other not in came:
                    came[other] = (name, bound)
                    ahead.append(other)
        steps = []
        at = came[later]
        while at is not None:
            steps.append(at[1])
            at = came[at[0]]
        return steps[::-1]


def _apart(facts: ModeFacts, forest: _Forest) -> Iterator[Bound]:
    """Return for pairs of connected tasks on the same unit how far apart their jobs must stay."""
    by_unit: dict[tuple[str, str], list[TaskFacts]] = {}
    for task in facts.tasks.values():
        if task.period and task.core > 0:
            for unit in task.sure_units():
                by_unit.setdefault((forest.trees.root(task.name), unit), []).append(task)
    left = MAX_PAIRS
    for (_, unit), tasks in sorted(by_unit.items(), key=lambda item: item[0]):
        for place_of, first in enumerate(tasks):
            for second in tasks[place_of + 1 :]:
                left -= 1
                if left < 0:
                    return
                modulus = math.gcd(first.period, second.period)
                shift = first.late - second.late
                low, high = first.core + shift, modulus - second.core + shift
                if low <= high:  # else they meet anyway, which is another witness
                    text = partial(_apart_text, facts, first, second, unit, modulus)
                    yield Bound(second.name, first.name, low, high, modulus, text)


def _apart_text(facts: ModeFacts, first: TaskFacts, second: TaskFacts, unit: str, modulus: int) -> str:
    text = f'"{second.name}" and "{first.name}" both run on "{unit}", for at least '
    return text + f"{facts.text(second.core)} and {facts.text(first.core)} of every {facts.text(modulus)}"


def _contradiction(facts: ModeFacts, path: list[Bound], closing: Bound) -> Iterator[Witness]:
    """Compare what the path says of the distance with what the closing bound says."""
    modulus = math.gcd(closing.modulus, *(bound.modulus for bound in path))
    at, low, high = closing.earlier, 0, 0
    for bound in path:
        forward = bound.earlier == at
        low, high = (low + bound.low, high + bound.high) if forward else (low - bound.high, high - bound.low)
        at = bound.later if forward else bound.earlier
    # path - closing must contain a multiple of the modulus
    least, most = low - closing.high, high - closing.low
    if most // modulus * modulus >= least:
        return
    names = [n for n in dict.fromkeys(n for b in (*path, closing) for n in (b.earlier, b.later)) if n != ORIGIN]
    steps = "; ".join(dict.fromkeys(bound.says() for bound in path))
    text = f"{steps}: this puts {_pair(closing)} {_interval(facts, low, high)} apart, up to multiples of "
    text += f"{facts.text(modulus)}; but {closing.says()}, which asks for {_interval(facts, closing.low, closing.high)}"
    text += " (slack included)" if any(facts.tasks[name].late for name in names) else ""
    below = most // modulus * modulus
    room = min(least - below, below + modulus - most)
    help = f"necessary: windows, slack or an offset that give way by {facts.text(room)} in sum"
    found = codes.WINDOWS_CONTRADICT(text, at=place(facts.tasks[names[0]].task), path=facts.mode.path, help=help)
    yield Witness(found, tuple(names))


def _pair(bound: Bound) -> str:
    if bound.earlier == ORIGIN:
        return f'the releases of "{bound.later}" and the instant 0'
    return f"the releases of {few([bound.later])} and {few([bound.earlier])}"


def _interval(facts: ModeFacts, low: int, high: int) -> str:
    return facts.text(low) if low == high else f"{facts.text(low)} to {facts.text(high)}"


# ------------------------------------------------------------------------------------------------ units held for long
# Witnesses about work that holds a unit in one piece while a chain with a limit needs that unit.
#
# Let X hold the unit for c at a time. A chain's limit leaves its task t no time for the versions that run elsewhere, so
# the job of t that the chain goes through runs on the unit, before X or after it. If before, the chain's data come from
# too long ago for its readers after X; and no reader may be missing for longer than two of its jobs are apart.


@record
class _Need:
    """That a chain goes through a job of `task` on `unit` so often that the unit is never without one for `room`.

    Elsewhere the chain would take `elsewhere` at least, or None where the task cannot run elsewhere at all.
    """

    chain: Chain
    limit: str
    task: TaskFacts
    unit: str
    room: int
    elsewhere: int | None


def blockings(facts: ModeFacts, model: TaskModel) -> Iterator[Witness]:
    """Find tasks that hold a unit for longer at a time than a chain can do without it."""
    holders = _holders(facts)
    for chain in model.chains:
        if not all(name in facts.tasks and facts.tasks[name].period for name in chain.tasks):
            continue
        members = [facts.tasks[name] for name in chain.tasks]
        for unit, (holder, length) in holders.items():
            for need in (*_by_age(facts, chain, members, unit), *_by_reaction(facts, chain, members, unit)):
                if need.task is not holder and length > need.room:
                    yield _blocked(facts, holder, length, need)


def _holders(facts: ModeFacts) -> dict[str, tuple[TaskFacts, int]]:
    """Return for every unit the task that certainly holds it longest in one piece."""
    holders: dict[str, tuple[TaskFacts, int]] = {}
    for task in facts.tasks.values():
        length = min(version.piece for version in task.versions)
        for unit in task.sure_units():
            if unit not in holders or length > holders[unit][1]:
                holders[unit] = (task, length)
    return dict(sorted(holders.items()))


def _by_age(facts: ModeFacts, chain: Chain, members: Sequence[TaskFacts], unit: str) -> Iterator[_Need]:
    """Let the last task read data that are at most so old; its jobs are at most D + slack * D apart."""
    if chain.max_age is None:
        return
    limit, last = facts.ticks(chain.max_age), members[-1]
    others = sum(task.least for task in members)
    for task in members[:-1]:
        rest = others - task.least
        there = _there(task, unit, limit - rest)
        if there is not None:
            room = limit + last.period + last.late - 2 * there - rest
            yield _Need(chain, _text("data age", chain.max_age), task, unit, room, _elsewhere(task, unit, rest))


def _by_reaction(facts: ModeFacts, chain: Chain, members: Sequence[TaskFacts], unit: str) -> Iterator[_Need]:
    """Let the first task write: what it misses is seen by its next job, and must have had its effect in time."""
    if chain.max_reaction is None:
        return
    limit, first = facts.ticks(chain.max_reaction), members[0]
    others = sum(task.least for task in members)
    for task in members[1:]:
        rest = others - task.least
        missed = first.period - first.late
        there = _there(task, unit, limit - rest - missed)
        if there is not None:
            room = limit - 2 * there - rest
            yield _Need(
                chain,
                _text("reaction time", chain.max_reaction),
                task,
                unit,
                room,
                _elsewhere(task, unit, rest + missed),
            )


def _there(task: TaskFacts, unit: str, most: int) -> int | None:
    """Return the least time of a job on the unit; None unless all versions elsewhere take longer than `most`.

    Nor where a job may pause on it: then it may begin before, and end after, what holds the unit.
    """
    on_unit = [version for version in task.versions if _is_on(version, unit)]
    if not on_unit or any(version.pauses for version in on_unit):
        return None
    if any(version.wcet <= most for version in task.versions if not _is_on(version, unit)):
        return None
    return min(version.wcet for version in on_unit)


def _elsewhere(task: TaskFacts, unit: str, rest: int) -> int | None:
    away = [version.wcet for version in task.versions if not _is_on(version, unit)]
    return min(away) + rest if away else None


def _is_on(version: Usable, unit: str) -> bool:
    return unit in version.units and len(version.units) == version.version.gang


def _text(what: str, limit: Duration) -> str:
    return f"{what} of {limit}"


def _blocked(facts: ModeFacts, holder: TaskFacts, length: int, need: _Need) -> Witness:
    held, room = facts.text(length), facts.text(max(0, need.room))
    text = f'"{holder.name}" holds "{need.unit}" for {held} at a time; chain "{need.chain.name}" with its {need.limit} '
    text += f'goes through jobs of "{need.task.name}" on "{need.unit}"'
    if need.elsewhere is not None:
        text += f", since elsewhere it would take {facts.text(need.elsewhere)} at least"
    text += f"; so the next of them must start within {room} after one has ended"
    if need.room <= 0:
        text += ", and whatever holds the unit in between is too long"
    over = facts.text(length - need.room)
    help = (
        f'necessary: {over} less in one piece of "{holder.name}" or more for chain "{need.chain.name}", or another unit'
    )
    path = f'{facts.mode.path} task "{holder.name}"'
    found = codes.UNIT_HELD(text, at=place(holder.task), path=path, help=help)
    return Witness(found, tuple(dict.fromkeys((holder.name, *need.chain.tasks))))
