/* Earliest deadline first over parts, on unrolled time (MODEL 8.3).
 *
 * On each unit the job with the earliest deadline runs to its next split point. A piece that would keep a job which is
 * still to come from its latest start is not begun: idle time is inserted instead. A job that can wait no longer comes
 * before all others. Jobs that have begun are a stack on each unit, so that spans are nested.
 *
 * All is deterministic, in integers, and nothing is allocated: where some room is too small, that is said, and Python
 * begins again with more of it. */

#include "events.h"
#include "latency.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* The deadline of a job that can wait no longer. */
enum { AT_ONCE = -1 };

/* By how much the jobs of a task are late at most, as far as it is counted. */
#define MOST_LATE ((int64_t)1 << 60)

/* ---- queues */

/* Whether a task's job is more urgent than that of another. */
static bool is_sooner(const Simulation *s, int64_t task, int64_t other) {
    const Job *a = &s->memory->jobs[task], *b = &s->memory->jobs[other];
    return a->due < b->due || (a->due == b->due && task < other);
}

static int64_t *pending_of(const Simulation *s, int64_t unit) {
    return &s->memory->pending[s->plan->on_unit_at[unit]];
}

static int64_t *stack_of(const Simulation *s, int64_t unit) { return &s->memory->stacks[s->plan->on_unit_at[unit]]; }

/* The task that began last on a unit, of those that have not ended; -1 if there is none. */
static int64_t top_of(const Simulation *s, int64_t unit) {
    int64_t count = s->memory->stack_count[unit];
    return count ? stack_of(s, unit)[count - 1] : -1;
}

static void enqueue(const Simulation *s, int64_t unit, int64_t task) {
    int64_t *waiting = pending_of(s, unit), place = s->memory->pending_count[unit]++;
    for (; place > 0 && is_sooner(s, task, waiting[place - 1]); place--)
        waiting[place] = waiting[place - 1];
    waiting[place] = task;
}

static void dequeue(const Simulation *s, int64_t unit, int64_t task) {
    int64_t *waiting = pending_of(s, unit), place = 0, count = --s->memory->pending_count[unit];
    while (waiting[place] != task)
        place++;
    for (; place < count; place++)
        waiting[place] = waiting[place + 1];
}

/* Let a job wait for its units, from its release on or, if the one before it ends later, from then on. */
static void offer(const Simulation *s, int64_t task, int64_t number, int64_t now) {
    Job *job = &s->memory->jobs[task];
    const Task *facts = &s->system->task[task];
    const Way *way = way_of(s, task);
    int64_t far = s->system->cycle * s->system->most_cycles;
    int64_t time = release_of(s, task, number) - s->plan->holds[task];
    job->is_there = true;
    job->number = number;
    job->release = time;
    job->due = time + s->plan->urgency[task];
    job->latest = time + (facts->is_cyclic ? facts->latest : far);
    job->end_by = time + (facts->is_cyclic ? facts->deadline : far);
    job->last_start = least(job->latest, job->end_by - way->length);
    job->executed = job->target = job->claimed = job->parts = 0;
    job->kept = -1;
    for (int64_t n = way->units; n < way[1].units; n++)
        enqueue(s, s->system->way_units[n], task);
    if (job->last_start > now)
        put(s, job->last_start, WAKE, task, s->system->way_units[way->units]);
}

/* Put a job before all that can still wait. */
static void hurry(const Simulation *s, int64_t task) {
    const Way *way = way_of(s, task);
    s->memory->jobs[task].due = AT_ONCE;
    s->memory->hurried++;
    for (int64_t n = way->units; n < way[1].units; n++) {
        dequeue(s, s->system->way_units[n], task);
        enqueue(s, s->system->way_units[n], task);
    }
}

/* ---- events */

static void release(const Simulation *s, int64_t task) {
    Job *job = &s->memory->jobs[task];
    int64_t now = job->next_release, number = job->next_number;
    announce(s, task, number + 1);
    if (!job->is_there)
        offer(s, task, number, now);
    touch_units(s, way_of(s, task));
}

