"""Periods and offsets of activations, in the order of authority of their sources.

A timing event has the period of its component prototype's override, or its own; where that is unusable, the one of
the schedule table or alarm that triggers it, then of whatever activates its OsTask, then the OsTaskPeriod, then of an
event triggering of the timing extension. Other events have none of their own: the overlay may give one, or an event
triggering, and data-received events inherit that of their senders. A process has the cycle of its deterministic client.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about, named
from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import is_symbolic, parse_number, parse_seconds
from halpipe.importers.arxml.system.containers import symbolic_values
from halpipe.importers.arxml.tasks.activation import Activation, compare, polled, report_sporadic
from halpipe.importers.arxml.tasks.dataflow import Actor, DataFlow, item_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.arxml.files.tree import Stated, Tree
    from halpipe.importers.arxml.system.values import Event, Place, System, Trigger
    from halpipe.importers.overlay import OverlayUse

NOT_SCHEDULED = {
    "OPERATION-INVOKED-EVENT": "server call: runs within its client",
    "BSW-OPERATION-INVOKED-EVENT": "server call: runs within its client",
    "INIT-EVENT": "initialisation: runs before the schedule begins",
    "OsTask": "OS task without mapped events, alarm, schedule table or period",
}
NOT_CALLED = "no OsTask calls it: its mapping in the Rte configuration names none"
NOT_MAPPED = "no OsTask calls it: the Rte configuration maps other events, but not its own"
_ON_ARRIVAL = "the RTE calls it when data arrives, whatever the period of its sender"
_NO_SENDER = "no periodic runnable is known to send its data"
_NO_PERIOD = {
    "BACKGROUND-EVENT": "background work has no period",
    "BSW-BACKGROUND-EVENT": "background work has no period",
    "DATA-RECEIVED-EVENT": _NO_SENDER,
    "SWC-MODE-SWITCH-EVENT": "mode switches have no period",
    "BSW-MODE-SWITCH-EVENT": "mode switches have no period",
    "TIMING-EVENT": "no usable period, and no OS trigger with one",
    "BSW-TIMING-EVENT": "no usable period, and no OS trigger with one",
    "PROCESS": "its manifest states no period",
}
_DATA_RECEIVED = "DATA-RECEIVED-EVENT"


@record
class Recurrence:
    """A period with the offset of its first occurrence, and the elements that it comes from."""

    period: Duration
    offset: Duration
    used: tuple[Place, ...]


def decide_periods(
    system: System,
    activations: Sequence[Activation],
    dataflow: DataFlow,
    tree: Tree,
    overlay: OverlayUse | None,
) -> list[Activation]:
    """Return the activations with their periods, or with the reason why they have none."""
    periods = Periods(system, tree)
    decided = [found for activation in activations for found in periods.of(activation)]
    if overlay is not None:
        decided = _from_overlay(decided, overlay)
    decided = [_spaced(activation, tree.findings) for activation in polled(_from_arrivals(decided))]
    for activation in decided:
        compare(activation, tree.findings)
    report_sporadic(decided, tree.findings)
    decided = _inherited([_arriving(activation) for activation in decided], dataflow, tree.findings)
    decided = [_spaced(activation, tree.findings) for activation in decided]
    return [a if a.period is not None else replace(a, reason=a.reason or _reason(a.kind)) for a in decided]


def _reason(kind: str) -> str:
    return NOT_SCHEDULED.get(kind) or _NO_PERIOD.get(kind) or "events of this kind have no period"


class Periods:
    """Finds the periods that the files state; every unusable value is reported once."""

    def __init__(self, system: System, tree: Tree) -> None:
        self._findings = tree.findings
        self._tree = tree
        self._symbols: dict[str, list[Stated]] | None = None
        self._overrides = {key: period for each in system.compositions for key, period in each.periods.items()}
        self._triggers = system.configuration.triggers
        self._is_mapped = any(mapping.task is not None for mapping in system.configuration.mappings)
        self._mapped = {mapping.event for mapping in system.configuration.mappings}

    def of(self, activation: Activation) -> list[Activation]:
        """Return the activation once for every way it recurs; unchanged if it does not."""
        event, mapping = activation.event, activation.mapping
        if event is not None and event.is_timing and self._is_mapped:
            if mapping is not None and not mapping.is_called:
                return [replace(activation, reason=NOT_CALLED)]
            if mapping is None and event.place.path not in self._mapped:
                return [replace(activation, reason=NOT_MAPPED)]
        if activation.process is not None:
            found = self._of_process(activation)
        elif event is None:
            found = self._of_os_task(activation)
        elif event.is_timing:
            found = self._of_timing_event(activation, event)
        else:
            found = []
        return [
            replace(activation, period=r.period, offset=self._offset(activation, r, found), used=r.used) for r in found
        ] or [activation]

    # -------------------------------------------------------------------------------------- timing events

    def _of_timing_event(self, activation: Activation, event: Event) -> list[Recurrence]:
        stated = event.period
        for prototype in reversed(activation.context):
            stated = self._overrides.get((event.place.path, prototype), stated)
        mapping = activation.mapping
        if mapping is not None and mapping.period is not None:
            before = f", instead of {stated.text} s" if stated is not None else ""
            stated = mapping.period
            message = f'gives "{activation.name}" the period {stated.text} s{before}'
            path = named(mapping.place.kind, mapping.place.path)
            self._findings.report(codes.PERIOD_OF_MAPPING, message, at=stated.at, path=path)
        period = self._evaluate(event, stated)
        if isinstance(period, Duration):
            self._compare(activation, period)
            return [Recurrence(period, ZERO, ())]
        found = self._recurrences(self._used_by(activation)) or self._of_os_task(activation) or of_arrival(activation)
        if not found:
            self._findings.add(period)
        for recurrence in found:
            source = recurrence.used[0]
            message = f'gets its period {recurrence.period} from {source.kind} "{source.path}"'
            self._findings.report(codes.OS_PERIOD, message, at=event.place.at, path=_what(event))
        return found

    def _compare(self, activation: Activation, period: Duration) -> None:
        """Report a period that is no multiple of how often the alarm or table that the mapping names comes."""
        used = self._used_by(activation)
        rates = {
            t.place: t.period / sum(other.table == t.table for other in used) if t.table else t.period for t in used
        }
        if rates and all(period % rate for rate in rates.values()):
            place, rate = next(iter(rates.items()))
            message = f'comes every {rate}, but "{activation.name}", which it triggers, has the period {period}'
            help = "make them agree; the period of the event counts"
            place.report(self._findings, codes.TRIGGERING_DIFFERS, message, help=help)

    def _of_process(self, activation: Activation) -> list[Recurrence]:
        cycle = activation.process.cycle if activation.process else None
        if cycle is None:
            return []
        period = parse_seconds(cycle.text)
        if period:
            return [Recurrence(period, ZERO, ())]
        message = f'CYCLE-TIME-VALUE "{cycle.text}" is not a positive number of seconds'
        path = named("PROCESS", activation.place.path)
        self._findings.report(codes.BAD_PERIOD, message, at=cycle.at, path=path, help=_PERIOD_HELP)
        return []

    def _evaluate(self, event: Event, stated: Stated | None) -> Duration | Diagnostic:
        """Return a stated period, or what is wrong with it: absent, an unknown name, or no positive time."""
        if stated is None:
            return codes.BAD_PERIOD("states no PERIOD", at=event.place.at, path=_what(event), help=_PERIOD_HELP)
        if is_symbolic(stated.text):
            return self._look_up(event, stated)
        period = parse_seconds(stated.text)
        if not period:
            message = f'PERIOD "{stated.text}" is not a positive number of seconds'
            return codes.BAD_PERIOD(message, at=stated.at, path=_what(event), help=_PERIOD_HELP)
        if not isinstance(period.ns, int):
            message = f'PERIOD "{stated.text}" is {period}, not a whole number of nanoseconds'
            help = "correct it in the source if it is a rounded value"
            self._findings.report(codes.FINE_PERIOD, message, at=stated.at, path=_what(event), help=help)
        return period

    def _look_up(self, event: Event, stated: Stated) -> Duration | Diagnostic:
        if self._symbols is None:
            self._symbols = symbolic_values(self._tree)
        values = self._symbols.get(stated.text, [])
        numbers = {parse_number(value.text) for value in values}
        number = next(iter(numbers)) if len(numbers) == 1 else None
        if number is None or number <= 0:
            texts = ", ".join(dict.fromkeys(value.text for value in values))
            why = f"its values are {texts}" if values else "no parameter of that name is configured"
            message = f'PERIOD is the name "{stated.text}", but {why}'
            help = "add the ECU configuration of its module, or give a period in the overlay (sources)"
            return codes.SYMBOLIC_UNKNOWN(message, at=stated.at, path=_what(event), help=help)
        period = seconds(number)
        message = f'PERIOD "{stated.text}" is {period}, stated at {values[0].at}'
        self._findings.report(codes.SYMBOLIC, message, at=stated.at, path=_what(event))
        return period

    # ------------------------------------------------------------------------------------ the OS as a source

    def _used_by(self, activation: Activation) -> list[Trigger]:
        """Find what triggers an event by its mapping: an expiry point, an alarm, or an OS event that one sets."""
        names = activation.mapping.triggers if activation.mapping else ()
        return [t for t in self._triggers if t.place.path in names or any(event in names for event in t.events)]

    def _of_os_task(self, activation: Activation) -> list[Recurrence]:
        """Find what activates an OsTask, or take the period that it states itself.

        One that hosts no events is also woken by what sets the OS events that it waits for.
        """
        task = activation.os_task
        if task is None:
            return []
        path, alone = task.place.path, activation.event is None
        found = self._recurrences([t for t in self._triggers if path in t.tasks or (alone and path in t.wakes)])
        if not found and task.period:
            found = [Recurrence(task.period, ZERO, (task.place,))]
        return found

    def _recurrences(self, triggers: list[Trigger]) -> list[Recurrence]:
        """Join expiry points at equal distances into one recurrence of that distance (schedule tables come first)."""
        found = []
        for table in dict.fromkeys(trigger.table for trigger in triggers if trigger.table):
            points = sorted((t for t in triggers if t.table == table), key=lambda t: t.offset)
            found += self._of_table(points)
        alarms = [trigger for trigger in triggers if not trigger.table]
        return found or [Recurrence(t.period, t.offset, (t.place, *t.through)) for t in alarms]

    def _of_table(self, points: list[Trigger]) -> list[Recurrence]:
        first = points[0]
        distance = first.period / len(points)
        if all(point.offset == first.offset + distance * index for index, point in enumerate(points)):
            used = tuple(point.place for point in points)
            return [Recurrence(distance, first.offset, (*used, *first.through))]
        message = f"triggers the same task {len(points)} times in {first.period}, at unequal distances"
        first.through[-1].report(self._findings, codes.UNEVEN_TABLE, message)
        return [Recurrence(point.period, point.offset, (point.place, *point.through)) for point in points]

    # ---------------------------------------------------------------------------------------------- offsets

    def _offset(
        self, activation: Activation, recurrence: Recurrence, all_of_it: Sequence[Recurrence]
    ) -> Duration | None:
        """Return the first stated offset other than zero, within the period; else that of the recurrence."""
        event, mapping = activation.event, activation.mapping
        for stated in (mapping.offset if mapping else None, event.offset if event else None):
            offset = self._stated_offset(stated, activation) if stated else None
            if offset:
                return offset % recurrence.period or None
        return _phase(recurrence, all_of_it)

    def _stated_offset(self, stated: Stated, activation: Activation) -> Duration | None:
        offset = parse_seconds(stated.text)
        if offset is None:
            message = f'offset "{stated.text}" is not a non-negative number of seconds'
            path, help = about(task=activation.name), "write it in seconds, such as 0.0025"
            self._findings.report(codes.BAD_OFFSET, message, at=stated.at, path=path, help=help)
        return offset


def _what(event: Event) -> str:
    return f'{event.place.kind} "{event.place.path}"'


_PERIOD_HELP = "write it in seconds, such as 0.01, or give a period in the overlay (sources)"


def _spaced(activation: Activation, findings: Findings) -> Activation:
    """Give what starts sooner than its runnable may the least time between two starts as its period."""
    stated = activation.runnable.interval if activation.runnable else None
    interval = parse_seconds(stated.text) if stated else None
    if stated is None or interval is None or activation.period is None or interval <= activation.period:
        return activation
    findings.report(
        codes.START_INTERVAL,
        f'MINIMUM-START-INTERVAL {interval} lets "{activation.name}" start less often than every '
        f"{activation.period}; {interval} is its period",
        at=stated.at,
        path=named(activation.place.kind, activation.place.path),
        help="make the period of the event at least as long as the interval",
    )
    return replace(activation, period=interval)


# ---------------------------------------------------------------------------- periods from outside the event


def _from_overlay(activations: list[Activation], overlay: OverlayUse) -> list[Activation]:
    """Give runnables that no event starts periodically the period that the overlay states for them.

    Of several events that start one, it goes to the arrival of data, else to one that an OsTask runs.
    """
    periodic = {a.actor for a in activations if a.period is not None}
    idle = grouped((each.actor, index) for index, each in enumerate(activations) if each.actor not in periodic)
    result = list(activations)
    for indices in idle.values():
        name = result[indices[0]].name
        period = overlay.task_period(name) or overlay.source_period(name)
        if period is None:
            continue
        chosen = min(indices, key=lambda i: (result[i].kind != _DATA_RECEIVED, result[i].os_task is None))
        for index in indices:
            result[index] = replace(result[index], reason="the overlay states when its runnable starts")
        result[chosen] = replace(result[chosen], period=period, reason="")
    return result


def _phase(recurrence: Recurrence, all_of_it: Sequence[Recurrence]) -> Duration | None:
    """Return the offset of a recurrence; zero counts only beside others of the same period.

    Tools write 0 where no offset was chosen, so that zero alone leaves the phase to the scheduler. In a pattern, the
    distances between the occurrences are what it states.
    """
    is_alone = len({r.offset for r in all_of_it if r.period == recurrence.period}) == 1
    return (recurrence.offset % recurrence.period or None) if is_alone else recurrence.offset % recurrence.period


def of_arrival(activation: Activation) -> list[Recurrence]:
    """Return how an activation recurs by the timing extension, once for every offset of a concrete pattern."""
    arrival = activation.arrival
    if arrival is None:
        return []
    return [Recurrence(arrival.period, offset, (arrival.place,)) for offset in arrival.offsets or (ZERO,)]


def _from_arrivals(activations: list[Activation]) -> list[Activation]:
    """Give runnables that nothing starts periodically the period of their event triggering."""
    periodic = {a.actor for a in activations if a.period is not None}
    result = []
    for activation in activations:
        found = of_arrival(activation) if activation.actor not in periodic and not activation.reason else []
        if not found:
            result.append(activation)
            continue
        periodic.add(activation.actor)
        result += [replace(activation, period=r.period, offset=_phase(r, found), used=r.used) for r in found]
    return result


def _arriving(activation: Activation) -> Activation:
    """Mark what an OsTask runs on the arrival of data: when that is, is known only without an Rte configuration."""
    if _is_pending(activation) and activation.os_task is not None:
        return replace(activation, reason=_ON_ARRIVAL)
    return activation


def _inherited(activations: list[Activation], dataflow: DataFlow, findings: Findings) -> list[Activation]:
    """Give data-received events the period that all periodic senders of their data share.

    Works forward from periodic senders until nothing changes, so that chains of data-received events inherit too.
    """
    result = list(activations)
    pending = [index for index, a in enumerate(result) if _is_pending(a)]
    while True:
        waiting = {result[index].actor for index in pending}
        ready = [i for i in pending if not any(sender in waiting for sender in senders_of(result[i], dataflow))]
        if not ready:
            return result
        periods = grouped((each.actor, each.period) for each in result if each.period is not None)
        for index in ready:
            result[index] = _inherit(result[index], periods, dataflow, findings)
        pending = [index for index in pending if index not in ready]


def _is_pending(activation: Activation) -> bool:
    return activation.kind == _DATA_RECEIVED and activation.period is None and not activation.reason


def senders_of(activation: Activation, dataflow: DataFlow) -> tuple[Actor, ...]:
    """Return the runnables that send the data whose arrival starts this activation."""
    data = activation.event.data if activation.event else None
    return dataflow.senders.get(item_at(activation.context, data), ()) if data else ()


def _inherit(
    activation: Activation, periods: dict[Actor, list[Duration]], dataflow: DataFlow, findings: Findings
) -> Activation:
    found = sorted({period for sender in senders_of(activation, dataflow) for period in periods.get(sender, ())})
    event = activation.event
    if not found or event is None:
        return replace(activation, reason=_NO_SENDER)
    if len(found) == 1:
        message = f'"{activation.name}" gets the period {found[0]} of the runnable that sends its data'
        help = "give it another period in the overlay (sources) if its data is not sent each time"
        findings.report(codes.INHERITED, message, at=event.place.at, path=_what(event), help=help)
        return replace(activation, period=found[0], is_inherited=True)
    listed = ", ".join(str(period) for period in found)
    message = f"its data is sent with periods {listed}"
    help = f'give "{activation.name}" a period in the overlay (sources)'
    findings.report(codes.SENDERS_DIFFER, message, at=event.place.at, path=_what(event), help=help)
    return replace(activation, reason=f"its data is sent with different periods: {listed}")
