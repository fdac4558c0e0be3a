"""The list of entries that may be in conflict, and the choice of the entry to move next."""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.placement import lane_conflict
from halpipe.pipeline.solve.kernel.profile import overloaded, wrapped
from halpipe.pipeline.solve.kernel.registry import compiled
from halpipe.pipeline.solve.kernel.side_costs import side_cost
from halpipe.pipeline.solve.kernel.state import FROZEN, FROZEN_HINT, HOT, INSERTED, draw

HOT_SHARE, HOT_SHARE_WITH_WINDOWS = 960, 900
"""Draws, of 1024, that pick an entry in conflict. With windows, others must make room more often."""


@compiled
def heat_up(p, s, entry):
    """Remember that an entry may be in conflict."""
    if s.hot_at[entry] < 0 and s.hint[entry] != FROZEN_HINT:
        s.hot[s.register[HOT]] = entry
        s.hot_at[entry] = s.register[HOT]
        s.register[HOT] += 1


@compiled
def cool_down(s, entry):
    """Forget an entry that turned out clean."""
    place = s.hot_at[entry]
    s.register[HOT] -= 1
    moved = s.hot[s.register[HOT]]
    s.hot[place] = moved
    s.hot_at[moved] = place
    s.hot_at[entry] = -1


@compiled
def heat_up_task(p, s, task):
    """Remember all entries of a task."""
    begin = p.task_job[task]
    end = p.task_job[task + 1]
    if begin == end:
        return
    for entry in range(p.job_entry[begin], p.job_entry[end - 1] + 1):
        heat_up(p, s, entry)


@compiled
def heat_up_overlapped(p, s, job):
    """Remember whoever shares an overloaded rectangle with a job."""
    option = s.option[job]
    for index in range(p.rect_first[option], p.rect_first[option + 1]):
        lane = p.rect[index, 0]
        begin = wrapped(s.start[job] + p.rect[index, 1], p.hyperperiod)
        length = p.rect[index, 2]
        if not overloaded(p, s, lane, begin, length):
            continue
        for place in range(p.owner_first[lane], p.owner_first[lane] + s.owners[lane]):
            gap = s.owner[place, 0] - begin
            if gap < 0:
                gap += p.hyperperiod
            if gap < length or p.hyperperiod - gap < s.owner[place, 1]:
                heat_up(p, s, p.job_entry[s.owner[place, 2] // s.max_rects])


@compiled
def heat_up_partners(p, s, task, begin, end):
    """Remember whoever has windows, demands or chains in common with jobs [begin, end) of a task."""
    for index in range(p.partner_first[task], p.partner_first[task + 1]):
        heat_up_task(p, s, p.partner[index, 0])
    for job in range(begin, end):
        if p.demand_job[job] >= 0:
            heat_up(p, s, p.job_entry[p.demand_job[job]])
        for index in range(p.dependent_first[job], p.dependent_first[job + 1]):
            heat_up(p, s, p.job_entry[p.dependent[index]])
    for index in range(p.task_chain_first[task], p.task_chain_first[task + 1]):
        chain = p.task_chain[index]
        for member in range(p.chain_first[chain], p.chain_first[chain + 1]):
            heat_up_task(p, s, p.chain_task[member])


@compiled
def pick(p, s):
    """Return the entry to move next: the next to construct, one in conflict, or any; and a job of it in conflict."""
    entries = len(p.entry_offset)
    if s.register[INSERTED] < entries:
        return p.construction[s.register[INSERTED]], -1
    if draw(s.random, 1024) < (HOT_SHARE_WITH_WINDOWS if len(p.row) > 0 else HOT_SHARE):
        while s.register[HOT] > 0:
            entry = s.hot[draw(s.random, s.register[HOT])]
            begin = p.entry_job[entry]
            end = p.entry_job[entry + 1]
            for job in range(begin, end):
                if lane_conflict(p, s, job):
                    return entry, job
            task = p.job_task[begin]
            if p.task_coupled[task] == 1 and side_cost(p, s, task, begin, end) > 0:
                return entry, -1
            cool_down(s, entry)
    frozen = s.register[FROZEN]
    return p.construction[frozen + draw(s.random, entries - frozen)], -1
