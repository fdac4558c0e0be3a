"""Processing units with their core types and frequencies, memories with their peaks, and the paths between them.

From 0.9.0, units and memories stand in structures, at the frequency of a domain; before, cores run at a quartz times
the ratio of a prescaler, and their type states instructions per cycle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.amalthea import codes

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.importers.amalthea.xmi import Forest, Item

_CACHE_LINE = 8  # bytes that one access moves where neither cache nor port says more
_LATENCY_KINDS = ("readLatency", "writeLatency")


@record
class Path:
    """How a unit reaches a memory: cycles of the unit for an access of `width` bytes, or a rate in bytes per second."""

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
class Memory:
    """A memory and its peak in bytes per second, where it is stated."""

    item: Item
    peak: Fraction | None


@record
class Hardware:
    """All units and memories, in document order."""

    units: tuple[Pu, ...]
    memories: dict[Item, Memory]


def read_hardware(forest: Forest) -> Hardware:
    """Read the hardware; report units without a frequency."""
    memories = {item: _memory(forest, item) for item in forest.kinds("Memory") if item.within("HWModel")}
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
    stated = None if domain is None else domain.one("defaultValue")
    value = None if stated is None else forest.hertz(stated)
    if domain is not None and value:
        domain.use_all()
    return value or None


def _path(forest: Forest, unit: Item, access: Item, memory: Item) -> Path | None:
    """Return the path that an access element states by latencies or a rate, its own or those along its access path."""
    cycles = [latency_of(forest, access.one(kind)) for kind in _LATENCY_KINDS]
    stated = access.one("dataRate")
    rate = None if stated is None else forest.rate(stated)
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
        stated = holder.one("dataRate")
        if (rate := None if stated is None else forest.rate(stated)) is not None:
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
        line = None if definition is None else definition.one("lineSize")
        size = None if line is None else forest.size(line)
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


def _memory(forest: Forest, item: Item) -> Memory:
    definition = forest.ref(item, "definition")
    stated = None if definition is None else definition.one("dataRate")
    rate = None if stated is None else forest.rate(stated)
    if rate and definition is not None:
        definition.use_all()
        return Memory(item, rate)
    frequency, width = _frequency(forest, item), _port_width(forest, item)
    return Memory(item, frequency * width if frequency and width else None)


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
