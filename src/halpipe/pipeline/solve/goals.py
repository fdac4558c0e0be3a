"""Objectives after the first valid schedule: their order, and the limits that must not get worse."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.models import Status
from halpipe.pipeline.measure.metrics import mode_report
from halpipe.pipeline.measure.objectives import Judge, Objective

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.measure.objectives import Worth
    from halpipe.pipeline.solve.optimise import Reached

DELAYS, UNITS = "delays", "units"
"""Stages of the cost F: less delay of all jobs, and fewer units."""

POLISH_BUDGET = 300
"""Moves per task for one step of improving a valid schedule."""


@record
class Goals:
    """Objectives and the stages of their improvement.

    - `objectives` come one before the other; none gets worse than in the first valid schedule.
    - `stages` are the kinds of tightening in their order. Each comes with the number of leading objectives in which its
      results may not be worse than the best so far.
    """

    objectives: tuple[Objective, ...]
    stages: tuple[tuple[str, int], ...]

    @classmethod
    def of(cls, objectives: tuple[Objective, ...]) -> Goals:
        """Return the goals of the objectives named."""
        ranked = enumerate(objectives, 1)
        return cls(objectives, tuple((stage, rank) for rank, goal in ranked for stage in STAGES.get(goal, (goal,))))


STAGES: dict[Objective, tuple[str, ...]] = {Objective.COST: (DELAYS, UNITS, DELAYS)}
"""Stages of objectives that have several: the bonuses of F are for punctual jobs and for idle units."""


@record
class Polish:
    """The goals, the judge of schedules, the moves per task and step, the seed, and the end of the improvement.

    `on_better` receives the worth of each better schedule.
    """

    goals: Goals
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
    goals: Goals,
    target: Fraction | None,
    seed: int,
    on_better: Callable[[Worth], None] = lambda worth: None,
) -> Polish:
    """Return the improvement of the first valid schedule of a mode, which ends once its cost F is at most `target`."""

    def is_enough(jobs: tuple[Job, ...]) -> bool:
        if target is None:
            return False
        report = mode_report(model, expansion, jobs, Status.VALID)
        return report.cost is not None and report.cost.total <= target

    judge = Judge(model, expansion, goals.objectives)
    return Polish(goals, judge, POLISH_BUDGET, seed, is_enough, on_better)
