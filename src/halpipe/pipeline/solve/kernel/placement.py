"""Jobs on lanes: what a placement costs, entering and removing it, and the nearest shift at which it fits."""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.jit import entry_point
from halpipe.pipeline.solve.kernel.profile import NEVER, excess, find, overloaded, raise_level, wrapped
from halpipe.pipeline.solve.kernel.registry import compiled

SLIDE_STEPS = 24
"""Steps of the profiles that a slide may look at before it gives up."""


@compiled
def option_cost(p, s, option, start, limit):
    """Return the excess that a job would add on all lanes; stop once it reaches `limit`.

    Access phases come before units: resources are fuller and weigh more, so the limit is reached sooner.
    """
    cost = 0
    for index in range(p.rect_first[option + 1] - 1, p.rect_first[option] - 1, -1):
        lane = p.rect[index, 0]
        begin = wrapped(start + p.rect[index, 1], p.hyperperiod)
        cost += excess(p, s, lane, begin, p.rect[index, 2], p.rect[index, 3]) * p.lane_weight[lane]
        if cost >= limit:
            return cost
    return cost


@entry_point
def put(p, s, job):
    """Enter a job's rectangles into the profiles."""
    option = s.option[job]
    for index in range(p.rect_first[option], p.rect_first[option + 1]):
        lane = p.rect[index, 0]
        begin = wrapped(s.start[job] + p.rect[index, 1], p.hyperperiod)
        length = p.rect[index, 2]
        raise_level(p, s, lane, begin, length, p.rect[index, 3])
        number = index - p.rect_first[option]
        place = p.owner_first[lane] + s.owners[lane]
        s.owner_at[job, number] = place
        s.owner[place, 0] = begin
        s.owner[place, 1] = length
        s.owner[place, 2] = job * s.max_rects + number
        s.owners[lane] += 1


@compiled
def take(p, s, job):
    """Remove a job's rectangles from the profiles."""
    option = s.option[job]
    for index in range(p.rect_first[option], p.rect_first[option + 1]):
        lane = p.rect[index, 0]
        begin = wrapped(s.start[job] + p.rect[index, 1], p.hyperperiod)
        raise_level(p, s, lane, begin, p.rect[index, 2], -p.rect[index, 3])
        number = index - p.rect_first[option]
        place = s.owner_at[job, number]
        s.owners[lane] -= 1
        last = p.owner_first[lane] + s.owners[lane]
        for column in range(3):
            s.owner[place, column] = s.owner[last, column]
        moved = s.owner[place, 2]
        s.owner_at[moved // s.max_rects, moved % s.max_rects] = place


@compiled
def enter(p, s, begin, end):
    """Enter jobs into the profiles, one after the other; return the lane cost that they bring."""
    cost = 0
    for job in range(begin, end):
        cost += option_cost(p, s, s.option[job], s.start[job], NEVER)
        put(p, s, job)
    return cost


@compiled
def leave(p, s, begin, end):
    """Remove jobs from the profiles."""
    for job in range(begin, end):
        take(p, s, job)


@compiled
def take_out(p, s, begin, end):
    """Remove jobs from the profiles and note where they were; return the lane cost that goes with them."""
    cost = 0
    for job in range(end - 1, begin - 1, -1):
        take(p, s, job)
        cost += option_cost(p, s, s.option[job], s.start[job], NEVER)
        s.old[job, 0] = s.start[job]
        s.old[job, 1] = s.option[job]
        s.old[job, 2] = s.phase[job]
        s.kept[job, 0] = s.start[job]
        s.kept[job, 1] = s.option[job]
        s.kept[job, 2] = s.phase[job]
    return cost


@compiled
def slide(p, s, option, start, most):
    """Return the least shift of at most `most` ticks at which the job fits on all lanes, or -1."""
    first = p.rect_first[option]
    rects = p.rect_first[option + 1] - first
    shift = 0
    fitting = 0
    number = 0
    steps = SLIDE_STEPS
    while fitting < rects:
        index = first + number
        lane = p.rect[index, 0]
        threshold = p.lane_capacity[lane] - p.rect[index, 3]
        length = p.rect[index, 2]
        base = p.lane_first[lane]
        time = (start + shift + p.rect[index, 1]) % p.hyperperiod
        here = find(p, s, lane, time)
        advance = 0
        free = 0
        while free < length:
            span = s.edge[here + 1] - time
            advance += span
            if s.level[here] > threshold:
                shift += advance
                advance = 0
                free = 0
                fitting = 0
            else:
                free += span
            steps -= 1
            if shift > most or steps < 0:
                return -1
            here += 1
            time = s.edge[here]
            if here == base + s.edges[lane]:
                here = base
                time = 0
        fitting += 1
        number += 1
        if number == rects:
            number = 0
    return shift


@compiled
def lane_conflict(p, s, job):
    """Return whether a job lies on an overloaded instant of some lane."""
    option = s.option[job]
    for index in range(p.rect_first[option], p.rect_first[option + 1]):
        lane = p.rect[index, 0]
        begin = wrapped(s.start[job] + p.rect[index, 1], p.hyperperiod)
        if overloaded(p, s, lane, begin, p.rect[index, 2]):
            return True
    return False
