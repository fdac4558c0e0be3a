"""The order in which a schedule is built up: what is linked comes one after the other, the heaviest first.

A task that is placed right after those that it has windows with finds room in the windows. When the tasks in between
are placed first, it finds none, and the search has to move all of them again.
"""

from __future__ import annotations

from heapq import heappop, heappush
from typing import TYPE_CHECKING

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
    weights = [-1] * len(loads)
    for root in range(len(loads)):
        if weights[root] >= 0:
            continue
        component = {root}
        open_tasks = [root]
        while open_tasks:
            fresh = links[open_tasks.pop()].keys() - component
            component |= fresh
            open_tasks += fresh
        whole = sum(loads[task] for task in component)
        for task in component:
            weights[task] = whole
    return weights
