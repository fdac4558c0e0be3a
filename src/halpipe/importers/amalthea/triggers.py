"""Triggers within activity graphs: how often a job makes each of them, and which occurrences their counters let pass.

A counter lets every `prescaler`-th occurrence pass, the first after `offset` others. Counters stand at stimuli, at
triggers and at the calls of runnables that trigger.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea.graph import CALLS, SWITCHES, branches, call_count, steps

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.amalthea.xmi import Forest, Item

TRIGGERS = {"InterProcessTrigger": "stimulus", "InterProcessActivation": "stimulus", "CustomEventTrigger": "event"}
MOST = 1000
"""Activations of a task, and triggers of a job."""
_MOST_LEVELS = 100


@record
class Count:
    """Every `each`-th occurrence passes, the first after `first` others."""

    each: int = 1
    first: int = 0

    def then(self, inner: Count) -> Count:
        """Return what passes both counters, this one first."""
        return Count(self.each * inner.each, self.first + self.each * inner.first)


@record
class Occurrence:
    """A trigger of a stimulus or event, or a call of a runnable (`target`), within the step `top` of a job."""

    target: Item
    cause: Item
    top: Item
    count: Count = Count()


def thinned(number: int, count: Count) -> list[Count] | None:
    """Return what passes of `number` occurrences in each job; None if jobs differ in how many pass."""
    if count.each == 1:
        return [Count()] * number
    if number == 1:
        return [count]
    if number % count.each == 0:
        return [Count()] * (number // count.each)
    return [Count(count.each // number, count.first // number)] if count.each % number == 0 else None


class Triggers:
    """Finds the occurrences; `unread` collects the counters that are not followed, so that more occurrences pass.

    `counted` collects calls with counters: what they trigger is thinned, but their work counts in each job.
    """

    def __init__(self, forest: Forest) -> None:
        self._forest = forest
        self._of_runnable: dict[Item, list[Occurrence]] = {}
        self._calling: set[Item] = set()
        self.unread: dict[Item, None] = {}
        self.counted: dict[Item, None] = {}
        self.is_too_much = False
        events = [e for s in forest.kinds("EventStimulus") for e in forest.refs(s, "triggeringEvents")]
        self._wanted = {forest.ref(event, "entity") for event in events if event.kind == "RunnableEvent"}

    def of(self, found: Iterable[Item]) -> list[Occurrence]:
        """Return what some steps of a job trigger and call, each as often as they do."""
        made = [occurrence for step in found for occurrence in self._step(step)]
        self.is_too_much = self.is_too_much or len(made) > MOST
        return self._followed(made[:MOST])

    def counter(self, item: Item) -> Count:
        """Return the counter of a stimulus or a step."""
        counter = item.one("counter")
        if counter is None:
            return Count()
        each, first = self._forest.number(counter, "prescaler"), self._forest.number(counter, "offset")
        return Count(max(1, int(each or 1)), int(first or 0))

    def _followed(self, made: Sequence[Occurrence]) -> list[Occurrence]:
        """Return the occurrences with counters that count all of one job together."""
        groups: defaultdict[tuple[Item, Item, Count], list[Occurrence]] = defaultdict(list)
        for one in made:
            groups[one.target, one.cause, one.count].append(one)
        found = []
        for (target, cause, count), same in groups.items():
            passing = thinned(len(same), count)
            if passing is None:
                self.unread[cause] = None
                passing = [Count()] * len(same)
            found += [Occurrence(target, cause, same[0].top, each) for each in passing]
        return found

    def _step(self, step: Item) -> list[Occurrence]:
        if step.kind in TRIGGERS:
            target = self._forest.ref(step, TRIGGERS[step.kind])
            return [] if target is None else [Occurrence(target, step, step, self.counter(step))]
        if step.kind in CALLS:
            called = self._forest.ref(step, CALLS[step.kind])
            return [] if called is None else self._call(step, called)
        if step.kind in SWITCHES:
            return self._densest([self._steps(steps(entry)) for entry in branches(step)], step)
        return [Occurrence(o.target, o.cause, step, o.count) for o in self._steps(steps(step))]

    def _steps(self, found: Iterable[Item]) -> list[Occurrence]:
        made = [occurrence for step in found for occurrence in self._step(step)]
        self.is_too_much = self.is_too_much or len(made) > MOST
        return made[:MOST]

    def _call(self, step: Item, called: Item) -> list[Occurrence]:
        if called in self._calling or len(self._calling) > _MOST_LEVELS:
            return []  # which is an error wherever times are added up
        if called not in self._of_runnable:
            self._calling.add(called)
            self._of_runnable[called] = self._steps(steps(called))
            self._calling.remove(called)
        own = self.counter(step)
        if own.each > 1:
            self.counted[step] = None
        own_event = [Occurrence(called, step, step)] if called in self._wanted else []
        inner = [*own_event, *self._of_runnable[called]]
        times = min(MOST + 1, math.ceil(call_count(self._forest, step, "upper")))
        return [Occurrence(o.target, o.cause, step, own.then(o.count)) for _ in range(times) for o in inner]

    def _densest(self, ways: Sequence[Sequence[Occurrence]], step: Item) -> list[Occurrence]:
        """Return for each target the branch with most occurrences, since one branch is taken."""
        found = []
        for target in dict.fromkeys(o.target for way in ways for o in way):
            most = max(([o for o in way if o.target is target] for way in ways), key=len)
            found += [Occurrence(o.target, o.cause, step, o.count) for o in most]
        return found
