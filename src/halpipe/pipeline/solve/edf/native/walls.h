/* What jobs that stay make of the units that they are on. */

#ifndef WALLS_H
#define WALLS_H

#include "queues.h"

static bool has_walls(const System *system, int64_t unit) {
    return system->walls_at[unit + 1] > system->walls_at[unit];
}

/* What those that stay make of an instant on a unit; `shift` is the begin of its hyperperiod. */
static const Place *place_at(const System *system, int64_t unit, int64_t now, int64_t *shift) {
    const Place *places = &system->places[system->places_at[unit]];
    int64_t low = 0, high = system->places_at[unit + 1] - system->places_at[unit], rest = now % system->cycle;
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (places[middle].point <= rest)
            low = middle;
        else
            high = middle;
    }
    *shift = now - rest;
    return &places[low];
}

/* Until when a job may run from `now` on, before one that stays; -1 if for ever. */
static int64_t limit_of(const Simulation *s, const Way *way, int64_t now) {
    const System *system = s->system;
    int64_t limit = -1, rest = now % system->cycle;
    for (int64_t n = way->units; n < way[1].units; n++) {
        int64_t unit = system->way_units[n], first = system->walls_at[unit];
        if (!has_walls(system, unit))
            continue;
        int64_t count = system->walls_at[unit + 1] - first;
        int64_t place = count_up_to(&system->walls[first], count, rest - 1);
        int64_t next = place < count ? system->walls[first + place] : system->walls[first + count - 1] + system->cycle;
        next += now - rest;
        limit = limit < 0 ? next : least(limit, next);
    }
    return limit;
}

/* Whether a job that stays keeps another from a unit: it runs, or what is begun must end before it. */
static bool is_shut_out(const Simulation *s, int64_t task, int64_t unit, int64_t now) {
    if (!has_walls(s->system, unit))
        return false;
    int64_t shift;
    const Place *place = place_at(s->system, unit, now, &shift);
    if (place->is_busy)
        return true;
    if (!place->has_gap)
        return false;
    if (s->memory->jobs[task].parts)
        return parts_of(s, task)[0].start < place->gap_begin + shift;
    int64_t end = now + way_of(s, task)->length;
    for (int64_t n = 0; n < s->memory->stack_count[unit]; n++) {
        int64_t other = stack_of(s, unit)[n];
        if (parts_of(s, other)[0].start >= place->gap_begin + shift)
            end += rest_of(s, other);
    }
    return end > place->gap_end + shift;
}

#endif
