"""Content of the workbench page: a session as plain values."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.report.scene import scene
from halpipe.flow.formats import EXPORTERS, formats

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.workbench.session import Session

Plain = dict[str, Any]
MOST = 50
"""Deviations that the page lists; the chart marks all of them."""


def picture(session: Session) -> Plain:
    """Return everything that the page shows."""
    state, seconds = session.state, session.answered.seconds
    findings = list(state.findings)
    try:
        beside = session.beside()
    except HalpipeError as unlike:  # after an edit
        beside = None
        findings += unlike.diagnostics
    return {
        "revision": session.revision,
        "path": session.path,
        "busy": session.lock.locked(),
        "valid": state.is_valid,
        "what": state.what,
        "can_undo": session.can_undo,
        "can_redo": session.can_redo,
        "changed_on_disk": session.changed_on_disk(),
        "unkept": session.journal.fault,
        "answered": {
            "stayed": session.answered.stayed,
            "jobs": session.answered.jobs,
            "milliseconds": None if seconds is None else round(seconds * 1000),
        },
        "findings": [plain(found) for found in findings],
        "beside": None
        if beside is None
        else {"kind": session.lower[0], "name": beside.name, "found": beside.found[:MOST]},
        "variants": list(session.variants),
        "runs": [{"name": mode.name, "tasks": " ".join(run.task for run in mode.runs)} for mode in state.model.modes],
        "windows": _windows(state.model),
        "formats": formats(EXPORTERS),
        "pins": [[pin.mode, pin.task, pin.index] for pin in state.pins],
        **scene(state.model, state.schedule, is_valid=state.is_valid, drawn=session.drawn, beside=beside),
    }


def _windows(model: TaskModel) -> list[Plain]:
    """Return windows and accesses that can be edited: those that version and predecessor or resource identify."""
    found = []
    for task in model.tasks:
        for version in task.versions:
            name = {"name": task.name, "inner": version.name}
            count = Counter(window.task for window in version.precedences)
            for window in (w for w in version.precedences if count[w.task] == 1):
                limits = [["min", str(window.min)], ["max", str(window.max)]]
                found.append(name | {"kind": "window", "after": window.task, "words": window.words, "limits": limits})
            count = Counter(access.resource for access in version.accesses)
            for access in (a for a in version.accesses if count[a.resource] == 1):
                limits = [["start", str(access.start)], ["end", str(access.end)], ["bound", str(access.bound)]]
                words = f"access to {access.resource}: from, to, share"
                found.append(name | {"kind": "access", "after": access.resource, "words": words, "limits": limits})
    return found


def plain(found: Diagnostic) -> Plain:
    """Return a diagnostic as values."""
    return {
        "code": found.code,
        "severity": str(found.severity),
        "message": found.message,
        "path": found.path,
        "help": found.help,
    }
