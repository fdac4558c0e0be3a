/* Who waits for a unit, the most urgent first, and who has begun on it. */

#ifndef QUEUES_H
#define QUEUES_H

#include "events.h"

/* The deadline of a job that can wait no longer. */
enum { AT_ONCE = -1 };

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

#endif
