"""Operations of the management core: programs, tables of releases, and how late each may be."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, Location, about
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor, milliseconds
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import OFF_GRID, PHASE_ORDER, PHASE_TOO_SHORT, WATCHDOG_SHORT
from halpipe.exporters.riscv.copies import Copies, Turn, lines_of
from halpipe.exporters.riscv.cores import MainMemory, Shape, Slots, shape_of
from halpipe.exporters.riscv.drivers import NONE, Drivers
from halpipe.exporters.riscv.phases import (
    COPIES,
    Clock,
    disorder,
    executions,
    functions_of,
    memory_of,
    phases_of,
    shares,
)
from halpipe.exporters.riscv.render import DECISION
from halpipe.models import Access, AccessKind, Job, Schedule

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.exporters.riscv.images import Image, Part
    from halpipe.exporters.riscv.profile import Profile

COPY, DONE, RUN, STOP = "copy", "done", "run", "stop"
INPUT, OUTPUT = "input", "output"
_ORDER = {DONE: 0, STOP: 0, OUTPUT: 0, RUN: 1, INPUT: 2, COPY: 2}


@record(kw_only=True)
class Operation:
    """One operation, `at` ticks after the job's start. What the fields of each kind mean is in runtime/halpipe.h.

    A transfer knows its phase, and how many ticks it and those after it in the phase need; with `is_copy` it is between
    buffers in main memory. A driver takes up to `time`, beyond what every operation does.
    """

    at: int
    kind: str
    unit: int
    channel: int = 0
    source: int = 0
    target: int = 0
    size: int = 0
    limit: int = 0
    rank: int = 0
    ranks: int = 1
    what: str = ""
    access: Access | None = None
    needs: int = 0
    time: Duration = ZERO
    is_copy: bool = False

    @property
    def key(self) -> tuple[int, int]:
        """Its place among the operations of its program, and at equal ticks among all."""
        return self.at, _ORDER[self.kind]


@record
class Program:
    """Operations for one job of a version on its units (core indices; the first leads), in a slot of the runtime."""

    task: str
    version: str
    units: tuple[int, ...]
    operations: tuple[Operation, ...]
    slot: int
    slots: int


@record
class Release:
    """A job of a table: starts at `tick`, and is done by `program` (index)."""

    tick: int
    program: int
    job: Job


@record
class Table:
    """A mode, or the transition from mode `origin` to mode `target` (indices of modes)."""

    name: str
    origin: int
    target: int
    length: int
    releases: tuple[Release, ...]

    @property
    def is_mode(self) -> bool:
        """Whether the table repeats."""
        return self.origin == self.target


@dataclass(slots=True)
class Operations:
    """The programs and tables of a schedule, made of images by their (task, version, unit)."""

    clock: Clock
    channels: dict[str, int]
    memory: MainMemory
    images: dict[tuple[str, str, str], Image]
    slots: Slots
    drivers: Drivers = NONE
    copies: Copies = field(default_factory=Copies)
    programs: list[Program] = field(default_factory=list)
    _known: dict[tuple[str, str, tuple[str, ...], Shape], int] = field(default_factory=dict)

    def tables(self, schedule: Schedule) -> list[Table]:
        """Return all tables, modes first."""
        index = {mode.name: i for i, mode in enumerate(schedule.modes)}
        found = [
            Table(m.name, index[m.name], index[m.name], self.clock.up(m.hyperperiod), self._releases(m.jobs))
            for m in schedule.modes
        ]
        return found + [
            Table(t.name, index[t.source], index[t.target], self.clock.up(t.length), self._releases(t.jobs))
            for t in schedule.transitions
        ]

    def _releases(self, jobs: Iterable[Job]) -> tuple[Release, ...]:
        found = [Release(self.clock.up(self.copies.release(job)), self._program(job), job) for job in jobs]
        return tuple(sorted(found, key=lambda r: (r.tick, self.programs[r.program].units, r.job.task, r.job.index)))

    def _program(self, job: Job) -> int:
        images = [self.images[job.task, job.version, unit] for unit in job.units]
        shape = shape_of(job, images[0].part.version, job.start - self.copies.release(job))
        key = (job.task, job.version, job.units, shape)
        if key not in self._known:
            self._known[key] = len(self.programs)
            operations = sorted(self._operations(images, shape), key=lambda o: o.key)
            units = tuple(image.core.index for image in images)
            slot, slots = self.slots.of(job.task, units[0]), self.slots.number(job.task, units[0])
            self.programs.append(Program(job.task, job.version, units, tuple(operations), slot, slots))
        return self._known[key]

    def _operations(self, images: list[Image], shape: Shape) -> Iterable[Operation]:
        part = images[0].part
        for turn in self.copies.of(part.task):
            if turn.sizes[part.version.name]:
                yield from self._copies(turn, images[0])
        for access in phases_of(part.version):
            yield from self._phase(access, images, shape)
        functions = functions_of(part.version)
        for position, (start, over) in enumerate(executions(part.version, len(functions))):
            begin_at, end_at = self.clock.up(shape.begin(start)), self.clock.down(shape.end(over))
            for rank, image in enumerate(images):
                begin, size = image.bss if position == 0 else (0, 0)
                stop = Operation(at=end_at, kind=STOP, unit=image.core.index, what=functions[position])
                entry, limit, ranks = image.entries[position], end_at - begin_at, len(images)
                run = replace(stop, at=begin_at, kind=RUN, source=entry, target=begin, size=size, limit=limit)
                yield from (replace(run, rank=rank, ranks=ranks), stop)

    def _phase(self, access: Access, images: list[Image], shape: Shape) -> Iterable[Operation]:
        """Yield the transfers of a phase, one after the other, and the check at its end that they are complete."""
        at, end = self.clock.up(shape.begin(access.start)), self.clock.down(shape.end(access.end))
        channel = self.channels[access.resource]
        transfers = list(self._transfers(access, images))
        drivers = list(self._drivers(access, images[0])) if not self.copies.of(images[0].part.task) else []
        yield from (replace(driver, at=at) for driver in drivers if driver.kind == INPUT)
        move = Operation(at=at, kind=COPY, unit=0, channel=channel, access=access)
        moves = [
            replace(move, source=source, target=target, size=size, unit=unit, what=what)
            for source, target, size, unit, what, _ in transfers
        ]
        times = [self.clock.transfer(access.resource, size, memory) for _, _, size, _, _, memory in transfers]
        yield from _in_turn(moves, times, end)
        at += sum(times)
        unit = images[0].core.index
        yield Operation(at=max(at, end), kind=DONE, unit=unit, channel=channel, what=str(access.kind))
        yield from (replace(driver, at=max(at, end)) for driver in drivers if driver.kind == OUTPUT)

    def _copies(self, turn: Turn, image: Image) -> Iterable[Operation]:
        """Yield the copies of a job at its release, or at release + LET, and the calls of the buffers' drivers."""
        part, channel, unit = image.part, self.channels[COPIES], image.core.index
        phases = [access for access in phases_of(part.version) if access.kind is turn.kind]
        drivers = [driver for access in phases for driver in self._drivers(access, image)]
        at = turn.at + turn.after
        end = at + turn.length
        yield from (replace(driver, at=at) for driver in drivers if driver.kind == INPUT)
        copy = Operation(at=at, kind=COPY, unit=unit, channel=channel, access=phases[0], is_copy=True)
        moves = []
        for buffer, size in turn.sizes[part.version.name].items():
            ends = self.memory.buffers[buffer].base, self.memory.shadows[part.task, turn.kind, buffer].base
            source, target = ends if turn.kind is AccessKind.READ else ends[::-1]
            moves.append(replace(copy, source=source, target=target, size=size, what=buffer))
        yield from _in_turn(moves, [self.clock.transfer(COPIES, move.size, "main") for move in moves], end)
        yield Operation(at=end, kind=DONE, unit=unit, channel=channel, what=f"LET {turn.kind}")
        yield from (replace(driver, at=end) for driver in drivers if driver.kind == OUTPUT)

    def _drivers(self, access: Access, image: Image) -> Iterable[Operation]:
        """Yield the calls of drivers in a phase, at no instant yet."""
        for driver in self.drivers.of(image.part.task, access):
            buffer = self.memory.buffers[driver.buffer]
            yield Operation(
                at=0,
                kind=INPUT if driver.kind is AccessKind.READ else OUTPUT,
                unit=image.core.index,
                source=self.drivers.functions.index(driver.function),
                target=buffer.base,
                size=buffer.size,
                what=f"{driver.function}, {driver.buffer}",
                time=driver.time,
            )

    def _transfers(self, access: Access, images: list[Image]) -> Iterable[tuple[int, int, int, int, str, str]]:
        """Yield (from, to, bytes, core, what, memory). Each member of a gang reads all, and writes its part."""
        if access.kind is AccessKind.LOAD:
            for image in images:
                for s in image.elf.segments:
                    yield s.source, s.target, s.size, image.core.index, "image", image.core.memory_at(s.target)
        for transfer in access.transfers:
            for member, offset, size in shares(access, transfer.size, len(images)):
                kind, task = access.kind or AccessKind.READ, images[0].part.task
                buffer = self.memory.place(task, kind, transfer.buffer).base + offset
                symbol = images[member].elf.symbols[transfer.symbol].address + offset
                ends = (symbol, buffer) if access.kind is AccessKind.WRITE else (buffer, symbol)
                yield *ends, size, images[member].core.index, transfer.buffer, memory_of(access)


