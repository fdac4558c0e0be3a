"""Preemption points of a task, from its `preemption` attribute and the ends of the runnables that it calls."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.importers.amalthea.graph import CALLS, GROUPS, SWITCHES
from halpipe.importers.common.pieces import cuts
from halpipe.models import WHOLE, AccessKind, Split

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.importers.amalthea.graph import Evaluator
    from halpipe.importers.amalthea.hardware import Pu
    from halpipe.importers.amalthea.memory import Phase
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Draft
    from halpipe.importers.amalthea.xmi import Item
    from halpipe.models import Access

PREEMPTIVE, COOPERATIVE = "preemptive", "cooperative"
WHOLE_RUNS = ("non_preemptive", "nonpreemptive")


def preemption_of(task: Item) -> str:
    """Return what a task states of its preemption, empty if nothing that is known."""
    stated = task.get("preemption")
    return stated if stated in (PREEMPTIVE, COOPERATIVE, *WHOLE_RUNS) else ""


class Splitter:
    """Finds split points; `longest` is the piece that is left of a runnable that may be preempted anywhere (0: all)."""

    def __init__(self, evaluator: Evaluator, longest: Duration, *, added: bool) -> None:
        self._evaluator = evaluator
        self._longest = longest
        self._added = added
        self.cut: dict[Item, None] = {}
        """The tasks that are cut within runnables."""

    def split(
        self,
        draft: Draft,
        mode: SystemMode,
        unit: Pu,
        phases: Sequence[Phase],
        accesses: Sequence[Access],
        wcet: Duration,
    ) -> Split:
        """Return where jobs of a draft may be interrupted: between its runnables, never inside an access phase.

        A task that is preemptive is also cut inside runnables of more than the longest piece.
        """
        preemption = preemption_of(draft.task)
        if preemption not in (PREEMPTIVE, COOPERATIVE):
            return WHOLE
        longest = self._longest if preemption == PREEMPTIVE else ZERO
        reads = sum((phase.length for phase in phases if phase.kind is AccessKind.READ), ZERO)
        bounds = list(self._bounds(draft, mode, unit, reads if self._added else ZERO))
        if bounds and not self._added:
            begin, end, is_whole = bounds[-1]
            bounds[-1] = (begin, max(wcet, end), is_whole)  # accesses may take longer than what is stated
        points: set[Duration] = set()
        for begin, end, is_whole in bounds:
            points.add(end)
            inner = set(cuts(ZERO if is_whole else longest, begin, end, draft.task.name, draft.task.at))
            if any(_is_allowed(point, wcet, accesses) for point in inner):
                self.cut[draft.task] = None
            points |= inner
        kept = sorted(point for point in points if _is_allowed(point, wcet, accesses))
        return Split(points=tuple(kept)) if kept else WHOLE

    def _bounds(
        self, draft: Draft, mode: SystemMode, unit: Pu, at: Duration
    ) -> Iterator[tuple[Duration, Duration, bool]]:
        """Yield begin and end of every runnable, each with what stands before it outside of runnables.

        Groups that may not be interrupted count as one runnable, and are whole; so is a runnable that contains one.
        """
        assert unit.frequency
        begin, is_whole = at, False
        for step in draft.part.steps:
            at += seconds(self._evaluator.amount([step], mode, unit).cycles / unit.frequency)
            is_whole = is_whole or self._evaluator.is_whole(step)
            if step.kind in CALLS or step.kind in SWITCHES or step.kind in GROUPS or step.kind == "SchedulePoint":
                if at > begin:
                    yield begin, at, is_whole
                begin, is_whole = at, False
        if at > begin:
            yield begin, at, is_whole


def _is_allowed(point: Duration, wcet: Duration, accesses: Sequence[Access]) -> bool:
    return ZERO < point < wcet and not any(access.start < point < access.end for access in accesses)
