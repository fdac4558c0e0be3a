"""The annealing kernel: heat-bath moves over whole tasks or single jobs, in integers only.

One move takes an entry (a periodic task, one of its jobs, or a demand job) out of the schedule, draws candidate
placements, samples one of them and the old one with probability proportional to exp(-cost / T), and puts it
back. Sampling uses the Gumbel-max trick: the argument of min(cost - T * G) with G from an integer table; the
noise of a candidate is drawn before its evaluation, which therefore stops as soon as it cannot win, with the
same result. A candidate of cost zero ends the draw. Entries in conflict are drawn most of the time.

All state lives in arrays, so that the search can stop after any number of moves and go on later with the same
outcome: the bytes depend on the problem and the seed alone.
"""

from __future__ import annotations

from halpipe.pipeline.solve.kernel.candidates import candidate_start
from halpipe.pipeline.solve.kernel.clusters import gather_cluster, move_cluster
from halpipe.pipeline.solve.kernel.conflicts import heat_up, heat_up_overlapped, heat_up_partners, pick
from halpipe.pipeline.solve.kernel.jit import entry_point
from halpipe.pipeline.solve.kernel.placement import enter, option_cost, put, slide, take, take_out
from halpipe.pipeline.solve.kernel.profile import NEVER
from halpipe.pipeline.solve.kernel.registry import compiled
from halpipe.pipeline.solve.kernel.side_costs import chain_cost, demand_cost, job_window_cost, side_cost
from halpipe.pipeline.solve.kernel.state import (
    BEST,
    COST,
    CYCLE,
    CYCLE_LEFT,
    CYCLE_LENGTH,
    FROZEN,
    FROZEN_HINT,
    HEAT,
    HOT,
    INSERTED,
    MOVES,
    NOISE_SHIFT,
    TEMPERATURE,
    draw,
)

# Choices of the search, tuned on generated sets; none of them affects validity.
CANDIDATES, CANDIDATES_IN_WINDOWS = 16, 32
"""Places to look at for a task alone, and for one that is coupled with others."""
CLUSTERS = 4
"""One move in so many of a task that is coupled with others takes along what is tightly linked to it."""
CYCLE_MOVES = 300
"""Moves per entry in a cooling cycle, times Luby's sequence."""
FIRST_CYCLE_MOVES = 20
"""Of many entries, cycles begin shorter and double up to `CYCLE_MOVES`: most sets need no more than a quench."""
PATIENCE = 16
"""Of many entries with windows, each cycle begins with an empty schedule, and after so many cycles they get longer:
linked tasks hold each other in place, and what has not fallen into place in one cycle seldom does in the next."""
RESTART = 4
"""Without windows, one cycle in so many begins with an empty schedule: some basins are left in no other way."""
FEW_CYCLES = 4
"""So many cycles are made before the first restart."""
HOT_CYCLES = 6
"""Of 16 + entries cycles, this many start hot: a few entries hold each other in place by their windows and must all
move at once; of many, a hot cycle throws away more than it frees."""
FEW_ENTRIES = 32
"""With more entries, the first cycles are never hot: most sets are solved in them."""
HOTTER = 3
"""Hot cycles start at T0 times 2**3."""


@compiled
def luby(number):
    """Return the number-th term, from 1 on, of Luby's sequence 1, 1, 2, 1, 1, 2, 4, ..."""
    length = 1
    while (length << 1) - 1 < number:
        length <<= 1
    while number != (length << 1) - 1:
        number -= length - 1
        length = 1
        while (length << 1) - 1 < number:
            length <<= 1
    return length


@compiled
def restart(p, s):
    """Take everything out that is not frozen, to construct it anew; after some cycles, without the hints."""
    register = s.register
    for place in range(register[FROZEN], register[INSERTED]):
        entry = p.construction[place]
        if register[CYCLE] > FEW_CYCLES:
            s.hint[entry] = -1
        for job in range(p.entry_job[entry], p.entry_job[entry + 1]):
            take(p, s, job)
            s.start[job] = -1
    for place in range(register[HOT]):
        s.hot_at[s.hot[place]] = -1
    register[HOT] = 0
    register[INSERTED] = register[FROZEN]
    register[COST] = total_cost(p, s)