/* Note a job that has ended, if it belongs to the hyperperiod that is looked at. */
static void keep(const Simulation *s, int64_t task) {
    Memory *m = s->memory;
    const Job *job = &m->jobs[task];
    const Part *parts = parts_of(s, task);
    int64_t start = parts[0].start, end = parts[job->parts - 1].end;
    if (start < m->begin || start >= m->end)
        return;
    if (m->part_count + job->parts > m->part_room) {
        m->lack |= PARTS;
        return;
    }
    int64_t first = s->plan->releases_at[task], count = s->plan->releases_at[task + 1] - first;
    int64_t place = first + job->number % count;
    m->first[place] = m->part_count;
    m->count[place] = job->parts;
    m->release[place] = job->release - m->begin;
    m->start[place] = start - m->begin;
    m->finish[place] = end - m->begin;
    for (int64_t n = 0; n < job->parts; n++)
        m->parts[m->part_count++] =
            (Part){parts[n].start - m->begin, parts[n].end - m->begin, parts[n].first, parts[n].last};
    int64_t late = least(MOST_LATE, greatest(0, start - job->latest) + greatest(0, end - job->end_by));
    m->late[task] = least(MOST_LATE, m->late[task] + late);
}

/* End a piece; the job goes on, or makes room, when the unit is dispatched. */
static void stop(const Simulation *s, int64_t task, int64_t now) {
    Memory *m = s->memory;
    Job *job = &m->jobs[task];
    const Way *way = way_of(s, task);
    Part *part = last_part(s, task);
    job->executed = part->last = job->target;
    job->is_running = false;
    part->end = now;
    touch_units(s, way);
    for (int64_t n = way->units; n < way[1].units; n++)
        m->running[s->system->way_units[n]] = -1;
    if (job->executed < way->wcet)
        return;
    for (int64_t n = way->units; n < way[1].units; n++)
        m->stack_count[s->system->way_units[n]]--;
    keep(s, task);
    note(s, task, true, now);
    job->is_there = false;
    if (job->number + 1 < job->next_number)
        offer(s, task, job->number + 1, now);
    touch_followers(s, task);
}

/* Note what a job that stays does at an instant, and when it comes by again. */
static void pass(const Simulation *s, int64_t number, int64_t now) {
    const System *system = s->system;
    const Fixed *fixed = &system->fixed[number];
    put(s, now + system->cycle, FIXED, -1, number);
    for (int64_t n = fixed->units; n < fixed[1].units; n++)
        touch(s, system->fixed_units[n]);
    bool starts = (now - fixed->start) % system->cycle == 0, ends = (now - fixed->end) % system->cycle == 0;
    if (starts)
        note(s, fixed->task, false, now);
    if (ends)
        note(s, fixed->task, true, now);
    if (starts || ends)
        touch_followers(s, fixed->task);
}

/* ---- jobs that stay */

static bool has_walls(const System *system, int64_t unit) {
    return system->walls_at[unit + 1] > system->walls_at[unit];
}

/* What those that stay make of an instant on a unit; `shift` is the begin of its hyperperiod. */
static const Place *place_at(const System *system, int64_t unit, int64_t now, int64_t *shift) {
    const Place *places = &system->places[system->places_at[unit]];
    int64_t low = 0, high = system->places_at[unit + 1] - system->places_at[unit], rest = now % system->cycle;
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (places[middle].point <= rest)
            low = middle;
        else
            high = middle;
    }
    *shift = now - rest;
    return &places[low];
}

/* Until when a job may run from `now` on, before one that stays; -1 if for ever. */
static int64_t limit_of(const Simulation *s, const Way *way, int64_t now) {
    const System *system = s->system;
    int64_t limit = -1, rest = now % system->cycle;
    for (int64_t n = way->units; n < way[1].units; n++) {
        int64_t unit = system->way_units[n], first = system->walls_at[unit];
        if (!has_walls(system, unit))
            continue;
        int64_t count = system->walls_at[unit + 1] - first;
        int64_t place = count_up_to(&system->walls[first], count, rest - 1);
        int64_t next = place < count ? system->walls[first + place] : system->walls[first + count - 1] + system->cycle;
        next += now - rest;
        limit = limit < 0 ? next : least(limit, next);
    }
    return limit;
}

