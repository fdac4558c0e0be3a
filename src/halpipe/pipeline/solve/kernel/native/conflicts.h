/* Entries that may be in conflict, the choice of the one to move next, and where to try it: in a precedence window, at the
 * edge of a gap or of a step, near its old place, anywhere. */

#ifndef HALPIPE_CONFLICTS_H
#define HALPIPE_CONFLICTS_H

#include <stddef.h>

#include "lanes.h"
#include "rules.h"

/* Draws, of 1024, that pick an entry in conflict. With windows, others must make room more often. */
enum { HOT_SHARE = 960, HOT_SHARE_WITH_WINDOWS = 900 };

/* An entry to move, and a job of it that is in conflict, or -1. */
typedef struct { int64_t entry, job; } Pick;

/* Remember that an entry may be in conflict. */
static void heat_up(State *s, int64_t entry) {
    if (s->hot_at[entry] < 0 && s->hint[entry] != FROZEN_HINT) {
        s->hot[s->registers->hot] = entry;
        s->hot_at[entry] = s->registers->hot++;
    }
}

/* Forget an entry that turned out clean. */
static void cool_down(State *s, int64_t entry) {
    int64_t place = s->hot_at[entry];
    int64_t moved = s->hot[--s->registers->hot];
    s->hot[place] = moved;
    s->hot_at[moved] = place;
    s->hot_at[entry] = -1;
}

/* Remember all entries of a task. */
static void heat_up_task(const Arrays *p, State *s, int64_t task) {
    int64_t begin = p->task_job[task], end = p->task_job[task + 1];
    if (begin == end)
        return;
    for (int64_t entry = p->job_entry[begin]; entry <= p->job_entry[end - 1]; entry++)
        heat_up(s, entry);
}

/* Remember the entries that share an overloaded rectangle with a job. */
static void heat_up_overlapped(const Arrays *p, State *s, int64_t job) {
    int64_t option = s->option[job];
    for (int64_t index = p->rect_first[option]; index < p->rect_first[option + 1]; index++) {
        const Rect *r = &p->rect[index];
        int64_t begin = wrapped(p, s->start[job] + r->offset);
        if (!overloaded(p, s, r->lane, begin, r->length))
            continue;
        int64_t first = p->owner_first[r->lane];
        for (int64_t place = first; place < first + s->owners[r->lane]; place++) {
            Owner other = s->owner[place];
            int64_t gap = other.begin - begin;
            if (gap < 0)
                gap += p->hyperperiod;
            if (gap < r->length || p->hyperperiod - gap < other.length)
                heat_up(s, p->job_entry[other.mark / s->max_rects]);
        }
    }
}

/* Remember the entries that have windows, demands or chains in common with jobs [begin, end) of a task. */
static void heat_up_partners(const Arrays *p, State *s, int64_t task, int64_t begin, int64_t end) {
    for (int64_t index = p->partner_first[task]; index < p->partner_first[task + 1]; index++)
        heat_up_task(p, s, p->partner[index].task);
    for (int64_t job = begin; job < end; job++) {
        if (p->demand_job[job] >= 0)
            heat_up(s, p->job_entry[p->demand_job[job]]);
        for (int64_t index = p->dependent_first[job]; index < p->dependent_first[job + 1]; index++)
            heat_up(s, p->job_entry[p->dependent[index]]);
    }
    for (int64_t index = p->task_chain_first[task]; index < p->task_chain_first[task + 1]; index++) {
        int64_t chain = p->task_chain[index];
        for (int64_t member = p->chain_first[chain]; member < p->chain_first[chain + 1]; member++)
            heat_up_task(p, s, p->chain_task[member]);
    }
}

/* The entry to move next: the next to construct, one in conflict, or any. */
static Pick pick(const Arrays *p, State *s) {
    Registers *at = s->registers;
    if (at->inserted < p->entries)
        return (Pick){p->construction[at->inserted], -1};
    if (draw(s, 1024) < (p->rows > 0 ? HOT_SHARE_WITH_WINDOWS : HOT_SHARE) && is_on(s, PICK_CONFLICTS)) {
        while (at->hot > 0) {
            int64_t entry = s->hot[draw(s, at->hot)];
            int64_t begin = p->entry_job[entry], end = p->entry_job[entry + 1];
            for (int64_t job = begin; job < end; job++)
                if (lane_conflict(p, s, job))
                    return (Pick){entry, job};
            int64_t task = p->job_task[begin];
            if (p->task_coupled[task] == 1 && side_cost(p, s, task, begin, end) > 0)
                return (Pick){entry, -1};
            cool_down(s, entry);
        }
    }
    return (Pick){p->construction[at->frozen + draw(s, p->entries - at->frozen)], -1};
}

enum {
    /* Steps of a profile that the search for a gap looks at. */
    GAP_STEPS = 24,
    /* Draws, of 1024, that aim at a gap for an access phase if the job has any: the tighter places are there. The first
     * is for tasks alone, the second for tasks coupled with others. */
    ACCESS_SHARE = 800,
    ACCESS_SHARE_IN_WINDOWS = 500,
    /* Draws, of 128: those below the first bound aim at a window where there is one, and so on; the rest go anywhere. */
    WAYS = 128,
    TO_WINDOWS = 32,
    TO_GAPS = 92,
    TO_STEPS = 116,
    TO_NEARBY = 122,
};

static inline int64_t options_of(const Arrays *p, int64_t task) { return p->task_option[task + 1] - p->task_option[task]; }

