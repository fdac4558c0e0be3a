/* The move of an entry or, of one whose jobs have a choice each, of a single job: out, looked around, and in again. */

#ifndef HALPIPE_MOVE_ENTRY_H
#define HALPIPE_MOVE_ENTRY_H

#include "conflicts.h"
#include "cycles.h"

enum {
    /* Places to look at for a task alone, and for one that is coupled with others. */
    CANDIDATES = 16,
    CANDIDATES_IN_WINDOWS = 32,
};

/* Whether an option may be taken on the unit set `set`. */
static inline bool is_of_set(const Arrays *p, int64_t option, int64_t set) {
    return set == ANY_SET || p->option_set[option] == ANY_SET || p->option_set[option] == set;
}

/* The unit set that the jobs of a bound task outside [begin, end) are on; ANY_SET if none of them is placed. */
static int64_t set_of_others(const Arrays *p, const State *s, int64_t task, int64_t begin, int64_t end) {
    for (int64_t job = p->task_job[task]; job < p->task_job[task + 1]; job++)
        if ((job < begin || job >= end) && s->start[job] >= 0 && p->option_set[s->option[job]] != ANY_SET)
            return p->option_set[s->option[job]];
    return ANY_SET;
}

/* Choose option, slide and start of a job at `phase` or later; return its lane cost, NEVER if no option may.
 *
 * The job's phase may reach `latest` plus what slack and deadline of the option allow. */
static int64_t settle(const Arrays *p, State *s, const int64_t *noise, int64_t task, int64_t job, int64_t phase,
                      int64_t latest, int64_t set, int64_t limit) {
    int64_t first = p->task_option[task], last = p->task_option[task + 1];
    int64_t number = p->task_cyclic[task] == 1 ? job - p->task_job[task] : 0;
    int64_t start = modulo(phase + number * p->task_period[task], p->hyperperiod);
    if (last - first == 1 && p->option_late[first] == 0 && phase == latest) {
        s->option[job] = first;
        s->start[job] = start;
        s->phase[job] = phase;
        return option_cost(p, s, first, start, limit);
    }
    int64_t best = NEVER, chosen = NEVER;
    for (int64_t option = first; option < last; option++) {
        int64_t room = latest + p->option_late[option] - phase, shift = 0;
        if (room < 0 || !is_of_set(p, option, set))
            continue;
        int64_t cost = option_cost(p, s, option, start, NEVER);
        if (cost > 0 && room > 0) {
            int64_t found = slide(p, s, option, start, room);
            if (found > 0) {
                shift = found;
                cost = 0;
            }
        }
        int64_t score = cost;
        if (last - first > 1)
            score -= draw_noise(s, noise);
        if (score < best) {
            best = score;
            chosen = cost;
            s->option[job] = option;
            s->start[job] = modulo(start + shift, p->hyperperiod);
            s->phase[job] = phase + shift;
        }
    }
    return chosen;
}

/* Place all jobs of an entry from `phase` on, on one unit set; return the lane cost, `limit` or more when abandoned. */
static int64_t try_set(const Arrays *p, State *s, const int64_t *noise, int64_t task, int64_t begin, int64_t end,
                       int64_t phase, int64_t set, int64_t limit) {
    int64_t cost = 0;
    for (int64_t job = begin; job < end; job++) {
        cost += settle(p, s, noise, task, job, phase, phase, set, limit - cost);
        if (cost >= limit)
            break;
    }
    return cost;
}

/* Do that where each job may choose; for a bound task on the set that its other jobs are on, else on the cheapest, the
 * first of them from one that is drawn on. */
static int64_t try_entry(const Arrays *p, State *s, const int64_t *noise, int64_t task, int64_t begin, int64_t end,
                         int64_t phase, int64_t limit) {
    int64_t sets = p->task_sets[task];
    if (sets == 1)
        return try_set(p, s, noise, task, begin, end, phase, ANY_SET, limit);
    int64_t set = set_of_others(p, s, task, begin, end);
    if (set != ANY_SET)
        return try_set(p, s, noise, task, begin, end, phase, set, limit);
    int64_t first = draw(s, sets), cost = NEVER, chosen = first, last = first;
    for (int64_t number = 0; number < sets && cost > 0; number++) {
        last = modulo(first + number, sets);
        int64_t found = try_set(p, s, noise, task, begin, end, phase, last, least(limit, cost));
        if (found < cost) {
            cost = found;
            chosen = last;
        }
    }
    return chosen == last ? cost : try_set(p, s, noise, task, begin, end, phase, chosen, limit);
}

/* Place one job near `start`, within what the phases of the other jobs of its entry leave it. */
static int64_t try_job(const Arrays *p, State *s, const int64_t *noise, int64_t task, int64_t job, int64_t start,
                       int64_t limit) {
    int64_t entry = p->job_entry[job];
    int64_t earliest = p->entry_offset[entry], latest = p->entry_offset[entry];
    if (earliest < 0) {
        earliest = -NEVER;
        latest = NEVER;
        for (int64_t other = p->entry_job[entry]; other < p->entry_job[entry + 1]; other++) {
            if (other != job) {
                earliest = most(earliest, s->phase[other] - p->option_late[s->option[other]]);
                latest = least(latest, s->phase[other]);
            }
        }
    }
    if (p->task_first[task] == 1) { /* some phase in [0, D) suits all jobs */
        earliest = most(earliest, 0);
        latest = least(latest, p->task_period[task] - 1);
    }
    int64_t late = 0;
    for (int64_t option = p->task_option[task]; option < p->task_option[task + 1]; option++)
        late = most(late, p->option_late[option]);
    int64_t half = p->hyperperiod >> 1;
    int64_t phase = s->old[job].phase + modulo(start - s->old[job].start + half, p->hyperperiod) - half;
    if (phase < earliest || phase > latest + late)
        phase = earliest + draw(s, latest + late - earliest + 1);
    int64_t set = p->task_sets[task] == 1 ? ANY_SET : set_of_others(p, s, task, job, job + 1);
    return settle(p, s, noise, task, job, phase, latest, set, limit);
}

