"""One hart: an emulated core with its own clock, interrupts and traps, and the memory that its protection leaves.

The emulator (Unicorn) executes; what it does not do is done here: the clock, waiting for interrupts, taking traps, the
registers of `csr`, and physical memory protection. A clock advances by the cycles of instructions, and is looked at
between basic blocks, so that everything a hart does is exact to the length of one block.
"""

from __future__ import annotations

from functools import cache, reduce
from itertools import islice, pairwise
from operator import and_
from typing import TYPE_CHECKING, Any, Protocol

from halpipe.deploy.riscv.board import block_hook, registers
from halpipe.deploy.riscv.board.block_hook import Page
from halpipe.deploy.riscv.board.memory import PAGE, Memory
from halpipe.deploy.riscv.board.registers import ADDRESS, Level, Protection, Right
from halpipe.deploy.riscv.target import CLASSES, Area

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.deploy.riscv.board.machine import Machine

NEVER = 1 << 200
"""An instant that does not come."""

_FOREVER = 0xFFFFFFFFFFFFFFFE
SOFTWARE, TIMER = 3, 7
FETCH_FAULT, ILLEGAL, BREAKPOINT, LOAD_FAULT, STORE_FAULT = 1, 2, 3, 5, 7
LOAD_MISALIGNED, STORE_MISALIGNED = 4, 6
_LEFT_BEHIND = 0xA5A5A5A500
_ENABLED, _WAS_ENABLED = 1 << 3, 1 << 7  # mstatus.MIE, mstatus.MPIE


class Device(Protocol):
    """Device at a range of addresses instead of memory."""

    base: int
    size: int

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return what `hart` reads."""
        ...

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Take what `hart` writes."""
        ...


