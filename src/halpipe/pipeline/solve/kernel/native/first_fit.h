/* The first place at which a whole entry costs nothing: what a construction asks for, one entry after the other.
 *
 * Nothing here is drawn. A place is free on all lanes, and breaks none of the rules between the jobs that are placed. */

#ifndef HALPIPE_FIRST_FIT_H
#define HALPIPE_FIRST_FIT_H

#include "move_entry.h"

enum {
    /* Steps of profiles that the search for one place of one job looks at. */
    FIT_STEPS = 1 << 30,
    /* Places that are free on all lanes, but break another rule, before an entry is given up. */
    FIT_TRIALS = 256,
};

/* Stands for a place that is free, but breaks rules between jobs. */
#define REFUSED (NEVER + 1)

/* What a bound task chooses once, and how late each of its jobs may start. */
typedef struct { int64_t set, jitter; } Choice;

/* How much later than `phase` a job has to be to fit on all lanes, 0 if it does; more than `furthest` if it never does.
 * Where it fits, its option, start and phase are set. */
static int64_t settle_first(const Arrays *p, State *s, int64_t task, int64_t job, int64_t phase, Choice choice,
                            int64_t furthest) {
    int64_t number = p->task_cyclic[task] == 1 ? job - p->task_job[task] : 0;
    int64_t start = modulo(phase + number * p->task_period[task], p->hyperperiod), advance = furthest + 1;
    for (int64_t option = p->task_option[task]; option < p->task_option[task + 1]; option++) {
        if (!is_of_set(p, option, choice.set))
            continue;
        int64_t late = least(p->option_late[option], choice.jitter);
        int64_t shift = slide_within(p, s, option, start, late + advance - 1, FIT_STEPS);
        if (shift < 0)
            continue;
        if (shift <= late) {
            s->option[job] = option;
            s->start[job] = modulo(start + shift, p->hyperperiod);
            s->phase[job] = phase + shift;
            return 0;
        }
        advance = shift - late;
    }
    return advance;
}

/* The first phase in [phase, end] at which all jobs fit on all lanes, or NEVER; sets their places. */
static int64_t first_free(const Arrays *p, State *s, int64_t task, int64_t begin, int64_t end, int64_t phase,
                          int64_t last, Choice choice) {
    bool is_fixed = p->entry_offset[p->job_entry[begin]] >= 0;
    int64_t turn = p->task_cyclic[task] == 1 ? p->task_period[task] : p->hyperperiod, job = begin;
    for (int64_t fitting = 0; fitting < end - begin;) {
        int64_t base = is_fixed ? phase : modulo(phase, turn);
        int64_t advance = settle_first(p, s, task, job, base, choice, last - phase);
        phase += advance;
        if (phase > last)
            return NEVER;
        if (advance > 0) {
            fitting = 0;
            continue;
        }
        fitting++;
        if (++job == end)
            job = begin;
    }
    return phase;
}

/* By how much a job's windows of all rows, or of those that name task `only`, are missed by at least. */
static int64_t widest_miss(const Arrays *p, Placing x, int64_t job, int64_t only) {
    int64_t widest = 0;
    if (!is_running(p, x, job))
        return 0;
    Range rows = rows_of(p, x.option[job], only);
    for (int64_t index = rows.low; index < rows.high; index++) {
        int64_t distance = row_distance(p, x, &p->row[index], job);
        if (distance < NEVER)
            widest = most(widest, distance);
    }
    return widest;
}

/* How far an entry that breaks rules between jobs is to be moved before it is worth to look again: never so far that a
 * window is passed by; a chain may be. */
static int64_t step_over(const Arrays *p, const State *s, int64_t task, int64_t begin, int64_t end) {
    Placing x = placing(s);
    int64_t step = 1;
    for (int64_t job = begin; job < end; job++)
        step = most(step, widest_miss(p, x, job, -1));
    for (int64_t index = p->consumer_first[task]; index < p->consumer_first[task + 1]; index++) {
        int64_t consumer = p->consumer[index];
        for (int64_t job = p->task_job[consumer]; job < p->task_job[consumer + 1]; job++)
            step = most(step, widest_miss(p, x, job, task));
    }
    for (int64_t index = p->task_chain_first[task]; index < p->task_chain_first[task + 1]; index++) {
        int64_t cost = chain_cost(p, x, p->task_chain[index]);
        if (cost < p->missing_cost)
            step = most(step, cost / p->unit_weight);
    }
    return step;
}

