"""Options of the ARXML import."""

from __future__ import annotations

from halpipe.core.options import Form, option
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.importers.common.base import PiecesOptions

BUDGET = "budget"
GRANULARITIES = ("runnable", "event", "ostask")


@record(kw_only=True)
class ArxmlImportOptions(PiecesOptions):
    """`conditions` are values of system constants and criteria, which choose among the variants of a product line."""

    granularity: str = option("runnable", "One task per runnable, event or ostask.", Words(*GRANULARITIES))
    wcet: str = option(
        "stated",
        "The WCET is the stated execution time alone, or the budget of the OsTask where none is stated.",
        Words("stated", BUDGET),
    )
    ecu: str = option("", "The ECU of a system that has several.", metavar="NAME")
    variant: str = option("", "Predefined or evaluated variant to import.", metavar="NAME")
    conditions: tuple[str, ...] = option(
        (),
        "Value of a system constant or variant criterion; repeatable.",
        name="condition",
        metavar="NAME=VALUE",
        form=Form.LIST,
    )
