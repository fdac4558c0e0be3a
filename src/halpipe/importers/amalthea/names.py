"""Names of model elements from names of AMALTHEA, and lists of them in messages."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.amalthea import codes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings, Location

_FORBIDDEN = re.compile(r"[^A-Za-z0-9_./:~+@$%-]")
_MAX_LENGTH = 1000  # as in the schema of task models
_SHOWN = 5


def legal(name: str) -> str:
    """Replace by ``_`` what a name of the task model may not contain, and bound its length."""
    return _FORBIDDEN.sub("_", name)[:_MAX_LENGTH] or "_"


class Names:
    """Hands out legal names, unique among those of one kind, and reports each that differs from the source's."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}

    def reserve(self, name: str) -> None:
        """Take a name that something of another kind has."""
        self._taken.add(name)

    def unique(self, name: str, kind: str, at: Location) -> str:
        """Return `name`, made legal, with a number behind it if it is taken."""
        wanted = legal(name)
        result = wanted
        while result in self._taken:
            self._next[wanted] = self._next.get(wanted, 1) + 1
            ending = f"~{self._next[wanted]}"
            result = wanted[: _MAX_LENGTH - len(ending)] + ending
        self._taken.add(result)
        if result != name:
            help = f'use "{result}" in the overlay'
            self._findings.add(
                codes.RENAMED(f'is called "{result}" in the model', at=at, path=named(kind, name), help=help)
            )
        return result


def few(names: Sequence[str]) -> str:
    """Return the first few names for a message, and how many more there are."""
    shown = ", ".join(names[:_SHOWN])
    return f"{shown} and {len(names) - _SHOWN} more" if len(names) > _SHOWN else shown
