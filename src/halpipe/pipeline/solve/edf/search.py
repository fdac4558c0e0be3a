"""Search over the inputs of earliest deadline first: units, phases and urgencies, until the table is valid.

The first plan is often enough: deadlines propagated back along windows, units by load. Where jobs come too late, the
plan changes around them: they become more urgent, are released at another phase, or move to other units. From a valid
table the search climbs to others that are worth more; nothing that counts gets worse than in the first.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.edf.plans import Moves, Plan, adopted, allowed_ways, first_plan, fits, together
from halpipe.pipeline.solve.edf.trials import Effort, Trials, Try, followed
from halpipe.pipeline.solve.integers import Draws, ints

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.edf.trials import Ticks
    from halpipe.pipeline.solve.edf.works import Mode, Way
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.lanes import Pins
    from halpipe.pipeline.solve.optimise import Polish


@record
class State:
    """Jobs placed, the state of the draws, the plan that is changed, the best one; and while a valid table is improved
    the `first` valid one and the jobs that were placed when it was found."""

    placed: int
    draws: int
    current: Plan
    best: Plan
    first: tuple[Plan, ...] = ()
    began: int = 0


class Memory:
    """Keeps states of one search with a keeper, if there is one."""

    def __init__(self, kept: Kept | None, allowed: Sequence[tuple[Way, ...]]) -> None:
        self._kept = kept
        self._allowed = allowed

    def keep(self, state: State) -> None:
        """Save where the search stands."""
        if self._kept is None:
            return
        facts = {"counts": ints([state.placed, state.began, state.draws >> 32, state.draws & 0xFFFFFFFF])}
        plans = {"current": state.current, "best": state.best, **{f"first{n}": p for n, p in enumerate(state.first)}}
        self._kept.note(facts | {name: self._written(plan) for name, plan in plans.items()})

    def recalled(self) -> State | None:
        """Return where an earlier run stood; None if there was none, or what it left does not fit the mode."""
        facts = self._kept.noted() if self._kept is not None else None
        if not facts or not {"counts", "current", "best"} <= facts.keys():
            return None
        plans = {name: self._read(facts[name]) for name in ("current", "best", "first0") if name in facts}
        current, best, first = plans["current"], plans["best"], plans.get("first0")
        if current is None or best is None or len(facts["counts"]) != 4:
            return None
        placed, began, high, low = facts["counts"]
        return State(placed, high << 32 | low, current, best, () if first is None else (first,), began)

    def _written(self, plan: Plan) -> Ints:
        ways = [ways.index(way) for ways, way in zip(self._allowed, plan.ways, strict=True)]
        return ints([int(plan.fresh), *ways, *plan.phases, *plan.urgency, *plan.holds])

    def _read(self, numbers: Ints) -> Plan | None:
        count = len(self._allowed)
        if len(numbers) != 1 + 4 * count:
            return None
        ways, phases, urgency, holds = (tuple(numbers[1 + n * count : 1 + (n + 1) * count]) for n in range(4))
        if any(not 0 <= way < len(allowed) for way, allowed in zip(ways, self._allowed, strict=True)):
            return None
        chosen = tuple(allowed[way] for way, allowed in zip(ways, self._allowed, strict=True))
        return Plan(chosen, phases, urgency, holds, fresh=bool(numbers[0]))


STEPS = 50
"""Tables that are tried by their chains alone before what they led to is judged."""

JUDGING = 16
"""To judge a table takes about as long as to try so many."""

TRIES = 20
"""Draws of a plan that differs and overloads no unit, before any is taken."""

SETTLING = 4
"""Simulations in which the phases of the first plan follow where its jobs start."""


@record
class Found:
    """The best table of a search; `excess` is zero if no job in it is late and no chain beyond its limit."""

    plan: Plan
    jobs: tuple[Job, ...]
    excess: int
    placed: int
    stopped: bool
    unimproved: bool


class Search:
    """Search for a valid table of a mode, and with `polish` for better ones.

    `pinned` tasks stay on their units. A plan `before` it, of the same mode with other lengths, is tried first. The
    search continues from what is `kept` of an earlier run.
    """

    def __init__(
        self,
        mode: Mode,
        model: TaskModel,
        seed: int,
        pinned: Mapping[str, Pins],
        effort: Effort,
        polish: Polish | None = None,
        kept: Kept | None = None,
        before: Plan | None = None,
    ) -> None:
        self.mode = mode
        self.trials = Trials(mode, model, effort)
        self.polish = polish
        self.allowed = allowed_ways(mode, pinned)
        self.moves = Moves(mode, self.allowed, model.chains, Draws(seed))
        self.memory = Memory(kept, self.allowed)
        self.before = before

    def run(self) -> Found:
        """Search for a valid table, then for better ones."""
        trials, state = self.trials, self.memory.recalled()
        if state is None:
            best = current = self._first()
        else:
            best, current = trials.evaluate(state.best), trials.evaluate(state.current)
            trials.placed, self.moves.draws = state.placed, Draws(state.draws)
        if state is None or not state.first:
            best = self._found(best, current)
        unimproved = False
        if not best.excess and self.polish is not None and not trials.stopped and self.moves.free:
            best = self._climbed(self.polish, best, state if state is not None and state.first else None)
            unimproved, trials.stopped = trials.stopped, False
        return Found(best.plan, trials.jobs(best), best.excess, trials.placed, trials.stopped, unimproved)

    # ---- a valid table

    def _first(self) -> Try:
        """Return the table to begin with."""
        earlier = None if self.before is None else self._settle(adopted(self.before, self.allowed))
        if earlier is not None and not earlier.excess:
            return earlier
        first = self._nearer(self._settle(first_plan(self.mode, self.allowed)))
        return first if earlier is None or first.excess < earlier.excess else earlier

    def _nearer(self, best: Try) -> Try:
        """Put the successive tasks of chains that are too long on one unit."""
        if not best.excess or not self.trials.limited:
            return best
        plan = together(self.mode, best.plan, self.allowed, self.trials.limited)
        tried = self.trials.evaluate(plan) if plan != best.plan else best
        return tried if tried.excess < best.excess else best

    def _found(self, best: Try, current: Try) -> Try:
        """Repair plans until one leads to a valid table, or the budget is spent."""
        trials, draws = self.trials, self.moves.draws
        while best.excess and self.moves.free and trials.placed < trials.effort.budget and not trials.stopped:
            self.memory.keep(State(trials.placed, draws.state, current.plan, best.plan))
            moved = trials.evaluate(self._repaired(current))
            if moved.excess <= current.excess or not draws.below(50):
                current = moved
            if current.excess < best.excess:
                best = current
        return best

    def _repaired(self, current: Try) -> Plan:
        for _ in range(TRIES if current.slow else 0):
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

    # ---- better tables

    def _climbed(self, polish: Polish, best: Try, state: State | None) -> Try:
        """Return the best table that is found from a valid one on, or from where an earlier run stood."""
        trials, judge = self.trials, polish.judge
        first = best if state is None else trials.evaluate(state.first[0])
        bar = judge.worth(trials.jobs(first))
        polish.first[:] = [bar]
        nearer = trials.evaluate(together(trials.mode, first.plan, self.allowed, trials.model.chains))
        beside = None if nearer.excess else judge.better(trials.jobs(nearer), bar, bar)
        if beside is not None:
            bar = beside if judge.keeps(bar, beside) else bar
            best = nearer if state is None else best
            polish.on_better(beside)
        began = trials.placed if state is None else state.began
        trials.placed = trials.placed if state is None else state.placed
        # Where chains come first, many steps lead to a table that is judged.
        beside_it = self._walked if judge.chain_weights and judge.is_led_by_chains else self._varied
        jobs = trials.jobs(best)
        worth = judge.worth(jobs)
        while trials.placed < began + trials.effort.polish and not trials.stopped and not polish.is_enough(jobs):
            self.memory.keep(State(trials.placed, self.moves.draws.state, best.plan, best.plan, (first.plan,), began))
            moved = beside_it(best)
            if moved is None or moved is best:
                continue
            trials.placed += JUDGING * len(moved.table)
            better = judge.better(moved_jobs := trials.jobs(moved), bar, worth)
            if better is not None:
                best, worth, jobs = moved, better, moved_jobs
                polish.on_better(worth)
        return best

    def _walked(self, best: Try) -> Try:
        """Go to tables whose chains are no longer, all together."""
        current, least = best, self._sum(best)
        for _ in range(STEPS):
            moved = self._varied(current)
            if moved is not None and (total := self._sum(moved)) <= least:
                current, least = moved, total
            if self.trials.stopped:
                break
        return current

    def _sum(self, found: Try) -> Ticks:
        """Return the weighted sum of the latencies of a table."""
        weights = self.polish.judge.chain_weights if self.polish is not None else ()
        return sum(w * sum(both) for w, both in zip(weights, self.trials.latencies(found), strict=True))

    def _varied(self, current: Try) -> Try | None:
        """Try a plan beside that of a table; return None if no valid table comes of it."""
        plan: Plan = self.moves.varied(current.plan)
        if plan == current.plan or not fits(self.mode, plan):
            self.trials.placed += 1
            return None
        moved = self.trials.evaluate(plan)
        return None if moved.excess else moved
