"""The DMA engine as software sees it: the PDMA of SiFive (FU540 manual, chapter 12), with bandwidth and latency."""

from __future__ import annotations

from dataclasses import dataclass

CONTROL, CONFIG, BYTES, TARGET, SOURCE = 0x0, 0x4, 0x8, 0x10, 0x18
CLAIM, RUN, DONE, ERROR = 1, 2, 1 << 30, 1 << 31
_REGISTERS = 0x20


@dataclass(slots=True, eq=False)
class Transfer:
    """One transfer that was seen: `begin` and `end` in units of the machine's time; `data` is what was read.

    `held` is how long a regulator kept its bursts waiting, in all.
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
        claimed = self.control & CLAIM
        if not value & CLAIM:
            self.control = 0
        elif not claimed:  # claiming resets the registers of the next transfer
            self.control = CLAIM
            self._registers = bytearray(_REGISTERS)
        elif value & RUN and not self.control & RUN:
            self.control = CLAIM | RUN
            return True
        return False

    def finish(self, error: bool = False) -> None:
        """Say to software that the transfer is over."""
        self.control = self.control & ~RUN | (ERROR if error else DONE)

    def next(self) -> tuple[int, int, int]:
        """Return source, target and size of the transfer that software described."""
        word = self._registers
        source, target, size = (int.from_bytes(word[at : at + 8], "little") for at in (SOURCE, TARGET, BYTES))
        return source, target, size