@compiled
def begin_cycle(p, s):
    """Choose the length of the next cycle, the temperature it starts from, and whether it builds up everything anew."""
    register = s.register
    register[CYCLE] += 1
    number = register[CYCLE]
    entries = len(p.entry_offset)
    is_small = entries < FEW_ENTRIES
    moves = CYCLE_MOVES if is_small else min(CYCLE_MOVES, FIRST_CYCLE_MOVES << min(number - 1, 8))
    is_linked = len(p.row) > 0
    is_hot = draw(s.random, 16 + entries) < HOT_CYCLES and (is_small or (number > FEW_CYCLES and not is_linked))
    register[HEAT] = first_heat(s, number, is_linked, is_hot)
    if is_linked and not is_small:
        moves *= 1 + number // PATIENCE
        is_anew = number > 1
    else:
        moves *= luby(number)
        is_anew = number > FEW_CYCLES and draw(s.random, RESTART) == 0
    register[CYCLE_LENGTH] = moves * entries
    register[CYCLE_LEFT] = register[CYCLE_LENGTH]
    if is_anew:
        restart(p, s)


@compiled
def first_heat(s, number, is_linked, is_hot):
    """Return where a cycle starts: at T0, T0/2 or T0/4, with windows anywhere from T0/2 to T0, if hot at 8 T0."""
    if is_hot:
        return s.heat << HOTTER
    if number == 1:
        return s.heat >> 1
    if is_linked:
        return s.heat * (8 + draw(s.random, 9)) >> 4
    return s.heat >> draw(s.random, 3)


