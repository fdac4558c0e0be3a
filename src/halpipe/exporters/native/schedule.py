"""Writer of the schedule XML (schema schedule-1.xsd); what it writes reads back to an equal schedule.

Figures that decide nothing are left out where their exact form is too long to be read again.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

from halpipe.core.quantities import is_writable
from halpipe.exporters.native.document import Writer, attributes_of, document, serialise
from halpipe.models import ModeSchedule, Schedule
from halpipe.models.attributes import children
from halpipe.schemas import SCHEDULE

if TYPE_CHECKING:
    from fractions import Fraction


def format_schedule(schedule: Schedule) -> bytes:
    """Return the canonical XML of a schedule; jobs stay in their order."""
    root, writer = document(SCHEDULE, attributes_of(schedule)), Writer()
    for one in children(Schedule):
        for each in getattr(schedule, one.field):
            writer.element(root, one.tag, _writable(each) if isinstance(each, ModeSchedule) else each)
    return serialise(root, SCHEDULE)


def _writable(mode: ModeSchedule) -> ModeSchedule:
    """Return a table without the figures that are too long to be read again."""

    def short(figure: Fraction | None) -> Fraction | None:
        return figure if figure is None or is_writable(figure) else None

    loads = tuple(replace(load, peak=short(load.peak), mean=short(load.mean)) for load in mode.resource_loads)
    is_short = mode.cost is not None and all(is_writable(getattr(mode.cost, term.name)) for term in fields(mode.cost))
    cost, margin, bound = mode.cost if is_short else None, short(mode.margin), short(mode.margin_bound)
    return replace(mode, margin=margin, margin_bound=bound, resource_loads=loads, cost=cost)