class Hart:
    """A core; all instants are in units of the machine's time."""

    def __init__(self, number: int, memory: Memory, devices: Iterable[Device], cycle: int, tick: int) -> None:
        import unicorn

        self.number = number
        self.world: Machine | None = None
        self.protection = Protection()
        self.level = Level.MACHINE
        self.asleep = False
        self.software = False  # the software interrupt of the CLINT
        self.software_at = 0
        self.woken = 0  # when it woke up last
        self.compare = (1 << 64) - 1  # mtimecmp
        self._cycle, self._tick = cycle, tick
        self._origin = 0  # the time at which the count of instructions was zero, had the clock never jumped
        self._memory = memory
        self.allowance = 1 << 62  # instructions that it may execute at all
        self._enabled = 0  # mie, as it was when the hart went to sleep
        self._known_enabled = 0
        self._raised: tuple[int, int] | None = None
        self._left_open = (0, 0)  # at the last mret: mcounteren and mstatus.FS, which user mode does not let us read
        self.has_user_mode = True
        self.is_restless = self._has_dozed = False  # whether each sleep ends once without a cause
        self.is_fenced = True  # the instruction cache has seen what was loaded
        self.is_ordered = True  # others see what it has stored for them
        self.has_looked = False  # at the answer of another one, without a fence since then
        self.is_overdue = False  # whether the time of its next job is over before it begins
        self.fences = 2  # since it cleared its software interrupt
        self.shown = b""  # its answer to a request, as others saw it at the last fence before it was given
        self._excepted = -1  # where the emulator took an exception of its own
        self._mapped: dict[
            tuple[int, int], tuple[Right, int]
        ] = {}  # low, high: what may be done, and where in the host
        self._wanted: dict[Level, dict[tuple[int, int], tuple[Right, int]]] = {}  # the same, since protection changed
        self._remap = False
        self._paused = False
        self._hooked: set[int] = set()
        self._allowed: dict[tuple[int, int, int], bool] = {}  # what was asked of the protection since it changed
        self.engine = unicorn.Uc(unicorn.UC_ARCH_RISCV, unicorn.UC_MODE_RISCV64)
        self._page = Page.from_address(memory.host + number * block_hook.HEADER)
        self._fill_page()
        self._map(Right.ALL)
        for device in devices:
            self._attach(device)
        block_hook.install(self.engine, self._page)
        self.engine.hook_add(unicorn.UC_HOOK_INTR, self._interrupted)
        self.engine.hook_add(unicorn.UC_HOOK_MEM_INVALID, self._refused)

    # ------------------------------------------------------------------------------------------ time

    @property
    def count(self) -> int:
        """Cycles of a simple instruction so far."""
        return int(self._page.count)

    @property
    def now(self) -> int:
        """The hart's own time."""
        return self._origin + self.count * self._cycle

    def advance(self, instant: int) -> None:
        """Let the clock jump to `instant`, as a hart that waited does."""
        if instant > self.now:
            self._origin = instant - self._page.count * self._cycle

    def weigh(self, access: int = 0, near: Area | None = None, **cycles: int) -> None:
        """Have loads and stores beyond `near` take more cycles, and classes of instructions (`CLASSES`) so many."""
        self._page.weight = access
        self._page.near, self._page.end = (near.base, near.end) if near else (0, 0)
        for number, name in enumerate(CLASSES):
            self._page.cycles[number] = cycles.get(name, 1)
        self._page.forget()

    def wake(self) -> int:
        """Return when the sleeping hart wakes by what is known now; `NEVER` if nothing would wake it."""
        instants = [NEVER]
        if self._enabled >> SOFTWARE & 1 and self.software:
            instants.append(max(self.now, self.software_at))
        if self._enabled >> TIMER & 1:
            instants.append(max(self.now, self.compare * self._tick))
        return min(instants)

    def run(self, until: int) -> None:
        """Execute until the clock reaches `until`, or nothing more happens before."""
        while self.now < until:
            if self.count >= self.allowance:
                assert self.world is not None
                self.world.spent(self)
                return
            if self.asleep:
                wake = self.wake()
                if wake >= until:
                    return
                self.advance(wake)
                self.asleep = False
                self.woken = self.now
            if not self._burst(until) or self._paused:
                self._paused = False
                return

    def timed(self) -> None:
        """It sets a timer: since it cleared its interrupt, it has looked at a request, and at its deadline."""
        if self.number and self.fences < 2 and self.world is not None:
            self.world.needs_fence(self, "takes a request")
        if self.is_overdue:
            self.compare = 0

    def look_up(self) -> None:
        """Have the running hart stop after this block, because something about its interrupts may have changed."""
        self._page.limit = self._page.count

    def pause(self) -> None:
        """Have `run` return after this block, because there is an earlier event than it was started with."""
        self._paused = True
        self.look_up()

    # ------------------------------------------------------------------------------------------ execution

    def _burst(self, until: int) -> bool:
        """Execute up to the next event; False if the machine has stopped."""
        import unicorn

        until = min(until, self._interrupts())
        if self._remap:
            self._apply_protection()
        page = self._page
        page.limit = min(-((self._origin - until) // self._cycle), self.allowance)
        page.full, page.hit, page.misaligned = 0, -1, -1
        self._raised, self._excepted = None, -1
        failure = None
        try:
            self.engine.emu_start(self.pc, _FOREVER)
        except unicorn.UcError as error:
            failure = error.errno
        pc = self.pc
        if page.misaligned >= 0:  # before what may be done with the address
            self._raised = (STORE_MISALIGNED if page.stores else LOAD_MISALIGNED, page.misaligned)
        if failure is not None and self._raised is None:
            breaks = self._instruction(pc) in (registers.EBREAK, registers.C_EBREAK)
            self._raised = (BREAKPOINT, pc) if breaks else (ILLEGAL, 0)
        if self._raised is not None:
            pc = self._excepted if self._excepted >= 0 else pc
            return self._trap(*self._as_cores_do(*self._raised, pc), pc)
        if page.hit >= 0:
            address = page.hit
            page.skip = address
            assert self.world is not None
            self.world.reached(self, address)
        elif not page.full:
            self._page.take_back(pc)  # a block does not end where the core goes to sleep
            self._has_dozed = self.is_restless and not self._has_dozed
            if self._has_dozed:
                return True
            self.asleep = True
            self._enabled = self._interrupts_enabled()
            assert self.world is not None
            self.world.sleeps(self, self._enabled)
        return True

    def _interrupts(self) -> int:
        """Take an interrupt that is due and enabled, and return the instant of the next that could come."""
        enabled = self._interrupts_enabled()
        if self.level is Level.MACHINE and not self._register("MSTATUS") & _ENABLED:
            return NEVER
        due = enabled & self.pending()
        for number in (SOFTWARE, TIMER):
            if due >> number & 1:
                assert self.world is not None
                self.world.trapped(self, 1 << 63 | number, self.pc, 0)
                self._enter_trap(1 << 63 | number, self.pc, 0)
                return NEVER
        timer = self.compare * self._tick
        return timer if enabled >> TIMER & 1 and timer > self.now else NEVER

    def _interrupts_enabled(self) -> int:
        """Return the register ``mie``, which user mode neither changes nor lets us read."""
        if self.level is Level.MACHINE:
            self._known_enabled = self._register("MIE")
        return self._known_enabled

    def pending(self) -> int:
        """Return the register ``mip``."""
        timer = self.now >= self.compare * self._tick
        software = self.software and self.now >= self.software_at
        return software << SOFTWARE | timer << TIMER

    def _instruction(self, pc: int) -> int:
        """Return the instruction at an address, of two or four bytes; 0 where there is no memory."""
        code = self._memory.view(pc, 4) or self._memory.view(pc, 2) or b"\0\0"
        word = int.from_bytes(code, "little")
        return word if word & 3 == 3 else word & 0xFFFF

    def _as_cores_do(self, cause: int, value: int, pc: int) -> tuple[int, int]:
        """Return cause and value of an exception as Spike and Rocket give them, where the emulator differs."""
        word = self._instruction(pc)
        if cause == ILLEGAL:
            return cause, word
        if word & 0x7F == registers.ATOMIC:
            if cause in (LOAD_MISALIGNED, STORE_MISALIGNED):
                value = self.x(word >> 15 & 31)
            if word >> 27 != registers.LOAD_RESERVED:
                cause = {LOAD_FAULT: STORE_FAULT, LOAD_MISALIGNED: STORE_MISALIGNED}.get(cause, cause)
        return cause, value

    def _trap(self, cause: int, value: int, pc: int) -> bool:
        self._page.take_back(pc)
        self._page.count += 1  # of its own, so that a core that only traps gets on, too
        assert self.world is not None
        if self.world.trapped(self, cause, pc, value):
            return False
        self._enter_trap(cause, pc, value)
        return True

    def _enter_trap(self, cause: int, pc: int, value: int) -> None:
        """Enter the handler as the privileged architecture says (section 3.1): to machine mode, interrupts off."""
        self.is_overdue = False
        level = self._register("PRIV")
        self._set("PRIV", 3)
        self._change_level(Level.MACHINE)
        status = self._register("MSTATUS")
        entered = status & ~(_ENABLED | _WAS_ENABLED | 3 << 11) | level << 11
        self._set("MSTATUS", entered | (_WAS_ENABLED if status & _ENABLED else 0))
        self._set("MEPC", pc)
        self._set("MCAUSE", cause)
        self._set("MTVAL", value)
        vector = self._register("MTVEC")
        offset = 4 * (cause & 0xFF) if vector & 1 and cause >> 63 else 0
        self.pc = (vector & ~3) + offset

    def _interrupted(self, engine: Any, number: int, _: Any) -> None:
        self._raised = (number, 0)
        self._excepted = self.pc - 4  # it has gone on by then, by four bytes whatever the instruction has
        engine.emu_stop()

    def _refused(self, engine: Any, access: int, address: int, size: int, value: int, _: Any) -> bool:
        import unicorn

        cause = LOAD_FAULT if access in (unicorn.UC_MEM_READ_UNMAPPED, unicorn.UC_MEM_READ_PROT) else FETCH_FAULT
        if access in (unicorn.UC_MEM_WRITE_UNMAPPED, unicorn.UC_MEM_WRITE_PROT):
            cause = STORE_FAULT
        if cause == LOAD_FAULT and address % size:  # the emulator looks for memory before it calls the other hook
            cause = LOAD_MISALIGNED
        self._raised = (cause, address)
        return False

    # ------------------------------------------------------------------------------------------ registers

    def _register(self, name: str) -> int:
        return int(self.engine.reg_read(_numbers()[name]))

    def _set(self, name: str, value: int) -> None:
        self.engine.reg_write(_numbers()[name], value)

    @property
    def pc(self) -> int:
        """The program counter."""
        return self._register("PC")

    @pc.setter
    def pc(self, value: int) -> None:
        self._set("PC", value)

    def x(self, number: int) -> int:
        """Return a general register."""
        return self._register(f"X{number}")

    def unclean(self) -> Iterator[str]:
        """Yield what a function that begins must not find: values, counters, floating point, code of before."""
        kept = [number for number in range(3, 32) if number not in (10, 11) and self.x(number)]
        if kept:
            yield (
                f"x{kept[0]} not cleared, nor {len(kept) - 1} more registers" if kept[1:] else f"x{kept[0]} not cleared"
            )
        counters, floating = self._left_open
        if counters:
            yield "counters that it may read"
        if floating:
            yield "floating point switched on"
        if self._known_enabled != 1 << TIMER:
            yield f"interrupts enabled other than its timer's (mie {self._known_enabled:#x})"
        if not self.is_fenced:
            yield "no fence.i since its code was loaded"

    def enable_interrupts(self) -> None:
        """Enable all interrupts, and counters for jobs, as boot ROMs may leave them."""
        self._set("MCOUNTEREN", 7)
        self._set("MIE", 1 << SOFTWARE | 1 << TIMER)
        self._set("MSTATUS", self._register("MSTATUS") | _ENABLED)

    def scramble(self) -> None:
        """Put something else into every general register, as boot ROMs and jobs may leave it."""
        for number in range(1, 32):
            self._set(f"X{number}", _LEFT_BEHIND + number)

    # ------------------------------------------------------------------------------------------ watching

    def watch(self, addresses: Iterable[int]) -> None:
        """Report to the machine whenever one of these `addresses`, and no other, is about to be executed."""
        number = 0
        for number, address in enumerate(islice(addresses, block_hook.MAX_WATCHED), 1):
            self._page.watched[number - 1] = address
        self._page.watching = number

    def hook_registers(self, code: bytes, base: int) -> None:
        """Carry out the instructions of `csr` wherever `code`, which stands at `base`, has them."""
        from unicorn import UC_HOOK_CODE

        for address in registers.of_interest(code, base):
            if address not in self._hooked:
                self._hooked.add(address)
                self.engine.hook_add(UC_HOOK_CODE, self._on_register, None, address, address)

    def _on_register(self, engine: Any, address: int, size: int, _: Any) -> None:
        word = int.from_bytes(self._memory.read(address, 4), "little")
        access = registers.decode(word)
        if word == registers.FENCE_I:
            self.is_fenced = True
        elif word == registers.FENCE:
            self.is_ordered, self.has_looked = True, False
            self.fences += 1
            if self.number and self.world is not None:
                self.world.fenced(self)
        elif self.level is Level.USER and access is not None and access.csr in registers.OURS:
            self._raised = (ILLEGAL, 0)  # the counters, too: the monitor keeps them
            self.pc = address
            engine.emu_stop()
        elif not self.has_user_mode and access is not None and access.csr == registers.MSTATUS and access.target:
            self._set(f"X{access.target}", self._register("MSTATUS") | 3 << 11)
            self._page.take_back(address + 4)
            self.pc = address + 4
        elif word == registers.MRET or (access is not None and access.csr in registers.INTERRUPTS):
            self.look_up()
            if word == registers.MRET and self.level is Level.MACHINE:
                self._interrupts_enabled()
                self._left_open = self._register("MCOUNTEREN"), self._register("MSTATUS") >> 13 & 3
                self._change_level(Level.MACHINE if self._register("MSTATUS") >> 11 & 3 else Level.USER)
        elif access is not None and access.csr in registers.OURS:
            self._on_own_register(access)
            self._page.take_back(address + 4)
            self.pc = address + 4

    def _on_own_register(self, access: registers.Access) -> None:
        old = self._read_own(access.csr)
        operand = access.source if access.immediate else self.x(access.source)
        if access.writes and access.csr in registers.PROTECTION:
            self.protection.write(access.csr, access.result(old, operand))
            self._allowed.clear()
            if access.csr < ADDRESS:
                self._wanted.clear()
                self._remap = True
            self.look_up()
        if access.target:
            self._set(f"X{access.target}", old)

    def _read_own(self, number: int) -> int:
        if number == registers.MHARTID:
            return self.number
        if number == registers.MIP:
            return self.pending()
        if number == registers.TIME:
            return self.now // self._tick
        if number in registers.COUNTERS:
            return self.now // self._cycle if number in (registers.MCYCLE, registers.CYCLE) else self.count
        return self.protection.read(number)

    # ------------------------------------------------------------------------------------------ memory

    def take_code(self, address: int, code: bytes) -> None:
        """Drop what the emulator has translated of memory that changed, and hook the registers of what is there now."""
        self.is_fenced = False
        self.engine.ctl_remove_cache(address, address + len(code))
        self._page.forget()
        self.hook_registers(code, address)

    def _fill_page(self) -> None:
        page = self._page
        page.block = page.skip = page.hit = -1
        page.cycles[:] = [1] * len(page.cycles)
        start = self.number * block_hook.HEADER
        page.span = self._memory.size - start
        placed = self._memory.placed()
        page.memories = len(placed)
        for i, (region, offset) in enumerate(placed):
            page.region[i] = block_hook.Region(region.base, region.end, offset - start)

    def _map(self, right: Right) -> None:
        for region, offset in self._memory.placed():
            host = self._memory.host + offset
            self.engine.mem_map_ptr(region.base, region.extent, int(right), host)
            self._mapped[region.base, region.base + region.extent] = (right, host)

    def _change_level(self, level: Level) -> None:
        if level is not self.level:
            self.level = level
            self._allowed.clear()
            self._remap = self._remap or self.number > 0

    def _apply_protection(self) -> None:
        """Keep of the memories what the level may do, changing as little as possible."""
        self._remap = False
        if self.level not in self._wanted:
            self._wanted[self.level] = self._reachable(self.level)
        wanted = self._wanted[self.level]
        for (low, high), (right, _) in self._mapped.items():
            if right and wanted.get((low, high), (Right.NONE, 0))[0] != right:
                self.engine.mem_unmap(low, high - low)
        for (low, high), (right, host) in wanted.items():
            if right and self._mapped.get((low, high), (Right.NONE, 0))[0] != right:
                self.engine.mem_map_ptr(low, high - low, int(right), host)
        self._mapped = wanted

    def _reachable(self, level: Level) -> dict[tuple[int, int], tuple[Right, int]]:
        """Return the rights and the place in the host of every part of the memories, cut where any level's change."""
        found = {}
        for region, offset in self._memory.placed():
            low, high = region.base, region.base + region.extent
            pieces = self.protection.pieces(low, high, level)
            others = [self.protection.pieces(low, high, other) for other in Level]
            edges = {edge for parts in others for start, end, _ in parts for edge in (start, end)}
            for start, end, right in _whole_pages(pieces, edges):
                found[start, end] = (right, self._memory.host + offset + start - region.base)
        return found

    def _attach(self, device: Device) -> None:
        reading, writing = int(Right.READ), int(Right.WRITE)

        def load(_: Any, offset: int, size: int, __: Any) -> int:
            if self._denied(device.base + offset, size, reading, LOAD_FAULT) or not self._may_call():
                return 0
            return device.load(self, offset, size)

        def store(_: Any, offset: int, size: int, value: int, __: Any) -> None:
            if not self._denied(device.base + offset, size, writing, STORE_FAULT) and self._may_call():
                device.store(self, offset, size, value)

        self.engine.mmio_map(device.base, device.size, load, None, store, None)

    def _may_call(self) -> bool:
        return self.world is None or self.world.called()

    def _denied(self, address: int, size: int, right: int, cause: int) -> bool:
        key = (address, size, right)
        allowed = self._allowed.get(key)
        if allowed is None:
            allowed = self._allowed[key] = bool(self.protection.rights(address, size, self.level) & right)
        if allowed:
            return False
        self._raised = self._raised or (cause, address)  # of eight bytes, two halves are denied
        self.engine.emu_stop()
        return True


@cache
def _numbers() -> dict[str, int]:
    from unicorn import riscv_const

    prefix = "UC_RISCV_REG_"
    return {name.removeprefix(prefix): value for name, value in vars(riscv_const).items() if name.startswith(prefix)}


def _whole_pages(pieces: Iterable[tuple[int, int, Right]], edges: Iterable[int]) -> Iterator[tuple[int, int, Right]]:
    """Cut pieces to pages, at `edges` at least; a page in several pieces has only the rights that all of them have."""
    found = list(pieces)
    cuts = sorted({page for edge in edges for page in (edge // PAGE, -(-edge // PAGE))})
    for first, last in pairwise(cuts):
        low, high = first * PAGE, last * PAGE
        yield low, high, reduce(and_, (right for start, end, right in found if start < high and low < end))
