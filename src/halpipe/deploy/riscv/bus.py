"""How long transfers take: each channel has a rate of its own, and a regulator may stand before the memory.

A regulator admits a burst when what is left of the budget of the window covers it; else the burst waits for the next
window (docs/reference/regulator-unit.md). A transfer is followed from window to window and not from burst to burst.
Instants are in units of the machine, exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Protocol

from halpipe.deploy.riscv.hart import NEVER

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.deploy.riscv.dma import Transfer


@dataclass(frozen=True, slots=True)
class Opening:
    """A window in which bursts may pass: its begin and end, and the bytes that it grants."""

    begin: Fraction
    end: Fraction
    budget: int


class Gate(Protocol):
    """One direction of one unit, as its regulator plays it."""

    @property
    def burst(self) -> int:
        """The bytes of a whole burst; all of a transfer but its last are whole."""
        ...

    @property
    def overshoot(self) -> int:
        """By how many bytes the last burst of a window may exceed what is left of its budget."""
        ...

    def openings(self, since: Fraction) -> Iterator[Opening]:
        """Yield the windows with a budget, from the one at `since` on; it ends where none will ever have one."""
        ...


@dataclass(slots=True)
class Spent:
    """What a gate has let through in the window that it admitted something in last."""

    window: Fraction = Fraction(-1)
    used: int = 0


@dataclass(slots=True)
class _Crossing:
    """A transfer on its way through a gate, with what the gate had let through before it."""

    transfer: Transfer
    ready: int
    bandwidth: int
    gate: Gate
    before: Spent


class Bus:
    """The way of transfers to the memory: when each is over, by its channel's rate and by the gate before it.

    Transfers through one gate come one after the other, each when the one before it is over.
    """

    def __init__(self, rate: int) -> None:
        self._rate = rate  # units of time per second
        self._spent: dict[Gate, Spent] = {}
        self._crossing: list[_Crossing] = []

    def take(self, transfer: Transfer, ready: int, bandwidth: int, gate: Gate | None) -> None:
        """Say when a transfer is over whose first byte can move at `ready`; `NEVER` where its gate stays shut."""
        if gate is None or not transfer.size:
            transfer.end = ready - (-transfer.size * self._rate // bandwidth)
            return
        before = self._spent.get(gate, Spent())
        self._crossing = [c for c in self._crossing if c.transfer.end > ready]
        self._crossing.append(_Crossing(transfer, ready, bandwidth, gate, before))
        self._plan(self._crossing[-1])

    def replan(self, now: int) -> None:
        """Say anew when those are over that are on their way: what the gates will let through has changed."""
        for crossing in self._crossing:
            if crossing.transfer.end > now:
                self._plan(crossing)
                crossing.transfer.end = max(crossing.transfer.end, now)

    def release(self, transfer: Transfer) -> None:
        """Leave the end of a transfer as it stands."""
        self._crossing = [c for c in self._crossing if c.transfer is not transfer]

    def _plan(self, crossing: _Crossing) -> None:
        transfer, ready = crossing.transfer, crossing.ready
        self._spent[crossing.gate] = replace(crossing.before)
        per_byte = Fraction(self._rate, crossing.bandwidth)
        end = self._through(crossing.gate, transfer.size, Fraction(ready), per_byte)
        transfer.end = NEVER if end is None else ceil(end)
        transfer.held = NEVER if end is None else ceil(end - ready - transfer.size * per_byte)

    def _through(self, gate: Gate, size: int, now: Fraction, per_byte: Fraction) -> Fraction | None:
        """Return when the last of `size` bytes has passed a gate; None if it never does."""
        spent = self._spent[gate]
        for opening in gate.openings(now):
            now = max(now, opening.begin)
            left = opening.budget - (spent.used if spent.window == opening.begin else 0)
            moved = min(size, _covered(left, size, gate), _begun(opening.end - now, per_byte, gate.burst))
            if not moved:
                continue
            used = opening.budget - left + moved
            spent.window, spent.used = opening.begin, used
            size -= moved
            now += moved * per_byte
            if not size:
                return now
        return None


def _covered(left: int, size: int, gate: Gate) -> int:
    """Return the bytes of whole bursts that a budget covers, of which the last may exceed it by the overshoot."""
    if left <= 0:
        return 0
    if size <= left:
        return size
    bursts = left // gate.burst
    rest = min(gate.burst, size - bursts * gate.burst)
    return bursts * gate.burst + (rest if 0 < rest <= left - bursts * gate.burst + gate.overshoot else 0)


def _begun(time: Fraction, per_byte: Fraction, burst: int) -> int:
    """Return the bytes of the bursts that begin within some time, one after the other."""
    return ceil(time / (per_byte * burst)) * burst if time > 0 else 0
