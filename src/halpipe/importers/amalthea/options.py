"""Options of the AMALTHEA import."""

from __future__ import annotations

from halpipe.core.options import option
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.importers.common.base import PiecesOptions

STATISTICS = ("upper", "average", "lower")


@record(kw_only=True)
class AmaltheaImportOptions(PiecesOptions):
    """Readings of what AMALTHEA leaves open: statistics of execution times, times of accesses, mappings."""

    wcet: str = option(
        "upper", "The WCET is the upper, average or lower of a stated execution time.", Words(*STATISTICS)
    )
    memory: str = option(
        "within",
        "Accesses to memory are within the stated time, added to it, or none.",
        Words("within", "added", "none"),
    )
    mapping: str = option(
        "stated", "Tasks run where the mapping is stated, or free on all units.", Words("stated", "free")
    )