/* Whether a job that stays keeps another from a unit: it runs, or what is begun must end before it. */
static bool is_shut_out(const Simulation *s, int64_t task, int64_t unit, int64_t now) {
    if (!has_walls(s->system, unit))
        return false;
    int64_t shift;
    const Place *place = place_at(s->system, unit, now, &shift);
    if (place->is_busy)
        return true;
    if (!place->has_gap)
        return false;
    if (s->memory->jobs[task].parts)
        return parts_of(s, task)[0].start < place->gap_begin + shift;
    int64_t end = now + way_of(s, task)->length;
    for (int64_t n = 0; n < s->memory->stack_count[unit]; n++) {
        int64_t other = stack_of(s, unit)[n];
        if (parts_of(s, other)[0].start >= place->gap_begin + shift)
            end += rest_of(s, other);
    }
    return end > place->gap_end + shift;
}

/* ---- decisions */

/* Whether a job may have all its units: nobody runs there, and who has begun is less urgent and may stop. */
static bool is_free_for(const Simulation *s, int64_t task, int64_t now) {
    const Memory *m = s->memory;
    const Way *way = way_of(s, task);
    for (int64_t n = way->units; n < way[1].units; n++) {
        int64_t unit = s->system->way_units[n], top = top_of(s, unit);
        if (m->running[unit] >= 0 || is_shut_out(s, task, unit, now))
            return false;
        if (top < 0 || top == task)
            continue;
        const Way *other = way_of(s, top);
        bool may_stop = stops_at(s->system, other, last_part(s, top)->first, m->jobs[top].executed);
        if (m->jobs[task].parts || gaps_of(&m->jobs[top]) >= other->max_gaps || !may_stop)
            return false;
        if (is_sooner(s, top, task) && !is_shut_out(s, top, unit, now))
            return false;
    }
    return true;
}

/* Whether a predecessor that was released no later than a job has still to start, or to end. */
static bool is_to_come(const Simulation *s, const Window *window, const Job *job) {
    const Job *before = &s->memory->jobs[window->task];
    return before->is_there && before->release <= job->release && (window->from_end || !before->parts);
}

/* Before when no job may expect a predecessor in a window, since none has run yet. */
static int64_t earliest_expected(const Simulation *s, const Window *window) {
    int64_t first = s->plan->releases_at[window->task];
    if (!window->least || first == s->plan->releases_at[window->task + 1])
        return 0;
    int64_t length = window->from_end ? way_of(s, window->task)->length : 0;
    return s->plan->releases[first] + length + window->least;
}

/* Whether every window of a job is open; if one opens later, ask again then. */
static bool windows_allow(const Simulation *s, int64_t task, int64_t now) {
    const Memory *m = s->memory;
    const Way *way = way_of(s, task);
    for (int64_t n = way->windows; n < way[1].windows; n++) {
        const Window *window = &s->system->windows[n];
        if (s->plan->fresh && now < m->jobs[task].last_start && is_to_come(s, window, &m->jobs[task]))
            return false;
        int64_t list = 2 * s->plan->history[window->task] + (window->from_end ? 1 : 0);
        const int64_t *times = &m->past[list * m->history_room];
        int64_t place = count_up_to(times, m->past_count[list], now - window->least);
        if (place && times[place - 1] >= now - window->most)
            continue;
        if (now < earliest_expected(s, window))
            continue; /* what it asks for lies before the beginning of time */
        if (place < m->past_count[list])
            put(s, times[place] + window->least, WAKE, task, s->system->way_units[way->units]);
        return false;
    }
    return true;
}

