"""Writer of the schedule XML (schema schedule-1.xsd); what it writes reads back to an equal schedule.

Figures that decide nothing are left out where their exact form is too long to be read again.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

from halpipe.core.quantities import is_writable
from halpipe.exporters.native.document import add_element, attributes_of, document, serialise
from halpipe.schemas import SCHEDULE

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.models import Job, ModeSchedule, Schedule


def format_schedule(schedule: Schedule) -> bytes:
    """Return the canonical XML of a schedule; jobs stay in their order."""
    root = document(SCHEDULE, attributes_of(schedule))
    for mode in schedule.modes:
        _write_mode(root, mode)
    for table in schedule.transitions:
        _write_jobs(add_element(root, "transition", table), table.jobs)
    for reaction in schedule.reactions:
        add_element(root, "reaction", reaction)
    return serialise(root, SCHEDULE)


def _write_mode(parent: etree._Element, mode: ModeSchedule) -> None:
    margin, bound = (each if each is None or is_writable(each) else None for each in (mode.margin, mode.margin_bound))
    element = add_element(parent, "mode", replace(mode, margin=margin, margin_bound=bound))
    _write_jobs(element, mode.jobs)
    if mode.cost is not None and all(is_writable(getattr(mode.cost, term.name)) for term in fields(mode.cost)):
        add_element(element, "cost", mode.cost)
    for unit in mode.unit_loads:
        add_element(element, "unit-load", unit)
    for resource in mode.resource_loads:
        peak, mean = (each if each is None or is_writable(each) else None for each in (resource.peak, resource.mean))
        add_element(element, "resource-load", replace(resource, peak=peak, mean=mean))
    for chain in mode.chains:
        add_element(element, "chain", chain)


def _write_jobs(parent: etree._Element, jobs: tuple[Job, ...]) -> None:
    for job in jobs:
        element = add_element(parent, "job", job)
        for part in job.parts:
            add_element(element, "part", part)
