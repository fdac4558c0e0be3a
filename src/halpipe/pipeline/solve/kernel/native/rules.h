/* The rules between jobs (MODEL 2, 3 and 10): windows, demands and chains, and the sums of their costs.
 *
 * A job counts only once it is placed (start >= 0) and present, so that construction can begin with an empty schedule:
 * a row whose other side is not placed yet costs nothing. */

#ifndef HALPIPE_RULES_H
#define HALPIPE_RULES_H

#include "arrays.h"

/* Where jobs are: the current placement, or the best one. */
typedef struct { const int64_t *start, *option, *phase; } Placing;

typedef struct { int64_t low, high; } Range;

static inline Placing placing(const State *s) { return (Placing){s->start, s->option, s->phase}; }

/* The best placement, where it is the current one too: phases are kept of that alone. */
static inline Placing best_placing(const State *s) { return (Placing){s->best_start, s->best_option, s->phase}; }

/* Whether a job is placed and present. */
static inline bool is_running(const Arrays *p, Placing x, int64_t job) {
    return x.start[job] >= 0 && p->option_present[x.option[job]] == 1;
}

static inline int64_t jobs_of(const Arrays *p, int64_t task) { return p->task_job[task + 1] - p->task_job[task]; }

static inline int64_t number_of(const Arrays *p, int64_t job) { return job - p->task_job[p->job_task[job]]; }

/* The start of a periodic job where it belongs: a hyperperiod later if that lies before its release (MODEL 10.1). */
static inline int64_t unreduced(const Arrays *p, Placing x, int64_t job) {
    int64_t first = number_of(p, job) * p->task_period[p->job_task[job]] + most(0, p->entry_offset[p->job_entry[job]]);
    return x.start[job] + (x.start[job] < first ? p->hyperperiod : 0);
}

/* The release of a periodic job, not reduced. Without an offset, jobs whose release counts start at it (jobs.py). */
static inline int64_t release_of(const Arrays *p, Placing x, int64_t job) {
    int64_t offset = p->entry_offset[p->job_entry[job]];
    return offset < 0 ? unreduced(p, x, job) : offset + number_of(p, job) * p->task_period[p->job_task[job]];
}

/* From its start on, the instant of a job at which a window begins; `event` is that of a point, for its first option. */
static inline int64_t lag_of(const Arrays *p, Placing x, int64_t job, int64_t origin, int64_t event) {
    if (origin == AT_END)
        return p->option_wcet[x.option[job]];
    return origin == AT_POINT ? p->event_at[event + x.option[job] - p->task_option[p->job_task[job]]] : 0;
}

/* When a job reads its data, and how long after that it writes: at start and end, or at its release and LET later. */
static inline int64_t read_of(const Arrays *p, Placing x, int64_t job) {
    return p->task_let[p->job_task[job]] < 0 ? x.start[job] : release_of(p, x, job);
}

static inline int64_t held_for(const Arrays *p, Placing x, int64_t job) {
    int64_t let = p->task_let[p->job_task[job]];
    return let < 0 ? p->option_wcet[x.option[job]] : let;
}

/* The range of job numbers of `task` that holds those which start or end nearest to `time`.
 *
 * Jobs of a periodic task are found by division; tasks on demand, and periodic ones with few jobs, are scanned. */
static inline Range numbers_near(const Arrays *p, Placing x, int64_t task, int64_t time) {
    int64_t jobs = jobs_of(p, task);
    int64_t around = quotient(p->task_reach[task], p->task_period[task]) + 2;
    if (p->task_cyclic[task] == 0 || jobs <= 2 * around + 1)
        return (Range){0, jobs};
    int64_t nearest = quotient(time - x.phase[p->task_job[task]], p->task_period[task]);
    return (Range){nearest - around, nearest + around + 1};
}

/* ------------------------- Windows (MODEL 3): a job of the named task lies in the window before a start or an end. */

/* How far the time from the job of the same cycle to `job` lies outside the window; NEVER while it is not placed. */
static int64_t cycle_distance(const Arrays *p, Placing x, const Row *row, int64_t job) {
    int64_t number = number_of(p, job) * p->task_period[p->job_task[job]] / p->task_period[row->task];
    int64_t before = p->task_job[row->task] + number;
    if (!is_running(p, x, before))
        return NEVER;
    int64_t own = unreduced(p, x, job) + (row->to_end == 1 ? p->option_wcet[x.option[job]] : 0);
    int64_t from = row->origin == AT_RELEASE ? release_of(p, x, before)
                                             : unreduced(p, x, before) + lag_of(p, x, before, row->origin, row->event);
    int64_t gap = own - from - row->least;
    return gap < 0 ? -gap : most(0, gap - row->room);
}

/* How far the nearest job of a row's task lies outside [point - room, point] on the circle, `point` being the row's
 * least distance before `reached`. The instant of a job is its start, or what the row says. */
