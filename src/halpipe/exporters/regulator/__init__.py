"""Exporter of memory-bandwidth regulator configurations: whole bursts per window, exact, sealed as a bundle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.exporters.base import ExportOptions, specific
from halpipe.extent import Extent

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel
    from halpipe.settings import Fields

KIND = "regulator"


@dataclass(frozen=True, slots=True, kw_only=True)
class RegulatorOptions(ExportOptions):
    """The `platform` file, the `backend` (empty: the one that the file names), and the rule of `rounding`.

    Rounding is ``whole``, ``controlled``, or ``auto``: whole where it fits, table by table.
    """

    platform: str = ""
    backend: str = ""
    rounding: str = "auto"


class RegulatorExporter:
    """Writes the budgets of every unit, direction and window for the regulators of a platform; see `write`."""

    name = KIND
    summary = "memory-bandwidth regulators (folder): budgets per window for every mode and transition"
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
    needs_schedule = True
    suffix = ""
    keys = ("platform", "backend", "rounding")

    def options(self, common: ExportOptions, fields: Fields, base: str) -> RegulatorOptions:
        """Return the options that a pipeline file states; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.regulator.options import backend_name, platform_path, rounding_rule

        fields.require("platform")
        return RegulatorOptions(
            title=common.title,
            mode=common.mode,
            platform=fields.value("platform", lambda text: platform_path(base, text), ""),
            backend=fields.value("backend", backend_name, ""),
            rounding=fields.value("rounding", rounding_rule, "auto"),
        )

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return a bundle: the tables, what the back-end loads, the report, and the model and schedule themselves."""
        from halpipe.exporters.regulator.export import export_tables
        from halpipe.exporters.selection import select

        chosen = select(model, schedule, options.mode, self.name)
        return export_tables(model, chosen, specific(RegulatorOptions, options))


FORMAT = RegulatorExporter()
