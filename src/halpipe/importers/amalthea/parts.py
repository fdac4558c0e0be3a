"""Drafts of tasks: a task is cut at its waits, and each of its activations is a draft of its own.

A triggered task is activated by each trigger of each job of the tasks that trigger it, with their period times what
its counters let pass.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import islice
from typing import TYPE_CHECKING, NoReturn, TypeVar

from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import GROUPS, Evaluator, everything, is_uninterrupted, steps
from halpipe.importers.amalthea.mapping import is_interrupt
from halpipe.importers.amalthea.stimuli import MOST, TRIGGERED, Activation, Count, Triggers, activations_of, thinned
from halpipe.importers.common.names import Names
from halpipe.importers.common.polling import polling_period

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.overlay import OverlayUse


@dataclass(eq=False, slots=True)
class Part:
    """Part of a task between two waits; `waits` are the events that it waits for at its beginning."""

    task: Item
    index: int
    steps: list[Item] = field(default_factory=list)
    waits: list[Item] = field(default_factory=list)


@record
class _Source:
    """A part whose jobs trigger a task in some modes, by `step` within their step `top`.

    `cause` is the step, or an event of it; without a step, an event of the part itself. `count` says which pass.
    """

    part: Part
    cause: Item
    step: Item | None
    top: Item | None
    count: Count
    modes: frozenset[str]


@record
class Trigger(_Source):
    """Trigger of a draft by the jobs of another one, its `source`."""

    source: Draft


@dataclass(eq=False, slots=True)
class Draft:
    """A task of the model to be: one part of a task, with one activation (None: on demand), in some modes."""

    part: Part
    activation: Activation | None
    modes: set[str]
    name: str = ""
    after: dict[Draft, Item] = field(default_factory=dict)
    trigger: Trigger | None = None

    @property
    def lineage(self) -> Iterator[Item]:
        """The task with those that trigger it, the nearest first."""
        draft: Draft | None = self
        while draft is not None:
            yield draft.task
            draft = None if draft.trigger is None else draft.trigger.source

    @property
    def release(self) -> Activation | None:
        """The activation whose instants are releases of the task of the model: neither polled nor triggered."""
        known = self.activation
        return None if known is None or known.distance is not None or self.trigger or self.part.index else known

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
    forest: Forest, modes: Sequence[SystemMode], evaluator: Evaluator, overlay: OverlayUse | None
) -> Drafts:
    """Find what activates each task, cut the tasks, and order what activates one another."""
    return _Drafting(forest, modes, evaluator, overlay).run()


class _Drafting:
    def __init__(
        self, forest: Forest, modes: Sequence[SystemMode], evaluator: Evaluator, overlay: OverlayUse | None
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
        self.occurrences = Triggers(forest)
        self.triggers: dict[Item, list[_Source]] = {}
        self.stated: set[Item] = set()
        """Tasks with a period of the overlay, which their triggers do not change."""
        self.lost: list[Item] = []
        self.setters: dict[Item, list[tuple[Part, Item]]] = {}

    def _is_dropped(self, task: Item) -> bool:
        if self.overlay is None or not self.overlay.drops(task.name):
            return False
        self.result.without[task] = "left out by the overlay"
        return True

    def run(self) -> Drafts:
        settable = {event for item in self.forest.kinds("SetEvent") for event in _events(self.forest, item)}
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

    def _report_waits(self, settable: set[Item]) -> None:
        cut = [part.task for parts in self.result.parts.values() for part in parts if part.index == 1]
        help = "state limits of the whole under chains: in an overlay"
        self.forest.report_each(codes.WAITING, "tasks wait for others and became several", cut, help)
        top = {wait for task in self.tasks for wait in _flat(task) if wait.kind == "WaitEvent"}
        waits = self.forest.kinds("WaitEvent")
        unused = [w for w in waits if w not in top or not settable.issuperset(_events(self.forest, w))]
        active = [w for w in waits if w not in unused and w.get("waitingBehaviour") == "active"]
        help = "add the time of the wait to the WCET of the part before it, under tasks: in an overlay"
        self.forest.report_each(codes.ACTIVE_WAIT, "waits are active, but leave the unit to others", active, help)
        help = "let a task set the event, or wait in the task itself"
        self.forest.report_each(codes.UNUSED_WAIT, "waits have no effect", unused, help)

    def _index(self) -> None:
        """Note which parts trigger stimuli and custom events, call runnables, and set events."""
        for parts in self.result.parts.values():
            for part in parts:
                self._index_triggers(part)
                for step in everything(self.forest, part.steps):
                    for event in _events(self.forest, step) if step.kind == "SetEvent" else ():
                        self.setters.setdefault(event, []).append((part, step))

    def _index_triggers(self, part: Part) -> None:
        """Note what a part triggers; the same trigger in several modes, by whichever branch, is one source."""
        found: dict[tuple[Item, Item, Count, int], tuple[Item, set[str]]] = {}
        for mode in self.modes:
            times: dict[tuple[Item, Item, Count], int] = {}
            for one in self.occurrences.of(part.steps, self.evaluator.conditions(mode)):
                key = one.target, one.top, one.count
                times[key] = times.get(key, 0) + 1
                found.setdefault((*key, times[key]), (one.cause, set()))[1].add(mode.name)
        if self.occurrences.is_too_much:
            self._stop(part.task)
        for (target, top, count, _), (cause, modes) in found.items():
            self.triggers.setdefault(target, []).append(_Source(part, cause, cause, top, count, frozenset(modes)))

    # ------------------------------------------------------------------------------------- activation

    def _activate(self) -> None:
        """Make drafts of the tasks with a period of their own, or with one that the overlay states."""
        for task in self.tasks:
            stimuli = self.forest.refs(task, "stimuli")
            found = [(a, self._allowed(s)) for s in stimuli for a in activations_of(self.forest, s) or self._stated(s)]
            if not found and self.overlay is not None and (period := self.overlay.task_period(task.name)):
                self.stated.add(task)
                found = [(Activation(period, None, None), {mode.name for mode in self.modes})]
            for activation, modes in _alternating(found):
                self._add(task, activation, modes)

    def _poll(self) -> None:
        """Choose for sporadic activations the period of polling that leaves the hyperperiod of the others as it is."""
        drafts = [draft for drafts in self.by_task.values() for draft in drafts]
        periods = [d.activation.period for d in drafts if d.activation is not None and d.activation.distance is None]
        polled: dict[Item, Activation] = {}
        for draft in drafts:
            activation = draft.activation
            if activation is None or activation.distance is None:
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
        """Activate triggered tasks by each job that triggers them, in loops up to where a task comes again."""
        waiting: dict[Part, list[tuple[Item, Item, _Source]]] = {}  # part -> (triggered task, stimulus, trigger)
        for task in self.tasks:
            if task not in self.stated:
                for stimulus, source in self._triggering(task):
                    waiting.setdefault(source.part, []).append((task, stimulus, source))
        rest = [draft for task in self.tasks for draft in self.by_task.get(task, ()) if draft.activation is not None]
        for draft in rest:
            triggered = waiting.get(draft.part, ())
            lineage = list(islice(draft.lineage, MOST)) if triggered else []
            for task, stimulus, source in triggered:
                if task in lineage:
                    self.lost.append(source.cause)
                    continue
                if max(len(self.by_task.get(task, ())), len(lineage)) >= MOST:
                    self._stop(task)
                stimulus.use()
                passing = self._passing(draft, source)
                trigger = Trigger(draft.part, source.cause, source.step, source.top, passing, source.modes, draft)
                new = self._add(task, _triggered(draft, trigger.count, stimulus), set())
                new[0].trigger = trigger
                rest += new
        help = "let the counter count the triggers of one job of one task, or state the period in an overlay"
        what = "counters are not followed, so that all occurrences activate"
        self.forest.report_each(codes.NOT_READ, what, list(self.occurrences.unread), help)
        help = "state the WCET of the task and the limits of its data in an overlay"
        what = "calls with counters work, read and write in each job"
        self.forest.report_each(codes.NOT_READ, what, list(self.occurrences.counted), help)

    def _stop(self, task: Item) -> NoReturn:
        message = f"makes, is activated by, or stands behind more than {MOST} triggers"
        self.forest.refuse(message, task, "state its period in an overlay")

    def _passing(self, draft: Draft, source: _Source) -> Count:
        """Return what the counters of a trigger let pass; every occurrence where the model cannot say which, but warn.

        A job of the task belongs to that of the source with `each` times its number, so counters pass the first.
        """
        is_sporadic = draft.activation is None or draft.activation.distance is not None
        if source.count.each == 1 or not (is_sporadic or source.count.first % source.count.each):
            return source.count
        self.occurrences.unread[source.cause] = None
        return Count()

    def _triggering(self, task: Item) -> list[tuple[Item, _Source]]:
        """Return the triggers of the stimuli of a task, as far as counters let them pass."""
        found = []
        for stimulus in self.forest.refs(task, "stimuli"):
            if stimulus.kind in TRIGGERED:
                found += [(stimulus, source) for source in self._counted(stimulus, self._sources(stimulus))]
        return found

    def _counted(self, stimulus: Item, sources: list[_Source]) -> list[_Source]:
        """Return the triggers that the counter of a stimulus lets pass; it counts those of all jobs together."""
        own = self.occurrences.counter(stimulus)
        if own.each == 1:
            return sources
        parts = {source.part for source in sources}
        drafts = sum(draft.part in parts for drafts in self.by_task.values() for draft in drafts)
        if len(sources) == 1 and drafts < 2:
            return [replace(sources[0], count=sources[0].count.then(own))]
        passing = thinned(len(sources), own) if all(source.count == Count() for source in sources) else None
        if passing is None or len(parts) > 1 or drafts > 1 or len({source.modes for source in sources}) > 1:
            self.occurrences.unread[stimulus] = None
            return sources
        return [replace(sources[0], count=count) for count in passing]

    def _sources(self, stimulus: Item) -> list[_Source]:
        found = list(self.triggers.get(stimulus, ()))
        unread = []
        for event in self.forest.refs(stimulus, "triggeringEvents"):
            entity = self.forest.ref(event, "entity")
            if event.kind == "CustomEvent":
                found += self.triggers.get(event, ())
            elif event.kind == "ProcessEvent" and entity is not None and entity in self.result.parts:
                index = -1 if event.get("eventType") == "terminate" else 0
                modes = frozenset(mode.name for mode in self.modes)
                found.append(_Source(self.result.parts[entity][index], event, None, None, Count(), modes))
            elif event.kind == "RunnableEvent" and entity is not None:
                found += [replace(source, cause=event) for source in self.triggers.get(entity, ())]
            else:
                unread.append(event)
        help = "let a task trigger a custom event there, or state the period of the stimulus in an overlay"
        self.forest.report_each(codes.NOT_READ, "events of other kinds trigger nothing", unread, help)
        return found

    # ------------------------------------------------------------------------------ names and order

    def _name(self) -> None:
        names = Names(self.forest.findings, codes.RENAMED)
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
        for task in self.tasks:
            previous: Draft | None = None
            for draft in self.by_task.get(task, ()):
                if draft.part.index and previous is not None:
                    draft.after[previous] = task
                    setters = [found for e in draft.part.waits for found in self.setters.get(e, ())]
                    self._edges(draft, [found for found in setters if self._is_set_for(found[1], task)])
                elif draft.trigger is not None:
                    draft.after[draft.trigger.source] = draft.trigger.cause
                    draft.trigger.cause.use_all()
                elif task in self.stated:
                    self._edges(draft, [(source.part, source.cause) for _, source in self._triggering(task)])
                previous = draft
        help = "state the period of the task where the loop should begin, in an overlay"
        self.forest.report_each(codes.FEEDBACK, "activations close a loop and order nothing", self.lost, help)

    def _is_set_for(self, step: Item, task: Item) -> bool:
        """Return whether an event is set for a task: for the one that the step names, or for all."""
        process = self.forest.ref(step, "process")
        return process is None or process is task

    def _edges(self, draft: Draft, sources: Sequence[tuple[Part, Item]]) -> None:
        for part, cause in sources:
            for source in self.by_task.get(part.task, ()):
                if source.part is not part or source in draft.after:
                    continue
                if comes_after(source, draft, lambda each: each.after):
                    self.lost.append(cause)
                else:
                    draft.after[source] = cause
                    cause.use_all()

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
                if draft.trigger is not None:
                    found &= draft.trigger.modes
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


def _alternating(found: Sequence[tuple[Activation, set[str]]]) -> list[tuple[Activation, set[str]]]:
    """Return activations, those as one that are equal and never active in one mode."""
    kept: list[tuple[Activation, set[str]]] = []
    for activation, modes in found:
        for known, others in kept:
            same = (known.period, known.offset, known.distance) == (
                activation.period,
                activation.offset,
                activation.distance,
            )
            if same and known.stimulus is not activation.stimulus and not others & modes:
                others |= modes
                break
        else:
            kept.append((activation, set(modes)))
    return kept


def _triggered(source: Draft, count: Count, stimulus: Item) -> Activation:
    """Return the activation by a trigger: that of its source, or every so many of it."""
    known = source.activation
    assert known is not None
    period = known.period * count.each
    offset = known.offset if count.each > 1 else None
    return Activation(period, None if offset is None else offset % period, stimulus)


_Node = TypeVar("_Node")


def comes_after(last: _Node, first: _Node, before: Callable[[_Node], Iterable[_Node]]) -> bool:
    """Return whether `first` is `last`, or among what is before it, directly or through others."""
    seen, rest = {last}, [last]
    while rest and first not in seen:
        new = [node for node in before(rest.pop()) if node not in seen]
        seen.update(new)
        rest += new
    return first in seen


def _why(forest: Forest, task: Item) -> str:
    stimuli = forest.refs(task, "stimuli")
    if not stimuli:
        return "has no stimulus"
    kinds = ", ".join(sorted({stimulus.kind for stimulus in stimuli}))
    return f"its stimuli ({kinds}) give it no period"


def _events(forest: Forest, item: Item) -> list[Item]:
    return [event for mask in item.all("eventMask") for event in forest.refs(mask, "events")]


def _flat(item: Item) -> list[Item]:
    """Return the steps of a task with its groups dissolved, as far as they may be interrupted."""
    found = []
    for step in steps(item):
        if step.kind in GROUPS and step.kind != "WhileLoop" and not is_uninterrupted(step):
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
