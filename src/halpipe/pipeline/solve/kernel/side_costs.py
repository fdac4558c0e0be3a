"""Costs that lie between jobs rather than on lanes: precedence windows, demands and chain latencies.

A job counts only once it is placed (``start >= 0``) and present; rows whose other side is not placed yet cost
nothing, so that construction can start from an empty schedule.
"""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.jit import entry_point
from halpipe.pipeline.solve.kernel.profile import NEVER
from halpipe.pipeline.solve.kernel.registry import compiled


@compiled
def is_running(p, start, option, job):
    """Return whether a job is placed and present."""
    return start[job] >= 0 and p.option_present[option[job]] == 1


@compiled
def numbers_near(p, phase, task, time):
    """Return the range of job numbers of `task` that holds those which start or end nearest to `time`.

    Jobs of a periodic task are found by division; tasks on demand, and periodic ones with few jobs, are scanned.
    """
    first = p.task_job[task]
    jobs = p.task_job[task + 1] - first
    around = p.task_reach[task] // p.task_period[task] + 2
    if p.task_cyclic[task] == 0 or jobs <= 2 * around + 1:
        return 0, jobs
    nearest = (time - phase[first]) // p.task_period[task]
    return nearest - around, nearest + around + 1


@compiled
def window_distance(p, start, option, phase, task, point, width, from_end):
    """Return how far the nearest job of `task` lies outside [point - width, point] on the circle.

    The instant of a job is its start, or its end if `from_end`.
    """
    tp = p.hyperperiod
    first = p.task_job[task]
    jobs = p.task_job[task + 1] - first
    low, high = numbers_near(p, phase, task, point)
    best = NEVER
    for number in range(low, high):
        job = first + number % jobs
        if not is_running(p, start, option, job):
            continue
        instant = start[job]
        if from_end == 1:
            instant += p.option_wcet[option[job]]
        gap = (point - instant) % tp
        distance = 0 if gap <= width else min(gap - width, tp - gap)
        if distance < best:
            best = distance
            if best == 0:
                return 0
    return best


@compiled
def job_window_cost(p, start, option, phase, job, only):
    """Return the distance of a job's windows, of all rows or of those naming task `only` (-1: all)."""
    cost = 0
    if not is_running(p, start, option, job):
        return cost
    chosen = option[job]
    for index in range(p.row_first[chosen], p.row_first[chosen + 1]):
        task = p.row[index, 0]
        if only >= 0 and task != only:
            continue
        point = start[job] - p.row[index, 1]
        distance = window_distance(p, start, option, phase, task, point, p.row[index, 2], p.row[index, 3])
        if distance < NEVER:
            cost += distance
    return cost * p.unit_weight


@compiled
def demand_cost(p, start, option, job):
    """Return the cost of a demand job that runs undemanded, or that is demanded and does not run."""
    demander = p.demand_job[job]
    if demander < 0 or start[job] < 0 or start[demander] < 0:
        return 0
    rows = 0
    if p.option_present[option[demander]] == 1:
        chosen = option[demander]
        for index in range(p.row_first[chosen], p.row_first[chosen + 1]):
            if p.row[index, 0] == p.job_task[job]:
                rows += 1
    wanted = rows > p.demand_slot[job]
    runs = p.option_present[option[job]] == 1
    return p.missing_cost if wanted != runs else 0


@compiled
def first_start(p, start, option, phase, task, time):
    """Return the earliest absolute start of a job of `task` at or after `time` and its job, or (NEVER, -1)."""
    tp = p.hyperperiod
    first = p.task_job[task]
    jobs = p.task_job[task + 1] - first
    low, high = numbers_near(p, phase, task, time)
    best = NEVER
    found = -1
    for number in range(low, high):
        job = first + number % jobs
        if not is_running(p, start, option, job):
            continue
        begin = time + (start[job] - time) % tp
        if begin < best:
            best = begin
            found = job
    return best, found