/* Take placed jobs away, as if they had never been. */
static void take_away(const Arrays *p, State *s, int64_t begin, int64_t end) {
    leave(p, s, begin, end);
    for (int64_t job = begin; job < end; job++)
        s->start[job] = -1;
}

static bool has_jitter(const Arrays *p, int64_t task) {
    for (int64_t option = p->task_option[task]; option < p->task_option[task + 1]; option++)
        if (p->option_late[option] > 0)
            return true;
    return false;
}

/* The first phase in [phase, last] at which an entry costs nothing on a unit set, which is then placed; or NEVER, and
 * REFUSED where it would fit on the lanes, but breaks rules between jobs. */
static int64_t fit_on_set(const Arrays *p, State *s, int64_t entry, int64_t phase, int64_t last, Choice choice) {
    int64_t begin = p->entry_job[entry], end = p->entry_job[entry + 1], task = p->job_task[begin];
    int64_t answer = NEVER;
    for (int trial = 0; trial < FIT_TRIALS; trial++) {
        phase = first_free(p, s, task, begin, end, phase, last, choice);
        if (phase == NEVER)
            break;
        int64_t cost = enter(p, s, begin, end), step = 1;
        if (cost == 0 && p->task_coupled[task] == 1) {
            cost = side_cost(p, s, task, begin, end);
            if (cost > 0)
                step = step_over(p, s, task, begin, end);
        }
        if (cost == 0)
            return phase;
        leave(p, s, begin, end);
        phase += step;
        answer = REFUSED;
    }
    for (int64_t job = begin; job < end; job++)
        s->start[job] = -1;
    return answer;
}

/* How late the last job of an entry starts; all of them are counted from where the first period begins. */
static int64_t last_start(const Arrays *p, const State *s, int64_t entry, int64_t phase) {
    int64_t begin = p->entry_job[entry], latest = s->phase[begin], task = p->job_task[begin];
    int64_t turn = p->task_cyclic[task] == 1 ? p->task_period[task] : p->hyperperiod;
    for (int64_t job = begin; job < p->entry_job[entry + 1]; job++)
        latest = most(latest, s->phase[job]);
    return latest + (p->entry_offset[entry] < 0 ? phase - modulo(phase, turn) : 0);
}

/* Place an entry from a phase in [earliest, last] on, where it costs nothing and its last job starts first: on one of
 * the unit sets of a bound task, without jitter or with it. Return the phase, NEVER or REFUSED. */
static int64_t fit(const Arrays *p, State *s, int64_t entry, int64_t earliest, int64_t last) {
    int64_t begin = p->entry_job[entry], end = p->entry_job[entry + 1], task = p->job_task[begin];
    int64_t sets = p->task_sets[task], best = NEVER, phase = NEVER, refusal = NEVER, found;
    Choice chosen = {ANY_SET, 0};
    for (int64_t set = 0; set < sets; set++) {
        for (int jitter = 0; jitter < 2; jitter++) {
            Choice choice = {sets == 1 ? ANY_SET : set, jitter ? NEVER : 0};
            if (jitter && (best <= earliest || !has_jitter(p, task)))
                break;
            found = fit_on_set(p, s, entry, earliest, least(last, best - 1), choice);
            if (found >= NEVER) {
                refusal = most(refusal, found);
                continue;
            }
            int64_t latest = last_start(p, s, entry, found);
            if (latest < best) {
                best = latest;
                phase = found;
                chosen = choice;
            }
            take_away(p, s, begin, end);
        }
    }
    return phase == NEVER ? refusal : fit_on_set(p, s, entry, phase, phase, chosen);
}

#endif
