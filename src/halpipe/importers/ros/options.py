"""Options of the ROS import."""

from __future__ import annotations

from fractions import Fraction

from halpipe.core.options import Form, option
from halpipe.core.quantities import parse_share
from halpipe.core.records import record
from halpipe.core.samples import quantile_of
from halpipe.core.settings import Words
from halpipe.importers.common.base import ImportOptions

IGNORED, RESOURCES = GROUP_RULES = ("ignored", "resources")


@record(kw_only=True)
class RosImportOptions(ImportOptions):
    """Sources of WCETs, and the reading of mutually exclusive callback groups."""

    calibrate: tuple[str, ...] = option(
        (),
        "CSV of measured callback durations, for WCETs; repeatable.",
        metavar="FILE",
        form=Form.LIST,
        is_path=True,
    )
    quantile: Fraction = option(
        Fraction(1), "Which of the measured durations is the WCET; 1 is the maximum.", quantile_of, metavar="Q"
    )
    margin: Fraction = option(
        Fraction(0), "Share of the WCET that is added to it: 0.2 or 20% adds a fifth.", parse_share, metavar="SHARE"
    )
    groups: str = option(
        RESOURCES,
        "Exclusive callback groups are resources that their tasks hold to their ends, or ignored.",
        Words(*GROUP_RULES),
    )
