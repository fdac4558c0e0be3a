"""QoS-400 regulators of the Zynq UltraScale+ on a model of their registers.

From Xilinx UG1087 (addresses) and Arm DSU 0026 (meaning): a token bucket for each port and direction, filled with
``r / 4096`` transfers per cycle and holding ``b``; 0 in either switches it off, and so does a cleared enable bit.
"""

from __future__ import annotations

import re
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.deploy.regulator import rates
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, GRANTS_DIFFER, NOT_UNDERSTOOD
from halpipe.deploy.regulator.loading import choices, header_number, header_of, scripts_of
from halpipe.deploy.regulator.promise import rate_steps
from halpipe.deploy.regulator.reading import setting_frequency
from halpipe.devices.registers import port_registers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.loading import Case, Header, Line, Script
    from halpipe.deploy.regulator.promise import Row
    from halpipe.deploy.regulator.reading import Table

HEADER = "qos400.h"
TYPES = {
    "struct qos400_init": "uint64_t address; uint32_t value;",
    "struct qos400_write": "uint64_t at_ns, address; uint32_t value;",
    "struct qos400_table": "uint32_t writes; const struct qos400_write *write;",
}
ARRAYS = {
    "qos400_init": "struct qos400_init",
    "qos400_write": "struct qos400_write",
    "qos400_tables": "struct qos400_table",
}
PUT = (
    "static inline uint32_t qos400_put(uint64_t address, uint32_t value) { "
    "volatile uint32_t *at = (volatile uint32_t *)(uintptr_t)address; "
    "*at = value; return (*at == value) ? 0u : 1u; }"
)
"""Writes a register and reads it back."""

STEPS = 4096
DESCRIPTION = port_registers("qos400")
PORTS = DESCRIPTION.ports
AT = {register.offset: register for register in DESCRIPTION.registers.values()}
CONTROL = DESCRIPTION.registers["control"].offset
ENABLES = {"write": 1, "read": 2}
COMMAND = re.compile(r"jailhouse qos (\w+):((?:,?a[rw]_b=\d{1,9},a[rw]_r=\d{1,9}){1,2})")
DIRECTIONS = {"ar": "read", "aw": "write"}

Order = tuple[str, str, int]
"""Owner (unit and direction), what of it (``b`` or ``r``), value."""
Setting = tuple[int, dict[str, Fraction]]
"""From which nanosecond on, and the rate of every owner."""


def execute(case: Case) -> None:
    """Execute the scripts of all tables, and the header's set-up and tables."""
    case.caveat = "on a model that was held against nothing real"
    owners = _owners(case)
    _, numbered = scripts_of(case, ".sh")
    played = {i: list(_script(case, owners, s)) for i, s in numbered.items()}
    _check(case, {i: s.name for i, s in numbered.items()}, played)
    header = header_of(case, HEADER, TYPES, ARRAYS, "QOS400_SCHEDULE_SHA256", PUT)
    if header is not None:
        _init(case, owners, header)
        tables = case.tables.tables
        _check(case, {t.index: HEADER for t in tables}, {t.index: list(_rows(case, owners, header, t)) for t in tables})
        _index(case, header)


def _owners(case: Case) -> dict[str, str]:
    """Return the unit behind every port."""
    found: dict[str, str] = {}
    for unit in case.tables.units:
        port = case.facts.units[unit.name].get("port", "")
        if port not in PORTS:
            case.note(DEVICE_REFUSES, HEADER, f'the chip has no port "{port}"', path=about(unit=unit.name))
        elif port in found:
            text = f'port {port} is that of unit "{found[port]}", too'
            case.note(DEVICE_REFUSES, HEADER, text, path=about(unit=unit.name))
        found[port] = unit.name
    return found


# ------------------------------------------------------------------------------------------------- scripts

Block = tuple[int, list[Order]]
"""The instant of a setting in nanoseconds, and its orders."""


def _script(case: Case, owners: dict[str, str], script: Script) -> Iterator[Block]:
    """Yield the settings of a script; one without choices has one, at 0."""
    lines = list(script.lines)
    if not lines or lines[0].text != "set -e":
        case.note(NOT_UNDERSTOOD, script.name, 'does not begin with "set -e"')
    for instant, block in choices(case, script, lines[1:]):
        yield instant, [order for line in block for order in _command(case, owners, script, line)]


