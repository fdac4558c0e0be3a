"""Import of spreadsheets: CSV files and Excel workbooks with one row for each task, chain, access or switch.

`sheets` reads files into rows of texts, `columns` states the columns of each kind of table with their synonyms, and
`build` makes the task model of the rows.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.importers.common.base import Imported, ImportOptions

if TYPE_CHECKING:
    from collections.abc import Sequence


class TableFormat:
    """The door of the spreadsheet importer (entry point ``halpipe.importers``)."""

    name = "table"
    summary = "spreadsheets (.csv, .xlsx): a row for each task, chain, access, precedence or switch"
    extent = Extent(
        {
            "units": "column `units` of tasks; a table of units with their types",
            "resources": "column `resource` of accesses; a table of resources with bandwidth and kind",
            "tasks": "a row for each task, or for each version of a task",
            "timing": "columns `offset`, `slack`, `deadline`, `let`",
            "versions": "columns `version`, `wcet`, `units`, `gang`",
            "binding": "column `binding`",
            "interrupts": "a table of interrupts; column `distance` of tasks, for polled sporadic arrivals",
            "accesses": "a table of accesses",
            "precedence": "column `after`, in the same cycle; a table of precedences with their windows",
            "chains": "a table of chains with their limits",
            "modes": "column `modes` of tasks; a table of modes",
            "transitions": "a table of switches with their longest length",
            "health": "a table of health rules",
            "origins": "file and row",
        },
        (
            "A column that is not known warns, since it may decide timing; columns of remarks are counted as ignored.",
            "Preemption, programs and data transfers have no columns: an overlay states them.",
        ),
    )

    options = ImportOptions

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read the tables of one system; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.table.build import import_tables

        return import_tables(paths, options)


FORMAT = TableFormat()
