"""Arm MPAM on a model of the bandwidth controls of a memory-system component.

From Arm's specification of such components (IHI 0099): PART_SEL chooses the partition whose settings the other
registers show; MBW_MAX and MBW_MIN are fractions of the capacity, of whose 16 bits the upper `width` count, and stand
for the upper end of their step; without HARDLIM a partition may pass its maximum when nobody else asks. Partition 0 is
everybody's.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.deploy.regulator.codes import DEVICE_REFUSES, GRANTS_DIFFER, NOT_UNDERSTOOD
from halpipe.deploy.regulator.devices import rates
from halpipe.deploy.regulator.devices.loading import (
    check_loader,
    header_number,
    header_of,
    hexadecimal,
    put_function,
    scripts_of,
)
from halpipe.deploy.regulator.promise import ZERO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.deploy.regulator.arithmetic import Planned
    from halpipe.deploy.regulator.devices import Case
    from halpipe.deploy.regulator.devices.loading import Script
    from halpipe.deploy.regulator.reading import Table

HEADER, LOADER = "mpam.h", "load.sh"
TYPES = {
    "struct mpam_write": "uint32_t offset, value;",
    "struct mpam_table": "uint32_t writes; const struct mpam_write *write;",
}
ARRAYS = {
    "mpam_setup": "struct mpam_write",
    "mpam_write": "struct mpam_write",
    "mpam_tables": "struct mpam_table",
}
PART_SEL, MBW_MIN, MBW_MAX = 0x100, 0x200, 0x208
HARDLIM = 2**31
REST = "everything else"

Write = tuple[int, int]


class Component:
    """The registers of a component: least and largest parts of every partition."""

    def __init__(self, case: Case) -> None:
        self.width, self.count = case.facts.number("mpam", "width"), case.facts.number("mpam", "partids")
        self.part = Fraction(case.facts.capacity, 2**self.width)
        self.selected: int | None = None
        self.most: dict[int, int] = {}
        self.least: dict[int, int] = {}

    def write(self, offset: int, value: int) -> str:
        """Write a register; return why it has no meaning, empty if it has one."""
        if offset == PART_SEL:
            self.selected = value if value < self.count else None
            return "" if value < self.count else f"there is no partition {value}"
        if offset not in (MBW_MIN, MBW_MAX) or self.selected is None:
            return f"register {offset:#x} is none of the bandwidth controls, or no partition is selected"
        limit = value & ~HARDLIM if offset == MBW_MAX else value
        if offset == MBW_MAX and not value & HARDLIM:
            return f"{value:#x} is no hard limit: the partition may pass it"
        below = (1 << 16 - self.width) - 1
        if limit >= 2**16 or limit & below != below:
            return f"{value:#x} is no fraction of 16 bits that ends a step of {self.width} bits"
        (self.most if offset == MBW_MAX else self.least)[self.selected] = (limit >> 16 - self.width) + 1
        return ""


def execute(case: Case) -> None:
    """Execute the set-up and every table, of the scripts and of the header."""
    named, numbered = scripts_of(case, ".txt", "setup.txt", LOADER)
    if LOADER in named:
        check_loader(case, named[LOADER], case.facts.settings["mpam"]["base"], "")
    if "setup.txt" in named:
        _set_up(case, "setup.txt", _writes(case, named["setup.txt"]))
    _tables(case, {i: s.name for i, s in numbered.items()}, {i: _writes(case, s) for i, s in numbered.items()})
    header = header_of(case, HEADER, TYPES, ARRAYS, "MPAM_SCHEDULE_SHA256", put_function("mpam", ""))
    if header is None:
        return
    tables = case.tables.tables
    _set_up(case, HEADER, [row for row in header.numbers("mpam_setup") if len(row) == 2])
    arrays = {t.index: [row for row in header.numbers(f"mpam_write_{t.index}") if len(row) == 2] for t in tables}
    _tables(case, dict.fromkeys(arrays, HEADER), arrays)
    rows = [[str(len(writes)), f"mpam_write_{index}"] for index, writes in arrays.items()]
    if header.arrays.get("mpam_tables") != rows:
        case.note(GRANTS_DIFFER, HEADER, "mpam_tables are not the tables")
    numbers = {name: header_number(value) for name, value in header.defines.items() if not name.endswith("SHA256")}
    base = int(case.facts.settings["mpam"]["base"], 16)
    if (numbers.pop("MPAM_BASE", None), numbers.pop("MPAM_TABLES", None)) != (base, len(tables)):
        case.note(GRANTS_DIFFER, HEADER, f"MPAM_BASE and MPAM_TABLES are not {base:#x} and {len(tables)}")
    if list(numbers.values()) != list(range(len(tables))):
        case.note(GRANTS_DIFFER, HEADER, f"does not name the tables 0 to {len(tables) - 1}, each once")


def _writes(case: Case, script: Script) -> list[Write]:
    found = []
    for line in script.lines:
        words = [hexadecimal(word) for word in line.text.split()]
        if len(words) != 2 or words[0] is None or words[1] is None or words[1] >= 2**32:
            case.note(NOT_UNDERSTOOD, script.name, f'is "{line.text[:60]}", not "offset value"', line=line.number)
        else:
            found.append((words[0], words[1]))
    return found


def _play(case: Case, name: str, component: Component, writes: Sequence[Sequence[int]]) -> None:
    for offset, value in writes:
        case.steps += 1
        before = (component.selected, dict(component.most), dict(component.least))
        refused = component.write(offset, value)
        if not refused and before == (component.selected, component.most, component.least):
            refused = f"{value:#x} in {offset:#x} changes nothing"
        if refused:
            case.note(DEVICE_REFUSES, name, refused)


def _set_up(case: Case, name: str, writes: Sequence[Sequence[int]]) -> None:
    """Execute the set-up: every partition has the least share."""
    component = Component(case)
    _play(case, name, component, writes)
    wanted = dict.fromkeys(range(component.count), 1)
    for what, have in (("largest", component.most), ("least", component.least)):
        if have != wanted:
            wrong = sorted(p for p in wanted if have.get(p) != 1)
            case.note(GRANTS_DIFFER, name, f"the {what} share of partitions {wrong[:5]} is not one part")
    if len(writes) != 3 * component.count:
        case.note(GRANTS_DIFFER, name, f"has {len(writes)} writes, three for each of {component.count} partitions")


def _tables(case: Case, names: dict[int, str], writes: dict[int, list[Write]]) -> None:
    owners = {int(case.facts.units[u.name].get("partid", "0")): u.name for u in case.tables.units}
    if len(owners) != len(case.tables.units) or 0 in owners:
        case.note(DEVICE_REFUSES, HEADER, "every unit must have a partition of its own, from 1 on")
        return
    final: dict[int, dict[int, int]] = {}
    for index, several in writes.items():
        component = Component(case)
        for offset, value in several:
            component.write(offset, value)
        final[index] = component.most
    for plan in case.planned:
        if plan.table.index in writes:
            _table(case, names[plan.table.index], plan, writes[plan.table.index], owners, final)


def _table(
    case: Case,
    name: str,
    plan: Planned,
    writes: list[Write],
    owners: dict[int, str],
    final: dict[int, dict[int, int]],
) -> None:
    component = Component(case)
    _play(case, name, component, writes)
    have = {owners.get(partition, f"partition {partition}"): n for partition, n in component.most.items()}
    promised, part = rates.unit_peaks(case, plan), component.part
    rates.compare(
        case, name, plan.table, {REST: 1, **have}, {REST: ZERO, **promised}, lambda rate: max(1, -int(-rate // part)),
        lambda n: n * part,
    )  # fmt: skip
    if component.least != component.most:
        text = "least and largest share of a partition are not the same"
        case.note(GRANTS_DIFFER, name, text, path=about(table=plan.table.name))
    values = [(f"partition {p}", n) for p, n in _changes(case, writes)]
    formers = [{f"partition {p}": n for p, n in final.get(t.index, {}).items()} for t in case.tables.before(plan.table)]
    rates.fall_first(case, name, plan.table, values, formers)
    for before in case.tables.before(plan.table):
        _rise(case, name, plan.table, {0: 1, **final.get(before.index, {})}, writes)


def _changes(case: Case, writes: list[Write]) -> list[tuple[int, int]]:
    """Return the partitions with the largest share that is written to them, one write after the other."""
    component, found = Component(case), []
    for offset, value in writes:
        if not component.write(offset, value) and offset == MBW_MAX and component.selected is not None:
            found.append((component.selected, component.most[component.selected]))
    return found


def _rise(case: Case, name: str, table: Table, before: dict[int, int], writes: list[Write]) -> None:
    """Note the first write after which all shares together are above the capacity."""
    component, known = Component(case), len(case.findings)
    component.most = dict(before)
    for offset, value in writes:
        component.write(offset, value)
        granted = {f"partition {p}": n * component.part for p, n in component.most.items()}
        rates.hold(case, name, table, granted, " while shares change")
        if len(case.findings) > known:
            return
