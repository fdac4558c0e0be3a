"""Observation of a run by the simulator alone: executions, transfers, traps, data."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.deploy.riscv.board.hart import TIMER
from halpipe.deploy.riscv.board.machine import MANAGEMENT, Machine
from halpipe.deploy.riscv.board.registers import Level
from halpipe.deploy.riscv.judge.contents import BSS
from halpipe.deploy.riscv.run.drivers import Call

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from halpipe.deploy.riscv.board.devices import Transfer
    from halpipe.deploy.riscv.run.expectation import Image
    from halpipe.deploy.riscv.target import Area, Site


_STATUS = 80
"""Where in the mailbox a monitor says how an execution ended."""


class Outcome(StrEnum):
    """End of an execution."""

    RETURNED = "returned"
    OVERRUN = "overrun"  # ended by the timer
    FAULT = "fault"  # ended by an exception
    OPEN = "open"  # not ended when the run did


@dataclass(slots=True, eq=False)
class Execution:
    """A core in a function of a job, in units of the machine's time.

    `begin` is when the core woke to do it, `entered` when it was at the first instruction of the function, `left` when
    it was back from it, and `end` when it waited again for work.
    """

    hart: int
    function: int
    image: Image | None
    begin: int
    entered: int
    back: int
    left: int = 0
    end: int = 0
    outcome: Outcome = Outcome.OPEN
    wrong: list[tuple[int, int]] = field(default_factory=list)
    given: list[tuple[int, int]] = field(default_factory=list)  # address and size of what was loaded, read or cleared
    level: Level = Level.USER
    rank: int = 0
    ranks: int = 1
    stack: int = 0
    unclean: tuple[str, ...] = ()  # what of the core's state is not as a job has to find it
    deadline: int = 0  # mtimecmp of its core when it was entered
    status: int = 0  # as the monitor tells the management core
    due: int = 0  # when its operation has to begin it, where records say which operation that is


@record
class Trap:
    """An exception that a core took, in units; `execution` is what it was doing."""

    hart: int
    cause: int
    pc: int
    value: int
    now: int
    execution: Execution | None


@dataclass
class Observations:
    """Executions, transfers, calls and traps of a run, as a simulator or the runtime's records have them."""

    executions: list[Execution] = field(default_factory=list)
    transfers: list[Transfer] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)
    traps: list[Trap] = field(default_factory=list)
    disturbances: list[tuple[Transfer, Execution]] = field(default_factory=list)  # of scratchpads in use
    traced: list[tuple[int, int]] = field(default_factory=list)  # of every record: now, and when hart 0 woke up last
    restarts: list[int] = field(default_factory=list)  # when monitors began anew
    unfenced: set[int] = field(default_factory=set)  # cores whose monitors began without fence.i
    unordered: set[tuple[int, str]] = field(default_factory=set)  # what a core did without the fence that it needs
    decisions: list[tuple[int, int]] = field(default_factory=list)  # of requests: when taken, and when hart 0 woke up
    states: list[int] = field(default_factory=list)  # that the control block was given
    kicks: list[int] = field(default_factory=list)  # when the management core wrote to the watchdog
    stale: list[tuple[Transfer, str]] = field(default_factory=list)


