"""Judges what the monitor of the bench counted, window by window, by the tables and by nothing of the regulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.deploy.regulator import codes
from halpipe.deploy.regulator.reading import DIRECTIONS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Code, Diagnostic, Location
    from halpipe.deploy.regulator.reading import Table, Tables, Unit
    from halpipe.deploy.regulator.stimuli import Expected, Run

FIELDS = 13
UNKNOWN = 2**32 - 2
_FAULTS = (
    "a read was withdrawn or changed before it was taken",
    "a write was withdrawn or changed before it was taken",
    "a burst passed on one side of the regulator only",
    "data was shown to the memory before its address",
    "table or window changed within a window",
    "data was held back although its address had been shown",
    "more than 255 writes were shown whose data had not passed",
)
_HELP = "the Verilog in the bundle or its tables were changed; export the bundle again"


@record
class Count:
    """One direction of one unit in one window, in bytes: taken; of these carried over; shown and left waiting."""

    taken: int
    carried: int
    waiting: int

    def admitted(self, owed: int) -> int:
        """Return the bytes first shown in this window; `owed` was waiting when it began."""
        still = owed and self.taken == 0 and self.waiting == owed
        return self.taken - self.carried + (0 if still else self.waiting)


@dataclass(slots=True)
class Verdict:
    """Figures of a run, and its findings."""

    windows: int = 0
    switches: int = 0
    granted: int = 0
    used: int = 0
    carried: int = 0
    largest_sum: int = 0
    findings: list[Diagnostic] = field(default_factory=list)


def judge(tables: Tables, run: Run, trace: bytes, at: Location) -> Verdict:
    """Return the verdict on the trace of a run."""
    judge = _Judge(tables, run, at)
    for line in trace.decode("latin-1").splitlines():
        judge.line(line)
    judge.finish()
    return judge.verdict


class _Judge:
    """Reads a trace and reports the first finding of each kind on each row, with the number of further ones."""

    def __init__(self, tables: Tables, run: Run, at: Location) -> None:
        self.verdict = Verdict(switches=run.switches)
        self._tables, self._run, self._at = tables, run, at
        self._rows = list(tables.rows())
        self._owed = [0] * len(self._rows)
        self._noted: dict[tuple[Code, str], tuple[str, int]] = {}
        self._faults = 0
        self._reads = {(cycle, address): value for cycle, address, value in run.reads}
        self._budgets: dict[tuple[int, int, str], list[int]] = {}

    def line(self, text: str) -> None:
        words = text.split()
        try:
            numbers = [int(word) for word in words[1:]]
        except ValueError:  # Verilog's x: a register that was never written
            numbers = [int(word) if word.isdecimal() else UNKNOWN for word in words[1:]]
        if words[:1] == ["R"]:
            self._register(*numbers)
        elif words[:1] == ["W"]:
            self._window(numbers[0], numbers[1:])

    def finish(self) -> None:
        """Make the findings of what was seen, and of what should have been."""
        for cycle, address in self._reads:
            if cycle < self._end:
                self._note(codes.BROKE_PROTOCOL, "registers", f"register {address:#x} was not read in cycle {cycle}")
        if self.verdict.windows != len(self._run.expected):
            text = f"the trace has {self.verdict.windows} windows, {len(self._run.expected)} were simulated"
            self._note(codes.PLAYED_WRONG, "trace", text)
        name = self._run.traffic.name
        for (code, path), (text, times) in self._noted.items():
            more = times - 1
            tail = f", and {more} windows more" if more else ""
            message = f"{text}{tail} (traffic: {name}, seed {self._run.seed})"
            self.verdict.findings.append(code(message, at=self._at, path=path, help=_HELP))

    @property
    def _end(self) -> int:
        cycles = [cycle for cycle, _order, _address, _value in self._run.script]
        return max(cycles, default=0) + 1

    def _note(self, code: Code, path: str, text: str) -> None:
        first, times = self._noted.get((code, path), (text, 0))
        self._noted[code, path] = first, times + 1

    def _register(self, cycle: int, address: int, value: int) -> None:
        expected = self._reads.pop((cycle, address), None)
        if expected is not None and expected != value:
            text = f"register {address:#x} held {value:#x} in cycle {cycle}, it must hold {expected:#x}"
            self._note(codes.BROKE_PROTOCOL, "registers", text)

    def _window(self, number: int, fields: Sequence[int]) -> None:
        self.verdict.windows += 1
        if number >= len(self._run.expected):
            return
        expected = self._run.expected[number]
        total = 0
        for unit in self._tables.units:
            base = FIELDS * unit.index
            self._played(number, expected, unit.name, fields[base], fields[base + 1])
            self._protocol(number, unit.name, fields[base + 10])
            for half, direction in enumerate(DIRECTIONS):
                count = Count(*fields[base + 2 + 3 * half : base + 5 + 3 * half])
                budget = self._budget(expected, unit, direction)
                self._row(number, 2 * unit.index + half, count, budget, fields[base + 11 + half])
                total += count.taken
        self.verdict.largest_sum = max(self.verdict.largest_sum, total)
        if total > self._tables.platform.capacity_bytes:
            text = f"{total} B in window {number}, the capacity is {self._tables.platform.capacity_bytes} B"
            self._note(codes.SHARED_TOO_MUCH, "all units", text)

    def _row(self, number: int, row: int, count: Count, budget: int, left: int) -> None:
        """Hold one direction of one unit against its budget.

        What was shown before and not yet taken is charged to this window as well; all else must fit the rest, which is
        also what the regulator must have `left` when the window begins.
        """
        owed, self._owed[row] = self._owed[row], count.waiting
        room = max(0, budget - owed)
        admitted = count.admitted(owed)
        self.verdict.granted += budget
        self.verdict.used += count.taken
        self.verdict.carried += count.carried > 0
        unit, direction = self._rows[row]
        path = f'unit "{unit.name}", {direction}'
        if admitted > room or count.carried > owed:
            text = f"{count.taken} B in window {number} ({self._where(number)}), the budget is {budget} B"
            self._note(codes.SPENT_TOO_MUCH, path, text)
        if left != room:
            code = codes.SPENT_TOO_MUCH if left > room else codes.GOT_TOO_LITTLE
            text = f"has {left} B in window {number} ({self._where(number)}), it must have {room} B"
            self._note(code, path, text)
        is_asking = self._run.kinds[unit.index] >> (4 * (direction == "write")) & 1
        if self._run.traffic.greedy and is_asking and admitted < room - room % self._tables.platform.burst_bytes:
            text = f"{count.taken} B in window {number} ({self._where(number)}), the budget is {budget} B"
            self._note(codes.GOT_TOO_LITTLE, path, text)

    def _played(self, number: int, expected: Expected, unit: str, table: int, window: int) -> None:
        if (table if expected.running else 0, window) != (expected.table, expected.window):
            found = f'table {table} "{self._name(table)}", window {window}' if window != 2**32 - 1 else "its defaults"
            text = f"plays {found} in window {number}, it must play {self._where(number)}"
            self._note(codes.PLAYED_WRONG, about(unit=unit), text)

    def _protocol(self, number: int, unit: str, faults: int) -> None:
        for bit, what in enumerate(_FAULTS):
            if faults >> bit & 1 and not self._faults >> bit & 1:
                code = codes.PLAYED_WRONG if bit == 4 else codes.BROKE_PROTOCOL
                self._note(code, about(unit=unit), f"{what}, seen in window {number}")
        self._faults |= faults

    def _budget(self, expected: Expected, unit: Unit, direction: str) -> int:
        if not expected.running:
            return 0 if expected.is_calm else unit.default[direction]
        key = (expected.table, unit.index, direction)
        if key not in self._budgets:
            self._budgets[key] = self._tables.tables[expected.table].budgets(unit.name, direction)
        return self._budgets[key][expected.window]

    def _where(self, number: int) -> str:
        expected = self._run.expected[number]
        if not expected.running:
            return "its defaults"
        return f'table {expected.table} "{self._name(expected.table)}", window {expected.window}'

    def _name(self, table: int) -> str:
        known: Sequence[Table] = self._tables.tables
        return known[table].name if 0 <= table < len(known) else "unknown"
