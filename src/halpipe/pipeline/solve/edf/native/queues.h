/* What happens next: claims of resources, execution segments, events, queues of ready jobs, and jobs that stay. */

#ifndef HALPIPE_QUEUES_H
#define HALPIPE_QUEUES_H

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

/* ---------------------------------------------- Access phases on the line of time: what of each resource is taken. */

/* Claims of a resource that are remembered before any are forgotten. */
enum { FEW = 64 };

/* Write down what a piece up to `target` asks of resources, beyond what the job has taken; return how many claims. */
static int64_t ask(const Simulation *s, const Piece *piece, int64_t executed, int64_t target) {
    int64_t count = 0;
    for (int64_t n = piece->way->phases; n < piece->way[1].phases; n++) {
        const Phase *phase = &s->system->phases[n];
        if (executed <= phase->begin && phase->end <= target) {
            int64_t begin = piece->start + piece->lost + phase->begin - piece->first;
            int64_t end = end_of(s->system, piece, phase->end);
            s->memory->asked[count++] = (Claim){phase->resource, begin, end, phase->height};
        }
    }
    return count;
}

static int64_t add_near(const Simulation *s, int64_t count, const Claim *claim, int64_t begin, int64_t end, int64_t height) {
    if (begin >= claim->end || claim->begin >= end)
        return count;
    if (count == s->memory->near_room) {
        s->memory->lack |= CLAIMS;
        return count;
    }
    s->memory->near[count] = (Claim){claim->resource, begin, end, height};
    return count + 1;
}

/* Add what stays and lies over a claim, in each turn of the hyperperiod that it touches. */
static int64_t gather_standing(const Simulation *s, const Claim *claim, int64_t count) {
    const System *system = s->system;
    const Claim *standing = system->standing;
    int64_t first = system->standing_at[claim->resource], end = system->standing_at[claim->resource + 1];
    int64_t earliest = claim->begin - system->longest[claim->resource], cycle = system->cycle;
    if (first == end)
        return count;
    for (int64_t turn = floor_of(earliest, cycle); turn <= floor_of(claim->end, cycle); turn++) {
        int64_t shift = turn * cycle, low = first, high = end;
        while (low < high) { /* the first that may reach the claim */
            int64_t middle = low + (high - low) / 2;
            if (standing[middle].begin + shift < earliest)
                low = middle + 1;
            else
                high = middle;
        }
        for (; low < end && standing[low].begin + shift < claim->end; low++)
            count = add_near(s, count, claim, standing[low].begin + shift, standing[low].end + shift, standing[low].height);
    }
    return count;
}

/* Gather what lies over a claim: what is taken, the `others` asked for before it, and what stays. */
static int64_t gather(const Simulation *s, const Claim *claim, int64_t others) {
    const Memory *m = s->memory;
    int64_t count = 0;
    for (int64_t n = m->claims_of[claim->resource]; n >= 0; n = m->claims[n].next)
        count = add_near(s, count, claim, m->claims[n].begin, m->claims[n].end, m->claims[n].height);
    for (int64_t n = 0; n < others; n++)
        if (m->asked[n].resource == claim->resource)
            count = add_near(s, count, claim, m->asked[n].begin, m->asked[n].end, m->asked[n].height);
    return gather_standing(s, claim, count);
}

/* An instant up to which a claim does not fit beside `others` and all that is taken; -1 if it fits. */
static int64_t first_free(const Simulation *s, const Claim *claim, int64_t others) {
    int64_t count = gather(s, claim, others);
    const Claim *near = s->memory->near;
    int64_t room = s->system->capacity[claim->resource] - claim->height;
    int64_t instant = claim->begin - 1;
    for (;;) {
        int64_t next = claim->end;
        for (int64_t n = 0; n < count; n++) {
            int64_t begin = greatest(claim->begin, near[n].begin);
            if (begin > instant)
                next = least(next, begin);
        }
        if (next >= claim->end)
            return -1;
        instant = next;
        int64_t height = 0, end = INT64_MAX;
        for (int64_t n = 0; n < count; n++) {
            if (near[n].begin <= instant && instant < near[n].end) {
                height += near[n].height;
                end = least(end, near[n].end);
            }
        }
        if (height > room)
            return end;
    }
}

