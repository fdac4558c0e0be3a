"""Co-simulation: a bundle on a simulated board, in a closed loop with a plant."""

from __future__ import annotations

import struct
from bisect import bisect_right
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about
from halpipe.core.durations import Duration, seconds
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.deploy.riscv.board.elf import Program, read_program
from halpipe.deploy.riscv.board.hart import NEVER
from halpipe.deploy.riscv.board.machine import MANAGEMENT, RUBBISH, Budget, Machine
from halpipe.deploy.riscv.codes import BAD_REQUEST, BROKEN_PROGRAM, BROKEN_TARGET, ENGINE_ABSENT
from halpipe.deploy.riscv.judge.contents import BSS
from halpipe.deploy.riscv.run.drivers import REQUEST, RETURN, Call, Plant, places, read_drivers, without_drivers
from halpipe.deploy.riscv.run.expectation import Expectation, Image, PlannedJob
from halpipe.deploy.riscv.run.observation import Execution, Observations, Recorder, Trap
from halpipe.deploy.riscv.run.recording import Memory, Recording, Word, meaning, read_recording
from halpipe.deploy.riscv.run.regulators import RegulatorPort, Regulators, regulators_playing
from halpipe.deploy.riscv.run.sequence import Played, Request, tables_named
from halpipe.deploy.riscv.target import CONTROL_SIZE, Area, Site, read_site
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.registers import Protection
    from halpipe.deploy.riscv.run.injection import Saboteur

PROGRAM = "bundle.elf"
MAGIC = 0x48414C5049504531
EXECUTIONS = ("real", "modelled")
BOOT = seconds(Fraction(1, 1000))
"""From the start of the machine to the beginning of the run."""

RUNNING, FINISHED = 1, 2
PRINTED = 50
"""Records of a report that the simulation has the runtime print."""

MEASURING = "runtime/calibrate.c"
"""The source of runtimes that measure their target before the run, for up to a second."""


@record
class TableSeen:
    """A table that was played: where it begins by the lengths of those before it, and when it was seen to begin."""

    start: Duration
    name: str
    seen: Duration


@dataclass(slots=True)
class Run:
    """Observations of a run. Instants of executions and transfers are in units of the machine; `since` converts."""

    site: Site
    rate: int
    tick: int
    zero: int | None
    state: int
    duration: Duration
    tables: list[TableSeen]
    recorder: Observations
    recording: Recording
    memory: Memory
    protections: dict[int, Protection]
    uart: bytes
    instructions: int
    is_modelled: bool
    exhausted: str = ""
    regulators: Regulators | None = None  # that the runtime has started
    requests: list[Request] = field(default_factory=list)
    status: int | None = None  # with which the runtime ended the emulation
    slowness: Fraction = Fraction(1)  # of its instructions, in those of the profile

    @property
    def executions(self) -> list[Execution]:
        """Every function of a job that a core entered, in that order."""
        return self.recorder.executions

    @property
    def faults(self) -> list[Trap]:
        """Every exception that a core took."""
        return self.recorder.traps

    def since(self, instant: int) -> Duration:
        """Return an instant of the machine as the time since the beginning of the run."""
        return Duration(Fraction((instant - (self.zero or 0)) * 10**9, self.rate))

    def length(self, units: int) -> Duration:
        """Return a number of units as a duration."""
        return Duration(Fraction(units * 10**9, self.rate))

    def reason(self, job: PlannedJob) -> str:
        """Return what the runtime recorded when it abandoned a job, empty if it did not."""
        harts = {execution.hart for execution in job.executions}
        for abandoned in self.recording.abandoned:
            if (
                abandoned.cycle == job.table.cycle
                and abandoned.hart in harts
                and job.begin <= abandoned.time <= job.end + 1
            ):
                return f"{meaning(abandoned.flags)}, at {self.since((self.zero or 0) + abandoned.time * self.tick)}"
        return ""

    def word(self, number: int) -> int:
        """Return a word of the control block, as it was at the end."""
        return self.memory.word(self.site.control + 8 * number)


