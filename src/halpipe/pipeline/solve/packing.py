"""Modes that are nothing but bin packing: every task runs once on one of some units alike, and minds nobody else.

Then the order on a unit does not matter, and what is hard is to fill the units: perfect fits are lost by searches that
go by small steps, and by CP-SAT, since only the last few units show that the first were filled wrongly. Units are
filled one after the other: the longest task that is left, and others that leave no more idle than there is to spare
(bin completion; I. P. Gent 1998, R. E. Korf 2002). Sums that can be reached are the bits of a whole number, so that no
way is tried that cannot end well. What is chosen is drawn; a filling that ends badly is followed by another one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.durations import ZERO
from halpipe.models import Job
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.solve.draws import Draws

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.models import TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion

MAX_BITS = 200_000_000
"""Ticks of a hyperperiod, times tasks, up to which sums are kept as bits: 25 megabytes."""

LAST_UNITS, WAYS = 3, 16
"""So many units are filled in up to so many ways; those before them in one way that is drawn."""


def pack(
    model: TaskModel, expansion: Expansion, seed: int, fillings: int, go_on: Callable[[], bool]
) -> tuple[Job, ...] | None:
    """Return the jobs of a schedule; None if the mode is another problem, or is not packed in so many fillings."""
    if model.chains or not expansion.tasks or not all(map(_is_item, expansion.tasks)):
        return None
    groups: dict[tuple[str, ...], list[ActiveTask]] = {}
    for active in expansion.tasks:
        groups.setdefault(tuple(sorted(set(active.versions[0].units))), []).append(active)
    if sum(map(len, groups)) > len({unit for group in groups for unit in group}):  # sets of units that overlap
        return None
    tick = natural_tick(expansion)
    room = expansion.hyperperiod // tick
    if room * max(map(len, groups.values())) > MAX_BITS:
        return None
    jobs: list[Job] = []
    for units, members in groups.items():
        lengths = [(active.versions[0].wcet or ZERO) // tick for active in members]
        bins = fill(lengths, len(units), room, Draws(seed), fillings, go_on)
        if bins is None:
            return None
        for unit, items in zip(units, bins, strict=True):
            start = ZERO
            for item in items:
                active = members[item]
                end = start + (active.versions[0].wcet or ZERO)
                name = active.versions[0].name
                jobs.append(Job(task=active.name, index=0, start=start, end=end, version=name, units=(unit,)))
                start = end
    return tuple(jobs)


def _is_item(active: ActiveTask) -> bool:
    """Tell whether a task is one job of one version on one unit, at whatever time."""
    version, task = active.versions[0], active.task
    return (
        active.jobs == 1
        and len(active.versions) == 1
        and task.period is not None
        and task.offset is None
        and (task.deadline is None or (version.wcet or ZERO) <= task.deadline)
        and version.gang == 1
        and not version.precedences
        and not version.accesses
    )


def _shuffle(items: list[int], draws: Draws) -> None:
    for last in range(len(items) - 1, 0, -1):
        other = draws.below(last + 1)
        items[last], items[other] = items[other], items[last]


def fill(
    lengths: Sequence[int], bins: int, room: int, draws: Draws, fillings: int, go_on: Callable[[], bool]
) -> list[list[int]] | None:
    """Return which items each bin holds; None if they are not packed in so many fillings, or cannot be."""
    spare = bins * room - sum(lengths)
    if spare < 0:
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
    for _ in range(1 if bins > LAST_UNITS else WAYS):
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