def _in_turn(moves: Sequence[Operation], times: Sequence[int], end: int) -> Iterable[Operation]:
    """Yield transfers one after the other, from the instant of each on, with what is left of the phase for each."""
    after, rest = 0, sum(times)
    for move, taken in zip(moves, times, strict=True):
        at = move.at + after
        yield replace(move, at=at, limit=max(end - at, 0), needs=rest)
        after, rest = after + taken, rest - taken


def check_version(part: Part, clock: Clock, findings: Findings) -> None:
    """Collect what of a version leaves no order of execution."""
    why = disorder(part.version, len(functions_of(part.version)), clock)
    if why:
        help = (
            'let a job read, execute and write in this order, or name one function for each gap: entry="first second"'
        )
        findings.add(PHASE_ORDER(why, at=part.version.at, path=part.path, help=help))


def check_grid(schedule: Schedule, clock: Clock, findings: Findings) -> None:
    """Collect instants of the schedule that are no multiples of the tick."""
    instants: list[tuple[Duration, str, str, Location]] = []
    for mode in schedule.modes:
        path = about(mode=mode.name)
        instants.append((mode.hyperperiod, "the hyperperiod", path, mode.at))
        instants += _starts(mode.jobs, path)
    for table in schedule.transitions:
        path = about(transition_from=(table.source, table.target))
        instants.append((table.length, "the length", path, table.at))
        instants += _starts(table.jobs, path)
    for instant, what, within, at in instants:
        if greatest_common_divisor((instant, clock.tick)) != clock.tick:
            help = f"schedule with --tick {clock.tick}, or with periods that are multiples of it"
            message = f"{what} {instant} is no multiple of the timer's tick {clock.tick}"
            findings.add(OFF_GRID(message, at=at, path=within, help=help))


