"""Import of AUTOSAR ARXML: Classic and Adaptive Platform, release 4, and releases 2 and 3 in its words.

`files` reads: `sniff` tells files apart, `slim` drops what cannot matter of large ones, `dialects` translates old
releases and EB tresos, `variants` leaves one variant, `tree` merges all into elements by path. `system` makes frozen
`values` of that tree, of one ECU. `tasks` decides what runs, when, where and in which order. `build` makes the task
model of it, `coverage` accounts for every element read, `embedded` reads the native model of an own export, and
`project` reads a project again for an export onto it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import specific
from halpipe.importers.arxml.options import ArxmlImportOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.common.base import Imported, ImportOptions


class ArxmlFormat:
    """The door of the ARXML importer (entry point ``halpipe.importers``)."""

    name = "arxml"
    summary = "AUTOSAR ARXML: components, BSW modules, ECU configuration, timing extension, Adaptive manifests"
    extent = Extent(
        {
            "units": "EcucCoreDefinition, OsApplicationCoreAssignment, HW-ELEMENT, PROCESSOR-CORE",
            "resources": "special data of halpipe's own export",
            "tasks": "runnables and BSW entities with their events, or OS tasks; processes",
            "timing": "offsets of alarms, expiry points and timing events; jitter; latency of one runnable; LET",
            "versions": "execution times, by HW-ELEMENT; units of the OsApplication; SHALL-RUN-ON; workers",
            "split": "OsTaskSchedule: FULL between runnables (by `--granularity`) and within long ones (`--pieces`)",
            "binding": "core of the OsApplication of an OsTask",
            "interrupts": "OsIsr with its timing protection; sporadic triggerings as polled arrivals",
            "accesses": "special data of halpipe's own export",
            "transfers": "special data of halpipe's own export",
            "precedence": "EXECUTION-ORDER-CONSTRAINT, OFFSET- and SYNCHRONIZATION-TIMING-CONSTRAINT, "
            "RtePositionInTask, data that triggers",
            "chains": "TIMING-DESCRIPTION-EVENT-CHAIN with LATENCY-TIMING-CONSTRAINT, AGE-CONSTRAINT",
            "modes": "MODE-DECLARATION-GROUP that disables events; function-group states of processes",
            "transitions": "MODE-TRANSITION",
            "health": "special data of halpipe's own export",
            "sources": "special data of halpipe's own export",
            "origins": "file, line and AUTOSAR path",
        },
        (
            "Server calls, initialisation runnables and what else has no period are counted as ignored, with a reason.",
            "Synchronisation of event chains and conditions of constraints are reported as lost.",
        ),
    )

    options = ArxmlImportOptions

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read files and directories into one model; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.arxml.build import import_arxml

        return import_arxml(paths, specific(ArxmlImportOptions, options))


FORMAT = ArxmlFormat()