class CoSimulation:
    """A bundle on a simulated board: one emulated core per hart, each with a clock of its own.

    Transfers pass the tables of the regulators in the bundle, if it has any that grant bytes in windows.
    `tables` is the number of tables to play (0: until the plant stops the run), `requests` are mode requests at their
    instants from the beginning of the run. `execution` is ``real`` (every job takes the instructions that it has) or
    ``modelled`` (it ends when its time in the schedule is over). `cpi` are cycles per instruction, by default those of
    the profile. `budget` ends a run that goes round in circles, and a `saboteur` has jobs and transfers fail; without
    `health` no rule of the model follows from that. Drivers return at once: the plant takes their place. Modes that
    tasks ask for are taken if it `hears` them.
    """

    def __init__(
        self,
        target: Target,
        *,
        plant: Plant | None = None,
        requests: Iterable[tuple[Duration, str]] = (),
        cycles: int = 0,
        first: str = "",
        execution: str = "real",
        cpi: Fraction | int | None = None,
        budget: Budget | None = None,
        saboteur: Saboteur | None = None,
        health: bool = True,
        hears: bool = True,
    ) -> None:
        self.site = read_site(target.bundle)
        self.images = read_images(target.bundle, self.site)
        self._target = target
        self._modes = [mode.name for mode in target.schedule.modes]
        self._plant = plant or Plant()
        self._cycles = cycles
        self._first = first or self._modes[0]
        self._execution = execution
        self._requests = sorted((Request(instant, mode) for instant, mode in requests), key=lambda r: r.instant)
        self._refuse_nonsense(1 if cpi is None else cpi)
        self._slowness = Fraction(1) if cpi is None else cpi / min(self.site.cpi, self.site.management_cpi)
        program = load_program(target.bundle, self.site)
        self.program = program
        self._recorder = Recorder(self.site, list(self.images.values()), self._told)
        try:
            rates = self._bandwidths()
            self._machine = Machine(
                self.site, program, self._recorder, bandwidths=rates, cpi=cpi, budget=budget, others=self._beside
            )
        except ModuleNotFoundError:
            help = "pip install ziglang pyelftools unicorn"
            raise HalpipeError(ENGINE_ABSENT("the package unicorn is not installed", help=help)) from None
        self._recorder.attach(self._machine)
        self._attend(hears=hears)
        self._recorder.before_read = self._before_read
        self._recorder.after_write = self._after_write
        self._saboteur = saboteur
        self._health = health
        if saboteur is not None:
            saboteur.memory = self._machine.memory
            self._recorder.begins = self._sabotage
            self._recorder.ends = saboteur.ended
            self._machine.fate = saboteur.fate
        self._memory = self._machine.memory
        self._zero: int | None = None
        self._tables: list[TableSeen] = []
        self._next = 0  # instant at which the next table begins, in units from the beginning of the run
        self._made: list[Request] = []
        self._asked: list[tuple[int, int]] = []
        self._leaves = self._astray = 0

    def _beside(self, machine: Machine) -> list[RegulatorPort]:
        """Put the regulators between DMA engine and memory; return their registers if the runtime has them."""
        self._regulators = regulators_playing(self._target, self.site, machine.timing.rate)
        if self._regulators is not None:
            machine.gate = self._regulators.gate
            if self._regulators.base:
                self.port = RegulatorPort(self._regulators, machine.timing, machine.gates_changed)
                return [self.port]
        return []

    def _attend(self, *, hears: bool) -> None:
        """Put the plant in the place of the drivers, and have the runtime take what tasks ask for, or not."""
        drivers = read_drivers(self._target.bundle)
        self._sampled = {driver.buffer: driver.kind for driver in drivers}
        self._buffers = {area.base: name for name, area in self.site.buffers.items()}
        known = places(self._target.bundle, self.program, drivers)
        for address, name in known.items():
            if not (hears and name == REQUEST):
                self._machine.overwrite(MANAGEMENT, self.program.source(address), RETURN)
        if known:
            self._recorder.watch_drivers(known)
            self._recorder.drives = self._drives

    def _bandwidths(self) -> dict[tuple[int, str], int]:
        """Return the bandwidth of every channel into each memory: that of the engine, or of a slower resource."""
        limits = {r.name: r.bandwidth for r in self._target.model.resources}
        return {
            (channel, memory): min(limits.get(name) or most, most)
            for name, channel in self.site.channels.items()
            for memory, most in self.site.dma.bandwidth.items()
        }

    def _refuse_nonsense(self, cpi: Fraction | int) -> None:
        findings = Findings()
        for mode in [self._first, *(request.mode for request in self._requests)]:
            self._check_mode(mode, findings)
        if self._execution not in EXECUTIONS:
            help = did_you_mean(self._execution, EXECUTIONS, "choose real or modelled")
            findings.add(BAD_REQUEST(f'there is no execution "{self._execution}"', help=help))
        if cpi < 1 or self._cycles < 0:
            findings.add(BAD_REQUEST("a number of cycles is not positive", help="give a positive number"))
        findings.stop_on_errors()

    def _check_mode(self, mode: str, findings: Findings) -> None:
        if mode not in self._modes:
            help = did_you_mean(mode, self._modes, "the modes are " + ", ".join(self._modes))
            findings.add(BAD_REQUEST(f'there is no mode "{mode}"', help=help))

    # ------------------------------------------------------------------------------------------ running

    @property
    def calibrates(self) -> bool:
        """Whether the runtime measures its target before the run."""
        return MEASURING in self._target.bundle.files

    def break_down(self) -> int:
        """Put an illegal instruction where the management core's program in C begins, and return that address."""
        address = self.program.symbols.get("runtime", (self.program.entry, 0))[0]
        self._machine.overwrite(MANAGEMENT, self.program.source(address), bytes(4))
        return address

    def break_monitor(self) -> None:
        """Put an illegal instruction where the monitor of the first core begins, before it is put there."""
        row = self.program.source(self.program.symbols["hp_units"][0])
        self._machine.overwrite(MANAGEMENT, self._memory.word(row + 16), bytes(4))

    def disturb(self) -> None:
        """Have every core wake up from each sleep without a cause first, as the architecture allows."""
        for hart in self._machine.harts:
            hart.is_restless = True

    def overtake(self) -> None:
        """Have the time of every core's first job be over before it begins."""
        for hart in self._machine.harts[1:]:
            hart.is_overdue = True

    def misdirect(self) -> None:
        """State the mode behind the last one as the first."""
        self._astray = len(self._modes)

    def withdraw_user_mode(self) -> None:
        """Have the application cores be cores without user mode."""
        for hart in self._machine.harts:
            hart.has_user_mode = False

    def run(self, limit: Duration | None = None, *, is_cold: bool = False, leaves: int = 0) -> Run:
        """Play the tables and return what was seen; `limit` (from the beginning of the run) ends it in any case.

        A run that `is_cold` begins as after power-on, with unprepared main memory. At its end it prints a report
        and `leaves` in that way of the control block; 0: neither.
        """
        self._leaves = leaves
        offset = int(BOOT / self.site.tick) or 1
        if is_cold:
            for area in (Area(self.site.control, CONTROL_SIZE), *self.site.buffers.values()):
                self._memory.write(area.base, RUBBISH * area.size)
        else:
            self._prepare(offset)
        self._plant.start(self)
        end = NEVER
        if limit is not None:
            before = offset + 1000 * len(self.site.units) + (self.site.timebase if self.calibrates else 0)
            end = self._units(limit) + before * self._machine.timing.tick
        self._machine.run(end)
        return self._result()

    def _prepare(self, offset: int) -> None:
        first, execution = self._modes.index(self._first) + self._astray, EXECUTIONS.index(self._execution)
        words = (MAGIC, self._cycles, execution, first, bool(self._leaves), self._leaves, offset, not self._health)
        self._memory.write(self.site.control, struct.pack("<8Q", *words))

    def _result(self) -> Run:
        machine = self._machine
        now = max(hart.now for hart in machine.harts) if self._zero is None else machine.management.now - self._zero
        return Run(
            site=self.site,
            slowness=self._slowness,
            rate=machine.timing.rate,
            tick=machine.timing.tick,
            zero=self._zero,
            state=self._memory.word(self.site.control + 8 * Word.STATE),
            duration=self._duration(now),
            tables=self._tables,
            recorder=self._recorder,
            recording=read_recording(self._memory, self.site),
            memory=self._memory,
            protections={hart.number: hart.protection for hart in machine.harts if hart.number != MANAGEMENT},
            uart=bytes(machine.uart.text),
            instructions=sum(hart.count for hart in machine.harts),
            is_modelled=self._execution == EXECUTIONS[1],
            exhausted=machine.exhausted,
            status=machine.status,
            regulators=self._regulators if self._regulators is not None and self._regulators.base else None,
            requests=sorted([*self._made, *self._of_tasks()], key=lambda request: request.instant),
        )

    def _of_tasks(self) -> Iterator[Request]:
        """Yield what tasks asked for, at the instants at which it counts: where the plan has their phases end."""
        if not self._asked:
            return
        seen = tables_named(self._target.schedule, [table.name for table in self._tables])
        expectation = Expectation(self._target.bundle, self._target.model, self.site, self.images)
        jobs = expectation.jobs(seen)
        due = sorted(call.begin for job in jobs for call in job.calls if call.driver.function == REQUEST)
        for now, value in self._asked:
            tick = (now - (self._zero or 0)) // self._machine.timing.tick
            place = bisect_right(due, tick)
            mode = self._modes[value - 1] if value <= len(self._modes) else f"mode {value}"
            yield Request(self.site.tick * (due[place - 1] if place else tick), mode)

    def _duration(self, units: int) -> Duration:
        return Duration(Fraction(units * 10**9, self._machine.timing.rate))

    def _units(self, duration: Duration) -> int:
        return int(duration.in_unit("s") * self._machine.timing.rate)

    def _set(self, word: int, value: int) -> None:
        self._memory.put_word(self.site.control + 8 * word, value)

    # ------------------------------------------------------------------------------------------ following the run

    def _told(self, word: int, value: int, now: int) -> None:
        if word == Word.STATE:
            self._recorder.states.append(value)
        if word == Word.STATE and value not in (0, RUNNING):
            if self._leaves:  # the first records show how they are printed, and a full ring how older ones are left out
                traced, faults = (self._memory.word(self.site.control + 8 * w) for w in (Word.TRACED, Word.FAULTS))
                self._set(Word.TRACED, min(traced, PRINTED))
                self._set(Word.FAULTS, faults + self.site.faults.capacity * bool(faults))
            else:
                self._machine.stop()
        elif word == Word.STATE and value == RUNNING:
            self._begin()
        elif word == Word.REQUEST and value:
            self._asked.append((now, value))
        elif word == Word.REQUEST and self._zero is not None:
            self._recorder.decisions.append((now, self._machine.management.woken))
        elif word == Word.TABLE and self._zero is not None:
            self._table(value, now)
        elif word == Word.TRACED and value:
            self._recorder.traced.append((now, self._machine.management.woken))

    def _begin(self) -> None:
        base = self._memory.word(self.site.control + 8 * Word.BASE)
        self._zero = base * self._machine.timing.tick
        if self._saboteur is not None:
            self._saboteur.zero, self._saboteur.tick = self._zero, self._machine.timing.tick
        for request in self._requests:
            instant = self._zero + self._units(request.instant)
            self._machine.at(instant, partial(self._request, request.mode, instant))

    def _table(self, index: int, seen: int) -> None:
        """A table begins: where, follows from the lengths of those before it."""
        if index >= len(self.site.tables):
            return
        table = self.site.tables[index]
        if self._regulators is not None and not self._regulators.base:
            self._regulators.begin(table.name, (self._zero or 0) + self._next)
            self._machine.gates_changed()
        now = self._duration(self._next)
        cycle = len(self._tables)
        self._tables.append(TableSeen(now, table.name, self._duration(seen - (self._zero or 0))))
        self._next += table.length * self._machine.timing.tick
        self._plant.cycle(self, now, cycle, table.name)

    def _sabotage(self, execution: Execution) -> None:
        assert self._saboteur is not None
        code = self._saboteur.code(execution)
        if code:
            self._machine.overwrite(execution.hart, execution.function, code)

    def _drives(self, call: Call) -> None:
        """A driver is called: what it would exchange with a device, it exchanges with the plant."""
        buffer = self._buffers.get(call.data, "")
        now = self._duration(call.now - (self._zero or 0))
        if self._sampled.get(buffer) is AccessKind.READ:
            self._plant.reads(self, now, buffer)
        elif buffer in self._sampled:
            self._plant.written(self, now, buffer)

    def _before_read(self, buffer: str, now: int) -> None:
        if self._zero is not None and self._sampled.get(buffer) is not AccessKind.READ:
            self._plant.reads(self, self._duration(now - self._zero), buffer)

    def _after_write(self, buffer: str, now: int) -> None:
        if self._zero is not None and self._sampled.get(buffer) is not AccessKind.WRITE:
            self._plant.written(self, self._duration(now - self._zero), buffer)

    # ------------------------------------------------------------------------------------------ the board

    def read(self, buffer: str) -> bytes:
        """Return what a buffer holds."""
        area = self.site.buffers[buffer]
        return self._memory.read(area.base, area.size)

    def write(self, buffer: str, data: bytes) -> None:
        """Put `data` at the beginning of a buffer; more than it holds is a fault of the plant (``ValueError``)."""
        area = self.site.buffers[buffer]
        if len(data) > area.size:
            raise ValueError(f'buffer "{buffer}" has {area.size} bytes, not {len(data)}')
        self._memory.write(area.base, data)
        self._recorder.stored(buffer, data)

    def request(self, mode: str) -> None:
        """Put a mode into the mailbox."""
        findings = Findings()
        self._check_mode(mode, findings)
        findings.stop_on_errors()
        self._request(mode, self._machine.management.now)

    def _request(self, mode: str, now: int) -> None:
        self._made.append(Request(self._duration(now - (self._zero or 0)), mode))
        self._set(Word.REQUEST, self._modes.index(mode) + 1)

    def stop(self) -> None:
        """End the run now."""
        self._machine.stop()


