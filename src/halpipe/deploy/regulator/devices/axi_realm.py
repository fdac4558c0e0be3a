"""AXI-REALM on a model of its register file and of its budget units.

From the project's documentation and RTL (pulp-platform/axi_rt): offsets move with the managers and regions that the
file is built for; every access fails until the guard is claimed; a budget counts from the next end of a period on, and
is loaded when a period is written; a budget of 0 in any region isolates the manager; a manager that always asks gets
its budget, and one burst more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.deploy.regulator.codes import DEVICE_OVER_CAPACITY, DEVICE_REFUSES, GRANTS_DIFFER, NOT_UNDERSTOOD
from halpipe.deploy.regulator.devices.loading import (
    WORD,
    check_loader,
    header_number,
    header_of,
    hexadecimal,
    put_function,
    scripts_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.regulator.devices import Case
    from halpipe.deploy.regulator.devices.loading import Header, Script
    from halpipe.deploy.regulator.reading import Table

HEADER, LOADER = "axi_realm.h", "load.sh"
TYPES = {
    "struct realm_write": "uint32_t window, offset, value;",
    "struct realm_table": "uint32_t windows, successor, entries, changes; const struct realm_write *entry, *change;",
}
ARRAYS = {
    "realm_setup": "struct realm_write",
    "realm_entry": "struct realm_write",
    "realm_change": "struct realm_write",
    "realm_tables": "struct realm_table",
    "realm_switches": "struct { uint32_t from, to, request; }",
}
OPEN = 2**31 - 1
BANKS = ("start low", "start high", "end low", "end high", "write budget", "read budget", "write period", "read period")
BUDGETS = {"write": "write budget", "read": "read budget"}
PERIODS = {"write": "write period", "read": "read period"}

Register = tuple[str, int, int]
"""Name, manager (or word), region."""


@record
class Write:
    """A register write and where it stands; `window` is the one in which it is done, -1 before the first."""

    window: int
    offset: int
    value: int
    line: int = 0


@dataclass(slots=True)
class RegisterFile:
    """The registers after reset, and what has been written since."""

    managers: int
    regions: int
    names: dict[int, Register] = field(default_factory=dict)
    values: dict[Register, int] = field(default_factory=dict)
    loaded: dict[Register, int] = field(default_factory=dict)
    is_claimed: bool = False
    is_enabled: bool = False

    def __post_init__(self) -> None:
        offset = 0x14
        self.names[0x0C] = ("rt enable", 0, 0)
        for word in range(-(-self.managers // 4)):
            self.names[offset] = ("length limit", word, 0)
            offset += 4
        self.names[offset] = ("imtu enable", 0, 0)
        offset += 8  # behind it the register that aborts periods, which nothing has to write
        for bank in BANKS:
            for manager in range(self.managers):
                for region in range(self.regions):
                    self.names[offset] = (bank, manager, region)
                    offset += 4
        size = offset + 4 * (4 * self.managers * self.regions + 13)  # counters, isolation, parameters: to be read only
        width = 1
        while 1 << width < size:
            width += 1
        self.guard = (1 << width + 1) - 4

    guard: int = 0

    def width(self, name: Register) -> int:
        """Return the bits that a register has: one for each manager where they share a word, else all."""
        return (1 << self.managers) - 1 if name[0].endswith("enable") else WORD - 1

    def write(self, offset: int, value: int) -> str:
        """Write a register; return why the device refuses it, empty if it does not."""
        if offset == self.guard:
            self.is_claimed = value & 7 == 7
            return "" if value == 7 else f"{value:#x} does not claim the registers; 0x7 does"
        if not self.is_claimed:
            return f"register {offset:#x} is written before the guard at {self.guard:#x} is claimed: the access fails"
        name = self.names.get(offset)
        if name is None or not 0 <= value < WORD:
            return f"there is no register {offset:#x} to be written with {value:#x}"
        self.values[name] = value & self.width(name)
        if self.values[name] != value:
            return f"the {name[0]} {value:#x} reads back as {self.values[name]:#x}"
        for direction, period in PERIODS.items():
            if name[0] == period:
                self.loaded[name] = self.values.get((BUDGETS[direction], *name[1:]), 0)
        return ""


def register_file(case: Case) -> RegisterFile:
    """Return the register file that the platform states, after reset."""
    return RegisterFile(case.facts.number("axi-realm", "managers"), case.facts.number("axi-realm", "regions"))


def execute(case: Case) -> None:
    """Execute the set-up and every table, of the scripts and of the header."""
    named, numbered = scripts_of(case, ".txt", "setup.txt", LOADER)
    if LOADER in named:
        base = case.facts.settings["axi-realm"]["base"]
        check_loader(case, named[LOADER], base, f"{register_file(case).guard:#05x}")
    if "setup.txt" in named:
        _set_up(case, "setup.txt", _setup_writes(case, named["setup.txt"]))
    for index, script in sorted(numbered.items()):
        entry, changes = _table_writes(case, script)
        _play(case, script.name, case.tables.tables[index], entry, changes)
    header = header_of(case, HEADER, TYPES, ARRAYS, "REALM_SCHEDULE_SHA256", put_function("realm", "REALM_GUARD"))
    if header is not None:
        _header(case, header)


# ------------------------------------------------------------------------------------------------- reading


def _setup_writes(case: Case, script: Script) -> list[Write]:
    found = []
    for line in script.lines:
        words = [hexadecimal(word) for word in line.text.split()]
        if len(words) != 2 or words[0] is None or words[1] is None:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", not "offset value"', line=line.number)
        else:
            found.append(Write(-1, words[0], words[1], line.number))
    return found


def _table_writes(case: Case, script: Script) -> tuple[list[Write], list[Write]]:
    entry: list[Write] = []
    changes: list[Write] = []
    for line in script.lines:
        first, *rest = line.text.split()
        words = [hexadecimal(word) for word in rest]
        window = -1 if first == "-" else int(first) if first.isdecimal() and len(first) < 10 else None
        if window is None or len(words) != 2 or words[0] is None or words[1] is None:
            case.note(
                NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", not "window offset value"', line=line.number
            )
        elif window < 0 and changes:
            case.note(DEVICE_REFUSES, script.name, "is to be written before the first window", line=line.number)
        else:
            (entry if window < 0 else changes).append(Write(window, words[0], words[1], line.number))
    return entry, changes


def _header(case: Case, header: Header) -> None:
    tables = case.tables.tables
    stated = {
        "REALM_BASE": int(case.facts.settings["axi-realm"]["base"], 16),
        "REALM_GUARD": register_file(case).guard,
        "REALM_WINDOW_CYCLES": case.facts.cycles,
        "REALM_TABLES": len(tables),
    }
    numbers = {name: header_number(text) for name, text in header.defines.items() if name != "REALM_SCHEDULE_SHA256"}
    for name, value in stated.items():
        if numbers.pop(name, None) != value:
            case.note(GRANTS_DIFFER, HEADER, f"{name} is {header.defines.get(name, 'missing')}, it must be {value}")
    if list(numbers.values()) != list(range(len(tables))):
        case.note(GRANTS_DIFFER, HEADER, f"does not name the tables 0 to {len(tables) - 1}, each once")
    _set_up(case, HEADER, _rows(case, header, "realm_setup", is_first=True))
    for table in tables:
        entry = _rows(case, header, f"realm_entry_{table.index}", is_first=True)
        changes = _rows(case, header, f"realm_change_{table.index}")
        _play(case, HEADER, table, entry, changes)
        names = [f"realm_{kind}_{table.index}" if w else "0" for kind, w in (("entry", entry), ("change", changes))]
        row = [*map(str, (table.windows, table.successor, len(entry), len(changes))), *names]
        have = header.arrays.get("realm_tables", [])[table.index : table.index + 1]
        if have != [row]:
            case.note(GRANTS_DIFFER, HEADER, f"row {table.index} of realm_tables is {have}, it must be {row}")
    modes = {table.mode: table.index for table in tables if not table.is_transition}
    switches = [(modes.get(s.source, -1), modes.get(s.target, -1), s.request) for s in case.tables.switches]
    if header.numbers("realm_switches") != switches:
        case.note(GRANTS_DIFFER, HEADER, "realm_switches are not those of the schedule")


def _rows(case: Case, header: Header, array: str, *, is_first: bool = False) -> list[Write]:
    """Return the writes of an array; those before the first window all state window 0."""
    rows = header.numbers(array)
    if any(len(row) != 3 or (is_first and row[0]) for row in rows) or len(rows) != len(header.arrays.get(array, [])):
        case.note(NOT_UNDERSTOOD, HEADER, f"{array} is not rows of window, offset and value")
        return []
    return [Write(-1 if is_first else window, offset, value) for window, offset, value in rows]


# ------------------------------------------------------------------------------------------------- set-up


def _set_up(case: Case, name: str, writes: Sequence[Write]) -> None:
    """Execute the set-up and compare every register with what the platform and the defaults demand."""
    file = register_file(case)
    seen: set[int] = set()
    for write in writes:
        case.steps += 1
        refused = file.write(write.offset, write.value)
        if refused:
            case.note(DEVICE_REFUSES, name, refused, line=write.line)
        elif write.offset in seen:
            case.note(DEVICE_REFUSES, name, f"writes register {write.offset:#x} a second time", line=write.line)
        elif file.is_enabled:
            case.note(DEVICE_REFUSES, name, "comes after the periods were started", line=write.line)
        seen.add(write.offset)
        if file.values.get(("imtu enable", 0, 0)):
            file.is_enabled = True
            if ("rt enable", 0, 0) not in file.values:
                case.note(DEVICE_REFUSES, name, "starts the periods of units that are not enabled", line=write.line)
    expected = _expected(case, file)
    for register in sorted(expected.keys() | file.values.keys()):
        have, want = file.values.get(register), expected.get(register)
        if have != want:
            text = f"{_named(register)} is {_shown(have)} after the set-up, it must be {_shown(want)}"
            case.note(GRANTS_DIFFER, name, text)
    for register, loaded in sorted(file.loaded.items()):
        direction = register[0].partition(" ")[0]
        budget = file.values.get((BUDGETS[direction], *register[1:]))
        if budget is not None and loaded != budget:
            text = f"{_named(register)} is written before its budget, and begins with {loaded} bytes"
            case.note(GRANTS_DIFFER, name, text)


def _expected(case: Case, file: RegisterFile) -> dict[Register, int]:
    """Return the registers as they must be when the periods start."""
    facts, everywhere = case.facts, 2**32 - 1
    beats = facts.burst // facts.bus - 1
    found = {("length limit", word, 0): beats * 0x01010101 for word in range(-(-file.managers // 4))}
    mask = 0
    for unit in case.tables.units:
        mask |= 1 << unit.manager
        is_used = any(case.tables.is_used(unit, d) for d in BUDGETS)
        for region in range(file.regions):  # region 0 is all addresses, the others are none
            for bank, value in zip(BANKS, (0, 0, everywhere, everywhere), strict=False):
                found[bank, unit.manager, region] = value if region == 0 else everywhere
            for direction, bank in BUDGETS.items():
                budget = max(unit.default[direction], facts.burst) if is_used else 0
                found[bank, unit.manager, region] = budget if region == 0 else OPEN
                found[PERIODS[direction], unit.manager, region] = facts.cycles - 1
    return {**found, ("rt enable", 0, 0): mask, ("imtu enable", 0, 0): mask}


def _named(register: Register) -> str:
    name, manager, region = register
    return f"the {name}" + (f" of manager {manager}, region {region}" if name in BANKS else f" register {manager}")


def _shown(value: int | None) -> str:
    return "not written" if value is None else f"{value:#x}"


# ------------------------------------------------------------------------------------------------- tables


def _play(case: Case, name: str, table: Table, entry: Sequence[Write], changes: Sequence[Write]) -> None:
    """Execute a table once and again, and compare the budget of every window with its entries."""
    file = register_file(case)
    file.is_claimed = True
    seen: dict[Register, list[tuple[int, int]]] = {}
    path, last, count = f'table "{table.name}"', -1, 0
    for write in (*entry, *changes):
        case.steps += 1
        register = file.names.get(write.offset)
        before = file.values.get(register) if register else None
        refused = file.write(write.offset, write.value)
        if refused or register is None or register[0] not in BUDGETS.values():
            text = refused or f"register {write.offset:#x} is no budget"
            case.note(DEVICE_REFUSES, name, text, line=write.line, path=path)
            continue
        if write.window < last or write.window >= table.windows:
            case.note(DEVICE_REFUSES, name, f"window {write.window} is over by then", line=write.line, path=path)
        if before == write.value:
            case.note(GRANTS_DIFFER, name, f"{_named(register)} is that already", line=write.line, path=path)
        count = count + 1 if write.window == last else 1
        last = max(last, write.window)
        if write.window >= 0 and count > case.facts.number("axi-realm", "writes-per-window"):
            case.note(DEVICE_REFUSES, name, f"{count} writes in window {last}", line=write.line, path=path)
        seen.setdefault(register, []).append((write.window + 1, write.value))
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
                    budget = max(item.budget(direction), case.facts.burst)
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
    total = len(seen) * case.facts.burst
    for window in sorted(changes):
        total += changes[window]
        if window < table.windows and total > case.tables.capacity_bytes:
            text = f"{total} B may pass in window {window}, the capacity is {case.tables.capacity_bytes} B"
            case.note(DEVICE_OVER_CAPACITY, name, text, path=about(table=table.name))
            return
