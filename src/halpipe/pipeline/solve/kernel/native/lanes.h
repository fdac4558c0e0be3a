/* The rule of capacity: at every instant, a lane (units that are alike, or a resource) carries no more than it can.
 *
 * Profiles of the lanes are minimal step functions over the circle [0, hyperperiod), sorted. A part of `step` begins at
 * lane_first[lane]: edges[lane] steps, the first from 0 on, and then a sentinel at the hyperperiod. Neighbouring levels
 * differ, except at the breakpoint 0, which is permanent. `guide` states where to look for a time: for each stretch of
 * the circle the last breakpoint at or before its begin (Chen and Asau's guide table). A binary search, whose branches
 * nothing foretells, took a fifth of the time. */

#ifndef HALPIPE_LANES_H
#define HALPIPE_LANES_H

#include <stddef.h>

#include "arrays.h"

/* The index of the last breakpoint of a lane at or before `time`. */
static inline int64_t find(const Arrays *p, const State *s, int64_t lane, int64_t time) {
    int64_t index = p->lane_first[lane] + s->guide[p->guide_first[lane] + (time >> p->guide_shift[lane])];
    while (s->step[index + 1].begin <= time)
        index++;
    return index;
}

/* The excess over the capacity that a rectangle would add, in ticks times quanta. */
static inline int64_t excess(const Arrays *p, const State *s, const Rect *r, int64_t start) {
    const Step *base = s->step + p->lane_first[r->lane], *end = base + s->edges[r->lane];
    int64_t threshold = p->lane_capacity[r->lane] - r->height; /* a level above it overflows with the rectangle on it */
    int64_t length = r->length, cost = 0;
    for (const Step *step = s->step + find(p, s, r->lane, start);;) {
        int64_t span = least(step[1].begin - start, length);
        int64_t over = step->level - threshold;
        cost += span * least(over > 0 ? over : 0, r->height); /* a branch here would be foretold wrongly too often */
        length -= span;
        if (length == 0)
            return cost;
        if (++step == end)
            step = base;
        start = step->begin;
    }
}

/* Whether the level exceeds the capacity at some instant of [start, start + length). */
static bool overloaded(const Arrays *p, const State *s, int64_t lane, int64_t start, int64_t length) {
    const Step *base = s->step + p->lane_first[lane], *end = base + s->edges[lane];
    for (const Step *step = s->step + find(p, s, lane, start);;) {
        if (step->level > p->lane_capacity[lane])
            return true;
        int64_t span = step[1].begin - start;
        if (span >= length)
            return false;
        length -= span;
        if (++step == end)
            step = base;
        start = step->begin;
    }
}

/* Move the steps [begin, end) so many places up, or down if negative. This is all that is asked of the C library, and
 * every process has it; without its headers, a compiler needs nothing of the system. */
static inline void move_steps(State *s, int64_t begin, int64_t end, int64_t places) {
    if (places != 0)
        __builtin_memmove(s->step + begin + places, s->step + begin, (size_t)(end - begin) * sizeof *s->step);
}

/* Account for breakpoints that come (1) or go (-1) at `begin` and at `end`. */
static void count(const Arrays *p, State *s, int64_t lane, int64_t begin, int64_t end, int64_t left, int64_t right) {
    s->edges[lane] += left + right;
    int64_t shift = p->guide_shift[lane], first = p->guide_first[lane];
    int64_t between = first - (-begin >> shift), after = first - (-end >> shift);
    if (left != 0)
        for (int64_t place = between; place < after; place++)
            s->guide[place] += left;
    if (left + right != 0)
        for (int64_t place = after; place < p->guide_first[lane + 1]; place++)
            s->guide[place] += left + right;
}

/* Raise the steps from `first` to `last`, which begin `places` further up from then on: 1, if the first one stays below
 * `begin` and is cut there; -1, if it becomes one with the step before it; else 0. */
static void raise_steps(Step *step, int64_t first, int64_t last, int64_t begin, int64_t height, int64_t places) {
    if (places > 0) {
        for (int64_t index = last; index > first; index--)
            step[index + 1] = (Step){step[index].begin, step[index].level + height};
        step[first + 1] = (Step){begin, step[first].level + height};
    } else {
        for (int64_t index = first - places; index <= last; index++)
            step[index + places] = (Step){step[index].begin, step[index].level + height};
    }
}

/* Add `height` on [begin, end), which does not wrap.
 *
 * A breakpoint comes at each side where there is none, and goes where the levels are the same from then on. What lies
 * after `end` is moved once. */
static void raise_segment(const Arrays *p, State *s, int64_t lane, int64_t begin, int64_t end, int64_t height) {
    Step *step = s->step;
    int64_t base = p->lane_first[lane], top = base + s->edges[lane];
    int64_t first = find(p, s, lane, begin), last = first;
    while (step[last + 1].begin < end)
        last++;
    int64_t before = step[last].level, left = 0, right = 0, rest = last + 1;
    if (step[first].begin < begin)
        left = 1;
    else if (first > base && step[first].level + height == step[first - 1].level)
        left = -1;
    if (end < step[rest].begin)
        right = 1;
    else if (rest < top && before + height == step[rest].level) {
        right = -1;
        rest++;
    }
    if (left <= 0)
        raise_steps(step, first, last, begin, height, left);
    move_steps(s, rest, top + 1, left + right);
    if (left > 0)
        raise_steps(step, first, last, begin, height, left);
    if (right > 0)
        step[last + 1 + left] = (Step){end, before};
    count(p, s, lane, begin, end, left, right);
}

/* Add `height` (negative to take away) on [start, start + length) of the circle. */
static void raise_level(const Arrays *p, State *s, int64_t lane, int64_t start, int64_t length, int64_t height) {
    int64_t end = start + length;
    if (end <= p->hyperperiod) {
        raise_segment(p, s, lane, start, end, height);
    } else {
        raise_segment(p, s, lane, start, p->hyperperiod, height);
        raise_segment(p, s, lane, 0, end - p->hyperperiod, height);
    }
}

/* Steps of the profiles that a slide may look at before it gives up. */
enum { SLIDE_STEPS = 24 };

/* The excess that a job would add on all lanes; ends as soon as it reaches `limit`.
 *
 * Access phases come before units: resources are fuller and weigh more, so the limit is reached sooner. */
static int64_t option_cost(const Arrays *p, const State *s, int64_t option, int64_t start, int64_t limit) {
    int64_t cost = 0;
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
