"""Parameters of a synthetic task set."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, error
from halpipe.core.durations import Duration, least_common_multiple, milliseconds
from halpipe.core.options import Form, option
from halpipe.core.quantities import parse_share, whole
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

TICK = Duration(1000)
"""The grid of all generated times (D): one microsecond."""

HYPERPERIOD = milliseconds(120)
"""The hyperperiod t_P where none is stated (D)."""

_LIMITS = {
    "tasks": (1, 100_000),
    "units": (1, 10_000),
    "unit_types": (1, 10_000),
    "resources": (0, 10_000),
    "access_windows": (0, 1_000_000),
}
_MOST_JOBS = 1_000_000

SHARE = "SHARE"
"""Shares are written as 0.7, 7/10 or 70%."""

ZERO = Fraction(0)
_NUMBER = whole(0, 10**9)

SEXTANTS = 6
"""Two and three start times at equal distances divide the hyperperiod into sixths."""


@record(kw_only=True)
class SetParameters:
    """Parameters of a synthetic task set; the first eight are the rows of the paper's Table III, others are ours.

    `access_windows` None means one for every task. With a `resource_fill`, windows are added until the resources are
    in use for that share of the time on average. `gang` is the share of tasks that take two units at once. With
    `unlike_units`, no two units can run the same versions. `periods`, when given, replace the random periods: one task
    for each (then `tasks` and `hyperperiod` do not count).
    """

    tasks: int = option(60, "Number of tasks.", _NUMBER, metavar="N")
    units: int = option(6, "Number of execution units.", _NUMBER, metavar="N")
    unit_types: int = option(2, "Number of types of units.", _NUMBER, metavar="N")
    access_windows: int | None = option(
        None, "Number of access windows.", _NUMBER, metavar="N", otherwise="one for every task"
    )
    resources: int = option(2, "Number of shared resources.", _NUMBER, metavar="N")
    multi_version: Fraction = option(ZERO, "Tasks with an alternative version.", parse_share, metavar=SHARE)
    precedence: Fraction = option(ZERO, "Tasks with a predecessor.", parse_share, metavar=SHARE)
    utilisation: Fraction = option(Fraction(3, 5), "Busy time of the units.", parse_share, metavar=SHARE)
    hyperperiod: Duration = option(
        HYPERPERIOD, "Time after which all repeats.", Duration.parse, metavar="TIME", takes=(Duration,)
    )
    slack: Fraction = option(ZERO, "Slack of every task.", parse_share, metavar=SHARE)
    fractional: bool = option(False, "Let windows take parts of a resource.", form=Form.SWITCH)
    resource_fill: Fraction | None = option(
        None, "Add windows up to this use of resources.", parse_share, metavar=SHARE
    )
    gang: Fraction = option(ZERO, "Tasks that take two units at once.", parse_share, metavar=SHARE)
    unlike_units: bool = option(False, "Make no two units alike.", form=Form.SWITCH)
    periods: tuple[Duration, ...] = option(
        (),
        "One task of this period, instead of --tasks; repeatable.",
        Duration.parse,
        name="period",
        metavar="TIME",
        form=Form.LIST,
    )

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others."""
        has_fill = self.resource_fill is not None
        beside_periods = ("tasks", "hyperperiod") if self.periods else ()
        without_windows = () if (self.resource_fill if has_fill else self.window_count) else ("fractional",)
        return (*beside_periods, *(("access_windows",) if has_fill else ()), *without_windows)

    @property
    def task_count(self) -> int:
        """The number of tasks of the set."""
        return len(self.periods) or self.tasks

    @property
    def window_count(self) -> int:
        """The number of access windows to place; with a `resource_fill`, the fill decides instead."""
        return self.task_count if self.access_windows is None else self.access_windows

    @property
    def span(self) -> Duration:
        """The hyperperiod t_P."""
        return least_common_multiple(self.periods) if self.periods else self.hyperperiod

    def check(self) -> None:
        """Raise `HalpipeError` with everything that no set could have."""
        found = [BAD_PARAMETER(text, path=name, help=help) for name, text, help in self._faults()]
        if found:
            raise HalpipeError(*found)

    def _faults(self) -> Iterator[tuple[str, str, str]]:
        for name, (least, most) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                yield name, f"is {value}", f"give a number from {least} to {most}"
        for name in ("multi_version", "precedence", "utilisation", "slack", "gang", "resource_fill"):
            share = getattr(self, name)
            if share is not None and not 0 <= share <= 1:
                yield name, f"is {share}, which is no share", "give a number from 0 to 1"
        if not self.utilisation:
            yield "utilisation", "is 0", "give a number above 0"
        if self.unit_types > self.units:
            yield "unit_types", f"is {self.unit_types} for {self.units} units", "give no more types than units"
        if not self.resources and (self.window_count or self.resource_fill):
            yield "resources", "is 0, but there are access windows", "give a resource, or no windows and no fill"
        if self.gang > Fraction(1, 2):
            yield "gang", f"is {self.gang}", "give at most 0.5: gang tasks are among those with two start times"
        if self.gang and self.units < 2 * self.unit_types:
            yield "gang", "needs two units of every type", "give more units or fewer types"
        if self.gang and self.periods:
            yield "gang", "cannot be combined with stated periods", "leave one of the two out"
        yield from self._times()

    def _times(self) -> Iterator[tuple[str, str, str]]:
        if self.periods:
            rough = [period for period in self.periods if not period or period % TICK]
            for period in rough:
                yield "periods", f"{period} is no positive multiple of {TICK}", "round it"
            jobs = 0 if rough else sum(self.span // period for period in self.periods)
            if jobs > _MOST_JOBS:
                help = f"choose periods that give at most {_MOST_JOBS}"
                yield "periods", f"give {jobs} jobs in a hyperperiod of {self.span}", help
        elif not self.hyperperiod or self.hyperperiod % (TICK * SEXTANTS):
            yield "hyperperiod", f"{self.hyperperiod} is no multiple of {TICK * SEXTANTS}", "round it"


# ------------------------------------------------------------------------------------------------ diagnostics

BAD_PARAMETER = error(
    "HAL0921",
    "Task set cannot have this parameter",
    "A count below its least value, a share outside [0, 1], or parameters that contradict each other.",
)
TOO_SHORT = error(
    "HAL0922",
    "Hyperperiod is too short for so many tasks",
    "Times of generated sets are whole microseconds; some task would be shorter than one. Give a longer hyperperiod "
    "or fewer tasks for each unit.",
)