/* The same for all that is asked: those of one piece may lie over each other where interrupts stretch its phases. */
static int64_t collision(const Simulation *s, int64_t count) {
    for (int64_t n = 0; n < count; n++) {
        int64_t until = first_free(s, &s->memory->asked[n], n);
        if (until >= 0)
            return until;
    }
    return -1;
}

static void take(const Simulation *s, int64_t count) {
    Memory *m = s->memory;
    for (int64_t n = 0; n < count; n++) {
        const Claim *claim = &m->asked[n];
        int64_t place = m->free_claim;
        if (place < 0) {
            m->lack |= CLAIMS;
            return;
        }
        m->free_claim = m->claims[place].next;
        m->claims[place] = (Held){claim->begin, claim->end, claim->height, m->claims_of[claim->resource]};
        m->claims_of[claim->resource] = place;
        m->claim_count[claim->resource]++;
    }
}

static void drop(Memory *m, int64_t resource, int64_t *link) {
    int64_t place = *link;
    *link = m->claims[place].next;
    m->claims[place].next = m->free_claim;
    m->free_claim = place;
    m->claim_count[resource]--;
}

/* Give back a claim that was taken and is not needed now. */
static void give_back(const Simulation *s, const Claim *claim) {
    Memory *m = s->memory;
    for (int64_t *link = &m->claims_of[claim->resource]; *link >= 0; link = &m->claims[*link].next) {
        const Held *held = &m->claims[*link];
        if (held->begin == claim->begin && held->end == claim->end && held->height == claim->height) {
            drop(m, claim->resource, link);
            return;
        }
    }
}

/* Forget what ended at or before an instant. */
static void forget(const Simulation *s, int64_t before) {
    Memory *m = s->memory;
    for (int64_t resource = 0; resource < s->system->resources; resource++) {
        int64_t *link = &m->claims_of[resource];
        while (*link >= 0) {
            if (m->claims[*link].end <= before)
                drop(m, resource, link);
            else
                link = &m->claims[*link].next;
        }
        m->claim_most[resource] = greatest(FEW, 2 * m->claim_count[resource]);
    }
}

static bool is_crowded(const Simulation *s) {
    for (int64_t resource = 0; resource < s->system->resources; resource++)
        if (s->memory->claim_count[resource] > s->memory->claim_most[resource])
            return true;
    return false;
}

typedef enum { RELEASE, STOP, WAKE, FIXED } Kind;

/* ----------------------------- Events: releases first, then ends, then questions asked again, then jobs that stay. */

/* Events of one instant come by their kind, and of one kind as they were put down. */
enum { KIND_SHIFT = 60 };

static Kind kind_of(const Event *event) { return (Kind)(event->order >> KIND_SHIFT); }

static bool is_before(const Event *a, const Event *b) {
    return a->time < b->time || (a->time == b->time && a->order < b->order);
}

static void put(const Simulation *s, int64_t time, Kind kind, int64_t task, int64_t number) {
    Memory *m = s->memory;
    if (m->event_count == m->event_room) {
        m->lack |= EVENTS;
        return;
    }
    Event event = {time, (int64_t)kind << KIND_SHIFT | m->sequence++, task, number};
    int64_t place = m->event_count++;
    for (; place > 0 && is_before(&event, &m->events[(place - 1) / 2]); place = (place - 1) / 2)
        m->events[place] = m->events[(place - 1) / 2];
    m->events[place] = event;
}

static Event pop(const Simulation *s) {
    Memory *m = s->memory;
    Event first = m->events[0], last = m->events[--m->event_count];
    int64_t place = 0, child;
    while ((child = 2 * place + 1) < m->event_count) {
        if (child + 1 < m->event_count && is_before(&m->events[child + 1], &m->events[child]))
            child++;
        if (!is_before(&m->events[child], &last))
            break;
        m->events[place] = m->events[child];
        place = child;
    }
    m->events[place] = last;
    return first;
}

/* When a job is released, counted from the beginning of time; -1 of a task without jobs. */
static int64_t release_of(const Simulation *s, int64_t task, int64_t number) {
    int64_t first = s->plan->releases_at[task], count = s->plan->releases_at[task + 1] - first;
    return count ? number / count * s->system->cycle + s->plan->releases[first + number % count] : -1;
}

static void announce(const Simulation *s, int64_t task, int64_t number) {
    Job *job = &s->memory->jobs[task];
    job->next_number = number;
    job->next_release = release_of(s, task, number);
    put(s, job->next_release, RELEASE, task, task);
}

