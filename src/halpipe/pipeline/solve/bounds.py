"""Lower bounds of objectives, from arithmetic alone.

Along a chain the WCETs add up, and the first task's period for a stimulus that it just missed. Whatever the phases, a
task k of the chain starts at instants that lie, seen from the jobs of the first task, in D_k / g different places of
its period, g = gcd(D_1, D_k); if all latencies are at least M, the greatest is at least M + D_k - g, less what the
slacks of both may take back. The same holds for data age seen from the jobs of the last task.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, greatest_common_divisor
from halpipe.pipeline.measure.objectives import LARGEST_MARGIN, Objective

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion


def lower_bound(objective: Objective, model: TaskModel, expansion: Expansion) -> Fraction | None:
    """Return what no valid schedule of a mode falls below; None where nothing is known."""
    match objective:
        case Objective.CHAINS:
            return sum((chain.weight * sum(bounds) for chain, bounds in chain_bounds(model, expansion)), Fraction(0))
        case Objective.JITTER | Objective.PREEMPTIONS:
            return Fraction(0)
        case Objective.MARGIN:
            return -_largest_margin(expansion)
        case _:
            return None


def chain_bounds(model: TaskModel, expansion: Expansion) -> list[tuple[Chain, tuple[Fraction, Fraction]]]:
    """Return the least reaction time and data age, in nanoseconds, of every chain whose tasks all run."""
    found = []
    for chain in model.chains:
        if expansion.by_name.keys() >= set(chain.tasks):
            members = [expansion.by_name[name] for name in chain.tasks]
            found.append((chain, (Fraction(_reaction(members).ns), Fraction(_age(members).ns))))
    return found


def _reaction(members: list[ActiveTask]) -> Duration:
    first = members[0]
    work = sum((_least(member) for member in members), ZERO)
    if first.task.period is None:
        return work
    period = first.task.period
    spread = max((_spread(first, member) for member in members[1:]), default=ZERO)
    return max(work + period, work + period - _late(first) + spread)


def _age(members: list[ActiveTask]) -> Duration:
    last = members[-1]
    work = sum((_least(member) for member in members), ZERO)
    return work + max((_spread(last, member) for member in members[:-1]), default=ZERO)


def _spread(seen_from: ActiveTask, member: ActiveTask) -> Duration:
    """Return by how much the latencies of the jobs of one task differ at least, because another has its own period."""
    one, other = seen_from.task.period, member.task.period
    if one is None or other is None:
        return ZERO
    gained = other - greatest_common_divisor([one, other]) - _late(member) - _late(seen_from)
    return max(ZERO, gained)


def _least(active: ActiveTask) -> Duration:
    return min((version.wcet for version in active.versions if version.wcet is not None), default=ZERO)


def _late(active: ActiveTask) -> Duration:
    """Return how far the jobs of a task may be from strictly periodic."""
    period = active.task.period
    return ZERO if period is None or active.jobs < 2 else period * active.task.slack


def _largest_margin(expansion: Expansion) -> Fraction:
    """Return by what share all WCETs could grow before the units were too few for the work, or a job for its circle."""
    units = {name for active in expansion.tasks for version in active.versions for name in version.units}
    work = Fraction(0)
    least = LARGEST_MARGIN
    for active in expansion.tasks:
        if active.task.period is None or not active.jobs:
            continue
        times = [v.wcet.fraction * v.gang for v in active.versions if v.wcet]
        work += active.jobs * min(times, default=Fraction(0))
        shortest = min((v.wcet.fraction for v in active.versions if v.wcet), default=Fraction(0))
        if shortest:
            least = min(least, expansion.hyperperiod.fraction / shortest - 1)
    if work:
        least = min(least, len(units) * expansion.hyperperiod.fraction / work - 1)
    return min([least, *_margins_of_units(expansion)])


def _margins_of_units(expansion: Expansion) -> Iterator[Fraction]:
    """Yield by what share WCETs could grow before a unit had too much of what runs there alone, or two jobs met."""
    by_unit: dict[str, list[ActiveTask]] = {}
    for active in expansion.tasks:
        sets = {(frozenset(version.units), version.gang) for version in active.versions}
        if active.task.period is not None and _least(active) and len(sets) == 1:
            units, gang = sets.pop()
            for unit in units if gang == len(units) else ():
                by_unit.setdefault(unit, []).append(active)
    for own in by_unit.values():
        yield 1 / sum((_least(each).fraction / _period(each).fraction for each in own), Fraction(0)) - 1
        longest: dict[Duration, list[Duration]] = {}
        for each in own:
            if not each.task.slack and not any(version.split.is_allowed for version in each.versions):
                longest.setdefault(_period(each), []).append(_least(each))
        tops = [(period, wcet) for period, wcets in longest.items() for wcet in sorted(wcets, reverse=True)[:2]]
        for (period, wcet), (other, its) in combinations(tops, 2):
            yield greatest_common_divisor([period, other]).fraction / (wcet + its).fraction - 1


def _period(active: ActiveTask) -> Duration:
    assert active.task.period is not None, "it was asked for"
    return active.task.period
