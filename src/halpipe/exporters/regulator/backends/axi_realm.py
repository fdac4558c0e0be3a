"""AXI-REALM (pulp-platform/axi_rt): budgets in bytes per period, which software rewrites window by window.

What its RTL was measured to do decides how it is programmed:

* A budget is loaded at the end of a period only, so that it is written in the window before it applies.
* A greedy manager gets one burst more than its budget: that is the overshoot.
* A budget of 0 in any region or direction isolates the manager as a whole. That is what a unit gets that never uses the
  resource. Of any other unit, a direction that is idle, now or always, keeps a budget of one burst, for which room is
  reserved; only regions that hold no address are left open.
* A period written before its budget starts with budget 0; budgets come first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.exporters.regulator.backends.base import file_names, identifiers, render
from halpipe.exporters.regulator.codes import BINDS_BOTH, DOES_NOT_FIT, TOO_MANY_WRITES
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS, READ

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import RegulatedUnit, Table, Tables

CLAIM = 0x7
ENABLE = 0x0C
OPEN = 0x7FFFFFFF


@record
class RegisterMap:
    """Offsets of the registers, which move with the numbers of managers and regions that the RTL is built for."""

    managers: int
    regions: int

    @property
    def len_limit(self) -> int:
        """Lengths of bursts, 8 bits for each manager."""
        return 0x14

    @property
    def imtu_enable(self) -> int:
        """One bit for each manager."""
        return self.len_limit + -(-self.managers // 4) * 4

    @property
    def guard(self) -> int:
        """Who owns the registers; it lies behind them, at the top of the next larger power of two."""
        counters, facts = 4, 13  # banks to be read only; then isolation and what the RTL was built with
        size = self.bank(END_OF_BANKS + counters, 0, 0) + 4 * facts
        return (2 << (size - 1).bit_length()) - 4

    def bank(self, number: int, manager: int, region: int) -> int:
        """Return a register of one of the banks with one register for each manager and region."""
        count = self.managers * self.regions
        return self.imtu_enable + 8 + 4 * (number * count + manager * self.regions + region)


START_LOW, START_HIGH, END_LOW, END_HIGH, WRITE_BUDGET, READ_BUDGET, WRITE_PERIOD, READ_PERIOD = range(8)
END_OF_BANKS = 8


@record
class Write:
    """A register write: `window` is the one during which it must be done."""

    window: int
    offset: int
    value: int


class AxiRealm:
    """A script of register writes, and the same as arrays for an interrupt handler."""

    name = "axi-realm"
    summary = "AXI-REALM: register writes for set-up and for every window, as script and as C arrays"
    least = 1
    reserves = "units"
    rates = False
    carries = False

    def overshoot(self, platform: Platform) -> int:
        """Return one burst: the bus is cut after the budget is spent."""
        return platform.burst

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return what the register file or the handler cannot do, and where promises depend on each other."""
        return [*_check_managers(tables), *_check_directions(tables), *_check_handler(tables)]

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return how much software has to write."""
        worst, where = _worst(tables)
        limit = int(tables.platform.settings[self.name]["writes-per-window"])
        regulated = {unit.manager for unit in tables.units}
        free = [m for m in range(_map(tables).managers) if m not in regulated]
        return {
            "writes_per_window": worst,
            "worst_window": where,
            "writes_allowed": limit,
            "managers_not_regulated": " ".join(map(str, free)) or "none",
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return ``setup.txt``, a script for every table, ``load.sh`` that loads them, and ``axi_realm.h``."""
        platform = tables.platform
        values = {"platform": platform, "model": tables.model, "digest": digest}
        setup = list(_setup(tables))
        scripts = [(table, _entry(tables, table), _changes(tables, table)) for table in tables.tables]
        files = {"setup.txt": render("axi_realm_setup.txt.j2", setup=setup, **values)}
        for stem, (table, entry, changes) in zip(file_names(t.name for t in tables.tables), scripts, strict=True):
            files[f"{stem}.txt"] = render("axi_realm.txt.j2", table=table, entry=entry, changes=changes, **values)
        names = identifiers(table.name for table in tables.tables)
        base, guard = platform.settings[self.name]["base"], f"{_map(tables).guard:#05x}"
        files["axi_realm.h"] = render(
            "axi_realm.h.j2",
            setup=setup,
            scripts=list(zip(names, scripts, strict=True)),
            switches=tables.switches,
            number={table.name: table.index for table in tables.tables},
            base=base,
            guard=guard,
            **values,
        )
        files["load.sh"] = render("load.sh.j2", base=base, guard=guard, digest=digest)
        return files


def _map(tables: Tables) -> RegisterMap:
    settings = tables.platform.settings[AxiRealm.name]
    return RegisterMap(int(settings["managers"]), int(settings["regions"]))


