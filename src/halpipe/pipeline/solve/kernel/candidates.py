"""Where to try a job: in a precedence window, at the edge of a gap or of a step, near its old place, anywhere."""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.placement import slide
from halpipe.pipeline.solve.kernel.registry import compiled
from halpipe.pipeline.solve.kernel.state import draw

GAP_STEPS = 24
"""Steps of a profile that the search for a gap looks at."""

ACCESS_SHARE, ACCESS_SHARE_IN_WINDOWS = 800, 500
"""Draws, of 1024, that aim at a gap for an access phase if the job has any: the tighter places are there. The first is
for tasks alone, the second for tasks coupled with others."""


@compiled
def nudged(p, s, task, start, most):
    """Return `start` or, half of the time, the next one up to `most` later at which a job of the task fits."""
    if most > 0 and draw(s.random, 2) == 0:
        options = p.task_option[task + 1] - p.task_option[task]
        shift = slide(p, s, p.task_option[task] + draw(s.random, options), start, most)
        if shift > 0:
            return (start + shift) % p.hyperperiod
    return start


@compiled
def aim_at_window(p, s, task):
    """Return a start inside some precedence window of the task, or -1 if the partner is not placed."""
    size = p.partner_first[task + 1] - p.partner_first[task]
    index = p.partner_first[task] + draw(s.random, size)
    other = p.partner[index, 0]
    jobs = p.task_job[other + 1] - p.task_job[other]
    if jobs == 0:
        return -1
    job = p.task_job[other] + draw(s.random, jobs)
    if s.start[job] < 0:
        return -1
    room = draw(s.random, p.partner[index, 2] + 1)
    lag = p.partner[index, 1] + room
    if p.partner[index, 3] == 1:
        if p.partner[index, 4] == 1:
            lag += p.option_wcet[s.option[job]]
        return nudged(p, s, task, (s.start[job] + lag) % p.hyperperiod, p.partner[index, 2] - room)
    if p.partner[index, 4] == 1:
        lag += p.option_wcet[p.task_option[task]]
    return nudged(p, s, task, (s.start[job] - lag) % p.hyperperiod, room)


@compiled
def aim_at_gap(p, s, task, steps, align_left):
    """Return a start that puts a rectangle of the task at an edge of a gap, or of any step, of its lane."""
    options = p.task_option[task + 1] - p.task_option[task]
    option = p.task_option[task] + draw(s.random, options)
    rects = p.rect_first[option + 1] - p.rect_first[option]
    if rects == 0:
        return draw(s.random, p.hyperperiod)
    index = p.rect_first[option] + draw(s.random, rects)
    share = ACCESS_SHARE_IN_WINDOWS if p.task_coupled[task] == 1 else ACCESS_SHARE
    if rects > 1 and draw(s.random, 1024) < share:
        index = p.rect_first[option] + 1 + draw(s.random, rects - 1)  # the first is of units
    lane = p.rect[index, 0]
    length = p.rect[index, 2]
    threshold = p.lane_capacity[lane] - p.rect[index, 3]
    base = p.lane_first[lane]
    end = base + s.edges[lane]
    origin = base + draw(s.random, s.edges[lane])
    here = origin
    while steps > 0:
        while s.level[here] > threshold and steps > 0:
            here += 1
            steps -= 1
            if here == end:
                here = base
        begin = s.edge[here]
        free = 0
        while s.level[here] <= threshold and steps > 0:
            free += s.edge[here + 1] - s.edge[here]
            here += 1
            steps -= 1
            if here == end:
                here = base
        if free >= length:
            start = begin if align_left else begin + free - length
            return (start - p.rect[index, 1]) % p.hyperperiod
    start = s.edge[origin] if s.level[origin] <= threshold else s.edge[origin] - length
    return (start - p.rect[index, 1]) % p.hyperperiod


@compiled
def candidate_start(p, s, task, job, fresh):
    """Return a start to try for `job`; the mix of ways is that of the kernel's design."""
    way = draw(s.random, 128)
    if way < 32 and p.partner_first[task + 1] > p.partner_first[task]:
        start = aim_at_window(p, s, task)
        if start >= 0:
            return start
    if way < 92:
        return aim_at_gap(p, s, task, GAP_STEPS, way & 1 == 1)
    if way < 116:
        return aim_at_gap(p, s, task, 0, False)
    if way < 122 and not fresh:
        near = max(1, p.task_period[task] >> 6)
        return (s.old[job, 0] - near + draw(s.random, 2 * near + 1)) % p.hyperperiod
    return draw(s.random, p.hyperperiod)
