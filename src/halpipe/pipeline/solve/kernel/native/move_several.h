/* Moves of several entries: of tightly linked tasks as one, and of two entries into each other's places.
 *
 * Of two tasks whose window is short, neither can leave alone: wherever it goes, the window is broken until the other
 * comes after it, and no temperature at which the rest of the schedule settles lets that happen. Shifted by the same
 * time, they keep the windows between them. Where little is idle, an entry alone has nowhere to go, either: the gaps are
 * shorter than it is. Two of nearly the same length change places for what they differ by. */

#ifndef HALPIPE_MOVE_SEVERAL_H
#define HALPIPE_MOVE_SEVERAL_H

#include "conflicts.h"
#include "move_entry.h"

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

enum {
    /* Entries that are drawn as partners: the one that is most like it in length is taken. */
    PARTNERS = 8,
    /* Each of the two begins where the other one did, or ends where it did. */
    WAYS_TO_SWAP = 4,
    /* They are tried at a temperature divided by 2**4: other moves keep the best of many places that were made to fit, and
     * at the same temperature these four would disturb more than those put in order. */
    COLDER = 4,
};

static int64_t draw_cold_noise(State *s, const int64_t *noise) { return draw_noise(s, noise) >> COLDER; }

typedef struct { int64_t entry, task, begin, end; } Side; /* jobs [begin, end) of one of the two */

static Side side_of(const Arrays *p, int64_t entry) {
    int64_t begin = p->entry_job[entry];
    return (Side){entry, p->job_task[begin], begin, p->entry_job[entry + 1]};
}

/* Whether an entry is a whole periodic task that may begin at any time, and minds nothing but lanes. */
static bool may_swap(const Arrays *p, const State *s, int64_t entry) {
    int64_t task = p->job_task[p->entry_job[entry]];
    bool is_free = p->entry_offset[entry] < 0 && s->hint[entry] != FROZEN_HINT;
    return is_free && p->task_cyclic[task] == 1 && p->task_coupled[task] == 0;
}

/* An entry with the same period that may change places with `entry`; -1 if none of those drawn may. */
static int64_t drawn_partner(const Arrays *p, State *s, int64_t entry) {
    int64_t job = p->entry_job[entry], period = p->task_period[p->job_task[job]];
    int64_t length = p->option_wcet[s->option[job]], found = -1, nearest = NEVER;
    for (int number = 0; number < PARTNERS; number++) {
        int64_t other = draw(s, p->entries), its_job = p->entry_job[other];
        if (other == entry || p->task_period[p->job_task[its_job]] != period || !may_swap(p, s, other))
            continue;
        int64_t longer = p->option_wcet[s->option[its_job]] - length;
        if (most(longer, -longer) < nearest) {
            nearest = most(longer, -longer);
            found = other;
        }
    }
    return found;
}

/* Place one at `phase` and then the other one at `its_phase`; return the lane cost, `limit` or more when abandoned. */
static int64_t try_both(const Arrays *p, State *s, const int64_t *noise, Side one, int64_t phase, Side other,
                        int64_t its_phase, int64_t limit) {
    int64_t cost = try_entry(p, s, noise, one.task, one.begin, one.end, phase, limit);
    if (cost >= limit)
        return cost;
    cost = enter(p, s, one.begin, one.end);
    if (cost < limit)
        cost += try_entry(p, s, noise, other.task, other.begin, other.end, its_phase, limit - cost);
    leave(p, s, one.begin, one.end);
    return cost;
}

/* Try the ways to change places and keep one of them, or the old places, whose score is `best`. */
static void sample_swaps(const Arrays *p, State *s, const int64_t *noise, Side one, Side other, int64_t best) {
    int64_t period = p->task_period[one.task];
    int64_t here = s->old[one.begin].phase, there = s->old[other.begin].phase;
    int64_t longer = p->option_wcet[s->old[one.begin].option] - p->option_wcet[s->old[other.begin].option];
    for (int way = 0; way < WAYS_TO_SWAP; way++) {
        int64_t limit = best + draw_cold_noise(s, noise);
        int64_t phase = modulo((way & 1) == 0 ? there : there - longer, period);
        int64_t its_phase = modulo((way & 2) == 0 ? here : here + longer, period);
        int64_t cost = try_both(p, s, noise, one, phase, other, its_phase, limit);
        if (cost < limit) {
            best -= limit - cost;
            keep(s, one.begin, one.end);
            keep(s, other.begin, other.end);
            if (cost == 0)
                break;
        }
    }
}

/* Swap an entry with another one, and account for the cost; false if there is none to swap with. */
static bool move_swap(const Arrays *p, State *s, const int64_t *noise, int64_t entry) {
    int64_t partner = may_swap(p, s, entry) ? drawn_partner(p, s, entry) : -1;
    if (partner < 0)
        return false;
    Side one = side_of(p, entry), other = side_of(p, partner);
    int64_t before = take_out(p, s, one.begin, one.end);
    before += take_out(p, s, other.begin, other.end);
    int64_t best = before - draw_cold_noise(s, noise);
    sample_swaps(p, s, noise, one, other, best);
    int64_t after = put_back(p, s, one.begin, one.end);
    after += put_back(p, s, other.begin, other.end);
    s->registers->cost += after - before;
    if (after > 0 && (has_moved(s, one.begin, one.end) || has_moved(s, other.begin, other.end))) {
        heat_up_around(p, s, one.entry, one.begin, one.end);
        heat_up_around(p, s, other.entry, other.begin, other.end);
    }
    return true;
}

#endif
