"""Names of model elements: the characters that the task model allows, each name once."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.ros import codes
from halpipe.importers.ros.sources.graph import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Findings, Location
    from halpipe.importers.ros.sources.graph import RosGraph

_FORBIDDEN = re.compile(r"[^A-Za-z0-9_./:~+@$%-]")


def printable(text: str) -> str:
    """Return text from a file on one line and without control characters, fit for messages and for XML."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def clean(name: str) -> str:
    """Replace by ``_`` what a name of the task model may not contain."""
    return _FORBIDDEN.sub("_", name) or "_"


class Names:
    """Hands out clean, unique names and reports each that differs from the source's."""

    def __init__(self, findings: Findings, taken: Iterable[str] = ()) -> None:
        self._findings = findings
        self._taken = set(taken)
        self._next: dict[str, int] = {}

    def unique(self, name: str, path: str, at: Location) -> str:
        """Return `name`, cleaned, with a number behind it if it is taken."""
        wanted = clean(name)
        result = wanted
        while result in self._taken:
            self._next[wanted] = self._next.get(wanted, 1) + 1
            result = f"{wanted}_{self._next[wanted]}"
        self._taken.add(result)
        if result != name:
            help = f'use "{result}" in the overlay'
            self._findings.add(codes.RENAMED(f'is called "{result}" in the model', at=at, path=path, help=help))
        return result


def task_names(graph: RosGraph, names: Names) -> dict[str, str]:
    """Return the task name of every callback: its node's name where it is the node's only one, else its own."""
    count: dict[str, int] = {}
    for callback in graph.callbacks:
        count[callback.node] = count.get(callback.node, 0) + 1
    result = {}
    for callback in sorted(graph.callbacks, key=lambda callback: count[callback.node] > 1):
        path = named("node" if callback.kind is Kind.NODE else "callback", callback.name)
        name = callback.node if count[callback.node] == 1 else callback.name
        result[callback.name] = names.unique(name, path, callback.at)
    return result
