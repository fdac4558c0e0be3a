/* The rule of precedence windows (MODEL 3): some job of the named task begins or ends in the window before a start.
 *
 * A row whose other side is not placed yet costs nothing, so that construction can begin with an empty schedule. */

#ifndef HALPIPE_WINDOWS_H
#define HALPIPE_WINDOWS_H

#include "placing.h"

/* How far the time from the job of the same cycle to `job` lies outside the window; NEVER while it is not placed. */
static int64_t cycle_distance(const Arrays *p, Placing x, const Row *row, int64_t job) {
    int64_t number = number_of(p, job) * p->task_period[p->job_task[job]] / p->task_period[row->task];
    int64_t before = p->task_job[row->task] + number;
    if (!is_running(p, x, before))
        return NEVER;
    int64_t own = unreduced(p, x, job) + (row->to_end == 1 ? p->option_wcet[x.option[job]] : 0);
    int64_t from = row->origin == AT_RELEASE ? release_of(p, before)
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
            instant = row->origin == AT_RELEASE ? release_of(p, job) : instant + lag_of(p, x, job, AT_POINT, row->event);
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

/* The distance of a job from its windows: of all rows, or of those that name task `only` (-1: all, and a closed edge). */
static int64_t job_window_cost(const Arrays *p, Placing x, int64_t job, int64_t only) {
    int64_t cost = 0;
    if (!is_running(p, x, job))
        return cost;
    int64_t chosen = x.option[job];
    if (p->is_closed == 1 && only < 0)
        cost += most(0, x.start[job] + p->option_wcet[chosen] - p->hyperperiod);
    for (int64_t index = p->row_first[chosen]; index < p->row_first[chosen + 1]; index++) {
        const Row *row = &p->row[index];
        if (only >= 0 && row->task != only)
            continue;
        int64_t distance = row_distance(p, x, row, job);
        if (distance < NEVER)
            cost += distance;
    }
    return cost * p->unit_weight;
}

#endif
