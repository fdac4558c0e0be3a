"""Names of model elements from short names and paths, and lists of them in messages."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

T = TypeVar("T")

_ILLEGAL = re.compile(r"[^A-Za-z0-9_./:~+@$%-]")
_MAX_LENGTH = 900
_SHOWN = 5


def legal_name(text: str) -> str:
    """Replace what a name of a model element must not contain by ``_``, and bound its length."""
    return _ILLEGAL.sub("_", text)[:_MAX_LENGTH] or "_"


def unique_name(name: str, taken: set[str]) -> str:
    """Return `name`, or `name` with the first free number after ``~``, and take it."""
    chosen, number = name, 2
    while chosen in taken:
        chosen, number = f"{name}~{number}", number + 1
    taken.add(chosen)
    return chosen


def listed(items: Sequence[T], name_of: Callable[[T], str] = str) -> str:
    """Return the names of the first few items for a message, and how many more there are."""
    shown = ", ".join(map(name_of, items[:_SHOWN]))
    return f"{shown} and {len(items) - _SHOWN} more" if len(items) > _SHOWN else shown
