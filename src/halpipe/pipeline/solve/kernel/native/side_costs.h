/* What lies between jobs, not on lanes: the sum of the rules of windows, demands and chains. */

#ifndef HALPIPE_SIDE_COSTS_H
#define HALPIPE_SIDE_COSTS_H

#include "chains.h"
#include "demands.h"
#include "windows.h"

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
    int64_t cost = 0;
    if (is_on(s, WINDOWS))
        cost += window_costs(p, x, task, begin, end);
    if (is_on(s, DEMANDS))
        cost += demand_costs(p, x, begin, end);
    if (is_on(s, CHAINS))
        cost += chain_costs(p, x, task);
    return cost;
}

/* What all jobs have to do with each other. */
static int64_t all_side_costs(const Arrays *p, const State *s) {
    Placing x = placing(s);
    int64_t cost = 0;
    for (int64_t job = 0; is_on(s, WINDOWS) && job < p->jobs; job++)
        cost += job_window_cost(p, x, job, -1);
    for (int64_t job = 0; is_on(s, DEMANDS) && job < p->jobs; job++)
        cost += demand_cost(p, x, job);
    for (int64_t chain = 0; is_on(s, CHAINS) && chain < p->chains; chain++)
        cost += chain_cost(p, x, chain);
    return cost;
}

#endif
