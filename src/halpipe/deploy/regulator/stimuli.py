"""Stimuli of a simulated bench: accesses of managers and software, drawn from a seed and recorded as a script.

Nothing is drawn but from SHA-256 of the seed, so that a run can be repeated on any machine.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from dataclasses import replace
from fractions import Fraction
from itertools import count as counting
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.deploy.regulator.forms import MOST_HEADERS, header_lines
from halpipe.deploy.regulator.reading import DIRECTIONS, Entry, Table, Tables

if TYPE_CHECKING:
    from collections.abc import Sequence


GREEDY = 1
LENGTHS, GAPS, CLUSTERS = 2, 4, 8
FRAME_ID, FRAME_GO, FRAME_WINDOW, FRAME_CYCLES, FRAME_REQUEST = 0x000, 0x008, 0x010, 0x018, 0x01C
FRAME_EXTRA, FRAME_OF, FRAME_LONGEST = 0x020, 0x024, 0x028
PARAMS, VERSION = 0x004, 4 << 24
UNIT_WINDOW, UNIT_DEF_READ, UNIT_DEF_WRITE, UNIT_REQUEST = 0x010, 0x014, 0x018, 0x01C
UNIT_HEADERS, UNIT_ENTRIES = 0x800, 0x1000
NOT_RUNNING = 2**32 - 1
LEAST_CYCLES = 4
"""The shortest window that there is; one that is asked to be shorter is as long."""

WHOLE, OKAY, SLVERR = 0xF, 0, 2
"""Strobes of a whole word, and what AXI4-Lite answers."""

LITE_CYCLES = 4
"""From one order through AXI4-Lite to the next; its answer is taken by then."""

READS, IGNORED, THROUGH_LITE = 200, 60, 20
"""How many registers are read in a run, and orders given that must change nothing; and reads through AXI4-Lite."""

MOST_TABLES, MOST_ENTRIES = MOST_HEADERS, 65_280
"""As many as have addresses."""


def unit_address(index: int, offset: int) -> int:
    """Return the address of a register of a unit: 1 MiB for each, after that of the windows."""
    return ((1 + index) << 20) | offset


def first_window(units: int) -> int:
    """Return the cycle in which the first window begins that counts; the defaults are written before it."""
    return 64 + 4 * units


def sizes(tables: Tables) -> tuple[int, int]:
    """Return the entries and the headers of every unit: powers of two, with a header that no table has."""
    entries = max(sum(len(t.entries[unit.name]) for t in tables.tables) + 1 for unit in tables.units)
    return max(1024, 1 << (entries - 1).bit_length()), header_lines(tables)


def beat_size(tables: Tables) -> int:
    """Return log2 of the bytes of a beat of the bus."""
    return tables.platform.bus_bytes.bit_length() - 1


class Draw:
    """Numbers that follow from a seed and a purpose."""

    def __init__(self, *purpose: object) -> None:
        self._key = " ".join(map(str, purpose)).encode()
        self._count = 0

    def below(self, limit: int) -> int:
        """Return a number in [0, limit)."""
        self._count += 1
        digest = hashlib.sha256(self._key + b" %d" % self._count).digest()
        return int.from_bytes(digest[:8], "big") % limit


@record(kw_only=True)
class Traffic:
    """Behaviour of the managers of a run; of the memory, its queues' depth and its latency in cycles."""

    name: str
    greedy: bool = False
    flags: int = 0
    mixed: bool = False
    depth: int = 64
    latency: int = 20
    by_software: bool = False
    """Whether the tables are written through the registers instead of being in the memory images."""
    cycles: int = 0
    """Cycles of a window; 0: those of the platform."""
    is_silent: bool = False
    """Make no requests: such a run checks tables and budgets alone, and ends when all tables were played."""
    is_owing: bool = False
    """Bursts are of one beat, and the memory takes no data of writes in the first three quarters of the run."""

    def kinds(self, tables: Tables, draw: Draw) -> list[int]:
        """Return for every unit what its reader (low half) and its writer (high half) do."""
        if self.is_silent:
            return [0 for _ in tables.units]
        kinds = []
        for _ in tables.units:
            halves = [GREEDY | (draw.below(8) << 1 if self.mixed else self.flags) for _ in DIRECTIONS]
            if self.mixed and draw.below(4) == 0:
                halves[draw.below(2)] = 0
            kinds.append(halves[0] | halves[1] << 4)
        return kinds


