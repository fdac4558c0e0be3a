/* The rule of chains (MODEL 3): worst reaction time and data age stay within their limits. */

#ifndef HALPIPE_CHAINS_H
#define HALPIPE_CHAINS_H

#include "placing.h"

typedef struct { int64_t time, job; } Met;

/* The earliest absolute instant at or after `time` at which a job of `task` reads, and the job, or (NEVER, -1). */
static Met first_read(const Arrays *p, Placing x, int64_t task, int64_t time) {
    int64_t first = p->task_job[task], jobs = jobs_of(p, task);
    Range near = numbers_near(p, x, task, time);
    Met found = {NEVER, -1};
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t begin = time + modulo(read_of(p, x, job) - time, p->hyperperiod);
        if (begin < found.time)
            found = (Met){begin, job};
    }
    return found;
}

/* The latest absolute instant at or before `time` at which a job of `task` writes, and the job, or (-NEVER, -1).
 *
 * Of jobs that write together, the one that read later is the newer. */
static Met last_write(const Arrays *p, Placing x, int64_t task, int64_t time) {
    int64_t first = p->task_job[task], jobs = jobs_of(p, task);
    Range near = numbers_near(p, x, task, time);
    Met found = {-NEVER, -1};
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t end = time - modulo(time - read_of(p, x, job) - held_for(p, x, job), p->hyperperiod);
        if (end > found.time || (end == found.time && p->option_recency[x.option[job]] >
                                                          p->option_recency[x.option[found.job]]))
            found = (Met){end, job};
    }
    return found;
}

/* From the instant at which a job reads to that of an event of it. */
static int64_t event_of(const Arrays *p, Placing x, int64_t job, int64_t event) {
    int64_t start = modulo(x.start[job] - read_of(p, x, job), p->hyperperiod);
    if (event == AT_RELEASE)
        return start - modulo(x.start[job] - release_of(p, job), p->hyperperiod);
    return event == AT_END ? start + p->option_wcet[x.option[job]] : start;
}

/* From the instant at which a job reads to that from which, or to which, the latencies of a chain count. */
static int64_t from_event(const Arrays *p, Placing x, int64_t chain, int64_t job) {
    int64_t event = p->chain_event[chain].from;
    return event == AT_DATA ? 0 : event_of(p, x, job, event);
}

static int64_t to_event(const Arrays *p, Placing x, int64_t chain, int64_t job) {
    int64_t event = p->chain_event[chain].to;
    return event == AT_DATA ? held_for(p, x, job) : event_of(p, x, job, event);
}

/* The time from a job of the first task of a chain to the last job that its data, or a stimulus just after it read if it
 * is `missed`, lead to; NEVER if there is none. */
static int64_t forward(const Arrays *p, Placing x, int64_t chain, int64_t job, bool missed) {
    int64_t begin = p->chain_first[chain], read = read_of(p, x, job);
    Met next = missed ? first_read(p, x, p->chain_task[begin], read + 1) : (Met){read, job};
    for (int64_t index = begin + 1; index < p->chain_first[chain + 1] && next.job >= 0; index++)
        next = first_read(p, x, p->chain_task[index], next.time + held_for(p, x, next.job));
    if (next.job < 0)
        return NEVER;
    return next.time + to_event(p, x, chain, next.job) - read - from_event(p, x, chain, job);
}

/* The worst reaction time of a chain, or its worst latency; NEVER if no data reach the end. */
static int64_t worst_forward(const Arrays *p, Placing x, int64_t chain, bool missed) {
    int64_t task = p->chain_task[p->chain_first[chain]], worst = -1;
    for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++)
        if (is_running(p, x, job))
            worst = most(worst, forward(p, x, chain, job, missed));
    return worst >= 0 ? worst : NEVER;
}

/* The worst data age of a chain, NEVER if no data reach the end. */
static int64_t worst_age(const Arrays *p, Placing x, int64_t chain) {
    int64_t begin = p->chain_first[chain], end = p->chain_first[chain + 1];
    int64_t task = p->chain_task[end - 1], worst = -1;
    for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++) {
        if (!is_running(p, x, job))
            continue;
        int64_t read = read_of(p, x, job);
        Met last = {read, job};
        for (int64_t index = end - 2; index >= begin && last.job >= 0; index--) {
            last = last_write(p, x, p->chain_task[index], last.time);
            if (last.job >= 0)
                last.time -= held_for(p, x, last.job);
        }
        if (last.job < 0)
            return NEVER;
        worst = most(worst, read + to_event(p, x, chain, job) - last.time - from_event(p, x, chain, last.job));
    }
    return worst >= 0 ? worst : NEVER;
}

static int64_t lateness(const Arrays *p, int64_t latency, int64_t limit) {
    return latency >= NEVER ? p->missing_cost : most(0, latency - limit) * p->unit_weight;
}

/* By how much a chain's worst reaction time, data age and latency pass their limits (MODEL 3 and 10.7). */
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
        cost += lateness(p, worst_forward(p, x, chain, true), limit.reaction);
    if (limit.age >= 0)
        cost += lateness(p, worst_age(p, x, chain), limit.age);
    if (p->chain_latency[chain] >= 0)
        cost += lateness(p, worst_forward(p, x, chain, false), p->chain_latency[chain]);
    return cost;
}

#endif
