/* End-to-end latencies of a chain (MODEL 3), as they are measured of every table that is tried. */

#ifndef LATENCY_H
#define LATENCY_H

#include "system.h"

/* A task of a chain: when its jobs start and end, each after the one before it, round the hyperperiod from job `first`
 * on, which starts first in it. */
typedef struct {
    int64_t count, first;
    const int64_t *starts;
    const int64_t *ends;
} Member;

static int64_t turned(const Member *member, const int64_t *times, int64_t place) {
    place += member->first;
    return times[place < member->count ? place : place - member->count];
}

/* How many of the first jobs start, or end, before `time`. */
static int64_t count_before(const Member *member, const int64_t *times, int64_t time) {
    int64_t low = 0, high = member->count;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        if (turned(member, times, middle) < time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The end of the job that starts next at or after a time. */
static int64_t end_after(const Member *member, int64_t cycle, int64_t time) {
    int64_t shift = -floor_of(turned(member, member->starts, member->count - 1) - time, cycle) * cycle;
    return shift + turned(member, member->ends, count_before(member, member->starts, time - shift));
}

/* The start of the job that ended last at or before a time. */
static int64_t start_before(const Member *member, int64_t cycle, int64_t time) {
    int64_t shift = floor_of(time - turned(member, member->ends, 0), cycle) * cycle;
    return shift + turned(member, member->starts, count_before(member, member->ends, time - shift + 1) - 1);
}

static int64_t worst_reaction(const Member *members, int64_t count, int64_t cycle) {
    int64_t worst = 0;
    for (int64_t n = 0; n < members[0].count; n++) {
        int64_t time = members[0].starts[n] + 1; /* what it reads has just been missed */
        for (int64_t member = 0; member < count; member++)
            time = end_after(&members[member], cycle, time);
        worst = greatest(worst, time - members[0].starts[n]);
    }
    return worst;
}

static int64_t worst_age(const Member *members, int64_t count, int64_t cycle) {
    const Member *last = &members[count - 1];
    int64_t worst = 0;
    for (int64_t n = 0; n < last->count; n++) {
        int64_t time = last->starts[n];
        for (int64_t member = count - 2; member >= 0; member--)
            time = start_before(&members[member], cycle, time);
        worst = greatest(worst, last->ends[n] - time);
    }
    return worst;
}

#endif