/* Note the placement just tried as the one to keep. */
static void keep(State *s, int64_t begin, int64_t end) {
    for (int64_t job = begin; job < end; job++)
        s->kept[job] = (Spot){s->start[job], s->option[job], s->phase[job]};
}

/* Enter the placement kept into the profiles; return the lane cost it brings. */
static int64_t put_back(const Arrays *p, State *s, int64_t begin, int64_t end) {
    for (int64_t job = begin; job < end; job++) {
        s->start[job] = s->kept[job].start;
        s->option[job] = s->kept[job].option;
        s->phase[job] = s->kept[job].phase;
    }
    return enter(p, s, begin, end);
}

/* Whether the placement kept differs from the old one. */
static bool has_moved(const State *s, int64_t begin, int64_t end) {
    for (int64_t job = begin; job < end; job++)
        if (s->kept[job].start != s->old[job].start || s->kept[job].option != s->old[job].option)
            return true;
    return false;
}

/* Draw candidates for jobs [begin, end) and keep one of them, or the old placement, whose score is `best`. */
static void sample(const Arrays *p, State *s, const int64_t *noise, int64_t task, int64_t begin, int64_t end,
                   bool single, bool fresh, int64_t best) {
    bool coupled = p->task_coupled[task] == 1;
    int64_t entry = p->job_entry[begin];
    int attempts = (coupled ? CANDIDATES_IN_WINDOWS : CANDIDATES) * (fresh ? 2 : 1);
    for (int attempt = 0; attempt < attempts; attempt++) {
        int64_t job = begin + draw(s, end - begin);
        int64_t start = candidate_start(p, s, task, job, fresh);
        int64_t limit = best + draw_noise(s, noise), cost;
        if (single) {
            cost = try_job(p, s, noise, task, job, start, limit);
        } else {
            int64_t phase = p->entry_offset[entry];
            if (phase < 0 && fresh && attempt == 0 && is_on(s, TRY_HINT))
                phase = s->hint[entry];
            if (phase < 0)
                phase = modulo(start, p->task_period[task]);
            cost = try_entry(p, s, noise, task, begin, end, phase, limit);
        }
        if (cost < limit && coupled)
            cost += side_cost(p, s, task, begin, end);
        if (cost < limit) {
            best -= limit - cost;
            keep(s, begin, end);
            if (cost == 0)
                break;
        }
    }
}

/* Whether single jobs of a task have a choice: slack, or more than one option. */
static bool is_flexible(const Arrays *p, int64_t task) {
    return options_of(p, task) > 1 || p->option_late[p->task_option[task]] > 0;
}

/* Remember an entry of which jobs [begin, end) were placed, and the entries that share what is overloaded with them. */
static void heat_up_around(const Arrays *p, State *s, int64_t entry, int64_t begin, int64_t end) {
    heat_up(s, entry);
    for (int64_t job = begin; job < end; job++)
        heat_up_overlapped(p, s, job);
}

/* Move an entry or, of one with a choice for each job, half of the time a job: that in conflict, if one is. */
static void move_entry(const Arrays *p, State *s, const int64_t *noise, int64_t entry, int64_t conflicting) {
    Registers *at = s->registers;
    bool fresh = at->inserted < p->entries;
    if (at->inserted == 0)
        at->cost = total_cost(p, s); /* of chains through tasks that have no jobs at all */
    int64_t begin = p->entry_job[entry], end = p->entry_job[entry + 1];
    int64_t task = p->job_task[begin];
    bool single = false;
    bool alone = end - begin == 1 && p->entry_offset[entry] < 0; /* then the job is free to go anywhere as a whole */
    if (!fresh && !alone && is_flexible(p, task) && draw(s, 2) == 0 && is_on(s, MOVE_JOB)) {
        single = true;
        begin = conflicting >= 0 ? conflicting : begin + draw(s, end - begin);
        end = begin + 1;
    }
    bool coupled = p->task_coupled[task] == 1;
    int64_t before = coupled ? side_cost(p, s, task, begin, end) : 0;
    int64_t best = NEVER;
    if (!fresh) {
        before += take_out(p, s, begin, end);
        best = before - draw_noise(s, noise);
    }
    sample(p, s, noise, task, begin, end, single, fresh, best);
    int64_t after = put_back(p, s, begin, end);
    int64_t side = coupled ? side_cost(p, s, task, begin, end) : 0;
    after += side;
    at->cost += after - before;
    if (fresh)
        at->inserted++;
    if (after > 0 && (fresh || has_moved(s, begin, end))) {
        heat_up_around(p, s, entry, begin, end);
        if (side > 0)
            heat_up_partners(p, s, task, begin, end);
    }
}

#endif
