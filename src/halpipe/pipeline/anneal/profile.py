"""Capacity profiles of the lanes: sorted minimal step functions over the circle [0, hyperperiod).

Lane `lane` owns ``edge[first[lane]:]`` and ``level[first[lane]:]``: `count[lane]` breakpoints from 0 on, then a
sentinel at the hyperperiod. Neighbouring levels differ, except at the permanent breakpoint 0.
"""

from __future__ import annotations

from halpipe.pipeline.anneal.registry import compiled

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
def find(edge, base, count, time):
    """Return the index of the last breakpoint at or before `time`."""
    low = 0
    high = count
    while high - low > 1:
        middle = (low + high) >> 1
        if edge[base + middle] <= time:
            low = middle
        else:
            high = middle
    return base + low


@compiled
def excess(edge, level, base, count, threshold, height, start, length):
    """Return the excess over capacity that a rectangle would add, in ticks times quanta.

    `threshold` is the capacity less `height`: a level above it overflows when the rectangle comes on top.
    """
    index = find(edge, base, count, start)
    cost = 0
    while True:
        span = min(edge[index + 1] - start, length)
        over = level[index] - threshold
        if over > 0:
            cost += span * min(over, height)
        length -= span
        if length == 0:
            return cost
        start = edge[index + 1]
        index += 1
        if index == base + count:
            index = base
            start = 0


@compiled
def overloaded(edge, level, base, count, capacity, start, length):
    """Return whether the level exceeds the capacity at some instant of [start, start + length)."""
    index = find(edge, base, count, start)
    while True:
        if level[index] > capacity:
            return True
        span = edge[index + 1] - start
        if span >= length:
            return False
        length -= span
        start = edge[index + 1]
        index += 1
        if index == base + count:
            index = base
            start = 0


@compiled
def _raise_segment(edge, level, base, count, begin, end, height):
    """Add `height` on [begin, end), which does not wrap; return the new number of breakpoints."""
    index = find(edge, base, count, begin)
    if edge[index] != begin:
        index += 1
        move_within(edge, index, base + count + 1, 1)
        move_within(level, index, base + count, 1)
        edge[index] = begin
        level[index] = level[index - 1]
        count += 1
    last = index
    while last < base + count and edge[last + 1] <= end:
        level[last] += height
        last += 1
    if last < base + count and edge[last] < end:
        move_within(edge, last + 1, base + count + 1, 1)
        move_within(level, last, base + count, 1)
        edge[last + 1] = end
        level[last] += height
        count += 1
        last += 1
    if base < last < base + count and level[last] == level[last - 1]:
        move_within(edge, last + 1, base + count + 1, -1)
        move_within(level, last + 1, base + count, -1)
        count -= 1
    if base < index < base + count and level[index] == level[index - 1]:
        move_within(edge, index + 1, base + count + 1, -1)
        move_within(level, index + 1, base + count, -1)
        count -= 1
    return count


@compiled
def raise_level(edge, level, base, count, hyperperiod, start, length, height):
    """Add `height` (negative to take away) on [start, start + length) of the circle; return the new count."""
    if start + length <= hyperperiod:
        return _raise_segment(edge, level, base, count, start, start + length, height)
    count = _raise_segment(edge, level, base, count, start, hyperperiod, height)
    return _raise_segment(edge, level, base, count, 0, start + length - hyperperiod, height)
