"""Improving a valid table of split jobs: other plans are tried, and kept where the latencies or the cost are better.

No chain ever gets longer than in the first valid table, in reaction time or in data age.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.models import ChainLatency, Status
from halpipe.pipeline.measure.metrics import mode_report

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.models import Job, ModeSchedule, TaskModel
    from halpipe.pipeline.jobs import Expansion

Worth = tuple[Fraction, Fraction]
"""The sum of all latencies in nanoseconds, and the cost: less is better, in this order."""


@dataclass(frozen=True, slots=True)
class Judge:
    """Tells which of the valid tables of a mode is the better one."""

    model: TaskModel
    expansion: Expansion
    is_enough: Callable[[tuple[Job, ...]], bool]

    def report(self, jobs: tuple[Job, ...]) -> ModeSchedule:
        """Return the table with its metrics."""
        return mode_report(self.model, self.expansion, jobs, Status.VALID)

    def worth(self, report: ModeSchedule) -> Worth:
        """Return what a table is worth."""
        latencies = [time for chain in report.chains for time in (chain.reaction, chain.age) if time is not None]
        cost = report.cost.total if report.cost else Fraction(0)
        return sum((time.fraction for time in latencies), Fraction(0)), cost

    def keeps(self, first: ModeSchedule, report: ModeSchedule) -> bool:
        """Return whether no chain is worse than in the first table."""
        pairs = zip(first.chains, report.chains, strict=True)
        return all(_is_within(one, two) for one, two in pairs)


def _is_within(before: ChainLatency, after: ChainLatency) -> bool:
    pairs = ((before.reaction, after.reaction), (before.age, after.age))
    return all(one is None or (two is not None and two <= one) for one, two in pairs)
