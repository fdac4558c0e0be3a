"""The last step of optimising: the exact engine where it helps, and how far what was reached is from the best."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.bounds import lower_bound
from halpipe.pipeline.solve.exact import Effort, violations
from halpipe.pipeline.solve.goals import Finished

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.models import Job
    from halpipe.pipeline.measure.objectives import Worth
    from halpipe.pipeline.solve.goals import Goals, Polish


@record
class Reached:
    """What became of one objective in a mode: its value at first and now, and what no valid schedule falls below."""

    mode: str
    objective: Objective
    first: Fraction
    value: Fraction
    bound: Fraction | None

    @property
    def gap(self) -> Fraction | None:
        """By what share of the bound the value may be above the best possible; None where that is not known."""
        if self.bound is None:
            return None
        if self.value == self.bound:
            return Fraction(0)
        return (self.value - self.bound) / abs(self.bound) if self.bound else None

    def __str__(self) -> str:
        """Say it in a line."""
        now, before = self._text(self.value), self._text(self.first)
        return f"{WORDS[self.objective]} {now}, at first {before}; {self._standing()}"

    def _standing(self) -> str:
        if self.bound is None:
            return "how good it can be is not known"
        if self.value == self.bound:
            return "the best possible"
        best = self._text(self.bound)
        if self.gap is None or self.objective is Objective.MARGIN:
            return f"the best possible is at {'most' if self.objective is Objective.MARGIN else 'least'} {best}"
        percent = -(-self.gap * 1000 // 1)  # rounded up, to a tenth
        return f"at most {format_rational(Fraction(int(percent), 10))} % above the best possible ({best} or more)"

    def _text(self, value: Fraction) -> str:
        return value_text(self.objective, value)


def value_text(objective: Objective, value: Fraction) -> str:
    """Return the value of an objective in its unit."""
    if objective in (Objective.CHAINS, Objective.JITTER):
        return str(Duration(round(value)))
    if objective is Objective.MARGIN:
        return f"{format_rational(Fraction(int(-value * 1000), 10))} %"
    return format_rational(value) if value >= 0 else f"-{format_rational(-value)}"


def telling(goals: Goals, tell: Callable[[str], None]) -> Callable[[Worth], None]:
    """Return what tells in a few words how far all objectives are."""

    def said(worth: Worth) -> None:
        pairs = zip(goals.objectives, worth.values, strict=True)
        tell(", ".join(f"{objective} {value_text(objective, value)}" for objective, value in pairs))

    return said


WORDS = {
    Objective.CHAINS: "weighted sum of reaction times and data ages",
    Objective.JITTER: "sum of start jitters",
    Objective.MARGIN: "least margin of a WCET",
    Objective.PREEMPTIONS: "preemptions",
    Objective.COST: "cost F",
}


def finish(polish: Polish, jobs: tuple[Job, ...], seed: int, go_on: Callable[[], bool], *, is_free: bool) -> Finished:
    """Return the jobs, better ones if the exact engine finds them, and what was reached.

    It is asked where shorter chains come first, and where it `is_free` to move all jobs on the grid of the model.
    """
    judge = polish.judge
    first = polish.first[0] if polish.first else judge.worth(jobs)
    worth, is_stopped = judge.worth(jobs), False
    bounds = [lower_bound(objective, judge.model, judge.expansion) for objective in judge.objectives]
    if judge.objectives[0] is Objective.CHAINS and is_free and bounds[0] != worth.values[0]:
        from halpipe.pipeline.solve.exact_chains import shortest_chains

        shortest = shortest_chains(
            judge.model, judge.expansion, jobs, worth.values[0], replace(Effort(), seed=seed % 2**31, go_on=go_on)
        )
        bounds[0], is_stopped = shortest.bound, shortest.stopped
        if shortest.jobs:
            found = judge.worth(shortest.jobs)
            if found.values < worth.values and judge.keeps(first, found):
                jobs, worth = shortest.jobs, found
    if judge.objectives[0] is Objective.MARGIN and bounds[0] is not None and bounds[0] < worth.values[0]:
        from halpipe.pipeline.solve.stretch import stretched

        wider = stretched(judge.model, judge.expansion, jobs, -bounds[0])
        found = judge.worth(wider)
        is_better = found.values < worth.values and judge.keeps(first, found)
        if is_better and not violations(judge.model, judge.expansion, wider):
            jobs, worth = wider, found
    rows = zip(judge.objectives, first.values, worth.values, bounds, strict=True)
    return Finished(jobs, tuple(Reached(judge.expansion.mode.name, *row) for row in rows), is_stopped)
