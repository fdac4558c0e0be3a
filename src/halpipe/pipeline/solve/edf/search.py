"""The search over what earliest deadline first is told: units, phases and urgencies, until the table is valid.

The first plan is often enough: deadlines propagated back along windows, units by load. Where jobs come too late, the
plan changes around them: they become more urgent, are released at another phase, or move to other units.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.codes import TOO_MANY_PARTS
from halpipe.pipeline.solve.draws import Draws
from halpipe.pipeline.solve.edf.keeping import Memory, State
from halpipe.pipeline.solve.edf.moves import Moves
from halpipe.pipeline.solve.edf.plans import allowed_ways, first_plan, fits, together
from halpipe.pipeline.solve.edf.simulate import simulate
from halpipe.pipeline.solve.edf.tables import followed, lateness, missed_by_fixed, named
from halpipe.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from halpipe.durations import Duration
    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.solve.edf.jobs import Plan, Table
    from halpipe.pipeline.solve.edf.works import Mode
    from halpipe.pipeline.solve.goals import Polish
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept

MAX_PARTS = 10_000_000
"""Parts of all jobs in a hyperperiod (MODEL 8.3)."""

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


@record
class _Try:
    plan: Plan
    table: Table
    late: tuple[int, ...]
    excess: int
    slow: tuple[int, ...] = ()
    """The tasks of chains that are too long, where no job is late."""


@record
class Effort:
    """How long to search, in jobs placed, and then to improve; `go_on` is told of jobs placed and the least excess."""

    budget: int
    polish: int
    go_on: Callable[[int, int], bool]


def search(
    mode: Mode,
    model: TaskModel,
    seed: int,
    pinned: Mapping[str, tuple[str, ...]],
    effort: Effort,
    polish: Polish | None = None,
    kept: Kept | None = None,
) -> Found:
    """Look for a valid table of `mode`; `pinned` tasks stay on their units; with `polish` it goes on to better ones.

    What is `kept` of an earlier run is where the search goes on from.
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
        self.model = model
        self.limited = [c for c in model.chains if c.max_reaction is not None or c.max_age is not None]
        self.draws = draws
        self.effort = effort
        self.polish = polish
        self.allowed = allowed_ways(mode, pinned)
        self.moves = Moves(mode, self.allowed, model.chains, draws)
        self.memory = Memory(kept, self.allowed)
        self.placed = 0
        self.stopped = False

    def run(self) -> Found:
        state = self.memory.recalled()
        if state is None:
            best = current = self._nearer(self._settle(first_plan(self.mode, self.allowed)))
        else:
            best, current = self._evaluate(state.best), self._evaluate(state.current)
            self.placed, self.draws = state.placed, Draws(state.draws)
            self.moves.draws = self.draws
        if state is None or not state.first:
            best = self._found(best, current)
        unimproved = False
        if not best.excess and self.polish is not None and not self.stopped and self.moves.free:
            best = self._improved(best, self.polish, state if state is not None and state.first else None)
            unimproved, self.stopped = self.stopped, False
        jobs = named(self.mode, best.plan, best.table)
        return Found(jobs, best.excess, self.placed, self.stopped, unimproved)

    def _nearer(self, best: _Try) -> _Try:
        """Where chains are too long, try to put what follows each other in one on one unit."""
        if not best.excess or not self.limited:
            return best
        plan = together(self.mode, best.plan, self.allowed, self.limited)
        tried = self._evaluate(plan) if plan != best.plan else best
        return tried if tried.excess < best.excess else best

    def _found(self, best: _Try, current: _Try) -> _Try:
        """Repair plans until one leads to a valid table, or the budget is spent."""
        while best.excess and self.moves.free and self.placed < self.effort.budget and not self.stopped:
            self.memory.keep(State(self.placed, self.draws.state, current.plan, best.plan))
            moved = self._evaluate(self._repaired(current))
            if moved.excess <= current.excess or not self.draws.below(50):
                current = moved
            if current.excess < best.excess:
                best = current
        return best

    def _repaired(self, current: _Try) -> Plan:
        if not current.slow:
            return self.moves.repaired(current.plan, current.late)
        for _ in range(TRIES):
            varied = self.moves.varied(current.plan, current.slow)
            if varied != current.plan and fits(self.mode, varied):
                return varied
        return self.moves.repaired(current.plan, current.late)

    def _improved(self, best: _Try, polish: Polish, state: State | None) -> _Try:
        """Climb to tables that are worth more, from a valid one; nothing that counts gets worse than in the first."""
        first = state.first if state is not None else (best.plan,)
        began = state.began if state is not None else self.placed
        original = self._evaluate(first[0]) if state is not None else best
        judge = polish.judge
        bar = judge.worth(named(self.mode, original.plan, original.table))
        polish.first[:] = [bar]
        worth = judge.worth(named(self.mode, best.plan, best.table))
        tried = [] if state is not None else [together(self.mode, best.plan, self.allowed, self.model.chains)]
        if state is not None:
            self.placed = state.placed
        enough = polish.is_enough(named(self.mode, best.plan, best.table))
        while self.placed < began + self.effort.polish and not self.stopped and not enough:
            if not tried:
                self.memory.keep(State(self.placed, self.draws.state, best.plan, best.plan, first, began))
            plan = tried.pop() if tried else self.moves.varied(best.plan)
            if plan == best.plan or not fits(self.mode, plan):
                self.placed += 1
                continue
            moved = self._evaluate(plan)
            if moved.excess:
                continue
            better = judge.better(named(self.mode, moved.plan, moved.table), bar, worth)
            if better is not None:
                best, worth = moved, better
                polish.on_better(worth)
                enough = polish.is_enough(named(self.mode, best.plan, best.table))
        return best

    def _settle(self, plan: Plan) -> _Try:
        """Let the phases that are free follow the first starts, as long as that makes less late."""
        best = self._evaluate(plan)
        for _ in range(SETTLING):
            if not best.excess:
                break
            phases = followed(self.mode, best.plan, best.table)
            if phases == best.plan.phases:
                break
            tried = self._evaluate(replace(best.plan, phases=phases))
            if tried.excess >= best.excess:
                break
            best = tried
        return best

    def _evaluate(self, plan: Plan) -> _Try:
        table = simulate(self.mode, plan)
        self._refuse_crowds(table)
        self.placed += max(1, len(table.jobs))
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
        return _Try(plan, table, late, excess, slow)

    def _refuse_crowds(self, table: Table) -> None:
        """Stop where jobs have more parts than a schedule may have (MODEL 8.3)."""
        parts = sum(map(len, table.jobs.values()))
        if parts > MAX_PARTS:
            mode = self.mode.expansion.mode
            help = "state max-gaps, or a longer min-part, or periods with a shorter hyperperiod"
            text = f"its jobs have {parts} parts in a hyperperiod, {MAX_PARTS} are allowed"
            raise HalpipeError(TOO_MANY_PARTS(text, at=mode.at, path=f'mode "{mode.name}"', help=help))

    def _beside_fixed(self, plan: Plan, table: Table) -> int:
        """Return what a table still costs with the jobs that stay: those may break rules by themselves."""
        if not self.mode.fixed.jobs:
            return 0
        placement = Placement.of(self.mode.expansion, named(self.mode, plan, table), self.mode.platform)
        total = cost_terms(self.model, placement).total
        return max(0, -(-total.numerator // total.denominator))

    def _chain_excess(self, plan: Plan, table: Table) -> tuple[int, tuple[int, ...]]:
        """Return by how much chains are too long, and the tasks of those that are."""
        if not self.limited:
            return 0, ()
        placement = Placement.of(self.mode.expansion, named(self.mode, plan, table), self.mode.platform)
        found = {latency.name: latency for latency in chain_latencies(placement, self.limited)}
        excess = 0
        slow: set[str] = set()
        for chain in self.limited:
            if chain.name not in found:
                continue
            beyond = self._beyond(found[chain.name].reaction, chain.max_reaction)
            beyond += self._beyond(found[chain.name].age, chain.max_age)
            excess += beyond
            slow.update(chain.tasks if beyond else ())
        return excess, tuple(task for task, work in enumerate(self.mode.works) if work.name in slow)

    def _beyond(self, latency: Duration | None, limit: Duration | None) -> int:
        if limit is None:
            return 0
        if latency is None:
            return self.mode.hyperperiod
        return max(0, -((limit - latency) // self.mode.tick))
