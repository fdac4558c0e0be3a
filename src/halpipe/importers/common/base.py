"""Base of all importers: options, result, and the coverage of every element."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from halpipe.core.diagnostics import NOWHERE, Exit, Findings, HalpipeError, Location, Severity, sort_diagnostics
from halpipe.core.durations import Duration, milliseconds
from halpipe.core.options import Form, option
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.core.diagnostics import Diagnostic, Location
    from halpipe.core.extent import Extent
    from halpipe.importers.overlay import OverlayUse
    from halpipe.models import TaskModel


@record(kw_only=True)
class ImportOptions:
    """Options of every importer; one with further ones has a subclass of this.

    `overlay` answers for the files named in `overlays`; `on_progress` gets the bytes read so far, and all bytes.
    """

    overlays: tuple[str, ...] = option(
        (),
        "YAML file with what the source cannot say; repeatable, later wins.",
        name="overlay",
        metavar="FILE",
        form=Form.LIST,
        is_path=True,
    )
    name: str = option("", "Name of the model; otherwise the source's own.", metavar="NAME")
    strict: bool = option(False, "Every loss is an error (exit code 5).", form=Form.SWITCH)
    overlay: OverlayUse | None = None
    on_progress: Callable[[int, int], None] | None = field(default=None, compare=False)

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others; stating one is refused."""
        return ()


@record(kw_only=True)
class PiecesOptions(ImportOptions):
    """Options of an importer that cuts the runnables of preemptive tasks; `pieces` of 0 cuts none."""

    pieces: Duration = option(
        milliseconds(5),
        "The longest piece of a runnable of a preemptive task; 0ms cuts none.",
        Duration.parse,
        metavar="TIME",
    )


@record
class Ignored:
    """An element of the source that has no effect on the model, and why."""

    kind: str
    name: str
    reason: str
    at: Location = NOWHERE


@record
class Defaulted:
    """A value that the source does not state and that the importer chose."""

    element: str
    what: str
    value: str
    at: Location = NOWHERE


@dataclass(slots=True)
class Coverage:
    """Coverage report of an import: for every kind of element, read = mapped + ignored, always.

    Call exactly one of `mapped` and `ignored` for every element read.
    """

    mapped_counts: Counter[str] = field(default_factory=Counter)
    ignored_elements: list[Ignored] = field(default_factory=list)
    dropped_counts: Counter[str] = field(default_factory=Counter)
    defaulted_values: list[Defaulted] = field(default_factory=list)

    def mapped(self, kind: str, count: int = 1) -> None:
        """Account for `count` elements of `kind` that shaped the model."""
        self.mapped_counts[kind] += count

    def ignored(self, kind: str, name: str, reason: str, at: Location = NOWHERE) -> None:
        """Account for one element of `kind` that did not."""
        self.ignored_elements.append(Ignored(kind, name, reason, at))

    def dropped(self, kind: str, count: int) -> None:
        """Account for elements of a large source that cannot matter, and were not kept: ignored by kind."""
        self.dropped_counts[kind] += count

    def defaulted(self, element: str, what: str, value: str, at: Location = NOWHERE) -> None:
        """Record a value that was assumed."""
        self.defaulted_values.append(Defaulted(element, what, value, at))

    def rows(self) -> list[tuple[str, int, int, int]]:
        """Return (kind, read, mapped, ignored) for every kind met, by name."""
        ignored = Counter(element.kind for element in self.ignored_elements) + self.dropped_counts
        kinds = sorted(set(self.mapped_counts) | set(ignored))
        return [
            (kind, self.mapped_counts[kind] + ignored[kind], self.mapped_counts[kind], ignored[kind]) for kind in kinds
        ]


@record(kw_only=True)
class Imported:
    """The result of an import: the model, the diagnostics, and the coverage of every element.

    `completion` adds what depends on what an overlay states: it takes the model with the overlay on it.
    """

    model: TaskModel
    diagnostics: tuple[Diagnostic, ...]
    coverage: Coverage
    completion: Callable[[TaskModel], tuple[TaskModel, tuple[Diagnostic, ...]]] | None = None

    def completed(self) -> Imported:
        """Return the result with the completion of its model."""
        if self.completion is None:
            return self
        model, found = self.completion(self.model)
        return replace(self, model=model, diagnostics=(*self.diagnostics, *found), completion=None)


def imported(read: Callable[[Findings], Imported], options: ImportOptions) -> Imported:
    """Return what `read` makes of a source; raise every finding if one is an error.

    Under `options.strict` every loss (warning) is one, with the exit code for unsupported input.
    """
    findings = Findings()
    try:
        result = read(findings)
        if options.overlay is None:
            result = result.completed()
            findings.extend(result.diagnostics)
        findings.stop_on_errors()
    except HalpipeError as failure:
        found = sort_diagnostics((*findings.items, *failure.diagnostics))
        raise HalpipeError(*(map(_as_error, found) if options.strict else found), exit=failure.exit) from None
    found = sort_diagnostics(findings.items)
    if options.strict and any(diagnostic.severity is Severity.WARNING for diagnostic in found):
        raise HalpipeError(*map(_as_error, found), exit=Exit.UNSUPPORTED)
    return replace(result, diagnostics=tuple(found))


def _as_error(found: Diagnostic) -> Diagnostic:
    return replace(found, severity=Severity.ERROR) if found.severity is Severity.WARNING else found


class Importer(Protocol):
    """The door through which a source format comes in; registered as entry point ``halpipe.importers``.

    `options` is the type of its options (`halpipe.core.options`).
    """

    name: str
    summary: str
    extent: Extent
    options: type[ImportOptions]

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read `paths` into one model; raise `HalpipeError` when nothing usable is in them."""
        ...


VERSION = 1


def format_account(imported: Imported) -> bytes:
    """Return the coverage report as JSON; the same sources give the same bytes."""
    coverage = imported.coverage
    account = {
        "halpipe-import-report": VERSION,
        "model": imported.model.name,
        "elements": [
            {"kind": kind, "read": read, "mapped": mapped, "ignored": ignored}
            for kind, read, mapped, ignored in coverage.rows()
        ],
        "ignored": [
            {"kind": e.kind, "name": e.name, "reason": e.reason, **_place(e.at)} for e in coverage.ignored_elements
        ],
        "dropped": [{"kind": kind, "count": count} for kind, count in sorted(coverage.dropped_counts.items())],
        "defaults": [
            {"element": d.element, "what": d.what, "value": d.value, **_place(d.at)} for d in coverage.defaulted_values
        ],
    }
    return (json.dumps(account, indent=1, ensure_ascii=True) + "\n").encode()


def _place(at: Location) -> dict[str, Any]:
    return {"file": at.file, "line": at.line}
