"""Arm MPAM: the largest and the least bandwidth of every partition, in the registers of a memory-system component.

A partition is selected, then its MBW_MAX and MBW_MIN are written. A maximum is some of ``2**width`` parts of the
capacity; with HARDLIM nothing passes above it. Partition 0 is what everything has that was given no other: it gets
one part, as does every partition that belongs to no unit. Source: Arm, MPAM system component specification (IHI 0099).
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import about
from halpipe.exporters.regulator.backends.base import falls_first, file_names, identifiers, predecessors, render
from halpipe.exporters.regulator.backends.rates import Shares, check_owners, coarse, over_limit, rate_text, unit_rates
from halpipe.exporters.regulator.codes import DOES_NOT_FIT, NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.owners import outward

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

PART_SEL, MBW_MIN, MBW_MAX = 0x100, 0x200, 0x208
HARDLIM = 1 << 31
FIELD = 16


class Mpam:
    """Register writes for set-up and for every table, as script and as C arrays."""

    name = "mpam"
    summary = "Arm MPAM: register writes for set-up and for every mode, as script and as C arrays"
    least = 0
    reserves = "used"
    rates = True
    carries = False

    def overshoot(self, platform: Platform) -> int:
        """Return 0; what passes within a regulation period is for the platform to state."""
        return 0

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a partition of their own, and rates that do not fit."""
        found = list(_check_partitions(tables))
        for table in () if found else tables.tables:
            found += _check_parts(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the parts of every unit in every table."""
        part = Fraction(tables.platform.capacity, _parts(tables.platform))
        return {
            "part_bytes_per_second": part.numerator // part.denominator,
            "parts": {
                t.name: {unit.name: _given(tables, t)[unit.name] for unit in tables.units} for t in tables.tables
            },
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return ``setup.txt``, a script for every table, ``load.sh`` that loads them, and ``mpam.h``."""
        values = {"platform": tables.platform, "model": tables.model, "digest": digest}
        setup = list(_setup(tables))
        scripts = [(table, list(_writes(tables, table))) for table in tables.tables]
        files = {"setup.txt": render("mpam_setup.txt.j2", writes=setup, **values)}
        for stem, (table, writes) in zip(file_names(t.name for t in tables.tables), scripts, strict=True):
            files[f"{stem}.txt"] = render("mpam.txt.j2", table=table, writes=writes, **values)
        names = identifiers(table.name for table in tables.tables)
        base = tables.platform.settings[self.name]["base"]
        files["mpam.h"] = render(
            "mpam.h.j2", setup=setup, scripts=list(zip(names, scripts, strict=True)), base=base, **values
        )
        files["load.sh"] = render("load.sh.j2", base=base, guard="", digest=digest)
        return files


def _parts(platform: Platform) -> int:
    return 1 << int(platform.settings[Mpam.name]["width"])


def _partition(tables: Tables, unit: str) -> int:
    partid = tables.platform.units[unit].partid
    assert partid is not None  # checked before anything is written
    return partid


def _given(tables: Tables, table: Table) -> dict[str, int]:
    """Return the least number of parts for every unit that keeps its promise, one at least."""
    part = Fraction(tables.platform.capacity, _parts(tables.platform))
    return {unit: max(1, -int(-rate // part)) for unit, rate in unit_rates(tables, table).items()}


def _select(platform: Platform, partition: int, parts: int) -> Iterator[tuple[int, int]]:
    """Yield the writes that give a partition its parts: as minimum, and as maximum with a hard limit."""
    shift = FIELD - int(platform.settings[Mpam.name]["width"])
    field = ((parts - 1) << shift) | ((1 << shift) - 1)
    yield PART_SEL, partition
    yield MBW_MAX, HARDLIM | field
    yield MBW_MIN, field


def _setup(tables: Tables) -> Iterator[tuple[int, int]]:
    for partition in range(int(tables.platform.settings[Mpam.name]["partids"])):
        yield from _select(tables.platform, partition, 1)


def _writes(tables: Tables, table: Table) -> Iterator[tuple[int, int]]:
    before = [_given(tables, t) for t in predecessors(tables, table)]
    for unit, parts in falls_first(before, _given(tables, table)):
        yield from _select(tables.platform, _partition(tables, unit), parts)


def _check_partitions(tables: Tables) -> Iterator[Diagnostic]:
    count = int(tables.platform.settings[Mpam.name]["partids"])
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    for port in ports:
        path = about(unit=port.unit)
        if not port.partid:
            message = "has partition 0, which is everything else's" if port.partid == 0 else "has no partition"
            yield NO_MANAGER(message, at=port.at, path=path, help='state "partid: N", from 1 on')
        elif port.partid >= count:
            message = f"partition {port.partid} does not exist; the component has {count}"
            help = f'use 1 to {count - 1}, or state "mpam: {{partids: {port.partid + 1}}}"'
            yield DOES_NOT_FIT(message, at=port.at, path=path, help=help)
    yield from check_owners(
        ((port.unit, port.partid, port.at) for port in ports if port.partid), "partid", outward(range(1, count))
    )


def _check_parts(tables: Tables, table: Table) -> Iterator[Diagnostic]:
    part = Fraction(tables.platform.capacity, _parts(tables.platform))
    promised = {"everything else": Fraction(0), **unit_rates(tables, table)}
    parts: Mapping[str, int] = {"everything else": 1, **_given(tables, table)}
    given = {name: count * part for name, count in parts.items()}
    for unit, count in parts.items():
        if count > _parts(tables.platform):
            message = f"is promised {rate_text(promised[unit])}, more than the capacity"
            path = about(table.frame.path, unit=unit)
            yield RATE_DOES_NOT_FIT(message, at=table.frame.at, path=path, help="lower the bound")
        else:
            yield from coarse(tables, table, unit, given[unit], promised[unit])
    shares = _shares(_parts(tables.platform), list(promised.values()))
    yield from over_limit(tables, table, given, promised, "use the back-end table or axi-realm", shares=shares)


MOST_PARTS = 1024
"""That are tried one by one for the capacity at which a promise needs one part less."""


def _shares(parts: int, rates: list[Fraction]) -> Shares:
    """Return what these rates take of another capacity, at least one part each."""

    def total(capacity: int) -> Fraction | None:
        counts = [max(1, -int(-rate * parts // capacity)) for rate in rates]
        return None if max(counts) > parts else Fraction(sum(counts) * capacity, parts)

    tried = range(1, parts + 1, max(1, parts // MOST_PARTS))
    return Shares(total, [rate * parts / count for rate in rates for count in tried])
