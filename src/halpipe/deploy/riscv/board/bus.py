"""Duration of transfers: channels share the bus, and a regulator may stand between a unit and the memory.

Channels move bytes at their own rates, or at equal shares of the bus where these are too much for it. A regulator
admits a burst when what is left of the budget of the window covers it; else the burst waits for the next window
(docs/reference/regulator-unit.md). What flows is followed from change to change and not from burst to burst. Instants
are in units of the machine, bytes may be parts of one; all is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.deploy.riscv.board.hart import NEVER

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.deploy.riscv.board.devices import Transfer

NONE = Fraction(0)
LANES = 8
"""Bytes of a beat, in which source and target of a transfer may lie differently."""


@record
class Opening:
    """A window in which bursts may pass: its begin and end, and the bytes that it grants."""

    begin: Fraction
    end: Fraction
    budget: int


@record
class Gate:
    """One direction of one unit, as its regulator plays it; transfers pass it one after the other.

    All bursts of a transfer but its last have `burst` bytes, and cost whole beats of `beat` bytes. The last burst of a
    window may exceed what is left of its budget by `overshoot`. `openings` yields the windows with a budget, from the
    one at an instant on; it ends where none will ever have one.
    """

    openings: Callable[[Fraction], Iterator[Opening]]
    burst: int
    beat: int
    overshoot: int


@dataclass(slots=True)
class _Spent:
    """Bytes that a gate has admitted in the last window in which it admitted any."""

    window: Fraction = Fraction(-1)
    used: int = 0


@dataclass(slots=True)
class _Flow:
    """The bytes of one transfer: `left` have still to move, of which `covered` are of bursts that were admitted."""

    transfer: Transfer
    ready: Fraction
    rate: Fraction  # bytes in a unit of time, if it has the bus for itself
    left: Fraction
    gate: Gate | None
    spent: _Spent = field(default_factory=_Spent)
    covered: Fraction = NONE
    opening: Opening | None = None

    def copy(self) -> _Flow:
        """Return a copy of the flow, to look ahead."""
        return replace(self, spent=replace(self.spent))

    def admit(self, now: Fraction) -> None:
        """Admit what the budget covers now; in a new window that is what has not begun to move before."""
        if self.gate is None:
            self.covered = self.left
            return
        if self.opening is None or now >= self.opening.end:
            moved = self.transfer.size - self.left
            self.covered = min(-moved % self.gate.burst, self.left)
            self.opening = next(self.gate.openings(now), None)
        if self.opening is not None and now >= self.opening.begin:
            used = self.spent.used if self.spent.window == self.opening.begin else 0
            more, cost = _covered(self.opening.budget - used, int(self.left - self.covered), self.gate)
            self.covered += more
            if more:
                self.spent.window, self.spent.used = self.opening.begin, used + cost

    def changes(self, now: Fraction, rate: Fraction) -> Iterator[Fraction]:
        """Yield when something changes for it, if until then it moves at a rate: 0 while it waits."""
        if rate:
            yield now + min(self.left, self.covered) / rate
        if self.opening is not None:
            yield self.opening.begin if now < self.opening.begin else self.opening.end


class Bus:
    """The way of transfers to the memory; `capacity` is what all channels move together, in bytes per second."""

    def __init__(self, rate: int, capacity: int | None = None) -> None:
        self._units = rate  # of time, in a second
        self._capacity = None if capacity is None else Fraction(capacity, rate)
        self._now = NONE
        self._flows: list[_Flow] = []
        self._spent: dict[Gate, _Spent] = {}

    def take(self, transfer: Transfer, ready: int, bandwidth: int, gate: Gate | None) -> None:
        """Take a transfer whose first byte can move at `ready`; say when all are over, `NEVER` where a gate is shut."""
        self._pass(transfer.begin)
        spent = _Spent() if gate is None else self._spent.setdefault(gate, _Spent())
        rate = Fraction(bandwidth, self._units)
        begin = ready + _lag(transfer) / rate
        self._flows.append(_Flow(transfer, begin, rate, Fraction(transfer.size), gate, spent))
        self._plan()

    def replan(self, now: int) -> None:
        """Say anew when those are over that are on their way: what the gates will let through has changed."""
        self._pass(now)
        for flow in self._flows:
            flow.opening = None
        self._plan()

    def release(self, transfer: Transfer) -> None:
        """Leave the end of a transfer as it stands from now on; its bytes still take their time."""
        for flow in self._flows:
            if flow.transfer is transfer:
                flow.transfer = replace(transfer)

    def _pass(self, now: int) -> None:
        """Let time pass."""
        if self._flows:
            _flow(self._flows, self._now, Fraction(now), self._capacity)
        self._now = max(self._now, Fraction(now))
        self._flows = [flow for flow in self._flows if flow.left]

    def _plan(self) -> None:
        for flow, end in _flow([f.copy() for f in self._flows], self._now, None, self._capacity):
            transfer = flow.transfer
            transfer.end = NEVER if end is None else ceil(end)
            transfer.held = NEVER if end is None else ceil(end - flow.ready - transfer.size / flow.rate)


def _lag(transfer: Transfer) -> int:
    """Return the bytes in whose time a misaligned transfer ends later than an aligned one: it has more beats.

    One that begins in a lower lane than it is read from has another, for its bytes come from two beats each.
    """
    source, target, size = transfer.source % LANES, transfer.target % LANES, transfer.size
    beats = -(-(target + size) // LANES) + (source > target)
    return beats * LANES - size if source or target else 0


def _flow(
    flows: Sequence[_Flow], now: Fraction, until: Fraction | None, capacity: Fraction | None
) -> list[tuple[_Flow, Fraction | None]]:
    """Let bytes move up to an instant, or to the end; return when each was over, None for one that never will be."""
    over: list[tuple[_Flow, Fraction | None]] = [(flow, max(now, flow.ready)) for flow in flows if not flow.left]
    waiting = [flow for flow in flows if flow.left]
    while waiting and (until is None or now < until):
        ready = [flow for flow in waiting if flow.ready <= now]
        for flow in ready:
            flow.admit(now)
        rates = _shared([flow.rate if flow.covered else NONE for flow in ready], capacity)
        changes = [flow.ready for flow in waiting if flow.ready > now]
        changes += [change for flow, rate in zip(ready, rates, strict=True) for change in flow.changes(now, rate)]
        if not changes:
            break
        then = min(changes) if until is None else min(*changes, until)
        for flow, rate in zip(ready, rates, strict=True):
            flow.left -= rate * (then - now)
            flow.covered -= rate * (then - now)
        over += [(flow, then) for flow in ready if not flow.left]
        waiting = [flow for flow in waiting if flow.left]
        now = then
    return [*over, *((flow, None) for flow in waiting)]


def _shared(rates: Sequence[Fraction], capacity: Fraction | None) -> list[Fraction]:
    """Return what each channel gets: its own rate, or the share at which together they fill the bus."""
    if capacity is None or sum(rates, NONE) <= capacity:
        return list(rates)
    return [min(rate, share_of(rates, capacity)) for rate in rates]


def share_of(rates: Iterable[Fraction], capacity: Fraction) -> Fraction:
    """Return the share for which the lesser of it and of each rate sum to the capacity, which all together exceed."""
    left, several = capacity, sorted(rate for rate in rates if rate)
    for number, rate in enumerate(several):
        share = left / (len(several) - number)
        if rate >= share:
            return share
        left -= rate
    raise ValueError("together they do not fill the capacity")


def _covered(left: int, size: int, gate: Gate) -> tuple[int, int]:
    """Return the bytes of bursts that a budget covers, and what they cost: whole beats, also of a last partial burst.

    The last burst may exceed the budget by the overshoot.
    """
    if left <= 0:
        return 0, 0
    whole = min(left, size) // gate.burst * gate.burst
    rest = min(gate.burst, size - whole)
    cost = -(-rest // gate.beat) * gate.beat
    if not 0 < cost <= left - whole + gate.overshoot:
        return whole, whole
    return whole + rest, whole + cost
