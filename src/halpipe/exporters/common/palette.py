"""Colours that stay apart for colour-blind readers, with dark text legible on every fill."""

from __future__ import annotations

# After Paul Tol, "Colour schemes" (SRON/EPS/TN/09-002), the light scheme: made as fills behind dark text.
_BASE = ("#77aadd", "#ee8866", "#44bb99", "#eedd88", "#ffaabb", "#99ddff", "#bbcc33", "#c8b6e2")
INK = "#111111"
# The high-contrast scheme of the same note, for what is drawn on top of those fills.
RESOURCES = ("#004488", "#bb3344", "#665500", "#333333")


def _mix(colour: str, other: str, percent: int) -> str:
    """Return `colour` with `percent` of `other` in it."""
    pairs = ((int(colour[i : i + 2], 16), int(other[i : i + 2], 16)) for i in (1, 3, 5))
    return "#" + "".join(f"{(a * (100 - percent) + b * percent) // 100:02x}" for a, b in pairs)


FILLS = (
    *_BASE,
    *(_mix(colour, "#ffffff", 45) for colour in _BASE),
    *(_mix(colour, "#555555", 30) for colour in _BASE),
)


def tone(position: int) -> int:
    """Return which of `FILLS` the element at `position` has; after the last, they start again."""
    return position % len(FILLS)
