"""Moves of tightly linked tasks together: shifted by the same time, they keep the windows between them.

Of two tasks whose window is short, neither can leave alone: wherever it goes, the window is broken until the other
comes after it, and no temperature at which the rest of the schedule settles lets that happen.
"""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.candidates import candidate_start
from halpipe.pipeline.solve.kernel.conflicts import heat_up_overlapped, heat_up_partners, heat_up_task
from halpipe.pipeline.solve.kernel.placement import enter, leave, option_cost, take_out
from halpipe.pipeline.solve.kernel.registry import compiled
from halpipe.pipeline.solve.kernel.side_costs import side_cost
from halpipe.pipeline.solve.kernel.state import COST, FROZEN_HINT, NOISE_SHIFT, TEMPERATURE, draw

CANDIDATES_OF_CLUSTERS = 16
"""Shifts to look at in one move."""

TIGHT = 8
"""Windows of at most this part of a task's period link it tightly."""


@compiled
def gather_cluster(p, s, task):
    """List `task` and all that is tightly linked to it in `cluster`; return how many, 0 if they cannot be moved."""
    s.cluster[0] = task
    size = 1
    place = 0
    while place < size:
        member = s.cluster[place]
        place += 1
        if not _may_shift(p, s, member):
            return 0
        for index in range(p.partner_first[member], p.partner_first[member + 1]):
            other = p.partner[index, 0]
            if p.partner[index, 2] * TIGHT > p.task_period[member] or _is_listed(s, size, other):
                continue
            if size == len(s.cluster):
                return 0
            s.cluster[size] = other
            size += 1
    return size


@compiled
def _is_listed(s, size, task):
    for place in range(size):
        if s.cluster[place] == task:
            return True
    return False


@compiled
def _may_shift(p, s, task):
    """Return whether all jobs of a task may go anywhere together, and windows are all that couples it with others."""
    begin = p.task_job[task]
    end = p.task_job[task + 1]
    if begin == end or p.task_cyclic[task] == 0:
        return False
    if p.task_chain_first[task + 1] > p.task_chain_first[task]:
        return False
    if p.dependent_first[end] > p.dependent_first[begin]:
        return False
    entry = p.job_entry[begin]
    return p.entry_offset[entry] < 0 and s.hint[entry] != FROZEN_HINT


@compiled
def move_cluster(p, s, noise, size):
    """Make one heat-bath move of the cluster and account for its cost."""
    before = _windows(p, s, size)
    for place in range(size):
        task = s.cluster[place]
        before += take_out(p, s, p.task_job[task], p.task_job[task + 1])
    shift = _sample(p, s, noise, size, before)
    _shift(p, s, size, shift)
    after = _enter(p, s, size) + _windows(p, s, size)
    s.register[COST] += after - before
    if after > 0:
        _heat_up(p, s, size)


@compiled
def _heat_up(p, s, size):
    """Remember whoever may be in conflict after a move of the cluster."""
    for place in range(size):
        task = s.cluster[place]
        heat_up_task(p, s, task)
        for job in range(p.task_job[task], p.task_job[task + 1]):
            heat_up_overlapped(p, s, job)
        heat_up_partners(p, s, task, p.task_job[task], p.task_job[task + 1])


@compiled
def _sample(p, s, noise, size, before):
    """Draw shifts for a cluster that has been taken out; return the one to keep, or 0 for the old placement."""
    temperature = s.register[TEMPERATURE]
    best = before - (temperature * noise[draw(s.random, len(noise))] >> NOISE_SHIFT)
    chosen = 0
    for _ in range(CANDIDATES_OF_CLUSTERS):
        task = s.cluster[draw(s.random, size)]
        job = p.task_job[task] + draw(s.random, p.task_job[task + 1] - p.task_job[task])
        shift = (candidate_start(p, s, task, job, False) - s.old[job, 0]) % p.hyperperiod
        limit = best + (temperature * noise[draw(s.random, len(noise))] >> NOISE_SHIFT)
        cost = _shifted_cost(p, s, size, shift, limit)
        if cost < limit:
            best -= limit - cost
            chosen = shift
            if cost == 0:
                break
    return chosen


@compiled
def _shifted_cost(p, s, size, shift, limit):
    """Return what the cluster costs when shifted, or `limit` or more as soon as it is known to cost that.

    What its members cost by being in the same place is found last, by entering them one after the other.
    """
    cost = 0
    for place in range(size):
        task = s.cluster[place]
        for job in range(p.task_job[task], p.task_job[task + 1]):
            start = (s.old[job, 0] + shift) % p.hyperperiod
            cost += option_cost(p, s, s.option[job], start, limit - cost)
            if cost >= limit:
                return cost
    _shift(p, s, size, shift)
    windows = _windows(p, s, size)
    if cost + windows >= limit:
        return cost + windows
    cost = _enter(p, s, size)
    for place in range(size):
        task = s.cluster[place]
        leave(p, s, p.task_job[task], p.task_job[task + 1])
    return cost + windows


@compiled
def _shift(p, s, size, shift):
    """Let the starts and phases of a cluster be `shift` later than the old ones."""
    for place in range(size):
        task = s.cluster[place]
        begin = p.task_job[task]
        # A whole turn less, for all jobs of a task alike, keeps phases from growing without end.
        turn = p.hyperperiod if s.old[begin, 2] + shift >= p.hyperperiod else 0
        for job in range(begin, p.task_job[task + 1]):
            s.start[job] = (s.old[job, 0] + shift) % p.hyperperiod
            s.phase[job] = s.old[job, 2] + shift - turn


@compiled
def _enter(p, s, size):
    cost = 0
    for place in range(size):
        task = s.cluster[place]
        cost += enter(p, s, p.task_job[task], p.task_job[task + 1])
    return cost


@compiled
def _windows(p, s, size):
    """Return the distances from windows of all members, those between them twice: a shift does not change them."""
    cost = 0
    for place in range(size):
        task = s.cluster[place]
        cost += side_cost(p, s, task, p.task_job[task], p.task_job[task + 1])
    return cost
