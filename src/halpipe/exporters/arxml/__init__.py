"""Export to AUTOSAR Classic ARXML (R4.x): the model, its requirements and guarantees, and the OS that plays it.

`software` writes the system, `timing` requirements and guarantees; `ticks` and `tables` turn a schedule into integers,
`osconfig` writes them as ECU configuration, `definitions` completes and checks it; `onto` adds to a project.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import specific
from halpipe.exporters.arxml.options import PARTS, RELEASES, ArxmlOptions
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel


class ArxmlExporter(Exporter):
    """Writes one ARXML file; the native model stands in it once, which ``import`` reads where nothing was edited."""

    name = "arxml"
    summary = "AUTOSAR Classic ARXML (R4.x): system with timing, and the schedule as OsScheduleTables"
    help = "Write the model as AUTOSAR Classic ARXML; a schedule gives OsScheduleTables and timing guarantees."
    extent = Extent(
        {
            "units": "HW-ELEMENT, EcucCoreDefinition with its OsApplication",
            "resources": "HW-ELEMENT; its bandwidth in the native model",
            "tasks": "component type with a runnable and its TIMING-EVENT",
            "timing": "PERIOD, LATENCY-TIMING-CONSTRAINT for deadlines, OFFSET (4.4.0); slack in the native model",
            "versions": "SWC-IMPLEMENTATION with an ANALYZED-EXECUTION-TIME; gang size in the native model",
            "split": "in the native model",
            "binding": "in the native model; one OsTask per task",
            "interrupts": "in the native model, as is the distance of arrivals",
            "accesses": "in the native model",
            "transfers": "in the native model",
            "precedence": "EXECUTION-ORDER-CONSTRAINT and OFFSET-TIMING-CONSTRAINT; by version in the native model",
            "chains": "TIMING-DESCRIPTION-EVENT-CHAIN with its LATENCY-TIMING-CONSTRAINTs",
            "modes": "MODE-DECLARATION, DISABLED-MODE-IREFS; versions available in the native model",
            "transitions": "MODE-TRANSITION (not in 4.0.3); maximum length in the native model",
            "health": "in the native model",
            "sources": "in the native model",
            "origins": "in the native model",
            "schedule": "OsScheduleTable for each mode and core; timing guarantees",
            "parts": "OsEvents that hold an OsTask at split points, or priorities of OsTasks that are preempted",
            "tables": "OsScheduleTable that is played once, for each switch and core",
        },
        (
            "Costs and loads of the schedule are not written.",
            "Times that AUTOSAR rounds (microseconds, floating point seconds) stay exact in the native model.",
            "The native model is a special data group of the package; it counts while the elements are unchanged.",
        ),
    )
    suffix = ".arxml"
    options = ArxmlOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return everything as one document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.arxml.export import format_arxml

        return {"": format_arxml(model, schedule, specific(ArxmlOptions, options))}

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return the limits that ARXML cannot state, and what does not fit the definitions of a vendor, if given."""
        from halpipe.exporters.arxml.definitions import check, read_definitions
        from halpipe.exporters.arxml.timing import unstated

        chosen = specific(ArxmlOptions, options)
        found = unstated(model) if chosen.part != "ecuc" else []
        paths = chosen.ecuc_definitions
        return [*found, *(check(contents[""], read_definitions(paths)) if paths else ())]


__all__ = ["FORMAT", "PARTS", "RELEASES", "ArxmlExporter", "ArxmlOptions"]

FORMAT = ArxmlExporter()
