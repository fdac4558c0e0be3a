/* What is done when a job is released, a piece ends, or a job that stays comes by; and the latencies of a chain. */

#ifndef HALPIPE_HANDLERS_H
#define HALPIPE_HANDLERS_H

#include "queues.h"

/* By how much the jobs of a task are late at most, as far as it is counted. */
#define MOST_LATE ((int64_t)1 << 60)

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

/* End a piece; the job continues, or is preempted, when the unit is dispatched. */
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

/* A task of a chain: when its jobs start and end, each after the one before it, round the hyperperiod from job `first`
 * on, which starts first in it. */
typedef struct {
    int64_t count, first;
    const int64_t *starts;
    const int64_t *ends;
} Member;

static int64_t turned(const Member *member, const int64_t *times, int64_t place) {
    place += member->first;
    return times[place < member->count ? place : place - member->count];
}

/* How many of the first jobs start, or end, before `time`. */
static int64_t count_before(const Member *member, const int64_t *times, int64_t time) {
    int64_t low = 0, high = member->count;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        if (turned(member, times, middle) < time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The end of the job that starts next at or after a time. */
static int64_t end_after(const Member *member, int64_t cycle, int64_t time) {
    int64_t shift = -floor_of(turned(member, member->starts, member->count - 1) - time, cycle) * cycle;
    return shift + turned(member, member->ends, count_before(member, member->starts, time - shift));
}

/* The start of the job that ended last at or before a time. */
static int64_t start_before(const Member *member, int64_t cycle, int64_t time) {
    int64_t shift = floor_of(time - turned(member, member->ends, 0), cycle) * cycle;
    return shift + turned(member, member->starts, count_before(member, member->ends, time - shift + 1) - 1);
}

static int64_t worst_reaction(const Member *members, int64_t count, int64_t cycle) {
    int64_t worst = 0;
    for (int64_t n = 0; n < members[0].count; n++) {
        int64_t time = members[0].starts[n] + 1; /* what it reads has just been missed */
        for (int64_t member = 0; member < count; member++)
            time = end_after(&members[member], cycle, time);
        worst = greatest(worst, time - members[0].starts[n]);
    }
    return worst;
}

static int64_t worst_age(const Member *members, int64_t count, int64_t cycle) {
    const Member *last = &members[count - 1];
    int64_t worst = 0;
    for (int64_t n = 0; n < last->count; n++) {
        int64_t time = last->starts[n];
        for (int64_t member = count - 2; member >= 0; member--)
            time = start_before(&members[member], cycle, time);
        worst = greatest(worst, last->ends[n] - time);
    }
    return worst;
}

#endif
