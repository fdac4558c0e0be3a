/* The move of tightly linked tasks together: shifted by the same time, they keep the windows between them.
 *
 * Of two tasks whose window is short, neither can leave alone: wherever it goes, the window is broken until the other
 * comes after it, and no temperature at which the rest of the schedule settles lets that happen. */

#ifndef HALPIPE_MOVE_CLUSTER_H
#define HALPIPE_MOVE_CLUSTER_H

#include "conflicts.h"

enum {
    /* Shifts to look at in one move. */
    CANDIDATES_OF_CLUSTERS = 16,
    /* Windows of at most this part of a task's period link it tightly. */
    TIGHT = 8,
    /* Windows of at most this part of it link it rigidly: such tasks are one body, however many they are. */
    RIGID = 128,
};

static bool is_listed(const State *s, int64_t size, int64_t task) {
    for (int64_t place = 0; place < size; place++)
        if (s->cluster[place] == task)
            return true;
    return false;
}

/* Whether all jobs of a task may go anywhere together, and windows are all that couples it with others. */
static bool may_shift(const Arrays *p, const State *s, int64_t task) {
    int64_t begin = p->task_job[task], end = p->task_job[task + 1];
    if (begin == end || p->task_cyclic[task] == 0 || p->task_first[task] == 1)
        return false;
    if (p->task_chain_first[task + 1] > p->task_chain_first[task])
        return false;
    if (p->dependent_first[end] > p->dependent_first[begin])
        return false;
    int64_t entry = p->job_entry[begin];
    return p->entry_offset[entry] < 0 && s->hint[entry] != FROZEN_HINT;
}

static inline bool is_rigid(const Arrays *p, int64_t task, const Partner *w) { return w->room * RIGID <= p->task_period[task]; }

/* Whether a task is in a body of several. */
static bool is_in_body(const Arrays *p, int64_t task) {
    for (int64_t index = p->partner_first[task]; index < p->partner_first[task + 1]; index++)
        if (is_rigid(p, task, &p->partner[index]))
            return true;
    return false;
}

/* List a body, `task` and all that is rigidly linked to it, from `size` on; return where it ends. */
static int64_t list_body(const Arrays *p, State *s, int64_t size, int64_t task) {
    int64_t end = size;
    s->cluster[end++] = task;
    for (int64_t place = size; place < end; place++) {
        int64_t member = s->cluster[place];
        for (int64_t index = p->partner_first[member]; index < p->partner_first[member + 1]; index++) {
            const Partner *w = &p->partner[index];
            if (is_rigid(p, member, w) && !is_listed(s, end, w->task))
                s->cluster[end++] = w->task;
        }
    }
    return end;
}

/* List the body of `task` and, up to the size of a cluster, the bodies that are tightly linked to it, in `cluster`; return
 * how many tasks these are, 0 if they cannot be moved. */
static int64_t gather_cluster(const Arrays *p, State *s, int64_t task) {
    int64_t size = list_body(p, s, 0, task);
    for (int64_t place = 0; place < size; place++) {
        int64_t member = s->cluster[place];
        if (!may_shift(p, s, member))
            return 0;
        for (int64_t index = p->partner_first[member]; index < p->partner_first[member + 1]; index++) {
            const Partner *w = &p->partner[index];
            if (size >= CLUSTER || w->room * TIGHT > p->task_period[member] || is_listed(s, size, w->task))
                continue;
            int64_t end = list_body(p, s, size, w->task);
            if (end <= CLUSTER)
                size = end;
        }
    }
    return size;
}

/* Let the starts and phases of a cluster be `shift` later than the old ones. */
static void shift_cluster(const Arrays *p, State *s, int64_t size, int64_t shift) {
    for (int64_t place = 0; place < size; place++) {
        int64_t begin = p->task_job[s->cluster[place]], end = p->task_job[s->cluster[place] + 1];
        /* A whole turn less, for all jobs of a task alike, keeps phases from growing without end. */
        int64_t turn = s->old[begin].phase + shift >= p->hyperperiod ? p->hyperperiod : 0;
        for (int64_t job = begin; job < end; job++) {
            s->start[job] = modulo(s->old[job].start + shift, p->hyperperiod);
            s->phase[job] = s->old[job].phase + shift - turn;
        }
    }
}

