"""Climbing from a valid table to others that are worth more; nothing that counts gets worse than in the first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.solve.edf.keeping import State
from halpipe.pipeline.solve.edf.plans import fits, together

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.pipeline.solve.edf.jobs import Plan
    from halpipe.pipeline.solve.edf.keeping import Memory
    from halpipe.pipeline.solve.edf.latencies import Latency, Ticks
    from halpipe.pipeline.solve.edf.moves import Moves
    from halpipe.pipeline.solve.edf.trials import Trials, Try
    from halpipe.pipeline.solve.edf.works import Way
    from halpipe.pipeline.solve.optimise import Polish

STEPS = 50
"""Tables that are tried by their chains alone before what they led to is judged."""

JUDGING = 16
"""To judge a table takes about as long as to try so many."""


class Climb:
    """Goes from one table of a mode to the next."""

    def __init__(
        self, trials: Trials, moves: Moves, memory: Memory, polish: Polish, allowed: Sequence[tuple[Way, ...]]
    ) -> None:
        """Get ready; `allowed` are the ways that each task may take."""
        self.trials = trials
        self.moves = moves
        self.memory = memory
        self.polish = polish
        self.allowed = allowed
        self.weights = polish.judge.chain_weights

    def climbed(self, best: Try, state: State | None) -> Try:
        """Return the best table that is found from a valid one on, or from where an earlier run stood."""
        trials, polish, judge = self.trials, self.polish, self.polish.judge
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
        jobs = trials.jobs(best)
        worth = judge.worth(jobs)
        while trials.placed < began + trials.effort.polish and not trials.stopped and not polish.is_enough(jobs):
            plans = best.plan, best.plan, (first.plan,)
            self.memory.keep(State(trials.placed, self.moves.draws.state, *plans, began))
            moved = self._beside(best)
            if moved is best:
                continue
            trials.placed += JUDGING * len(moved.table)
            better = judge.better(moved_jobs := trials.jobs(moved), bar, worth)
            if better is not None:
                best, worth, jobs = moved, better, moved_jobs
                polish.on_better(worth)
        return best

    def _beside(self, best: Try) -> Try:
        """Return a valid table beside the best one; where chains come first, one to which many steps lead."""
        if self.weights and self.polish.judge.is_led_by_chains:
            return self._walked(best)
        return self._varied(best) or best

    def _walked(self, best: Try) -> Try:
        """Go to tables whose chains are no longer, all together."""
        current, least = best, self._sum(self.trials.latencies(best))
        for _ in range(STEPS):
            moved = self._varied(current)
            if moved is not None:
                total = self._sum(self.trials.latencies(moved))
                if total <= least:
                    current, least = moved, total
            if self.trials.stopped:
                break
        return current

    def _sum(self, latencies: Iterable[Latency]) -> Ticks:
        return sum(weight * sum(both) for weight, both in zip(self.weights, latencies, strict=True))

    def _varied(self, current: Try) -> Try | None:
        """Try a plan beside that of a table; return None if no valid table comes of it."""
        plan: Plan = self.moves.varied(current.plan)
        if plan == current.plan or not fits(self.trials.mode, plan):
            self.trials.placed += 1
            return None
        moved = self.trials.evaluate(plan)
        return None if moved.excess else moved
