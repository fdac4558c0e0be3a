"""Origin of the model: its source files, and the coverage of the import where it is given."""

from __future__ import annotations

import json
from collections import Counter
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import read_bytes
from halpipe.core.records import record
from halpipe.exporters.common.codes import NO_IMPORT_REPORT
from halpipe.exporters.report.axis import percent

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Origin, TaskModel

_KINDS = ("units", "resources", "tasks", "versions", "chains", "modes", "transitions")
_MOST_REASONS = 30


@record
class SourceRow:
    """A source file and how many elements of each kind of the model came from it."""

    file: str
    counts: tuple[int, ...]


@record
class Account:
    """What the report says of the import; `elements` and what follows are empty without an import report."""

    kinds: tuple[str, ...]
    sources: tuple[SourceRow, ...]
    elements: tuple[tuple[str, int, int, int], ...] = ()
    share: str = ""
    reasons: tuple[tuple[str, int], ...] = ()
    defaults: tuple[tuple[str, str, int], ...] = ()


def build_account(model: TaskModel, report: str) -> Account | None:
    """Return the account of `model`, with the import report in the file `report`; None if neither says anything."""
    sources = _sources(model)
    kinds = tuple(kind for kind in _KINDS if getattr(model, kind, ()) or kind == "versions")
    if not report:
        return Account(kinds, sources) if any(row.file for row in sources) else None
    document = _read(report)
    elements = tuple((e["kind"], e["read"], e["mapped"], e["ignored"]) for e in document["elements"])
    read, mapped = sum(e[1] for e in elements), sum(e[2] for e in elements)
    reasons = Counter(entry["reason"] for entry in document["ignored"])
    defaults = Counter((entry["what"], entry["value"]) for entry in document["defaults"])
    return Account(
        kinds,
        sources,
        elements,
        f"{mapped} of {read} elements shaped the model" + (f" ({percent(Fraction(mapped, read))})" if read else ""),
        tuple(sorted(reasons.items(), key=lambda entry: (-entry[1], entry[0]))[:_MOST_REASONS]),
        tuple((what, value, count) for (what, value), count in sorted(defaults.items())),
    )


def _sources(model: TaskModel) -> tuple[SourceRow, ...]:
    """Count the elements of the model by the file they came from; elements without an origin come last."""
    counts: dict[str, Counter[str]] = {}
    for kind, origin in _origins(model):
        counts.setdefault(origin.file if origin else "", Counter())[kind] += 1
    kinds = [kind for kind in _KINDS if getattr(model, kind, ()) or kind == "versions"]
    names = sorted(counts, key=lambda name: (not name, name))
    return tuple(SourceRow(name, tuple(counts[name][kind] for kind in kinds)) for name in names)


def _origins(model: TaskModel) -> Iterator[tuple[str, Origin | None]]:
    for kind in _KINDS:
        for element in getattr(model, kind, ()):
            yield kind, element.origin
    for task in model.tasks:
        for version in task.versions:
            # A version without an origin of its own came with its task.
            yield "versions", version.origin or task.origin


def _read(file: str) -> dict[str, Any]:
    """Return the import report in `file`; raise `HalpipeError` if it is none."""
    try:
        document = json.loads(read_bytes(file))
    except (ValueError, RecursionError) as failure:
        raise _no_report(file, f"it is no JSON: {failure}") from None
    shapes: dict[str, dict[str, type]] = {
        "elements": {"kind": str, "read": int, "mapped": int, "ignored": int},
        "ignored": {"reason": str},
        "defaults": {"what": str, "value": str},
    }
    if not isinstance(document, dict) or document.get("halpipe-import-report") != 1:
        raise _no_report(file, 'it does not state "halpipe-import-report": 1')
    for key, shape in shapes.items():
        rows = document.get(key)
        if not isinstance(rows, list) or not all(_has_shape(row, shape) for row in rows):
            raise _no_report(file, f'"{key}" is no list of entries with {", ".join(shape)}')
    return document


def _has_shape(row: object, shape: dict[str, type]) -> bool:
    return isinstance(row, dict) and all(isinstance(row.get(name), kind) for name, kind in shape.items())


def _no_report(file: str, message: str) -> HalpipeError:
    help = "write one with `halpipe import ... --report FILE`"
    return HalpipeError(NO_IMPORT_REPORT(message, at=Location(file), help=help))
