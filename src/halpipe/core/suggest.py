"""Names in messages: the nearest known one, and the first few of many."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

COMPARISONS = 50_000
"""Names that one command compares, about a second's worth; findings after that do without a suggestion."""

LONGEST = 200
"""Characters of a name up to which one is sought that resembles it."""

SHORT = 5
"""Characters of a name up to which half of them suffice: one typing error spoils much of a short name."""

_WORDS = {
    "schedule": "solve plan optimise optimize synthesise synthesize",
    "run": "build make pipeline",
    "validate": "check lint test",
    "verify": "check prove",
    "serve": "gui ui web open edit workbench",
    "show": "plot draw view print display list",
    "new": "init create start example",
    "import": "convert read load",
    "export": "convert write report",
    "report": "html pdf",
    "trace": "perfetto chrome",
    "arxml": "autosar",
    "amalthea": "app4mc",
    "table": "csv excel xls xlsx ods spreadsheet",
    "xlsx": "csv excel xls ods table spreadsheet",
    "graph": "dot svg",
    "--workers": "jobs j threads processes parallel",
    "--time-limit": "timeout limit",
    "--output": "out file",
    "--verbose": "debug",
    "wcet": "cost budget execution-time duration runtime",
    "units": "core cores cpu cpus processor",
    "period": "cycle interval rate frequency",
    "output": "file path",
}
"""Words that other tools and the field use, by ours: no spelling leads from one to the other."""


_MOST_NAMES = 5


def few(items: Iterable[object], most: int = _MOST_NAMES, *, quote: str = '"', between: str = ", ") -> str:
    """List names in quotes for a message: the first ones, and how many more there are."""
    found = list(items)
    more = f"{between.strip(', ')} and {len(found) - most} more" if len(found) > most else ""
    return between.join(f"{quote}{item}{quote}" for item in found[:most]) + more


class _Budget:
    """Rest of the comparisons of the current command; None where they are not counted."""

    left: int | None = None


@contextmanager
def bounded_suggestions() -> Iterator[None]:
    """Bound what is spent on suggestions until the end of the block, however many names are unknown in it."""
    before, _Budget.left = _Budget.left, COMPARISONS
    try:
        yield
    finally:
        _Budget.left = before


def nearest(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return up to `count` known names that resemble `name`, best first."""
    if len(name) > LONGEST or _Budget.left == 0:
        return []
    candidates = list(known)
    if not candidates:
        return []
    meant = [word for word in candidates if name.lower().lstrip("-") in _WORDS.get(word, "").split()]
    if meant:
        return meant[:count]
    import difflib  # only those who have mistyped something wait for it

    if _Budget.left is not None:
        _Budget.left = max(0, _Budget.left - len(candidates))
    by_small: dict[str, str] = {}
    for candidate in candidates:
        by_small.setdefault(candidate.lower().lstrip("-"), candidate)
    small = name.lower().lstrip("-")  # two options are not near by their dashes
    alike = [each for each in (small, small.replace("_", "-")) if each in by_small]
    cutoff = 0.5 if len(small) <= SHORT else 0.6  # common to both, as difflib reckons it
    return [by_small[each] for each in alike[:1] or difflib.get_close_matches(small, by_small, n=count, cutoff=cutoff)]


def counted(number: int, noun: str) -> str:
    """Return ``1 mode`` or ``2 modes``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return ``did you mean "x" or "y"?``, or `otherwise` when nothing is near."""
    return one_of(nearest(name, known), otherwise)


def one_of(near: Iterable[str], otherwise: str = "") -> str:
    """Return the question whether one of the names is meant, or `otherwise` where there is none."""
    return f"did you mean {names}?" if (names := " or ".join(f'"{name}"' for name in near)) else otherwise