def _command(case: Case, owners: dict[str, str], script: Script, line: Line) -> Iterator[Order]:
    match = COMMAND.fullmatch(line.text.strip())
    if match is None:
        case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", no command for a port', line=line.number)
        return
    port = match[1]
    if port not in owners:
        case.note(DEVICE_REFUSES, script.name, f"port {port} belongs to no unit", line=line.number)
        return
    for parameter in match[2].split(","):
        name, _, value = parameter.partition("=")
        yield f"{owners[port]} {DIRECTIONS[name[:2]]}", name[3:], int(value)


# ------------------------------------------------------------------------------------------------- header


def _address(owners: dict[str, str], address: int) -> tuple[str, int] | None:
    """Return the unit and the offset of a register."""
    for port, unit in owners.items():
        base = PORTS.get(port, 0)
        if 0 <= address - base < 0x100:
            return unit, address - base
    return None


def _decode(case: Case, owners: dict[str, str], address: int, value: int) -> Order | None:
    found = _address(owners, address)
    register = AT.get(found[1]) if found else None
    if found is None or register is None or register.offset == CONTROL:
        case.note(DEVICE_REFUSES, HEADER, f"there is no such register of a unit: {address:#x}")
        return None
    held = register.decode(value)
    if held is None:
        case.note(DEVICE_REFUSES, HEADER, f"{value:#x} sets bits that register {address:#x} does not have")
    direction, _, what = register.name.partition("_")
    return f"{found[0]} {direction}", what[0], value >> register.shift if held is None else held


def _init(case: Case, owners: dict[str, str], header: Header) -> None:
    """Execute the set-up: every bucket has its size and the lowest rate before it is switched on."""
    values: dict[tuple[str, str], int] = {}
    enabled: set[str] = set()
    for address, value in (row for row in header.numbers("qos400_init") if len(row) == 2):
        case.steps += 1
        found = _address(owners, address)
        if found and found[1] == CONTROL:
            on = {f"{found[0]} {d}" for d, bit in ENABLES.items() if value & bit}
            if value != 3 or found[0] in {owner.rpartition(" ")[0] for owner in enabled}:
                case.note(GRANTS_DIFFER, HEADER, f"{value:#x} in {address:#x} is not both rates on, once")
            if any((owner, what) not in values for owner in on for what in ("b", "r")):
                case.note(DEVICE_REFUSES, HEADER, f"{address:#x} switches on what has no rate yet")
            enabled |= on
            continue
        order = _decode(case, owners, address, value)
        if order and (order[:2] in values or order[0] in enabled):
            case.note(GRANTS_DIFFER, HEADER, f"writes {address:#x} again, or after it was switched on")
        if order:
            values[order[:2]] = order[2]
    for unit in case.tables.units:
        for owner in (f"{unit.name} {d}" for d in ENABLES):
            wanted = (1, case.facts.number("qos400", "burstiness"))
            if owner not in enabled or (values.get((owner, "r")), values.get((owner, "b"))) != wanted:
                case.note(GRANTS_DIFFER, HEADER, f"the set-up does not leave {owner} with rate and bucket {wanted}")


def _rows(case: Case, owners: dict[str, str], header: Header, table: Table) -> Iterator[Block]:
    """Yield the settings of a table of the header; the bucket sizes are those of the set-up."""
    orders: list[Order] = []
    instant = last = 0
    for at, address, value in (row for row in header.numbers(f"qos400_write_{table.index}") if len(row) == 3):
        order = _decode(case, owners, address, value)
        if at < last:
            case.note(DEVICE_REFUSES, HEADER, f"{at} ns are over by then", path=about(table=table.name))
        if at != instant:
            yield instant, orders
            instant, orders = at, []
        last = at
        orders += [order] if order else []
    yield instant, orders


def _index(case: Case, header: Header) -> None:
    tables = case.tables.tables
    for table in tables:
        count = len(header.arrays.get(f"qos400_write_{table.index}", []))
        row = [str(count), f"qos400_write_{table.index}" if count else "0"]
        if header.arrays.get("qos400_tables", [])[table.index : table.index + 1] != [row]:
            case.note(GRANTS_DIFFER, HEADER, f"row {table.index} of qos400_tables is not {row}")
    named = [header_number(v) for k, v in header.defines.items() if k.startswith("QOS400_TABLE_")]
    if named != list(range(len(tables))):
        case.note(GRANTS_DIFFER, HEADER, f"does not name the tables 0 to {len(tables) - 1}, each once")


