"""Import of AUTOSAR Classic ARXML (R4.x): components, events, ECU configuration of Os, Rte and EcuC.

The steps, each in its own module: `sniff` tells files apart; `tree` merges them into one tree of elements by
path; `swc`, `compositions`, `ecuc`, `constraints` and `modes` read that tree into a frozen `system.System`;
`activation` and `periods` decide what runs, when and where; `grouping` cuts tasks out of it; `precedence` orders
them; `build` makes the task model; `coverage` accounts for every element read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.base import Imported, ImportOptions


class ArxmlFormat:
    """The door of the ARXML importer (entry point ``halpipe.importers``)."""

    name = "arxml"
    summary = "AUTOSAR Classic ARXML (R4.x): software components, BSW modules, ECU configuration of Os, Rte and EcuC"

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read files and directories into one model; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.arxml.build import import_arxml

        return import_arxml(paths, options)


FORMAT = ArxmlFormat()