static int64_t window_distance(const Arrays *p, Placing x, const Row *row, int64_t reached) {
    int64_t point = reached - row->least, best = NEVER;
    int64_t first = p->task_job[row->task], jobs = jobs_of(p, row->task);
    Range near = numbers_near(p, x, row->task, point);
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t instant = x.start[job];
        if (row->origin == AT_END)
            instant += p->option_wcet[x.option[job]];
        else if (row->origin != AT_START)
            instant = row->origin == AT_RELEASE ? release_of(p, x, job) : instant + lag_of(p, x, job, AT_POINT, row->event);
        int64_t gap = modulo(point - instant, p->hyperperiod);
        if (gap <= row->room)
            return 0;
        best = least(best, least(gap - row->room, p->hyperperiod - gap));
    }
    return best;
}

/* How far a running job is from the window of a row; NEVER while the other side is not placed. */
static int64_t row_distance(const Arrays *p, Placing x, const Row *row, int64_t job) {
    if (row->is_cycle == 1)
        return cycle_distance(p, x, row, job);
    return window_distance(p, x, row, x.start[job] + (row->to_end == 1 ? p->option_wcet[x.option[job]] : 0));
}

/* The rows of an option that name a task, which lie side by side; all of its rows for task -1. */
static Range rows_of(const Arrays *p, int64_t option, int64_t task) {
    int64_t low = p->row_first[option], end = p->row_first[option + 1], high = end;
    if (task < 0)
        return (Range){low, end};
    while (low < high) {
        int64_t middle = (low + high) >> 1;
        if (p->row[middle].task < task)
            low = middle + 1;
        else
            high = middle;
    }
    while (high < end && p->row[high].task == task)
        high++;
    return (Range){low, high};
}

/* The distance of a job from its windows: of all rows, or of those that name task `only` (-1: all, and a closed edge). */
static int64_t job_window_cost(const Arrays *p, Placing x, int64_t job, int64_t only) {
    int64_t cost = 0;
    if (!is_running(p, x, job))
        return cost;
    int64_t chosen = x.option[job];
    if (p->is_closed == 1 && only < 0)
        cost += most(0, x.start[job] + p->option_wcet[chosen] - p->hyperperiod);
    Range rows = rows_of(p, chosen, only);
    for (int64_t index = rows.low; index < rows.high; index++) {
        int64_t distance = row_distance(p, x, &p->row[index], job);
        if (distance < NEVER)
            cost += distance;
    }
    return cost * p->unit_weight;
}

/* ------------------------------------- Demands (MODEL 2): a job without a period runs if its demander asks for it. */

/* The cost of a demand job that runs undemanded, or that is demanded and does not run. */
static int64_t demand_cost(const Arrays *p, Placing x, int64_t job) {
    int64_t demander = p->demand_job[job];
    if (demander < 0 || x.start[job] < 0 || x.start[demander] < 0)
        return 0;
    int64_t chosen = x.option[demander];
    Range rows = rows_of(p, chosen, p->job_task[job]);
    bool wanted = p->option_present[chosen] == 1 && rows.high - rows.low > p->demand_slot[job];
    bool runs = p->option_present[x.option[job]] == 1;
    return wanted != runs ? p->missing_cost : 0;
}

/* --------------------------- Chains (MODEL 3): worst reaction time, data age and latency stay within their limits. */

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
        return start - modulo(x.start[job] - release_of(p, x, job), p->hyperperiod);
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

/* ---------------------------------------------------------------------------------------------- Sums of the rules. */

static int64_t window_costs(const Arrays *p, Placing x, int64_t task, int64_t begin, int64_t end) {
    int64_t cost = 0;
    for (int64_t job = begin; job < end; job++)
        cost += job_window_cost(p, x, job, -1);
    for (int64_t index = p->consumer_first[task]; index < p->consumer_first[task + 1]; index++) {
        int64_t consumer = p->consumer[index];
        for (int64_t job = p->task_job[consumer]; job < p->task_job[consumer + 1]; job++)
            cost += job_window_cost(p, x, job, task);
    }
    return cost;
}

static int64_t demand_costs(const Arrays *p, Placing x, int64_t begin, int64_t end) {
    int64_t cost = 0;
    for (int64_t job = begin; job < end; job++) {
        cost += demand_cost(p, x, job);
        for (int64_t index = p->dependent_first[job]; index < p->dependent_first[job + 1]; index++)
            cost += demand_cost(p, x, p->dependent[index]);
    }
    return cost;
}

static int64_t chain_costs(const Arrays *p, Placing x, int64_t task) {
    int64_t cost = 0;
    for (int64_t index = p->task_chain_first[task]; index < p->task_chain_first[task + 1]; index++)
        cost += chain_cost(p, x, p->task_chain[index]);
    return cost;
}

/* What jobs [begin, end) of `task` have to do with others. */
static int64_t side_cost(const Arrays *p, const State *s, int64_t task, int64_t begin, int64_t end) {
    Placing x = placing(s);
    return window_costs(p, x, task, begin, end) + demand_costs(p, x, begin, end) + chain_costs(p, x, task);
}

/* What all jobs have to do with each other. */
static int64_t all_side_costs(const Arrays *p, const State *s) {
    Placing x = placing(s);
    int64_t cost = 0;
    for (int64_t job = 0; job < p->jobs; job++)
        cost += job_window_cost(p, x, job, -1) + demand_cost(p, x, job);
    for (int64_t chain = 0; chain < p->chains; chain++)
        cost += chain_cost(p, x, chain);
    return cost;
}

#endif
