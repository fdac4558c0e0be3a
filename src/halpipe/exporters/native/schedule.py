"""Writer of the schedule XML (schema schedule-1.xsd); what it writes reads back to an equal schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.native.document import add, document, listed, serialise
from halpipe.quantities import format_rational
from halpipe.schemas import SCHEDULE

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.models import CostTerms, Job, ModeSchedule, Reaction, Schedule, TransitionTable


def format_schedule(schedule: Schedule) -> bytes:
    """Return the canonical XML of a schedule; jobs stay in their order."""
    root = document(
        SCHEDULE,
        model=schedule.model,
        model_sha256=schedule.model_sha256,
        generator=schedule.generator or None,
        solver=schedule.solver or None,
        seed=schedule.seed,
        tick=schedule.tick,
    )
    for mode in schedule.modes:
        _write_mode(root, mode)
    for table in schedule.transitions:
        _write_transition(root, table)
    for reaction in schedule.reactions:
        _write_reaction(root, reaction)
    return serialise(root, SCHEDULE)


def _write_mode(parent: etree._Element, mode: ModeSchedule) -> None:
    element = add(parent, "mode", name=mode.name, hyperperiod=mode.hyperperiod, status=mode.status)
    _write_jobs(element, mode.jobs)
    if mode.cost is not None:
        _write_cost(element, mode.cost)
    for unit in mode.unit_loads:
        add(element, "unit-load", unit=unit.unit, busy=unit.busy, share=format_rational(unit.share))
    for load in mode.resource_loads:
        peak, mean = format_rational(load.peak), format_rational(load.mean)
        add(element, "resource-load", resource=load.resource, peak=peak, mean=mean)
    for chain in mode.chains:
        add(element, "chain", name=chain.name, reaction=chain.reaction, age=chain.age)


def _write_jobs(parent: etree._Element, jobs: tuple[Job, ...]) -> None:
    for job in jobs:
        element = add(
            parent,
            "job",
            task=job.task,
            index=job.index,
            start=job.start,
            end=job.end,
            version=job.version,
            units=listed(job.units),
        )
        for part in job.parts:
            add(element, "part", start=part.start, end=part.end, from_=part.executed_from, to=part.executed_to)


def _write_cost(parent: etree._Element, cost: CostTerms) -> None:
    add(
        parent,
        "cost",
        total=format_rational(cost.total),
        overlap=format_rational(cost.overlap),
        access=format_rational(cost.access),
        precedence=format_rational(cost.precedence),
        unit=format_rational(cost.unit),
        occupancy=format_rational(cost.occupancy),
        timeliness=format_rational(cost.timeliness),
    )


def _write_transition(parent: etree._Element, table: TransitionTable) -> None:
    element = add(
        parent,
        "transition",
        from_=table.source,
        to=table.target,
        length=table.length,
        worst_latency=table.worst_latency,
        status=table.status,
    )
    _write_jobs(element, table.jobs)


def _write_reaction(parent: etree._Element, reaction: Reaction) -> None:
    add(
        parent,
        "reaction",
        mode=reaction.mode,
        task=reaction.task,
        on=reaction.event,
        count=reaction.count,
        cycles=reaction.cycles,
        action=reaction.action,
        to=reaction.target or None,
        within=reaction.within,
    )
