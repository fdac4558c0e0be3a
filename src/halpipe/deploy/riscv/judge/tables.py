"""Operation tables as stored in the program, compared with the plan before anything is played.

Engines that see no DMA registers learn from this what a transfer that the runtime records has moved. Layouts are
those of docs/reference/riscv-bundle.md.
"""

from __future__ import annotations

import struct
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.deploy.riscv.codes import WRONG_OPERATIONS
from halpipe.deploy.riscv.judge.contents import AGAIN, BSS, stored
from halpipe.deploy.riscv.run.cosimulation import load_program
from halpipe.deploy.riscv.run.drivers import read_drivers
from halpipe.deploy.riscv.run.recording import Abandoned, Flag, Kind, Record
from halpipe.deploy.riscv.run.sequence import tables_named
from halpipe.models import AccessKind, HealthAction, HealthEvent, Schedule, TaskModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.elf import Program
    from halpipe.deploy.riscv.run.expectation import Expectation, Image, PlannedJob
    from halpipe.deploy.riscv.target import Site

_OPERATION = struct.Struct("<QQQQIBBHII")  # a byte behind the unit is zero
_PROGRAM = struct.Struct("<QIIIHH")
_RULE = struct.Struct("<IIIBBBB")
_RELEASE = struct.Struct("<QQ")
_TABLE = struct.Struct("<QQII")
_INDEX = struct.Struct("<I")
_ADDRESS = struct.Struct("<Q")
_NO_TABLE = 0xFFFFFFFF
_EVENTS = {
    HealthEvent.OVERRUN: Flag.LATE | Flag.OVERRUN,
    HealthEvent.FAULT: Flag.FAULT | Flag.STUCK | Flag.ERROR,
    HealthEvent.ANY: Flag.LATE | Flag.OVERRUN | Flag.FAULT | Flag.STUCK | Flag.ERROR,
}
_ENDS = ("source", "target", "size", "limit")
_UNUSED: dict[int, tuple[str, ...]] = {Kind.RUN: ("channel",), Kind.DONE: _ENDS, Kind.STOP: (*_ENDS, "channel")}
_UNUSED |= dict.fromkeys((Kind.INPUT, Kind.OUTPUT), ("limit", "channel"))  # fields of operations that mean nothing
_ACTIONS = {HealthAction.SWITCH: 1, HealthAction.RESTART: 2, HealthAction.STOP: 3}
_MOST = 1 << 20


@record
class Operation:
    """One operation, `at` ticks from the job's start; its numbers as in the runtime's header."""

    at: int
    order: int
    kind: int
    source: int
    target: int
    size: int
    limit: int
    channel: int
    hart: int
    rank: int
    ranks: int


def tables_of(target: Target, site: Site) -> Tables:
    """Return the reader of the operation tables in the program of a bundle."""
    drivers = (driver.function for driver in read_drivers(target.bundle))
    return Tables(load_program(target.bundle, site), target.model, drivers)


def wrong_operations(
    target: Target, site: Site, expectation: Expectation, images: Mapping[tuple[str, str, str], Image]
) -> Iterator[Diagnostic]:
    """Yield where the tables in the program are not those that the schedule asks for."""
    at, reader = target.bundle.at("bundle.elf"), tables_of(target, site)
    try:
        for index, table in enumerate(site.tables):
            (played,) = tables_named(target.schedule, [table.name])
            jobs = expectation.jobs([played])
            for path, message in reader.deviations(index, table.length, jobs, images):
                yield WRONG_OPERATIONS(message, at=at, path=path or f'table "{table.name}"', help=AGAIN)
        for message in reader.switches(target.schedule):
            yield WRONG_OPERATIONS(message, at=at, path="hp_switches", help=AGAIN)
        for message in reader.health(target.model, target.schedule):
            yield WRONG_OPERATIONS(message, at=at, path="hp_rules", help=AGAIN)
    except (struct.error, LookupError) as failure:
        yield WRONG_OPERATIONS(f"its tables cannot be read: {failure}", at=at, help=AGAIN)


PER_SLOT = 5
"""Instructions by which an operation takes longer for each slot beyond those of the units."""


