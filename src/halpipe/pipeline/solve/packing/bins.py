"""Bin packing: what takes one height of what is shared, such as jobs on one of some units alike.

Then the order in a bin does not matter, and what is hard is to fill the bins: perfect fits are lost by searches that go
by small steps, and by CP-SAT, since only the last few bins show that the first were filled wrongly. Bins are filled one
after the other: the longest item that is left, and others that leave no more idle than there is to spare (bin
completion; I. P. Gent 1998, R. E. Korf 2002). Sums that can be reached are the bits of a whole number, so that no way
is tried that cannot end well. What is chosen is drawn; a filling that ends badly is followed by another one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.pipeline.solve.draws import Draws

MAX_BITS = 200_000_000
"""Room of a bin, times items, up to which sums are kept as bits: 25 megabytes."""

LAST_BINS, WAYS = 3, 16
"""So many bins are filled in up to so many ways; those before them in one way that is drawn."""


def _shuffle(items: list[int], draws: Draws) -> None:
    for last in range(len(items) - 1, 0, -1):
        other = draws.below(last + 1)
        items[last], items[other] = items[other], items[last]


def fill(
    lengths: Sequence[int], bins: int, room: int, draws: Draws, fillings: int, go_on: Callable[[], bool]
) -> list[list[int]] | None:
    """Return which items each bin holds; None if they are not packed in so many fillings, or cannot be."""
    spare = bins * room - sum(lengths)
    if spare < 0 or room * len(lengths) > MAX_BITS:
        return None
    order = sorted(range(len(lengths)), key=lambda item: (-lengths[item], item))
    for _ in range(fillings):
        filled = _fill(lengths, order, bins, room, spare, draws)
        if filled is not None:
            return filled
        if not go_on():
            break
    return None


def _fill(
    lengths: Sequence[int], left: list[int], bins: int, room: int, spare: int, draws: Draws
) -> list[list[int]] | None:
    """Fill bins with the items left, longest first, wasting at most `spare`; the first bins in one way, drawn."""
    if not left:
        return [[] for _ in range(bins)]
    if bins == 0:
        return None
    seen: set[frozenset[int]] = set()
    for _ in range(1 if bins > LAST_BINS else WAYS):
        chosen = _complete(lengths, left, room, spare, draws)
        if chosen is None:
            return None
        key = frozenset(chosen)
        if key in seen:
            continue
        seen.add(key)
        waste = room - sum(lengths[item] for item in chosen)
        rest = _fill(lengths, [item for item in left if item not in key], bins - 1, room, spare - waste, draws)
        if rest is not None:
            return [chosen, *rest]
    return None


def _complete(lengths: Sequence[int], left: list[int], room: int, spare: int, draws: Draws) -> list[int] | None:
    """Return the longest item left, with others that are drawn and leave at most `spare` of a bin; None if none do."""
    first, *others = left
    _shuffle(others, draws)
    wanted = room - lengths[first]
    if wanted < 0:
        return None
    mask = (1 << (wanted + 1)) - 1
    sums = [1]  # sums[k]: bit s is set if the first k of the others reach the sum s
    for item in others:
        sums.append((sums[-1] | sums[-1] << lengths[item]) & mask)
    reached = sums[-1] >> max(0, wanted - spare)
    if not reached:
        return None
    target = max(0, wanted - spare) + reached.bit_length() - 1
    chosen = [first]
    for number in range(len(others) - 1, -1, -1):
        if not sums[number] >> target & 1:
            chosen.append(others[number])
            target -= lengths[others[number]]
    return chosen
