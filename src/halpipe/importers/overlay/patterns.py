"""Names and globs as keys: which entries hold for a name, and in which order.

The order is fixed: the exact name before a glob, a later entry before an earlier one, and ``*`` last.
"""

from __future__ import annotations

import re
from fnmatch import translate
from typing import TYPE_CHECKING, Generic, TypeVar

from halpipe.importers.common.stated import is_glob

if TYPE_CHECKING:
    from collections.abc import Iterable

T = TypeVar("T")

EVERYTHING = "*"
MAX_GLOBS = 1000
"""Globs of one overlay: each is tried on every name."""


class Patterns(Generic[T]):
    """Entries keyed by names and globs; finding those of a name costs one look-up and one match per glob."""

    def __init__(self, entries: Iterable[tuple[str, T]]) -> None:
        self._exact: dict[str, list[tuple[str, T]]] = {}
        self._globs: list[tuple[re.Pattern[str], str, T]] = []
        self._everything: list[tuple[str, T]] = []
        for pattern, entry in reversed(list(entries)):
            if pattern == EVERYTHING:
                self._everything.append((pattern, entry))
            elif is_glob(pattern):
                self._globs.append((re.compile(translate(pattern)), pattern, entry))
            else:
                self._exact.setdefault(pattern, []).append((pattern, entry))

    def of(self, name: str) -> list[tuple[str, T]]:
        """Return (pattern, entry) of everything that matches `name`, the one that wins first."""
        globs = [(pattern, entry) for regex, pattern, entry in self._globs if regex.match(name)]
        return [*self._exact.get(name, ()), *globs, *self._everything]


def expand(pattern: str, names: Iterable[str]) -> list[str]:
    """Return those of `names` that `pattern` matches, in their order."""
    matches = re.compile(translate(pattern)).match
    return [name for name in names if matches(name)]
