"""Search over the inputs of earliest deadline first: units, phases and urgencies, until the table is valid.

The first plan is often enough: deadlines propagated back along windows, units by load. Where jobs come too late, the
plan changes around them: they become more urgent, are released at another phase, or move to other units.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.edf.improving import Climb
from halpipe.pipeline.solve.edf.keeping import Memory, State
from halpipe.pipeline.solve.edf.moves import Moves
from halpipe.pipeline.solve.edf.plans import allowed_ways, first_plan, fits, together
from halpipe.pipeline.solve.edf.tables import followed
from halpipe.pipeline.solve.edf.trials import Effort, Trials, Try
from halpipe.pipeline.solve.integers import Draws

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.solve.edf.jobs import Plan
    from halpipe.pipeline.solve.edf.works import Mode
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept
    from halpipe.pipeline.solve.optimise import Polish

TRIES = 20
"""Draws of a plan that differs and overloads no unit, before any is taken."""

SETTLING = 4
"""Simulations in which the phases of the first plan follow where its jobs start."""


@record
class Found:
    """The best table of a search; `excess` is zero if no job in it is late and no chain beyond its limit."""

    jobs: tuple[Job, ...]
    excess: int
    placed: int
    stopped: bool
    unimproved: bool


def search(
    mode: Mode,
    model: TaskModel,
    seed: int,
    pinned: Mapping[str, tuple[str, ...]],
    effort: Effort,
    polish: Polish | None = None,
    kept: Kept | None = None,
) -> Found:
    """Look for a valid table of `mode`; `pinned` tasks stay on their units; with `polish` it continues to better ones.

    The search continues from what is `kept` of an earlier run.
    """
    return _Search(mode, model, Draws(seed), effort, pinned, polish, kept).run()


class _Search:
    def __init__(
        self,
        mode: Mode,
        model: TaskModel,
        draws: Draws,
        effort: Effort,
        pinned: Mapping[str, tuple[str, ...]],
        polish: Polish | None,
        kept: Kept | None,
    ) -> None:
        self.mode = mode
        self.trials = Trials(mode, model, effort)
        self.draws = draws
        self.polish = polish
        self.allowed = allowed_ways(mode, pinned)
        self.moves = Moves(mode, self.allowed, model.chains, draws)
        self.memory = Memory(kept, self.allowed)

    def run(self) -> Found:
        trials, state = self.trials, self.memory.recalled()
        if state is None:
            best = current = self._nearer(self._settle(first_plan(self.mode, self.allowed)))
        else:
            best, current = trials.evaluate(state.best), trials.evaluate(state.current)
            trials.placed, self.draws = state.placed, Draws(state.draws)
            self.moves.draws = self.draws
        if state is None or not state.first:
            best = self._found(best, current)
        unimproved = False
        if not best.excess and self.polish is not None and not trials.stopped and self.moves.free:
            climb = Climb(trials, self.moves, self.memory, self.polish, self.allowed)
            best = climb.climbed(best, state if state is not None and state.first else None)
            unimproved, trials.stopped = trials.stopped, False
        return Found(trials.jobs(best), best.excess, trials.placed, trials.stopped, unimproved)

    def _nearer(self, best: Try) -> Try:
        """Where chains are too long, try to put what follows each other in one on one unit."""
        if not best.excess or not self.trials.limited:
            return best
        plan = together(self.mode, best.plan, self.allowed, self.trials.limited)
        tried = self.trials.evaluate(plan) if plan != best.plan else best
        return tried if tried.excess < best.excess else best

    def _found(self, best: Try, current: Try) -> Try:
        """Repair plans until one leads to a valid table, or the budget is spent."""
        trials = self.trials
        while best.excess and self.moves.free and trials.placed < trials.effort.budget and not trials.stopped:
            self.memory.keep(State(trials.placed, self.draws.state, current.plan, best.plan))
            moved = trials.evaluate(self._repaired(current))
            if moved.excess <= current.excess or not self.draws.below(50):
                current = moved
            if current.excess < best.excess:
                best = current
        return best

    def _repaired(self, current: Try) -> Plan:
        if not current.slow:
            return self.moves.repaired(current.plan, current.late)
        for _ in range(TRIES):
            varied = self.moves.varied(current.plan, current.slow)
            if varied != current.plan and fits(self.mode, varied):
                return varied
        return self.moves.repaired(current.plan, current.late)

    def _settle(self, plan: Plan) -> Try:
        """Let the phases that are free follow the first starts, as long as that makes less late."""
        best = self.trials.evaluate(plan)
        for _ in range(SETTLING):
            if not best.excess:
                break
            phases = followed(self.mode, best.plan, best.table)
            if phases == best.plan.phases:
                break
            tried = self.trials.evaluate(replace(best.plan, phases=phases))
            if tried.excess >= best.excess:
                break
            best = tried
        return best
