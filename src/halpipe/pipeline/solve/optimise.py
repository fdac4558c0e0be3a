"""Objectives after the first valid schedule: their order, lower bounds, and the last step of the improvement.

Bounds come from arithmetic alone. Along a chain the WCETs add up, and the first task's period for a stimulus that it
just missed. Whatever the phases, a task k of the chain starts at instants that lie, seen from the jobs of the first
task, in D_k / g different places of its period, g = gcd(D_1, D_k); if all latencies are at least M, the greatest is at
least M + D_k - g, less what the slacks of both may take back. The same holds for data age seen from the jobs of the
last task.
"""

from __future__ import annotations

from dataclasses import field, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.quantities import format_percent, format_rational
from halpipe.core.records import record
from halpipe.models import Anchor, Status
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.measure.margins import largest_margin, least_wcet
from halpipe.pipeline.measure.objectives import Judge, Objective
from halpipe.pipeline.solve.exact import Effort

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.models import Chain, Job, TaskModel
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.measure.objectives import Worth


DELAYS, UNITS = "delays", "units"
"""Stages of the cost F: less delay of all jobs, and fewer units."""

POLISH_BUDGET, MARGIN_BUDGET = 300, 2000
"""Moves per task for one step of improving a valid schedule, and where the margin comes first, as much as for `size`:
longer jobs hardly fit beside each other where the valid schedule has them."""


STAGES: dict[Objective, tuple[str, ...]] = {Objective.COST: (DELAYS, UNITS, DELAYS)}
"""Stages of objectives that have several: the bonuses of F are for punctual jobs and for idle units."""


def stages_of(objectives: tuple[Objective, ...]) -> Iterator[tuple[str, int]]:
    """Yield the kinds of tightening in order, with how many leading objectives may not get worse by it."""
    for rank, goal in enumerate(objectives, 1):
        yield from ((stage, rank) for stage in STAGES.get(goal, (goal,)))


@record
class Polish:
    """The judge of schedules, the moves per task and step, the seed, and the end of the improvement.

    `on_better` receives the worth of each better schedule.
    """

    judge: Judge
    budget: int
    seed: int
    is_enough: Callable[[tuple[Job, ...]], bool]
    on_better: Callable[[Worth], None]
    first: list[Worth] = field(default_factory=list)
    """What the first valid schedule was worth, once there is one."""


@record
class Finished:
    """The jobs of a mode at the end, what was reached, and whether the caller stopped it before."""

    jobs: tuple[Job, ...]
    reached: tuple[Reached, ...] = ()
    stopped: bool = False


def polish_of(
    model: TaskModel,
    expansion: Expansion,
    objectives: tuple[Objective, ...],
    target: Fraction | None,
    seed: int,
    tell: Callable[[str], None],
    budget: int | None,
) -> Polish:
    """Return the improvement of the first valid schedule of a mode, which ends once its cost F is at most `target`.

    No step takes more than a stated `budget`; `tell` gets the objectives of each better schedule in a few words.
    """

    def is_enough(jobs: tuple[Job, ...]) -> bool:
        if target is None:
            return False
        report = mode_report(model, expansion, jobs, Status.VALID)
        return report.cost is not None and report.cost.total <= target

    def on_better(worth: Worth) -> None:
        pairs = zip(objectives, worth.values, strict=True)
        tell(", ".join(f"{objective} {value_text(objective, value)}" for objective, value in pairs))

    most = MARGIN_BUDGET if objectives[0] is Objective.MARGIN else POLISH_BUDGET
    return Polish(Judge(model, expansion, objectives), min(most, budget or most), seed, is_enough, on_better)


