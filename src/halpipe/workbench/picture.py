"""Content of the workbench page: a session as plain values."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError
from halpipe.exporters.report.chains import latency_of
from halpipe.exporters.report.scene import scene
from halpipe.flow.formats import EXPORTERS, formats
from halpipe.workbench.edits import LIMITS, ROWS
from halpipe.workbench.session import RESTORED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Schedule, TaskModel
    from halpipe.workbench.session import Session

Plain = dict[str, Any]
MOST = 50
"""Deviations that the page lists; the chart marks all of them."""


def picture(session: Session) -> Plain:
    """Return everything that the page shows."""
    state, seconds = session.shown, session.answered.seconds
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
        "solved": state.solved,
        "what": state.what,
        "restored": state.what == RESTORED,
        "can_undo": bool(session.past),
        "can_redo": bool(session.future),
        "changed_on_disk": session.changed_on_disk(),
        "unkept": session.journal.fault,
        "answered": {
            "stayed": session.answered.stayed,
            "jobs": session.answered.jobs,
            "milliseconds": None if seconds is None else round(seconds * 1000),
        },
        "findings": [plain(found) for found in findings],
        "beside": beside and {"kind": session.lower[0], "name": beside.name, "found": beside.found[:MOST]},
        "variants": list(session.variants),
        "forms": [
            *_chains(state.model, state.schedule if state.is_valid else None),
            *_windows(state.model),
            *_modes(state.model),
        ],
        "formats": formats(EXPORTERS),
        "pins": [[pin.mode, pin.task, pin.index] for pin in state.pins],
        **scene(state.model, state.schedule, is_valid=state.is_valid, drawn=session.drawn, beside=beside),
    }


def _form(table: str, edit: Plain, *cells: str | Plain) -> Plain:
    """Return a row of a table: whom its edits concern, and its cells, which are texts or fields."""
    return {"table": table, "edit": edit, "cells": [{"text": c} if isinstance(c, str) else c for c in cells]}


def _field(name: str, value: object, *, wide: bool = False) -> Plain:
    return {"field": name, "value": "" if value is None else str(value), "wide": wide}


def _chains(model: TaskModel, schedule: Schedule | None) -> Iterator[Plain]:
    for chain in model.chains:
        found = {
            mode.name: (latency_of(model, chain, mode, row), row.reaction, row.age)
            for mode in (schedule.modes if schedule else ())
            for row in mode.chains
            if row.name == chain.name
        }
        cells: list[str | Plain] = [chain.name, _field("tasks", " ".join(chain.tasks), wide=True)]
        for place, limit in enumerate(LIMITS):
            texts = {mode: str(row[place]) for mode, row in found.items() if row[place] is not None}
            cells += [_field(limit, getattr(chain, limit)), {"by_mode": texts}]
        yield _form("chains", {"kind": "chain", "name": chain.name}, *cells)


def _windows(model: TaskModel) -> Iterator[Plain]:
    """Return windows and accesses that can be edited: those that version and predecessor or resource identify."""
    for task in model.tasks:
        for version in task.versions:
            names = (task.name, version.name)
            edit = {"name": task.name, "inner": version.name}
            for kind, (fields, rows, key, _) in ROWS.items():
                count = Counter(getattr(row, key) for row in getattr(version, rows))
                for row in (row for row in getattr(version, rows) if count[getattr(row, key)] == 1):
                    after = getattr(row, key)
                    words = row.words if kind == "window" else f"access to {after}: from, to, share"
                    cells = [_field(name, getattr(row, name)) for name in fields]
                    yield _form("windows", edit | {"kind": kind, "after": after}, *names, words, *cells)


def _modes(model: TaskModel) -> Iterator[Plain]:
    for mode in model.modes:
        tasks = _field("tasks", " ".join(run.task for run in mode.runs), wide=True)
        yield _form("modes", {"kind": "mode", "name": mode.name}, mode.name, tasks)


def plain(found: Diagnostic) -> Plain:
    """Return a diagnostic as values."""
    return {
        "code": found.code,
        "severity": str(found.severity),
        "message": found.message,
        "path": found.path,
        "help": found.help,
    }
