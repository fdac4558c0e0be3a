"""The regulators of a bundle while it is played: which table holds from when on, and what each gate lets through."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from fractions import Fraction
from operator import itemgetter
from typing import TYPE_CHECKING

from halpipe.core.bundles import MODEL, SCHEDULE, Bundle
from halpipe.core.records import record
from halpipe.deploy.regulator import DEPLOYMENT as REGULATORS
from halpipe.deploy.regulator.arithmetic import RATES
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.riscv.board.bus import Opening

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.deploy.base import Target
    from halpipe.deploy.regulator.reading import Table, Tables, Unit
    from halpipe.deploy.riscv.target import Site

FOLDER = "regulator/"


def regulators_of(target: Target) -> Target | None:
    """Return the regulators of a bundle as one of their own, with the same model and schedule; None if it has none."""
    bundle = target.bundle
    files = {name.removeprefix(FOLDER): data for name, data in bundle.files.items() if name.startswith(FOLDER)}
    if not files:
        return None
    files |= {name: bundle.files[name] for name in (MODEL, SCHEDULE)}
    return replace(target, bundle=Bundle(f"{bundle.path}/{FOLDER.rstrip('/')}", REGULATORS.name, {}, files))


def regulators_playing(target: Target, site: Site, rate: int) -> Regulators | None:
    """Return the regulators that stand between DMA engine and memory; None where none grants bytes in windows.

    `rate` is the machine's units of time in a second. Raise `HalpipeError` where their tables cannot be read.
    """
    own = regulators_of(target)
    tables = read_tables(own.bundle) if own is not None else None
    return Regulators(tables, site, rate) if tables is not None and tables.backend not in RATES else None


class Regulators:
    """They follow the runtime: with each of its tables begins their own, unless that of a switch is still in force.

    Before the first one nothing is regulated. What they will play is the successor of each table, until the runtime
    begins another one.
    """

    def __init__(self, tables: Tables, site: Site, rate: int) -> None:
        self.width = tables.platform.window_ns * rate / 10**9
        self._tables = tables.tables
        self._named = {table.name: table for table in tables.tables}
        self._channel = site.channels.get(tables.platform.resource)
        units = {unit.name: unit for unit in tables.units}
        self._units = {unit.hart: units[unit.name] for unit in site.units if unit.name in units}
        self._platform = tables.platform
        self._begun: list[tuple[Fraction, Table]] = []

    def begin(self, name: str, start: Fraction | int) -> None:
        """Follow the runtime to its next table."""
        table = self._named.get(name)
        if table is not None and (not self._begun or start >= self._end(*self._begun[-1])):
            self._begun.append((Fraction(start), table))

    def gate(self, channel: int, hart: int, writes: bool) -> TableGate | None:
        """Return what a transfer has to pass; None where nothing regulates its unit or the memory of its channel."""
        unit = self._units.get(hart)
        if channel != self._channel or unit is None or not self._begun:
            return None
        direction = "write" if writes else "read"
        p = self._platform
        return TableGate(self, unit, direction, p.burst_bytes, p.bus_bytes, unit.overshoot[direction])

    def openings(self, unit: Unit, direction: str, since: Fraction) -> Iterator[Opening]:
        """Yield the windows from `since` on that grant something; it ends if there will be none."""
        barren = 0
        while barren <= len(self._tables):
            start, table, end = self.playing(since)
            barren += 1
            for begin, budget in _windows(table, unit.name, direction, int((since - start) // self.width)):
                opening = Opening(start + begin * self.width, start + (begin + 1) * self.width, budget)
                if opening.begin >= end:
                    break
                barren = 0
                yield opening
            since = end

    def playing(self, instant: Fraction) -> tuple[Fraction, Table, Fraction]:
        """Return the table that is played at an instant, with its begin and end; before all of them, the first."""
        number = max(bisect_right(self._begun, instant, key=itemgetter(0)) - 1, 0)
        start, table = self._begun[number]
        later = [begin for begin, _ in self._begun[number + 1 : number + 2]]
        while self._end(start, table) <= instant:
            turns = (instant - start) // (table.windows * self.width) if table.successor == table.index else 1
            start, table = start + turns * table.windows * self.width, self._tables[table.successor]
        return start, table, min([self._end(start, table), *later])

    def _end(self, start: Fraction, table: Table) -> Fraction:
        return start + table.windows * self.width


@record
class TableGate:
    """One direction of one unit; see `Gate`."""

    regulators: Regulators
    unit: Unit
    direction: str
    burst: int
    beat: int
    overshoot: int

    def openings(self, since: Fraction) -> Iterator[Opening]:
        """Yield the windows from `since` on in which something may pass."""
        return self.regulators.openings(self.unit, self.direction, since)

    def __hash__(self) -> int:
        return hash((self.unit.index, self.direction))


def _windows(table: Table, unit: str, direction: str, first: int) -> Iterator[tuple[int, int]]:
    """Yield the windows of a table from `first` on that have a budget, each with it."""
    entries = table.entries[unit]
    ends = [*(entry.window for entry in entries[1:]), table.windows]
    for entry, end in zip(entries, ends, strict=True):
        budget = entry.budget(direction)
        for window in range(max(first, entry.window), end if budget else 0):
            yield window, budget
