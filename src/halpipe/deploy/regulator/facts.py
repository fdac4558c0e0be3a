"""Platform figures of a bundle (platform.yaml): those that tables.json repeats, and those of the device models.

Read here on its own, by the documented form (docs/reference/regulator-platform.md), and not through the exporter.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import parse_yaml
from halpipe.core.quantities import parse_bandwidth, parse_rational, parse_size
from halpipe.core.records import record
from halpipe.deploy.regulator.codes import UNUSABLE_TABLES, WRONG_FACTS
from halpipe.devices import DEVICES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.regulator.reading import Tables, Unit

PLATFORM = "platform.yaml"
DIRECTIONS = ("read", "write")
_HERTZ = {"Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
_HELP = "export the bundle again; tables.json is made from platform.yaml"


@record(kw_only=True)
class Facts:
    """A platform: Hz, bytes, cycles, bytes per second; keys of units and settings of back-ends as they are written."""

    clock: int
    bus: int
    burst: int
    cycles: int
    extra: Fraction
    guaranteed: int
    capacity: int
    peak: int | None
    unspecified: str
    resource: str
    name: str
    overshoot: int | None
    units: Mapping[str, Mapping[str, str]]
    settings: Mapping[str, Mapping[str, str]]

    @property
    def seconds(self) -> Fraction:
        """The length of a window."""
        return (self.cycles + self.extra) / self.clock

    def number(self, backend: str, key: str) -> int:
        """Return a setting that is a whole number."""
        return int(self.settings[backend][key])


def read_facts(bundle: Bundle) -> Facts:
    """Return the facts; raise `HalpipeError` where the file is not in its form."""
    if PLATFORM not in bundle.files:
        raise HalpipeError(UNUSABLE_TABLES("is not in the bundle", at=bundle.at(PLATFORM), help=_HELP))
    document = parse_yaml(bundle.files[PLATFORM], str(bundle.at(PLATFORM).file))
    try:
        return _facts(document)
    except (ValueError, KeyError, TypeError, AttributeError, ZeroDivisionError) as failure:
        text = f"is no platform: {failure}"
        raise HalpipeError(UNUSABLE_TABLES(text, at=bundle.at(PLATFORM), help=_HELP)) from None


def _facts(document: Any) -> Facts:
    clock = _frequency(document["clock"])
    window = document["window"].strip()
    cycles = Fraction(int(window)) if window.isdigit() else Duration.parse(window).in_unit("s") * clock
    bus = document["bus"].strip()
    guaranteed = parse_bandwidth(document["guaranteed"])
    return Facts(
        clock=clock,
        bus=int(parse_rational(bus.removesuffix("bit")) / 8) if bus.endswith("bit") else parse_size(bus),
        burst=parse_size(document["burst"]),
        cycles=int(cycles),
        extra=cycles - int(cycles),
        guaranteed=guaranteed,
        capacity=parse_bandwidth(document["capacity"]) if "capacity" in document else guaranteed,
        peak=parse_bandwidth(document["peak"]) if "peak" in document else None,
        unspecified=document.get("unspecified", "read"),
        resource=document.get("resource", ""),
        name=document.get("name", ""),
        overshoot=parse_size(document["overshoot"]) if "overshoot" in document else None,
        units={name: dict(unit or {}) for name, unit in document["units"].items()},
        settings={name: {**device.defaults, **(document.get(name) or {})} for name, device in DEVICES.items()},
    )


def _frequency(text: str) -> int:
    match = re.fullmatch(r"\s*([0-9.]+)\s*(Hz|kHz|MHz|GHz)\s*", text)
    if match is None:
        raise ValueError(f"{text!r} is no frequency")
    return int(Fraction(match[1]) * _HERTZ[match[2]])


def setting_frequency(facts: Facts, backend: str) -> int:
    """Return the clock that a back-end has of its own, in Hz."""
    return _frequency(facts.settings[backend]["clock"])


# ---------------------------------------------------------------------------------------------- tables.json


def compare_facts(bundle: Bundle, tables: Tables, facts: Facts) -> Iterator[Diagnostic]:
    """Yield every figure of tables.json that platform.yaml does not state so."""
    p = tables.platform
    pairs: list[tuple[str, object, object]] = [
        ("clock_hz", p.clock_hz, facts.clock),
        ("bus_bytes", p.bus_bytes, facts.bus),
        ("burst_bytes", p.burst_bytes, facts.burst),
        ("window_cycles", p.window_cycles, facts.cycles),
        ("window_extra", p.window_extra, facts.extra),
        ("guaranteed", p.guaranteed, facts.guaranteed),
        ("capacity", p.capacity, facts.capacity),
        ("unspecified", p.unspecified, facts.unspecified),
        ("table_depth", p.table_depth, facts.number("table", "depth")),
        ("resource", p.resource, facts.resource or p.resource),
        ("name", p.name, facts.name or p.name),
    ]
    for unit in tables.units:
        known = facts.units.get(unit.name, {})
        pairs.append((f'manager of unit "{unit.name}"', str(unit.manager), known.get("manager")))
        for direction in DIRECTIONS:
            stated = known.get(f"default-{direction}")
            if stated is not None:
                pairs.append((f'{direction} default of "{unit.name}"', unit.default[direction], parse_size(stated)))
            kept, expected = unit.overshoot[direction], _reserve(tables, facts, unit, direction)
            pairs.append((f'{direction} overshoot of "{unit.name}"', kept, expected))
    for what, have, want in pairs:
        if have != want:
            text = f"{what} is {have}, platform.yaml gives {want}"
            yield WRONG_FACTS(text, at=bundle.at("tables.json"), help=_HELP)


def _reserve(tables: Tables, facts: Facts, unit: Unit, direction: str) -> int:
    """Return what must be kept for a row: what passes above a budget, and what the back-end cannot deny."""
    known = {"axi-realm": facts.burst, "qos400": facts.number("qos400", "burstiness") * facts.burst}
    each = known.get(tables.backend, 0) if facts.overshoot is None else facts.overshoot
    each += DEVICES[tables.backend].least * facts.burst
    used = {d: tables.is_used(unit, d) for d in DIRECTIONS}
    is_kept = used[direction] or unit.default[direction] > 0
    rule = DEVICES[tables.backend].reserves
    is_kept |= rule == "all" or (rule == "units" and any(used.values()))
    return each if is_kept else 0
