"""The timing extension: what a model demands, and what a schedule guarantees in each mode."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.exporters.arxml.codes import NO_LATENCY, WEAKER_WINDOW
from halpipe.exporters.arxml.document import add, add_time, freeze, named, package, ref
from halpipe.exporters.arxml.software import Layout, ShortNames
from halpipe.exporters.common.timeline import delays_of
from halpipe.models import Anchor, Chain, Match, ModeSchedule, Precedence, Schedule, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree


_WEAKER = ("written as a window after any job", "left out")
DEMANDS = "Requirements"
_EVENT = "TD-EVENT-SWC-INTERNAL-BEHAVIOR"
_CHAIN = "TIMING-DESCRIPTION-EVENT-CHAIN"
_STARTED = "STARTED"
_TERMINATED = "TERMINATED"
_ACTIVATED = "ACTIVATED"
_KINDS = {Anchor.RELEASE: _ACTIVATED, Anchor.START: _STARTED, Anchor.END: _TERMINATED}


class Descriptions:
    """The events and event chains of a file; each is written when it is first referred to."""

    def __init__(self, parent: etree._Element, layout: Layout) -> None:
        self.layout = layout
        self.names = ShortNames()
        self.chains: dict[str, str] = {}
        self._parent = parent
        self._events: dict[tuple[str, str], str] = {}
        self._responses: dict[str, str] = {}

    def path(self, name: str) -> str:
        """Return the path of what stands in the element of the demands."""
        return self.layout.path("Timing", DEMANDS, name)

    def event(self, task: str, kind: str = _STARTED) -> str:
        """Return the path of the event that a task is activated, started or terminated."""
        if (task, kind) not in self._events:
            name = self.names(self.layout.tasks[task], kind.lower())
            element = named(self._parent, _EVENT, name)
            iref = add(element, "COMPONENT-IREF")
            ref(iref, "TARGET-COMPONENT-REF", "SW-COMPONENT-PROTOTYPE", self.layout.prototype(task))
            ref(element, "RUNNABLE-REF", "RUNNABLE-ENTITY", self.layout.runnable(task))
            add(element, f"{_EVENT}-TYPE", f"RUNNABLE-ENTITY-{kind}")
            freeze(element, self.layout.texts)
            self._events[task, kind] = self.path(name)
        return self._events[task, kind]

    def chain(self, name: str, stimulus: str, response: str, segments: Sequence[str] = ()) -> None:
        """Append an event chain between two events, of `segments` if there are any; `name` is free."""
        element = named(self._parent, _CHAIN, name)
        ref(element, "STIMULUS-REF", _EVENT, stimulus)
        ref(element, "RESPONSE-REF", _EVENT, response)
        refs = add(element, "SEGMENT-REFS") if segments else element
        for segment in segments:
            ref(refs, "SEGMENT-REF", _CHAIN, self.path(segment))
        freeze(element, self.layout.texts)

    def response(self, task: str) -> str:
        """Return the path of the chain from the activation of a task to its end."""
        if task not in self._responses:
            ends = self.event(task, _ACTIVATED), self.event(task, _TERMINATED)
            name = self.names(self.layout.tasks[task], "response")
            self.chain(name, *ends)
            self._responses[task] = self.path(name)
        return self._responses[task]

    def task_chain(self, chain: Chain) -> str:
        """Append a cause-effect chain, from the event of its first task to that of its last; return its path.

        Its segments, one for each task, tell the tasks in order.
        """
        name = self.names(chain.name)
        first = self.event(chain.tasks[0], _KINDS[chain.anchor or Anchor.START])
        starts = [first, *(self.event(task) for task in chain.tasks[1:])]
        ends = [*starts[1:], self.event(chain.tasks[-1], _KINDS[chain.to or Anchor.END])]
        segments = [self.names(name, self.layout.tasks[task]) for task in chain.tasks]
        self.chain(name, starts[0], ends[-1], segments)
        for segment, start, end in zip(segments, starts, ends, strict=True):
            self.chain(segment, start, end)
        return self.path(name)


def write_demands(packages: etree._Element, model: TaskModel, layout: Layout) -> tuple[etree._Element, Descriptions]:
    """Append the package of timing with the demands; return the place of its elements, and the descriptions."""
    elements = package(packages, "Timing")
    timing = named(elements, "SYSTEM-TIMING", DEMANDS)
    known = Descriptions(add(timing, "TIMING-DESCRIPTIONS"), layout)
    demands = add(timing, "TIMING-REQUIREMENTS")
    for task in model.tasks:
        if task.period is not None:
            name = known.names(layout.tasks[task.name], "period")
            periodic(known, demands, name, known.event(task.name, _ACTIVATED), task.period, None)
    for task in model.tasks:
        if task.deadline is not None:
            name = known.names(layout.tasks[task.name], "deadline")
            latency(known, demands, name, "REACTION", known.response(task.name), task.deadline)
    for task in model.tasks:
        for precedence in common_windows(task):
            if precedence.anchor is not Anchor.POINT:
                _window(demands, task, precedence, known)
    _order(demands, model, known)
    known.chains |= {chain.name: known.task_chain(chain) for chain in model.chains}
    tasks = {task.name: task for task in model.tasks}
    for chain in model.chains:
        for kind, limit in (("REACTION", _reaction(chain, tasks[chain.tasks[0]])), ("AGE", chain.max_age)):
            if limit is not None:
                name = known.names(chain.name, kind.lower())
                latency(known, demands, name, kind, known.chains[chain.name], limit)
    ref(timing, "SYSTEM-REF", "SYSTEM", layout.path("System", "System"))
    return elements, known


def _reaction(chain: Chain, first: Task) -> Duration | None:
    """Return the most from the event of a job of the first task to the response, which is what REACTION limits.

    A stimulus that comes from outside may just miss a job, and waits for the next one: a limit of the reaction time
    holds if the latency is below it by the longest time between two jobs (MODEL 10.7).
    """
    limits = [chain.max_latency] if chain.max_latency is not None else []
    if chain.max_reaction is not None:
        wait = longest_wait(first)
        limits += [chain.max_reaction - wait] if chain.max_reaction > wait else []
    return min(limits, default=None)


def longest_wait(task: Task) -> Duration:
    """Return the longest time between two jobs of a task, none for work on demand."""
    return task.period * (1 + task.slack) if task.period is not None else ZERO


def unstated(model: TaskModel) -> list[Diagnostic]:
    """Return the limits and windows that standard elements cannot state; they are in the native model."""
    tasks = {task.name: task for task in model.tasks}
    found = []
    for chain in model.chains:
        wait = longest_wait(tasks[chain.tasks[0]])
        if chain.max_reaction is not None and chain.max_reaction <= wait:
            message = f"limits its reaction time to {chain.max_reaction}, but its first task may start {wait} apart"
            help = "limit its latency instead, which is what AUTOSAR's REACTION means between runnables"
            found.append(NO_LATENCY(message, path=about(chain=chain.name), help=help))
    for task in model.tasks:
        for precedence in common_windows(task):
            if precedence.anchor is Anchor.POINT or precedence.match is Match.CYCLE:
                message = f"is to run {precedence.words}, which is {_WEAKER[precedence.anchor is Anchor.POINT]}"
                help = "import the file as it was written, so that the native model counts"
                found.append(WEAKER_WINDOW(message, path=about(task=task.name), help=help))
    return found


def periodic(
    known: Descriptions, parent: etree._Element, name: str, event: str, period: Duration, jitter: Duration | None
) -> None:
    """Append that an event recurs, with at most a jitter."""
    element = named(parent, "PERIODIC-EVENT-TRIGGERING", name)
    ref(element, "EVENT-REF", _EVENT, event)
    if jitter is not None:
        add_time(element, "JITTER", jitter, up=True)
    add_time(element, "PERIOD", period, up=False)
    freeze(element, known.layout.texts)


def latency(
    known: Descriptions, parent: etree._Element, name: str, kind: str, chain: str, limit: Duration, *, up: bool = False
) -> None:
    """Append the most that a chain may take, rounded down, or takes, rounded `up`."""
    element = named(parent, "LATENCY-TIMING-CONSTRAINT", name)
    add(element, "LATENCY-CONSTRAINT-TYPE", kind)
    ref(element, "SCOPE-REF", _CHAIN, chain)
    add_time(element, "MAXIMUM", limit, up=up)
    freeze(element, known.layout.texts)


def common_windows(task: Task) -> list[Precedence]:
    """Return the windows that a task keeps whatever its version: AUTOSAR has no demands that depend on the version.

    Of several versions these are the windows round all those from one instant of a predecessor that every version has.
    """
    if len(task.versions) == 1:
        return list(task.versions[0].precedences)
    found = grouped((_ends(precedence), precedence) for version in task.versions for precedence in version.precedences)
    keys = [set(map(_ends, version.precedences)) for version in task.versions]
    return [
        replace(windows[0], min=min(p.min for p in windows), max=max(p.max for p in windows))
        for key, windows in found.items()
        if all(key in known for known in keys)
    ]


def _ends(precedence: Precedence) -> object:
    """Return what a window lies between."""
    return precedence.task, precedence.anchor, precedence.point, precedence.to, precedence.match


def _window(demands: etree._Element, task: Task, precedence: Precedence, known: Descriptions) -> None:
    """Append the least and the most time from an instant of the predecessor to one of a task."""
    ends = known.event(precedence.task, _KINDS[precedence.anchor]), known.event(task.name, _KINDS[precedence.to])
    tasks = known.layout.tasks
    name = known.names(tasks[precedence.task], "before", tasks[task.name])
    element = named(demands, "OFFSET-TIMING-CONSTRAINT", name)
    ref(element, "SOURCE-REF", _EVENT, ends[0])
    ref(element, "TARGET-REF", _EVENT, ends[1])
    add_time(element, "MINIMUM", precedence.min, up=True)
    add_time(element, "MAXIMUM", precedence.max, up=False)
    freeze(element, known.layout.texts)


def _order(demands: etree._Element, model: TaskModel, known: Descriptions) -> None:
    """Append one order of all tasks that end before others start; windows between other instants state no order."""
    after: dict[str, list[str]] = {}
    for task in model.tasks:
        for precedence in common_windows(task):
            is_order = (precedence.anchor, precedence.to) == (Anchor.END, Anchor.START) and precedence.min >= ZERO
            if is_order and task.name not in (followers := after.setdefault(precedence.task, [])):
                followers.append(task.name)
    if not after:
        return
    ordered = {*after, *(follower for found in after.values() for follower in found)}
    name, layout = known.names("Order"), known.layout
    elements = add(named(demands, "EXECUTION-ORDER-CONSTRAINT", name), "ORDERED-ELEMENTS")
    for task in model.tasks:
        if task.name not in ordered:
            continue
        element = named(elements, "EOC-EXECUTABLE-ENTITY-REF", layout.tasks[task.name])
        iref = add(element, "COMPONENT-IREF")
        ref(iref, "TARGET-COMPONENT-REF", "SW-COMPONENT-PROTOTYPE", layout.prototype(task.name))
        ref(element, "EXECUTABLE-REF", "RUNNABLE-ENTITY", layout.runnable(task.name))
        if task.name in after:
            refs = add(element, "SUCCESSOR-REFS")
            for follower in after[task.name]:
                path = known.path(f"{name}/{layout.tasks[follower]}")
                ref(refs, "SUCCESSOR-REF", "EOC-EXECUTABLE-ENTITY-REF", path)
        freeze(element, layout.texts)


def write_guarantees(elements: etree._Element, model: TaskModel, schedule: Schedule, known: Descriptions) -> None:
    """Append one element with guarantees for each mode, which hold while the mode is played, switches apart."""
    names = ShortNames()
    for table in schedule.modes:
        short_name = names("Guarantees", known.layout.modes[table.name])
        timing = named(elements, "SYSTEM-TIMING", short_name, f"proven for mode {table.name}")
        _mode(add(timing, "TIMING-GUARANTEES"), model, table, known)
        ref(timing, "SYSTEM-REF", "SYSTEM", known.layout.path("System", "System"))


def _mode(parent: etree._Element, model: TaskModel, table: ModeSchedule, known: Descriptions) -> None:
    names, jobs = ShortNames(), table.by_task()
    for task in model.tasks:
        found = jobs.get(task.name)
        if task.period is None or not found:
            continue
        short_name = known.layout.tasks[task.name]
        delays = delays_of(task, task.period, found, table.hyperperiod)
        jitter = max(delays) - min(delays)
        periodic(known, parent, names(short_name, "period"), known.event(task.name), task.period, jitter)
        response = max(delay + (job.end - job.start) for delay, job in zip(delays, found, strict=True))
        latency(known, parent, names(short_name, "response"), "REACTION", known.response(task.name), response, up=True)
    for chain in table.chains:
        forward = chain.reaction if chain.latency is None else chain.latency
        for kind, value in (("REACTION", forward), ("AGE", chain.age)):
            if value is not None:
                latency(known, parent, names(chain.name, kind.lower()), kind, known.chains[chain.name], value, up=True)
