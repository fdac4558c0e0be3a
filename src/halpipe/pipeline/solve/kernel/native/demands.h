/* The rule of demands (MODEL 2): a job of a task without a period runs if, and only if, its demander asks for it. */

#ifndef HALPIPE_DEMANDS_H
#define HALPIPE_DEMANDS_H

#include "placing.h"

/* The cost of a demand job that runs undemanded, or that is demanded and does not run. */
static int64_t demand_cost(const Arrays *p, Placing x, int64_t job) {
    int64_t demander = p->demand_job[job];
    if (demander < 0 || x.start[job] < 0 || x.start[demander] < 0)
        return 0;
    int64_t rows = 0, chosen = x.option[demander];
    if (p->option_present[chosen] == 1)
        for (int64_t index = p->row_first[chosen]; index < p->row_first[chosen + 1]; index++)
            if (p->row[index].task == p->job_task[job])
                rows++;
    bool wanted = rows > p->demand_slot[job];
    bool runs = p->option_present[x.option[job]] == 1;
    return wanted != runs ? p->missing_cost : 0;
}

#endif
