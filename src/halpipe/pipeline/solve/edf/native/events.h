/* What happens when: releases first, then what ends, then questions that are asked again, then jobs that stay. */

#ifndef EVENTS_H
#define EVENTS_H

#include "claims.h"

typedef enum { RELEASE, STOP, WAKE, FIXED } Kind;

/* Events of one instant come by their kind, and of one kind as they were put down. */
enum { KIND_SHIFT = 60 };

static Kind kind_of(const Event *event) { return (Kind)(event->order >> KIND_SHIFT); }

static bool is_before(const Event *a, const Event *b) {
    return a->time < b->time || (a->time == b->time && a->order < b->order);
}

static void put(const Simulation *s, int64_t time, Kind kind, int64_t task, int64_t number) {
    Memory *m = s->memory;
    if (m->event_count == m->event_room) {
        m->lack |= EVENTS;
        return;
    }
    Event event = {time, (int64_t)kind << KIND_SHIFT | m->sequence++, task, number};
    int64_t place = m->event_count++;
    for (; place > 0 && is_before(&event, &m->events[(place - 1) / 2]); place = (place - 1) / 2)
        m->events[place] = m->events[(place - 1) / 2];
    m->events[place] = event;
}

static Event pop(const Simulation *s) {
    Memory *m = s->memory;
    Event first = m->events[0], last = m->events[--m->event_count];
    int64_t place = 0, child;
    while ((child = 2 * place + 1) < m->event_count) {
        if (child + 1 < m->event_count && is_before(&m->events[child + 1], &m->events[child]))
            child++;
        if (!is_before(&m->events[child], &last))
            break;
        m->events[place] = m->events[child];
        place = child;
    }
    m->events[place] = last;
    return first;
}

/* When a job is released, counted from the beginning of time; -1 of a task without jobs. */
static int64_t release_of(const Simulation *s, int64_t task, int64_t number) {
    int64_t first = s->plan->releases_at[task], count = s->plan->releases_at[task + 1] - first;
    return count ? number / count * s->system->cycle + s->plan->releases[first + number % count] : -1;
}

static void announce(const Simulation *s, int64_t task, int64_t number) {
    Job *job = &s->memory->jobs[task];
    job->next_number = number;
    job->next_release = release_of(s, task, number);
    put(s, job->next_release, RELEASE, task, task);
}

/* Note that a task has started, or ended: windows look back as far as their reach. */
static void note(const Simulation *s, int64_t task, bool is_end, int64_t now) {
    Memory *m = s->memory;
    int64_t number = s->plan->history[task];
    if (number < 0)
        return;
    int64_t list = 2 * number + is_end;
    int64_t *times = &m->past[list * m->history_room], *count = &m->past_count[list];
    if (*count == m->history_room) {
        int64_t old = count_up_to(times, *count, now - s->plan->reach[task] - 1);
        for (int64_t n = old; n < *count; n++)
            times[n - old] = times[n];
        *count -= old;
    }
    if (*count == m->history_room) {
        m->lack |= HISTORY;
        return;
    }
    times[(*count)++] = now;
}

static void touch(const Simulation *s, int64_t unit) { s->memory->is_touched[unit] = true; }

static void touch_units(const Simulation *s, const Way *way) {
    for (int64_t n = way->units; n < way[1].units; n++)
        touch(s, s->system->way_units[n]);
}

static void touch_followers(const Simulation *s, int64_t task) {
    for (int64_t n = s->plan->followers_at[task]; n < s->plan->followers_at[task + 1]; n++)
        touch(s, s->plan->followers[n]);
}

#endif
