"""Regulators of a bundle while it is played, and its transfers compared with their budgets."""

from __future__ import annotations

import csv
import io
from bisect import bisect_right
from dataclasses import replace
from fractions import Fraction
from functools import partial
from math import ceil
from operator import itemgetter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Location, about
from halpipe.core.durations import Duration
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.deploy.regulator import regulators_of
from halpipe.deploy.regulator.arithmetic import RATES, Arithmetic
from halpipe.deploy.regulator.codes import PLAYED_ELSEWHERE
from halpipe.deploy.regulator.counters import Judge, Sample
from halpipe.deploy.regulator.reading import TABLES, Table, Tables, Unit, read_tables
from halpipe.deploy.riscv.board.bus import Gate, Opening
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.devices import Transfer
    from halpipe.deploy.riscv.board.hart import Hart
    from halpipe.deploy.riscv.board.machine import Timing
    from halpipe.deploy.riscv.judge.check import Outcome
    from halpipe.deploy.riscv.target import Site


def regulators_playing(target: Target, site: Site, rate: int) -> Regulators | None:
    """Return the regulators that stand between DMA engine and memory; None where none grants bytes in windows.

    `rate` is the machine's units of time in a second. Raise `HalpipeError` where their tables cannot be read.
    """
    own = regulators_of(target)
    tables = read_tables(own.bundle) if own is not None else None
    return None if tables is None or tables.backend in RATES else Regulators(tables, site, rate)


class Regulators:
    """Tables that are played, in the machine's units of time; before the first one nothing is regulated.

    Of a platform that states where their registers are, the runtime starts and switches them (see `RegulatorPort`).
    Others follow the runtime: with each of its tables begins their own, unless that of a switch is still in force.
    """

    def __init__(self, tables: Tables, site: Site, rate: int) -> None:
        self.width = tables.platform.window_ns * rate / 10**9
        self.cycle = Fraction(rate, tables.platform.clock_hz)
        self._tables = tables.tables
        base = tables.platform.settings["table"]["base"] if tables.backend == "table" else ""
        self.base, self.units = int(base or "0", 16), len(tables.units)
        self._named = {table.name: table for table in tables.tables}
        self._channel = site.channels.get(tables.platform.resource)
        units = {unit.name: unit for unit in tables.units}
        p = tables.platform
        self._gates = {
            (hart, direction == "write"): Gate(
                partial(self.openings, unit, direction), p.burst_bytes, p.bus_bytes, unit.overshoot[direction]
            )
            for hart, unit in ((u.hart, units[u.name]) for u in site.units if u.name in units)
            for direction in ("read", "write")
        }
        self.begun: list[tuple[Fraction, Table]] = []

    def request(self, number: int, instant: Fraction | int) -> None:
        """Go to a table at the end of the one in force; a request counts two cycles before it, and the latest alone."""
        _, _, end = self.playing(Fraction(instant))
        if instant > end - 2 * self.cycle:
            _, _, end = self.playing(end)
        self.begun = [*((start, table) for start, table in self.begun if start < end), (end, self._tables[number])]

    def start(self, number: int, instant: Fraction) -> None:
        """Begin with a table at an instant."""
        self.begun = [(instant, self._tables[number])]

    def begin(self, name: str, start: Fraction | int) -> None:
        """Follow the runtime to its next table."""
        table = self._named.get(name)
        if table is not None and (not self.begun or start >= self._end(*self.begun[-1])):
            self.begun.append((Fraction(start), table))

    def gate(self, channel: int, hart: int, writes: bool) -> Gate | None:
        """Return what a transfer has to pass; None where nothing regulates its unit or the memory of its channel."""
        return self._gates.get((hart, writes)) if channel == self._channel and self.begun else None

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
        number = max(bisect_right(self.begun, instant, key=itemgetter(0)) - 1, 0)
        start, table = self.begun[number]
        later = [begin for begin, _ in self.begun[number + 1 : number + 2]]
        while self._end(start, table) <= instant:
            turns = (instant - start) // (table.windows * self.width) if table.successor == table.index else 1
            start, table = start + turns * table.windows * self.width, self._tables[table.successor]
        return start, table, min([self._end(start, table), *later])

    def _end(self, start: Fraction, table: Table) -> Fraction:
        return start + table.windows * self.width


_CTRL, _CYCLES, _REQUEST, _START_LO, _START_HI, _ARM = 0x08, 0x18, 0x1C, 0x2C, 0x30, 2


