"""State of a search over plans as whole numbers, so that a resumed run gives the same bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.edf.jobs import Plan
from halpipe.pipeline.solve.integers import ints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.pipeline.solve.edf.works import Way
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.run_in_slices import Kept


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