def plan(target: Target, site: Site, tables: Iterable[Played]) -> list[PlannedJob]:
    """Return the jobs of tables that are played, as the model and the schedule of a bundle have them."""
    return Expectation(target.bundle, target.model, site, read_images(target.bundle, site)).jobs(tables)


def silent(target: Target) -> bytes:
    """Return the program of a bundle with drivers that return at once."""
    content = target.bundle.files[PROGRAM]
    drivers = read_drivers(target.bundle)
    if not drivers:
        return content
    program = read_program(content, target.bundle.at(PROGRAM))
    return without_drivers(content, places(target.bundle, program, drivers))


def load_program(bundle: Bundle, site: Site) -> Program:
    """Return the one program of a bundle; raise `HalpipeError` unless all of it lies in the memories of the target."""
    at = bundle.at(PROGRAM)
    help = "export the bundle again"
    if PROGRAM not in bundle.files:
        raise HalpipeError(BROKEN_PROGRAM(f"the bundle has no {PROGRAM}", at=at, help=help))
    program = read_program(bundle.files[PROGRAM], at)
    findings = Findings()
    for segment in program.segments:
        if not (site.main.base <= segment.source and segment.source + len(segment.data) <= site.main.end):
            message = f"{len(segment.data)} bytes at {segment.source:#x} are not in main memory"
            findings.add(BROKEN_PROGRAM(message, at=at, help=help))
    if program.entry != site.entry:
        message = f"it begins at {program.entry:#x}, target.json says {site.entry:#x}"
        findings.add(BROKEN_PROGRAM(message, at=at, help=help))
    findings.stop_on_errors()
    return program


