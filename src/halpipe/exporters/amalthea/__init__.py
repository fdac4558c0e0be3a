"""Export to AMALTHEA (Eclipse APP4MC .amxmi): the model, with the offsets and the mapping of a schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import option
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

RELEASES = ("1.2.0", "2.0.0", "2.1.0", "2.2.0", "3.0.0", "3.1.0", "3.2.0", "3.3.0")


@record(kw_only=True)
class AmaltheaOptions(ExportOptions):
    """`release`: the version of APP4MC whose format is written."""

    release: str = option(
        RELEASES[-1], f"Release of APP4MC to write for, {RELEASES[0]} to {RELEASES[-1]}.", Words(*RELEASES)
    )


class AmaltheaExporter(Exporter):
    """Writes one .amxmi file; the native model stands in it once, which ``import`` reads where nothing was edited."""

    name = "amalthea"
    summary = "AMALTHEA model (APP4MC .amxmi) with the mapping and offsets of the schedule"
    help = "Write the model as AMALTHEA (.amxmi); a schedule gives its offsets and its mapping."
    extent = Extent(
        {
            "units": "ProcessingUnit, with a definition for each type",
            "resources": "Memory, its bandwidth as the data rate of its definition",
            "tasks": "Task with its stimuli",
            "timing": "offset of the stimulus, ResponseTime limit, LET as timed accesses; slack in the native model",
            "versions": "Runnable with Ticks (1 GHz) for each kind of unit; affinity; gang size in the native model",
            "split": "`preemption`; points, resumption and limits in the native model",
            "binding": "in the native model",
            "interrupts": "in the native model, as is the distance of arrivals",
            "accesses": "Semaphore and SemaphoreAccess for locks; others in the native model",
            "transfers": "Label and LabelAccess; symbols in the native model",
            "precedence": "DelayConstraint between events",
            "chains": "EventChain with latency constraints",
            "modes": "EnumMode and ModeLabel, conditions of the stimuli",
            "transitions": "in the native model",
            "health": "in the native model",
            "sources": "in the native model",
            "schedule": "offsets or occurrence times of stimuli, affinity of tasks, versions chosen",
        },
        (
            "Transition tables, parts of jobs, costs and loads of the schedule are not written.",
            "Which job runs on which of several units is a custom property of the stimulus.",
            "Values that AMALTHEA rounds (picoseconds, whole ticks) stay exact in the native model, a custom property.",
        ),
    )
    suffix = ".amxmi"
    options = AmaltheaOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: AmaltheaOptions) -> dict[str, bytes]:
        """Return the model as one document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.amalthea.model import format_amalthea

        return {"": format_amalthea(model, schedule, options)}


__all__ = ["FORMAT", "RELEASES", "AmaltheaExporter", "AmaltheaOptions"]

FORMAT = AmaltheaExporter()
