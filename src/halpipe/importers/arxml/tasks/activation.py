"""Activations of work, with how often they arrive, and the tasks that are cut out of them.

Every event of every component instance is paired with its OsTask; tasks are cut by runnable, event or OsTask."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named
from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.common.names import legal, unique_name
from halpipe.importers.common.polling import polling_period
from halpipe.models import Origin

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Iterable, Sequence

    from halpipe.importers.arxml.system.values import (
        Arrival,
        Event,
        EventMapping,
        Instance,
        Observable,
        OsTask,
        Place,
        Process,
        Runnable,
        System,
    )
    from halpipe.importers.arxml.tasks.dataflow import Actor


@record(kw_only=True)
class Activation:
    """One reason for work to be done: an event of an instance that starts a runnable, or an OsTask or process.

    `name` is what a task of it is called. `period` None means that it does not recur, as `reason` explains; `used`
    are the elements that the period comes from, where it is not the event's own. `arrival` is what the timing
    extension says of how often it happens; with `distance` that is sporadic, and the period is that of polling. `twin`
    is the runnable that is the same function as a BSW entity, and `joins` the event of it with which this one shares a
    call. `is_inherited` says that the period is that of the sender of its data, and `called_every` is the period of a
    call that is not due at each activation of its OsTask.
    """

    name: str
    place: Place
    context: tuple[str, ...] = ()
    runnable: Runnable | None = None
    event: Event | None = None
    mapping: EventMapping | None = None
    os_task: OsTask | None = None
    process: Process | None = None
    arrival: Arrival | None = None
    period: Duration | None = None
    offset: Duration | None = None
    reason: str = ""
    used: tuple[Place, ...] = ()
    distance: Duration | None = None
    twin: Actor | None = None
    joins: Event | None = None
    is_inherited: bool = False
    called_every: Duration | None = None

    @property
    def kind(self) -> str:
        """The kind of event, or of what starts on its own: OsTask, PROCESS, a runnable without events."""
        return self.event.place.kind if self.event else self.place.kind

    @property
    def actor(self) -> Actor:
        """The runnable of this instance, or the OsTask or process."""
        return self.context, self.place.path

    @property
    def work(self) -> Actor:
        """Executed entity: the runnable, or for a BSW entity the runnable that is the same function (`twin`)."""
        return self.twin or self.actor


def find_activations(system: System, findings: Findings) -> list[Activation]:
    """Pair the events of every instance with runnables and OS tasks; add what runs without any event.

    That is runnables whose arrival the timing extension states, OS tasks that host nothing, and processes.
    """
    arrivals = Arrivals(system)
    tasks = {task.place.path: task for task in system.configuration.tasks}
    mappings = _Mappings(system, findings)
    found = [activation for instance in system.instances for activation in _of_instance(instance, mappings, tasks)]
    found += _without_events(system, found, arrivals)
    hosting = {activation.os_task.place.path for activation in found if activation.os_task}
    found += [
        Activation(name=task.place.name, place=task.place, os_task=task)
        for path, task in tasks.items()
        if path not in hosting
    ]
    found += [
        Activation(name=process.place.name, place=process.place, context=(process.place.path,), process=process)
        for process in system.processes
    ]
    if arrivals.subjects:
        found = [replace(activation, arrival=arrivals.of(activation)) for activation in found]
    return _named_apart(_joined(found, system), findings)


def _without_events(system: System, found: list[Activation], arrivals: Arrivals) -> list[Activation]:
    stated = frozenset(arrivals.subjects)
    if not stated:
        return []
    started = {activation.actor for activation in found}
    return [
        Activation(
            name=f"{instance.label}/{runnable.place.name}",
            place=runnable.place,
            context=instance.context,
            runnable=runnable,
        )
        for instance in system.instances
        for runnable in instance.component.runnables
        if runnable.place.path in stated and (instance.context, runnable.place.path) not in started
    ]


def _of_instance(instance: Instance, mappings: _Mappings, tasks: dict[str, OsTask]) -> list[Activation]:
    runnables = {runnable.place.path: runnable for runnable in instance.component.runnables}
    found = []
    for event in instance.component.events:
        runnable = runnables.get(event.runnable or "")
        if runnable is None:
            continue
        mapping = mappings.of(instance, event)
        found.append(
            Activation(
                name=f"{instance.label}/{runnable.place.name}",
                place=runnable.place,
                context=instance.context,
                runnable=runnable,
                event=event,
                mapping=mapping,
                os_task=tasks.get(mapping.task or "") if mapping else None,
            )
        )
    return found


class _Mappings:
    """The mappings of events to OS tasks, by event and instance."""

    def __init__(self, system: System, findings: Findings) -> None:
        self._findings = findings
        self._configured = system.configured
        self._by_event: dict[str, list[EventMapping]] = {}
        for mapping in system.configuration.mappings:
            if mapping.event is not None:
                self._by_event.setdefault(mapping.event, []).append(mapping)

    def of(self, instance: Instance, event: Event) -> EventMapping | None:
        """Choose the mapping of an event for one instance: its own, or one that names no instance."""
        mappings = self._by_event.get(event.place.path, [])
        context, configured = instance.context, self._configured
        own = [m for m in mappings if m.prototype in context or configured.get(m.prototype or "") == context]
        general = [mapping for mapping in mappings if mapping.prototype is None]
        any_instance = mappings if len(instance.context) == 1 else []
        found = own or general or any_instance
        self._report_second(own or general)
        return next((mapping for mapping in found if mapping.task is not None), found[0] if found else None)

    def _report_second(self, mappings: Sequence[EventMapping]) -> None:
        """Report mappings of an event to another OsTask than the first, of which there may be none (SWS_Rte_07843)."""
        called = [mapping for mapping in mappings if mapping.task is not None]
        for other in called[1:]:
            if other.task != called[0].task:
                message = f"maps an event to {other.task}, but {called[0].place.path}, to {called[0].task}, counts"
                help = "remove one of the two mappings"
                other.place.report(self._findings, codes.SECOND_MAPPING, message, help=help)


def _joined(activations: list[Activation], system: System) -> list[Activation]:
    """Point BSW entities to the runnable that is the same function, where an instance of it exists."""
    if not system.twins:
        return activations
    actors = {a.place.path: a.actor for a in reversed(activations) if a.runnable is not None}
    return [replace(a, twin=actors.get(system.twins.get(a.place.path, ""))) for a in activations]


def _named_apart(activations: list[Activation], findings: Findings) -> list[Activation]:
    """Give runnables that would be called the same their whole AUTOSAR path, and every name its legal form."""
    actors = {activation.actor: activation for activation in activations}
    shared = {name for name, count in Counter(a.name for a in actors.values()).items() if count > 1}
    names = {}
    for actor, activation in actors.items():
        name = legal(_full_name(activation) if activation.name in shared else activation.name)
        names[actor] = name
        if name != activation.name:
            message = f'is called "{name}"'
            at, path = activation.place.at, named(activation.place.kind, activation.name)
            findings.report(codes.RENAMED, message, at=at, path=path)
    chosen = ((activation, names[activation.actor]) for activation in activations)
    return [activation if name == activation.name else replace(activation, name=name) for activation, name in chosen]


def _full_name(activation: Activation) -> str:
    if len(activation.context) < 2:
        return activation.place.path.lstrip("/")
    steps = [activation.context[0].lstrip("/"), *(path.rpartition("/")[2] for path in activation.context[1:])]
    return "/".join((*steps, activation.place.name))


BEGINNINGS = ("activated", "started")


class Arrivals:
    """The event triggerings of the timing extension, by what they are about."""

    def __init__(self, system: System) -> None:
        observables = {observable.place.path: observable for observable in system.timing.observables}
        self._by_subject: dict[str, list[tuple[Observable, Arrival]]] = {}
        for arrival in system.timing.arrivals:
            observable = observables.get(arrival.event)
            if observable is not None:
                self._by_subject.setdefault(observable.subject, []).append((observable, arrival))

    @property
    def subjects(self) -> Iterable[str]:
        """The runnables and data elements (paths) that arrivals are stated for."""
        return self._by_subject.keys()

    def of(self, activation: Activation) -> Arrival | None:
        """Return how often the work of an activation begins, or the data that starts it arrives; None if unstated."""
        data = activation.event.data if activation.event else None
        found = list(self._by_subject.get(activation.place.path, ()))
        if data is not None:
            found += self._by_subject.get(data.element, ())
        for observable, arrival in found:
            if observable.prototype is not None and observable.prototype not in activation.context:
                continue
            arrives = data is not None and observable.what == "received" and observable.port == data.port
            if arrives or observable.what in BEGINNINGS:
                return arrival
        return None


def slack_of(activation: Activation, findings: Findings) -> Fraction | None:
    """Return the jitter that a triggering allows, as a share of the period; None if none is stated.

    A triggering with jitter J lets every occurrence lie up to J after its regular instant, which is what slack is
    (MODEL, section 3: 0 <= delta <= gamma D).
    """
    arrival = activation.arrival
    if arrival is None or not arrival.jitter or not activation.period:
        return None
    if arrival.jitter <= activation.period:
        return Fraction(arrival.jitter / activation.period)
    arrival.place.report(
        findings,
        codes.TIMING_PART_LOST,
        f"JITTER {arrival.jitter} is longer than the period {activation.period}; a slack of one period is imported",
        help="correct the jitter, or state the slack in the overlay",
    )
    return Fraction(1)


def compare(activation: Activation, findings: Findings) -> None:
    """Report a triggering that contradicts the period which an activation has from elsewhere."""
    arrival = activation.arrival
    if arrival is None or arrival.place in activation.used or activation.period is None:
        return
    occurrences = len(arrival.offsets or (ZERO,))
    period = activation.period * occurrences
    if arrival.period != period if arrival.offsets is not None else arrival.period > period:
        arrival.place.report(
            findings,
            codes.TRIGGERING_DIFFERS,
            f'states the period {arrival.period / occurrences} for "{activation.name}", which has {activation.period}',
            help="make them agree; the period of the event, or of the OS, counts",
        )


def polled(activations: Sequence[Activation]) -> list[Activation]:
    """Give sporadic work, which recurs at its least distance so far, the period at which it is looked for."""
    periods = [a.period for a in activations if a.period is not None and not _is_sporadic(a)]
    return [
        replace(a, distance=a.period, period=polling_period(a.period, periods), offset=None)
        if a.period is not None and _is_sporadic(a)
        else a
        for a in activations
    ]


def _is_sporadic(activation: Activation) -> bool:
    """Whether the period of an activation is the least distance of a triggering without a period."""
    arrival = activation.arrival
    return arrival is not None and arrival.offsets is None and arrival.place in activation.used


def report_sporadic(activations: Iterable[Activation], findings: Findings) -> None:
    """Report every triggering without a period, and how often it is looked for."""
    for activation in activations:
        arrival = activation.arrival
        if arrival is not None and activation.distance is not None:
            what = f"looks every {activation.period} for what comes every {activation.distance} at most"
            message = f'"{activation.name}" {what}'
            help = "give another period in the overlay (sources), if occurrences so dense cannot be"
            arrival.place.report(findings, codes.SPORADIC, message, help=help)


@record
class Draft:
    """A task to be: its name, and the activations that it serves, in their order within the OsTask.

    All members have the same period, offset and OsTask.
    """

    name: str
    members: tuple[Activation, ...]
    place: Place

    @property
    def period(self) -> Duration | None:
        """The common period; None for a process whose manifest states none."""
        return self.members[0].period

    @property
    def distance(self) -> Duration | None:
        """The least distance of the arrivals that it polls for; None if it is periodic by itself."""
        return self.members[0].distance

    @property
    def offset(self) -> Duration | None:
        """The common offset."""
        return self.members[0].offset

    @property
    def os_task(self) -> OsTask | None:
        """The common OsTask."""
        return self.members[0].os_task

    @property
    def origin(self) -> Origin:
        """Origin in the source; an OsTask lists its runnables, in order."""
        origin = self.place.origin
        if self.place.kind != "OsTask" or not any(member.event for member in self.members):
            return origin
        listed = ", ".join(dict.fromkeys(member.name for member in self.members))
        return Origin(origin.file, origin.line, f"{origin.path}: {listed}")

    @property
    def position(self) -> int | None:
        """The first position in the OsTask."""
        return min((p for p in map(position_of, self.members) if p is not None), default=None)

    def is_within(self, calls: Collection[Activation], *, end: bool) -> bool:
        """Return whether some calls happen within jobs: others precede them, or for their `end` follow them."""
        works = {call.work for call in calls}
        own = [member for member in self.members if member.work in works]
        rest = [member for member in self.members if member.work not in works]
        return len(works) > 1 or not (are_in_order(rest, own) if end else are_in_order(own, rest))

    @property
    def disabled_in(self) -> frozenset[str]:
        """The mode declarations (paths) in which no member is active."""
        return frozenset.intersection(*(frozenset(_disabled_in(member)) for member in self.members))


def _disabled_in(activation: Activation) -> tuple[str, ...]:
    if activation.process is not None:
        return activation.process.disabled_in
    return activation.event.disabled_in if activation.event else ()


def position_of(activation: Activation) -> int | None:
    """Return RtePositionInTask of an activation that an OsTask runs."""
    return activation.mapping.position if activation.mapping and activation.os_task else None


def are_in_order(first: Iterable[Activation], second: Iterable[Activation]) -> bool:
    """Return whether the positions in an OsTask state that it calls all of `first` before any of `second`."""
    pairs = product(map(position_of, first), map(position_of, second))
    return all(one is not None and other is not None and one < other for one, other in pairs)


def group(activations: Sequence[Activation], granularity: str) -> list[Draft]:
    """Make one draft per runnable instance (or event, or OsTask), period and offset; names are unique.

    Several events with the same period and offset that start one runnable make one task: the second start would
    find nothing left to do. Events of different periods or offsets make one task each. Processes are tasks even
    without a period: there is nothing else in their manifests that could be.
    """
    active = [each for each in activations if each.period is not None or each.process is not None]
    groups = grouped((_key(activation, granularity), activation) for activation in active)
    members = [sorted(found, key=_order) for found in groups.values()]
    names = _names(members, granularity)
    return [
        Draft(name, tuple(found), _place(found[0], granularity)) for name, found in zip(names, members, strict=True)
    ]


def _key(activation: Activation, granularity: str) -> Hashable:
    os_task = activation.os_task.place.path if activation.os_task else ""
    event = activation.joins or activation.event
    if granularity == "event" and event is not None:
        return (*activation.work, event.place.path, activation.period, activation.offset, os_task)
    if granularity == "ostask" and os_task:
        return os_task, activation.period, activation.offset
    return activation.work, activation.period, activation.offset, os_task


def _order(activation: Activation) -> tuple[bool, int]:
    position = position_of(activation)
    return position is None, position or 0


def _place(first: Activation, granularity: str) -> Place:
    if granularity == "ostask" and first.os_task:
        return first.os_task.place
    if granularity == "event" and first.event:
        return first.event.place
    return first.place


def _names(groups: list[list[Activation]], granularity: str) -> list[str]:
    """Name tasks after runnable or OsTask, adding the period, then the offset, then the event while names collide."""
    names = [_base_name(found[0], granularity) for found in groups]
    for suffix in _SUFFIXES:
        if len(set(names)) == len(names):
            break
        longer = [legal(name + suffix(found[0])) for name, found in zip(names, groups, strict=True)]
        variants = Counter(name for name, _ in set(zip(names, longer, strict=True)))
        names = [more if variants[name] > 1 else name for name, more in zip(names, longer, strict=True)]
    taken: dict[str, int] = {}
    return [unique_name(name, taken) for name in names]


def _base_name(first: Activation, granularity: str) -> str:
    if granularity == "ostask" and first.os_task:
        return legal(first.os_task.place.name)
    if granularity == "event" and first.event:
        return legal(f"{first.name}@{first.event.place.name}")
    return first.name


_SUFFIXES: tuple[Callable[[Activation], str], ...] = (
    lambda first: f"@{first.period}" if first.period else "",
    lambda first: f"+{first.offset}" if first.offset else "",
    lambda first: f"@{first.event.place.name}" if first.event else "",
)
