"""Options of the AMALTHEA export."""

from __future__ import annotations

from halpipe.core.options import option
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import ExportOptions

RELEASES = ("1.2.0", "2.0.0", "2.1.0", "2.2.0", "3.0.0", "3.1.0", "3.2.0", "3.3.0")


@record(kw_only=True)
class AmaltheaOptions(ExportOptions):
    """`release`: the version of APP4MC whose format is written."""

    release: str = option(
        RELEASES[-1], f"Release of APP4MC to write for, {RELEASES[0]} to {RELEASES[-1]}.", Words(*RELEASES)
    )