@compiled
def last_end(p, start, option, phase, task, time):
    """Return the latest absolute end of a job of `task` at or before `time` and its job, or (-NEVER, -1).

    Of jobs that end together, the one that started later is the newer.
    """
    tp = p.hyperperiod
    first = p.task_job[task]
    jobs = p.task_job[task + 1] - first
    low, high = numbers_near(p, phase, task, time)
    best = -NEVER
    found = -1
    for number in range(low, high):
        job = first + number % jobs
        if not is_running(p, start, option, job):
            continue
        end = time - (time - start[job] - p.option_wcet[option[job]]) % tp
        if end > best or (end == best and p.option_recency[option[job]] > p.option_recency[option[found]]):
            best = end
            found = job
    return best, found


@compiled
def chain_cost(p, start, option, phase, chain):
    """Return by how much a chain's worst reaction time and data age pass their limits (MODEL 3)."""
    begin = p.chain_first[chain]
    end = p.chain_first[chain + 1]
    for index in range(begin, end):
        task = p.chain_task[index]
        for job in range(p.task_job[task], p.task_job[task + 1]):
            if start[job] < 0:
                return 0
    cost = 0
    if p.chain_limit[chain, 0] >= 0:
        cost += _late(p, worst_reaction(p, start, option, phase, begin, end), p.chain_limit[chain, 0])
    if p.chain_limit[chain, 1] >= 0:
        cost += _late(p, worst_age(p, start, option, phase, begin, end), p.chain_limit[chain, 1])
    return cost


@compiled
def _late(p, latency, limit):
    if latency >= NEVER:
        return p.missing_cost
    return max(0, latency - limit) * p.unit_weight


@entry_point
def worst_reaction(p, start, option, phase, begin, end):
    """Return the worst reaction time of the chain in ``chain_task[begin:end]``, NEVER if nothing gets through."""
    task = p.chain_task[begin]
    worst = -1
    for job in range(p.task_job[task], p.task_job[task + 1]):
        if not is_running(p, start, option, job):
            continue
        time, reached = first_start(p, start, option, phase, task, start[job] + 1)
        for index in range(begin, end):
            if index > begin:
                time, reached = first_start(p, start, option, phase, p.chain_task[index], time)
            if reached < 0:
                return NEVER
            time += p.option_wcet[option[reached]]
        worst = max(worst, time - start[job])
    return worst if worst >= 0 else NEVER


@entry_point
def worst_age(p, start, option, phase, begin, end):
    """Return the worst data age of the chain in ``chain_task[begin:end]``, NEVER if nothing gets through."""
    task = p.chain_task[end - 1]
    worst = -1
    for job in range(p.task_job[task], p.task_job[task + 1]):
        if not is_running(p, start, option, job):
            continue
        time = start[job]
        for index in range(end - 2, begin - 1, -1):
            time, reached = last_end(p, start, option, phase, p.chain_task[index], time)
            if reached < 0:
                return NEVER
            time -= p.option_wcet[option[reached]]
        worst = max(worst, start[job] + p.option_wcet[option[job]] - time)
    return worst if worst >= 0 else NEVER


@compiled
def side_cost(p, s, task, begin, end):
    """Return what jobs [begin, end) of `task` have to do with others: windows, demands and chains."""
    cost = 0
    for job in range(begin, end):
        cost += job_window_cost(p, s.start, s.option, s.phase, job, -1)
        cost += demand_cost(p, s.start, s.option, job)
        for index in range(p.dependent_first[job], p.dependent_first[job + 1]):
            cost += demand_cost(p, s.start, s.option, p.dependent[index])
    for index in range(p.consumer_first[task], p.consumer_first[task + 1]):
        consumer = p.consumer[index]
        for job in range(p.task_job[consumer], p.task_job[consumer + 1]):
            cost += job_window_cost(p, s.start, s.option, s.phase, job, task)
    for index in range(p.task_chain_first[task], p.task_chain_first[task + 1]):
        cost += chain_cost(p, s.start, s.option, s.phase, p.task_chain[index])
    return cost
