/* Who gets a unit, up to where, and who has to wait. */

#ifndef DECISIONS_H
#define DECISIONS_H

#include "queues.h"

/* Whether a job may have all its units: no job runs there, and those begun are less urgent and may stop. */
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

/* Whether what a piece asks of resources is free, and no job is late by it; else see to it that it is asked again. */
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
        return; /* no job could take its place at this instant */
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

#endif
