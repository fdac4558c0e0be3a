"""The modes that packing is for: every task runs once, in one version, and waits for nobody.

A task takes some of what it shares with others for some time: units that are treated alike, or a resource. Where the
sum of all is no more than there is, they may all run at once. Each of the others is a board of its own, as long as no
task has to do with two of them: what is placed on one leaves the others as they are.
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.models import Job
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.solve.draws import Draws
from halpipe.pipeline.solve.kernel.arc_colouring import Arc, assign_units
from halpipe.pipeline.solve.packing import bins, boards

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion

Units = tuple[str, ...]


@record
class Claim:
    """What a task takes of what it shares: so much of it, for so long, from an offset after its start on; in ticks."""

    task: int
    offset: int
    length: int
    height: int


@record
class Shared:
    """Units that are treated alike, or a resource (no units), in as many parts as its bounds have; and who takes it."""

    units: Units
    capacity: int
    claims: tuple[Claim, ...]

    @property
    def is_contested(self) -> bool:
        """Whether not all can have it at once."""
        return sum(claim.height for claim in self.claims) > self.capacity


def pack(
    model: TaskModel, expansion: Expansion, seed: int, fillings: int, go_on: Callable[[], bool]
) -> tuple[Job, ...] | None:
    """Return the jobs of a schedule; None if the mode is another problem, or is not packed in so many fillings."""
    versions = [active.versions[0] for active in expansion.tasks]
    if model.chains or not versions or not all(map(_runs_alone, expansion.tasks)):
        return None
    groups = dict.fromkeys(_units(version) for version in versions)
    if sum(map(len, groups)) > len({unit for group in groups for unit in group}):  # sets of units that overlap
        return None
    tick = natural_tick(expansion)
    shared = [*_shared_units(versions, groups, tick), *_shared_resources(versions, tick)]
    contested = [each for each in shared if each.is_contested]
    tasks = [claim.task for each in contested for claim in each.claims]
    if len(tasks) > len(set(tasks)):
        return None
    room, draws = expansion.hyperperiod // tick, Draws(seed)
    starts = [0] * len(versions)
    for each in contested:
        filled = _fill(each, room, draws, fillings, go_on)
        if filled is None:
            return None
        for claim, start in zip(each.claims, filled, strict=True):
            starts[claim.task] = (start - claim.offset) % room
    units = _dealt(shared, starts, room)
    return None if units is None else tuple(_jobs(expansion, starts, units, tick))


def _runs_alone(active: ActiveTask) -> bool:
    """Tell whether a task is one job of one version, at whatever time."""
    version, task = active.versions[0], active.task
    return (
        active.jobs == 1
        and len(active.versions) == 1
        and task.period is not None
        and task.offset is None
        and (task.deadline is None or (version.wcet or ZERO) <= task.deadline)
        and not version.precedences
    )


def _units(version: Version) -> Units:
    return tuple(sorted(set(version.units)))


def _shared_units(versions: Sequence[Version], groups: Mapping[Units, None], tick: Duration) -> Iterator[Shared]:
    claims: dict[Units, list[Claim]] = {group: [] for group in groups}
    for task, version in enumerate(versions):
        claims[_units(version)].append(Claim(task, 0, (version.wcet or ZERO) // tick, version.gang))
    for group, found in claims.items():
        yield Shared(group, len(group), tuple(found))


def _shared_resources(versions: Sequence[Version], tick: Duration) -> Iterator[Shared]:
    accesses = [(task, access) for task, version in enumerate(versions) for access in version.accesses]
    for name in dict.fromkeys(access.resource for _, access in accesses):
        own = [(task, access) for task, access in accesses if access.resource == name]
        parts = math.lcm(*(access.bound.denominator for _, access in own))
        claims = (
            Claim(task, access.start // tick, (access.end - access.start) // tick, int(access.bound * parts))
            for task, access in own
        )
        yield Shared((), parts, tuple(claims))


def _fill(shared: Shared, room: int, draws: Draws, fillings: int, go_on: Callable[[], bool]) -> Sequence[int] | None:
    """Return where each claim begins, so that none passes the end of the hyperperiod."""
    heights = {claim.height for claim in shared.claims}
    if len(heights) > 1:
        sides = [(claim.length, claim.height) for claim in shared.claims]
        return boards.fill_board(sides, shared.capacity, room, draws, fillings, go_on)
    lengths = [claim.length for claim in shared.claims]
    filled = bins.fill(lengths, shared.capacity // heights.pop(), room, draws, fillings, go_on)
    if filled is None:
        return None
    starts = [0] * len(lengths)
    for items in filled:
        for item, start in zip(items, accumulate((lengths[item] for item in items), initial=0), strict=False):
            starts[item] = start
    return starts


def _dealt(shared: Sequence[Shared], starts: Sequence[int], room: int) -> dict[int, Units] | None:
    """Return the units of each task: own ones where there are enough for all, else those that are idle."""
    dealt: dict[int, Units] = {}
    for each in shared:
        if not each.units:
            continue
        if each.is_contested:
            arcs = [Arc(claim.task, starts[claim.task], claim.length, claim.height) for claim in each.claims]
            tracks = assign_units(arcs, each.capacity, room)
            if tracks is None:
                return None
            dealt |= {task: tuple(each.units[track] for track in sorted(own)) for task, own in tracks.items()}
        else:
            firsts = accumulate((claim.height for claim in each.claims), initial=0)
            for claim, first in zip(each.claims, firsts, strict=False):
                dealt[claim.task] = each.units[first : first + claim.height]
    return dealt


def _jobs(expansion: Expansion, starts: Sequence[int], units: Mapping[int, Units], tick: Duration) -> Iterator[Job]:
    for task, active in enumerate(expansion.tasks):
        version, start = active.versions[0], tick * starts[task]
        end = start + (version.wcet or ZERO)
        yield Job(task=active.name, index=0, start=start, end=end, version=version.name, units=units[task])
