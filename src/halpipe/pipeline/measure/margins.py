"""Margins of WCETs: the least of a schedule, and the largest that any schedule of a mode can have.

The margin of a stay on a unit is the share of its own length by which it could last longer before the next one begins
there. All numbers are exact.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.measure.placement import Placement

LARGEST_MARGIN = Fraction(100)
"""Growth beyond a hundred times the WCET is of no interest; a job alone on its unit would have no bound."""


def least_margin(placement: Placement) -> Fraction:
    """Return by what share of its length every stay on a unit could last longer, at most `LARGEST_MARGIN`."""
    least, length = LARGEST_MARGIN, placement.hyperperiod
    stays: dict[str, list[tuple[int | Fraction, int | Fraction]]] = {}
    for job in placement.jobs:
        spans = [(start % length, end - start) for start, end in job.occupations() if start < end]
        for unit in dict.fromkeys(job.units) if spans else ():
            stays.setdefault(unit, []).extend(spans)
    for on_unit in stays.values():
        on_unit.sort()
        following = [*(start for start, _ in on_unit[1:]), on_unit[0][0] + length]
        for (start, own), then in zip(on_unit, following, strict=True):
            if then - start - own < own * least:
                least = Fraction(then - start - own) / own
    return least


def largest_margin(expansion: Expansion) -> Fraction:
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
        if active.task.period is not None and least_wcet(active) and len(sets) == 1:
            units, gang = sets.pop()
            for unit in units if gang == len(units) else ():
                by_unit.setdefault(unit, []).append(active)
    for own in by_unit.values():
        yield 1 / sum((least_wcet(each).fraction / _period(each).fraction for each in own), Fraction(0)) - 1
        longest: dict[Duration, list[Duration]] = {}
        for each in own:
            if not each.task.slack and not any(version.split.is_allowed for version in each.versions):
                longest.setdefault(_period(each), []).append(least_wcet(each))
        tops = [(period, wcet) for period, wcets in longest.items() for wcet in sorted(wcets, reverse=True)[:2]]
        for (period, wcet), (other, its) in combinations(tops, 2):
            yield greatest_common_divisor([period, other]).fraction / (wcet + its).fraction - 1


def _period(active: ActiveTask) -> Duration:
    assert active.task.period is not None, "it was asked for"
    return active.task.period


def least_wcet(active: ActiveTask) -> Duration:
    """Return the shortest WCET of the versions of a task."""
    return min((version.wcet for version in active.versions if version.wcet is not None), default=ZERO)
