"""From exact promises to whole bursts per window: the two rules, and how well they keep the promise.

*whole*: the promise of every window is rounded up to bursts, window by window. No unit ever waits, and a phase on the
grid of windows takes one table entry; it fits where a schedule was made with --quantise.

*controlled*: the promise P(k) of windows [0, k) is rounded cumulatively, floor P(k) <= N(k) <= ceil P(k), with at most
`room` bursts in any window. It is a schedule of unit jobs: burst j of a row is released in the first window in which
ceil P reaches j, and due in the first in which floor P does. The fluid schedule is a fractional solution, the polytope
is integral, and EDF is optimal for unit jobs on `room` parallel slots; so where the promises fit, this finds bursts
that fit.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from fractions import Fraction
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.exporters.regulator.frames import MODE, Frame, Phase, Row

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence


Bursts = dict["Row", list[int]]


@record
class Overload:
    """A window in which more bursts are needed than there is room for."""

    window: int
    needed: int
    room: int


@record
class Promise:
    """The promise of one row: ``numerators[k] / denominator`` bursts in windows [0, k), exact."""

    numerators: Sequence[int]
    denominator: int

    def at(self, window: int) -> Fraction:
        """Return P(k)."""
        return Fraction(self.numerators[window], self.denominator)

    def floors(self) -> list[int]:
        """Return floor P(k) for every k."""
        return [value // self.denominator for value in self.numerators]

    def ceilings(self) -> list[int]:
        """Return ceil P(k) for every k."""
        return [-(-value // self.denominator) for value in self.numerators]


def pieces(frame: Frame, phase: Phase) -> Iterator[tuple[int, int]]:
    """Yield the stretches [begin, end) of a phase that lie inside its table; one that wraps has two on a circle."""
    if frame.kind == MODE and phase.end > frame.span:
        yield 0, phase.end - frame.span
        yield phase.begin, frame.span
    else:
        begin, end = max(phase.begin, 0), min(phase.end, frame.span)
        if begin < end:
            yield begin, end


def promises(frame: Frame, window: int, bursts: Fraction) -> dict[Row, Promise]:
    """Return the promise of every row that has any; `bursts` per window are what a bound of 1 promises."""
    by_row = grouped((phase.row, phase) for phase in frame.phases)
    return {row: _promise(frame, by_row[row], window, bursts) for row in sorted(by_row)}


def _promise(frame: Frame, phases: list[Phase], window: int, bursts: Fraction) -> Promise:
    # Bursts per tick of a phase are bound * bursts / window; counted in parts so fine that all are integers.
    rates = {bound: bound * bursts / window for bound in {phase.bound for phase in phases}}
    denominator = math.lcm(*(rate.denominator for rate in rates.values()))
    parts = {bound: rate.numerator * (denominator // rate.denominator) for bound, rate in rates.items()}
    count = frame.span // window
    steps = [0] * (count + 1)  # changes of the steady increment per window
    extra = [0] * (count + 1)  # what windows have that a phase only touches
    for phase in phases:
        rate = parts[phase.bound]
        for begin, end in pieces(frame, phase):
            first, last = -(-begin // window), end // window
            if first > last:  # inside one window
                extra[last] += rate * (end - begin)
                continue
            steps[first] += rate * window
            steps[last] -= rate * window
            extra[first - 1] += rate * (first * window - begin)
            extra[last] += rate * (end - last * window)
    increments = (steady + more for steady, more in zip(accumulate(steps), extra, strict=True))
    numerators = [0, *accumulate(increments)][: count + 1]
    return Promise(numerators, denominator)


def whole(promised: Mapping[Row, Promise]) -> Bursts:
    """Return bursts per window by the rule *whole*."""
    return {
        row: [-(-(after - before) // promise.denominator) for before, after in pairwise(promise.numerators)]
        for row, promise in promised.items()
    }


def totals(bursts: Mapping[Row, Sequence[int]], count: int) -> list[int]:
    """Return the sum over all rows for every window."""
    sums = [0] * count
    for row in bursts.values():
        sums = [a + b for a, b in zip(sums, row, strict=True)]
    return sums


def charged(bursts: Mapping[Row, Sequence[int]], count: int, before_first: Collection[Row]) -> list[int]:
    """Return what each window may have to carry: its bursts, and those shown in the window before and taken in it.

    AXI forbids to withdraw what was shown. A row that had bursts in the window before may therefore use one in this
    window, whatever its budget; in the first window that are the rows of `before_first`.
    """
    sums = [0] * count
    for row in {**bursts, **dict.fromkeys(before_first)}:
        granted = bursts.get(row) or [0] * count
        before = [row in before_first, *granted[:-1]]
        sums = [total + (n or (1 if p else 0)) for total, n, p in zip(sums, granted, before, strict=True)]
    return sums


def overload(
    bursts: Mapping[Row, Sequence[int]], count: int, room: int, before_first: Collection[Row] | None = None
) -> Overload | None:
    """Return the worst window above `room`, None if there is none; with `before_first` as for `charged`."""
    sums = totals(bursts, count) if before_first is None else charged(bursts, count, before_first)
    most = max(sums)
    return Overload(sums.index(most), most, room) if most > room else None


def controlled(promised: Mapping[Row, Promise], count: int, room: int) -> Bursts | Overload:
    """Return bursts per window by the rule *controlled*, or the first window in which more is due than fits."""
    rows = list(promised)
    due = [promised[row].floors() for row in rows]
    allowed = [promised[row].ceilings() for row in rows]
    given = [0] * len(rows)
    bursts = [[0] * count for _ in rows]
    busy = _busy(due, allowed, count)
    for k in range(count):
        spare = room
        eager = []
        for r in busy[k]:
            before = given[r]
            least = due[r][k + 1]
            if least > before:
                bursts[r][k] = least - before
                spare -= least - before
                given[r] = least
            if given[r] < allowed[r][k + 1]:
                eager.append(r)
        if spare < 0:
            return Overload(k, room - spare, room)
        if len(eager) > spare:  # those first whose next burst is due first
            eager.sort(key=lambda r: bisect_left(due[r], given[r] + 1, k + 2))
        for r in eager[:spare]:
            bursts[r][k] += 1
            given[r] += 1
    return dict(zip(rows, bursts, strict=True))


def controlled_seams(
    promised: Mapping[Row, Promise], count: int, room: int, before_first: Collection[Row]
) -> Bursts | Overload:
    """Return bursts by the rule *controlled* that leave room for what is carried over, see `charged`.

    One burst kept for every row that has any is always enough; fewer are tried first.
    """
    rows = len({*promised, *before_first})
    kept, fault = 0, None
    while True:
        found = controlled(promised, count, room - kept)
        if isinstance(found, Overload):
            return fault or found
        excess = overload(found, count, room, before_first)
        if excess is None:
            return found
        fault = fault or excess
        if kept == rows:
            return fault
        kept = min(rows, 2 * kept or 1)


def _busy(due: list[list[int]], allowed: list[list[int]], count: int) -> list[list[int]]:
    """Return for every window the rows that may need a burst there: those that have a share in it, or one open."""
    busy: list[list[int]] = [[] for _ in range(count)]
    for r, (low, high) in enumerate(zip(due, allowed, strict=True)):
        for k in range(count):
            if high[k + 1] > low[k]:
                busy[k].append(r)
    return busy
