"""Coverage report of an import as a file: every kind of element with its counts, every loss and every default."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Location
    from halpipe.importers.common.base import Imported

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