class RegulatorPort:
    """Registers of the regulators: what is loaded is kept, and what starts and switches them has its effect."""

    def __init__(self, regulators: Regulators, timing: Timing, changed: Callable[[], None]) -> None:
        self.base, self.size = regulators.base, (1 + regulators.units) << 20
        self.writes: list[tuple[int, int, int]] = []  # instants, offsets and values
        self._words = {0: 0x48425746}
        self._regulators, self._tick, self._changed = regulators, timing.tick, changed

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return a register."""
        return self._words.get(offset, 0)

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Set a register; START counts in ticks of the timer, and a window without budgets follows it."""
        self.writes.append((hart.now, offset, value))
        self._words[offset] = value
        if offset == _CTRL and value == _ARM:
            ticks = self._words.get(_START_HI, 0) << 32 | self._words.get(_START_LO, 0)
            first = ticks * self._tick + self._regulators.cycle + self._regulators.width
            self._regulators.start(self._words.get(_REQUEST, 0), first)
        elif offset == _REQUEST and self._words.get(_CTRL) == _ARM:
            self._regulators.request(value, hart.now)
            self._changed()


def _windows(table: Table, unit: str, direction: str, first: int) -> Iterator[tuple[int, int]]:
    """Yield the windows of a table from `first` on that have a budget, each with it."""
    entries = table.entries[unit]
    ends = [*(entry.window for entry in entries[1:]), table.windows]
    for entry, end in zip(entries, ends, strict=True):
        budget = entry.budget(direction)
        for window in range(max(first, entry.window), end if budget else 0):
            yield window, budget


@record
class Held:
    """Transfers compared with the tables: findings, lines of the summary, and every memory phase as CSV."""

    findings: tuple[Diagnostic, ...] = ()
    lines: tuple[str, ...] = ()
    phases: bytes = b""


def hold_transfers(target: Target, outcomes: Sequence[Outcome]) -> Held:
    """Hold the transfers of runs against the budgets of the tables that the regulators play meanwhile.

    Transfers of a unit that share a window are one demand. The figures are of memory phases: the bytes that their
    bounds promise, that the windows which they touch grant, and that were used.
    """
    own = regulators_of(target)
    if own is None:
        return Held()
    tables = read_tables(own.bundle)
    arithmetic = Arithmetic(own, tables)
    if tables.backend in RATES or list(arithmetic.findings()):  # said by the check of the tables
        return Held()
    judge = Judge(tables, {plan.table.index: plan for plan in arithmetic.planned})
    findings: list[Diagnostic] = []
    for outcome in outcomes:
        findings += judge.rows(list(_samples(tables, outcome)), f"{own.bundle.path}/{TABLES}")
    phases = [phase for outcome in outcomes for phase in _phases(tables, judge, outcome)]
    findings += [found for outcome in outcomes for found in _elsewhere(tables, outcome, own.bundle.at(TABLES))]
    lines, run = [*_figures(phases)], outcomes[0].run
    if run.regulators is not None:
        late = Duration((run.regulators.begun[0][0] - (run.zero or 0)) * 10**9 / run.rate)
        lines.append(f"regulators: their tables begin {late} after those of the runtime")
    return Held(tuple(findings), tuple(lines), _csv(phases))


def _elsewhere(tables: Tables, outcome: Outcome, at: Location) -> Iterator[Diagnostic]:
    """Yield the first table of the runtime with which its regulators do not play theirs."""
    own, wanted = outcome.run.regulators, _followed(tables, outcome)
    if own is None:
        return
    for played in outcome.tables:
        start, want, _ = wanted.playing(played.start.fraction)
        instant = own.begun[0][0] + start * outcome.run.rate / 10**9
        have_start, have, _ = own.playing(instant)
        if (have.index, have_start) != (want.index, instant):
            text = f'they play "{have.name}" where the runtime plays "{want.name}", {start} ns after its begin'
            help = "ask for a mode after the table of the switch before has ended"
            yield PLAYED_ELSEWHERE(text, at=at, path=about(table=played.name), help=help)
            return


@record
class _Phase:
    """A memory phase of a job on one unit as it was played; times in nanoseconds from the begin of its table."""

    cycle: int
    table: str
    task: str
    job: int
    unit: str
    direction: str
    start: Fraction
    end: Fraction
    promised: Fraction
    granted: int
    used: int
    held: Fraction


