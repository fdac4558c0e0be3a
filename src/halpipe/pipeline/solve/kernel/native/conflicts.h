/* The list of entries that may be in conflict, and the choice of the entry to move next. */

#ifndef HALPIPE_CONFLICTS_H
#define HALPIPE_CONFLICTS_H

#include "lanes.h"
#include "side_costs.h"

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

#endif
