/* What is done when a job is released, a piece ends, or a job that stays comes by. */

#ifndef HANDLERS_H
#define HANDLERS_H

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

#endif
