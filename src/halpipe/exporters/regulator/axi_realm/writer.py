"""AXI-REALM (pulp-platform/axi_rt): budgets in bytes per period, which software rewrites window by window.

Measurements of its RTL decide how it is programmed:

* A budget is loaded at the end of a period only, so that it is written in the window before it applies.
* A greedy manager gets one burst more than its budget: that is the overshoot.
* A budget of 0 in any region or direction isolates the manager as a whole. That is the budget of a unit that never uses
  the resource. Of any other unit, a direction that is idle, now or always, keeps a budget of one burst, for which room
  is reserved; only regions that hold no address are left open.
* A period written before its budget starts with budget 0; budgets come first.
* Set-up registers are write-only. What the file was built with, bypass, and what is left of budgets can be read.
* An unused region still needs its end above its start.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.devices import DEVICES
from halpipe.devices.registers import RegisterFile
from halpipe.exporters.regulator.codes import BINDS_BOTH, DOES_NOT_FIT, SHORT_BURSTS, TOO_MANY_WRITES
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS, Platform
from halpipe.exporters.regulator.writing import ALL, START, Check, Write, file_names, render, script

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.exporters.regulator.tables import RegulatedUnit, Table, Tables

DEVICE = "axi_realm"
CLAIM = 0x7
OPEN = 0x7FFFFFFF
NOWHERE = (ALL - 1, ALL, ALL, ALL)
"""Start and end, low and high, of a region that holds no address of a bus; the end is above the start."""

EVERYWHERE = (0, 0, ALL, ALL)


class AxiRealm:
    """Scripts of register writes: the set-up, and what an interrupt handler writes window by window."""

    device = DEVICES["axi-realm"]
    name = device.name

    def overshoot(self, platform: Platform) -> int:
        """Return one burst: the bus is cut after the budget is spent."""
        return platform.burst

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return what the register file or the handler cannot do, and where promises depend on each other."""
        return [
            *_check_managers(tables),
            *_check_window(tables.platform),
            *_check_directions(tables),
            *_check_short(tables.platform),
            *_check_handler(tables),
        ]

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
        """Return ``setup.txt``, a script for every table, and ``load.sh`` that loads them."""
        claim, *setup = _setup(tables)
        steps: list[Write | Check] = [claim, *_built(tables), *setup, *_started(tables)]
        meaning = (
            "Load it before any manager starts, in this order: claim, lengths of bursts, regions, budgets, periods."
        )
        files = {"setup.txt": script(tables, digest, "AXI-REALM set-up", meaning, steps)}
        meaning = "WRITE(window, offset, value) applies from the next window on; -1: the last one of the table before."
        for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True):
            title = (
                f"AXI-REALM budgets of {table.frame.path}, {table.windows} windows of {tables.platform.cycles} cycles"
            )
            steps = [Write(START, offset, values[0]) for offset, values in _programmed(tables, table).items()]
            steps += _changes(tables, table)
            files[f"{stem}.txt"] = script(tables, digest, title, meaning, steps)
        files["load.sh"] = render("load.sh.j2", base=tables.platform.settings[self.name]["base"], digest=digest)
        return files


def _map(tables: Tables) -> RegisterFile:
    settings = tables.platform.settings[AxiRealm.name]
    return RegisterFile(DEVICE, int(settings["managers"]), int(settings["regions"]))


def _built(tables: Tables) -> list[Check]:
    """Return how the register file must be built, to be read before anything but the claim is written."""
    p, registers = tables.platform, _map(tables)
    budgets = [n for unit in tables.units for n in unit.default.values()]
    budgets += [p.burst * n for table in tables.tables for bursts in table.bursts.values() for n in bursts]
    return [
        Check(registers.offset(name), ALL, least, most)
        for name, least, most in (
            ("num_managers", registers.managers, registers.managers),
            ("num_addr_regions", registers.regions, registers.regions),
            ("data_width", 8 * p.bus, 8 * p.bus),
            ("period_width", (p.cycles - 1).bit_length(), ALL),
            ("budget_width", max(budgets).bit_length(), ALL),
        )
    ]


def _started(tables: Tables) -> list[Check]:
    """Return how the units must be after the set-up: in use, with what is left of a budget and a period in range."""
    registers, found = _map(tables), []
    mask = sum(1 << unit.manager for unit in tables.units)
    found.append(Check(registers.offset("rt_bypassed"), mask, 0, 0))
    for unit in tables.units:
        field = unit.manager * registers.regions
        for d in DIRECTIONS:
            found.append(Check(registers.offset(f"{d}_period_left", field), ALL, 0, tables.platform.cycles - 1))
            budget = _default(tables, unit, d)
            found.append(Check(registers.offset(f"{d}_budget_left", field), ALL, min(1, budget), budget))
    return found


def _default(tables: Tables, unit: RegulatedUnit, direction: str) -> int:
    """Return the bytes per window before the first table."""
    is_bound = Row(unit.name, direction) in set(_bound(tables))
    return max(unit.default[direction], tables.platform.burst) if is_bound else 0


