"""Preemption points of an OsTask: between its runnables, where OsTaskSchedule is FULL."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.names import listed
from halpipe.importers.common.pieces import cuts
from halpipe.models import WHOLE, Split

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.options import ArxmlImportOptions
    from halpipe.importers.arxml.tasks.grouping import Draft

FULL = "FULL"


class Splitter:
    """Finds split points, and remembers which tasks are cut within runnables."""

    def __init__(self, options: ArxmlImportOptions) -> None:
        self._longest = options.pieces
        self._overlay = options.overlay
        self._cut: dict[str, Draft] = {}

    def stated(self, draft: Draft, runnable: Sequence[str]) -> Duration | None:
        """Return the WCET that the overlay states for a runnable within an OsTask, by any of its names; the longest.

        What runs as a runnable of a component and as an entity of its BSW module has two.
        """
        if self._overlay is None or draft.place.kind != "OsTask":
            return None
        found = [self._overlay.work_wcet(name) for name in runnable if name != draft.name]
        return max((time for time in found if time is not None), default=None)

    def split(self, draft: Draft, lengths: Sequence[Duration]) -> Split:
        """Return where jobs of a draft with runnables of some lengths may be interrupted.

        Where the overlay states the WCET of the whole, it says nothing of the runnables, and theirs do not count.
        """
        if draft.os_task is None or draft.os_task.schedule != FULL:
            return WHOLE
        whole = None if self._overlay is None else self._overlay.task_wcet(draft.name, is_known=bool(lengths))
        if whole is not None:
            lengths = [whole]
        points: list[Duration] = []
        end = ZERO
        for length in lengths:
            begin, end = end, end + length
            within = cuts(self._longest, begin, end, draft.name, draft.place.at)
            if within:
                self._cut[draft.name] = draft
            points += [*within, end]
        inner = sorted({point for point in points if ZERO < point < end})
        return Split(points=tuple(inner)) if inner else WHOLE

    def report(self, findings: Findings) -> None:
        """Report the tasks that are cut within runnables."""
        if self._cut:
            message = f"{len(self._cut)} preemptive tasks are cut within runnables: {listed(list(self._cut))}"
            help = "state where they may be interrupted in an overlay, or the longest piece with --pieces"
            first = next(iter(self._cut.values()))
            findings.add(codes.CUT_RUNNABLES(message, at=first.place.at, help=help))
