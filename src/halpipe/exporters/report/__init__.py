"""The report: one self-contained HTML page with a Gantt chart of every mode and switch, complete without network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.extent import Extent
from halpipe.core.options import option, specific
from halpipe.core.records import record
from halpipe.exporters.common.base import Exporter, ExportOptions, TitledOptions

if TYPE_CHECKING:
    from halpipe.exporters.report.beside import Beside
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class ReportOptions(TitledOptions):
    """`import_report`: the file in which the import of the model gave its account; empty: none.

    `beside` is what the file of `trace` or `against` shows, for the tables that are drawn; `flow` reads it.
    """

    import_report: str = option(
        "", "What `halpipe import FORMAT --report` wrote; shown as a section.", metavar="FILE", is_path=True
    )
    trace: str = option(
        "", "Recording of a run that is drawn under the schedule, aligned by table.", metavar="FILE", is_path=True
    )
    against: str = option("", "Another schedule that is drawn under this one.", metavar="FILE", is_path=True)
    tolerance: Duration = option(
        ZERO, "With --trace: lateness that is allowed at starts and ends.", Duration.parse, metavar="TIME"
    )
    origin: Duration | None = option(
        None,
        "With --trace: instant at which the schedule starts in it; otherwise found, so that no job is early.",
        Duration.parse,
        metavar="TIME",
    )
    beside: Beside | None = None

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others."""
        return ("against",) if self.trace else ("tolerance", "origin")


class ReportExporter(Exporter):
    """Writes the schedule as a page for people: charts, loads, latencies, tables."""

    name = "report"
    summary = "HTML page for people: Gantt charts, loads, chain latencies, tables of jobs and tasks"
    help = "Write the schedule as one HTML page for people: Gantt charts, loads, chain latencies, tables."
    extent = Extent(
        {
            "units": "rows of the charts, with their loads",
            "resources": "rows of the charts, with peak and mean",
            "tasks": "table of tasks",
            "timing": "table of tasks",
            "versions": "table of tasks",
            "split": "table of tasks",
            "interrupts": "loads of units; table of tasks",
            "chains": "table of latencies against limits",
            "modes": "one section each",
            "schedule": "Gantt chart and table of jobs",
            "parts": "bars joined by a thin line; gaps counted in the tables",
            "tables": "Gantt chart and table of jobs",
        },
        ("It is a page for people and is not read back.",),
    )
    suffix = ".html"
    options = ReportOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the page; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.report.page import format_page

        chosen = select(model, schedule, options.mode, self.name)
        return {"": format_page(model, chosen, specific(ReportOptions, options)).encode()}


FORMAT = ReportExporter()
