"""Names of model elements, made out of the names of a source."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Findings, Location, named

if TYPE_CHECKING:
    from collections.abc import Iterable


_ILLEGAL = re.compile(r"[^A-Za-z0-9_./:~+@$%-]")
_MAX_LENGTH = 1000  # as in the schema of task models


def legal(name: str) -> str:
    """Replace by ``_`` what a name of the task model may not contain, and bound its length."""
    return _ILLEGAL.sub("_", name)[:_MAX_LENGTH] or "_"


def unique_name(name: str, taken: dict[str, int], mark: str = "~") -> str:
    """Return `name`, or `name` with the first free number after a mark; `taken` has the last number of each."""
    chosen = name
    while chosen in taken:
        taken[name] += 1
        ending = f"{mark}{taken[name]}"
        chosen = name[: _MAX_LENGTH - len(ending)] + ending
    taken[chosen] = 1
    return chosen


class Names:
    """Hands out legal, unique names and reports each that differs from the source's, with the code `renamed`."""

    def __init__(self, findings: Findings, renamed: Code, taken: Iterable[str] = (), *, mark: str = "~") -> None:
        self._findings = findings
        self._renamed = renamed
        self._taken = dict.fromkeys(taken, 1)
        self._mark = mark

    def unique(self, name: str, kind: str, at: Location, *, of: str = "") -> str:
        """Return `name` (the one `of` an element, if another), made legal, with a mark and a number if it is taken."""
        result = unique_name(legal(name), self._taken, self._mark)
        if result != name:
            help = f'use "{result}" in the overlay'
            message = f'is called "{result}" in the model'
            self._findings.report(self._renamed, message, at=at, path=named(kind, of or name), help=help)
        return result