/* `start` or, half of the time, the next one up to `furthest` later at which a job of the task fits. */
static int64_t nudged(const Arrays *p, State *s, int64_t task, int64_t start, int64_t furthest) {
    if (furthest > 0 && draw(s, 2) == 0) {
        int64_t option = p->task_option[task] + draw(s, options_of(p, task));
        int64_t shift = slide(p, s, option, start, furthest);
        if (shift > 0)
            return modulo(start + shift, p->hyperperiod);
    }
    return start;
}

/* A start inside some precedence window of the task, or -1 if the partner is not placed. */
static int64_t aim_at_window(const Arrays *p, State *s, int64_t task) {
    int64_t first = p->partner_first[task];
    const Partner *w = &p->partner[first + draw(s, p->partner_first[task + 1] - first)];
    int64_t jobs = p->task_job[w->task + 1] - p->task_job[w->task];
    if (jobs == 0)
        return -1;
    int64_t job = p->task_job[w->task] + draw(s, jobs);
    if (s->start[job] < 0)
        return -1;
    int64_t room = draw(s, w->room + 1);
    int64_t lag = w->lag + room;
    if (w->is_after == 1) {
        if (w->from_end == 1)
            lag += p->option_wcet[s->option[job]];
        return nudged(p, s, task, modulo(s->start[job] + lag, p->hyperperiod), w->room - room);
    }
    if (w->from_end == 1)
        lag += p->option_wcet[p->task_option[task]];
    return nudged(p, s, task, modulo(s->start[job] - lag, p->hyperperiod), room);
}

static int64_t anywhere(const Arrays *p, State *s) { return draw(s, p->hyperperiod); }

/* Some rectangle of some option of the task; NULL if the option has none. */
static const Rect *drawn_rect(const Arrays *p, State *s, int64_t task) {
    int64_t option = p->task_option[task] + draw(s, options_of(p, task));
    int64_t first = p->rect_first[option], rects = p->rect_first[option + 1] - first;
    if (rects == 0)
        return NULL;
    int64_t index = first + draw(s, rects);
    int64_t share = p->task_coupled[task] == 1 ? ACCESS_SHARE_IN_WINDOWS : ACCESS_SHARE;
    if (rects > 1 && draw(s, 1024) < share)
        index = first + 1 + draw(s, rects - 1); /* the first is of units */
    return &p->rect[index];
}

/* A start that puts a rectangle at a breakpoint of its lane: after it where there is room, else before it. */
static int64_t at_step(const Arrays *p, const State *s, const Rect *r, int64_t index) {
    bool has_room = s->step[index].level <= p->lane_capacity[r->lane] - r->height;
    int64_t start = has_room ? s->step[index].begin : s->step[index].begin - r->length;
    return modulo(start - r->offset, p->hyperperiod);
}

/* A start that puts a rectangle of the task at any step of its lane. */
static int64_t aim_at_step(const Arrays *p, State *s, int64_t task) {
    const Rect *r = drawn_rect(p, s, task);
    if (r == NULL)
        return anywhere(p, s);
    int64_t index = p->lane_first[r->lane] + draw(s, s->edges[r->lane]);
    return at_step(p, s, r, index);
}

/* A start that puts a rectangle of the task at an edge of a gap that is long enough, if one is near some step. */
static int64_t aim_at_gap(const Arrays *p, State *s, int64_t task, bool align_left) {
    const Rect *r = drawn_rect(p, s, task);
    if (r == NULL)
        return anywhere(p, s);
    int64_t threshold = p->lane_capacity[r->lane] - r->height;
    int64_t base = p->lane_first[r->lane], end = base + s->edges[r->lane];
    int64_t origin = base + draw(s, s->edges[r->lane]);
    int64_t here = origin, steps = GAP_STEPS;
    while (steps > 0) {
        for (; s->step[here].level > threshold && steps > 0; steps--)
            if (++here == end)
                here = base;
        int64_t begin = s->step[here].begin, free = 0;
        for (; s->step[here].level <= threshold && steps > 0; steps--) {
            free += s->step[here + 1].begin - s->step[here].begin;
            if (++here == end)
                here = base;
        }
        if (free >= r->length)
            return modulo((align_left ? begin : begin + free - r->length) - r->offset, p->hyperperiod);
    }
    return at_step(p, s, r, origin);
}

/* A start close to where the job was before the move. */
static int64_t aim_nearby(const Arrays *p, State *s, int64_t task, int64_t job) {
    int64_t near = most(1, p->task_period[task] >> 6);
    return modulo(s->old[job].start - near + draw(s, 2 * near + 1), p->hyperperiod);
}

/* A start to try for `job`, in one of the ways above; what is switched off leaves its share to the next. */
static int64_t candidate_start(const Arrays *p, State *s, int64_t task, int64_t job, bool fresh) {
    int64_t way = draw(s, WAYS);
    if (way < TO_WINDOWS && is_on(s, AIM_AT_WINDOW) && p->partner_first[task + 1] > p->partner_first[task]) {
        int64_t start = aim_at_window(p, s, task);
        if (start >= 0)
            return start;
    }
    if (way < TO_GAPS && is_on(s, AIM_AT_GAP))
        return aim_at_gap(p, s, task, (way & 1) == 1);
    if (way < TO_STEPS && is_on(s, AIM_AT_STEP))
        return aim_at_step(p, s, task);
    if (way < TO_NEARBY && is_on(s, AIM_NEARBY) && !fresh)
        return aim_nearby(p, s, task, job);
    return anywhere(p, s);
}

#endif