@record
class Reached:
    """Result of one objective in a mode: its value at first and now, and a bound on all valid schedules."""

    mode: str
    objective: Objective
    first: Fraction
    value: Fraction
    bound: Fraction | None

    def __str__(self) -> str:
        """Say it in a line."""
        now, before = self._text(self.value), self._text(self.first)
        return f"{WORDS[self.objective]} {now}, at first {before}; {self._standing()}"

    def _standing(self) -> str:
        if self.bound is None:
            return "how good it can be is not known"
        if self.value == self.bound:
            return "the best possible"
        if self.objective is Objective.MARGIN:
            proven, best = "" if self.value else "not proven best; ", format_percent(-self.bound, is_bound=True)
            return f"{proven}the best possible is at most {best}"
        best = self._text(self.bound)
        if not self.bound:
            return f"the best possible is at least {best}"
        percent = -((self.bound - self.value) * 1000 // self.bound)  # rounded up, to a tenth
        return f"at most {format_rational(Fraction(int(percent), 10))} % above the best possible ({best} or more)"

    def _text(self, value: Fraction) -> str:
        return value_text(self.objective, value)


def value_text(objective: Objective, value: Fraction) -> str:
    """Return the value of an objective in its unit."""
    if objective in (Objective.CHAINS, Objective.JITTER):
        return str(Duration(round(value)))
    if objective is Objective.MARGIN:
        return format_percent(-value)
    return format_rational(value) if value >= 0 else f"-{format_rational(-value)}"


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
        from halpipe.pipeline.solve.exact_goals import shortest_chains

        least = {chain: sum(times, Fraction(0)) for chain, times in chain_bounds(judge.model, judge.expansion)}
        effort = replace(Effort(), seed=seed, go_on=go_on)
        shortest = shortest_chains(judge.model, judge.expansion, jobs, worth.values[0], least, effort)
        bounds[0], is_stopped = shortest.bound, shortest.stopped
        if shortest.jobs:
            found = judge.worth(shortest.jobs)
            if found.values < worth.values and judge.keeps(first, found):
                jobs, worth = shortest.jobs, found
    rows = zip(judge.objectives, first.values, worth.values, bounds, strict=True)
    return Finished(jobs, tuple(Reached(judge.expansion.mode.name, *row) for row in rows), is_stopped)


def lower_bound(objective: Objective, model: TaskModel, expansion: Expansion) -> Fraction | None:
    """Return what no valid schedule of a mode falls below; None where nothing is known."""
    match objective:
        case Objective.CHAINS:
            return sum((chain.weight * sum(bounds) for chain, bounds in chain_bounds(model, expansion)), Fraction(0))
        case Objective.JITTER | Objective.PREEMPTIONS:
            return Fraction(0)
        case Objective.MARGIN:
            return -largest_margin(expansion, model)
        case _:
            return None


def chain_bounds(model: TaskModel, expansion: Expansion) -> list[tuple[Chain, tuple[Fraction, Fraction]]]:
    """Return the least reaction time and data age, in nanoseconds, of every chain whose tasks all run."""
    found = []
    for chain in model.chains:
        if expansion.by_name.keys() >= set(chain.tasks):
            members = [expansion.by_name[name] for name in chain.tasks]
            less = _uncounted(chain, expansion)
            bounds = (max(ZERO, bound - less).ns for bound in (_reaction(members), _age(members)))
            found.append((chain, (Fraction(next(bounds)), Fraction(next(bounds)))))
    return found


def _uncounted(chain: Chain, expansion: Expansion) -> Duration:
    """Return how long those jobs last at most whose ends a chain begins with, or with whose starts it ends."""
    names = chain.tasks[: chain.anchor is Anchor.END] + chain.tasks[len(chain.tasks) - (chain.to is Anchor.START) :]
    longest = ZERO
    for active in map(expansion.by_name.__getitem__, names):
        task, versions = active.task, active.versions
        if expansion.interrupts or any(version.split.is_allowed for version in versions):
            longest += task.deadline or task.distance or task.period or expansion.hyperperiod
        else:
            longest += max(version.wcet or ZERO for version in versions)
    return longest


def _reaction(members: list[ActiveTask]) -> Duration:
    first = members[0]
    work = sum((least_wcet(member) for member in members), ZERO)
    if first.task.period is None:
        return work
    period = first.task.period
    spread = max((_spread(first, member) for member in members[1:]), default=ZERO)
    return max(work + period, work + period - _late(first) + spread)


def _age(members: list[ActiveTask]) -> Duration:
    last = members[-1]
    work = sum((least_wcet(member) for member in members), ZERO)
    return work + max((_spread(last, member) for member in members[:-1]), default=ZERO)


def _spread(seen_from: ActiveTask, member: ActiveTask) -> Duration:
    """Return by how much the latencies of the jobs of one task differ at least, because another has its own period."""
    one, other = seen_from.task.period, member.task.period
    if one is None or other is None:
        return ZERO
    gained = other - greatest_common_divisor([one, other]) - _late(member) - _late(seen_from)
    return max(ZERO, gained)


def _late(active: ActiveTask) -> Duration:
    """Return how far the jobs of a task may be from strictly periodic."""
    period = active.task.period
    return ZERO if period is None or active.jobs < 2 else period * active.task.slack