class Tables:
    """Reads the tables of a program by their symbols and addresses."""

    def __init__(self, program: Program, model: TaskModel, drivers: Iterable[str] = ()) -> None:
        self._program, self._model = program, model
        self._drivers = {program.symbols[name][0]: name for name in drivers if name in program.symbols}
        self._programs: dict[int, list[Operation]] = {}
        self._releases: dict[int, list[tuple[int, int]]] = {}

    def _at(self, address: int, form: struct.Struct) -> tuple[int, ...]:
        found = stored(self._program, address, form.size)
        if found is None:
            raise LookupError(f"nothing is stored at {address:#x}")
        return form.unpack(found)

    def _symbol(self, name: str) -> int:
        return self._program.symbols[name][0]

    def program(self, number: int) -> tuple[int, ...]:
        """Return where its operations are, their number, its slot, its first health rule, and the numbers of both."""
        return self._at(self._symbol("hp_programs") + number * _PROGRAM.size, _PROGRAM)

    def health(self, model: TaskModel, schedule: Schedule) -> Iterator[str]:
        """Yield which health rules are not those of the model: in the order of their tasks, then as in the model."""
        modes = [mode.name for mode in schedule.modes]
        first = 0
        for place, (number, rule) in enumerate(sorted(enumerate(model.health), key=lambda entry: entry[1].task)):
            mode = modes.index(rule.mode) if rule.mode in modes else _NO_TABLE
            wanted = (first, mode, number, _EVENTS[rule.event], rule.count, rule.cycles, _ACTIONS[rule.action])
            found = self._at(self._symbol("hp_rules") + place * _RULE.size, _RULE)
            if found != wanted:
                yield f"rule {place} is {found}, that of the model is {wanted}"
            first += rule.count

    def releases(self, index: int) -> list[tuple[int, int]]:
        """Return the tick and the program of every job that a table releases, by row."""
        if index not in self._releases:
            base, _, count, _ = self._at(self._symbol("hp_tables") + index * _TABLE.size, _TABLE)
            rows = (self._at(base + row * _RELEASE.size, _RELEASE) for row in range(min(count, _MOST)))
            self._releases[index] = [(tick, program) for tick, program in rows]
        return self._releases[index]

    def has(self, entry: Record | Abandoned) -> bool:
        """Whether the operation that a record names is one of the job that it names."""
        try:
            program = self.releases(entry.table)[entry.release][1]
            operation = self.operations(entry.program)[entry.operation]
        except LookupError:
            return False
        known = program == entry.program and entry.hart == operation.hart
        return known and entry.kind in (operation.kind, Kind.HEALTH)

    def slot(self, number: int) -> int | None:
        """Return the slot in which a program is in progress; None if that may be the next one."""
        _, _, slot, _, _, slots = self.program(number)
        return slot if slots == 1 else None

    def further_slots(self, site: Site) -> int:
        """Return how many slots there are beside one for each unit."""
        size = self._program.symbols["hp_programs"][1]
        programs = [self.program(number) for number in range(size // _PROGRAM.size)]
        return max([0, *(program[2] + program[5] - len(site.units) for program in programs)])

    def driver(self, number: int) -> str:
        """Return the function that is called for a number."""
        (address,) = self._at(self._symbol("hp_drivers") + number * _ADDRESS.size, _ADDRESS)
        return self._drivers.get(address, hex(address))

    def rules(self, number: int) -> tuple[int, int]:
        """Return the first health rule of a program, 0 if it has none, and their number."""
        _, _, _, first, count, _ = self.program(number)
        return (first if count else 0), count

    def operations(self, number: int) -> list[Operation]:
        """Return a program of the runtime."""
        if number not in self._programs:
            base, count, *_ = self.program(number)
            found = []
            for i in range(min(count, _MOST)):
                key, source, target, size, limit, kind, channel, unit, *ranks = self._at(
                    base + i * _OPERATION.size, _OPERATION
                )
                found.append(Operation(key >> 2, key & 3, kind, source, target, size, limit, channel, unit + 1, *ranks))
            self._programs[number] = found
        return self._programs[number]

    def deviations(
        self, index: int, length: int, jobs: Sequence[PlannedJob], images: Mapping[tuple[str, str, str], Image]
    ) -> Iterator[tuple[str, str]]:
        """Yield path and message of what a table has otherwise than the plan."""
        ticks = self._at(self._symbol("hp_tables") + index * _TABLE.size, _TABLE)[1]
        if ticks != length:
            yield "", f"lasts {ticks} ticks, target.json says {length}"
        releases = self.releases(index)
        if any(later[0] < earlier[0] for earlier, later in pairwise(releases)):
            yield "", "its releases are not in the order of time"
        left = list(releases)
        named = sorted(rule.task for rule in self._model.health)
        for job in jobs:
            wanted = _wanted(job, images)
            here = [release for release in left if release[0] == job.begin]
            fitting = [r for r in here if _found(self.operations(r[1]), job, self.driver) == wanted]
            if fitting:
                left.remove(fitting[0])
                own = (named.index(job.job.task), named.count(job.job.task)) if job.job.task in named else (0, 0)
                if self.rules(fitting[0][1]) != own:
                    yield job.path, f"has health rules {self.rules(fitting[0][1])} (first, number), not {own}"
                continue
            if not here:
                yield job.path, f"is not released at its start, tick {job.begin}"
                continue
            options = [_found(self.operations(number), job, self.driver) for _, number in here]
            nearest = min(options, key=lambda found: ((found - wanted) + (wanted - found)).total())
            lacking, more = wanted - nearest, nearest - wanted
            yield job.path, f"its operations lack {_shown(lacking)} and have {_shown(more)} instead"
        if len(releases) != len(jobs):
            yield "", f"releases {len(releases)} jobs, the schedule has {len(jobs)}"

    def switches(self, schedule: Schedule) -> Iterator[str]:
        """Yield what a request would lead to that it must not lead to."""
        modes = [mode.name for mode in schedule.modes]
        tables = {(t.source, t.target): len(modes) + i for i, t in enumerate(schedule.transitions)}
        if len(modes) == 1:
            return  # there is none, and the linker leaves their table out
        for i, source in enumerate(modes):
            for j, target in enumerate(modes):
                place = self._symbol("hp_switches") + _INDEX.size * (i * len(modes) + j)
                (found,) = self._at(place, _INDEX)
                if found != tables.get((source, target), _NO_TABLE):
                    yield f'from "{source}" to "{target}" leads to table {found}'
        for (_, target), index in tables.items():
            following = self._at(self._symbol("hp_tables") + index * _TABLE.size, _TABLE)[3]
            if following != modes.index(target):
                yield f"table {index} is followed by table {following}, not by {modes.index(target)}"


_Key = tuple[str, *tuple[int, ...]]


def _wanted(job: PlannedJob, images: Mapping[tuple[str, str, str], Image]) -> Counter[_Key]:
    """Return the operations that a job has to have; of transfers the phase is stated, for each begins as it can."""
    wanted: Counter[_Key] = Counter()
    units = {images[job.job.task, job.job.version, unit].hart: unit for unit in job.job.units}
    for t in job.transfers:
        begin, end = t.begin - job.begin, t.end - job.begin
        wanted["copy", t.source, t.target, t.size, t.channel, t.hart, begin, end] += 1
        wanted["done", t.channel, end, next(iter(units))] = 1
    for call in job.calls:
        word = "input" if call.driver.kind is AccessKind.READ else "output"
        wanted[f"{word} {call.driver.function}", call.data, call.size, call.begin - job.begin] += 1
    for e in job.executions:
        begin, end = e.begin - job.begin, e.end - job.begin
        symbols = images[job.job.task, job.job.version, units[e.hart]].program.symbols
        low, high = (symbols.get(name, (0, 0))[0] for name in BSS)
        clear = (low, high - low) if e.stretch == 0 else (0, 0)
        wanted["run", begin, e.hart, e.function, end - begin, e.rank, e.ranks, *clear] += 1
        wanted["stop", end, e.hart] += 1
    return wanted


def _found(operations: Sequence[Operation], job: PlannedJob, driver: Callable[[int], str]) -> Counter[_Key]:
    found: Counter[_Key] = Counter()
    phases = {(t.begin - job.begin, t.end - job.begin, t.channel) for t in job.transfers}
    for number, o in enumerate(operations):
        if any(getattr(o, name) for name in _UNUSED.get(o.kind, ())) or (
            o.kind != Kind.RUN and (o.rank, o.ranks) != (0, 1)
        ):
            found["not zero where nothing is meant: operation", number] += 1
        if o.kind == Kind.COPY:
            begin, end = next(
                ((b, e) for b, e, c in phases if c == o.channel and b <= o.at < e), (o.at, o.at + o.limit)
            )
            within = o.at + o.limit <= end
            found["copy", o.source, o.target, o.size, o.channel, o.hart, begin, end if within else o.at + o.limit] += 1
        elif o.kind == Kind.DONE:
            found["done", o.channel, o.at, o.hart] = 1
        elif o.kind == Kind.RUN:
            clear = (o.target, o.size) if o.target or o.size else (0, 0)
            found["run", o.at, o.hart, o.source, o.limit, o.rank, o.ranks, *clear] += 1
        elif o.kind == Kind.STOP:
            found["stop", o.at, o.hart] += 1
        elif o.kind in (Kind.INPUT, Kind.OUTPUT):
            word = "input" if o.kind == Kind.INPUT else "output"
            found[f"{word} {driver(o.source)}", o.target, o.size, o.at] += 1
    return found


def _shown(operations: Counter[_Key]) -> str:
    each = [f"{key[0]} {' '.join(hex(n) if n > 1 << 20 else str(n) for n in key[1:])}" for key in operations]
    return few(sorted(each), 3, quote="", between="; ") or "nothing"
