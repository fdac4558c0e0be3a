"""Devices beside the memories: CLINT, serial line, finisher, DMA engine (SiFive PDMA) or the copies in its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.deploy.riscv.board.hart import Hart
    from halpipe.deploy.riscv.board.machine import Machine
    from halpipe.deploy.riscv.board.memory import Memory

CONTROL, CONFIG, BYTES, TARGET, SOURCE = 0x0, 0x4, 0x8, 0x10, 0x18
CLAIM, RUN, DONE, ERROR = 1, 2, 1 << 30, 1 << 31
TRANSACTION = 64
"""Bytes of the transactions whose bandwidth a profile states."""

_REGISTERS, _WORD = 0x20, 8


@dataclass(slots=True, eq=False)
class Transfer:
    """One transfer that was seen: `begin` and `end` in units of the machine's time; `data` is what was read.

    `held` is how long a regulator kept its bursts waiting, in all; it moves `transaction` bytes at a time. What a core
    copies has so many `pieces`.
    """

    channel: int
    source: int
    target: int
    size: int
    begin: int
    end: int
    data: bytes = b""
    fails: bool = False
    held: int = 0
    transaction: int = TRANSACTION
    pieces: int = 0


class Channel:
    """The registers of one channel."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.control = 0
        self._registers = bytearray(_REGISTERS)

    def read(self, offset: int, size: int) -> int:
        """Return what software reads."""
        if offset == CONTROL:
            return self.control
        return int.from_bytes(self._registers[offset : offset + size], "little")

    def write(self, offset: int, size: int, value: int) -> bool:
        """Take what software writes, and return whether that starts a transfer."""
        if offset != CONTROL:
            if offset + size <= _REGISTERS:
                self._registers[offset : offset + size] = value.to_bytes(size, "little")
            return False
        if self.control & RUN:
            return False  # neither given up nor started anew while it moves
        if not value & CLAIM:
            self.control = 0
        elif not self.control & CLAIM:  # claiming resets the registers of the next transfer
            self.control = CLAIM
            self._registers = bytearray(_REGISTERS)
        elif value & RUN:
            self.control |= RUN  # done and error stay set until the claim is given up
            return True
        return False

    def finish(self, error: bool = False) -> None:
        """Say to software that the transfer is over."""
        self.control = self.control & ~RUN | (ERROR if error else DONE)

    @property
    def transaction(self) -> int:
        """Bytes of the smaller of its transactions, reads and writes: their logarithms are in the configuration."""
        config = int.from_bytes(self._registers[CONFIG : CONFIG + 4], "little")
        return 1 << min(config >> 28, config >> 24 & 15)

    def next(self) -> tuple[int, int, int]:
        """Return source, target and size of the transfer that software described."""
        word = self._registers
        source, target, size = (int.from_bytes(word[at : at + 8], "little") for at in (SOURCE, TARGET, BYTES))
        return source, target, size


UNKNOWN = -1
"""The channel of copies: whatever resource they are for, one core does them all."""


class CopyWatcher:
    """Puts loads and stores together to transfers; `begins` and `ends` hear of each."""

    def __init__(self, memory: Memory, begins: Callable[[Transfer], None], ends: Callable[[Transfer], None]) -> None:
        self._memory = memory
        self._begins, self._ends = begins, ends
        self._open: list[Transfer] = []
        self._loaded: tuple[Transfer, int] | None = None  # of which transfer something was loaded last, and how much

    def loads(self, address: int, size: int, now: int) -> None:
        """Take a load as the beginning of a copy, or as more of one."""
        known = next((t for t in self._open if t.source + t.size == address), None)
        if known is None:
            known = Transfer(UNKNOWN, address, 0, 0, now, now)
            self._begins(known)
        self._loaded = (known, size)

    def stores(self, address: int, size: int, now: int) -> None:
        """Take a store of what was loaded; others are no copies."""
        if self._loaded is None or self._loaded[1] != size:
            return
        transfer, _ = self._loaded
        self._loaded = None
        if not transfer.size:
            transfer.target = address
            self._open.append(transfer)
        elif transfer.target + transfer.size != address:
            return
        transfer.size += size
        transfer.end = now
        transfer.pieces += 1

    def finish(self, now: int, hart: int | None = None) -> None:
        """All copies are over, or those into the scratchpads of one `hart`."""
        for transfer in list(self._open):
            region = self._memory.region(transfer.target)
            if hart is None or (region is not None and region.hart == hart):
                self._open.remove(transfer)
                transfer.end = now
                transfer.data = self._memory.read(transfer.target, transfer.size)
                if not (transfer.source | transfer.target) % _WORD and transfer.pieces > sum(
                    divmod(transfer.size, _WORD)
                ):
                    transfer.transaction = 1  # not in words, though both ends are aligned
                self._ends(transfer)


