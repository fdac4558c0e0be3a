"""Custom properties that halpipe's own export adds; their keys begin with ``halpipe:``, their values are texts."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from halpipe.importers.amalthea.xmi import Item

PREFIX = "halpipe:"
ROLE = "role"
"""Tells whether a mode label selects the mode of the system or the version of a task."""


def text_of(item: Item, key: str) -> str | None:
    """Return the text of a property of halpipe, None when absent."""
    for found in item.all("customProperties"):
        if found.get("key") == PREFIX + key:
            value = found.one("value")
            found.use_all()
            return "" if value is None else value.get("value")
    return None
