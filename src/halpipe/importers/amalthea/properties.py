"""Custom properties that halpipe's own export adds: exact values, and what AMALTHEA has no element for.

Their keys begin with ``halpipe:``, their values are texts. A property counts as long as it agrees with the standard
elements beside it; where those were edited since, they count.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.durations import Duration
from halpipe.importers.amalthea import codes
from halpipe.models.attributes import attributes

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.importers.amalthea.xmi import Forest, Item

T = TypeVar("T")

PREFIX = "halpipe:"
NONE = "none"
ROLE = "role"
_PICOSECOND = Duration.parse("1ns") / 1000


def text_of(item: Item, key: str) -> str | None:
    """Return the text of a property of halpipe, None when absent."""
    for found in item.all("customProperties"):
        if found.get("key") == PREFIX + key:
            value = found.one("value")
            found.use_all()
            return "" if value is None else value.get("value")
    return None


def value_of(forest: Forest, item: Item, key: str, read: Callable[[str], T]) -> T | None:
    """Return a property as `read` understands it; None when absent, and, reported, when it is unreadable."""
    text = text_of(item, key)
    if text is None:
        return None
    try:
        return read(text)
    except (ValueError, KeyError, TypeError, AttributeError) as failure:
        reason = str(failure) if isinstance(failure, ValueError) else "has the wrong form"
        edited(forest, item, key, f"cannot be read: {reason}")
        return None


def stated_of(forest: Forest, item: Item, kind: type, *without: str) -> dict[str, Any]:
    """Return the attributes of a class that an item has as properties, by field."""
    wanted = (one for one in attributes(kind) if one.name not in without)
    found = {one.field: value_of(forest, item, one.name, one.codec.parse) for one in wanted}
    return {field: value for field, value in found.items() if value is not None}


def structure(text: str) -> Any:
    """Read a property that holds JSON; raise ``ValueError`` if it is none."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nests too deep") from None


def optional_duration(text: str) -> Duration | None:
    """Read a duration or ``none``."""
    return None if text == NONE else Duration.parse(text)


def agrees(exact: Duration | None, standard: Duration | None) -> bool:
    """Return whether a standard value is an exact one, in whole picoseconds."""
    if exact is None or standard is None:
        return exact is standard
    return -_PICOSECOND < exact - standard < _PICOSECOND


def edited(forest: Forest, item: Item, key: str, what: str) -> None:
    """Report a property that does not count."""
    help = "remove the property, or export the model again"
    forest.report(codes.EDITED, f'property "{PREFIX}{key}" {what}', item, help)
