"""Chrome trace JSON, which Perfetto (ui.perfetto.dev) and chrome://tracing open: the schedule to zoom into."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.exporters.common.base import Exporter, TitledOptions

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel


class TraceExporter(Exporter):
    """Writes the schedule as a trace: modes are processes, units are threads, jobs are slices."""

    name = "trace"
    summary = "Chrome/Perfetto trace (JSON): jobs as slices, precedence as flows, resources as counters"
    help = "Write the schedule as a trace to zoom into with Perfetto or chrome://tracing."
    extent = Extent(
        {
            "units": "threads",
            "resources": "counters",
            "precedence": "flows between slices",
            "modes": "processes",
            "schedule": "one slice per job and unit",
            "parts": "one slice per part and unit",
        },
        ("Instants that no decimal of a microsecond can state are rounded to 1 ns, and counted.",),
    )
    suffix = ".json"
    options = TitledOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: TitledOptions) -> dict[str, bytes]:
        """Return the trace as one JSON document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.trace.events import format_trace

        chosen = select(model, schedule, options.mode, self.name)
        return {"": format_trace(model, chosen, options.title).encode()}


FORMAT = TraceExporter()
