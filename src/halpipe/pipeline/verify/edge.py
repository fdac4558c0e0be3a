"""Rule edge: nothing is in progress where the table of a mode with a closed edge begins again (MODEL 10.4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.pipeline.verify.tables import ModeTable


def check_edge(table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the ends of all jobs with the hyperperiod; access phases lie within their jobs."""
    for placed in table.jobs if table.mode.is_closed else ():
        if placed.end > table.period:
            text = f"ends at {table.clock.text(placed.end)}, after the end of the table at "
            text += table.clock.text(table.period)
            help = "start it earlier, or open the edge of the mode"
            yield codes.OVER_THE_EDGE(text, at=placed.job.at, path=table.path(placed), help=help)


EDGE = Rule("edge", "In a mode with a closed edge every job ends within the table.", check_edge)
