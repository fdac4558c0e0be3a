"""Cuts tasks out of activations: by runnable, by event, or by OsTask."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.arxml.names import legal_name, unique_name
from halpipe.models import Origin

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.system.values import OsTask, Place
    from halpipe.importers.arxml.tasks.activation import Activation


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
        """Where it comes from; an OsTask lists what it runs, in order."""
        origin = self.place.origin
        if self.place.kind != "OsTask" or not any(member.event for member in self.members):
            return origin
        listed = ", ".join(dict.fromkeys(member.name for member in self.members))
        return Origin(origin.file, origin.line, f"{origin.path}: {listed}")

    @property
    def position(self) -> int | None:
        """The first position in the OsTask."""
        return min((p for p in map(position_of, self.members) if p is not None), default=None)

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


def group(activations: Sequence[Activation], granularity: str) -> list[Draft]:
    """Make one draft per runnable instance (or event, or OsTask), period and offset; names are unique.

    Several events with the same period and offset that start one runnable make one task: the second start would
    find nothing left to do. Events of different periods or offsets make one task each. Processes are tasks even
    without a period: there is nothing else in their manifests that could be.
    """
    groups: dict[Hashable, list[Activation]] = {}
    for activation in activations:
        if activation.period is not None or activation.process is not None:
            groups.setdefault(_key(activation, granularity), []).append(activation)
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
    for suffix in (_period_suffix, _offset_suffix, _event_suffix):
        if len(set(names)) == len(names):
            break
        longer = [legal_name(name + suffix(found[0])) for name, found in zip(names, groups, strict=True)]
        variants = Counter(name for name, _ in set(zip(names, longer, strict=True)))
        names = [more if variants[name] > 1 else name for name, more in zip(names, longer, strict=True)]
    taken: set[str] = set()
    return [unique_name(name, taken) for name in names]


def _base_name(first: Activation, granularity: str) -> str:
    if granularity == "ostask" and first.os_task:
        return legal_name(first.os_task.place.name)
    if granularity == "event" and first.event:
        return legal_name(f"{first.name}@{first.event.place.name}")
    return first.name


def _period_suffix(first: Activation) -> str:
    return f"@{first.period}" if first.period else ""


def _offset_suffix(first: Activation) -> str:
    return f"+{first.offset}" if first.offset else ""


def _event_suffix(first: Activation) -> str:
    return f"@{first.event.place.name}" if first.event else ""
