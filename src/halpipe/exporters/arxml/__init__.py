"""Export to AUTOSAR Classic ARXML (R4.x): the model, what it demands and what is proven, and the OS that plays it.

The parts, each in its own module: `layout` gives every element its short name and path; `platform`, `software` and
`modes` write the system; `timing` the demands, `guarantees` what a schedule proves; `ticks` and `tables` turn a
schedule into integers, `osconfig` and `rteconfig` write them as ECU configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.exporters.base import ExportOptions, PlainExporter, specific
from halpipe.exporters.choices import choice, positive_duration, whole
from halpipe.extent import Extent

if TYPE_CHECKING:
    from halpipe.durations import Duration
    from halpipe.models import Schedule, TaskModel

RELEASES = {
    "4.0.3": "AUTOSAR_4-0-3.xsd",
    "4.2.2": "AUTOSAR_4-2-2.xsd",
    "R19-11": "AUTOSAR_00048.xsd",
    "R22-11": "AUTOSAR_00051.xsd",
}
"""The releases that can be written, oldest first, with the schema that the header of their files names."""

PARTS = ("all", "system", "ecuc")
DEFAULT_RELEASE = "R22-11"
DEFAULT_PREFIX = "/AUTOSAR/EcucDefs"
DEFAULT_MAX_VALUE = 2**30 - 1
"""What the counters of all known operating systems hold; some have 32 bits with and some without a sign."""


_ticks = whole(0, 10**19, "number of ticks")


def _points(text: str) -> int | None:
    return _ticks(text) or None


@dataclass(frozen=True, slots=True, kw_only=True)
class ArxmlOptions(ExportOptions):
    """What may be chosen of an ARXML file; the title is not used.

    - `release` is one of `RELEASES`; `part` is one of `PARTS`: the system, the ECU configuration, or both.
    - `ecuc_prefix` stands before the names of the modules in the paths of definitions; vendors have their own.
    - `tick` is the tick of the counters (None: the largest that all instants are multiples of); `min_cycle` and
      `max_value` are their OsCounterMinCycle and OsCounterMaxAllowedValue.
    - `max_points` is how many expiry points a table of the target may have (None: any number).
    """

    release: str = choice(DEFAULT_RELEASE, f"AUTOSAR release: {', '.join(RELEASES)}.")
    part: str = choice("all", "system, ecuc (cores, OS and RTE; needs a schedule), or all.")
    ecuc_prefix: str = choice(
        DEFAULT_PREFIX, "Package of the ECUC definitions; vendors have their own.", metavar="PATH"
    )
    tick: Duration | None = choice(
        None, "Tick of the counters; otherwise the largest.", positive_duration, metavar="TIME"
    )
    min_cycle: int = choice(1, "OsCounterMinCycle of the counters.", _ticks, metavar="TICKS")
    max_value: int = choice(DEFAULT_MAX_VALUE, "OsCounterMaxAllowedValue of the counters.", _ticks, metavar="TICKS")
    max_points: int | None = choice(
        None, "Expiry points that the OS allows in a table, 254 for ATK2; 0: any number.", _points, metavar="N"
    )


class ArxmlExporter(PlainExporter):
    """Writes one ARXML file; what AUTOSAR rounds or lacks goes to special data groups, which ``import`` reads."""

    name = "arxml"
    summary = "AUTOSAR Classic ARXML (R4.x): system with timing, and the schedule as OsScheduleTables"
    help = "Write the model as AUTOSAR Classic ARXML; a schedule gives OsScheduleTables and timing guarantees."
    extent = Extent(
        {
            "units": "HW-ELEMENT, EcucCoreDefinition with its OsApplication",
            "resources": "HW-ELEMENT, its bandwidth as special data",
            "tasks": "component type with a runnable and its TIMING-EVENT",
            "timing": "PERIOD, LATENCY-TIMING-CONSTRAINT for deadlines; offset and slack as special data",
            "versions": "SWC-IMPLEMENTATION with ANALYZED-EXECUTION-TIME for each unit; gang size as special data",
            "split": "special data of the implementation",
            "binding": "special data of the runnable; one OsTask per task",
            "interrupts": "special data of the HW-ELEMENT; distance of arrivals as special data of the runnable",
            "accesses": "special data of the implementation",
            "transfers": "special data of the implementation",
            "precedence": "EXECUTION-ORDER-CONSTRAINT and OFFSET-TIMING-CONSTRAINT; by version as special data",
            "chains": "TIMING-DESCRIPTION-EVENT-CHAIN with its LATENCY-TIMING-CONSTRAINTs",
            "modes": "MODE-DECLARATION, DISABLED-MODE-IREFS; versions available as special data",
            "transitions": "MODE-TRANSITION (special data in 4.0.3), with maximum length as special data",
            "health": "special data",
            "sources": "special data of the implementation",
            "origins": "special data of each element",
            "schedule": "OsScheduleTable for each mode and core; timing guarantees",
            "parts": "OsEvents that hold an OsTask at split points, or priorities of OsTasks that are preempted",
            "tables": "OsScheduleTable that is played once, for each switch and core",
        },
        (
            "Costs and loads of the schedule are not written.",
            "Times that AUTOSAR rounds (microseconds, floating point seconds) stay exact as special data.",
        ),
    )
    needs_schedule = False
    suffix = ".arxml"
    options = ArxmlOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return everything as one document; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.arxml.export import format_arxml

        return {"": format_arxml(model, schedule, specific(ArxmlOptions, options))}


FORMAT = ArxmlExporter()
