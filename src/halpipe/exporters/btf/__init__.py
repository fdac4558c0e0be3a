"""The Best Trace Format (BTF 2.1), which timing tools and Eclipse Trace Compass open: the schedule as it would run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.exporters.base import ExportOptions, specific
from halpipe.extent import Extent

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel
    from halpipe.settings import Fields


@dataclass(frozen=True, slots=True, kw_only=True)
class BtfOptions(ExportOptions):
    """`cycles`: how often each mode is played before the next switch."""

    cycles: int = 2


class BtfExporter:
    """Writes a run through all modes and switches: every job activated, started and terminated as scheduled."""

    name = "btf"
    summary = "trace in the Best Trace Format (BTF 2.1): a run through every mode and every switch"
    extent = Extent(
        {
            "units": "core entities",
            "modes": "stimuli that mark the start of each table",
            "schedule": "activate, start and terminate of every job",
            "tables": "played between the modes",
            "parts": "preempt and resume between the parts of a job",
        },
        (
            "BTF has whole nanoseconds: instants between two are rounded down, and counted in the header.",
            "Memory phases and constraints have no events.",
        ),
    )
    needs_schedule = True
    suffix = ".btf"
    keys = ("cycles",)

    def options(self, common: ExportOptions, fields: Fields, base: str) -> BtfOptions:
        """Return the options that a pipeline file states; see `halpipe.exporters.base.Exporter`."""
        return BtfOptions(title=common.title, mode=common.mode, cycles=fields.value("cycles", _cycles, 2))

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the trace as one document; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.btf.events import format_btf
        from halpipe.exporters.selection import select

        chosen = select(model, schedule, options.mode, self.name)
        return {"": format_btf(model, chosen, specific(BtfOptions, options)).encode()}


def _cycles(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text[:5]) <= 1000):
        raise ValueError(f"{text[:40]!r} is no number of cycles; write a whole number from 1 to 1000")
    return int(text)


FORMAT = BtfExporter()
