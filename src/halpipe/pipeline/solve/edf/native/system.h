/* Inputs and state of a simulation; Python hands all of it over (native.py), field by field in the same
 * order. Arrays whose rows belong to tasks, units or ways are laid out one after the other, with where each one's rows
 * begin beside them; the last of those is where all rows end. All times are ticks. */

#ifndef SYSTEM_H
#define SYSTEM_H

#include <stdbool.h>
#include <stdint.h>

/* A version on a set of units. The first five say where its rows begin; they end where those of the next way begin. */
typedef struct {
    int64_t units, services, ends, phases, windows;
    int64_t wcet;
    int64_t length; /* what a job in one piece reserves */
    int64_t anywhere;
    int64_t resume;
    int64_t max_gaps;
    int64_t min_part;
} Way;

typedef struct {
    int64_t distance, time;
} Service;

/* `height` quanta of a resource while [begin, end) is executed. */
typedef struct {
    int64_t resource, begin, end, height;
} Phase;

/* [begin, end), of execution time or of time. */
typedef struct {
    int64_t begin, end;
} Stretch;

/* A job may start between `least` and `most` after some start (or end) of a job of `task`. */
typedef struct {
    int64_t task, least, most, from_end;
} Window;

typedef struct {
    int64_t latest, deadline, is_cyclic, is_fixed;
} Task;

/* `height` quanta of `resource` on [begin, end). */
typedef struct {
    int64_t resource, begin, end, height;
} Claim;

/* A job that stays; its rows of units end where those of the next one begin. */
typedef struct {
    int64_t task, start, end, units;
} Fixed;

/* What jobs that stay make of a unit from a point of the hyperperiod on: occupied or not, and the innermost gap. */
typedef struct {
    int64_t point, is_busy, has_gap, gap_begin, gap_end;
} Place;

typedef struct {
    int64_t tasks, units, resources, cycle, most_cycles;
    const Task *task;
    const Way *ways;
    const int64_t *way_units;
    const Service *services;
    const int64_t *ends;
    const Phase *phases;
    const Stretch *by_begin; /* the phases of each way, by their begin */
    const Stretch *by_end;   /* and the last first */
    const Window *windows;
    const int64_t *capacity;
    const Fixed *fixed;
    const int64_t *fixed_units;
    const Claim *standing; /* of those that stay, by resource and begin */
    const int64_t *standing_at;
    const int64_t *longest; /* of them, by resource */
    const Place *places;    /* by unit */
    const int64_t *places_at;
    const int64_t *walls; /* when a unit is occupied by those that stay, in ascending order */
    const int64_t *walls_at;
} System;

typedef struct {
    int64_t fresh;
    const int64_t *way; /* of each task */
    const int64_t *holds;
    const int64_t *urgency;
    const int64_t *releases; /* in the first hyperperiod, by task */
    const int64_t *releases_at;
    const int64_t *on_unit; /* the tasks of each unit that do not stay */
    const int64_t *on_unit_at;
    const int64_t *followers; /* the units of tasks that have a window after each task */
    const int64_t *followers_at;
    const int64_t *reach;    /* how far windows look back at each task */
    const int64_t *history;  /* the number of those that anybody looks back at, or -1 */
    const int64_t *parts_at; /* where each task's parts begin */
} Plan;

/* A part of a job: start and end, and what it executes, from and to. */
typedef struct {
    int64_t start, end, first, last;
} Part;

/* The job of a task that is waiting or has begun. `number` counts from the beginning of time; jobs that were released
 * after it wait behind it, so that a task has one of these. */
typedef struct {
    int64_t is_there;
    int64_t number;
    int64_t release;
    int64_t due;
    int64_t latest;
    int64_t end_by;
    int64_t last_start; /* the latest start from which it ends in time in one piece */
    int64_t executed;
    int64_t target;
    int64_t claimed; /* what the running piece was to execute when it took its claims */
    int64_t kept;    /* when it was last decided that it runs */
    int64_t ticket;  /* of the stop that counts */
    int64_t is_running;
    int64_t parts;
    int64_t next_release; /* of the job that is to come, and its number */
    int64_t next_number;
} Job;

typedef struct {
    int64_t time, order, task, number;
} Event;

typedef struct {
    int64_t begin, end, height, next;
} Held;


/* What there may be too little room for, a bit each. */
enum { EVENTS = 1, HISTORY = 2, PARTS = 4, CLAIMS = 8, SIGNATURE = 16, OPEN = 32 };

typedef struct {
    int64_t lack; /* whether some room was too small, and which: then nothing counts */
    int64_t begin, end; /* jobs that start in [begin, end) are noted */
    int64_t sequence, hurried, event_count, part_count, free_claim, signed_count, signed_before;
    int64_t event_room, history_room, part_room, claim_room, near_room, signature_room;
    Job *jobs;
    Event *events;
    Part *open;       /* the parts of jobs that have begun */
    int64_t *pending; /* tasks that wait for each unit, the most urgent first */
    int64_t *pending_count;
    int64_t *stacks; /* tasks that have begun on each unit */
    int64_t *stack_count;
    int64_t *running; /* on each unit, or -1 */
    int64_t *is_touched;
    int64_t *candidates; /* those of a unit as they are asked; the ones before wait */
    int64_t *past; /* of tasks with a history, starts and then ends */
    int64_t *past_count;
    Held *claims;
    int64_t *claims_of; /* the first of each resource, or -1 */
    int64_t *claim_count;
    int64_t *claim_most;
    Claim *asked;
    Claim *near;
    int64_t *signatures; /* two, in turn */
    int64_t *first; /* of the jobs of a hyperperiod, by task: where their parts begin, and how many they are */
    int64_t *count;
    int64_t *release;
    int64_t *start;
    int64_t *finish;
    Part *parts;
    int64_t *late;
} Memory;

typedef struct {
    const System *system;
    const Plan *plan;
    Memory *memory;
} Simulation;

static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }

static inline int64_t greatest(int64_t a, int64_t b) { return a > b ? a : b; }

static inline int64_t floor_of(int64_t a, int64_t b) { return a / b - (a % b < 0); }

/* How many of ascending values are at most `value`. */
static inline int64_t count_up_to(const int64_t *values, int64_t count, int64_t value) {
    int64_t low = 0, high = count;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        if (values[middle] <= value)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static inline const Way *way_of(const Simulation *s, int64_t task) { return &s->system->ways[s->plan->way[task]]; }

static inline Part *parts_of(const Simulation *s, int64_t task) {
    return &s->memory->open[s->plan->parts_at[task]];
}

static inline Part *last_part(const Simulation *s, int64_t task) {
    return &parts_of(s, task)[s->memory->jobs[task].parts - 1];
}

#endif