@entry_point
def next_temperature(p, s):
    """Cool linearly to a third within a cycle, then begin another."""
    register = s.register
    if register[CYCLE_LEFT] == 0:
        begin_cycle(p, s)
    register[CYCLE_LEFT] -= 1
    heat = register[HEAT]
    low = heat // 3
    register[TEMPERATURE] = low + ((heat - low) * (register[CYCLE_LEFT] * 1024 // register[CYCLE_LENGTH]) >> 10)


@compiled
def settle(p, s, noise, task, job, phase, latest, limit):
    """Choose option, slide and start of a job at `phase` or later; return its lane cost.

    The job's phase may reach `latest` plus what slack and deadline of the option allow. NEVER if no option may.
    """
    first = p.task_option[task]
    last = p.task_option[task + 1]
    number = job - p.task_job[task] if p.task_cyclic[task] == 1 else 0
    start = (phase + number * p.task_period[task]) % p.hyperperiod
    if last - first == 1 and p.option_late[first] == 0 and phase == latest:
        s.option[job] = first
        s.start[job] = start
        s.phase[job] = phase
        return option_cost(p, s, first, start, limit)
    temperature = s.register[TEMPERATURE]
    best = NEVER
    chosen = NEVER
    for option in range(first, last):
        room = latest + p.option_late[option] - phase
        if room < 0:
            continue
        shift = 0
        cost = option_cost(p, s, option, start, NEVER)
        if cost > 0 and room > 0:
            found = slide(p, s, option, start, room)
            if found > 0:
                shift = found
                cost = 0
        score = cost
        if last - first > 1:
            score -= temperature * noise[draw(s.random, len(noise))] >> NOISE_SHIFT
        if score < best:
            best = score
            chosen = cost
            s.option[job] = option
            s.start[job] = (start + shift) % p.hyperperiod
            s.phase[job] = phase + shift
    return chosen


@compiled
def try_entry(p, s, noise, task, begin, end, phase, limit):
    """Place all jobs of an entry from `phase` on; return the lane cost, `limit` or more when abandoned."""
    cost = 0
    for job in range(begin, end):
        cost += settle(p, s, noise, task, job, phase, phase, limit - cost)
        if cost >= limit:
            break
    return cost


@compiled
def try_job(p, s, noise, task, job, start, limit):
    """Place one job near `start`, within what the phases of the other jobs of its entry leave it."""
    entry = p.job_entry[job]
    earliest = p.entry_offset[entry]
    latest = p.entry_offset[entry]
    if earliest < 0:
        earliest = -NEVER
        latest = NEVER
        for other in range(p.entry_job[entry], p.entry_job[entry + 1]):
            if other != job:
                earliest = max(earliest, s.phase[other] - p.option_late[s.option[other]])
                latest = min(latest, s.phase[other])
    late = 0
    for option in range(p.task_option[task], p.task_option[task + 1]):
        late = max(late, p.option_late[option])
    half = p.hyperperiod >> 1
    phase = s.old[job, 2] + (start - s.old[job, 0] + half) % p.hyperperiod - half
    if phase < earliest or phase > latest + late:
        phase = earliest + draw(s.random, latest + late - earliest + 1)
    return settle(p, s, noise, task, job, phase, latest, limit)


@compiled
def keep(s, begin, end):
    """Note the placement just tried as the one to keep."""
    for job in range(begin, end):
        s.kept[job, 0] = s.start[job]
        s.kept[job, 1] = s.option[job]
        s.kept[job, 2] = s.phase[job]


@compiled
def put_back(p, s, begin, end):
    """Enter the placement kept into the profiles; return the lane cost it brings."""
    for job in range(begin, end):
        s.start[job] = s.kept[job, 0]
        s.option[job] = s.kept[job, 1]
        s.phase[job] = s.kept[job, 2]
    return enter(p, s, begin, end)


@compiled
def has_moved(s, begin, end):
    """Return whether the placement kept differs from the old one."""
    for job in range(begin, end):
        if s.kept[job, 0] != s.old[job, 0] or s.kept[job, 1] != s.old[job, 1]:
            return True
    return False


@compiled
def sample(p, s, noise, task, begin, end, single, fresh, best):
    """Draw candidates for jobs [begin, end) and keep one of them, or the old placement, whose score is `best`."""
    coupled = p.task_coupled[task] == 1
    entry = p.job_entry[begin]
    temperature = s.register[TEMPERATURE]
    attempts = CANDIDATES_IN_WINDOWS if coupled else CANDIDATES
    for attempt in range(2 * attempts if fresh else attempts):
        job = begin + draw(s.random, end - begin)
        start = candidate_start(p, s, task, job, fresh)
        limit = best + (temperature * noise[draw(s.random, len(noise))] >> NOISE_SHIFT)
        if single:
            cost = try_job(p, s, noise, task, job, start, limit)
        else:
            phase = p.entry_offset[entry]
            if phase < 0 and fresh and attempt == 0:
                phase = s.hint[entry]
            if phase < 0:
                phase = start % p.task_period[task]
            cost = try_entry(p, s, noise, task, begin, end, phase, limit)
        if cost < limit and coupled:
            cost += side_cost(p, s, task, begin, end)
        if cost < limit:
            best -= limit - cost
            keep(s, begin, end)
            if cost == 0:
                break


@compiled
def is_flexible(p, task):
    """Return whether single jobs of a task have a choice: slack, or more than one option."""
    first = p.task_option[task]
    last = p.task_option[task + 1]
    if last - first > 1:
        return True
    return p.option_late[first] > 0


@entry_point
def move(p, s, noise):
    """Make one heat-bath move and account for its cost: of an entry, or of it and what is tightly linked to it."""
    entry, conflicting = pick(p, s)
    task = p.job_task[p.entry_job[entry]]
    size = 1
    may_be_joint = s.register[INSERTED] == len(p.entry_offset) and p.task_coupled[task] == 1
    if may_be_joint and draw(s.random, CLUSTERS) == 0:
        size = gather_cluster(p, s, task)
    if size > 1:
        move_cluster(p, s, noise, size)
    else:
        move_entry(p, s, noise, entry, conflicting)
    note_best(p, s)


@compiled
def move_entry(p, s, noise, entry, conflicting):
    """Move an entry or, of one with a choice for each job, half of the time a job: that in conflict, if one is."""
    register = s.register
    fresh = register[INSERTED] < len(p.entry_offset)
    if register[INSERTED] == 0:
        register[COST] = total_cost(p, s)  # of chains through tasks that have no jobs at all
    begin = p.entry_job[entry]
    end = p.entry_job[entry + 1]
    task = p.job_task[begin]
    single = False
    alone = end - begin == 1 and p.entry_offset[entry] < 0  # then the job is free to go anywhere as a whole
    if not fresh and not alone and is_flexible(p, task) and draw(s.random, 2) == 0:
        single = True
        begin = conflicting if conflicting >= 0 else begin + draw(s.random, end - begin)
        end = begin + 1
    coupled = p.task_coupled[task] == 1
    before = side_cost(p, s, task, begin, end) if coupled else 0
    best = NEVER
    if not fresh:
        before += take_out(p, s, begin, end)
        best = before - (register[TEMPERATURE] * noise[draw(s.random, len(noise))] >> NOISE_SHIFT)
    sample(p, s, noise, task, begin, end, single, fresh, best)
    after = put_back(p, s, begin, end)
    side = side_cost(p, s, task, begin, end) if coupled else 0
    after += side
    register[COST] += after - before
    if fresh:
        register[INSERTED] += 1
    if after > 0 and (fresh or has_moved(s, begin, end)):
        heat_up(p, s, entry)
        for job in range(begin, end):
            heat_up_overlapped(p, s, job)
        if side > 0:
            heat_up_partners(p, s, task, begin, end)


@compiled
def note_best(p, s):
    """Remember the current placement if it is complete and the best so far."""
    register = s.register
    if register[INSERTED] == len(p.entry_offset) and register[COST] < register[BEST]:
        register[BEST] = register[COST]
        for job in range(len(s.start)):
            s.best_start[job] = s.start[job]
            s.best_option[job] = s.option[job]


@entry_point
def anneal(p, s, noise, moves):
    """Make up to `moves` moves; stop early when the schedule is complete and its cost is zero. Return the cost."""
    register = s.register
    for _ in range(moves):
        if register[INSERTED] == len(p.entry_offset) and register[COST] == 0:
            break
        register[MOVES] += 1
        next_temperature(p, s)
        move(p, s, noise)
    return register[COST]


@entry_point
def load(p, s):
    """Take the complete placement in `start`, `option` and `phase` as the current one; return its cost.

    What is built up anew after that tries the same times first.
    """
    for job in range(len(p.job_task)):
        put(p, s, job)
    s.register[INSERTED] = len(p.entry_offset)
    for entry in range(len(p.entry_offset)):
        heat_up(p, s, entry)
        if s.hint[entry] != FROZEN_HINT:
            job = p.entry_job[entry]
            s.hint[entry] = s.phase[job] % p.task_period[p.job_task[job]]
    s.register[COST] = total_cost(p, s)
    note_best(p, s)
    return s.register[COST]


@entry_point
def total_cost(p, s):
    """Return the cost of a complete placement, from its profiles and windows."""
    cost = 0
    for lane in range(len(p.lane_capacity)):
        base = p.lane_first[lane]
        for index in range(base, base + s.edges[lane]):
            over = s.level[index] - p.lane_capacity[lane]
            if over > 0:
                cost += over * (s.edge[index + 1] - s.edge[index]) * p.lane_weight[lane]
    for job in range(len(p.job_task)):
        cost += job_window_cost(p, s.start, s.option, s.phase, job, -1)
        cost += demand_cost(p, s.start, s.option, job)
    for chain in range(len(p.chain_limit)):
        cost += chain_cost(p, s.start, s.option, s.phase, chain)
    return cost
