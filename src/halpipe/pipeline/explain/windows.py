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
from halpipe.models import Anchor
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import Witness
from halpipe.pipeline.validate.context import place, quoted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from halpipe.core.diagnostics import Location
    from halpipe.models import Precedence
    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts

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
    """Trees of bounds; every node knows its parent and the bound between them."""

    def __init__(self, facts: ModeFacts) -> None:
        self._near: dict[str, list[tuple[str, Bound]]] = {name: [] for name in (*facts.tasks, ORIGIN)}
        self.tree: dict[str, str] = {name: name for name in self._near}

    def root(self, name: str) -> str:
        """Return the representative of the tree that `name` is in."""
        while self.tree[name] != name:
            self.tree[name] = name = self.tree[self.tree[name]]
        return name

    def add(self, bound: Bound) -> bool:
        """Join two trees; return False where the bound lies within one."""
        later, earlier = self.root(bound.later), self.root(bound.earlier)
        if later == earlier:
            return False
        self.tree[later] = earlier
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
                by_unit.setdefault((forest.root(task.name), unit), []).append(task)
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
    return f"the releases of {quoted([bound.later])} and {quoted([bound.earlier])}"


def _interval(facts: ModeFacts, low: int, high: int) -> str:
    return facts.text(low) if low == high else f"{facts.text(low)} to {facts.text(high)}"
