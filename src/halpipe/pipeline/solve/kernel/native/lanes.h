/* The rule of capacity: at every instant, a lane (units that are alike, or a resource) carries no more than it can.
 *
 * What a placement costs, entering and removing it, and the nearest shift at which it fits. */

#ifndef HALPIPE_LANES_H
#define HALPIPE_LANES_H

#include "profile.h"

/* Steps of the profiles that a slide may look at before it gives up. */
enum { SLIDE_STEPS = 24 };

/* The excess that a job would add on all lanes; ends as soon as it reaches `limit`.
 *
 * Access phases come before units: resources are fuller and weigh more, so the limit is reached sooner. */
static int64_t option_cost(const Arrays *p, const State *s, int64_t option, int64_t start, int64_t limit) {
    int64_t cost = 0;
    if (!is_on(s, LANES))
        return cost;
    for (int64_t index = p->rect_first[option + 1] - 1; index >= p->rect_first[option]; index--) {
        const Rect *r = &p->rect[index];
        cost += excess(p, s, r, wrapped(p, start + r->offset)) * p->lane_weight[r->lane];
        if (cost >= limit)
            return cost;
    }
    return cost;
}

/* Enter a job's rectangles into the profiles. */
static void put(const Arrays *p, State *s, int64_t job) {
    int64_t first = p->rect_first[s->option[job]], rects = p->rect_first[s->option[job] + 1] - first;
    for (int64_t number = 0; number < rects; number++) {
        const Rect *r = &p->rect[first + number];
        int64_t begin = wrapped(p, s->start[job] + r->offset);
        raise_level(p, s, r->lane, begin, r->length, r->height);
        int64_t place = p->owner_first[r->lane] + s->owners[r->lane]++;
        int64_t mark = job * s->max_rects + number;
        s->owner_at[mark] = place;
        s->owner[place] = (Owner){begin, r->length, mark};
    }
}

/* Remove a job's rectangles from the profiles. */
static void take(const Arrays *p, State *s, int64_t job) {
    int64_t first = p->rect_first[s->option[job]], rects = p->rect_first[s->option[job] + 1] - first;
    for (int64_t number = 0; number < rects; number++) {
        const Rect *r = &p->rect[first + number];
        raise_level(p, s, r->lane, wrapped(p, s->start[job] + r->offset), r->length, -r->height);
        int64_t place = s->owner_at[job * s->max_rects + number];
        int64_t last = p->owner_first[r->lane] + --s->owners[r->lane];
        s->owner[place] = s->owner[last];
        s->owner_at[s->owner[place].mark] = place;
    }
}

/* Enter jobs into the profiles, one after the other; return the lane cost that they bring. */
static int64_t enter(const Arrays *p, State *s, int64_t begin, int64_t end) {
    int64_t cost = 0;
    for (int64_t job = begin; job < end; job++) {
        cost += option_cost(p, s, s->option[job], s->start[job], NEVER);
        put(p, s, job);
    }
    return cost;
}

/* Remove jobs from the profiles. */
static void leave(const Arrays *p, State *s, int64_t begin, int64_t end) {
    for (int64_t job = begin; job < end; job++)
        take(p, s, job);
}

/* Remove jobs from the profiles and note where they were; return the lane cost that goes with them. */
static int64_t take_out(const Arrays *p, State *s, int64_t begin, int64_t end) {
    int64_t cost = 0;
    for (int64_t job = end - 1; job >= begin; job--) {
        take(p, s, job);
        cost += option_cost(p, s, s->option[job], s->start[job], NEVER);
        s->old[job] = s->kept[job] = (Spot){s->start[job], s->option[job], s->phase[job]};
    }
    return cost;
}

/* The least shift of at most `furthest` ticks at which the job fits on all lanes, or -1; also after so many steps. */
static int64_t slide_within(const Arrays *p, const State *s, int64_t option, int64_t start, int64_t furthest,
                            int64_t steps) {
    int64_t first = p->rect_first[option], rects = p->rect_first[option + 1] - first, shift = 0;
    for (int64_t fitting = 0, number = 0; fitting < rects; fitting++) {
        const Rect *r = &p->rect[first + number];
        int64_t threshold = p->lane_capacity[r->lane] - r->height;
        int64_t base = p->lane_first[r->lane], end = base + s->edges[r->lane];
        int64_t time = modulo(start + shift + r->offset, p->hyperperiod);
        int64_t here = find(p, s, r->lane, time);
        int64_t advance = 0, free = 0;
        while (free < r->length) {
            int64_t span = s->step[here + 1].begin - time;
            advance += span;
            if (s->step[here].level > threshold) {
                shift += advance;
                advance = free = fitting = 0;
            } else {
                free += span;
            }
            steps--;
            if (shift > furthest || steps < 0)
                return -1;
            time = s->step[++here].begin;
            if (here == end) {
                here = base;
                time = 0;
            }
        }
        if (++number == rects)
            number = 0;
    }
    return shift;
}

static int64_t slide(const Arrays *p, const State *s, int64_t option, int64_t start, int64_t furthest) {
    return is_on(s, SLIDE) ? slide_within(p, s, option, start, furthest, SLIDE_STEPS) : -1;
}

/* Whether a job lies on an overloaded instant of some lane. */
static bool lane_conflict(const Arrays *p, const State *s, int64_t job) {
    if (!is_on(s, LANES))
        return false;
    for (int64_t index = p->rect_first[s->option[job]]; index < p->rect_first[s->option[job] + 1]; index++) {
        const Rect *r = &p->rect[index];
        if (overloaded(p, s, r->lane, wrapped(p, s->start[job] + r->offset), r->length))
            return true;
    }
    return false;
}

/* The excess on all lanes. */
static int64_t lanes_cost(const Arrays *p, const State *s) {
    int64_t cost = 0;
    if (!is_on(s, LANES))
        return cost;
    for (int64_t lane = 0; lane < p->lanes; lane++) {
        int64_t base = p->lane_first[lane];
        for (int64_t index = base; index < base + s->edges[lane]; index++) {
            int64_t over = s->step[index].level - p->lane_capacity[lane];
            if (over > 0)
                cost += over * (s->step[index + 1].begin - s->step[index].begin) * p->lane_weight[lane];
        }
    }
    return cost;
}

#endif
