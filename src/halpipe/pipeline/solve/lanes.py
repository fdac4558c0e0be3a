"""Units and resources as lanes of the hyperperiod, and what a version takes of them, in ticks.

A lane is a capacity: one for each group of interchangeable units, with the size of the group as capacity, and one for
each resource. Heights on a lane are multiples of its quantum. WCETs and access phases are rounded outward, so that what
is valid on the grid is valid exactly.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.models import Binding
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.parts import reserved_length, service_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.parts import Service

Choice = tuple[tuple[int, int], ...]
"""How many units of which groups a job takes."""

MAX_OPTIONS_PER_VERSION = 4096
"""Ways to split one gang over groups of units that are tried; only gangs over many unlike units have more."""

MAX_QUANTA = 10**6
"""Bounds with a common denominator beyond this are rounded up to this grid, which is safe."""

RESOURCE_WEIGHT = 4
"""What a tick of overload of a resource weighs against a tick of overlap on a unit.

Access phases are short against jobs, and resources tell their users apart where units of a group do not. With equal
weights the search, at one temperature for all, settles the units first and then finds no room on the resources.
"""


UnitGroups = tuple[tuple[str, ...], ...]


def interchangeable_units(expansion: Expansion, units: Iterable[Unit], *, grouped: bool) -> UnitGroups:
    """Group units that every version treats alike and that serve the same interrupts; or each stands alone."""
    member_of: dict[str, list[int]] = {unit.name: [] for unit in units}
    service = {unit.name: tuple((i.distance, i.wcet) for i in unit.interrupts) for unit in units}
    versions = [version for active in expansion.tasks for version in active.versions]
    for index, version in enumerate(versions):
        for name in member_of.keys() & version.units:
            member_of[name].append(index)
    groups: dict[object, list[str]] = {}
    for name, members in member_of.items():
        if members:
            groups.setdefault((tuple(members), service[name]) if grouped else name, []).append(name)
    return tuple(tuple(names) for names in groups.values())


def is_bound(active: ActiveTask) -> bool:
    """Return whether the jobs of a task have to choose one unit set together."""
    has_choice = any(len(set(v.units)) > v.gang for v in active.versions)
    has_choice = has_choice or len({frozenset(version.units) for version in active.versions}) > 1
    return active.task.binding is not Binding.JOB and has_choice


def quanta_of(expansion: Expansion, resources: Iterable[str]) -> dict[str, int]:
    """Return in how many equal parts each resource is shared, so that all bounds are whole; at most `MAX_QUANTA`."""
    denominators = dict.fromkeys(resources, 1)
    for version in (version for active in expansion.tasks for version in active.versions):
        for access in version.accesses:
            denominators[access.resource] = math.lcm(denominators[access.resource], access.bound.denominator)
    return {name: min(denominator, MAX_QUANTA) for name, denominator in denominators.items()}


Pins = Mapping[int, frozenset[str]]
"""The units that a task may use, by the gang of the version."""


class Lanes:
    """The lanes of a mode: those of the groups of units first, then those of the resources."""

    def __init__(
        self,
        expansion: Expansion,
        units: Sequence[Unit],
        resources: Sequence[str],
        tick: Duration | None,
        grouped: bool,
        pinned: Mapping[str, Pins],
    ) -> None:
        self.tick = tick or natural_tick(expansion)
        self.groups = interchangeable_units(expansion, units, grouped=grouped)
        self.services = {unit.name: service_of({unit.name: unit}, [unit.name]) for unit in units}
        self._units = {unit.name: unit for unit in units}
        self._is_interrupted = any(unit.interrupts for unit in units)
        self._group_of = {name: index for index, names in enumerate(self.groups) for name in names}
        self._of_resource = {name: len(self.groups) + index for index, name in enumerate(resources)}
        self._quanta = list(quanta_of(expansion, resources).values())
        self._pinned = pinned
        self._expansion = expansion
        self._known_times: dict[tuple[str, str, Service[Duration]], tuple[int, int]] = {}
        self._known_choices: dict[tuple[str, str], list[Choice]] = {}

    def ticks(self, duration: Duration) -> int:
        """Return whole ticks, rounded down; exact for every duration that the tick divides."""
        return duration // self.tick

    def ticks_up(self, duration: Duration) -> int:
        """Return whole ticks, rounded up."""
        return -(-duration // self.tick)

    @property
    def capacities(self) -> list[int]:
        """Capacity of each lane, in quanta."""
        return [len(names) for names in self.groups] + self._quanta

    @property
    def unit_weight(self) -> int:
        """The cost of one tick of overlap on a unit; one quantum of a resource costs a whole number, too."""
        return max(self._quanta, default=1)

    @property
    def weights(self) -> list[int]:
        """The cost of one tick times one quantum of excess on each lane."""
        weight = self.unit_weight
        return [weight] * len(self.groups) + [RESOURCE_WEIGHT * weight // q for q in self._quanta]

    def service(self, choice: Choice) -> Service[Duration]:
        """Return the interrupts of the units of a choice, of which those of one group are alike."""
        if not self._is_interrupted:
            return ()
        return service_of(self._units, [name for group, count in choice for name in self.groups[group][:count]])

    def times(self, active: ActiveTask, version: Version, service: Service[Duration]) -> tuple[int, int]:
        """Return how long a job takes and how late it may start: the same on all units with the same interrupts."""
        key = (active.name, version.name, service)
        if key not in self._known_times:
            self._known_times[key] = self.length(version, service), self._late(active, version, service)
        return self._known_times[key]

    def length(self, version: Version, service: Service[Duration] = ()) -> int:
        """Return how many ticks a job in this version holds its units, with their interrupts."""
        assert version.wcet is not None, "validated models state every WCET"
        return self.ticks_up(reserved_length(version.wcet, service))

    def _late(self, active: ActiveTask, version: Version, service: Service[Duration]) -> int:
        """Return the largest delta in whole ticks: slack gamma * D, or what the deadline leaves (MODEL 3).

        Of polled arrivals, that with which every job ends in time after the start of the one before, however little
        late that was (MODEL 8.2): enough, not necessary.
        """
        task = active.task
        if task.period is None or version.wcet is None:
            return 0
        slack, due = task.period * task.slack, task.period if task.deadline is None else task.deadline
        if task.distance is not None:
            due = (task.deadline or task.distance) - task.period
            slack = min(slack, task.distance - task.period)
        due = due if task.let is None else min(due, task.let)
        if self._expansion.is_released_at_start(active):
            slack = ZERO
        room = due - reserved_length(version.wcet, service)
        # No job slips a whole period: of two jobs that start together, only their names would say which is the first.
        return min(self.ticks(slack), self.ticks(room), self.ticks(task.period) - 1)

    def phases(self, version: Version, service: Service[Duration]) -> list[tuple[int, int, int, int]]:
        """Return rectangles for a version's access phases; those on one lane never overlap.

        The kernel looks at one rectangle at a time, so what a job claims twice at once must be one of them. On every
        tick stands the most that the job claims at any instant of it.
        """
        spans: dict[int, list[tuple[Duration, Duration, Fraction]]] = {}
        for access in version.accesses:
            span = access.start, reserved_length(access.end, service), access.bound
            spans.setdefault(self._of_resource[access.resource], []).append(span)
        return [rect for lane, claims in spans.items() for rect in self._rectangles(lane, claims)]

    def _rectangles(
        self, lane: int, claims: list[tuple[Duration, Duration, Fraction]]
    ) -> Iterator[tuple[int, int, int, int]]:
        """Yield the rectangles of a version on one lane."""
        changes: dict[Duration, Fraction] = {}
        for start, end, bound in claims:
            changes[start] = changes.get(start, Fraction()) + bound
            changes[end] = changes.get(end, Fraction()) - bound
        instants = sorted(changes)
        claimed = list(itertools.accumulate(changes[instant] for instant in instants))  # from each instant on
        edges = sorted({edge for start, end, _ in claims for edge in (self.ticks(start), self.ticks_up(end))})
        for begin, until in itertools.pairwise(edges):
            first = max(0, bisect_right(instants, self.tick * begin) - 1)
            most = max(claimed[first : bisect_left(instants, self.tick * until)])
            if height := math.ceil(most * self._quanta[lane - len(self.groups)]):
                yield lane, begin, until - begin, height

    def choices(self, active: ActiveTask, version: Version) -> list[Choice]:
        """List how many units of each group a job may take: one group, or all splits of a gang."""
        key = (active.name, version.name)
        if key not in self._known_choices:
            self._known_choices[key] = self._listed_choices(active, version)
        return self._known_choices[key]

    def _listed_choices(self, active: ActiveTask, version: Version) -> list[Choice]:
        names, pinned = dict.fromkeys(version.units), self._pinned.get(active.name)
        allowed = names if pinned is None else [name for name in names if name in pinned.get(version.gang, ())]
        available = Counter(self._group_of[name] for name in allowed)
        picks = itertools.combinations_with_replacement(sorted(available), version.gang)
        counted = (tuple((g, pick.count(g)) for g in dict.fromkeys(pick)) for pick in picks)
        fitting = (choice for choice in counted if all(count <= available[g] for g, count in choice))
        served = (choice for choice in fitting if self._has_time(version, self.service(choice)))
        return list(itertools.islice(served, MAX_OPTIONS_PER_VERSION))

    @staticmethod
    def _has_time(version: Version, service: Service[Duration]) -> bool:
        """Return whether the interrupts of all units of a gang together leave time for a job."""
        try:
            reserved_length(version.wcet or ZERO, service)
        except ValueError:
            return False
        return True
