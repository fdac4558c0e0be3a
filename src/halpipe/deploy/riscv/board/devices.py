"""Devices beside the memories: clock and interrupts (CLINT), serial line, registers of the DMA, finisher."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.deploy.riscv.board.dma import Channel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.deploy.riscv.board.hart import Hart

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

    def _hart(self, number: int) -> Hart | None:
        return self.harts[number] if number < len(self.harts) else None


class Uart:
    """A serial line that is always ready to send, of either kind (SiFive or 16550): what is written is kept."""

    size = PAGE

    def __init__(self, base: int) -> None:
        self.base = base
        self.text = bytearray()

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return the status: nothing received, room to send."""
        return 0x60 if offset == 5 else 0

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """Keep what is sent."""
        if offset == 0:
            self.text.append(value & 0xFF)


class DmaPort:
    """The registers of all channels of the DMA engine."""

    def __init__(self, base: int, stride: int, channels: int, work: DmaWork) -> None:
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
        channel = offset // self._stride
        if channel < len(self.channels) and self.channels[channel].write(offset % self._stride, size, value):
            self._work.start_transfer(self.channels[channel], hart)


class DmaWork:
    """What the DMA engine asks of the machine."""

    def start_transfer(self, channel: Channel, hart: Hart) -> None:
        """Begin what the registers of `channel` describe."""
        raise NotImplementedError

    def complete_transfers(self, now: int) -> None:
        """Finish what is over at `now`."""
        raise NotImplementedError


class Finisher:
    """The device by which QEMU's machine virt ends."""

    size = PAGE

    def __init__(self, base: int, finish: Callable[[int], None]) -> None:
        self.base = base
        self._finish = finish

    def load(self, hart: Hart, offset: int, size: int) -> int:
        """Return nothing."""
        return 0

    def store(self, hart: Hart, offset: int, size: int, value: int) -> None:
        """End with the status that is written."""
        if value & 0xFFFF in (0x5555, 0x3333):
            self._finish(value >> 16)