class Recorder(Observations):
    """Record the actions of a machine; `told` is called with control words that the management core writes."""

    def __init__(self, site: Site, images: Sequence[Image], told: Callable[[int, int, int], None]) -> None:
        super().__init__()
        self.before_read: Callable[[str, int], None] = lambda buffer, now: None
        self.after_write: Callable[[str, int], None] = lambda buffer, now: None
        self.begins: Callable[[Execution], None] = lambda execution: None
        self.ends: Callable[[Execution], None] = lambda execution: None
        self.drives: Callable[[Call], None] = lambda call: None
        self._site = site
        self._told = told
        self._machine: Machine | None = None
        self._drivers: Mapping[int, str] = {}
        self._begun: set[int] = set()  # harts whose monitors have begun: the first time is the boot
        self._running: dict[int, Execution] = {}
        self._loaded: dict[int, list[Image]] = {}  # by hart, the newest first; older ones may have been overwritten
        self._inputs: dict[int, list[Transfer]] = {}
        self._contents: dict[str, bytes] = {}
        self._by_source = {s.source: image for image in images for s in image.program.segments if s.is_executable}
        self._functions: Mapping[int, frozenset[int]] = {
            unit.hart: frozenset(e for image in images if image.hart == unit.hart for e in image.site.entries)
            for unit in site.units
        }

    def attach(self, machine: Machine) -> None:
        """Begin to watch: every function of every image."""
        self._machine = machine
        for hart in self._functions:
            self._watch(hart)

    def _watch(self, hart: int) -> None:
        """Watch the functions of a core: of what was loaded last first, for there is a limit to how many can be."""
        loaded = [entry for image in self._loaded.get(hart, []) for entry in image.site.entries]
        monitor = self._site.unit_of(hart).ispm.base
        self.machine.harts[hart].watch(dict.fromkeys([monitor, *loaded, *sorted(self._functions[hart])]))

    @property
    def machine(self) -> Machine:
        """The machine that is watched."""
        assert self._machine is not None
        return self._machine

    # ------------------------------------------------------------------------------------------ cores

    def entered(self, hart: int, address: int, now: int) -> None:
        """A core is at the beginning of a function, or back from one."""
        if hart == MANAGEMENT:
            self._calls_driver(address, now)
            return
        running = self._running.get(hart)
        if running is None and address == self._site.unit_of(hart).ispm.base:
            if hart in self._begun:
                self.restarts.append(now)
            elif not self.machine.harts[hart].is_fenced:
                self.unfenced.add(hart)
            self._begun.add(hart)
        elif running is not None and running.back == address:
            running.left = now
            running.outcome = Outcome.RETURNED
            self.machine.harts[hart].scramble()
        elif running is None and address in self._functions[hart]:
            core = self.machine.harts[hart]
            back = core.x(1)
            core.watch([back])  # its own beginning may be that of a loop
            execution = Execution(hart, address, self._image_at(hart, address), core.woken, now, back)
            execution.level = core.level
            execution.rank, execution.ranks, execution.stack = core.x(10), core.x(11), core.x(2)
            execution.unclean = tuple(core.unclean())
            execution.deadline = core.compare
            self._compare(execution)
            self._running[hart] = execution
            self.executions.append(execution)
            self.begins(execution)

    def watch_drivers(self, drivers: Mapping[int, str]) -> None:
        """Watch the management core at functions, by their addresses."""
        self._drivers = drivers
        self.machine.harts[MANAGEMENT].watch(drivers)

    def _calls_driver(self, address: int, now: int) -> None:
        core = self.machine.harts[MANAGEMENT]
        call = Call(self._drivers[address], core.x(10), core.x(11), now)
        self.calls.append(call)
        self.drives(call)

    def _image_at(self, hart: int, address: int) -> Image | None:
        """Return the image that was loaded last over an address."""
        for image in self._loaded.get(hart, []):
            if any(s.is_executable and s.target <= address < s.target + s.size for s in image.program.segments):
                return image
        return None

    def is_running(self, hart: int) -> bool:
        """Whether a core is in an execution, or has not answered after one."""
        return hart in self._running

    def idles(self, hart: int, now: int) -> None:
        """A core waits for nothing but new work."""
        execution = self._running.pop(hart, None)
        if execution is not None:
            execution.end = now
            execution.left = execution.left or now
            execution.status = self.machine.memory.word(self._site.unit_of(hart).mailbox + _STATUS)
            self.ends(execution)
            self._watch(hart)

    def trapped(self, hart: int, cause: int, pc: int, value: int, now: int) -> None:
        """A core takes an exception, or the interrupt of its timer."""
        execution = self._running.get(hart)
        is_interrupt = bool(cause >> 63)
        if execution is not None and execution.outcome is Outcome.RETURNED and pc == execution.back:
            return  # back in user mode, it calls its monitor
        if execution is not None:
            execution.outcome = Outcome.OVERRUN if is_interrupt else Outcome.FAULT
            execution.left = now
        if not is_interrupt or cause & 0xFF != TIMER:
            self.traps.append(Trap(hart, cause, pc, value, now, execution))

    def _compare(self, execution: Execution) -> None:
        """Hold code and data of a job that begins against what was loaded and read for it."""
        memory = self.machine.memory
        inputs = self._inputs.pop(execution.hart, [])
        pieces = [(t.target, t.data) for t in inputs]
        if execution.image is not None:
            fresh = execution.function == execution.image.site.entries[0]
            segments = execution.image.program.segments
            begin, end = (execution.image.program.symbols.get(name, (0, 0))[0] for name in BSS)
            pieces += [(begin, bytes(end - begin))] if fresh and begin < end else []
            pieces += [(s.target, s.data) for s in segments if s.data and (fresh or s.is_executable)]
        execution.given = [(target, len(data)) for target, data in pieces]
        for target, data in pieces:
            if memory.read(target, len(data)) != data:
                execution.wrong.append((target, len(data)))

    # ------------------------------------------------------------------------------------------ transfers

    def starts(self, transfer: Transfer) -> None:
        """The DMA engine is about to read: the plant may bring its input up to date."""
        name = self._buffer(transfer.source)
        if name is None:
            return
        self.before_read(name, transfer.begin)
        area = self._site.buffers[name]
        known = self._contents.get(name)
        if known is not None and self.machine.memory.read(area.base, len(known)) != known:
            self.stale.append((transfer, name))

    def arrived(self, transfer: Transfer) -> None:
        """All bytes are at their target."""
        self.transfers.append(transfer)
        for address in (transfer.source, transfer.target):
            region = self.machine.memory.region(address)
            execution = self._running.get(region.hart) if region is not None and region.hart else None
            if execution is not None and execution.outcome is Outcome.OPEN:
                self.disturbances.append((transfer, execution))
        region = self.machine.memory.region(transfer.target)
        if region is not None and region.hart:
            self._inputs.setdefault(region.hart, []).append(transfer)
            image = self._by_source.get(transfer.source)
            if image is not None:
                others = [other for other in self._loaded.get(region.hart, []) if other is not image]
                self._loaded[region.hart] = [image, *others]
                if region.hart not in self._running:
                    self._watch(region.hart)
                self._inputs[region.hart] = [transfer]
        name = self._buffer(transfer.target)
        if name is not None:
            self.stored(name, transfer.data, transfer.target - self._site.buffers[name].base)
            self.after_write(name, transfer.end)

    def stored(self, buffer: str, data: bytes, offset: int = 0) -> None:
        """A buffer got new contents, by a write phase or by the plant; of a gang, each member writes its part."""
        area = self._site.buffers[buffer]
        known = self._contents.get(buffer) or self.machine.memory.read(area.base, area.size)
        self._contents[buffer] = known[:offset] + data + known[offset + len(data) :]

    def _buffer(self, address: int) -> str | None:
        return next((n for n, area in self._site.buffers.items() if _holds(area, address)), None)

    # ------------------------------------------------------------------------------------------ control

    def controlled(self, address: int, value: int, now: int) -> None:
        """The management core writes a word of the control block."""
        self._told((address - self._site.control) // 8, value, now)


def _holds(area: Area, address: int) -> bool:
    return area.base <= address < area.end
