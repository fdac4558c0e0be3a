"""Tasks of AMALTHEA to tasks of the model: cut where they wait, one for each activation, with who activates whom.

A task is cut at a wait for an event that another task sets. A task without a period of its own has that of the task
that triggers it; of several, the shortest.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import CALLS, GROUPS, everything, steps
from halpipe.importers.amalthea.interrupts import is_interrupt
from halpipe.importers.amalthea.names import Names, few
from halpipe.importers.amalthea.own_export import activation_of, is_carried
from halpipe.importers.amalthea.stimuli import TRIGGERED, Activation, activations_of
from halpipe.importers.common.polling import polling_period

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.durations import Duration
    from halpipe.importers.amalthea.graph import Evaluator
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Supplement

_TRIGGERS = {"InterProcessTrigger": "stimulus", "InterProcessActivation": "stimulus", "CustomEventTrigger": "event"}


@dataclass(eq=False, slots=True)
class Part:
    """What a task does between two waits; `waits` are the events that it waits for at its beginning."""

    task: Item
    index: int
    steps: list[Item] = field(default_factory=list)
    waits: list[Item] = field(default_factory=list)


@dataclass(eq=False, slots=True)
class Draft:
    """A task of the model to be: one part of a task, with one activation (None: on demand), in some modes."""

    part: Part
    activation: Activation | None
    modes: set[str]
    name: str = ""
    after: dict[Draft, Item] = field(default_factory=dict)

    @property
    def task(self) -> Item:
        """The task that it comes from."""
        return self.part.task


@dataclass(slots=True)
class Drafts:
    """All drafts in order; those of one task stand together, the parts of one activation in their order."""

    items: list[Draft] = field(default_factory=list)
    by_task: dict[Item, list[Draft]] = field(default_factory=dict)
    parts: dict[Item, list[Part]] = field(default_factory=dict)
    without: dict[Item, str] = field(default_factory=dict)
    routines: dict[Item, list[Duration]] = field(default_factory=dict)
    """Interrupt routines, with the least distances of their arrivals, by activation."""

    def of(self, task: Item) -> list[Draft]:
        """Return the drafts of a task."""
        return self.by_task.get(task, [])


def make_drafts(
    forest: Forest, modes: Sequence[SystemMode], evaluator: Evaluator, overlay: Supplement | None
) -> Drafts:
    """Find what activates each task, cut the tasks, and order what activates one another."""
    return _Drafting(forest, modes, evaluator, overlay).run()


class _Drafting:
    def __init__(
        self, forest: Forest, modes: Sequence[SystemMode], evaluator: Evaluator, overlay: Supplement | None
    ) -> None:
        self.forest = forest
        self.modes = modes
        self.evaluator = evaluator
        self.overlay = overlay
        self.result = Drafts()
        found = [t for t in forest.within("SWModel", "tasks", "isrs") if not self._is_dropped(t)]
        self.routines = [task for task in found if is_interrupt(forest, task)]
        self.tasks = [task for task in found if task not in self.routines]
        self.by_task = self.result.by_task
        self.triggers: dict[Item, list[tuple[Part, Item]]] = {}
        self.setters: dict[Item, list[tuple[Part, Item]]] = {}

    def _is_dropped(self, task: Item) -> bool:
        if self.overlay is None or not self.overlay.drops(task.name):
            return False
        self.result.without[task] = "left out by the overlay"
        return True

    def run(self) -> Drafts:
        settable = self._settable()
        for task in self.tasks:
            self.result.parts[task] = _cut(self.forest, task, settable)
        self._report_waits(settable)
        self._index()
        self._activate()
        self._poll()
        self._inherit()
        self._interrupts()
        self._name()
        self._connect()
        self._spread_modes()
        self._report()
        return self.result

    # ---------------------------------------------------------------------------------------- cutting

    def _settable(self) -> set[Item]:
        return {event for item in self.forest.kinds("SetEvent") for event in _events(self.forest, item)}

    def _report_waits(self, settable: set[Item]) -> None:
        cut = [part.task for parts in self.result.parts.values() for part in parts if part.index == 1]
        help = "state limits of the whole under chains: in an overlay"
        self.forest.report_each(codes.WAITING, "tasks wait for others and became several", cut, help)
        top = {wait for task in self.tasks for wait in _flat(task) if wait.kind == "WaitEvent"}
        unused = [
            wait
            for wait in self.forest.kinds("WaitEvent")
            if wait not in top or not any(event in settable for event in _events(self.forest, wait))
        ]
        active = [
            wait
            for wait in self.forest.kinds("WaitEvent")
            if wait in top and wait not in unused and wait.get("waitingBehaviour") == "active"
        ]
        help = "add the time of the wait to the WCET of the part before it, under tasks: in an overlay"
        self.forest.report_each(codes.ACTIVE_WAIT, "waits are active, but leave the unit to others", active, help)
        help = "let a task set the event, or wait in the task itself"
        self.forest.report_each(codes.UNUSED_WAIT, "waits have no effect", unused, help)

    def _index(self) -> None:
        """Note which parts trigger which stimuli and custom events, and set which events."""
        for parts in self.result.parts.values():
            for part in parts:
                for step in everything(self.forest, part.steps):
                    if step.kind in _TRIGGERS:
                        target = self.forest.ref(step, _TRIGGERS[step.kind])
                        if target is not None:
                            self.triggers.setdefault(target, []).append((part, step))
                    elif step.kind == "SetEvent":
                        for event in _events(self.forest, step):
                            self.setters.setdefault(event, []).append((part, step))

    # ------------------------------------------------------------------------------------- activation

    def _activate(self) -> None:
        """Make drafts of the tasks with a period of their own, or with one that the overlay states."""
        for task in self.tasks:
            stimuli = self.forest.refs(task, "stimuli")
            if is_carried(task):
                self._carried(task, stimuli)
                continue
            groups: dict[tuple[object, object], tuple[Activation, set[str]]] = {}
            for stimulus in stimuli:
                for activation in activations_of(self.forest, stimulus) or self._stated(stimulus):
                    key = (activation.period, activation.offset)
                    groups.setdefault(key, (activation, set()))[1].update(self._allowed(stimulus))
            if not groups and self.overlay is not None and (period := self.overlay.task_period(task.name)):
                everywhere = {mode.name for mode in self.modes}
                groups[period, None] = (Activation(period, None, None), everywhere)
            for activation, modes in groups.values():
                self._add(task, activation, modes)

    def _poll(self) -> None:
        """Choose for sporadic activations the period of polling that leaves the hyperperiod of the others as it is."""
        drafts = [draft for drafts in self.by_task.values() for draft in drafts]
        periods = [d.activation.period for d in drafts if d.activation is not None and d.activation.distance is None]
        polled: dict[Item, Activation] = {}
        for draft in drafts:
            activation = draft.activation
            if activation is None or activation.distance is None or is_carried(draft.task):
                continue
            draft.activation = replace(activation, period=polling_period(activation.distance, periods))
            if activation.stimulus is not None:
                polled.setdefault(activation.stimulus, draft.activation)
        help = "state another period in an overlay, if arrivals so dense cannot be"
        for stimulus, activation in polled.items():
            what = f"comes at most every {activation.distance}; its tasks look for it every {activation.period}"
            self.forest.report(codes.SPORADIC, what, stimulus, help)

    def _interrupts(self) -> None:
        """Note the least distances of the arrivals of each interrupt routine; several may come at one time."""
        for routine in self.routines:
            found = [a for s in self.forest.refs(routine, "stimuli") for a in activations_of(self.forest, s)]
            stated = None if self.overlay is None else self.overlay.task_period(routine.name)
            self.result.routines[routine] = [stated] if stated else [a.distance or a.period for a in found]

    def _carried(self, task: Item, stimuli: Sequence[Item]) -> None:
        activation = activation_of(self.forest, task, stimuli)
        modes = {mode for stimulus in stimuli for mode in self._allowed(stimulus)}
        for stimulus in stimuli:
            stimulus.use_all()
        if not stimuli and activation is None:
            modes = {mode.name for mode in self.modes}
        self._add(task, activation, modes)

    def _stated(self, stimulus: Item) -> list[Activation]:
        """Return the period that the overlay states for a stimulus without one."""
        period = None if self.overlay is None else self.overlay.source_period(stimulus.name)
        if period:
            stimulus.use()
        return [Activation(period, None, stimulus)] if period else []

    def _allowed(self, stimulus: Item) -> set[str]:
        return {mode.name for mode in self.modes if self.evaluator.conditions(mode).allows(stimulus)}

    def _add(self, task: Item, activation: Activation | None, modes: set[str]) -> list[Draft]:
        task.use()
        drafts = []
        for part in self.result.parts[task]:
            later = activation is not None and part.index > 0
            own = Activation(activation.period, None, activation.stimulus) if later and activation else activation
            drafts.append(Draft(part, own, set(modes)))
        self.by_task.setdefault(task, []).extend(drafts)
        return drafts

    # ------------------------------------------------------------------------------------ inheritance

    def _inherit(self) -> None:
        """Give triggered tasks the period of who triggers them, shortest period first (Dijkstra's algorithm)."""
        waiting: dict[Item, list[tuple[Item, Item]]] = {}  # task with the trigger -> (stimulus, triggered task)
        for task in self.tasks:
            if task not in self.by_task:
                for stimulus, part, _ in self._triggering(task):
                    waiting.setdefault(part.task, []).append((stimulus, task))
        order = {task: index for index, task in enumerate(self.tasks)}
        heap = [
            (draft.activation.period, order[draft.task], draft.task)
            for drafts in self.by_task.values()
            for draft in drafts
            if draft.activation is not None
        ]
        heapq.heapify(heap)
        while heap:
            period, _, task = heapq.heappop(heap)
            for stimulus, triggered in waiting.get(task, ()):
                if triggered not in self.by_task:
                    stimulus.use()
                    self._add(triggered, Activation(period, None, stimulus), set())
                    heapq.heappush(heap, (period, order[triggered], triggered))

    def _triggering(self, task: Item) -> list[tuple[Item, Part, Item]]:
        """Return (stimulus, part that triggers it, the step that does) for the stimuli of a task."""
        found = []
        for stimulus in self.forest.refs(task, "stimuli"):
            if stimulus.kind in TRIGGERED:
                found += [(stimulus, part, step) for part, step in self._sources(stimulus)]
        return found

    def _sources(self, stimulus: Item) -> list[tuple[Part, Item]]:
        found = list(self.triggers.get(stimulus, ()))
        for event in self.forest.refs(stimulus, "triggeringEvents"):
            found += self.triggers.get(event, ())
            entity = self.forest.ref(event, "entity") if event.kind in ("ProcessEvent", "RunnableEvent") else None
            if entity in self.result.parts and entity is not None:
                index = -1 if event.get("eventType") == "terminate" else 0
                found.append((self.result.parts[entity][index], event))
            elif entity is not None:
                found += [(part, event) for part in self._all_parts() if _calls(self.forest, part, entity)]
        return found

    def _all_parts(self) -> Iterable[Part]:
        return (part for parts in self.result.parts.values() for part in parts)

    # ------------------------------------------------------------------------------ names and order

    def _name(self) -> None:
        names = Names(self.forest.findings)
        several = []
        for task in self.tasks:
            drafts = self.by_task.get(task, [])
            firsts = [draft for draft in drafts if draft.part.index == 0]
            if len(firsts) > 1:
                several.append(task)
            for draft in drafts:
                name = task.name
                if len(firsts) > 1 and draft.activation is not None and draft.activation.stimulus is not None:
                    name += f"@{draft.activation.stimulus.name}"
                if draft.part.index:
                    name += f".{draft.part.index + 1}"
                draft.name = names.unique(name, "task", task.at)
            self.result.items += drafts
        help = "state one of them, if the others never occur"
        self.forest.report_each(codes.SEVERAL_ACTIVATIONS, "tasks have several activations", several, help)

    def _connect(self) -> None:
        """Order the parts of a task, what waits after what sets, and what is triggered after what triggers."""
        lost: list[Item] = []
        for task in self.tasks:
            previous: Draft | None = None
            for draft in self.by_task.get(task, ()):
                if draft.part.index and previous is not None:
                    draft.after[previous] = task
                    setters = [found for e in draft.part.waits for found in self.setters.get(e, ())]
                    self._edges(draft, [found for found in setters if self._is_set_for(found[1], task)], lost)
                previous = draft
        for task in self.tasks:
            sources = [(part, step) for _, part, step in self._triggering(task)]
            for draft in self.by_task.get(task, ()):
                if draft.part.index == 0:
                    self._edges(draft, sources, lost)
            self._report_several(task, sources)
        help = "state the period of the task where the loop should begin, in an overlay"
        self.forest.report_each(codes.FEEDBACK, "activations close a loop and order nothing", lost, help)

    def _is_set_for(self, step: Item, task: Item) -> bool:
        """Return whether an event is set for a task: for the one that the step names, or for all."""
        process = self.forest.ref(step, "process")
        return process is None or process is task

    def _edges(self, draft: Draft, sources: Sequence[tuple[Part, Item]], lost: list[Item]) -> None:
        for part, cause in sources:
            for source in self.by_task.get(part.task, ()):
                if source.part is not part or source in draft.after:
                    continue
                if _reaches(source, draft):
                    lost.append(cause)
                else:
                    draft.after[source] = cause
                    cause.use_all()

    def _report_several(self, task: Item, sources: Sequence[tuple[Part, Item]]) -> None:
        others = {part.task: None for part, _ in sources if part.task in self.by_task}
        if len(others) > 1 and task in self.by_task:
            names = few([other.name for other in others])
            help = "state its period in an overlay, if the triggers do not coincide"
            message = f"is triggered by {len(others)} tasks: {names}"
            self.forest.report(codes.SEVERAL_TRIGGERS, message, task, help)

    def _spread_modes(self) -> None:
        """Let triggered tasks and later parts run in the modes in which what comes before them runs."""
        changed = True
        while changed:
            changed = False
            for draft in self.result.items:
                stimulus = None if draft.activation is None else draft.activation.stimulus
                if stimulus is None or stimulus.kind not in TRIGGERED:
                    continue
                allowed = self._allowed(stimulus)
                found = {mode for source in draft.after for mode in source.modes} & allowed
                if not found <= draft.modes:
                    draft.modes |= found
                    changed = True

    def _report(self) -> None:
        help = "state the period of the task, or of its stimulus under sources:, in an overlay"
        for task in self.tasks:
            if task not in self.by_task:
                self.result.without[task] = _why(self.forest, task)
        without = [task for task in self.tasks if task in self.result.without]
        self.forest.report_each(codes.NO_PERIOD, "tasks have no period and are left out", without, help)


def _reaches(goal: Draft, start: Draft) -> bool:
    """Return whether `goal` comes after `start` by the edges so far."""
    seen, rest = {goal}, [goal]
    while rest:
        draft = rest.pop()
        if draft is start:
            return True
        new = [source for source in draft.after if source not in seen]
        seen.update(new)
        rest += new
    return False


def _why(forest: Forest, task: Item) -> str:
    stimuli = forest.refs(task, "stimuli")
    if not stimuli:
        return "has no stimulus"
    kinds = ", ".join(sorted({stimulus.kind for stimulus in stimuli}))
    return f"its stimuli ({kinds}) give it no period"


def _events(forest: Forest, item: Item) -> list[Item]:
    return [event for mask in item.all("eventMask") for event in forest.refs(mask, "events")]


def _calls(forest: Forest, part: Part, runnable: Item) -> bool:
    found = everything(forest, part.steps)
    return any(step.kind in CALLS and forest.ref(step, CALLS[step.kind]) is runnable for step in found)


def _flat(item: Item) -> list[Item]:
    """Return the steps of a task with its groups dissolved."""
    found = []
    for step in steps(item):
        if step.kind in GROUPS and step.kind != "WhileLoop":
            found += _flat(step)
        else:
            found.append(step)
    return found


def _cut(forest: Forest, task: Item, settable: set[Item]) -> list[Part]:
    parts = [Part(task, 0)]
    for step in _flat(task):
        waits = [e for e in _events(forest, step) if e in settable] if step.kind == "WaitEvent" else []
        if waits:
            step.use_all()
            for event in waits:
                event.use()
            parts.append(Part(task, len(parts), waits=waits))
        else:
            parts[-1].steps.append(step)
    return parts