/* Note that a task has started, or ended: windows look back as far as their reach. */
static void note(const Simulation *s, int64_t task, bool is_end, int64_t now) {
    Memory *m = s->memory;
    int64_t number = s->plan->history[task];
    if (number < 0)
        return;
    int64_t list = 2 * number + is_end;
    int64_t *times = &m->past[list * m->history_room], *count = &m->past_count[list];
    if (*count == m->history_room) {
        int64_t old = count_up_to(times, *count, now - s->plan->reach[task] - 1);
        for (int64_t n = old; n < *count; n++)
            times[n - old] = times[n];
        *count -= old;
    }
    if (*count == m->history_room) {
        m->lack |= HISTORY;
        return;
    }
    times[(*count)++] = now;
}

/* ------------------------------ Jobs that wait for a unit, the most urgent first, and those that have begun on it. */

static void touch(const Simulation *s, int64_t unit) { s->memory->is_touched[unit] = true; }

static void touch_units(const Simulation *s, const Way *way) {
    for (int64_t n = way->units; n < way[1].units; n++)
        touch(s, s->system->way_units[n]);
}

static void touch_followers(const Simulation *s, int64_t task) {
    for (int64_t n = s->plan->followers_at[task]; n < s->plan->followers_at[task + 1]; n++)
        touch(s, s->plan->followers[n]);
}

/* The deadline of a job that can wait no longer. */
enum { AT_ONCE = -1 };

/* Whether a task's job is more urgent than that of another. */
static bool is_sooner(const Simulation *s, int64_t task, int64_t other) {
    const Job *a = &s->memory->jobs[task], *b = &s->memory->jobs[other];
    return a->due < b->due || (a->due == b->due && task < other);
}

static int64_t *pending_of(const Simulation *s, int64_t unit) {
    return &s->memory->pending[s->plan->on_unit_at[unit]];
}

static int64_t *stack_of(const Simulation *s, int64_t unit) { return &s->memory->stacks[s->plan->on_unit_at[unit]]; }

/* The task that began last on a unit, of those that have not ended; -1 if there is none. */
static int64_t top_of(const Simulation *s, int64_t unit) {
    int64_t count = s->memory->stack_count[unit];
    return count ? stack_of(s, unit)[count - 1] : -1;
}

static void enqueue(const Simulation *s, int64_t unit, int64_t task) {
    int64_t *waiting = pending_of(s, unit), place = s->memory->pending_count[unit]++;
    for (; place > 0 && is_sooner(s, task, waiting[place - 1]); place--)
        waiting[place] = waiting[place - 1];
    waiting[place] = task;
}

static void dequeue(const Simulation *s, int64_t unit, int64_t task) {
    int64_t *waiting = pending_of(s, unit), place = 0, count = --s->memory->pending_count[unit];
    while (waiting[place] != task)
        place++;
    for (; place < count; place++)
        waiting[place] = waiting[place + 1];
}

/* Let a job wait for its units, from its release on or, if the one before it ends later, from then on. */
static void offer(const Simulation *s, int64_t task, int64_t number, int64_t now) {
    Job *job = &s->memory->jobs[task];
    const Task *facts = &s->system->task[task];
    const Way *way = way_of(s, task);
    int64_t far = s->system->cycle * s->system->most_cycles;
    int64_t time = release_of(s, task, number) - s->plan->holds[task];
    job->is_there = true;
    job->number = number;
    job->release = time;
    job->due = time + s->plan->urgency[task];
    job->latest = time + (facts->is_cyclic ? facts->latest : far);
    job->end_by = time + (facts->is_cyclic ? facts->deadline : far);
    job->last_start = least(job->latest, job->end_by - way->length);
    job->executed = job->target = job->claimed = job->parts = 0;
    job->kept = -1;
    for (int64_t n = way->units; n < way[1].units; n++)
        enqueue(s, s->system->way_units[n], task);
    if (job->last_start > now)
        put(s, job->last_start, WAKE, task, s->system->way_units[way->units]);
}

/* Put a job before all that can still wait. */
static void hurry(const Simulation *s, int64_t task) {
    const Way *way = way_of(s, task);
    s->memory->jobs[task].due = AT_ONCE;
    s->memory->hurried++;
    for (int64_t n = way->units; n < way[1].units; n++) {
        dequeue(s, s->system->way_units[n], task);
        enqueue(s, s->system->way_units[n], task);
    }
}

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