/* The next split point, or a later one where until then no job is released that could be more urgent. */
static int64_t next_end(const Simulation *s, int64_t task, const Piece *piece, int64_t limit) {
    const Memory *m = s->memory;
    const Way *way = piece->way;
    const int64_t *ends = &s->system->ends[way->ends];
    int64_t most = way[1].ends - way->ends - 1, first = count_up_to(ends, most + 1, m->jobs[task].executed);
    int64_t quiet = INT64_MAX;
    for (int64_t n = way->units; n < way[1].units; n++) {
        int64_t unit = s->system->way_units[n];
        const int64_t *waiting = pending_of(s, unit);
        if (m->pending_count[unit] && waiting[0] != task && is_sooner(s, waiting[0], task))
            return ends[first];
        for (int64_t k = s->plan->on_unit_at[unit]; k < s->plan->on_unit_at[unit + 1]; k++)
            if (s->plan->on_unit[k] != task)
                quiet = least(quiet, m->jobs[s->plan->on_unit[k]].next_release);
        for (int64_t k = 0; k < m->pending_count[unit]; k++)
            quiet = least(quiet, m->jobs[waiting[k]].last_start);
    }
    if (limit >= 0)
        quiet = least(quiet, limit);
    if (quiet == INT64_MAX)
        quiet = piece->start;
    while (first < most) {
        int64_t middle = (first + most + 1) / 2;
        if (end_of(s->system, piece, ends[middle]) <= quiet)
            first = middle;
        else
            most = middle - 1;
    }
    return ends[first];
}

/* The first edge of an access phase at which a job that may be interrupted anywhere stops, or its end. */
static int64_t next_edge(const System *system, const Piece *piece, int64_t executed) {
    const Way *way = piece->way;
    int64_t edge = way->wcet;
    for (int64_t n = way->phases; n < way[1].phases; n++) {
        int64_t edges[] = {system->phases[n].begin, system->phases[n].end};
        for (int k = 0; k < 2; k++)
            if (edges[k] > executed && edges[k] < edge && stops_at(system, way, piece->first, edges[k]))
                edge = edges[k];
    }
    return edge;
}

/* Up to where a job runs before the next decision: a job without gaps left runs to its end. */
static int64_t target_of(const Simulation *s, int64_t task, const Piece *piece, int64_t limit) {
    const Way *way = piece->way;
    int64_t executed = s->memory->jobs[task].executed;
    if (piece->gaps >= way->max_gaps)
        return way->wcet;
    if (!way->anywhere)
        return next_end(s, task, piece, limit);
    int64_t target = next_edge(s->system, piece, executed);
    if (limit >= 0 && end_of(s->system, piece, target) > limit) {
        int64_t stop_at = last_stop(s->system, piece, limit, executed);
        return stop_at ? stop_at : target;
    }
    return target;
}

/* Whether a piece until `end` would keep a job that is released before then from its latest start. */
static bool keeps_next_late(const Simulation *s, int64_t task, const Piece *piece, int64_t end, int64_t unit, int64_t now) {
    for (int64_t n = s->plan->on_unit_at[unit]; n < s->plan->on_unit_at[unit + 1]; n++) {
        int64_t other = s->plan->on_unit[n];
        const Job *job = &s->memory->jobs[other];
        const Task *facts = &s->system->task[other];
        int64_t next = job->next_release;
        if (other == task || next >= end || job->is_there || !facts->is_cyclic)
            continue;
        const Way *way = way_of(s, other);
        int64_t latest = next - s->plan->holds[other] + least(facts->latest, facts->deadline - way->length);
        if (holds_up(s, task, piece, end, greatest(next, now), latest) && can_wait(s, task, next + way->length))
            return true;
    }
    return false;
}