_COMPARE, _TIME = 0x4000, 0xBFF8
PAGE = 4096


class Clint:
    """Software interrupts (MSIP), timers (mtimecmp) and the clock (mtime), which shows every hart its own time."""

    size = 0xC000

    def __init__(self, base: int, tick: int, raise_software: Callable[[Hart, int, int], None]) -> None:
        self.base = base
        self.harts: Sequence[Hart] = ()
        self._tick = tick
        self._raise_software = raise_software

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return a register, or the half of one: the emulator cuts accesses of eight bytes in two."""
        if offset >= _TIME:
            value = hart.now // self._tick
        elif offset >= _COMPARE:
            other = self._hart((offset - _COMPARE) // 8)
            value = other.compare if other else 0
        else:
            other = self._hart(offset // 4)
            return int(other.software) if other else 0
        return value >> 8 * (offset & 7) & (1 << 8 * size) - 1

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Set a register, or the half of one."""
        if offset < _COMPARE:
            self._raise_software(hart, offset // 4, value & 1)
        elif offset < _TIME:
            other = self._hart((offset - _COMPARE) // 8)
            if other:
                shift = 8 * (offset & 7)
                mask = (1 << 8 * size) - 1 << shift
                other.compare = other.compare & ~mask | value << shift & mask
                other.look_up()
                hart.timed()

    def _hart(self, number: int) -> Hart | None:
        return self.harts[number] if number < len(self.harts) else None


class Uart:
    """A serial line of any kind (SiFive, LiteX, 16550 with registers of one or four bytes) that keeps what it sends.

    After each byte it is busy for some looks at it; what is written meanwhile is lost.
    """

    size = PAGE

    def __init__(self, base: int) -> None:
        self.base = base
        self.text = bytearray()
        self._busy = 0

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return whether there is room to send."""
        is_busy = self._busy > 0
        self._busy -= is_busy
        if offset in (5, 20):  # of a 16550
            return 0 if is_busy else 0x60
        return {0: 1 << 31, 4: 1}.get(offset, 0) if is_busy else 0

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Keep what is sent."""
        if offset == 0 and not self._busy:
            self.text.append(value & 0xFF)
            self._busy = 2


class DmaPort:
    """The registers of all channels of the DMA engine."""

    def __init__(self, base: int, stride: int, channels: int, work: Machine) -> None:
        self.base = base
        self.size = -(-stride * channels // PAGE) * PAGE
        self._stride = stride
        self.channels = [Channel(number) for number in range(channels)]
        self._work = work

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return what software reads; transfers that are over by now are over for it, too."""
        self._work.complete_transfers(hart.now)
        channel = offset // self._stride
        return self.channels[channel].read(offset % self._stride, size) if channel < len(self.channels) else 0

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Take what software writes; it may start a transfer."""
        channel, is_order = offset // self._stride, offset % self._stride == CONTROL
        hart.is_ordered = hart.is_ordered and is_order
        if channel < len(self.channels) and self.channels[channel].write(offset % self._stride, size, value):
            self._work.start_transfer(self.channels[channel], hart)


class Register:
    """A device with something that is written: what ends an emulation (QEMU's machine virt), or a watchdog."""

    size = PAGE

    def __init__(self, address: int, written: Callable[[Hart, int], None]) -> None:
        self.base = address // PAGE * PAGE
        self._place, self._written = address % PAGE, written

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return nothing."""
        return 0

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Pass on what is written to its one place."""
        if offset == self._place:
            self._written(hart, value)