def _starts(jobs: Iterable[Job], path: str) -> list[tuple[Duration, str, str, Location]]:
    """Return the starts of jobs and of their parts, with what messages say of them."""
    found = []
    for job in jobs:
        where = f'{path}, job {job.index} of task "{job.task}"'
        found.append((job.start, "the start", where, job.at))
        found += [(part.start, "the start of a part", where, part.at) for part in job.parts[1:]]
    return found


_RELEASE, _DECIDE = 1, 3
"""The orders of a release or the end of a table, and of the look at the mailbox, among what is due at one tick."""


@record
class Backlog:
    """The greatest lateness of every operation, by (program, position), and of all in each table, by its index."""

    operations: dict[tuple[int, int], Duration]
    tables: dict[int, Duration]


def find_backlog(tables: Sequence[Table], programs: Sequence[Program], profile: Profile) -> Backlog:
    """Play every mode twice, and every switch between its modes."""
    found = Backlog({}, defaultdict(lambda: ZERO))
    for line in lines_of(tables):
        _play(line, tables, programs, profile, found)
    return found


def _play(
    line: Sequence[int], tables: Sequence[Table], programs: Sequence[Program], profile: Profile, found: Backlog
) -> None:
    """Serve all that is due on a line of tables, first come first served at equal ticks by their order."""
    due: list[tuple[int, int, int, Duration, tuple[int, int] | None]] = []  # tick, order, table, driver, operation
    start = 0
    for index in line:
        table = tables[index]
        for release in table.releases:
            due.append((start + release.tick, _RELEASE, index, ZERO, None))
            for position, operation in enumerate(programs[release.program].operations):
                tick, order = operation.key
                place = (release.program, position)
                due.append((start + release.tick + tick, order, index, operation.time, place))
        start += table.length
        due.append((start, _RELEASE, index, ZERO, None))
        if table.is_mode:
            due.append((start - DECISION, _DECIDE, index, ZERO, None))
    free = ZERO
    for tick, _, index, time, which in sorted(due, key=lambda d: d[:2]):
        instant = profile.tick * tick
        late = max(free - instant, ZERO)
        free = instant + late + profile.service + time
        found.tables[index] = max(found.tables[index], late)
        if which is not None:
            found.operations[which] = max(found.operations.get(which, ZERO), late)


