"""Import of AMALTHEA models (Eclipse APP4MC .amxmi), from ITEA 1.1.0 to APP4MC 3.3.0.

The steps, each in its own module: `documents` reads files; `xmi` makes one forest of items, in which references can be
followed; `modes`, `hardware`, `mapping` and `graph` read items; `stimuli` and `parts` make drafts of tasks; `timing`
and `chains` read constraints; `versions`, `tasks` and `build` make the task model; `build` accounts for every element.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import option, specific
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.importers.common.base import Imported, ImportOptions, PiecesOptions

if TYPE_CHECKING:
    from collections.abc import Sequence


@record(kw_only=True)
class AmaltheaImportOptions(PiecesOptions):
    """Readings of what AMALTHEA leaves open: times of accesses, mappings."""

    memory: str = option(
        "within",
        "Accesses to memory are within the stated time, added to it, or none.",
        Words("within", "added", "none"),
    )
    mapping: str = option(
        "stated", "Tasks run where the mapping is stated, or free on all units.", Words("stated", "free")
    )


class AmaltheaFormat:
    """The door of the AMALTHEA importer (entry point ``halpipe.importers``)."""

    name = "amalthea"
    summary = "AMALTHEA models (APP4MC .amxmi), ITEA 1.1.0 to 3.3.0: tasks, stimuli, runnables, hardware, mapping"
    extent = Extent(
        {
            "units": "ProcessingUnit with its definition, Core with its type",
            "resources": "Memory that mapped labels are accessed in, with its peak data rate; Semaphore as a lock",
            "tasks": "Task with its stimuli, cut where it waits for others; ISR that activates tasks",
            "timing": "offset of the stimulus; ResponseTime and StartToStart limits; LET of timed label accesses",
            "versions": "Ticks or instructions, for each kind of processing unit; affinity and schedulers",
            "split": "`preemption`, at the ends of runnables; preemptive ones also within runnables (`--pieces`)",
            "binding": "allocation to one unit",
            "interrupts": "ISR; sporadic stimuli and arrival curves as polled arrivals",
            "accesses": "LabelAccess, by sizes of labels, latencies and data rates; SemaphoreAccess",
            "transfers": "the labels accessed",
            "precedence": "DelayConstraint, RunnableSequencingConstraint, InterProcessTrigger, WaitEvent",
            "chains": "EventChain with latency constraints, ProcessChain, DataAgeConstraint",
            "modes": "ModeLabel that nothing sets, with the conditions on it",
            "transitions": "custom property of the model",
            "health": "custom property of the model",
            "sources": "custom property of the runnable",
            "origins": "file, line and name",
        },
        (
            "Branches that data or probability choose count with the longest one.",
            "Kinds that are listed as harmless are counted as ignored, with a reason; others that are not read warn.",
        ),
    )

    options = AmaltheaImportOptions

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read the files of one model; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.amalthea.build import import_amalthea

        return import_amalthea(paths, specific(AmaltheaImportOptions, options))


FORMAT = AmaltheaFormat()
