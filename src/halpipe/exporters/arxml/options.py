"""What may be chosen of an ARXML file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.common.choices import choice, positive_duration

if TYPE_CHECKING:
    from halpipe.core.durations import Duration

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


@record(kw_only=True)
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