STEPPED = Traffic(name="every table, stepped", cycles=LEAST_CYCLES, is_silent=True)
"""Windows as short as they can be, so that tables of any length are played to their ends in a moment."""

TRAFFIC = (
    Traffic(name="greedy", greedy=True),
    Traffic(name="random lengths and gaps", flags=LENGTHS | GAPS, by_software=True),
    Traffic(name="clusters, shallow queues", flags=LENGTHS | CLUSTERS, depth=2, latency=45),
    Traffic(name="greedy, shallow queues", depth=1, latency=3, by_software=True),
    Traffic(name="each manager different", mixed=True, depth=8),
    Traffic(name="data of writes waits", depth=512, is_owing=True),
)


@record(kw_only=True)
class Expected:
    """Expected window: the table played and its window; none while the defaults hold, or no budget at all."""

    table: int
    window: int
    is_calm: bool = False

    @property
    def running(self) -> bool:
        """Whether a table is played."""
        return self.window != NOT_RUNNING


@record(kw_only=True)
class Run:
    """One simulation: the script of the software, what the managers do, and which window of which table is expected."""

    traffic: Traffic
    seed: int
    cycles: int
    extra: Fraction
    kinds: tuple[int, ...]
    script: tuple[tuple[int, str, int, int], ...]
    expected: tuple[Expected, ...]
    reads: tuple[tuple[int, int, int], ...]
    """(cycle, address, value) of what the software must read, or be answered."""

    @property
    def switches(self) -> int:
        """Return the number of begins of another table."""
        return sum(a.running and b.running and a.table != b.table for a, b in pairwise(self.expected))


STRETCH = 3
"""Windows that an excerpt has of those, at most, in which no budget changes."""


