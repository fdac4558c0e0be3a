"""Export to AUTOSAR Classic ARXML (R4.x): the model, what it demands and what is proven, and the OS that plays it.

The parts, each in its own module: `layout` gives every element its short name and path; `platform`, `software` and
`modes` write the system; `timing` the demands, `guarantees` what a schedule proves; `ticks` and `tables` turn a
schedule into integers, `osconfig` and `rteconfig` write them as ECU configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.durations import Duration
from halpipe.exporters.base import ExportOptions, specific
from halpipe.extent import Extent

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel
    from halpipe.settings import Fields

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ArxmlOptions(ExportOptions):
    """What may be chosen of an ARXML file; the title is not used.

    - `release` is one of `RELEASES`; `part` is one of `PARTS`: the system, the ECU configuration, or both.
    - `ecuc_prefix` stands before the names of the modules in the paths of definitions; vendors have their own.
    - `tick` is the tick of the counters (None: the largest that all instants are multiples of); `min_cycle` and
      `max_value` are their OsCounterMinCycle and OsCounterMaxAllowedValue.
    - `max_points` is how many expiry points a table of the target may have (None: any number).
    """

    release: str = DEFAULT_RELEASE
    part: str = "all"
    ecuc_prefix: str = DEFAULT_PREFIX
    tick: Duration | None = None
    min_cycle: int = 1
    max_value: int = DEFAULT_MAX_VALUE
    max_points: int | None = None


class ArxmlExporter:
    """Writes one ARXML file; what AUTOSAR rounds or lacks goes to special data groups, which ``import`` reads."""

    name = "arxml"
    summary = "AUTOSAR Classic ARXML (R4.x): system with timing, and the schedule as OsScheduleTables"
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
    keys = ("release", "part", "ecuc-prefix", "tick", "min-cycle", "max-value", "max-points")

    def options(self, common: ExportOptions, fields: Fields, base: str) -> ArxmlOptions:
        """Return the options that a pipeline file states; see `halpipe.exporters.base.Exporter`."""
        return ArxmlOptions(
            title=common.title,
            mode=common.mode,
            release=fields.value("release", str, DEFAULT_RELEASE),
            part=fields.value("part", str, "all"),
            ecuc_prefix=fields.value("ecuc-prefix", str, DEFAULT_PREFIX),
            tick=fields.value("tick", Duration.parse, None),
            min_cycle=fields.value("min-cycle", _whole, 1),
            max_value=fields.value("max-value", _whole, DEFAULT_MAX_VALUE),
            max_points=fields.value("max-points", _whole, None),
        )

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return everything as one document; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.arxml.export import format_arxml

        return {"": format_arxml(model, schedule, specific(ArxmlOptions, options))}


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 20):
        raise ValueError(f"{text[:40]!r} is no number of ticks; write a whole number")
    return int(text)


FORMAT = ArxmlExporter()
