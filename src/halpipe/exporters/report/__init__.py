"""The report: one self-contained HTML page with a Gantt chart of every mode, complete without network or script."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.exporters.base import ExportOptions
    from halpipe.models import Schedule, TaskModel


class ReportExporter:
    """Writes the schedule as a page for people: charts, loads, latencies, tables."""

    name = "report"
    summary = "HTML page for people: Gantt charts, loads, chain latencies, tables of jobs and tasks"
    needs_schedule = True
    suffix = ".html"

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the page; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.report.page import format_page
        from halpipe.exporters.selection import select

        chosen = select(model, schedule, options.mode, self.name)
        return {"": format_page(model, chosen, options.title).encode()}


FORMAT = ReportExporter()
