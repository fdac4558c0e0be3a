"""Tries of plans: the table that each leads to, and how far that is from a valid one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.records import record
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.codes import TOO_MANY_PARTS
from halpipe.pipeline.solve.edf.latencies import ChainTimes
from halpipe.pipeline.solve.edf.simulate import Simulator
from halpipe.pipeline.solve.edf.tables import lateness, missed_by_fixed, named

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.durations import Duration
    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.solve.edf.jobs import Plan, Table
    from halpipe.pipeline.solve.edf.latencies import Latency, Ticks
    from halpipe.pipeline.solve.edf.works import Mode

MAX_PARTS = 10_000_000
"""Parts of all jobs in a hyperperiod (MODEL 8.3)."""


@record
class Try:
    """A plan and its table. `excess` is zero if no job is late, and no chain beyond its limit."""

    plan: Plan
    table: Table
    late: tuple[int, ...]
    excess: int
    slow: tuple[int, ...] = ()
    """The tasks of chains that are too long, where no job is late."""


@record
class Effort:
    """How long to search, in jobs placed, and then to improve; `go_on` gets the jobs placed and the least excess."""

    budget: int
    polish: int
    go_on: Callable[[int, int], bool]


class Trials:
    """Tries plans of one mode, and counts the jobs that were placed."""

    def __init__(self, mode: Mode, model: TaskModel, effort: Effort) -> None:
        """Begin without any."""
        self.mode = mode
        self.model = model
        self.effort = effort
        self.placed = 0
        self.stopped = False
        self._simulator = Simulator(mode)
        self._is_refined = bool(mode.expansion.locks) or any(True for _ in model.refinements())
        self._times = ChainTimes(mode, model.chains)
        self.limited = [chain for chain in model.chains if chain.max_reaction is not None or chain.max_age is not None]
        self._limits = ChainTimes(mode, self.limited)

    def evaluate(self, plan: Plan) -> Try:
        """Try a plan."""
        table = self._simulator.table(plan)
        self._refuse_crowds(table)
        self.placed += max(1, len(table))
        missed = missed_by_fixed(self.mode, table)
        late = tuple(late + missed.get(task, 0) for task, late in enumerate(lateness(self.mode, table)))
        excess = sum(late)
        slow: tuple[int, ...] = ()
        if not table.closed:
            excess += self.mode.hyperperiod
        elif not excess:
            excess, slow = self._chain_excess(plan, table)
            excess += self._beside_fixed(plan, table)
        if not self.effort.go_on(self.placed, excess):
            self.stopped = True
        return Try(plan, table, late, excess, slow)

    def jobs(self, found: Try) -> tuple[Job, ...]:
        """Return the jobs of a table with their names, in exact time."""
        return named(self.mode, found.plan, found.table)

    def latencies(self, found: Try) -> list[Latency]:
        """Return the latencies of the chains all of whose tasks run in the mode, in the order of the model."""
        return self._times.of(found.plan, found.table)

    def _refuse_crowds(self, table: Table) -> None:
        """Stop where jobs have more parts than a schedule may have (MODEL 8.3)."""
        parts = table.part_count
        if parts > MAX_PARTS:
            mode = self.mode.expansion.mode
            help = "state max-gaps, or a longer min-part, or periods with a shorter hyperperiod"
            text = f"its jobs have {parts} parts in a hyperperiod, {MAX_PARTS} are allowed"
            raise HalpipeError(TOO_MANY_PARTS(text, at=mode.at, path=f'mode "{mode.name}"', help=help))

    def _beside_fixed(self, plan: Plan, table: Table) -> int:
        """Return what a table still costs: with jobs that stay, or by rules that no simulation keeps (MODEL 10)."""
        if not self.mode.fixed.jobs and not self._is_refined:
            return 0
        placement = Placement.of(self.mode.expansion, named(self.mode, plan, table), self.mode.platform)
        return max(0, math.ceil(cost_terms(self.model, placement).total))

    def _chain_excess(self, plan: Plan, table: Table) -> tuple[int, tuple[int, ...]]:
        """Return by how much chains are too long, and the tasks of those that are."""
        excess = 0
        slow: set[str] = set()
        for chain, (reaction, age) in zip(self._limits.chains, self._limits.of(plan, table), strict=True):
            beyond = self._beyond(reaction, chain.max_reaction) + self._beyond(age, chain.max_age)
            excess += beyond
            slow.update(chain.tasks if beyond else ())
        return excess, tuple(task for task, work in enumerate(self.mode.works) if work.name in slow)

    def _beyond(self, latency: Ticks, limit: Duration | None) -> int:
        return 0 if limit is None else max(0, math.ceil(latency - limit / self.mode.tick))