def excerpt(tables: Tables, windows: int) -> Tables:
    """Return tables of which a tour takes about `windows` windows: a few of each stretch with the same budgets.

    What is still too long loses its middle. A window without budgets is there instead, so that no burst is carried
    over between windows that do not follow one another in the table.
    """
    modes = sum(not table.is_transition for table in tables.tables)
    most = max(2 * STRETCH, windows // (2 * modes + 3 * len(tables.switches) + 3))
    cut = replace(tables, tables=tuple(_cut(table, most) for table in tables.tables))
    return cut if sizes(cut) == sizes(tables) else tables


def _cut(table: Table, most: int) -> Table:
    if table.windows <= most:
        return table
    starts = sorted({entry.window for entries in table.entries.values() for entry in entries})
    kept: list[int | None] = []
    for start, end in pairwise([*starts, table.windows]):
        kept += range(start, min(end, start + STRETCH))
    if len(kept) > most:
        kept = [*kept[: most // 2], None, *kept[len(kept) - (most - 1 - most // 2) :]]

    def budgets(entries: Sequence[Entry]) -> tuple[Entry, ...]:
        found: list[Entry] = []
        for number, window in enumerate(kept):
            now = None if window is None else entries[bisect_right(entries, window, key=lambda e: e.window) - 1]
            read, write = (now.read, now.write) if now else (0, 0)
            if not found or (found[-1].read, found[-1].write) != (read, write):
                found.append(Entry(number, read, write))
        return tuple(found)

    entries = {unit: budgets(several) for unit, several in table.entries.items()}
    return replace(table, windows=len(kept), entries=entries)


def plan(tables: Tables, traffic: Traffic, seed: int, *, windows: int, repeats: int = 1) -> Run:
    """Return a run of at most `windows` windows that visits all switches, each at a drawn instant, as far as it gets.

    Every mode is played `repeats` times before it is left. A quarter of the requests come too late for the end of the
    table that they aim at, a quarter replace one made before.
    """
    draw = Draw(seed, traffic.name)
    extra = Fraction(0) if traffic.cycles else tables.platform.window_extra
    writer = _Software(tables, draw, traffic.cycles or tables.platform.window_cycles, extra)
    writer.start(by_software=traffic.by_software)
    writer.tour(windows, repeats, tables_only=traffic.is_silent)
    writer.ask_for_nothing()
    script, reads = writer.script(windows)
    return Run(
        traffic=traffic,
        seed=seed,
        cycles=traffic.cycles or tables.platform.window_cycles,
        extra=extra,
        kinds=tuple(traffic.kinds(tables, draw)),
        script=tuple(script),
        expected=tuple(writer.expected[:windows]),
        reads=tuple(reads),
    )


_CALM = Expected(table=0, window=NOT_RUNNING, is_calm=True)
"""The window between the defaults and the first table."""


class _Software:
    """Makes the script, and follows what the regulators must make of it."""

    def __init__(self, tables: Tables, draw: Draw, cycles: int, extra: Fraction) -> None:
        self._tables, self._draw = tables, draw
        self._cycles, self._extra = cycles, extra
        self._first = first_window(len(tables.units))
        self._entries, self._headers = sizes(tables)
        self._orders: dict[int, tuple[str, int, int]] = {}
        self._lite: set[int] = set()
        self._reads: list[tuple[int, int, int]] = []
        self.expected: list[Expected] = []

    def start(self, *, by_software: bool) -> None:
        """Set up as firmware does: the window, the defaults, the tables where they are not in the images; then GO.

        The shortest window is asked for as one that is shorter still. What is written beyond the tables is nowhere.
        """
        cycle = self._write(0, FRAME_CYCLES, self._cycles if self._cycles > LEAST_CYCLES else LEAST_CYCLES - 1)
        self._read(cycle, FRAME_CYCLES, self._cycles)
        cycle = self._write(cycle + 1, FRAME_EXTRA, self._extra.numerator)
        cycle = self._write(cycle, FRAME_OF, self._extra.denominator if self._extra else 0)
        cycle = self._write(cycle, FRAME_LONGEST, self._tables.platform.burst_bytes)
        cycle = self._write_beyond(cycle)
        for unit in self._tables.units:
            cycle = self._write(cycle, unit_address(unit.index, UNIT_DEF_READ), unit.default["read"])
            cycle = self._write(cycle, unit_address(unit.index, UNIT_DEF_WRITE), unit.default["write"])
        self._read(cycle, FRAME_ID, 0x48425746)
        self._read(cycle + 1, unit_address(0, FRAME_ID), 0x48425754)
        cycle += 2
        if by_software:
            cycle = self._load(cycle)
        cycle = max(cycle + LITE_CYCLES, self._first + self._draw.below(2 * self._cycles))
        self._write_lite(cycle - LITE_CYCLES, FRAME_CYCLES, self._cycles + 1, strobes=1 + self._draw.below(WHOLE - 1))
        self._write_lite(cycle, FRAME_GO, 1)
        waiting = next(
            n for n in counting() if self._tick(n) > cycle
        )  # in the last cycle of a window: one window later
        self.expected = [*[Expected(table=0, window=NOT_RUNNING)] * waiting, _CALM]

    def _write_beyond(self, cycle: int) -> int:
        """Write the first header and the first entry that there are not; in a memory of their size they are 0."""
        unit = self._draw.below(len(self._tables.units))
        if self._headers < MOST_TABLES:
            at = unit_address(unit, UNIT_HEADERS + 8 * self._headers)
            cycle = self._write(self._write(cycle, at, 1), at + 4, 0xFF << 24 | 1)
        if self._entries < MOST_ENTRIES:
            at = unit_address(unit, UNIT_ENTRIES + 16 * self._entries)
            for word, value in enumerate((1, 1, 0)):
                cycle = self._write(cycle, at + 4 * word, value)
        return cycle

    def _load(self, cycle: int) -> int:
        for unit in self._tables.units:
            index = 0
            for number, table in enumerate(self._tables.tables):
                at = unit_address(unit.index, UNIT_HEADERS + 8 * number)
                cycle = self._write(cycle, at, table.windows)
                cycle = self._write(cycle, at + 4, table.successor << 24 | index)
                for entry in table.entries[unit.name]:
                    at = unit_address(unit.index, UNIT_ENTRIES + 16 * index)
                    cycle = self._write(cycle, at, entry.write)
                    cycle = self._write(cycle, at + 4, entry.read)
                    cycle = self._write(cycle, at + 8, entry.window)
                    index += 1
            at = unit_address(unit.index, UNIT_ENTRIES + 16 * index)
            cycle = self._write(cycle, at + 8, NOT_RUNNING)
        return cycle

    def tour(self, windows: int, repeats: int, *, tables_only: bool = False) -> None:
        """Go through the modes until every mode was played and every switch made, or the windows are used up.

        With `tables_only` every table is enough.

        From a mode that leads nowhere new the regulators are stopped, and started in another one.
        """
        made: set[tuple[str, str]] = set()
        left = {table.mode for table in self._tables.tables if not table.is_transition}
        mode, tables = self._tables.tables[0].mode, self._tables.tables
        with_tables = {(s.source, s.target) for s in self._tables.switches if tables[s.request].is_transition}
        while len(self.expected) < windows:
            left.discard(mode)
            if tables_only and not left and made >= with_tables:
                self._play(self._mode_table(mode), 1)
                return
            path = self._path(mode, made)
            if path:
                request = next(s.request for s in self._tables.switches if (s.source, s.target) == path)
                self._play(self._mode_table(mode), repeats, request)
                if self._tables.tables[request].is_transition:
                    self._play(request, 1)
                made.add(path)
                mode = path[1]
                continue
            self._play(self._mode_table(mode), max(repeats, 2))
            rest = sorted({s.source for s in self._tables.switches if (s.source, s.target) not in made} | left)
            if not rest:
                return
            self._restart(self._mode_table(mode), self._mode_table(rest[0]))
            mode = rest[0]

    def _restart(self, table: int, begin: int) -> None:
        """Stop in the first window of `table`; one window later go on with the first of `begin`."""
        start = self._tick(len(self.expected)) + 1
        self._write(start + self._draw.below(self._cycles - 2), FRAME_GO, 0)
        again = self._tick(len(self.expected) + 1) + 1
        self._write(again, FRAME_REQUEST, begin)
        self._write(again + 1 + self._draw.below(self._cycles - 2), FRAME_GO, 1)
        self.expected += [Expected(table=table, window=0), Expected(table=0, window=NOT_RUNNING), _CALM]

    def ask_for_nothing(self) -> None:
        """Request a table that was never written: the defaults come for a window, then table 0."""
        now = self.expected[-1].table
        if self._headers > len(self._tables.tables) and now == self._tables.tables[now].successor:
            self._play(now, 1, len(self._tables.tables))
            self.expected += [Expected(table=0, window=NOT_RUNNING), _CALM]
            self._append(0, self._tables.tables[0].windows)

    def _path(self, mode: str, made: set[tuple[str, str]]) -> tuple[str, str] | None:
        """Return the next switch on the shortest way to one that was not made yet; drawn among equals."""
        leads = grouped((switch.source, switch.target) for switch in self._tables.switches)
        reached: list[tuple[str, tuple[str, str] | None]] = [(mode, None)]
        seen = {mode}
        for place, first in reached:
            fresh = [target for target in leads.get(place, []) if (place, target) not in made]
            if fresh:
                step = (place, fresh[self._draw.below(len(fresh))])
                return first or step
            for target in leads.get(place, []):
                if target not in seen:
                    seen.add(target)
                    reached.append((target, first or (place, target)))
        return None

    def _mode_table(self, mode: str) -> int:
        return next(t.index for t in self._tables.tables if t.mode == mode and not t.is_transition)

    def _play(self, table: int, times: int, request: int | None = None) -> None:
        """Play a table some times; in the last of them a request is made, in time or too late."""
        length = self._tables.tables[table].windows
        for _ in range(times):
            self._append(table, length)
        if request is None:
            return
        end = self._tick(len(self.expected))
        last = self._tick(len(self.expected) - length) + 1
        middle = last + (end - 2 - last) // 2
        fate = self._draw.below(5) if middle > last else 2
        if fate == 0:
            self._write(end - self._draw.below(2), FRAME_REQUEST, request)  # too late: once more
            self._append(table, length)
        elif fate == 2:
            self._write(end - 2, FRAME_REQUEST, request)  # just in time
        elif fate == 4:
            self._write(end - 2, FRAME_REQUEST, request)
            self._write(end - self._draw.below(2), FRAME_REQUEST, table)  # too late, and not wanted any more after it
        else:
            if fate == 1:
                self._write(last + self._draw.below(middle - last), FRAME_REQUEST, table)  # thought better of
            self._write(middle + self._draw.below(end - 2 - middle), FRAME_REQUEST, request)

    def _append(self, table: int, length: int) -> None:
        self.expected += [Expected(table=table, window=window) for window in range(length)]

    def _tick(self, window: int) -> int:
        """Return the last cycle before a window begins."""
        return self._first + window * self._cycles + int(window * self._extra) - 1

    def _write_lite(self, cycle: int, address: int, value: int, *, strobes: int = WHOLE) -> None:
        """Write through AXI4-Lite: all of a word, or part of it, which must change nothing."""
        address |= strobes << 26
        self._orders[cycle] = ("l", address, value)
        self._lite.add(cycle)
        self._reads.append((cycle, address, OKAY if strobes == WHOLE else SLVERR))

    def _write(self, cycle: int, address: int, value: int) -> int:
        assert cycle not in self._orders
        self._orders[cycle] = ("w", address, value)
        return cycle + 1

    def script(self, windows: int) -> tuple[list[tuple[int, str, int, int]], list[tuple[int, int, int]]]:
        """Return the orders by cycle, with looks at registers between them, and what these must show."""
        played = min(windows, len(self.expected))
        for _ in range(IGNORED):
            self._disturb(self._draw.below(played))
        for count in range(READS):
            number = self._draw.below(played)
            cycle = self._tick(number) + 1 + self._draw.below(self._cycles)
            self._read(cycle, *self._look(number), order="a" if count < THROUGH_LITE else "r")
        return [(cycle, *self._orders[cycle]) for cycle in sorted(self._orders)], sorted(self._reads)

    def _look(self, number: int) -> tuple[int, int]:
        """Draw a register, in half of the cases the window of a unit; return what it must hold in a window."""
        unit = self._tables.units[self._draw.below(len(self._tables.units))]
        known = [
            (unit_address(unit.index, UNIT_DEF_READ), unit.default["read"]),
            (unit_address(unit.index, UNIT_DEF_WRITE), unit.default["write"]),
            (unit_address(unit.index, PARAMS), VERSION | (self._headers & 0xFF) << 16 | self._entries & 0xFFFF),
            (PARAMS, VERSION | 1 << 20 | 1 << 16 | beat_size(self._tables) << 8 | len(self._tables.units)),
            (FRAME_WINDOW, number + 1),
            (FRAME_CYCLES, self._cycles),
            (FRAME_EXTRA, self._extra.numerator),
            (FRAME_OF, self._extra.denominator),
            (FRAME_LONGEST, self._tables.platform.burst_bytes),
        ]
        window = unit_address(unit.index, UNIT_WINDOW), self.expected[number].window
        return window if self._draw.below(2) else known[self._draw.below(len(known))]

    def _disturb(self, number: int) -> None:
        """Give an order in a window that must change nothing, since a table is played or there is no such table."""
        if not all(expected.running for expected in self.expected[number : number + 2]):
            return
        cycle = self._tick(number) + 1 + self._draw.below(self._cycles)
        unit = self._draw.below(len(self._tables.units))
        table = self._draw.below(len(self._tables.tables))
        beyond = range(self._headers, MOST_TABLES)
        entries = sum(len(t.entries[self._tables.units[unit].name]) for t in self._tables.tables)
        requests = FRAME_REQUEST, unit_address(unit, UNIT_REQUEST)
        orders = [
            (unit_address(unit, UNIT_HEADERS + 8 * table + 4 * self._draw.below(2)), 1),
            (unit_address(unit, UNIT_ENTRIES + 16 * self._draw.below(entries) + 8), 1),
            *((at, beyond[self._draw.below(len(beyond))]) for at in requests if beyond),
        ]
        if cycle not in self._orders:
            self._write(cycle, *orders[self._draw.below(len(orders))])

    def _read(self, cycle: int, address: int, value: int, *, order: str = "r") -> None:
        """Read a register, unless something else is done in that cycle, or an order through AXI4-Lite is too near."""
        near = range(cycle - LITE_CYCLES + 1, cycle + LITE_CYCLES)
        if cycle in self._orders or (order == "a" and not self._lite.isdisjoint(near)):
            return
        if order == "a":
            self._lite.add(cycle)
        self._orders[cycle] = (order, address, 0)
        self._reads.append((cycle, address, value))


def format_script(script: Sequence[tuple[int, str, int, int]]) -> bytes:
    """Return a script as the bench reads it."""
    return "".join(f"{cycle} {order} {address:x} {value:x}\n" for cycle, order, address, value in script).encode()
