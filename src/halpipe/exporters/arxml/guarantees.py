"""Timing guarantees of a schedule: recurrence and response times of tasks, and latencies of chains, in each mode."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import add, named, ref
from halpipe.exporters.arxml.layout import ShortNames
from halpipe.exporters.arxml.timing import latency, periodic
from halpipe.exporters.common.timeline import delays_of

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.arxml.timing import Descriptions
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel


def write_guarantees(elements: etree._Element, model: TaskModel, schedule: Schedule, known: Descriptions) -> None:
    """Append one element with guarantees for each mode, which hold while the mode is played, switches apart."""
    names = ShortNames()
    for table in schedule.modes:
        short_name = names("Guarantees", known.layout.modes[table.name])
        timing = named(elements, "SYSTEM-TIMING", short_name, f"proven for mode {table.name}")
        _mode(add(timing, "TIMING-GUARANTEES"), model, table, known)
        ref(timing, "SYSTEM-REF", "SYSTEM", known.layout.path("System", "System"))


def _mode(parent: etree._Element, model: TaskModel, table: ModeSchedule, known: Descriptions) -> None:
    jobs: dict[str, list[Job]] = {}
    for job in table.jobs:
        jobs.setdefault(job.task, []).append(job)
    names = ShortNames()
    for task in model.tasks:
        found = jobs.get(task.name)
        if task.period is None or not found:
            continue
        short_name = known.layout.tasks[task.name]
        delays = delays_of(task, task.period, found, table.hyperperiod)
        jitter = max(delays) - min(delays)
        periodic(parent, names(short_name, "period"), known.event(task.name), task.period, jitter)
        response = max(delay + (job.end - job.start) for delay, job in zip(delays, found, strict=True))
        latency(parent, names(short_name, "response"), "REACTION", known.response(task.name), response, up=True)
    for chain in table.chains:
        forward = chain.reaction if chain.latency is None else chain.latency
        for kind, value in (("REACTION", forward), ("AGE", chain.age)):
            if value is not None:
                latency(parent, names(chain.name, kind.lower()), kind, known.chains[chain.name], value, up=True)
