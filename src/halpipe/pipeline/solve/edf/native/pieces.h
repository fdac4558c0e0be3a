/* Where a job may be interrupted, and how long what it executes takes. */

#ifndef PIECES_H
#define PIECES_H

#include "system.h"

/* A part that a job runs, or might: from `start` on it executes what comes after `first`. Before that `lost` goes by,
 * and so many `gaps` lie before it. */
typedef struct {
    const Way *way;
    int64_t start, first, lost, gaps;
} Piece;

static int64_t gaps_of(const Job *job) { return job->parts - 1; }

/* The least length in which so much work fits between interrupts (MODEL 8.1). */
static int64_t reserved(const System *system, const Way *way, int64_t work) {
    int64_t length = 0, longer = work;
    while (way[1].services > way->services && longer != length) {
        length = longer;
        longer = work;
        for (int64_t n = way->services; n < way[1].services; n++) {
            const Service *each = &system->services[n];
            longer += (length + each->distance - 1) / each->distance * each->time;
        }
    }
    return longer;
}

static int64_t end_of(const System *system, const Piece *piece, int64_t done) {
    return piece->start + reserved(system, piece->way, piece->lost + done - piece->first);
}

static Piece running_piece(const Simulation *s, int64_t task) {
    const Way *way = way_of(s, task);
    const Part *part = last_part(s, task);
    int64_t gaps = gaps_of(&s->memory->jobs[task]);
    return (Piece){way, part->start, part->first, gaps ? way->resume : 0, gaps};
}

/* The part that continues at `now` without a gap, or else begins then. */
static Piece piece_at(const Simulation *s, int64_t task, int64_t now) {
    const Job *job = &s->memory->jobs[task];
    if (job->parts && last_part(s, task)->end == now)
        return running_piece(s, task);
    const Way *way = way_of(s, task);
    return (Piece){way, now, job->executed, job->parts ? way->resume : 0, job->parts};
}

/* What is left of a job, as one part. */
static int64_t rest_of(const Simulation *s, int64_t task) {
    const Way *way = way_of(s, task);
    const Job *job = &s->memory->jobs[task];
    return reserved(s->system, way, way->wcet - job->executed + (job->parts ? way->resume : 0));
}

/* Whether a part that began at `first` may end at `where`, in execution time. */
static bool stops_at(const System *system, const Way *way, int64_t first, int64_t where) {
    if (where >= way->wcet)
        return true;
    if (!way->anywhere) {
        const int64_t *ends = &system->ends[way->ends];
        int64_t place = count_up_to(ends, way[1].ends - way->ends, where);
        return place > 0 && ends[place - 1] == where;
    }
    if (where - first < way->min_part || way->wcet - where < way->min_part)
        return false;
    for (int64_t n = way->phases; n < way[1].phases; n++)
        if (system->phases[n].begin < where && where < system->phases[n].end)
            return false;
    return true;
}

/* The least execution time at which a piece may end, at or after the instant `now`. */
static int64_t first_stop(const System *system, const Piece *piece, int64_t now, int64_t executed) {
    const Way *way = piece->way;
    int64_t low = greatest(executed, piece->first + 1), high = way->wcet;
    while (low < high) { /* the least execution time that the part has reached at `now` */
        int64_t middle = low + (high - low) / 2;
        if (end_of(system, piece, middle) >= now)
            high = middle;
        else
            low = middle + 1;
    }
    int64_t where = greatest(low, piece->first + way->min_part);
    if (way->wcet - where < way->min_part)
        return way->wcet;
    for (int64_t n = way->phases; n < way[1].phases; n++)
        if (system->by_begin[n].begin < where && where < system->by_begin[n].end)
            where = system->by_begin[n].end;
    return stops_at(system, way, piece->first, where) ? where : way->wcet;
}

/* The last execution time beyond `executed` at which a piece may end before `limit`; 0 if there is none. */
static int64_t last_stop(const System *system, const Piece *piece, int64_t limit, int64_t executed) {
    const Way *way = piece->way;
    int64_t low = executed, high = way->wcet;
    while (low < high) {
        int64_t middle = low + (high - low + 1) / 2;
        if (end_of(system, piece, middle) <= limit)
            low = middle;
        else
            high = middle - 1;
    }
    int64_t where = least(low, way->wcet - way->min_part);
    for (int64_t n = way->phases; n < way[1].phases; n++)
        if (system->by_end[n].begin < where && where < system->by_end[n].end)
            where = system->by_end[n].begin;
    return where > executed && stops_at(system, way, piece->first, where) ? where : 0;
}

/* Whether a job may start, or go on, at an instant and end in time as one part. */
static bool can_wait(const Simulation *s, int64_t task, int64_t until) {
    const Job *job = &s->memory->jobs[task];
    return until + rest_of(s, task) <= job->end_by && (job->parts || until <= job->latest);
}

/* Whether a piece until `end` still runs after `latest`, even if it is asked to pause from `since` on. */
static bool holds_up(const Simulation *s, int64_t task, const Piece *piece, int64_t end, int64_t since, int64_t latest) {
    if (end <= latest)
        return false;
    if (!piece->way->anywhere || piece->gaps >= piece->way->max_gaps)
        return true;
    int64_t stop = first_stop(s->system, piece, since, s->memory->jobs[task].executed);
    return end_of(s->system, piece, stop) > latest;
}

#endif
