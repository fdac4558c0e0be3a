/* The rule of precedence windows (MODEL 3): some job of the named task begins or ends in the window before a start.
 *
 * A row whose other side is not placed yet costs nothing, so that construction can begin with an empty schedule. */

#ifndef HALPIPE_WINDOWS_H
#define HALPIPE_WINDOWS_H

#include "placing.h"

/* How far the nearest job of a row's task lies outside [point - room, point] on the circle, `point` being the row's
 * least distance before `start`. The instant of a job is its start, or its end if the row says so. */
static int64_t window_distance(const Arrays *p, Placing x, const Row *row, int64_t start) {
    int64_t point = start - row->least, best = NEVER;
    int64_t first = p->task_job[row->task], jobs = jobs_of(p, row->task);
    Range near = numbers_near(p, x, row->task, point);
    for (int64_t number = near.low; number < near.high; number++) {
        int64_t job = first + modulo(number, jobs);
        if (!is_running(p, x, job))
            continue;
        int64_t instant = x.start[job];
        if (row->from_end == 1)
            instant += p->option_wcet[x.option[job]];
        int64_t gap = modulo(point - instant, p->hyperperiod);
        if (gap <= row->room)
            return 0;
        best = least(best, least(gap - row->room, p->hyperperiod - gap));
    }
    return best;
}

/* The distance of a job from its windows: of all rows, or of those that name task `only` (-1: all). */
static int64_t job_window_cost(const Arrays *p, Placing x, int64_t job, int64_t only) {
    int64_t cost = 0;
    if (!is_running(p, x, job))
        return cost;
    int64_t chosen = x.option[job];
    for (int64_t index = p->row_first[chosen]; index < p->row_first[chosen + 1]; index++) {
        const Row *row = &p->row[index];
        if (only >= 0 && row->task != only)
            continue;
        int64_t distance = window_distance(p, x, row, x.start[job]);
        if (distance < NEVER)
            cost += distance;
    }
    return cost * p->unit_weight;
}

#endif
