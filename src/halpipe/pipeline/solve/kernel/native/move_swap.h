/* The move of two entries into each other's places.
 *
 * Where little is idle, an entry alone has nowhere to go: the gaps are shorter than it is, and to lie on another one costs
 * more than any temperature lets happen at which the rest stays in place. Two of nearly the same length change places
 * for what they differ by. */

#ifndef HALPIPE_MOVE_SWAP_H
#define HALPIPE_MOVE_SWAP_H

#include "move_entry.h"

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
