"""Accesses to labels as access phases: reads at the beginning of a job, writes at its end, by the memory they go to.

How long a phase takes follows from the sizes of the labels and from how the unit reaches the memory; its share of the
memory is the rate at which the unit draws, over the memory's peak.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.names import Names, legal
from halpipe.models import Access, AccessKind, Resource, Transfer

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.importers.amalthea.graph import Amount
    from halpipe.importers.amalthea.hardware import Hardware, Path, Pu
    from halpipe.importers.amalthea.xmi import Forest, Item


@record
class Phase:
    """Accesses to one memory, one after another: how long they take, and which share of it they use."""

    resource: str
    kind: AccessKind
    length: Duration
    bound: Fraction
    transfers: tuple[Transfer, ...]


class Memories:
    """Where labels are, and the resources of the model that this makes."""

    def __init__(self, forest: Forest, hardware: Hardware) -> None:
        self._forest = forest
        self._hardware = hardware
        self._place: dict[Item, Item] = {}
        self._mappings: dict[Item, Item] = {}
        self._sizes: dict[Item, Fraction] = {}
        self._names: dict[Item, str] = {}
        self.assumed: dict[Item, None] = {}
        self.unplaced: dict[Item, None] = {}
        self.unreached: dict[Item, None] = {}
        names = Names(forest.findings)
        for item in hardware.memories:
            self._names[item] = names.unique(item.name, "memory", item.at)
        for mapping in forest.kinds("MemoryMapping"):
            if (label := forest.ref(mapping, "abstractElement")) is not None:
                self._put(label, mapping)
        self._put_sections()

    def _put(self, label: Item, mapping: Item) -> None:
        """Note the memory that a mapping gives a label, unless another one does."""
        memory = self._forest.ref(mapping, "memory")
        if memory is not None and memory in self._hardware.memories:
            self._place.setdefault(label, memory)
            self._mappings.setdefault(label, mapping)

    def _put_sections(self) -> None:
        """Put labels where their sections are; a label that a section mapping names lies there, too."""
        sections: dict[Item, Item] = {}
        for mapping in self._forest.kinds("PhysicalSectionMapping"):
            for label in self._forest.refs(mapping, "labels"):
                self._put(label, mapping)
            for section in self._forest.refs(mapping, "origin"):
                sections.setdefault(section, mapping)
        for placed in self._forest.kinds("Label"):
            own = self._forest.ref(placed, "section")
            if own is not None and own in sections:
                self._put(placed, sections[own])

    def name(self, memory: Item) -> str:
        """Return the name of a memory as a resource."""
        return self._names[memory]

    def resources(self, used: Sequence[str]) -> tuple[Resource, ...]:
        """Return the memories of some names, with their peaks."""
        found = []
        for item, memory in self._hardware.memories.items():
            if self._names[item] in used:
                item.use()
                peak = None if memory.peak is None else int(memory.peak)
                found.append(Resource(name=self._names[item], bandwidth=peak))
        return tuple(found)

    def phases(self, amount: Amount, unit: Pu) -> list[Phase]:
        """Return the phases of reading and writing on a unit, memory by memory."""
        found = []
        for counts, kind in ((amount.reads, AccessKind.READ), (amount.writes, AccessKind.WRITE)):
            by_memory: dict[Item, dict[Item, Fraction]] = {}
            for label, count in counts.items():
                if label not in self._place:
                    self.unplaced[label] = None
                else:
                    by_memory.setdefault(self._place[label], {})[label] = count
            for memory, labels in by_memory.items():
                phase = self._phase(memory, labels, kind, unit)
                if phase is not None and phase.length:
                    found.append(phase)
        return found

    def _phase(self, memory: Item, labels: Mapping[Item, Fraction], kind: AccessKind, unit: Pu) -> Phase | None:
        path, frequency = unit.paths.get(memory), unit.frequency
        if path is None or not frequency:
            self.unreached[unit.item] = None
            return None
        writes = kind is AccessKind.WRITE
        total = Fraction(0)
        for label, count in labels.items():
            label.use()
            self._mappings[label].use()
            if (section := self._forest.ref(label, "section")) is not None:
                section.use()
            total += count * path.seconds(self._size(label), writes, frequency)
        moved = tuple(
            Transfer(buffer=legal(label.name), symbol=legal(label.name), size=size)
            for label in labels
            if (size := -int(-self._size(label) // 1))
        )
        bound = self._bound(memory, path, writes, frequency)
        return Phase(self._names[memory], kind, seconds(total), bound, moved)

    def _size(self, label: Item) -> Fraction:
        if label not in self._sizes:
            stated = label.one("size")
            self._sizes[label] = (None if stated is None else self._forest.size(stated)) or Fraction(0)
        return self._sizes[label]

    def _bound(self, memory: Item, path: Path, writes: bool, frequency: Fraction) -> Fraction:
        peak, drawn = self._hardware.memories[memory].peak, path.peak(writes, frequency)
        if not peak or not drawn:
            self.assumed[memory] = None
            return Fraction(1)
        return min(Fraction(1), drawn / peak)

    def report(self) -> None:
        """Report what was assumed, and accesses whose time is not known."""
        units = list(self.unreached)
        help = "state latencies or a data rate of the access elements, or shares in an overlay"
        self._forest.report_each(
            codes.NO_WAY, "processing units state no way to a memory that they access", units, help
        )
        help = "state the data rate of the memory and the latency or data rate of the access, or shares in an overlay"
        self._forest.report_each(
            codes.DEFAULT_BOUND, "memories are taken whole by each access", list(self.assumed), help
        )


def placed(phases: Sequence[Phase], wcet: Duration) -> tuple[Access, ...]:
    """Lay the phases out in a job: reads from its start on, writes up to its end; they must fit."""
    found = []
    at = ZERO
    for phase in phases:
        if phase.kind is AccessKind.READ:
            found.append(_access(phase, at))
            at += phase.length
    at = wcet - length_of(p for p in phases if p.kind is AccessKind.WRITE)
    for phase in phases:
        if phase.kind is AccessKind.WRITE:
            found.append(_access(phase, at))
            at += phase.length
    return tuple(found)


def _access(phase: Phase, start: Duration) -> Access:
    return Access(
        resource=phase.resource,
        start=start,
        end=start + phase.length,
        bound=phase.bound,
        kind=phase.kind,
        transfers=phase.transfers,
    )


def length_of(phases: Iterable[Phase]) -> Duration:
    """Return how long phases take together."""
    return sum((phase.length for phase in phases), ZERO)
