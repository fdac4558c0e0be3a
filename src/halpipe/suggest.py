"""Near names for messages: what the user probably meant."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def nearest(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return up to `count` known names that resemble `name`, best first."""
    import difflib  # only those who have mistyped something wait for it

    return difflib.get_close_matches(name, list(known), n=count, cutoff=0.5)


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return ``did you mean "x" or "y"?``, or `otherwise` when nothing is near."""
    near = nearest(name, known)
    if not near:
        return otherwise
    return "did you mean " + " or ".join(f'"{n}"' for n in near) + "?"