def _phases(tables: Tables, judge: Judge, outcome: Outcome) -> Iterator[_Phase]:
    """Yield every phase of a regulated unit, in the order of jobs."""
    units = {unit.hart: unit.name for unit in outcome.run.site.units}
    regulated = {unit.name: unit for unit in tables.units}
    channel = outcome.run.site.channels.get(tables.platform.resource)
    regulators = _followed(tables, outcome)
    for job in outcome.jobs:
        moved: dict[tuple[str, str, int, int], list[Transfer]] = {}
        for planned, seen in zip(job.planned.transfers, job.transfers, strict=True):
            if planned.channel == channel and units.get(planned.hart) in regulated:
                direction = "write" if planned.kind is AccessKind.WRITE else "read"
                key = (units[planned.hart], direction, planned.begin, planned.end)
                moved.setdefault(key, []).extend([] if seen is None else [seen])
        for (unit, direction, *ticks), transfers in moved.items():
            begin, end = (outcome.run.site.tick.fraction * tick for tick in ticks)
            start, table, _ = regulators.playing(begin)
            used = sum(transfer.size for transfer in transfers)
            sample = Sample(table, regulated[unit], direction, begin - start, end - start, used, 0)
            yield _Phase(
                job.planned.table.cycle,
                table.name,
                job.planned.job.task,
                job.planned.job.index,
                unit,
                direction,
                sample.start,
                sample.end,
                judge.promised(sample),
                judge.limits(sample)[0],
                used,
                sum((outcome.run.length(transfer.held).fraction for transfer in transfers), Fraction(0)),
            )


_COLUMNS = ("cycle", "table", "task", "job", "unit", "direction", "start", "end", "promised", "granted", "used", "held")


def _csv(phases: Sequence[_Phase]) -> bytes:
    """Return the phases as CSV: exact nanoseconds and bytes."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_COLUMNS)
    for phase in phases:
        cells = (getattr(phase, name) for name in _COLUMNS)
        rows.writerow(format_rational(cell) if isinstance(cell, Fraction) else cell for cell in cells)
    return text.getvalue().encode()


def _figures(phases: Sequence[_Phase]) -> Iterator[str]:
    """Yield what all phases of each table, unit and direction come to."""
    together = grouped(((phase.table, phase.unit, phase.direction), phase) for phase in phases)
    for (table, unit, direction), several in sorted(together.items()):
        promised, granted, used = (sum(getattr(p, what) for p in several) for what in ("promised", "granted", "used"))
        worst = max(phase.held for phase in several)
        held = f", held back for at most {Duration(worst)}" if worst else ""
        yield (
            f"regulators: {table}, {unit}, {direction}: {len(several)} phases, {int(promised)} B promised, "
            f"{granted} B granted, {used} B used{held}"
        )


def _samples(tables: Tables, outcome: Outcome) -> Iterator[Sample]:
    """Yield what each unit moved in each direction, in stretches of windows without a gap."""
    regulators = _followed(tables, outcome)
    units = {unit.hart: unit.name for unit in outcome.run.site.units}
    regulated = {unit.name: unit for unit in tables.units}
    moved: dict[tuple[str, str], list[tuple[Fraction, Fraction, int]]] = {}
    for job in outcome.jobs:
        for planned, seen in zip(job.planned.transfers, job.transfers, strict=False):
            if seen is not None and units.get(planned.hart) in regulated:
                row = units[planned.hart], "write" if planned.kind is AccessKind.WRITE else "read"
                begin, end = (outcome.run.since(instant).fraction for instant in (seen.begin, seen.end))
                moved.setdefault(row, []).append((begin, end, seen.size))
    width = tables.platform.window_ns
    for (unit, direction), several in sorted(moved.items()):
        found: list[tuple[Fraction, Sample]] = []  # with the begin of its table: each cycle has windows of its own
        for begin, end, size in sorted(several):
            start, table, _ = regulators.playing(begin)
            sample = Sample(table, regulated[unit], direction, begin - start, end - start, size, 0)
            if found and found[-1][0] == start and sample.start // width < ceil(found[-1][1].end / width):
                _, last = found.pop()
                sample = replace(last, end=max(last.end, sample.end), used=last.used + size)
            found.append((start, sample))
        yield from (sample for _, sample in found)


def _followed(tables: Tables, outcome: Outcome) -> Regulators:
    """Return the regulators as they followed a run, in nanoseconds from its beginning."""
    regulators = Regulators(tables, outcome.run.site, 10**9)
    for played in outcome.tables:
        regulators.begin(played.name, played.start.fraction)
    return regulators
