"""Workbooks of Excel: the model in sheets that `halpipe import table` reads back, and the schedule in further ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel


class WorkbookExporter(Exporter):
    """Writes a workbook; what it cannot carry is named in a remark."""

    name = "xlsx"
    summary = "workbook (.xlsx): tasks, chains and other elements, jobs, loads, latencies and switches"
    help = "Write model and schedule as a workbook, whose sheets of the model `halpipe import table` reads back."
    extent = Extent(
        {
            "units": "sheet Units",
            "resources": "sheet Resources",
            "tasks": "sheet Tasks: a row for each version",
            "timing": "columns of Tasks",
            "versions": "columns of Tasks",
            "binding": "column of Tasks",
            "interrupts": "sheet Interrupts",
            "accesses": "sheet Accesses",
            "precedence": "sheet Precedences",
            "chains": "sheet Chains",
            "modes": "column of Tasks; sheet Modes",
            "transitions": "sheet Transitions",
            "health": "sheet Health",
            "schedule": "sheets Schedule jobs, Schedule loads, Schedule latencies",
            "parts": "a row of Schedule jobs for each part",
            "tables": "sheet Schedule switches",
        },
        (
            "Preemption points, sources and transfers have no column; a warning names their tasks.",
            "A time that no decimal of a millisecond states is written as a text, which reads back exactly.",
        ),
    )
    suffix = ".xlsx"

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the workbook; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.xlsx.workbook import format_workbook

        return {"": format_workbook(model, select(model, schedule, options.mode, self.name))}

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return what of the model has no column."""
        from halpipe.exporters.xlsx.workbook import losses

        return losses(model)


FORMAT = WorkbookExporter()