def _misplaced(program: Program, memories: Iterable[Area]) -> Iterator[str]:
    """Yield what of an image lies in none of the memories of its core."""
    low, high = (program.symbols.get(name, (0, 0))[0] for name in BSS)
    for begin, size in [*((segment.target, segment.size) for segment in program.segments), (low, high - low)]:
        if size > 0 and not any(area.base <= begin and begin + size <= area.end for area in memories):
            yield f"{size} bytes at {begin:#x} are not in the scratchpads of its core"


def read_images(bundle: Bundle, site: Site) -> dict[tuple[str, str, str], Image]:
    """Return the images of a bundle by task, version and unit; raise `HalpipeError` with all that cannot be used."""
    findings = Findings()
    found = {}
    for image in site.images:
        at: Location = bundle.at(image.file)
        if image.file not in bundle.files:
            help = "export the bundle again"
            findings.add(BROKEN_TARGET(f'names "{image.file}", which is not in the bundle', at=at, help=help))
            continue
        try:
            program = read_program(bundle.files[image.file], at)
        except HalpipeError as failure:
            findings.extend(failure.diagnostics)
            continue
        unit = site.unit(image.unit)
        for message in _misplaced(program, (unit.ispm, unit.dspm)):
            findings.add(BROKEN_PROGRAM(message, at=at, path=about(unit=unit.name), help="export the bundle again"))
        found[image.task, image.version, image.unit] = Image(image, program, unit.hart)
    findings.stop_on_errors()
    return found
