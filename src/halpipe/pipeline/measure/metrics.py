"""Figures of a schedule report beside the jobs: loads of units and resources, terms of the cost function."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.models import ModeSchedule, ResourceLoad, Status, UnitLoad
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Job, Schedule, TaskModel
    from halpipe.pipeline.jobs import Expansion


def mode_report(model: TaskModel, expansion: Expansion, jobs: Iterable[Job], status: Status) -> ModeSchedule:
    """Return the schedule of a mode with all its metrics; jobs by start, task and index."""
    ordered = tuple(sorted(jobs, key=lambda job: (job.start, job.task, job.index)))
    placement = Placement.of(expansion, ordered, model.units)
    return ModeSchedule(
        name=expansion.mode.name,
        hyperperiod=expansion.hyperperiod,
        status=status,
        jobs=ordered,
        cost=cost_terms(model, placement),
        unit_loads=_unit_loads(model, placement),
        resource_loads=_resource_loads(model, placement),
        chains=chain_latencies(placement, model.chains),
    )


def with_latencies(model: TaskModel, schedule: Schedule) -> Schedule:
    """Return a schedule of the model with all three figures of every chain, also those that it does not state."""
    modes = []
    for table in schedule.modes:
        placement = Placement.of(expand(model, model.mode(table.name)), table.jobs, model.units)
        modes.append(replace(table, chains=chain_latencies(placement, model.chains, complete=True)))
    return replace(schedule, modes=tuple(modes))


def _unit_loads(model: TaskModel, placement: Placement) -> tuple[UnitLoad, ...]:
    busy = dict.fromkeys((unit.name for unit in model.units), ZERO)
    for job in placement.jobs:
        for unit in dict.fromkeys(job.units):
            busy[unit] += placement.tick * sum(end - start for start, end in job.occupations())
    total = placement.expansion.hyperperiod
    return tuple(
        UnitLoad(unit=name, busy=time, share=time / total if total else Fraction(0)) for name, time in busy.items()
    )


def _resource_loads(model: TaskModel, placement: Placement) -> tuple[ResourceLoad, ...]:
    loads = []
    for resource in model.resources:
        steps = placement.claims.get(resource.name, [])
        peak = Fraction(max((step.level for step in steps), default=0), placement.quanta)
        area = Fraction(sum((step.end - step.begin) * step.level for step in steps), placement.quanta)
        mean = area / placement.hyperperiod if steps else Fraction(0)
        loads.append(ResourceLoad(resource=resource.name, peak=peak, mean=mean))
    return tuple(loads)
