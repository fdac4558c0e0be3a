"""One sweep over time for both rules that share something: a unit among jobs, a resource among phases."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.pipeline.verify.tables import Placed

    Claim: TypeAlias = tuple[int, int, int, Placed]
    """Start and end (half-open, start < end), weight, and whose it is."""

NAMED = 12
"""How many jobs a message names before it counts the rest."""


@dataclass(slots=True)
class Excess:
    """A maximal interval [start, end) in which the weights in force sum to more than the limit.

    `members` are the jobs to name, `parts` the parts of the line of all jobs that take part.
    """

    start: int
    end: int
    peak: int
    members: dict[int, Placed] = field(default_factory=dict)
    parts: set[str] = field(default_factory=set)

    def add(self, claims: Iterable[Claim]) -> None:
        """Note who has a part in it; one job beyond those named is enough to know that there are more."""
        for claim in claims:
            if len(self.members) > NAMED:
                break
            self.members[id(claim[3])] = claim[3]

    def names(self) -> str:
        """List the jobs that take part."""
        found = sorted(self.members.values(), key=lambda p: (p.job.task, p.job.index, p.where))
        more = [] if len(found) <= NAMED else ["others"]
        labels = [p.label for p in found[:NAMED]] + more
        return " and ".join([", ".join(labels[:-1]), labels[-1]] if len(labels) > 1 else labels)


def wrap(claims: Iterable[Claim], period: int) -> Iterator[Claim]:
    """Lay claims round a circle of `period`, cut at 0; what is longer than the circle weighs on itself."""
    for start, end, weight, owner in claims:
        turns, rest = divmod(end - start, period)
        start %= period
        if turns:
            yield 0, period, weight * turns, owner
        if not rest:
            continue
        if start + rest <= period:
            yield start, start + rest, weight, owner
        else:
            yield start, period, weight, owner
            yield 0, start + rest - period, weight, owner


def excesses(claims: Iterable[Claim], limit: int) -> list[Excess]:
    """Return every maximal interval of the line in which more than `limit` is claimed, in order of time."""
    found: list[Excess] = []
    current: Excess | None = None
    active: dict[int, Claim] = {}
    parts: Counter[str] = Counter()
    total = 0
    for instant, ending, starting in _events(claims):
        for key, claim in ending:
            total -= claim[2]
            parts[claim[3].where] -= 1
            del active[key]
        for key, claim in starting:
            total += claim[2]
            parts[claim[3].where] += 1
            active[key] = claim
        if total <= limit:
            if current is not None:
                current.end = instant
                found.append(current)
            current = None
        elif current is None:
            current = Excess(instant, instant, total)
            current.add(active.values())
            current.parts.update(+parts)
        else:
            current.peak = max(current.peak, total)
            current.add(claim for _, claim in starting)
            current.parts.update(claim[3].where for _, claim in starting)
    return found


Keyed: TypeAlias = "tuple[int, Claim]"


def _events(claims: Iterable[Claim]) -> Iterator[tuple[int, list[Keyed], list[Keyed]]]:
    """Yield every instant at which something changes, with the claims that end there and those that start there."""
    changes: dict[int, tuple[list[Keyed], list[Keyed]]] = {}
    for keyed in enumerate(claims):
        start, end = keyed[1][:2]
        changes.setdefault(start, ([], []))[1].append(keyed)
        changes.setdefault(end, ([], []))[0].append(keyed)
    for instant in sorted(changes):
        yield instant, *changes[instant]


def excesses_on_circle(claims: Iterable[Claim], limit: int, period: int) -> list[Excess]:
    """Return the same on a circle; an interval that passes the end of the circle is one, with end > period."""
    found = excesses(wrap(claims, period), limit)
    if len(found) > 1 and found[0].start == 0 and found[-1].end == period:
        first, last = found[0], found.pop()
        found[0] = Excess(last.start, period + first.end, max(first.peak, last.peak), last.members)
        found[0].members.update(first.members)
    return found