def _setup(tables: Tables) -> Iterator[Write]:
    """Yield the writes of the set-up: claim, burst length, regions, default budgets, and only then periods."""
    p, registers = tables.platform, _map(tables)
    regions = registers.regions
    beats = p.burst // p.bus - 1
    yield Write(START, registers.claim.offset, CLAIM)
    for word in registers.words_of("len_limit"):
        yield Write(START, word.offset, beats * 0x01010101 & word.mask)
    for unit in tables.units:
        for region in range(regions):  # region 0 is all of memory, the others are empty
            field = unit.manager * regions + region
            bounds = EVERYWHERE if region == 0 else NOWHERE
            for name, value in zip(("start_low", "start_high", "end_low", "end_high"), bounds, strict=True):
                yield Write(START, registers.offset(name, field), value)
            for d in DIRECTIONS:
                budget = OPEN if region else _default(tables, unit, d)
                yield Write(START, registers.offset(f"{d}_budget", field), budget)
    for unit in tables.units:  # a period that is written loads the budget, so budgets come first
        for region in range(regions):
            for name in ("write_period", "read_period"):
                yield Write(START, registers.offset(name, unit.manager * regions + region), p.cycles - 1)
    mask = sum(1 << unit.manager for unit in tables.units)
    yield Write(START, registers.offset("rt_enable"), mask)
    yield Write(START, registers.offset("imtu_enable"), mask)  # one write for all, so that their windows are aligned


def _bound(tables: Tables) -> list[Row]:
    """Return both directions of every unit that has a budget somewhere."""
    used = {row.unit for row in tables.rows}
    return [Row(unit.name, d) for unit in tables.units if unit.name in used for d in DIRECTIONS]


def _programmed(tables: Tables, table: Table) -> dict[int, list[int]]:
    """Return for every budget register its bytes in every window; never 0."""
    registers, burst = _map(tables), tables.platform.burst
    rows = set(_bound(tables))
    bound = ((unit, d) for unit in tables.units for d in DIRECTIONS if Row(unit.name, d) in rows)
    return {
        registers.offset(f"{d}_budget", unit.manager * registers.regions): [
            max(n, AxiRealm.device.least) * burst for n in table.row(Row(unit.name, d))
        ]
        for unit, d in bound
    }


def _changes(tables: Tables, table: Table) -> list[Write]:
    """Return the writes within the table, each one window ahead; a mode ends with those for its own repetition."""
    found = []
    for offset, values in _programmed(tables, table).items():
        found += [Write(k - 1, offset, values[k]) for k in range(1, len(values)) if values[k] != values[k - 1]]
        if table.successor == table.index and values[0] != values[-1]:
            found.append(Write(len(values) - 1, offset, values[0]))
    return sorted(found, key=lambda write: (write.at, write.offset))


def _worst(tables: Tables) -> tuple[int, str]:
    """Return the most writes in any one window, and where; a switch writes every budget."""
    found = [(len(_bound(tables)), "any switch")]
    for table in tables.tables:
        counts = Counter(write.at for write in _changes(tables, table))
        found += [(count, f"{table.frame.path} window {window}") for window, count in counts.items()]
    return max(found, key=lambda each: each[0])


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


def _check_window(platform: Platform) -> list[Diagnostic]:
    """Return a finding if windows are not whole cycles, which is all that a period register holds."""
    if not platform.extra:
        return []
    message = (
        f"a window of {platform.window} has {platform.cycles_text} at {platform.clock} Hz; a period has whole ones"
    )
    help = "use a clock that divides the window, or the back-end table, whose windows may differ by a cycle"
    return [DOES_NOT_FIT(message, at=platform.at, path="platform window", help=help)]


def _check_directions(tables: Tables) -> list[Diagnostic]:
    p, rows, found = tables.platform, set(tables.rows), []
    pending = int(p.settings[AxiRealm.name]["pending"]) * p.burst
    for unit in tables.units:
        at, path = p.units[unit.name].at, about(unit=unit.name)
        bound = [row for row in (Row(unit.name, d) for d in DIRECTIONS) if row in rows]
        if len(bound) == len(DIRECTIONS):
            message = (
                "both its reads and its writes are bound; the direction that spends its budget first stops the other, "
                "which may then get as little as two thirds of its own"
            )
            help = "give the writes of this unit a manager of their own"
            found.append(BINDS_BOTH(message, at=at, path=path, help=help))
        for row in bound:
            least = min(n for table in tables.tables for n in table.row(row) if n) * p.burst
            if least < pending:
                message = (
                    f"{row.direction} budget is {least} bytes in some window, {pending} may be pending: slow to stop"
                )
                help = "use longer windows, or fewer pending transactions"
                found.append(BINDS_BOTH(message, at=at, path=path, help=help))
    return found


def _check_short(platform: Platform) -> list[Diagnostic]:
    """Return a finding unless all bursts are stated to be modifiable, since short ones that are not are refused."""
    if platform.settings[AxiRealm.name]["bursts"] == "modifiable":
        return []
    message = f"bursts below {platform.burst} bytes that are WRAP or non-modifiable are answered with SLVERR"
    help = (
        'set AxCACHE[1] in every manager, or build with DisableSplitChecks, and state "axi-realm: {bursts: modifiable}"'
    )
    return [SHORT_BURSTS(message, at=platform.at, path="platform axi-realm", help=help)]


def _check_handler(tables: Tables) -> list[Diagnostic]:
    limit = int(tables.platform.settings[AxiRealm.name]["writes-per-window"])
    worst, where = _worst(tables)
    if worst <= limit:
        return []
    message = f"{where} needs {worst} register writes; the handler can do {limit}"
    help = f'state "axi-realm: {{writes-per-window: {worst}}}" if it can, or use longer windows'
    return [TOO_MANY_WRITES(message, at=tables.platform.at, path="platform axi-realm", help=help)]


WRITER = AxiRealm()
