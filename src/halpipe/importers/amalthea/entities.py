"""Finder of the drafts that requirements name; a runnable or label may belong to several tasks."""

from __future__ import annotations

import itertools
from math import prod
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea.graph import CALLS, everything, is_at_edge
from halpipe.models import Anchor

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.importers.amalthea.parts import Draft, Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item

ENDS = ("terminate",)
"""Kinds of event at which a job or runnable is done."""


@record
class Place:
    """The drafts that an event happens in, their instant, and which of them write the label of the event."""

    drafts: tuple[Draft, ...]
    anchor: Anchor
    label: Item | None = None
    writers: tuple[Draft, ...] = ()

    @property
    def is_end(self) -> bool:
        """Whether the event is the end of jobs."""
        return self.anchor is Anchor.END


class Entities:
    """Finds the drafts of tasks, runnables, labels and events."""

    def __init__(self, forest: Forest, drafts: Drafts) -> None:
        self._forest = forest
        self._by_task: dict[Item, list[Draft]] = {}
        self._callers: dict[Item, dict[Draft, None]] = {}
        self._calls: dict[Draft, list[Item]] = {}
        self._writers: dict[Item, dict[Draft, None]] = {}
        self._readers: dict[Item, dict[Draft, None]] = {}
        for draft in drafts.items:
            self._by_task.setdefault(draft.task, []).append(draft)
            for step in everything(forest, draft.part.steps):
                self._note(draft, step)

    def _note(self, draft: Draft, step: Item) -> None:
        if step.kind in CALLS and (runnable := self._forest.ref(step, CALLS[step.kind])) is not None:
            self._callers.setdefault(runnable, {})[draft] = None
            self._calls.setdefault(draft, []).append(runnable)
        elif step.kind == "LabelAccess" and (label := self._forest.ref(step, "data")) is not None:
            kept = self._writers if step.get("access") == "write" else self._readers
            kept.setdefault(label, {})[draft] = None

    def of(self, task: Item) -> list[Draft]:
        """Return the drafts of a task."""
        return self._by_task.get(task, [])

    def path(self, task: Item) -> list[Draft]:
        """Return the parts of a task, for its first activation, each with what it waits for before it."""
        drafts = self.of(task)
        path: list[Draft] = []
        for draft in drafts:
            if draft.part.index == 0 and path:
                break
            path += [source for source in draft.after if draft.part.index and source not in path]
            path.append(draft)
        return path

    def callers(self, runnable: Item) -> list[Draft]:
        """Return the drafts that run a runnable."""
        return list(self._callers.get(runnable, ()))

    def calls(self, draft: Draft) -> list[Item]:
        """Return the runnables that a draft calls, directly or through others, in order."""
        return self._calls.get(draft, [])

    def writers(self, label: Item) -> list[Draft]:
        """Return the drafts that write a label."""
        return list(self._writers.get(label, ()))

    def is_inner(self, event: Item | None) -> bool:
        """Return whether an event of a runnable happens within jobs, not at their start or end alone."""
        entity = self._forest.ref(event, "entity") if event is not None and event.kind == "RunnableEvent" else None
        if event is None or entity is None:
            return False
        return self.is_within(self._drafts(event, entity), entity, end=event.get("eventType") in ENDS)

    def is_within(self, drafts: Sequence[Draft], runnable: Item, *, end: bool) -> bool:
        """Return whether the start, or the end, of a runnable is not that of each of some drafts."""
        return any(
            self.calls(draft).count(runnable) > 1 or not is_at_edge(self._forest, draft.part.steps, runnable, end=end)
            for draft in drafts
        )

    def place(self, event: Item | None) -> Place | None:
        """Return where an event happens; None if in no task."""
        if event is None:
            return None
        entity = self._forest.ref(event, "entity")
        if entity is None:
            return None
        is_end = event.get("eventType") in ENDS
        is_release = event.kind == "StimulusEvent" or event.get("eventType") == "activate"
        anchor = Anchor.END if is_end else Anchor.RELEASE if is_release else Anchor.START
        drafts = self._drafts(event, entity)
        if (
            event.kind == "ProcessEvent"
        ):  # of the parts of a task that waits, the last one ends it, the first one starts it
            at_end = [d for d in drafts if d.part.index == max(other.part.index for other in self.of(d.task))]
            drafts = at_end if is_end else [d for d in drafts if d.part.index == 0]
        if not drafts:
            return None
        if event.kind != "LabelEvent":
            return Place(tuple(drafts), anchor)
        writers = self.writers(entity) if event.get("eventType") != "read" else []
        return Place(tuple(drafts), anchor, entity, tuple(draft for draft in drafts if draft in writers))

    def _drafts(self, event: Item, entity: Item) -> list[Draft]:
        if event.kind == "ProcessEvent":
            return self.of(entity)
        process = self._forest.ref(event, "process")
        if event.kind == "RunnableEvent":
            found = self.callers(entity)
        elif event.kind == "LabelEvent":
            by_type = {"read": (self._readers,), "write": (self._writers,)}  # without a type, any access
            kept = by_type.get(event.get("eventType"), (self._writers, self._readers))
            found = list(dict.fromkeys(draft for drafts in kept for draft in drafts.get(entity, ())))
            runnable = self._forest.ref(event, "runnable")
            if runnable is not None:
                found = [draft for draft in found if draft in self.callers(runnable)]
        elif event.kind == "StimulusEvent":
            firsts = (d for drafts in self._by_task.values() for d in drafts if not d.part.index)
            found = [d for d in firsts if d.activation is not None and d.activation.stimulus is entity]
        else:
            found = []
        return [draft for draft in found if process is None or draft.task is process]


_MOST_COMBINATIONS = 20_000
"""Choices of one activation of each task that constraints connect, besides one for each."""


def combined(forest: Forest, item: Item, *choices: Sequence[Draft]) -> Iterator[tuple[Draft, ...]]:
    """Yield every choice of one draft of each; refuse a model with too many."""
    forest.combinations += max(1, prod(map(len, choices))) - 1
    if forest.combinations > _MOST_COMBINATIONS:
        message = f"connects activations of tasks in more than {_MOST_COMBINATIONS} combinations, with those before it"
        forest.refuse(message, item, "state fewer activations, or the constraint in an overlay")
    return itertools.product(*choices)