def _setup(tables: Tables) -> Iterator[Write]:
    """Yield the writes of the set-up: claim, burst length, regions, default budgets, and only then periods."""
    p, registers, rows = tables.platform, _map(tables), set(_bound(tables))
    beats = p.burst // p.bus - 1
    yield Write(0, registers.guard, CLAIM)
    for offset in range(registers.len_limit, registers.imtu_enable, 4):
        yield Write(0, offset, beats * 0x01010101)
    for unit in tables.units:
        for region in range(registers.regions):  # region 0 is all of memory, the others are empty
            low, high = (0, 0xFFFFFFFF) if region == 0 else (0xFFFFFFFF, 0xFFFFFFFF)
            for bank, value in ((START_LOW, low), (START_HIGH, low), (END_LOW, high), (END_HIGH, high)):
                yield Write(0, registers.bank(bank, unit.manager, region), value)
            for direction in DIRECTIONS:
                budget = OPEN
                if region == 0:
                    is_bound = Row(unit.name, direction) in rows
                    budget = max(unit.default[direction], p.burst) if is_bound else 0
                yield Write(0, _budget(registers, unit, direction, region), budget)
    for unit in tables.units:  # a period that is written loads the budget, so budgets come first
        for region in range(registers.regions):
            for bank in (WRITE_PERIOD, READ_PERIOD):
                yield Write(0, registers.bank(bank, unit.manager, region), p.cycles - 1)
    mask = sum(1 << unit.manager for unit in tables.units)
    yield Write(0, ENABLE, mask)
    yield Write(0, registers.imtu_enable, mask)  # one write for all, so that their windows are aligned


def _bound(tables: Tables) -> list[Row]:
    """Return both directions of every unit that has a budget somewhere."""
    used = {row.unit for row in tables.rows}
    return [Row(unit.name, d) for unit in tables.units if unit.name in used for d in DIRECTIONS]


def _budget(registers: RegisterMap, unit: RegulatedUnit, direction: str, region: int = 0) -> int:
    return registers.bank(READ_BUDGET if direction == READ else WRITE_BUDGET, unit.manager, region)


def _programmed(tables: Tables, table: Table) -> dict[int, list[int]]:
    """Return for every budget register its bytes in every window; never 0."""
    registers, burst = _map(tables), tables.platform.burst
    rows = set(_bound(tables))
    bound = ((unit, d) for unit in tables.units for d in DIRECTIONS if Row(unit.name, d) in rows)
    return {
        _budget(registers, unit, d): [max(n, AxiRealm.least) * burst for n in table.row(Row(unit.name, d))]
        for unit, d in bound
    }


def _entry(tables: Tables, table: Table) -> list[Write]:
    """Return the writes before the first window, to be done in the last window of whatever ran before."""
    return [Write(0, offset, values[0]) for offset, values in _programmed(tables, table).items()]


def _changes(tables: Tables, table: Table) -> list[Write]:
    """Return the writes within the table, each one window ahead; a mode ends with those for its own repetition."""
    found = []
    for offset, values in _programmed(tables, table).items():
        found += [Write(k - 1, offset, values[k]) for k in range(1, len(values)) if values[k] != values[k - 1]]
        if table.successor == table.index and values[0] != values[-1]:
            found.append(Write(len(values) - 1, offset, values[0]))
    return sorted(found, key=lambda write: (write.window, write.offset))


def _worst(tables: Tables) -> tuple[int, str]:
    """Return the most writes in any one window, and where; a switch writes every budget."""
    worst, where = len(_bound(tables)), "any switch"
    for table in tables.tables:
        counts: dict[int, int] = {}
        for write in _changes(tables, table):
            counts[write.window] = counts.get(write.window, 0) + 1
        for window, count in counts.items():
            if count > worst:
                worst, where = count, f"{table.frame.path} window {window}"
    return worst, where


def _check_managers(tables: Tables) -> list[Diagnostic]:
    managers = _map(tables).managers
    return [
        DOES_NOT_FIT(
            f"manager {unit.manager} does not exist; the register file has {managers}",
            at=tables.platform.units[unit.name].at,
            path=about(unit=unit.name),
            help=f'use 0 to {managers - 1}, or state "axi-realm: {{managers: {unit.manager + 1}}}"',
        )
        for unit in tables.units
        if unit.manager >= managers
    ]


def _check_directions(tables: Tables) -> list[Diagnostic]:
    p, rows, found = tables.platform, set(tables.rows), []
    pending = int(p.settings[AxiRealm.name]["pending"]) * p.burst
    for unit in tables.units:
        at, path = p.units[unit.name].at, about(unit=unit.name)
        bound = [row for row in (Row(unit.name, d) for d in DIRECTIONS) if row in rows]
        if len(bound) == len(DIRECTIONS):
            message = "both its reads and its writes are bound; whichever spends its budget first stops the other, too"
            help = "give the writes of this unit a manager of their own"
            found.append(BINDS_BOTH(message, at=at, path=path, help=help))
        for row in bound:
            least = min((n for table in tables.tables for n in table.row(row) if n), default=0) * p.burst
            if least < pending:
                message = (
                    f"{row.direction} budget is {least} bytes in some window, {pending} may be pending: slow to stop"
                )
                help = "use longer windows, or fewer pending transactions"
                found.append(BINDS_BOTH(message, at=at, path=path, help=help))
    return found


def _check_handler(tables: Tables) -> list[Diagnostic]:
    limit = int(tables.platform.settings[AxiRealm.name]["writes-per-window"])
    worst, where = _worst(tables)
    if worst <= limit:
        return []
    message = f"{where} needs {worst} register writes; the handler can do {limit}"
    help = f'state "axi-realm: {{writes-per-window: {worst}}}" if it can, or use longer windows'
    return [TOO_MANY_WRITES(message, at=tables.platform.at, path="platform axi-realm", help=help)]