# ------------------------------------------------------------------------------------------------- verdict


def _check(case: Case, names: dict[int, str], played: dict[int, list[Block]]) -> None:
    """Execute every table after each that may come before it, and compare every setting with the promise."""
    step = Fraction(case.facts.burst * setting_frequency(case.facts, "qos400"), STEPS)
    final: dict[int, dict[str, int]] = {}
    for index, blocks in played.items():
        final[index] = {owner: value for _, orders in blocks for owner, what, value in orders if what == "r"}
    for plan in case.planned:
        table = plan.table
        if table.index not in played:
            continue
        expected, blocks, name = _promised(case, plan, step), played[table.index], names[table.index]
        instants = [instant for instant, _ in blocks]
        if instants != [instant for instant, _ in expected]:
            text = f"rates are set at {instants[:5]} ns, promised are changes at {[i for i, _ in expected][:5]}"
            case.note(GRANTS_DIFFER, name, text, path=about(table=table.name))
            continue
        state: dict[str, int] = {}
        for (instant, orders), (_, promised) in zip(blocks, expected, strict=True):
            before = [final.get(t.index, {}) for t in case.tables.before(table)] if instant == 0 else [dict(state)]
            rates.fall_first(
                case, name, table, [(owner, value) for owner, what, value in orders if what == "r"], before
            )
            for start in before:
                _rise(case, name, table, start, orders, step, instant)
            for owner, what, value in orders:
                case.steps += 1
                if what == "r":
                    if state.get(owner) == value:
                        case.note(GRANTS_DIFFER, name, f"{owner} has that rate already", path=about(table=table.name))
                    state[owner] = value
                _bounds(case, name, table, what, value)
            rates.compare(
                case, name, table, state, promised, lambda rate: max(1, ceil(rate / step)), lambda n: n * step
            )


def _bounds(case: Case, name: str, table: Table, what: str, value: int) -> None:
    """Note values that switch a regulator off or that its fields do not hold, and other bucket sizes than stated."""
    burstiness = case.facts.number("qos400", "burstiness")
    if what == "b" and value != burstiness:
        text = f"a bucket holds {value} transfers, the platform states {burstiness}"
        case.note(GRANTS_DIFFER, name, text, path=about(table=table.name))
    elif what == "r" and not 0 < value < STEPS:
        text = "a rate of 0 switches the regulator off" if not value else f"a rate has 12 bits, {value} does not fit"
        case.note(DEVICE_REFUSES, name, text, path=about(table=table.name))


def _rise(
    case: Case, name: str, table: Table, start: dict[str, int], orders: list[Order], step: Fraction, instant: int
) -> None:
    """Note the first write after which all rates together are above the capacity."""
    state = dict(start)
    for owner, what, value in orders:
        if what == "r":
            state[owner] = value
            granted = {who: count * step for who, count in state.items()}
            if rates.hold(case, name, table, granted, f" while rates change at {instant} ns"):
                return


def _promised(case: Case, plan: Planned, step: Fraction) -> list[Setting]:
    """Return what must be set and when: the highest rates of a table, or (phases) every change of the steps set."""
    owners = [f"{unit.name} {d}" for unit in case.tables.units for d in ("read", "write")]
    if case.facts.settings["qos400"]["granularity"] != "phase":
        highest = {f"{u} {d}": rate for (u, d), rate in rates.peaks(case, plan).items()}
        return [(0, {owner: highest.get(owner, Fraction(0)) for owner in owners})]
    steps = {row: rate_steps(plan.timeline, phases) for row, phases in plan.timeline.by_row().items()}
    instants = sorted({Fraction(0), *(instant for several in steps.values() for instant, _ in several)})
    found: list[Setting] = []
    now: dict[Row, Fraction] = {}
    known: dict[str, int] = {}
    for instant in instants:
        now |= {row: rate for row, several in steps.items() for at, rate in several if at == instant}
        promised = dict.fromkeys(owners, Fraction(0))
        promised |= {f"{u} {d}": rate * case.facts.guaranteed for (u, d), rate in now.items()}
        steps_set = {owner: max(1, ceil(rate / step)) for owner, rate in promised.items()}
        if steps_set != known:
            known = steps_set
            found.append((int(instant), promised))
    return found
