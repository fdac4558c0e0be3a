"""Hardware: processing units, memories and the paths between them; accesses to labels as access phases.

From 0.9.0, units and memories stand in structures, at the frequency of a domain; before, cores run at a quartz times
the ratio of a prescaler, and their type states instructions per cycle. Labels are read at the beginning of a job and
written at its end. The length of a phase follows from the sizes of the labels and from the path of the unit to the
memory; its share of the memory is the rate at which the unit draws, over the peak of the memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.common.names import Names, legal
from halpipe.models import Access, AccessKind, Resource, Transfer

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.importers.amalthea.graph import Amount
    from halpipe.importers.amalthea.xmi import Forest, Item

_CACHE_LINE = 8  # bytes that one access moves where neither cache nor port says more
_LATENCY_KINDS = ("readLatency", "writeLatency")


@record
class Path:
    """Access path to a memory: cycles of the unit for an access of `width` bytes, or a rate in bytes per second."""

    read: Fraction
    write: Fraction
    rate: Fraction | None
    width: Fraction

    def seconds(self, size: Fraction, writes: bool, frequency: Fraction) -> Fraction:
        """Return how long `size` bytes take: by rate after one latency, else one latency for every access."""
        latency = (self.write if writes else self.read) / frequency
        return latency + size / self.rate if self.rate else -(-size // self.width) * latency

    def peak(self, writes: bool, frequency: Fraction) -> Fraction | None:
        """Return the rate in bytes per second at which the unit draws while it accesses; None if without bound."""
        cycles = self.write if writes else self.read
        return self.rate or (self.width * frequency / cycles if cycles else None)


@dataclass(slots=True)
class Pu:
    """A processing unit or core; `frequency` in Hz, `ipc` instructions per cycle of its type."""

    item: Item
    type: Item | None
    frequency: Fraction | None
    ipc: Fraction = Fraction(1)
    needs: dict[str, Fraction] = field(default_factory=dict)
    paths: dict[Item, Path] = field(default_factory=dict)


@record
class Hardware:
    """All units, and all memories with their peaks in bytes per second (None: not stated), in document order."""

    units: tuple[Pu, ...]
    memories: dict[Item, Fraction | None]


def read_hardware(forest: Forest) -> Hardware:
    """Read the hardware; report units without a frequency."""
    memories = {item: _peak(forest, item) for item in forest.kinds("Memory") if item.within("HWModel")}
    units = [_unit(forest, item, memories) for item in forest.kinds("ProcessingUnit")]
    units += [_core(forest, item) for item in forest.kinds("Core") if item.within("HWModel")]
    lacking = [unit.item for unit in units if not unit.frequency]
    help = "state frequency domains (or quartzes), or WCETs in an overlay"
    forest.report_each(codes.NO_FREQUENCY, "processing units have no frequency", lacking, help)
    return Hardware(tuple(units), memories)


# ----------------------------------------------------------------------------------------- from 0.9.0 on


def _unit(forest: Forest, item: Item, memories: Iterable[Item]) -> Pu:
    type = forest.ref(item, "definition")
    unit = Pu(item, type, _frequency(forest, item))
    if type is not None:
        for feature in forest.refs(type, "features"):
            value = forest.number(feature, "value")
            category = feature.owner.name if feature.owner else ""
            if value:  # of several features of a category the smallest is safe
                unit.needs[category] = min(value, unit.needs.get(category, value))
    for access in item.all("accessElements"):
        destination = forest.ref(access, "destination")
        if destination is not None and destination in memories and (path := _path(forest, item, access, destination)):
            unit.paths.setdefault(destination, path)
    return unit


def _frequency(forest: Forest, item: Item) -> Fraction | None:
    domain = forest.ref(item, "frequencyDomain")
    value = forest.hertz(domain and domain.one("defaultValue"))
    if domain is not None and value:
        domain.use_all()
    return value or None


def _path(forest: Forest, unit: Item, access: Item, memory: Item) -> Path | None:
    """Return the path that an access element states by latencies or a rate, its own or those along its access path."""
    cycles = [latency_of(forest, access.one(kind)) for kind in _LATENCY_KINDS]
    rate = forest.rate(access.one("dataRate"))
    if rate is None and not any(cycles):
        cycles, rate = _along(forest, unit, access, memory)
    if rate is None and not any(cycles):
        return None
    access.use_all()
    return Path(cycles[0] or Fraction(0), cycles[1] or Fraction(0), rate or None, _width(forest, unit, memory))


def _along(forest: Forest, unit: Item, access: Item, memory: Item) -> tuple[list[Fraction | None], Fraction | None]:
    """Return the latencies along an access path with that of the memory, in cycles of the unit, and the least rate."""
    path = access.one("accessPath")
    elements = [] if path is None else forest.refs(path, "pathElements")
    own = _frequency(forest, unit)
    cycles: list[Fraction | None] = [Fraction(0), Fraction(0)]
    rates = []
    for element in (*elements, memory) if elements else ():
        holder = element if element.kind == "HwConnection" else forest.ref(element, "definition")
        if holder is None:
            continue
        element.use()
        holder.use_all()
        frequency = own if element.kind == "HwConnection" else _frequency(forest, element) or own
        scale = own / frequency if own and frequency else Fraction(1)
        for index, kind in enumerate(_LATENCY_KINDS):
            latency = latency_of(forest, holder.one(kind, "accessLatency"))
            cycles[index] = (cycles[index] or 0) + (latency or 0) * scale
        if (rate := forest.rate(holder.one("dataRate"))) is not None:
            rates.append(rate)
    return cycles, min(rates, default=None)


def latency_of(forest: Forest, value: Item | None) -> Fraction | None:
    """Return the largest number of cycles that a latency states."""
    if value is None:
        return None
    return forest.number(value, "value") or forest.number(value, "upperBound")


def _width(forest: Forest, unit: Item, memory: Item) -> Fraction:
    """Return the bytes that an access moves: a line of the caches beside the unit, else the width of a port."""
    structure = unit.owner
    caches = [*unit.all("caches"), *((c for c in structure.children if c.kind == "Cache") if structure else ())]
    for cache in caches:
        definition = forest.ref(cache, "definition")
        size = forest.size(definition and definition.one("lineSize"))
        if definition is not None and size:
            cache.use()
            definition.use_all()
            return size
    return _port_width(forest, unit) or _port_width(forest, memory) or Fraction(_CACHE_LINE)


def _port_width(forest: Forest, item: Item) -> Fraction | None:
    best: Fraction | None = None
    for port in item.all("ports"):
        width = forest.number(port, "bitWidth")
        if width and (best is None or width > best):
            port.use()
            best = width
    return None if best is None else best / 8


def _peak(forest: Forest, item: Item) -> Fraction | None:
    definition = forest.ref(item, "definition")
    rate = forest.rate(definition and definition.one("dataRate"))
    if rate and definition is not None:
        definition.use_all()
        return rate
    frequency, width = _frequency(forest, item), _port_width(forest, item)
    return frequency * width if frequency and width else None


# ------------------------------------------------------------------------------------------ before 0.9.0


def _core(forest: Forest, item: Item) -> Pu:
    type = forest.ref(item, "coreType")
    ipc = None if type is None else forest.number(type, "instructionsPerCycle")
    prescaler = item.one("prescaler")
    quartz = None if prescaler is None else forest.ref(prescaler, "quartz")
    if prescaler is None or quartz is None:
        return Pu(item, type, None, ipc or Fraction(1))
    stated = quartz.one("frequency")
    frequency = forest.number(quartz, "frequency") if stated is None else forest.hertz(stated)
    ratio = forest.number(prescaler, "clockRatio") or Fraction(1)  # 0 is what tools write where none was chosen
    quartz.use_all()
    return Pu(item, type, frequency * ratio if frequency else None, ipc or Fraction(1))


@record
class Phase:
    """Accesses to one memory, one after another: how long they take, and which share of it they use."""

    resource: str
    kind: AccessKind
    length: Duration
    bound: Fraction
    transfers: tuple[Transfer, ...]


class Memories:
    """Memories of labels, and the resources of the model that they become."""

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
        names = Names(forest.findings, codes.RENAMED)
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
        for item, peak in self._hardware.memories.items():
            if self._names[item] in used:
                item.use()
                found.append(Resource(name=self._names[item], bandwidth=int(peak or 0) or None))
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
            self._sizes[label] = self._forest.size(label.one("size")) or Fraction(0)
        return self._sizes[label]

    def _bound(self, memory: Item, path: Path, writes: bool, frequency: Fraction) -> Fraction:
        peak, drawn = self._hardware.memories[memory], path.peak(writes, frequency)
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
