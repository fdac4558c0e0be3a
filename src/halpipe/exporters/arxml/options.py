"""Options of an ARXML export."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.options import Form, option, positive_duration
from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import ExportOptions

if TYPE_CHECKING:
    from halpipe.core.durations import Duration

RELEASES = {
    "4.0.3": "AUTOSAR_4-0-3.xsd",
    "4.2.2": "AUTOSAR_4-2-2.xsd",
    "4.4.0": "AUTOSAR_00046.xsd",
    "R19-11": "AUTOSAR_00048.xsd",
    "R20-11": "AUTOSAR_00049.xsd",
    "R22-11": "AUTOSAR_00051.xsd",
    "R23-11": "AUTOSAR_00052.xsd",
    "R25-11": "AUTOSAR_00054.xsd",
}
"""The releases that can be written, oldest first, with the schema that the header of their files names."""

PARTS = ("all", "system", "ecuc")
DEFAULT_RELEASE = "R22-11"
DEFAULT_PREFIX = "/AUTOSAR/EcucDefs"
DEFAULT_MAX_VALUE = 2**30 - 1
"""What the counters of all known operating systems hold; some have 32 bits with and some without a sign."""


OF_PROJECT = ("ecu", "variant", "conditions")
"""Options that say how the project was imported which the schedule is put onto."""

_ticks = whole(0, 10**19, "number of ticks")


def _points(text: str) -> int | None:
    return _ticks(text) or None


@record(kw_only=True)
class ArxmlOptions(ExportOptions):
    """Options of an ARXML export: of files of its own, or `onto` a project, as its import chose."""

    release: str = option(DEFAULT_RELEASE, f"AUTOSAR release: {', '.join(RELEASES)}.", Words(*RELEASES))
    part: str = option("all", "system, ecuc (cores, OS and RTE; needs a schedule), or all.", Words(*PARTS))
    ecuc_prefix: str = option(
        DEFAULT_PREFIX, "Package of the ECUC definitions; vendors have their own.", metavar="PATH"
    )
    tick: Duration | None = option(
        None, "Tick of the counters; otherwise the largest.", positive_duration, metavar="TIME"
    )
    min_cycle: int = option(1, "OsCounterMinCycle of the counters.", _ticks, metavar="TICKS")
    max_value: int = option(DEFAULT_MAX_VALUE, "OsCounterMaxAllowedValue of the counters.", _ticks, metavar="TICKS")
    max_points: int | None = option(
        None, "Expiry points that the OS allows in a table, 254 for ATK2; 0: any number.", _points, metavar="N"
    )
    ecuc_definitions: tuple[str, ...] = option(
        (),
        "File or folder with the ECUC-MODULE-DEFs of a vendor, and configurations that state what these demand; "
        "repeatable.",
        metavar="PATH",
        form=Form.LIST,
        is_path=True,
    )
    onto: str = option(
        "",
        "Put the schedule onto the project that the model was imported from; the output is a folder then.",
        metavar="PROJECT_DIR",
        is_path=True,
    )
    ecu: str = option("", "With --onto: the ECU that was imported.", metavar="NAME")
    variant: str = option("", "With --onto: the variant that was imported.", metavar="NAME")
    conditions: tuple[str, ...] = option(
        (),
        "With --onto: as it was given to the import; repeatable.",
        name="condition",
        metavar="NAME=VALUE",
        form=Form.LIST,
    )

    def unused(self) -> tuple[str, ...]:
        """Return the options without effect: of files of their own, or of a project, or of the ECU configuration."""
        of_tables = ("ecuc_prefix", "tick", "min_cycle", "max_value", "max_points")
        if self.onto:
            return ("mode", "release", "part", *of_tables)
        return (*OF_PROJECT, *(of_tables if self.part == "system" else ()))