def too_short(
    programs: Sequence[Program], backlog: Backlog, parts: Iterable[Part], profile: Profile
) -> Iterable[Diagnostic]:
    """Yield the phases that do not hold their transfers, given how late these may start."""
    owners = {(part.task, part.version.name): part for part in parts}
    told = set()
    for index, program in enumerate(programs):
        for position, operation in enumerate(program.operations):
            late = backlog.operations.get((index, position), ZERO)
            if operation.access is None or math.ceil(late / profile.tick) + operation.needs <= operation.limit:
                continue
            part = owners[program.task, program.version]
            key = (part.path, operation.access.start)
            if key not in told:
                told.add(key)
                yield _finding(part, operation, late, profile)


START = milliseconds(1)


def resets(tables: Sequence[Table], backlog: Backlog, profile: Profile) -> Iterable[Diagnostic]:
    """Yield the tables that may last longer than the time-out of the watchdog, which is written when each begins.

    The first begins before the run does, by what the runtime leaves to start.
    """
    if profile.watchdog is None:
        return
    for index, table in enumerate(tables):
        longest = profile.tick * table.length + backlog.tables[index] + profile.service + START * table.is_mode
        if profile.watchdog.timeout < longest:
            message = f'the time-out is {profile.watchdog.timeout}, and "{table.name}" may last {longest}'
            yield WATCHDOG_SHORT(message, path="watchdog", help=f"set the time-out to at least {longest}")


def _finding(part: Part, operation: Operation, late: Duration, profile: Profile) -> Diagnostic:
    assert operation.access is not None
    needed = profile.tick * operation.needs
    message = f"the {operation.access.kind} phase has {profile.tick * operation.limit}, its transfers need {needed}"
    if late:
        message += f", and the management core may begin them {late} late, for it has other operations to do"
    help = "run `halpipe deploy prepare` with the same profile and toolchain, and schedule the prepared model"
    return PHASE_TOO_SHORT(message, at=operation.access.at, path=part.path, help=help)