/* Whether it would keep one that waits; that is put before all others. */
static bool keeps_pending_late(
    const Simulation *s, int64_t task, const Piece *piece, int64_t end, int64_t unit, int64_t now) {
    const int64_t *waiting = pending_of(s, unit);
    for (int64_t n = 0; n < s->memory->pending_count[unit]; n++) {
        int64_t other = waiting[n];
        const Job *job = &s->memory->jobs[other];
        int64_t latest = job->last_start;
        if (other == task || job->due == AT_ONCE || latest < now || latest >= end)
            continue;
        bool is_held_up = holds_up(s, task, piece, end, latest, latest);
        if (is_held_up && can_wait(s, task, now + way_of(s, other)->length)) {
            hurry(s, other);
            return true;
        }
    }
    return false;
}

/* Whether a piece until `end` would keep some job from its latest start, while this job can wait. */
static bool keeps_others_late(
    const Simulation *s, int64_t task, const Piece *piece, int64_t end, int64_t waiting, int64_t now) {
    const Memory *m = s->memory;
    const Job *job = &m->jobs[task];
    for (int64_t n = piece->way->units; n < piece->way[1].units; n++) {
        int64_t unit = s->system->way_units[n];
        if (keeps_next_late(s, task, piece, end, unit, now) || keeps_pending_late(s, task, piece, end, unit, now))
            return true;
    }
    for (int64_t n = 0; n < waiting; n++) {
        const Job *other = &m->jobs[m->candidates[n]];
        int64_t latest = other->parts ? other->end_by : other->latest;
        latest = least(latest, other->end_by - rest_of(s, m->candidates[n]));
        if (end > latest && latest >= now && end + rest_of(s, task) <= job->end_by)
            return true;
    }
    return false;
}

/* Begin a job; one that had to begin now, but need not end in one piece, is no more urgent from now on. */
static void enter(const Simulation *s, int64_t task, int64_t now) {
    Memory *m = s->memory;
    Job *job = &m->jobs[task];
    const Way *way = way_of(s, task);
    note(s, task, false, now);
    if (job->due == AT_ONCE && now + way->length < job->end_by)
        job->due = job->release + s->plan->urgency[task];
    for (int64_t n = way->units; n < way[1].units; n++) {
        int64_t unit = s->system->way_units[n];
        dequeue(s, unit, task);
        stack_of(s, unit)[m->stack_count[unit]++] = task;
    }
    for (int64_t n = s->plan->followers_at[task]; n < s->plan->followers_at[task + 1]; n++)
        put(s, now, WAKE, task, s->plan->followers[n]);
}

static void run_to(const Simulation *s, int64_t task, int64_t end) {
    Job *job = &s->memory->jobs[task];
    const Way *way = way_of(s, task);
    job->ticket++;
    job->is_running = true;
    for (int64_t n = way->units; n < way[1].units; n++)
        s->memory->running[s->system->way_units[n]] = task;
    put(s, end, STOP, task, job->ticket);
}

static void add_part(const Simulation *s, int64_t task, int64_t now) {
    Job *job = &s->memory->jobs[task];
    if (s->plan->parts_at[task] + job->parts == s->plan->parts_at[task + 1]) {
        s->memory->lack |= OPEN;
        return;
    }
    parts_of(s, task)[job->parts++] = (Part){now, now, job->executed, job->executed};
}

/* The first instant at which a part began that is running, or may go on at once. */
static int64_t oldest_part(const Simulation *s, int64_t now) {
    int64_t oldest = now;
    for (int64_t unit = 0; unit < s->system->units; unit++) {
        for (int64_t n = 0; n < s->memory->stack_count[unit]; n++) {
            int64_t task = stack_of(s, unit)[n];
            const Part *part = last_part(s, task);
            if (s->memory->jobs[task].is_running || part->end == now)
                oldest = least(oldest, part->start);
        }
    }
    return oldest;
}

/* Whether what a piece asks of resources is free, and nobody comes late by it; else see to it that it is asked again. */
static bool is_welcome(
    const Simulation *s, int64_t task, const Piece *piece, int64_t end, int64_t asked, int64_t waiting, int64_t now) {
    int64_t free_at = collision(s, asked);
    if (free_at > now)
        put(s, free_at, WAKE, task, s->system->way_units[piece->way->units]);
    return free_at < 0 && !keeps_others_late(s, task, piece, end, waiting, now);
}

