"""Other starters of the scheduled OsTasks: each is disabled in the project's files, or the export refuses.

An alarm or a table is stopped by taking away what starts it. A table that does more loses the actions that are doubled.
One that only code starts cannot be stopped in a configuration.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.records import record
from halpipe.exporters.arxml.onto.codes import DOUBLE_START, STARTS_ONCE
from halpipe.exporters.arxml.onto.edit import Edit

if TYPE_CHECKING:
    from collections.abc import Collection

    from halpipe.core.diagnostics import Findings
    from halpipe.models.project import Deed, Project, Starter


@record
class Stopped:
    """The edits by which alarms and tables no longer start what a schedule plays, and those that are stopped whole."""

    edits: tuple[Edit, ...]
    starters: tuple[Starter, ...]


def stop_others(project: Project, played: Collection[str], findings: Findings) -> Stopped:
    """Return how to stop what starts the OsTasks `played` (paths); report what cannot be stopped."""
    return _Stopper(project, played, findings).run()


class _Stopper:
    def __init__(self, project: Project, played: Collection[str], findings: Findings) -> None:
        self._project = project
        self._played = played
        self._findings = findings
        self._removed: list[str] = []
        self._stopped: list[Starter] = []

    def run(self) -> Stopped:
        for starter in self._project.starters:
            doubled = [deed for deed in starter.deeds if deed.os_task in self._played]
            if doubled and len(doubled) == len(starter.deeds):
                self._stop(starter)
            elif doubled and starter.is_table:
                self._cut(starter, doubled)
            elif doubled and (starter.autostart or starter.calls):
                self._refuse(starter, "concerns other OsTasks, too", "stop it by hand for those of the schedule")
        for path in sorted(self._played):
            task = self._project.tasks[path]
            if task.autostart and not task.is_extended:
                at = self._project.items[task.autostart].at
                message = "is activated once when the OS starts, before its jobs of the schedule"
                self._findings.add(STARTS_ONCE(message, at=at, path=named("OsTask", path), help="nothing, if meant so"))
        edits = (Edit(self._project.items[path].at.file, path) for path in self._removed)
        return Stopped(tuple(edits), tuple(self._stopped))

    def _stop(self, starter: Starter) -> None:
        """Take away what starts an alarm or table that only does what the schedule plays."""
        begins = [starter.autostart] if starter.autostart else []
        if begins or starter.calls:
            self._removed += [*begins, *starter.calls]
            self._stopped.append(starter)
        elif starter.is_table:
            self._refuse(
                starter,
                "is started by code, not by the OS or by the Rte configuration",
                "remove the table, and the code that starts it, from the project",
            )

    def _cut(self, starter: Starter, doubled: list[Deed]) -> None:
        """Take actions from a table; an expiry point goes with its last one."""
        rest = [deed for deed in starter.deeds if deed not in doubled]
        kept, shared = {deed.point for deed in rest}, {deed.path for deed in rest}
        if any(deed.path in shared for deed in doubled):
            self._refuse(starter, "sets an event for other OsTasks, too", "give each OsTask an event of its own")
            return
        self._removed += dict.fromkeys(deed.path if deed.point in kept else deed.point for deed in doubled)

    def _refuse(self, starter: Starter, why: str, remedy: str) -> None:
        kind = "OsScheduleTable" if starter.is_table else "OsAlarm"
        tasks = sorted({deed.os_task for deed in starter.deeds if deed.os_task in self._played})
        self._findings.add(
            DOUBLE_START(
                f"starts {', '.join(tasks)} beside the schedule, and {why}",
                at=self._project.items[starter.path].at,
                path=named(kind, starter.path),
                help=remedy,
            )
        )
