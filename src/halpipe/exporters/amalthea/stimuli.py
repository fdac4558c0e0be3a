"""Stimuli of tasks, events, deadlines, precedence windows and chains.

Stimuli are as the model states them, or as a schedule places the jobs, mode by mode.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.exporters.amalthea.document import Unique, Written, add, add_property, add_time, named, ref
from halpipe.models import Anchor, Chain, Job, Precedence, Schedule, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml import etree


MODE_LABEL = "mode"


def version_label(task: str) -> str:
    """Return the name of the mode label, and of its enumeration, that selects the version of a task."""
    return f"{task}/version"


@record
class Stimulus:
    """One stimulus: a recurrence with an offset, or with several instants; the modes it is active in (none: all)."""

    name: str
    recurrence: Duration
    times: tuple[Duration, ...]
    modes: tuple[str, ...] = ()
    version: str = ""
    units: tuple[str, ...] = ()


def stimuli_of(model: TaskModel, schedule: Schedule | None) -> dict[str, list[Stimulus]]:
    """Return the stimuli of every task."""
    names = Unique()
    tables = {} if schedule is None else {mode.name: mode for mode in schedule.modes}
    runs: defaultdict[str, dict[str, None]] = defaultdict(dict)
    for played in model.modes:
        for run in played.runs:
            runs[run.task][played.name] = None
    jobs = {name: table.by_task() for name, table in tables.items()}
    found: dict[str, list[Stimulus]] = {}
    for task in model.tasks:
        stimuli = found.setdefault(task.name, [])
        for mode in [mode for mode in runs[task.name] if mode in tables]:
            only = () if len(model.modes) == 1 else (mode,)
            stimuli += _placed(task, jobs[mode].get(task.name, ()), tables[mode].hyperperiod, only, names)
        rest = [mode for mode in runs[task.name] if mode not in tables]
        if task.period is not None and (rest or not model.modes):
            modes = () if len(rest) == len(model.modes) else tuple(rest)
            offset = () if task.offset is None else (task.offset,)
            stimuli.append(Stimulus(names(task.name), task.period, offset, modes))
    return found


def _placed(
    task: Task, jobs: Sequence[Job], hyperperiod: Duration, modes: tuple[str, ...], names: Unique
) -> list[Stimulus]:
    """Return a stimulus for each version and set of units that jobs of a task have in a mode."""
    groups = grouped(((job.version, job.units), job.start) for job in sorted(jobs, key=lambda job: job.start))
    base = "@".join((task.name, *modes))
    found = []
    for (version, units), starts in groups.items():
        recurrence = hyperperiod
        step = hyperperiod / len(starts)
        if all(start == starts[0] + step * index for index, start in enumerate(starts)):
            recurrence, starts = step, starts[:1]
        found.append(Stimulus(names(base), recurrence, tuple(starts), modes, version, units))
    return found


def write_stimuli(
    parent: etree._Element, model: TaskModel, stimuli: dict[str, list[Stimulus]], written: Written
) -> None:
    """Append the stimuli of all tasks."""
    for task in model.tasks:
        for stimulus in stimuli[task.name]:
            _write(parent, task, stimulus)
            written.children(parent)


def _write(parent: etree._Element, task: Task, stimulus: Stimulus) -> None:
    kind = kind_of(stimulus)
    element = named(parent, "stimuli", kind, stimulus.name, typed=True)
    if stimulus.units:  # then a schedule gave its instants
        add_property(element, "units", " ".join(stimulus.units))
    if stimulus.version and len(task.versions) > 1:
        label = ref("ModeLabel", version_label(task.name))
        add(add(element, "setModeValueList"), "entries", label=label, value=stimulus.version)
    if stimulus.modes:
        condition = add(element, "executionCondition")
        for mode in stimulus.modes:
            equals(condition, MODE_LABEL, mode)
    add_time(element, "recurrence", stimulus.recurrence)
    if kind == "PeriodicStimulus":
        for offset in stimulus.times:
            add_time(element, "offset", offset)
    else:
        for time in stimulus.times:
            add_time(element, "occurrenceTimes", time)


def kind_of(stimulus: Stimulus) -> str:
    """Return the class of a stimulus: several instants in a recurrence need a synthetic one."""
    return "PeriodicStimulus" if len(stimulus.times) <= 1 else "PeriodicSyntheticStimulus"


def equals(condition: etree._Element, label: str, value: str) -> None:
    """Append a comparison of a mode label to a condition."""
    entry = add(condition, "entries", "ModeValueCondition", label=ref("ModeLabel", label), value=value)
    entry.set("relation", "EQUAL")


_EVENTS = {Anchor.RELEASE: "activate", Anchor.START: "start", Anchor.POINT: "start", Anchor.END: "terminate"}
_SHORTEST = Duration.parse("1ns") / 1000
"""A picosecond: the limit of a reaction time that is shorter than what is missed before."""


class Events:
    """Writes each event when it is first referred to."""

    def __init__(self, parent: etree._Element, written: Written) -> None:
        self._parent = parent
        self._complete = written
        self._written: set[str] = set()

    def process(self, task: str, type: str) -> str:
        """Return a reference to the activation, start or end of a task."""
        return self._event("ProcessEvent", f"{task}/{type}", ref("Task", task), type)

    def runnable(self, name: str, type: str = "start") -> str:
        """Return a reference to the start or end of a runnable."""
        return self._event("RunnableEvent", f"{name}/{type}", ref("Runnable", name), type)

    def _event(self, kind: str, name: str, entity: str, type: str) -> str:
        reference = ref(kind, name)
        if reference not in self._written:
            self._written.add(reference)
            element = named(self._parent, "events", kind, name, typed=True)
            element.set("eventType", type)
            element.set("entity", entity)
            self._complete.children(self._parent)
        return reference


def write_constraints(
    parent: etree._Element,
    model: TaskModel,
    events: Events,
    runnables: Mapping[tuple[str, str], str],
    written: Written,
) -> None:
    """Append event chains, timing constraints and requirements, in the order of the metamodel."""
    for chain in model.chains:
        _chain(parent, chain, events)
        written.children(parent)
    names = Unique()
    for task in model.tasks:
        alone = len(task.versions) == 1
        for version in task.versions:
            for precedence in version.precedences:
                runnable = runnables[task.name, version.name]
                target = events.process(task.name, "start") if alone else events.runnable(runnable)
                name = names(f"{precedence.task}/{task.name if alone else runnable}")
                if precedence.to is Anchor.END:
                    target = events.process(task.name, "terminate") if alone else events.runnable(runnable, "terminate")
                _delay(parent, name, precedence, target, events)
        written.children(parent)
    tasks = {task.name: task for task in model.tasks}
    for chain in model.chains:
        for type, limit in (("Reaction", _reaction(tasks, chain)), ("Age", chain.max_age)):
            if limit is not None:
                _latency(parent, chain, type, limit)
        written.children(parent)
    for task in model.tasks:
        limits = [limit for limit in (task.deadline, task.let) if limit is not None]
        if limits:
            _deadline(parent, task, min(limits))
            written.children(parent)


def _reaction(tasks: Mapping[str, Task], chain: Chain) -> Duration | None:
    """Return the limit of an AMALTHEA reaction, which counts from each stimulus event, as a latency does.

    A reaction time counts from the job before: up to a period and the jitter of the first task earlier (MODEL 10.7).
    Its limit without these is a demand that is at least as strong; the native model has the exact one.
    """
    first = tasks.get(chain.tasks[0])
    limits = [] if chain.max_latency is None else [chain.max_latency]
    if chain.max_reaction is not None and first is not None and first.period is not None:
        jitter = ZERO if first.let is not None else first.period * first.slack
        missed = first.period + jitter
        limits.append(chain.max_reaction - missed if chain.max_reaction > missed else _SHORTEST)
    return min(limits, default=None)


def _chain(parent: etree._Element, chain: Chain, events: Events) -> None:
    """Append a chain from the event of its first task, by the starts of those between, to the event of its last."""
    first, last = _EVENTS[chain.anchor or Anchor.START], _EVENTS[chain.to or Anchor.END]
    begin = events.process(chain.tasks[0], first)
    steps = [events.process(task, "start") for task in chain.tasks[1:-1]]
    ends = [begin, *steps, events.process(chain.tasks[-1], last)]
    element = named(parent, "eventChains", "EventChain", chain.name)
    element.set("stimulus", ends[0])
    element.set("response", ends[-1])
    element.set("itemType", "sequence")
    if len(chain.tasks) == 1:
        return
    for index, (stimulus, response) in enumerate(pairwise(ends), 1):
        item = add(element, "items", "EventChainContainer")
        add(item, "eventChain", name=f"{chain.name}.{index}", stimulus=stimulus, response=response)


def _delay(parent: etree._Element, name: str, precedence: Precedence, target: str, events: Events) -> None:
    """Append a window; without a mapping, since each target needs a source here, and all mappings want more.

    A point of the execution is no event: it counts from the start, which it follows by its time.
    """
    element = named(parent, "timingConstraints", "DelayConstraint", name, typed=True)
    element.set("source", events.process(precedence.task, _EVENTS[precedence.anchor]))
    element.set("target", target)
    shift = precedence.point or ZERO
    add_time(element, "upper", precedence.max + shift)
    add_time(element, "lower", precedence.min + shift)


def _latency(parent: etree._Element, chain: Chain, type: str, limit: Duration) -> None:
    name = f"{chain.name}/{type}"
    element = named(parent, "timingConstraints", "EventChainLatencyConstraint", name, typed=True)
    element.set("scope", ref("EventChain", chain.name))
    element.set("type", type)
    add_time(element, "maximum", limit)


def _deadline(parent: etree._Element, task: Task, deadline: Duration) -> None:
    element = add(parent, "requirements", "ProcessRequirement", name=f"{task.name}/deadline")
    element.set("process", ref("Task", task.name))
    limit = add(element, "limit", "TimeRequirementLimit", limitType="UpperLimit", metric="ResponseTime")
    add_time(limit, "limitValue", deadline)