/* Start a job, or go on with it, if nothing forbids it; so many others are `waiting` that came before it. */
static bool begin_at(const Simulation *s, int64_t task, int64_t waiting, int64_t now) {
    Job *job = &s->memory->jobs[task];
    if (!is_free_for(s, task, now) || (!job->parts && !windows_allow(s, task, now)))
        return false;
    Piece piece = piece_at(s, task, now);
    int64_t limit = limit_of(s, piece.way, now);
    int64_t target = target_of(s, task, &piece, limit), end = end_of(s->system, &piece, target);
    if (limit >= 0 && end > limit)
        return false;
    int64_t asked = ask(s, &piece, job->executed, target);
    bool goes_on = piece.gaps == gaps_of(job), must = goes_on && gaps_of(job) >= piece.way->max_gaps;
    if (!must && !is_welcome(s, task, &piece, end, asked, waiting, now))
        return false;
    if (asked && is_crowded(s))
        forget(s, oldest_part(s, now));
    take(s, asked);
    if (!job->parts)
        enter(s, task, now);
    if (!goes_on)
        add_part(s, task, now);
    job->target = job->claimed = target;
    job->kept = now;
    run_to(s, task, end);
    return true;
}

/* Shorten the piece of a job that may be interrupted anywhere, if a more urgent one waits for its unit. */
static void cut(const Simulation *s, int64_t task, int64_t unit, int64_t now) {
    Memory *m = s->memory;
    Job *job = &m->jobs[task];
    const Way *way = way_of(s, task);
    if (!way->anywhere || gaps_of(job) >= way->max_gaps || !m->pending_count[unit])
        return;
    int64_t urgent = pending_of(s, unit)[0];
    if (is_sooner(s, task, urgent) || !windows_allow(s, urgent, now))
        return;
    Piece piece = running_piece(s, task);
    int64_t where = first_stop(s->system, &piece, now, job->executed);
    if (where == job->executed && job->kept == now)
        return; /* nobody could take its place at this instant */
    if (where >= job->target)
        return;
    job->target = where;
    int64_t end = end_of(s->system, &piece, where), asked = ask(s, &piece, job->executed, job->claimed);
    for (int64_t n = 0; n < asked; n++)
        if (m->asked[n].begin >= end)
            give_back(s, &m->asked[n]);
    run_to(s, task, end);
}

/* Ask those that wait for a unit, the most urgent first, and then the job that has begun, until one takes it. Who has
 * become more urgent meanwhile is asked where it stood. */
static bool ask_all(const Simulation *s, int64_t unit, int64_t now) {
    Memory *m = s->memory;
    int64_t top = top_of(s, unit), count = m->pending_count[unit], asked = 0;
    bool waits = top >= 0 && is_shut_out(s, top, unit, now);
    for (int64_t n = 0; n < count; n++)
        m->candidates[n] = pending_of(s, unit)[n];
    for (; asked < count; asked++) {
        int64_t task = m->candidates[asked];
        if (top >= 0 && !waits && is_sooner(s, top, task))
            break;
        if (begin_at(s, task, asked, now))
            return true;
    }
    return top >= 0 && begin_at(s, top, asked, now);
}

static void dispatch(const Simulation *s, int64_t unit, int64_t now) {
    Memory *m = s->memory;
    for (int64_t n = 0; n < m->pending_count[unit]; n++) {
        int64_t task = pending_of(s, unit)[n];
        if (now >= m->jobs[task].last_start && m->jobs[task].due != AT_ONCE)
            hurry(s, task);
    }
    if (m->running[unit] >= 0) {
        cut(s, m->running[unit], unit, now);
        return;
    }
    for (int64_t hurried = -1; hurried != m->hurried;) { /* who was put first meanwhile has not been asked */
        hurried = m->hurried;
        if (ask_all(s, unit, now))
            return;
    }
}

/* ---- what Python calls */

