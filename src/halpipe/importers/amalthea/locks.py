"""Semaphores as locks: which of them a version holds, and from when to when in its execution (MODEL 10.5).

Positions are cycles of stated execution time. Where a branch or loop decides when a semaphore is held, the whole branch
or loop holds it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import CALLS, GROUPS, everything, steps
from halpipe.importers.amalthea.names import Names

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from halpipe.importers.amalthea.graph import Evaluator
    from halpipe.importers.amalthea.hardware import Pu
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Draft
    from halpipe.importers.amalthea.xmi import Forest, Item

_ACCESS = "SemaphoreAccess"
_MOST_STEPS = 10_000
"""Steps with semaphores that are followed one by one; what comes after them holds its semaphores as a whole."""


@record
class Held:
    """A semaphore that is held from `begin` to `end`, in cycles."""

    semaphore: Item
    begin: Fraction
    end: Fraction


class Locks:
    """Finds what versions hold; reports semaphores that several jobs may hold, and those that a job does not return."""

    def __init__(self, forest: Forest, evaluator: Evaluator, taken: Sequence[str]) -> None:
        self._forest = forest
        self._evaluator = evaluator
        self._names = Names(forest.findings)
        for name in taken:
            self._names.reserve(name)
        self.names: dict[Item, str] = {}
        self._shared: dict[Item, None] = {}
        self._unpaired: dict[Item, None] = {}

    def name(self, semaphore: Item) -> str:
        """Return the name of a semaphore as a resource."""
        if semaphore not in self.names:
            self.names[semaphore] = self._names.unique(semaphore.name, "semaphore", semaphore.at)
        return self.names[semaphore]

    def held(self, draft: Draft, mode: SystemMode, unit: Pu) -> list[Held]:
        """Return what a job of a draft holds, each semaphore once for each time."""
        walk = _Walk(self._forest, self._evaluator, mode, unit)
        walk.through(draft.part.steps)
        for step, semaphore in walk.open.values():
            self._unpaired[step] = None
            walk.found.append(Held(semaphore, walk.begins[semaphore], walk.at))
        for step in walk.unpaired:
            self._unpaired[step] = None
        return self._merged([held for held in walk.found if self._is_lock(held.semaphore)])

    def _is_lock(self, semaphore: Item) -> bool:
        most = self._forest.number(semaphore, "maxValue")
        if most is not None and most > 1:
            self._shared[semaphore] = None
            return False
        return True

    def _merged(self, found: Sequence[Held]) -> list[Held]:
        kept: list[Held] = []
        for held in sorted(found, key=lambda h: (self.name(h.semaphore), h.begin, h.end)):
            held.semaphore.use()
            last = kept[-1] if kept else None
            if last is not None and last.semaphore is held.semaphore and held.begin <= last.end:
                kept[-1] = Held(held.semaphore, last.begin, max(last.end, held.end))
            elif held.begin < held.end:
                kept.append(held)
        return kept

    def report(self) -> None:
        """Report what a lock does not say."""
        help = "state in an overlay which tasks exclude each other"
        what = "semaphores may be held several times, so they exclude nothing"
        self._forest.report_each(codes.NOT_READ, what, list(self._shared), help)
        help = "request and release a semaphore in one task, between its waits"
        what = "requests and releases of semaphores have no counterpart in their job"
        self._forest.report_each(codes.NOT_READ, what, list(self._unpaired), help)


class _Walk:
    """One way through a job: the position, and what is held there."""

    def __init__(self, forest: Forest, evaluator: Evaluator, mode: SystemMode, unit: Pu) -> None:
        self._forest = forest
        self._evaluator = evaluator
        self._mode = mode
        self._unit = unit
        self.at = evaluator.amount((), mode, unit).cycles
        self.begins: dict[Item, Fraction] = {}
        self.open: dict[Item, tuple[Item, Item]] = {}
        self.found: list[Held] = []
        self.unpaired: list[Item] = []
        self._left = _MOST_STEPS

    def through(self, found: Sequence[Item]) -> None:
        for step in found:
            self._left -= 1
            if step.kind == _ACCESS:
                self._access(step)
            elif not any(inner.kind == _ACCESS for inner in everything(self._forest, [step])):
                self.at += self._evaluator.amount([step], self._mode, self._unit).cycles
            elif self._left <= 0:
                self._whole(step)
            elif step.kind in GROUPS and step.kind != "WhileLoop":
                self.through(steps(step))
            elif step.kind in CALLS and step.one("statistic") is None:
                called = self._forest.ref(step, CALLS[step.kind])
                if called is not None and self._evaluator.conditions(self._mode).allows(called):
                    self.through(steps(called))
            else:
                self._whole(step)

    def _access(self, step: Item) -> None:
        semaphore = self._forest.ref(step, "semaphore")
        if semaphore is None:
            return
        step.use_all()
        if step.get("access") != "release":
            self.begins.setdefault(semaphore, self.at)
            self.open.setdefault(semaphore, (step, semaphore))
        elif semaphore in self.open:
            del self.open[semaphore]
            self.found.append(Held(semaphore, self.begins.pop(semaphore), self.at))
        else:
            self.unpaired.append(step)

    def _whole(self, step: Item) -> None:
        begin = self.at
        self.at += self._evaluator.amount([step], self._mode, self._unit).cycles
        for inner in everything(self._forest, [step]):
            semaphore = self._forest.ref(inner, "semaphore") if inner.kind == _ACCESS else None
            if semaphore is not None:
                inner.use_all()
                self.found.append(Held(semaphore, begin, self.at))
