"""Exporter of memory-bandwidth regulator configurations: whole bursts per window, exact, sealed as a bundle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import file_name, option, specific
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import Exporter, ExportOptions
from halpipe.exporters.regulator.words import AUTO, BACKENDS, RULES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class RegulatorOptions(ExportOptions):
    """The `platform` file, the `backend` (empty: the one that the file names), and the rule of `rounding`.

    Rounding is ``whole``, ``controlled``, or ``auto``: whole where it fits, table by table.
    """

    platform: str = option(
        "", "The regulators and the memory: YAML.", file_name, metavar="FILE", is_path=True, required=True
    )
    backend: str = option("", f"{', '.join(BACKENDS)}; otherwise what the platform names.", Words(*BACKENDS))
    rounding: str = option(
        AUTO,
        "whole bursts for every phase, controlled (cumulative), or auto: whole where it fits.",
        Words(*RULES),
    )


class RegulatorExporter(Exporter):
    """Writes the budgets of every unit, direction and window for the regulators of a platform; see `write`."""

    name = "regulator"
    summary = "memory-bandwidth regulators (folder): budgets per window for every mode and transition"
    help = "Write the budgets of memory-bandwidth regulators, window by window, for every mode and transition."
    extent = Extent(
        {
            "units": "one regulator each, those that the platform names",
            "resources": "the one that is regulated",
            "accesses": "budgets per window",
            "modes": "one table each",
            "transitions": "tables, and which to request",
            "schedule": "when budgets change",
            "parts": "budgets follow the access phases through the parts of a job",
            "tables": "one table each, with the first cycles of the mode after where jobs reach into it",
        },
        (
            "Budgets are whole bursts per window; what rounding leaves of a promise is in the report.",
            "The bundle carries model and schedule whole, but only to be checked.",
        ),
    )
    suffix = ""
    options = RegulatorOptions
    shown = "report.txt"

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return a bundle: the tables, what the back-end loads, the report, and the model and schedule themselves."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.regulator.writing import export_tables

        chosen = select(model, schedule, options.mode, self.name)
        return export_tables(model, chosen, specific(RegulatorOptions, options))

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> list[Diagnostic]:
        """Return what the report says; it names files without their folders."""
        from halpipe.exporters.regulator.report import findings_of

        return findings_of(contents["report.json"])


FORMAT = RegulatorExporter()