/* Put down the first release of every task, and the jobs that stay. */
EXPORTED void halpipe_edf_begin(const System *system, const Plan *plan, Memory *memory) {
    const Simulation s = {system, plan, memory};
    for (int64_t task = 0; task < system->tasks; task++) {
        memory->jobs[task].next_release = memory->jobs[task].next_number = -1;
        if (plan->releases_at[task] < plan->releases_at[task + 1])
            announce(&s, task, 0);
    }
    for (int64_t unit = 0; unit < system->units; unit++)
        memory->running[unit] = -1;
}

/* Put down when a job that stays comes by. */
EXPORTED void halpipe_edf_fix(const System *system, const Plan *plan, Memory *memory, int64_t time, int64_t number) {
    const Simulation s = {system, plan, memory};
    put(&s, time, FIXED, -1, number);
}

/* Go on to `end`, or for so many instants; return whether it is reached. */
EXPORTED int64_t halpipe_edf_run(const System *system, const Plan *plan, Memory *memory, int64_t end, int64_t instants) {
    const Simulation s = {system, plan, memory};
    while (memory->event_count && memory->events[0].time < end && !memory->lack) {
        if (instants-- == 0)
            return false;
        int64_t now = memory->events[0].time;
        while (memory->event_count && memory->events[0].time == now) {
            Event event = pop(&s);
            switch (kind_of(&event)) {
            case RELEASE:
                release(&s, event.number);
                break;
            case STOP:
                if (memory->jobs[event.task].ticket == event.number)
                    stop(&s, event.task, now);
                break;
            case WAKE:
                touch(&s, event.number);
                break;
            case FIXED:
                pass(&s, event.number, now);
                break;
            }
        }
        for (int64_t unit = 0; unit < system->units && !memory->lack; unit++) {
            if (memory->is_touched[unit]) {
                memory->is_touched[unit] = false;
                dispatch(&s, unit, now);
            }
        }
    }
    return true;
}

/* When the next event comes that what began before `end` still waits for; -1 if all that has ended. */
EXPORTED int64_t halpipe_edf_unended(const System *system, const Plan *plan, Memory *memory, int64_t end) {
    const Simulation s = {system, plan, memory};
    for (int64_t unit = 0; unit < system->units; unit++) {
        for (int64_t n = 0; n < memory->stack_count[unit]; n++) {
            int64_t task = stack_of(&s, unit)[n];
            if (memory->jobs[task].parts && parts_of(&s, task)[0].start < end)
                return memory->event_count ? memory->events[0].time : -1;
        }
    }
    return -1;
}

/* Whether nothing is under way, so that the next hyperperiod repeats the first. */
EXPORTED int64_t halpipe_edf_is_quiescent(const System *system, const Plan *plan, Memory *memory, int64_t now) {
    for (int64_t task = 0; task < system->tasks; task++) {
        int64_t first = plan->releases_at[task];
        if (memory->jobs[task].is_there)
            return false;
        if (first < plan->releases_at[task + 1] &&
            memory->jobs[task].next_release - system->cycle != plan->releases[first])
            return false;
    }
    for (int64_t resource = 0; resource < system->resources; resource++)
        for (int64_t n = memory->claims_of[resource]; n >= 0; n = memory->claims[n].next)
            if (memory->claims[n].end > now)
                return false;
    return true;
}

static void sign(Memory *m, int64_t *signature, int64_t value) {
    if (m->signed_count == m->signature_room)
        m->lack |= SIGNATURE;
    else
        signature[m->signed_count++] = value;
}

static void sign_job(const Simulation *s, int64_t *signature, int64_t task, int64_t now) {
    Memory *m = s->memory;
    const Job *job = &m->jobs[task];
    const int64_t facts[] = {task, job->release - now, job->executed, job->target, job->is_running, job->parts};
    for (int64_t n = 0; n < 6; n++)
        sign(m, signature, facts[n]);
    for (int64_t n = 0; n < job->parts; n++) {
        const Part *part = &parts_of(s, task)[n];
        sign(m, signature, part->start - now);
        sign(m, signature, part->end - now);
        sign(m, signature, part->first);
        sign(m, signature, part->last);
    }
}

