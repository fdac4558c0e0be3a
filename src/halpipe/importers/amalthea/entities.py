"""Events and entities of constraints in terms of tasks: the drafts meant, and whether start or end counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea.graph import CALLS, everything
from halpipe.models import Anchor

if TYPE_CHECKING:
    from halpipe.importers.amalthea.parts import Draft, Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item

_ENDS = ("terminate",)


@record
class Place:
    """The drafts that an event happens in, their instant, and which of them write the label of the event."""

    drafts: tuple[Draft, ...]
    anchor: Anchor
    runnable: Item | None = None
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

    def place(self, event: Item | None) -> Place | None:
        """Return where an event happens; None if in no task."""
        if event is None:
            return None
        entity = self._forest.ref(event, "entity")
        if entity is None:
            return None
        is_end = event.get("eventType") in _ENDS
        is_release = event.kind == "StimulusEvent" or event.get("eventType") == "activate"
        anchor = Anchor.END if is_end else Anchor.RELEASE if is_release else Anchor.START
        drafts = self._drafts(event, entity)
        if event.kind == "ProcessEvent":  # the parts of a task that waits: its start is that of the first
            drafts = [d for d in drafts if d.part.index == (self._last(d) if is_end else 0)]
        runnable = entity if event.kind == "RunnableEvent" else None
        if not drafts:
            return None
        if event.kind != "LabelEvent":
            return Place(tuple(drafts), anchor, runnable)
        writers = self.writers(entity) if event.get("eventType") != "read" else []
        return Place(tuple(drafts), anchor, runnable, entity, tuple(draft for draft in drafts if draft in writers))

    def _last(self, draft: Draft) -> int:
        return max(other.part.index for other in self._by_task[draft.task])

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
            found = [
                d for drafts in self._by_task.values() for d in drafts if _stimulus(d) is entity and not d.part.index
            ]
        else:
            found = []
        return [draft for draft in found if process is None or draft.task is process]


def _stimulus(draft: Draft) -> Item | None:
    return None if draft.activation is None else draft.activation.stimulus
