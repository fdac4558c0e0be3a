"""Best Trace Format (BTF 2.1), which timing tools and Eclipse Trace Compass open: the schedule as it would run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import option
from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.exporters.common.base import Exporter, TitledOptions

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class BtfOptions(TitledOptions):
    """`cycles`: how often each mode is played before the next switch."""

    cycles: int = option(
        2, "Hyperperiods of a mode before the next switch.", whole(1, 1000, "number of cycles"), metavar="N"
    )


class BtfExporter(Exporter):
    """Writes a run through all modes and switches: every job activated, started and terminated as scheduled."""

    name = "btf"
    summary = "trace in the Best Trace Format (BTF 2.1): a run through every mode and every switch"
    help = "Write a run through every mode and switch as a trace in the Best Trace Format (BTF)."
    extent = Extent(
        {
            "units": "core entities",
            "modes": "stimuli that mark the start of each table",
            "schedule": "activate at the release, start and terminate of every job",
            "tables": "played between the modes",
            "parts": "preempt and resume between the parts of a job",
            "versions": "one runnable for each, which runs within its jobs",
        },
        (
            "BTF has whole nanoseconds: instants between two are rounded down, and counted in the header.",
            "Memory phases and constraints have no events.",
        ),
    )
    suffix = ".btf"
    options = BtfOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: BtfOptions) -> dict[str, bytes]:
        """Return the trace as one document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.btf.events import format_btf
        from halpipe.exporters.common.selection import select

        chosen = select(model, schedule, options.mode, self.name)
        return {"": format_btf(model, chosen, options).encode()}


FORMAT = BtfExporter()
