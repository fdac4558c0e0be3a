"""Modes and other elements by their names, as options state them, and tours along the switches between modes."""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Mode, ModeSchedule, TransitionTable

UNKNOWN_MODE = error(
    "HAL0802",
    "Mode does not exist",
    "The mode named in the options is not one that the model (or the schedule) has.",
)
UNKNOWN_ELEMENT = error(
    "HAL1411",
    "Option names an element that the model lacks",
    "A task, unit type or resource in the options is none of the model: the answer would be about nothing.",
)


def require_names(names: Iterable[str], known: Iterable[str], kind: str) -> None:
    """Raise `HalpipeError` with each of the `names` that is not known as the name of an element of a `kind`."""
    known = list(known)
    there_are = f"the model has: {', '.join(known) or 'none'}"
    unknown = [name for name in names if name not in known]
    if unknown:
        text = 'the model has no {} "{}"'.format
        findings = (UNKNOWN_ELEMENT(text(kind, n), help=did_you_mean(n, known, there_are)) for n in unknown)
        raise HalpipeError(*findings, exit=Exit.USAGE)


def require_mode(name: str, modes: Iterable[Mode | ModeSchedule]) -> None:
    """Raise `HalpipeError` unless `name` is that of one of the modes of a model or schedule."""
    known = [mode.name for mode in modes]
    if name not in known:
        help = did_you_mean(name, known, "the modes are " + ", ".join(known))
        raise HalpipeError(UNKNOWN_MODE(f'there is no mode "{name}"', help=help), exit=Exit.USAGE)


def tour(first: str, tables: Sequence[TransitionTable], untaken: dict[tuple[str, str], None]) -> Iterator[str]:
    """Yield the modes that follow `first` on a way along every switch of `untaken` that can be reached.

    Each time the nearest such switch comes next, of equally near ones the first of `tables`; it is taken out.
    """
    targets: dict[str, list[str]] = defaultdict(list)
    for table in tables:
        targets[table.source].append(table.target)
    while steps := _nearest(first, targets, untaken):
        for step in steps:
            untaken.pop((first, step), None)
            yield (first := step)


def _nearest(here: str, targets: Mapping[str, list[str]], untaken: Collection[tuple[str, str]]) -> list[str]:
    """Return the shortest way from a mode that ends with a switch not yet taken; empty if there is none."""
    waiting, seen = deque([[here]]), {here}
    while waiting:
        way = waiting.popleft()
        following = targets.get(way[-1], [])
        if (end := next((target for target in following if (way[-1], target) in untaken), None)) is not None:
            return [*way[1:], end]
        waiting.extend([*way, target] for target in following if target not in seen)
        seen.update(following)
    return []
