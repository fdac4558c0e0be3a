"""Jobs drawn under those of a schedule, in a second row of each lane: of a recorded run, or of another schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.durations import Duration


MARKS = ("missing", "", "off", "extra", "delay", "over")
"""Marks of boxes in the order in which they are drawn: what deviates lies over what does not."""
SPREAD_HEIGHT = 18


@record
class Seen:
    """A box under the schedule, on the line of its table.

    `mark` is empty for what agrees with the schedule, else ``off``, ``missing`` or ``extra``; ``delay`` is the time in
    which a job was due and did not run, ``over`` that in which it ran beyond what is reserved.
    """

    task: str
    units: tuple[str, ...]
    start: Duration
    end: Duration
    mark: str
    title: str


@record
class Strip:
    """The second rows of one chart."""

    boxes: tuple[Seen, ...]
    caption: str


@record
class Spread:
    """Distribution of a figure of a task over bins of `width` from `least` on."""

    task: str
    figure: str
    least: str
    worst: str
    width: str
    counts: tuple[int, ...]

    @property
    def heights(self) -> list[int]:
        """Heights of the bars, at most `SPREAD_HEIGHT`; of a bin that is not empty at least 1."""
        return [-(-count * SPREAD_HEIGHT // max(self.counts)) for count in self.counts]


@record
class Beside:
    """The strips by table, a mode or a switch; `found` lists what deviates, `absent` says why a table has no strip."""

    name: str
    strips: Mapping[str, Strip]
    found: tuple[str, ...]
    absent: str
    spreads: tuple[Spread, ...] = ()

    def strip(self, table: str) -> Strip:
        """Return the strip of a table, an empty one if nothing was seen of it."""
        return self.strips.get(table) or Strip((), self.absent)