static bool is_lower(const Claim *a, const Claim *b) {
    if (a->begin != b->begin)
        return a->begin < b->begin;
    return a->end != b->end ? a->end < b->end : a->height < b->height;
}

/* The claims of a resource that end after `now`, in an order of their own. */
static void sign_claims(const Simulation *s, int64_t *signature, int64_t resource, int64_t now) {
    Memory *m = s->memory;
    int64_t count = 0;
    for (int64_t n = m->claims_of[resource]; n >= 0; n = m->claims[n].next) {
        if (m->claims[n].end <= now)
            continue;
        if (count == m->near_room) {
            m->lack |= CLAIMS;
            return;
        }
        Claim claim = {resource, m->claims[n].begin - now, m->claims[n].end - now, m->claims[n].height};
        int64_t place = count++;
        for (; place > 0 && is_lower(&claim, &m->near[place - 1]); place--)
            m->near[place] = m->near[place - 1];
        m->near[place] = claim;
    }
    sign(m, signature, count);
    for (int64_t n = 0; n < count; n++) {
        sign(m, signature, m->near[n].begin);
        sign(m, signature, m->near[n].end);
        sign(m, signature, m->near[n].height);
    }
}

/* Write down all that the future depends on, relative to `now`; return whether it is what was written `before`. */
EXPORTED int64_t halpipe_edf_sign(const System *system, const Plan *plan, Memory *m, int64_t now, int64_t turn) {
    const Simulation s = {system, plan, m};
    int64_t *signature = &m->signatures[turn % 2 * m->signature_room];
    const int64_t *other = &m->signatures[(turn + 1) % 2 * m->signature_room];
    m->signed_count = 0;
    forget(&s, now - system->cycle);
    for (int64_t unit = 0; unit < system->units; unit++) {
        sign(m, signature, m->stack_count[unit]);
        for (int64_t n = 0; n < m->stack_count[unit]; n++)
            sign_job(&s, signature, stack_of(&s, unit)[n], now);
        for (int64_t n = 0; n < m->pending_count[unit]; n++)
            sign_job(&s, signature, pending_of(&s, unit)[n], now);
    }
    for (int64_t task = 0; task < system->tasks; task++) {
        const Job *job = &m->jobs[task];
        if (plan->releases_at[task] < plan->releases_at[task + 1]) {
            sign(m, signature, job->next_release - now);
            sign(m, signature, job->is_there ? job->next_number - job->number : 0);
        }
        for (int64_t list = 2 * plan->history[task]; list >= 0 && list <= 2 * plan->history[task] + 1; list++) {
            const int64_t *times = &m->past[list * m->history_room];
            int64_t count = m->past_count[list], old = count_up_to(times, count, now - plan->reach[task] - 1);
            sign(m, signature, count - old);
            for (int64_t n = old; n < count; n++)
                sign(m, signature, times[n] - now);
        }
    }
    for (int64_t resource = 0; resource < system->resources; resource++)
        sign_claims(&s, signature, resource, now);
    bool is_same = m->signed_count == m->signed_before;
    for (int64_t n = 0; is_same && n < m->signed_count; n++)
        is_same = signature[n] == other[n];
    m->signed_before = m->signed_count;
    return is_same;
}

/* Reaction time and data age of a chain of tasks, each of which has jobs. */
EXPORTED void halpipe_edf_latency(const Member *members, int64_t count, int64_t cycle, int64_t *reaction, int64_t *age) {
    *reaction = worst_reaction(members, count, cycle);
    *age = worst_age(members, count, cycle);
}

/* What the sources hashed to when this was built: a library left over from other sources is refused. */
#ifndef FINGERPRINT
#define FINGERPRINT ""
#endif
EXPORTED const char halpipe_fingerprint[] = FINGERPRINT;
