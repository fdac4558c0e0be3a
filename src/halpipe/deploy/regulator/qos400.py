"""QoS-400 regulators of the Zynq UltraScale+ on a model of their registers.

From Xilinx UG1087 (addresses) and Arm DSU 0026 (meaning): a token bucket for each port and direction, filled with
``r / 4096`` transfers per cycle and holding ``b``; 0 in either switches it off, and so does a cleared enable bit.
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.quantities import parse_frequency
from halpipe.deploy.regulator import rates
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, GRANTS_DIFFER
from halpipe.deploy.regulator.loading import LOADER, SETUP, WORD, Case, Range, Write, check_loader, scripts_of, steps_of
from halpipe.deploy.regulator.promise import Row, rate_steps
from halpipe.deploy.regulator.reading import DIRECTIONS
from halpipe.devices.registers import port_registers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.regulator.arithmetic import Planned

STEPS = 4096
PORTS, REGISTERS = port_registers("qos400")
AT = {register.offset: register for register in REGISTERS.values()}

Block = tuple[int, list[tuple[str, int]]]
"""The instant of a setting in nanoseconds, and the rates that it writes: owner (unit and direction), value."""
Setting = tuple[int, dict[str, Fraction]]
"""From which nanosecond on, and the rate of every owner."""


def execute(case: Case) -> None:
    """Execute the set-up and the scripts of all tables."""
    case.caveat = "if rates mean what the manual says, held against nothing real"
    owners = _owners(case)
    named, numbered = scripts_of(case, ".txt", SETUP, LOADER)
    check_loader(case, named, "0x0")
    if SETUP in named:
        _init(case, owners, steps_of(case, named[SETUP]))
    names = {index: script.name for index, script in numbered.items()}
    _check(
        case, names, {i: _blocks(case, owners, script.name, steps_of(case, script)) for i, script in numbered.items()}
    )


def _owners(case: Case) -> dict[str, str]:
    """Return the unit behind every port."""
    found: dict[str, str] = {}
    for unit in case.tables.units:
        port = case.platform.units[unit.name].get("port", "")
        if port not in PORTS:
            case.note(DEVICE_REFUSES, SETUP, f'the chip has no port "{port}"', path=about(unit=unit.name))
        elif port in found:
            text = f'port {port} is that of unit "{found[port]}", too'
            case.note(DEVICE_REFUSES, SETUP, text, path=about(unit=unit.name))
        found[port] = unit.name
    return found


# ------------------------------------------------------------------------------------------------- scripts


def _decode(case: Case, owners: dict[str, str], name: str, write: Write) -> tuple[str, str, int] | None:
    """Return the unit, the register and the value of a write; None where no port of a unit has the register."""
    for port, unit in owners.items():
        register = AT.get(write.offset - PORTS.get(port, 0))
        if register is not None:
            if write.value & ~register.mask:
                text = f"{write.value:#x} sets bits that register {write.offset:#x} does not have"
                case.note(DEVICE_REFUSES, name, text, line=write.line)
            return unit, register.name, write.value >> register.shift
    case.note(DEVICE_REFUSES, name, f"there is no such register of a unit: {write.offset:#x}", line=write.line)
    return None


def _read_back(case: Case, name: str, steps: Sequence[Write | Range]) -> list[Write]:
    """Return the writes; note those before the table that are not read back as written, or in part."""
    due: dict[int, int] = {}
    writes = []
    for step in steps:
        case.steps += 1
        if isinstance(step, Range):
            value = due.pop(step.offset, None)
            if (step.mask, step.least, step.most) != (WORD - 1, value, value):
                text = f"register {step.offset:#x} is read as {step.least:#x}, which is not what it was written with"
                case.note(GRANTS_DIFFER, name, text, line=step.line)
            continue
        writes.append(step)
        if step.at < 0:
            due[step.offset] = step.value
    for offset in due:
        case.note(GRANTS_DIFFER, name, f"register {offset:#x} is not read back")
    return writes


def _init(case: Case, owners: dict[str, str], steps: Sequence[Write | Range]) -> None:
    """Execute the set-up: every bucket has its size and the lowest rate before it is switched on."""
    values: dict[tuple[str, str], int] = {}
    enabled: set[str] = set()
    for write in _read_back(case, SETUP, steps):
        unit, register, value = _decode(case, owners, SETUP, write) or ("", "", 0)
        if (unit, register) in values or unit in enabled or write.at >= 0:
            text = f"writes {write.offset:#x} again, or after it was switched on"
            case.note(GRANTS_DIFFER, SETUP, text, line=write.line)
        if register == "control":
            if any((unit, f"{d}_{what}") not in values for d in DIRECTIONS for what in ("burstiness", "rate")):
                text = f"{write.offset:#x} switches on what has no rate yet"
                case.note(DEVICE_REFUSES, SETUP, text, line=write.line)
            enabled.add(unit)
        values[unit, register] = value
    wanted = {"control": 3}
    for d in DIRECTIONS:
        wanted |= {f"{d}_rate": 1, f"{d}_burstiness": case.platform.number("qos400", "burstiness")}
    for unit, register in ((unit.name, register) for unit in case.tables.units for register in wanted):
        if values.get((unit, register)) != wanted[register]:
            text = f"the set-up does not leave {register} of {unit} with {wanted[register]}"
            case.note(GRANTS_DIFFER, SETUP, text)


def _blocks(case: Case, owners: dict[str, str], name: str, steps: Sequence[Write | Range]) -> list[Block]:
    """Return the settings of a table; the sizes of buckets are those of the set-up."""
    found: list[Block] = [(0, [])]
    for write in _read_back(case, name, steps):
        unit, register, value = _decode(case, owners, name, write) or ("", "", 0)
        if not register.endswith("_rate") or not 0 < value < STEPS:
            text = "a rate of 0 switches the regulator off" if register.endswith("_rate") else "is no rate"
            case.note(DEVICE_REFUSES, name, text, line=write.line)
            continue
        instant = max(0, write.at)
        if instant != found[-1][0]:
            found.append((instant, []))
        found[-1][1].append((f"{unit} {register.removesuffix('_rate')}", value))
    return found


# ------------------------------------------------------------------------------------------------- verdict


def _check(case: Case, names: dict[int, str], played: dict[int, list[Block]]) -> None:
    """Execute every table after each that may come before it, and compare every setting with the promise."""
    step = Fraction(case.platform.burst_bytes * parse_frequency(case.platform.settings["qos400"]["clock"]), STEPS)
    final = {index: dict(order for _, orders in blocks for order in orders) for index, blocks in played.items()}
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
            rates.fall_first(case, name, table, orders, before)
            for start in before:
                when = f" while rates change at {instant} ns"
                rates.rise(case, name, table, start, [(when, {o: n}) for o, n in orders], lambda n: n * step)
            for owner, value in orders:
                if state.get(owner) == value:
                    case.note(GRANTS_DIFFER, name, f"{owner} has that rate already", path=about(table=table.name))
                state[owner] = value
            rates.compare(
                case, name, table, state, promised, lambda rate: max(1, ceil(rate / step)), lambda n: n * step
            )


def _promised(case: Case, plan: Planned, step: Fraction) -> list[Setting]:
    """Return what must be set and when: the highest rates of a table, or (phases) every change of the steps set."""
    owners = [f"{unit.name} {d}" for unit in case.tables.units for d in DIRECTIONS]
    if case.platform.settings["qos400"]["granularity"] != "phase":
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
        promised |= {f"{u} {d}": rate * case.platform.guaranteed for (u, d), rate in now.items()}
        steps_set = {owner: max(1, ceil(rate / step)) for owner, rate in promised.items()}
        if steps_set != known:
            known = steps_set
            found.append((int(instant), promised))
    return found
