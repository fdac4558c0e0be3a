"""Many models, each with a schedule of its own: what is solved for each, wherever that runs, and what can be kept.

What comes out for a model depends on it and the options alone, so it has the same bytes as a search for that one model.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import fields, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError
from halpipe.core.files import is_shaped, load_json, read_own, refuse_foreign, sha256, write_output
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from halpipe.pipeline.solve.schedule import SearchOptions

LEDGER = "fleet.json"
"""What says in the folder of the schedules which of them belong to which input and options."""

MARK = "halpipe-fleet"
_ROW = {"key": str, "sha256": str, "jobs": int, "moves": int}


class Outcome(StrEnum):
    """Result of one model."""

    VALID = "valid"
    KEPT = "kept"
    INCOMPLETE = "valid, switches missing"
    NOT_FOUND = "not found"
    INFEASIBLE = "infeasible"
    INVALID = "invalid"
    REFUSED = "not begun: large"
    INTERRUPTED = "interrupted"
    FAILED = "internal error"


EXITS = {
    Outcome.FAILED: Exit.INTERNAL,
    Outcome.INTERRUPTED: Exit.INTERRUPTED,
    Outcome.INVALID: Exit.FINDINGS,
    Outcome.REFUSED: Exit.FINDINGS,
    Outcome.INCOMPLETE: Exit.FINDINGS,
    Outcome.INFEASIBLE: Exit.INFEASIBLE,
    Outcome.NOT_FOUND: Exit.NOT_FOUND,
    Outcome.VALID: Exit.OK,
    Outcome.KEPT: Exit.OK,
}
"""The exit code of each outcome; that of a fleet is the code of the first of these that it has."""


@record
class Variant:
    """A model of a fleet: its file, what that holds, and the options of the search as plain data."""

    source: str
    content: bytes
    options: Mapping[str, Any]

    @property
    def target(self) -> str:
        """The name of its schedule's file."""
        return f"{Path(self.source).stem}.xml"

    @property
    def key(self) -> str:
        """Hash of everything that the schedule depends on."""
        return sha256(repr((__version__, sha256(self.content), sorted(self.options.items()))).encode())


@record
class Solved:
    """Result of a variant: the bytes of its schedule, if it has one, and the findings."""

    outcome: Outcome
    content: bytes = b""
    jobs: int = 0
    moves: int = 0
    diagnostics: tuple[Diagnostic, ...] = ()
    remarks: tuple[str, ...] = ()


def plain_options(options: SearchOptions) -> dict[str, Any]:
    """Return the options that decide the outcome, for a process or a machine elsewhere."""
    return {one.name: getattr(options, one.name) for one in fields(options) if one.compare}


def solve(variant: Variant, go_on: Callable[..., bool], is_interrupted: Callable[[], bool]) -> Solved:
    """Read, search, verify and write one variant as bytes; what ends early is `is_interrupted`, or out of time."""
    from halpipe.exporters.native import format_schedule
    from halpipe.importers.native import parse_model
    from halpipe.pipeline.checked import explain_failure, schedule_model
    from halpipe.pipeline.solve.codes import ENDLESS
    from halpipe.pipeline.solve.limits import refuse_endless
    from halpipe.pipeline.solve.schedule import SearchOptions

    try:
        model = parse_model(variant.content, variant.source)
        if variant.options["budget"] is None:
            refuse_endless(model, variant.options["modes"])
        scheduled = schedule_model(model, SearchOptions(**variant.options), go_on)
        if not scheduled.is_complete:
            found = explain_failure(model, scheduled, interrupted=is_interrupted())
            outcome = Outcome.INTERRUPTED if is_interrupted() else Outcome.NOT_FOUND
            return Solved(outcome, moves=scheduled.moves, diagnostics=tuple(found))
        content = format_schedule(scheduled.schedule)
    except HalpipeError as failure:
        outcome = next((known for known, code in EXITS.items() if code is failure.exit), Outcome.INVALID)
        if any(found.code == ENDLESS.id for found in failure.diagnostics):
            outcome = Outcome.REFUSED
        return Solved(outcome, diagnostics=tuple(failure.diagnostics))
    lacks = any(found.is_error for found in scheduled.diagnostics)
    return Solved(
        Outcome.INCOMPLETE if lacks else Outcome.VALID,
        content,
        sum(len(mode.jobs) for mode in scheduled.schedule.modes),
        scheduled.moves,
        scheduled.diagnostics,
        tuple(f"mode {reached.mode}: {reached}" for reached in scheduled.reached),
    )


def near_to(variant: Variant, first: bytes, name: str) -> Variant:
    """Return a variant whose schedule is to share with an earlier one what it can."""
    from halpipe.importers.native import parse_schedule

    return replace(variant, options={**variant.options, "near": parse_schedule(first, name)})


class Ledger:
    """Remembers which files of a folder hold the schedule of which input and options; written after each of them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows: dict[str, dict[str, Any]] = {}
        path = folder / LEDGER
        refuse_foreign(str(path), lambda content: f'"{MARK}"'.encode() in content)
        if path.exists():
            with contextlib.suppress(ValueError):  # what is damaged is solved again
                stated = load_json(read_own(str(path)))
                rows = stated[MARK] if is_shaped(stated, {MARK: dict}) else {}
                self._rows = {name: row for name, row in rows.items() if is_shaped(row, _ROW)}

    def kept(self, variant: Variant) -> Solved | None:
        """Return what was solved before, if its file is still as it was written."""
        row = self._rows.get(variant.target)
        path = self._folder / variant.target
        if row is None or row["key"] != variant.key or not path.is_file():
            return None
        content = read_own(str(path))
        if sha256(content) != row["sha256"]:
            return None
        return Solved(Outcome.KEPT, content, row["jobs"], row["moves"])

    def keep(self, variant: Variant, solved: Solved) -> None:
        """Write a schedule, and then that it is there."""
        write_output(str(self._folder / variant.target), solved.content)
        if solved.outcome is Outcome.VALID:
            digest = sha256(solved.content)
            row = {"key": variant.key, "sha256": digest, "jobs": solved.jobs, "moves": solved.moves}
            self._rows[variant.target] = row
            text = json.dumps({MARK: dict(sorted(self._rows.items()))}, indent=1) + "\n"
            write_output(str(self._folder / LEDGER), text)
