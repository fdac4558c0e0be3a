/* The rule of chains (MODEL 3): worst reaction time and data age stay within their limits. */

#ifndef HALPIPE_CHAINS_H
#define HALPIPE_CHAINS_H

#include "placing.h"

typedef struct { int64_t time, job; } Met;

/* The earliest absolute start of a job of `task` at or after `time` and its job, or (NEVER, -1). */
static Met first_start(const Arrays *p, Placing x, int64_t task, int64_t time) {
    int64_t first = p->task_job[task], jobs = jobs_of(p, task);
    Range near = numbers_near(p, x, task, time);
    Met found = {NEVER, -1};
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t begin = time + modulo(x.start[job] - time, p->hyperperiod);
        if (begin < found.time)
            found = (Met){begin, job};
    }
    return found;
}

/* The latest absolute end of a job of `task` at or before `time` and its job, or (-NEVER, -1).
 *
 * Of jobs that end together, the one that started later is the newer. */
static Met last_end(const Arrays *p, Placing x, int64_t task, int64_t time) {
    int64_t first = p->task_job[task], jobs = jobs_of(p, task);
    Range near = numbers_near(p, x, task, time);
    Met found = {-NEVER, -1};
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t end = time - modulo(time - x.start[job] - p->option_wcet[x.option[job]], p->hyperperiod);
        if (end > found.time || (end == found.time && p->option_recency[x.option[job]] >
                                                          p->option_recency[x.option[found.job]]))
            found = (Met){end, job};
    }
    return found;
}

/* The worst reaction time of the chain in chain_task[begin:end], NEVER if nothing gets through. */
static int64_t worst_reaction(const Arrays *p, Placing x, int64_t begin, int64_t end) {
    int64_t task = p->chain_task[begin], worst = -1;
    for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++) {
        if (!is_running(p, x, job))
            continue;
        Met next = first_start(p, x, task, x.start[job] + 1);
        for (int64_t index = begin; index < end; index++) {
            if (index > begin)
                next = first_start(p, x, p->chain_task[index], next.time);
            if (next.job < 0)
                return NEVER;
            next.time += p->option_wcet[x.option[next.job]];
        }
        worst = most(worst, next.time - x.start[job]);
    }
    return worst >= 0 ? worst : NEVER;
}

/* The worst data age of the chain in chain_task[begin:end], NEVER if nothing gets through. */
static int64_t worst_age(const Arrays *p, Placing x, int64_t begin, int64_t end) {
    int64_t task = p->chain_task[end - 1], worst = -1;
    for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++) {
        if (!is_running(p, x, job))
            continue;
        int64_t time = x.start[job];
        for (int64_t index = end - 2; index >= begin; index--) {
            Met last = last_end(p, x, p->chain_task[index], time);
            if (last.job < 0)
                return NEVER;
            time = last.time - p->option_wcet[x.option[last.job]];
        }
        worst = most(worst, x.start[job] + p->option_wcet[x.option[job]] - time);
    }
    return worst >= 0 ? worst : NEVER;
}

static int64_t lateness(const Arrays *p, int64_t latency, int64_t limit) {
    return latency >= NEVER ? p->missing_cost : most(0, latency - limit) * p->unit_weight;
}

/* By how much a chain's worst reaction time and data age pass their limits (MODEL 3). */
static int64_t chain_cost(const Arrays *p, Placing x, int64_t chain) {
    int64_t begin = p->chain_first[chain], end = p->chain_first[chain + 1];
    for (int64_t index = begin; index < end; index++) {
        int64_t task = p->chain_task[index];
        for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++)
            if (x.start[job] < 0)
                return 0;
    }
    int64_t cost = 0;
    Limits limit = p->chain_limit[chain];
    if (limit.reaction >= 0)
        cost += lateness(p, worst_reaction(p, x, begin, end), limit.reaction);
    if (limit.age >= 0)
        cost += lateness(p, worst_age(p, x, begin, end), limit.age);
    return cost;
}

#endif
