/* Where jobs are, as the rules between jobs see it. A job counts only once it is placed (start >= 0) and present. */

#ifndef HALPIPE_PLACING_H
#define HALPIPE_PLACING_H

#include "arithmetic.h"

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

/* The release of a job whose task has a fixed phase, not reduced. */
static inline int64_t release_of(const Arrays *p, int64_t job) {
    return p->entry_offset[p->job_entry[job]] + number_of(p, job) * p->task_period[p->job_task[job]];
}

/* The start of a periodic job where it belongs: a hyperperiod later if that lies before its release (MODEL 10.1). */
static inline int64_t unreduced(const Arrays *p, Placing x, int64_t job) {
    int64_t first = number_of(p, job) * p->task_period[p->job_task[job]] + most(0, p->entry_offset[p->job_entry[job]]);
    return x.start[job] + (x.start[job] < first ? p->hyperperiod : 0);
}

/* From its start on, the instant of a job at which a window begins; `event` is that of a point, for its first option. */
static inline int64_t lag_of(const Arrays *p, Placing x, int64_t job, int64_t origin, int64_t event) {
    if (origin == AT_END)
        return p->option_wcet[x.option[job]];
    return origin == AT_POINT ? p->event_at[event + x.option[job] - p->task_option[p->job_task[job]]] : 0;
}

/* When a job reads its data, and how long after that it writes: at start and end, or at its release and LET later. */
static inline int64_t read_of(const Arrays *p, Placing x, int64_t job) {
    return p->task_let[p->job_task[job]] < 0 ? x.start[job] : release_of(p, job);
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

#endif
