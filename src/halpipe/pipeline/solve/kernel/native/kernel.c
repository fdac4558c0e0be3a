/* The annealing kernel: heat-bath moves of whole tasks or single jobs, in integers only.
 *
 * One move takes an entry (a periodic task, one of its jobs, or a demand job) out of the schedule, draws candidate
 * placements, samples one of them or the old one with probability proportional to exp(-cost / T), and puts it back.
 * Sampling is by the Gumbel-max trick: the argument of min(cost - T * G), with G from a table of integers. The noise of
 * a candidate is drawn before its evaluation, which may therefore stop as soon as the candidate cannot win, with the
 * same result. A candidate of cost zero ends the draw. Entries in conflict are drawn most of the time.
 *
 * All state is in arrays, so that the search can stop after any number of moves and go on later with the same outcome:
 * the bytes depend on the problem and the seed alone. Draws therefore stand in statements of their own: C does not say
 * which argument of a call, or side of a sum, comes first.
 *
 * This is the only file that is compiled; the others are parts of it. */

#include "cycles.h"
#include "first_fit.h"
#include "move_several.h"
#include "move_entry.h"

/* One move in so many of a task that is coupled with others takes along what is tightly linked to it; of one that is in a
 * body, all but one in so many: alone, it can only break the body apart. */
enum { CLUSTERS = 4 };

/* One move in so many lets an entry change places with another one, if it may; but not in the first cycles, of which most
 * sets need no more, and not where windows are what is hard. */
enum { SWAPS = 2 };

/* Remember the current placement if it is complete and the best so far. */
static void note_best(const Arrays *p, State *s) {
    Registers *at = s->registers;
    if (at->inserted == p->entries && at->cost < at->best) {
        at->best = at->cost;
        for (int64_t job = 0; job < p->jobs; job++) {
            s->best_start[job] = s->start[job];
            s->best_option[job] = s->option[job];
        }
    }
}

/* Gather what moves with a task, if it is coupled with others and they move together this time; return how many. */
static int64_t gather(const Arrays *p, State *s, int64_t task) {
    if (p->task_coupled[task] == 0)
        return 1;
    int64_t chance = draw(s, CLUSTERS);
    bool is_joint = is_in_body(p, task) ? chance > 0 : chance == 0;
    return is_joint && is_on(s, MOVE_CLUSTER) ? gather_cluster(p, s, task) : 1;
}

/* Whether the next move is to let two entries change places. */
static bool is_swap(const Arrays *p, State *s) {
    bool is_time = s->registers->cycle > FEW_CYCLES && p->rows == 0 && s->registers->inserted == p->entries;
    return is_time && is_on(s, MOVE_SWAP) && draw(s, SWAPS) == 0;
}

/* Make one heat-bath move and account for its cost: of an entry, of it and another one that change places, or of it and
 * what is tightly linked to it. */
static void move(const Arrays *p, State *s, const int64_t *noise) {
    Pick next = pick(p, s);
    bool is_complete = s->registers->inserted == p->entries;
    int64_t size = is_complete ? gather(p, s, p->job_task[p->entry_job[next.entry]]) : 1;
    if (size > 1)
        move_cluster(p, s, noise, size);
    else if (!is_swap(p, s) || !move_swap(p, s, noise, next.entry))
        move_entry(p, s, noise, next.entry, next.job);
    note_best(p, s);
}

/* Make up to `moves` moves; stop early when the schedule is complete and its cost is zero. Return the cost. */
static int64_t anneal(const Arrays *p, State *s, const int64_t *noise, int64_t moves) {
    Registers *at = s->registers;
    for (; moves > 0; moves--) {
        if (at->inserted == p->entries && at->cost == 0)
            break;
        at->moves++;
        next_temperature(p, s);
        move(p, s, noise);
    }
    return at->cost;
}

/* Take the complete placement in `start`, `option` and `phase` as the current one; return its cost.
 *
 * What is built up anew after that tries the same times first. */
static int64_t load(const Arrays *p, State *s) {
    for (int64_t job = 0; job < p->jobs; job++)
        put(p, s, job);
    s->registers->inserted = p->entries;
    for (int64_t entry = 0; entry < p->entries; entry++) {
        heat_up(s, entry);
        if (s->hint[entry] != FROZEN_HINT) {
            int64_t job = p->entry_job[entry];
            s->hint[entry] = modulo(s->phase[job], p->task_period[p->job_task[job]]);
        }
    }
    s->registers->cost = total_cost(p, s);
    note_best(p, s);
    return s->registers->cost;
}

/* ------------------------------------------------------------------------------------ What Python calls (kernel.py). */

EXPORTED int64_t halpipe_anneal(const Arrays *p, State *s, const int64_t *noise, int64_t moves) {
    return anneal(p, s, noise, moves);
}

EXPORTED int64_t halpipe_load(const Arrays *p, State *s) { return load(p, s); }

EXPORTED int64_t halpipe_total_cost(const Arrays *p, const State *s) { return total_cost(p, s); }

EXPORTED int64_t halpipe_fit(const Arrays *p, State *s, int64_t entry, int64_t earliest, int64_t last) {
    return fit(p, s, entry, earliest, last);
}

EXPORTED void halpipe_remove(const Arrays *p, State *s, int64_t entry) {
    take_away(p, s, p->entry_job[entry], p->entry_job[entry + 1]);
}

EXPORTED void halpipe_put(const Arrays *p, State *s, int64_t job) { put(p, s, job); }

EXPORTED int64_t halpipe_worst_reaction(const Arrays *p, const State *s, int64_t chain) {
    return worst_forward(p, best_placing(s), chain, true);
}

EXPORTED int64_t halpipe_worst_age(const Arrays *p, const State *s, int64_t chain) {
    return worst_age(p, best_placing(s), chain);
}

/* Parts of the above, for the tests. */

EXPORTED void halpipe_move(const Arrays *p, State *s, const int64_t *noise) { move(p, s, noise); }

EXPORTED void halpipe_next_temperature(const Arrays *p, State *s) { next_temperature(p, s); }

EXPORTED void halpipe_restart(const Arrays *p, State *s) { restart(p, s); }

EXPORTED int64_t halpipe_luby(int64_t number) { return luby(number); }

EXPORTED int64_t halpipe_gather_cluster(const Arrays *p, State *s, int64_t task) { return gather_cluster(p, s, task); }

EXPORTED void halpipe_move_cluster(const Arrays *p, State *s, const int64_t *noise, int64_t size) {
    move_cluster(p, s, noise, size);
}

EXPORTED int64_t halpipe_move_swap(const Arrays *p, State *s, const int64_t *noise, int64_t entry) {
    return move_swap(p, s, noise, entry);
}

/* What the sources hashed to when this was built: a library left over from other sources is refused. */
#ifndef FINGERPRINT
#define FINGERPRINT ""
#endif
EXPORTED const char halpipe_fingerprint[] = FINGERPRINT;
