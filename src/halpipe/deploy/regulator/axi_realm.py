"""AXI-REALM on a model of its register file and of its budget units.

From the maker's register description and RTL (pulp-platform/axi_rt): every access fails until the guard is claimed;
set-up registers are write-only and read as 0; a budget counts from the next end of a period on, and is loaded when a
period is written; a budget of 0 in any region isolates the manager; an address region ends above its start; a manager
that always asks gets its budget, and one burst more. Both directions of a manager share its isolation.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.deploy.regulator.codes import (
    DEVICE_OVER_CAPACITY,
    DEVICE_REFUSES,
    GRANTS_DIFFER,
    SHARED_ISOLATION,
)
from halpipe.deploy.regulator.loading import LOADER, SETUP, WORD, Case, Range, Write, check_loader, scripts_of, steps_of
from halpipe.devices.registers import RegisterFile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.regulator.reading import Table

OPEN = 2**31 - 1
DEVICE = "axi_realm"
BOUNDS = ("start_low", "start_high", "end_low", "end_high")
BUDGETS = {"write": "write_budget", "read": "read_budget"}
PERIODS = {"write": "write_period", "read": "read_period"}

Register = tuple[str, int, int]
"""Name, manager (or word), region."""


class Device:
    """The registers after reset, and the values written since, by name, manager (or word) and region."""

    def __init__(self, managers: int, regions: int) -> None:
        self.file = RegisterFile(DEVICE, managers, regions)
        self.values: dict[Register, int] = {}
        self.loaded: dict[Register, int] = {}
        self.is_claimed = False

    @property
    def is_enabled(self) -> bool:
        """Whether the periods were started."""
        return bool(self.values.get(("imtu_enable", 0, 0)))

    def register(self, offset: int) -> Register | None:
        """Return the register at an offset, None if there is none."""
        word = self.file.words.get(offset)
        if word is None:
            return None
        is_by_region = len(self.file.words_of(word.name)) == self.file.managers * self.file.regions and word.width == 32
        return (word.name, *divmod(word.number, self.file.regions)) if is_by_region else (word.name, word.number, 0)

    def write(self, offset: int, value: int) -> str:
        """Write a register; return why the device refuses it, empty if it does not."""
        guard = self.file.claim.offset
        if offset == guard:
            self.is_claimed = value & 7 == 7
            return "" if value == 7 else f"{value:#x} does not claim the registers; 0x7 does"
        if not self.is_claimed:
            return f"register {offset:#x} is written before the guard at {guard:#x} is claimed: the access fails"
        name, word = self.register(offset), self.file.words.get(offset)
        if name is None or word is None or word.access == "ro" or not 0 <= value < WORD:
            return f"there is no register {offset:#x} to be written with {value:#x}"
        if value & ~word.mask:
            return f"the {_named(name)} has no bits for {value:#x}"
        self.values[name] = value
        for direction, period in PERIODS.items():
            if name[0] == period:
                self.loaded[name] = self.values.get((BUDGETS[direction], *name[1:]), 0)
        return ""

    def refuses(self, check: Range) -> str:
        """Return why a register cannot be read; empty if it can."""
        word = self.file.words.get(check.offset)
        if not self.is_claimed:
            return f"register {check.offset:#x} is read before the guard is claimed: the access fails"
        if word is None or word.access == "wo":
            return f"register {check.offset:#x} cannot be read: it is write-only and reads as 0, or there is none"
        return ""


def device_of(case: Case) -> Device:
    """Return the device that the platform states, after reset."""
    return Device(case.platform.number("axi-realm", "managers"), case.platform.number("axi-realm", "regions"))


def execute(case: Case) -> None:
    """Execute the set-up and every table."""
    named, numbered = scripts_of(case, ".txt", SETUP, LOADER)
    check_loader(case, named, case.platform.settings["axi-realm"]["base"])
    if SETUP in named:
        _set_up(case, SETUP, steps_of(case, named[SETUP]))
    for index, script in sorted(numbered.items()):
        _play(case, script.name, case.tables.tables[index], steps_of(case, script))
    _share(case)


# ------------------------------------------------------------------------------------------------- set-up


def _set_up(case: Case, name: str, steps: Sequence[Write | Range]) -> None:
    """Execute the set-up and compare every register with what the platform and the defaults demand."""
    device = device_of(case)
    seen: set[int] = set()
    reads: dict[int, Range] = {}
    for step in steps:
        case.steps += 1
        if isinstance(step, Range):
            refused = device.refuses(step)
            if bool(device.values) != device.is_enabled:
                refused = refused or "is to be read before the set-up or after it"
            reads[step.offset] = step
        else:
            was_enabled = device.is_enabled
            refused = device.write(step.offset, step.value)
            if step.offset in seen:
                refused = refused or f"writes register {step.offset:#x} a second time"
            elif was_enabled:
                refused = refused or "comes after the periods were started"
            elif device.is_enabled and ("rt_enable", 0, 0) not in device.values:
                refused = refused or "starts the periods of units that are not enabled"
            seen.add(step.offset)
        if refused:
            case.note(DEVICE_REFUSES, name, refused, line=step.line)
    expected = _expected(case, device)
    for register in sorted(expected.keys() | device.values.keys()):
        have, want = device.values.get(register), expected.get(register)
        if have != want:
            said, due = ("not written" if value is None else f"{value:#x}" for value in (have, want))
            text = f"{_named(register)} is {said} after the set-up, it must be {due}"
            case.note(GRANTS_DIFFER, name, text)
    for register, loaded in sorted(device.loaded.items()):
        direction = register[0].partition("_")[0]
        budget = device.values.get((BUDGETS[direction], *register[1:]))
        if budget is not None and loaded != budget:
            text = f"{_named(register)} is written before its budget, and begins with {loaded} bytes"
            case.note(GRANTS_DIFFER, name, text)
    _read(case, name, device, reads)


def _read(case: Case, name: str, device: Device, reads: dict[int, Range]) -> None:
    """Note what is not read although it can be, or in another range than it must have."""
    p, word = case.platform, WORD - 1
    highest = max((n for table in case.tables.tables for n in _totals(case, table)), default=0)
    highest = max(highest, *(n for unit in case.tables.units for n in unit.default.values()))
    wanted = {
        ("num_managers", 0): (word, device.file.managers, device.file.managers),
        ("num_addr_regions", 0): (word, device.file.regions, device.file.regions),
        ("data_width", 0): (word, 8 * p.bus_bytes, 8 * p.bus_bytes),
        ("period_width", 0): (word, (p.window_cycles - 1).bit_length(), word),
        ("budget_width", 0): (word, highest.bit_length(), word),
        ("rt_bypassed", 0): (sum(1 << unit.manager for unit in case.tables.units), 0, 0),
    }
    for unit in case.tables.units:
        field = unit.manager * device.file.regions
        for direction, bank in BUDGETS.items():
            budget = device.values.get((bank, unit.manager, 0), 0)
            wanted[f"{direction}_budget_left", field] = (word, min(budget, 1), budget)
            wanted[f"{direction}_period_left", field] = (word, 0, p.window_cycles - 1)
    for (register, number), (mask, least, most) in wanted.items():
        found = reads.pop(device.file.offset(register, number), None)
        if found is None or (found.mask, found.least, found.most) != (mask, least, most):
            have = "not read" if found is None else f"compared with {found.least:#x} to {found.most:#x}"
            text = f"{register} {number} is {have}, it must be from {least:#x} to {most:#x}"
            case.note(GRANTS_DIFFER, name, text, line=found.line if found else 0)
    for check in reads.values():
        case.note(GRANTS_DIFFER, name, f"reads {check.offset:#x}, of which nothing is known", line=check.line)


def _totals(case: Case, table: Table) -> list[int]:
    """Return the bytes of all units in the windows of a table."""
    rows = [table.budgets(unit.name, direction) for unit, direction in case.tables.rows()]
    return [sum(column) for column in zip(*rows, strict=True)]


def _expected(case: Case, device: Device) -> dict[Register, int]:
    """Return the registers as they must be when the periods start."""
    p, everywhere = case.platform, 2**32 - 1
    beats = p.burst_bytes // p.bus_bytes - 1
    found = {
        ("len_limit", word.number, 0): beats * 0x01010101 & word.mask for word in device.file.words_of("len_limit")
    }
    mask = 0
    for unit in case.tables.units:
        mask |= 1 << unit.manager
        is_used = any(case.tables.is_used(unit, d) for d in BUDGETS)
        for region in range(device.file.regions):  # region 0 is all addresses, the others are beyond those of any bus
            bounds = (0, 0, everywhere, everywhere) if region == 0 else (everywhere - 1, *[everywhere] * 3)
            for bank, value in zip(BOUNDS, bounds, strict=True):
                found[bank, unit.manager, region] = value
            for direction, bank in BUDGETS.items():
                budget = max(unit.default[direction], p.burst_bytes) if is_used else 0
                found[bank, unit.manager, region] = budget if region == 0 else OPEN
                found[PERIODS[direction], unit.manager, region] = p.window_cycles - 1
    return {**found, ("rt_enable", 0, 0): mask, ("imtu_enable", 0, 0): mask}


def _share(case: Case) -> None:
    """Note units whose reads and writes are both bound: the promise of one depends on the other."""
    for unit in case.tables.units:
        if all(case.tables.is_used(unit, d) for d in BUDGETS):
            text = (
                "reads and writes share an isolation: where both are greedy, writes were measured to get 67 to 80 % of "
                "their budget"
            )
            help = "give the writes of this unit a manager of their own, and export again"
            case.note(SHARED_ISOLATION, "setup.txt", text, path=about(unit=unit.name), help=help)
            case.caveat = "only to units that do not read and write at once"
    if case.platform.settings["axi-realm"]["bursts"] != "modifiable":
        case.caveat += "; " * bool(case.caveat) + "if all short bursts are modifiable"


def _named(register: Register) -> str:
    name, manager, region = register
    is_one_of = name in BOUNDS or name.endswith(("_budget", "_period"))
    return f"the {name}" + (f" of manager {manager}, region {region}" if is_one_of else f" register {manager}")


# ------------------------------------------------------------------------------------------------- tables


def _play(case: Case, name: str, table: Table, steps: Sequence[Write | Range]) -> None:
    """Execute a table once and again, and compare the budget of every window with its entries."""
    device = device_of(case)
    device.is_claimed = True
    seen: dict[Register, list[tuple[int, int]]] = {}
    path, counts = f'table "{table.name}"', Counter[int]()
    for write in steps:
        case.steps += 1
        if isinstance(write, Range):
            case.note(DEVICE_REFUSES, name, "reads a budget, which is write-only", line=write.line, path=path)
            continue
        register = device.register(write.offset)
        before = device.values.get(register) if register else None
        refused = device.write(write.offset, write.value)
        if refused or register is None or register[0] not in BUDGETS.values():
            text = refused or f"register {write.offset:#x} is no budget"
            case.note(DEVICE_REFUSES, name, text, line=write.line, path=path)
            continue
        if write.at >= table.windows:
            case.note(DEVICE_REFUSES, name, f"window {write.at} is over by then", line=write.line, path=path)
        if before == write.value:
            case.note(GRANTS_DIFFER, name, f"{_named(register)} is that already", line=write.line, path=path)
        counts[write.at] += 1
        if write.at >= 0 and counts[write.at] > case.platform.number("axi-realm", "writes-per-window"):
            text = f"{counts[write.at]} writes in window {write.at}"
            case.note(DEVICE_REFUSES, name, text, line=write.line, path=path)
        seen.setdefault(register, []).append((write.at + 1, write.value))
    expected = _budgets(case, table)
    for register in sorted(expected.keys() | seen.keys()):
        fault = _difference(seen.get(register, []), expected.get(register, []), table)
        if fault:
            case.note(GRANTS_DIFFER, name, f"{_named(register)} {fault}", path=path)
    _sums(case, name, table, seen)


def _budgets(case: Case, table: Table) -> dict[Register, list[tuple[int, int]]]:
    """Return what each budget must be from which window on: never less than a burst, which could not be denied."""
    found = {}
    for unit in case.tables.units:
        if any(case.tables.is_used(unit, d) for d in BUDGETS):
            for direction, bank in BUDGETS.items():
                steps: list[tuple[int, int]] = []
                for item in table.entries[unit.name]:
                    budget = max(item.budget(direction), case.platform.burst_bytes)
                    if not steps or steps[-1][1] != budget:
                        steps.append((item.window, budget))
                found[bank, unit.manager, 0] = steps
    return found


def _difference(seen: list[tuple[int, int]], expected: list[tuple[int, int]], table: Table) -> str:
    """Return how the budgets of a register differ; a mode ends with the budget that it begins with."""
    again = [(table.windows, expected[0][1])] if expected and table.successor == table.index else []
    wanted = expected + [step for step in again if step[1] != expected[-1][1]]
    for have, want in zip(seen, wanted, strict=False):
        if have != want:
            return f"is {have[1]} bytes from window {have[0]} on, promised are {want[1]} from window {want[0]} on"
    if len(seen) > len(wanted):
        return f"is {seen[len(wanted)][1]} bytes from window {seen[len(wanted)][0]} on, which is not promised"
    if len(seen) < len(wanted):
        return f"is not {wanted[len(seen)][1]} bytes from window {wanted[len(seen)][0]} on, as promised"
    return ""


def _sums(case: Case, name: str, table: Table, seen: dict[Register, list[tuple[int, int]]]) -> None:
    """Hold what all may use in a window, each its budget and one burst, against the capacity."""
    changes: dict[int, int] = {}
    for steps in seen.values():
        before = 0
        for window, value in steps:
            changes[window] = changes.get(window, 0) + value - before
            before = value
    total = len(seen) * case.platform.burst_bytes
    for window in sorted(changes):
        total += changes[window]
        if window < table.windows and total > case.platform.capacity_bytes:
            text = f"{total} B may pass in window {window}, the capacity is {case.platform.capacity_bytes} B"
            case.note(DEVICE_OVER_CAPACITY, name, text, path=about(table=table.name))
            return