static int64_t enter_cluster(const Arrays *p, State *s, int64_t size) {
    int64_t cost = 0;
    for (int64_t place = 0; place < size; place++)
        cost += enter(p, s, p->task_job[s->cluster[place]], p->task_job[s->cluster[place] + 1]);
    return cost;
}

/* The distances of all members from windows, those between them twice: a shift does not change them. */
static int64_t windows_of_cluster(const Arrays *p, const State *s, int64_t size) {
    int64_t cost = 0;
    for (int64_t place = 0; place < size; place++) {
        int64_t task = s->cluster[place];
        cost += side_cost(p, s, task, p->task_job[task], p->task_job[task + 1]);
    }
    return cost;
}

/* What the cluster costs when shifted; `limit` or more as soon as it is known to cost that.
 *
 * What its members cost by being in the same place is found last, by entering them one after the other. */
static int64_t shifted_cost(const Arrays *p, State *s, int64_t size, int64_t shift, int64_t limit) {
    int64_t cost = 0;
    for (int64_t place = 0; place < size; place++) {
        int64_t task = s->cluster[place];
        for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++) {
            int64_t start = modulo(s->old[job].start + shift, p->hyperperiod);
            cost += option_cost(p, s, s->option[job], start, limit - cost);
            if (cost >= limit)
                return cost;
        }
    }
    shift_cluster(p, s, size, shift);
    int64_t windows = windows_of_cluster(p, s, size);
    if (cost + windows >= limit)
        return cost + windows;
    cost = enter_cluster(p, s, size);
    for (int64_t place = 0; place < size; place++)
        leave(p, s, p->task_job[s->cluster[place]], p->task_job[s->cluster[place] + 1]);
    return cost + windows;
}

/* Draw shifts for a cluster that has been taken out; return the one to keep, or 0 for the old placement. */
static int64_t sample_shifts(const Arrays *p, State *s, const int64_t *noise, int64_t size, int64_t before) {
    int64_t best = before - draw_noise(s, noise);
    int64_t chosen = 0;
    for (int attempt = 0; attempt < CANDIDATES_OF_CLUSTERS; attempt++) {
        int64_t task = s->cluster[draw(s, size)];
        int64_t job = p->task_job[task] + draw(s, p->task_job[task + 1] - p->task_job[task]);
        int64_t start = candidate_start(p, s, task, job, false);
        int64_t shift = modulo(start - s->old[job].start, p->hyperperiod);
        int64_t limit = best + draw_noise(s, noise);
        int64_t cost = shifted_cost(p, s, size, shift, limit);
        if (cost < limit) {
            best -= limit - cost;
            chosen = shift;
            if (cost == 0)
                break;
        }
    }
    return chosen;
}

/* Remember the entries that may be in conflict after a move of the cluster. */
static void heat_up_cluster(const Arrays *p, State *s, int64_t size) {
    for (int64_t place = 0; place < size; place++) {
        int64_t task = s->cluster[place], begin = p->task_job[task], end = p->task_job[task + 1];
        heat_up_task(p, s, task);
        for (int64_t job = begin; job < end; job++)
            heat_up_overlapped(p, s, job);
        heat_up_partners(p, s, task, begin, end);
    }
}

/* Make one heat-bath move of the cluster and account for its cost. */
static void move_cluster(const Arrays *p, State *s, const int64_t *noise, int64_t size) {
    int64_t before = windows_of_cluster(p, s, size);
    for (int64_t place = 0; place < size; place++)
        before += take_out(p, s, p->task_job[s->cluster[place]], p->task_job[s->cluster[place] + 1]);
    int64_t shift = sample_shifts(p, s, noise, size, before);
    shift_cluster(p, s, size, shift);
    int64_t after = enter_cluster(p, s, size);
    after += windows_of_cluster(p, s, size);
    s->registers->cost += after - before;
    if (after > 0)
        heat_up_cluster(p, s, size);
}

#endif
