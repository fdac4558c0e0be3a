"""Objectives after the first valid schedule: their order, and the limits that must not get worse."""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
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

POLISH_BUDGET = 300
"""Moves per task for one step of improving a valid schedule."""


class Quality(StrEnum):
    """What a search goes on for once a schedule is valid: nothing, the bonuses and chains, or WCET margins."""

    FIRST = "first"
    COST = "cost"
    MARGIN = "margin"


@record
class Goals:
    """What to go on for.

    - `objectives` come one before the other; none gets worse than in the first valid schedule.
    - `stages` are the wishes in their order. Each comes with the number of leading objectives in which what it finds
      may not be worse than the best so far.
    - With `hold`, no chain may get longer than it was at first.
    """

    objectives: tuple[Objective, ...]
    stages: tuple[tuple[str, int], ...]
    hold: bool = False

    @classmethod
    def of(cls, quality: Quality, objectives: tuple[Objective, ...] = ()) -> Goals | None:
        """Return the goals of the objectives named, or of a quality; None where the first valid schedule is enough."""
        if objectives:
            return cls(objectives, tuple((objective, place) for place, objective in enumerate(objectives, 1)))
        return QUALITIES[quality]


QUALITIES = {
    Quality.FIRST: None,
    Quality.COST: Goals(
        (Objective.CHAINS, Objective.COST),
        (("phases", 0), ("units", 0), ("phases", 0), (Objective.CHAINS, 1)),
        hold=True,
    ),
    Quality.MARGIN: Goals((Objective.MARGIN,), ((Objective.MARGIN, 1),)),
}


@record
class Polish:
    """The goals, who judges what is found, the moves per task and step, the seed, and when the jobs are good enough.

    `on_better` is told what each better schedule is worth.
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
    """The jobs of a mode at the end, what was reached, and whether somebody wanted no more before."""

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
    """Return how to improve the first valid schedule of a mode, until its cost F is at most `target`."""

    def is_enough(jobs: tuple[Job, ...]) -> bool:
        if target is None:
            return False
        report = mode_report(model, expansion, jobs, Status.VALID)
        return report.cost is not None and report.cost.total <= target

    judge = Judge(model, expansion, goals.objectives, each_chain=goals.hold)
    return Polish(goals, judge, POLISH_BUDGET, seed, is_enough, on_better)


def objectives_of(text: str) -> tuple[Objective, ...]:
    """Read a list of objectives such as ``chains,jitter``; raise ``ValueError`` that says what is wrong."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    known = [objective.value for objective in Objective if objective is not Objective.COST]
    for place, name in enumerate(names):
        if name not in known:
            raise ValueError(
                f"there is no objective {name!r}; {did_you_mean(name, known, 'there are: ' + ', '.join(known))}"
            )
        if name in names[:place]:
            raise ValueError(f"{name} is named twice")
    return tuple(map(Objective, names))
