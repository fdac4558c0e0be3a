"""The order in which a schedule is built up: what is linked comes one after the other, the heaviest first.

A task that is placed right after those that it has windows with finds room in the windows. When the tasks in between
are placed first, it finds none, and the search has to move all of them again.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


def construction_order(loads: Sequence[int], links: Sequence[Mapping[int, int]]) -> Iterator[int]:
    """Yield the indices of tasks: components by their whole load, each from its heaviest task along its shortest links.

    `loads[i]` is what task i weighs; `links[i]` maps the tasks that it is linked with to the width of the window, in
    ticks. Within a component the order is that of Prim's algorithm for the least spanning tree.
    """
    weights = _component_loads(loads, links)
    reached: set[int] = set()
    for root in sorted(range(len(loads)), key=lambda task: (-weights[task], -loads[task])):
        nearest = [(0, -loads[root], root)]
        while nearest:
            _, _, task = heappop(nearest)
            if task in reached:
                continue
            reached.add(task)
            yield task
            for other, width in links[task].items():
                if other not in reached:
                    heappush(nearest, (width, -loads[other], other))


def _component_loads(loads: Sequence[int], links: Sequence[Mapping[int, int]]) -> list[int]:
    """Return for each task the load of all tasks that it is linked with, directly or through others, and its own."""
    groups, totals = Groups[int](), dict[int, int]()
    for task, others in enumerate(links):
        for other in others:
            groups.join(task, other)
    roots = list(map(groups.root, range(len(loads))))
    for root, load in zip(roots, loads, strict=True):
        totals[root] = totals.get(root, 0) + load
    return [totals[root] for root in roots]


_Member = TypeVar("_Member")


class Groups(Generic[_Member]):
    """Groups of members, which are joined pair by pair."""

    def __init__(self) -> None:
        self._parent: dict[_Member, _Member] = {}

    def root(self, member: _Member) -> _Member:
        """Return the member that stands for a group."""
        while (parent := self._parent.get(member, member)) != member:
            self._parent[member] = self._parent.get(parent, parent)
            member = parent
        return member

    def join(self, one: _Member, other: _Member) -> bool:
        """Make one group of those of two members; return whether they were two."""
        one, other = self.root(one), self.root(other)
        self._parent[other] = one
        return one != other
