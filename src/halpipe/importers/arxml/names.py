"""Names of model elements from short names and paths, and lists of them in messages."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

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


def listed(names: Sequence[str]) -> str:
    """Return the first few names for a message, and how many more there are."""
    shown = ", ".join(names[:_SHOWN])
    return f"{shown} and {len(names) - _SHOWN} more" if len(names) > _SHOWN else shown
