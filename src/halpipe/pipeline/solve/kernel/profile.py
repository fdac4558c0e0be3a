"""Capacity profiles of the lanes: sorted minimal step functions over the circle [0, hyperperiod).

A lane owns ``edge`` and ``level`` from ``lane_first[lane]`` on: ``edges[lane]`` breakpoints from 0 on, then a sentinel
at the hyperperiod. Neighbouring levels differ, except at the permanent breakpoint 0. Where to look for a time is told
by ``guide``, which has for each stretch of the circle the last breakpoint at or before its begin (Chen and Asau's guide
table): a binary search, whose branches nothing foretells, took a fifth of the time.
"""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.registry import compiled

NEVER = 1 << 60
"""A cost that nothing reaches."""


@compiled
def wrapped(time, hyperperiod):
    """Return a time before twice the hyperperiod on the circle: division takes longer than all else in a short loop."""
    return time - hyperperiod if time >= hyperperiod else time


def move_within(array, begin, end, steps):
    """Move ``array[begin:end]`` so many places up, or down if negative; compiled code does it in one go."""
    array[begin + steps : end + steps] = array[begin:end].copy()


@compiled
def find(p, s, lane, time):
    """Return the index of the last breakpoint of a lane at or before `time`."""
    index = p.lane_first[lane] + s.guide[p.guide_first[lane] + (time >> p.guide_shift[lane])]
    while s.edge[index + 1] <= time:
        index += 1
    return index


@compiled
def excess(p, s, lane, start, length, height):
    """Return the excess over the capacity that a rectangle would add, in ticks times quanta."""
    threshold = p.lane_capacity[lane] - height  # a level above it overflows when the rectangle comes on top
    end = p.lane_first[lane] + s.edges[lane]
    index = find(p, s, lane, start)
    cost = 0
    while True:
        span = min(s.edge[index + 1] - start, length)
        over = s.level[index] - threshold
        if over > 0:
            cost += span * min(over, height)
        length -= span
        if length == 0:
            return cost
        start = s.edge[index + 1]
        index += 1
        if index == end:
            index = p.lane_first[lane]
            start = 0


@compiled
def overloaded(p, s, lane, start, length):
    """Return whether the level exceeds the capacity at some instant of [start, start + length)."""
    end = p.lane_first[lane] + s.edges[lane]
    index = find(p, s, lane, start)
    while True:
        if s.level[index] > p.lane_capacity[lane]:
            return True
        span = s.edge[index + 1] - start
        if span >= length:
            return False
        length -= span
        start = s.edge[index + 1]
        index += 1
        if index == end:
            index = p.lane_first[lane]
            start = 0


@compiled
def _insert(p, s, lane, index, time):
    """Let a breakpoint at `time` split the step before `index`."""
    end = p.lane_first[lane] + s.edges[lane]
    move_within(s.edge, index, end + 1, 1)
    move_within(s.level, index - 1, end, 1)
    s.edge[index] = time
    _count(p, s, lane, time, 1)


@compiled
def _remove_if_level(p, s, lane, index):
    """Remove the breakpoint at `index` if the level is the same on both sides of it, unless it is that at 0."""
    end = p.lane_first[lane] + s.edges[lane]
    if p.lane_first[lane] < index < end and s.level[index] == s.level[index - 1]:
        _count(p, s, lane, s.edge[index], -1)
        move_within(s.edge, index + 1, end + 1, -1)
        move_within(s.level, index + 1, end, -1)


@compiled
def _count(p, s, lane, time, change):
    """Account for a breakpoint at `time` that comes or goes."""
    s.edges[lane] += change
    first = p.guide_first[lane] - (-time >> p.guide_shift[lane])
    for place in range(first, p.guide_first[lane + 1]):
        s.guide[place] += change


@compiled
def _raise_segment(p, s, lane, begin, end, height):
    """Add `height` on [begin, end), which does not wrap."""
    index = find(p, s, lane, begin)
    if s.edge[index] != begin:
        index += 1
        _insert(p, s, lane, index, begin)
    last = index
    while s.edge[last + 1] <= end:
        s.level[last] += height
        last += 1
        if s.edge[last] == p.hyperperiod:
            break
    if s.edge[last] < end:
        _insert(p, s, lane, last + 1, end)
        s.level[last] += height
        last += 1
    _remove_if_level(p, s, lane, last)
    _remove_if_level(p, s, lane, index)


@compiled
def raise_level(p, s, lane, start, length, height):
    """Add `height` (negative to take away) on [start, start + length) of the circle."""
    end = start + length
    if end <= p.hyperperiod:
        _raise_segment(p, s, lane, start, end, height)
    else:
        _raise_segment(p, s, lane, start, p.hyperperiod, height)
        _raise_segment(p, s, lane, 0, end - p.hyperperiod, height)
