"""Objectives for valid schedules, as exact numbers; smaller is better.

- ``chains``: the sum of reaction time and data age over all chains, each times its weight, in nanoseconds (MODEL 3).
- ``jitter``: the sum over the periodic tasks of their start jitter, the largest less the least delay of their jobs.
- ``margin``: the share of its own length by which every stay on a unit could last longer before the next begins there,
  the least of all; negated, since more is better.
- ``preemptions``: the number of gaps of all jobs.
- ``cost``: the cost function F (paper, section III); of a valid schedule, its bonuses with a minus sign.
"""

from __future__ import annotations

from enum import StrEnum
from fractions import Fraction
from math import lcm
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.margins import least_margin
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.parts import latest_phase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, Job, TaskModel
    from halpipe.pipeline.jobs import Expansion

NEVER = Fraction(10**30)
"""Latency of a chain through which no data arrives: worse than any."""


class Objective(StrEnum):
    """Objective of the search, see above."""

    CHAINS = "chains"
    JITTER = "jitter"
    MARGIN = "margin"
    PREEMPTIONS = "preemptions"
    COST = "cost"


@record
class Worth:
    """The values of the objectives in their order."""

    values: tuple[Fraction, ...]


@record
class Judge:
    """Comparison of the valid schedules of a mode by their objectives."""

    model: TaskModel
    expansion: Expansion
    objectives: tuple[Objective, ...]

    def worth(self, jobs: Iterable[Job]) -> Worth:
        """Measure a schedule."""
        placement = Placement.of(self.expansion, jobs, self.model.units)
        return Worth(tuple(MEASURES[objective](self.model, placement) for objective in self.objectives))

    def better(self, jobs: Iterable[Job], first: Worth, best: Worth) -> Worth | None:
        """Return the worth of a schedule if it is no less than the `best`, and nothing is worse than in the `first`."""
        worth = self.worth(jobs)
        return worth if worth.values <= best.values and self.keeps(first, worth) else None

    @property
    def chain_weights(self) -> tuple[int, ...]:
        """Return the whole weight of a tick of each chain's latencies, of the chains whose tasks all run."""
        return whole_weights(chain for chain in self.model.chains if self.expansion.by_name.keys() >= set(chain.tasks))

    @property
    def is_led_by_chains(self) -> bool:
        """Whether latencies come first, and after them nothing but the bonuses."""
        return self.objectives in ((Objective.CHAINS,), (Objective.CHAINS, Objective.COST))

    def keeps(self, first: Worth, other: Worth) -> bool:
        """Return whether nothing that counts is worse than in the first schedule."""
        return all(now <= before for before, now in zip(first.values, other.values, strict=True))


def _nanoseconds(time: Duration | None) -> Fraction:
    return NEVER if time is None else Fraction(time.ns)


def whole_weights(chains: Iterable[Chain]) -> tuple[int, ...]:
    """Return the weights of chains as whole numbers in the same proportion."""
    weights = [chain.weight for chain in chains]
    common = lcm(*(weight.denominator for weight in weights))
    return tuple(int(weight * common) for weight in weights)


def sum_of_latencies(model: TaskModel, placement: Placement) -> Fraction:
    """Return the weighted sum of reaction time and data age of all chains, in nanoseconds."""
    weights = {chain.name: chain.weight for chain in model.chains}
    return sum(
        (
            weights[found.name] * _nanoseconds(time)
            for found in chain_latencies(placement, model.chains)
            for time in (found.reaction, found.age)
        ),
        Fraction(0),
    )


def sum_of_jitters(_model: TaskModel, placement: Placement) -> Fraction:
    """Return the sum of the start jitters of all periodic tasks, in nanoseconds."""
    total = 0
    for active in placement.expansion.tasks:
        jobs = placement.by_task[active.name]
        if active.task.period is not None and jobs:
            step = active.task.period // placement.tick
            delays = sorted((job.start - job.index * step) % placement.hyperperiod for job in jobs)
            phase = latest_phase(delays, placement.hyperperiod)
            total += max((delay - phase) % placement.hyperperiod for delay in delays)
    return Fraction(placement.tick.ns) * total


def number_of_gaps(_model: TaskModel, placement: Placement) -> Fraction:
    """Return how often jobs are preempted."""
    return Fraction(sum(len(job.parts) - 1 for job in placement.jobs if job.parts))


def cost(model: TaskModel, placement: Placement) -> Fraction:
    """Return the cost F."""
    return cost_terms(model, placement).total


MEASURES: dict[Objective, Callable[[TaskModel, Placement], Fraction]] = {
    Objective.CHAINS: sum_of_latencies,
    Objective.JITTER: sum_of_jitters,
    Objective.MARGIN: lambda _, placement: -least_margin(placement),
    Objective.PREEMPTIONS: number_of_gaps,
    Objective.COST: cost,
}
