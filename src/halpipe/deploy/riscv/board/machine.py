"""The machine: harts with clocks of their own, memories, devices, and the loop that keeps them in step.

The loop is conservative: no hart ever executes what could still be changed by what another one does earlier.
Application cores are influenced by the management core and the DMA engine only, so the management core goes first; an
application core follows whenever its scratchpads or its interrupt are touched, exactly up to the instant of the touch,
and up to the next event while the management core sleeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record
from halpipe.deploy.riscv.board.bus import Bus, Gate
from halpipe.deploy.riscv.board.devices import TRANSACTION, Clint, CopyWatcher, DmaPort, Register, Transfer, Uart
from halpipe.deploy.riscv.board.hart import NEVER, SOFTWARE, Device, Hart
from halpipe.deploy.riscv.board.memory import PAGE, Memory, Region
from halpipe.deploy.riscv.target import CONTROL_SIZE, Site

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from halpipe.deploy.riscv.board.devices import Channel
    from halpipe.deploy.riscv.board.elf import Program
    from halpipe.deploy.riscv.run.observation import Recorder

MANAGEMENT = 0
RUBBISH = b"\xa5"
"""What memories hold when the power comes: anything, so not zero."""

_EXIT, _EXIT_STATUS = 0x20, 0x20026
_SEMIHOSTING = b"".join(word.to_bytes(4, "little") for word in (0x01F01013, 0x00100073, 0x40705013))
"""The break of a call of semihosting, between two instructions that do nothing."""
_DONE, _BEGIN, _ANSWER = 8, 64, 48  # in a mailbox, and how long an answer is


@record
class Timing:
    """The machine's unit of time, so that instructions and ticks are whole numbers of it; `rate` is units per second.

    An instruction takes `cycle` in a job, and `management` on the management core.
    """

    rate: int
    cycle: int
    tick: int
    management: int

    @staticmethod
    def of(clock: int, timebase: int, jobs: Fraction | int = 1, management: Fraction | int | None = None) -> Timing:
        """Return the coarsest unit, but at most a nanosecond, for a core clock, a timebase in Hz, and cycles."""
        job, other = Fraction(jobs), Fraction(jobs if management is None else management)
        rate = math.lcm(clock, timebase, 10**9) * math.lcm(job.denominator, other.denominator)
        return Timing(rate, int(rate // clock * job), rate // timebase, int(rate // clock * other))


@dataclass(slots=True)
class Budget:
    """Limits of a run: instructions of each core by its number, traps, and uses of devices."""

    instructions: Mapping[int, int] = field(default_factory=dict)
    traps: int = 10**6
    calls: int = 10**9


class Machine:
    """A management core, application cores, and what they share."""

    def __init__(
        self,
        site: Site,
        program: Program,
        observer: Recorder,
        *,
        bandwidths: Mapping[tuple[int, str], int],
        cpi: Fraction | int | None = None,
        budget: Budget | None = None,
        others: Callable[[Machine], Sequence[Device]] = lambda machine: (),
    ) -> None:
        self.site = site
        jobs, management = (site.cpi, site.management_cpi) if cpi is None else (cpi, cpi)
        self.timing = Timing.of(site.clock, site.timebase, jobs, management)
        self.observer = observer
        self.stopped = False
        self.fate: Callable[[Transfer], tuple[int, bool] | None] = lambda transfer: None
        self.gate: Callable[[int, int, bool], Gate | None] = lambda channel, hart, writes: None
        self.status: int | None = None
        self.exhausted = ""
        self._budget = replace(budget or Budget())
        self._bandwidths = bandwidths  # by channel and memory, in bytes per second
        self._latency = math.ceil(site.dma.latency.in_unit("s") * self.timing.rate)
        regions = [Region("main", site.main.base, site.main.size)]
        regions += [Region("near", site.scratchpad.base, site.scratchpad.size)] if site.scratchpad else []
        for unit in site.units:
            regions.append(Region("ispm", unit.ispm.base, unit.ispm.size, unit.hart))
            regions.append(Region("dspm", unit.dspm.base, unit.dspm.size, unit.hart))
        self.memory = Memory(regions, 1 + len(site.units))
        self._copies = CopyWatcher(self.memory, observer.starts, self._copied)
        self.clint = Clint(site.clint, self.timing.tick, self._raise_software)
        self.uart = Uart(site.uart)
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()
        self._under_way: list[Transfer] = []
        self._bus = Bus(self.timing.rate, site.dma.bus)
        self._code: dict[int, bytes] = {}
        self._begun: set[int] = set()
        devices = [*self._devices(), *others(self)]
        self.harts = [
            Hart(n, self.memory, devices, self.timing.cycle if n else self.timing.management, self.timing.tick)
            for n in range(1 + len(site.units))
        ]
        self.clint.harts = self.harts
        for hart in self.harts:
            hart.allowance = self._budget.instructions.get(hart.number, hart.allowance)
        for hart in self.harts:
            hart.world = self
            if hart.number:
                hart.weigh(0, None, **{name: math.ceil(n / Fraction(jobs)) for name, n in site.classes.items()})
            hart.pc = program.entry
            hart.scramble()
            hart.enable_interrupts()
        latency = math.ceil(site.latency.in_unit("s") * self.timing.rate / self.timing.management)
        self.management.weigh(latency, site.scratchpad)
        self._power_up()
        self._load(program)
        self._hook_management()

    def _devices(self) -> list[Device]:
        devices: list[Device] = [self.clint, self.uart]
        dma = self.site.dma
        if dma.kind == "pdma":
            self._port = DmaPort(dma.base, dma.stride, dma.channels, self)
            devices.append(self._port)
        if self.site.finisher is not None:
            devices.append(Register(self.site.finisher, self._finishes))
        if self.site.watchdog is not None:
            devices.append(Register(self.site.watchdog.address, self._kicks))
        return devices

    def _power_up(self) -> None:
        """Fill unwritten memory with rubbish: the scratchpads, and the place of the program."""
        for region in self.memory.regions:
            size = self.site.control - region.base if region.kind == "main" else region.size
            self.memory.write(region.base, RUBBISH * size)
        self.memory.write(self.site.control + CONTROL_SIZE, RUBBISH * (PAGE - CONTROL_SIZE))

    def _load(self, program: Program) -> None:
        for segment in program.segments:
            self.memory.write(segment.source, segment.data)
            if segment.is_executable:
                for hart in self.harts:
                    hart.hook_registers(segment.data, segment.target)

    def _hook_management(self) -> None:
        """See what the management core does with the scratchpads of others, and with its control block."""
        from unicorn import UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE

        engine = self.harts[MANAGEMENT].engine
        for region in self.memory.regions:
            if region.hart:
                hook = UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE
                engine.hook_add(hook, self._touched, self.harts[region.hart], region.base, region.end - 1)
        if self.site.dma.kind == "copy":
            hook = UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE
            for low, high in self._shared():
                engine.hook_add(hook, self._copying, None, low, high - 1)
        engine.hook_add(UC_HOOK_MEM_WRITE, self._controlled, None, self.site.control, self.site.control + 127)

    def _shared(self) -> list[tuple[int, int]]:
        """Return the parts of main memory from and to which is copied: images and buffers."""
        images = [(source, source + size) for image in self.site.images for source, _, size in image.load]
        buffers = [(area.base, area.end) for area in self.site.buffers.values()]
        buffers += [(area.base, area.end) for turn in self.site.turns for area in turn.buffers.values()]
        return [(min(low for low, _ in part), max(high for _, high in part)) for part in (images, buffers) if part]

    # ------------------------------------------------------------------------------------------ the loop

    @property
    def management(self) -> Hart:
        """The management core."""
        return self.harts[MANAGEMENT]

    def at(self, instant: int, action: Callable[[], None]) -> None:
        """Do something at an instant, before any hart executes what it executes then."""
        heappush(self._events, (instant, next(self._order), action))
        self.management.pause()

    def run(self, until: int) -> None:
        """Let the machine run until it stops, nothing would happen any more, or `until`."""
        while not self.stopped:
            horizon = min(self._horizon(), until)
            self.management.run(horizon)
            if self.stopped:
                return
            asleep = self.management.asleep
            reached = min(self.management.wake(), self._horizon(), until) if asleep else self.management.now
            if reached >= until:
                return
            self.follow(reached)
            self._pass(reached)
            if asleep:
                self.management.advance(min(reached, self.management.wake()))

    def _horizon(self) -> int:
        ends = [transfer.end for transfer in self._under_way]
        return min([*ends, self._events[0][0] if self._events else NEVER])

    def follow(self, instant: int) -> None:
        """Let every application core come up to `instant`."""
        for hart in self.harts[1:]:
            if hart.now < instant:
                hart.run(instant)

    def _pass(self, instant: int) -> None:
        """Let happen what happens up to `instant`."""
        self.complete_transfers(instant)
        while self._events and self._events[0][0] <= instant and not self.stopped:
            heappop(self._events)[2]()

    def stop(self) -> None:
        """End the run."""
        self.stopped = True
        for hart in self.harts:
            hart.pause()

    def _exhaust(self, what: str) -> None:
        self.exhausted = self.exhausted or what
        self.stop()

    def spent(self, hart: Hart) -> None:
        """A core has executed all the instructions that it may."""
        name = self.site.unit_of(hart.number).name if hart.number else "the management core"
        self._exhaust(f"{name} executed {hart.count} instructions, last at pc {hart.pc:#x}")

    def called(self) -> bool:
        """A device is used; the run ends where that has no end."""
        self._budget.calls -= 1
        if self._budget.calls < 0:
            self._exhaust("devices and shared memory were used more often than any sound bundle does")
            return False
        return True

    def _finishes(self, hart: Hart, value: int) -> None:
        if value & 0xFFFF in (0x5555, 0x3333):
            self._finish(value >> 16)

    def _kicks(self, hart: Hart, value: int) -> None:
        if self.site.watchdog is not None and value == self.site.watchdog.value:
            self.observer.kicks.append(hart.now)

    def _finish(self, status: int) -> None:
        self.status = status
        self.stop()

    # ------------------------------------------------------------------------------------------ what harts do

    def reached(self, hart: Hart, address: int) -> None:
        """Pass on that `hart` is about to execute a watched address."""
        self.observer.entered(hart.number, address, hart.now)

    def trapped(self, hart: Hart, cause: int, pc: int, value: int) -> bool:
        """Pass on a trap; a break of the management core may be a call of semihosting, which ends the run."""
        if hart.number == MANAGEMENT and cause == 3 and bytes(self.memory.view(pc - 4, 12) or b"") == _SEMIHOSTING:
            block = self.memory.view(hart.x(11), 16)
            if hart.x(10) == _EXIT and block and int.from_bytes(block[:8], "little") == _EXIT_STATUS:
                self._finish(int.from_bytes(block[8:], "little"))
                return True
        self._budget.traps -= 1
        if self._budget.traps < 0:
            name = self.site.unit_of(hart.number).name if hart.number else "the management core"
            self._exhaust(f"{name} only traps any more, last with cause {cause:#x} at pc {pc:#x}")
            return True
        self.observer.trapped(hart.number, cause, pc, value, hart.now)
        return False

    def sleeps(self, hart: Hart, enabled: int) -> None:
        """Pass on that an application core waits for work, or that the management core has copied all there was."""
        if hart.number == MANAGEMENT:
            self._copies.finish(hart.now)
        elif enabled == 1 << SOFTWARE:
            answer = self._answer(hart)
            if hart.shown not in (b"", answer) and self.observer.is_running(hart.number):
                self.needs_fence(hart, "answers")
            self.observer.idles(hart.number, hart.now)

    def fenced(self, hart: Hart) -> None:
        """Note what a core that has not answered yet shows of its answer by a fence."""
        box = self.site.unit_of(hart.number).mailbox
        if self.memory.word(box) != self.memory.word(box + _DONE):
            hart.shown = self._answer(hart)

    def _answer(self, hart: Hart) -> bytes:
        return self.memory.read(self.site.unit_of(hart.number).mailbox + _BEGIN, _ANSWER)

    def needs_fence(self, hart: Hart, what: str) -> None:
        """Pass on that a core did something without the fence that it needs."""
        self.observer.unordered.add((hart.number, what))

    def _raise_software(self, hart: Hart, number: int, value: int) -> None:
        if number >= len(self.harts):
            return
        other = self.harts[number]
        hart.fences = 0 if other is hart else hart.fences
        if other is not hart and number != MANAGEMENT:
            self._copies.finish(hart.now, number)
            other.run(hart.now)
            if value and not hart.is_ordered:
                self.needs_fence(hart, f"wakes {self.site.unit_of(number).name}")
        if value and not other.software:
            other.software_at = hart.now
            if number and number not in self._begun:  # its monitor has been put there
                self._begun.add(number)
                other.is_fenced = False
                monitor = self.site.unit_of(number).ispm
                other.hook_registers(self.memory.read(monitor.base, min(monitor.size, PAGE)), monitor.base)
        other.software = bool(value)
        other.look_up()

    def _touched(self, engine: Any, access: int, address: int, size: int, value: int, other: Hart) -> None:
        """The management core touches a scratchpad: its owner comes up to that instant first."""
        from unicorn import UC_MEM_READ

        now = self.management.now
        if not self.called():
            return
        other.run(now)
        at = address - self.site.unit_of(other.number).mailbox
        if at < 0 or access != UC_MEM_READ:  # a load from the mailbox begins no copy
            (self._copies.loads if access == UC_MEM_READ else self._copies.stores)(address, size, now)
        if access == UC_MEM_READ:
            if at == _BEGIN and self.management.has_looked:
                self.needs_fence(self.management, "reads when a job began")
            self.management.has_looked = at == _DONE or (self.management.has_looked and at != _BEGIN)
        else:
            if at == 0 and other.number in self._begun and not self.management.is_ordered:
                self.needs_fence(self.management, f"requests a job of {self.site.unit_of(other.number).name}")
            self.management.is_ordered = False

    def _copying(self, engine: Any, access: int, address: int, size: int, value: int, _: Any) -> None:
        """The management core touches a buffer, or an image that is to be loaded."""
        from unicorn import UC_MEM_READ

        if self.called():
            touches = self._copies.loads if access == UC_MEM_READ else self._copies.stores
            touches(address, size, self.management.now)

    def _controlled(self, engine: Any, access: int, address: int, size: int, value: int, _: Any) -> None:
        if self.called():
            self.observer.controlled(address, value & (1 << 8 * size) - 1, self.management.now)

    # ------------------------------------------------------------------------------------------ transfers

    def start_transfer(self, channel: Channel, hart: Hart) -> None:
        """Read the source now, and have the bytes arrive after set-up and the time that bandwidth and gate ask for."""
        source, target, size = channel.next()
        now = hart.now
        if not hart.is_ordered:
            self.needs_fence(hart, f"starts a transfer on channel {channel.number}")
        transfer = Transfer(channel.number, source, target, size, now, now)
        self._bring_up(source, size, now)
        self.observer.starts(transfer)
        read = self.memory.view(source, size)
        if read is None or self.memory.view(target, size) is None:
            channel.finish(error=True)
            self.observer.arrived(transfer)
            return
        region = self.memory.region(target, size)
        memory = region.kind if region is not None else ""
        bandwidth = self._bandwidths.get((channel.number, memory), self.site.dma.bandwidth[memory])
        transfer.transaction = channel.transaction
        bandwidth = max(bandwidth * min(transfer.transaction, TRANSACTION) // TRANSACTION, 1)
        self._bus.take(transfer, now + self._latency, bandwidth, self._gate_before(transfer))
        fate = self.fate(transfer)
        if fate is not None:
            transfer.end, transfer.fails = fate
            self._bus.release(transfer)
        transfer.data = bytes(read)
        self._under_way.append(transfer)
        self.management.pause()

    def _gate_before(self, transfer: Transfer) -> Gate | None:
        """Return the regulator between main memory and the scratchpad that a transfer fills or empties."""
        target, source = (self.memory.region(at, transfer.size) for at in (transfer.target, transfer.source))
        if target is not None and target.hart:
            return self.gate(transfer.channel, target.hart, False)
        return self.gate(transfer.channel, source.hart, True) if source is not None and source.hart else None

    def gates_changed(self) -> None:
        """Hear that regulators play other tables from now on than they would have."""
        self._bus.replan(self.management.now)
        self.management.pause()

    def complete_transfers(self, now: int) -> None:
        """Let arrive what is over by `now`, in the order of its end."""
        for transfer in sorted(self._under_way, key=lambda t: (t.end, t.channel)):
            if transfer.end > now:
                return
            self._under_way.remove(transfer)
            self._bring_up(transfer.target, transfer.size, transfer.end)
            if transfer.fails:
                transfer.data = b""
            self._store(transfer.target, transfer.data)
            self._port.channels[transfer.channel].finish(error=transfer.fails)
            self.observer.arrived(transfer)

    def overwrite(self, hart: int, address: int, code: bytes) -> None:
        """Have a core that stands at `address` execute something else."""
        self.memory.write(address, code)
        self._code = {at: data for at, data in self._code.items() if not at <= address < at + len(data)}
        self.harts[hart].take_code(address, code)

    def _copied(self, transfer: Transfer) -> None:
        region = self.memory.region(transfer.target)
        if region is not None and region.hart and self._code.get(transfer.target) != transfer.data:
            self._code[transfer.target] = transfer.data
            self.harts[region.hart].take_code(transfer.target, transfer.data)
        self.observer.arrived(transfer)

    def _bring_up(self, address: int, size: int, instant: int) -> None:
        region = self.memory.region(address, size)
        if region and region.hart:
            self.harts[region.hart].run(instant)

    def _store(self, address: int, data: bytes) -> None:
        region, view = self.memory.region(address, len(data)), self.memory.view(address, len(data))
        if region is None or view is None or view == data:
            return
        view[:] = data
        if region.hart:
            self.harts[region.hart].take_code(address, data)
