/* What Python hands over: `Arrays` (problem.py) and `State` (kernel.py), field by field in the same order and with the
 * same names. A test compares them with the Python sides; the loader fills them.
 *
 * A field that is a table in Python is a pointer to rows with named members here. Nothing is ever allocated, so there
 * is nothing to free, and nothing but these structs is known to both sides. */

#ifndef HALPIPE_ARRAYS_H
#define HALPIPE_ARRAYS_H

#include <stdbool.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

_Static_assert(sizeof(void *) == 8, "the loader fills in words of 64 bits");
_Static_assert((-1 >> 1) == -1, "right shifts round down, as in Python");

typedef struct { int64_t lane, offset, length, height; } Rect;
typedef struct { int64_t task, least, room, origin, to_end, is_cycle, event; } Row;
typedef struct { int64_t task, lag, room, is_after, from_end; } Partner;
typedef struct { int64_t reaction, age; } Limits;
typedef struct { int64_t from, to; } Events;
typedef struct { int64_t begin, level; } Step; /* of a profile; it ends where the next one begins */
typedef struct { int64_t begin, length, mark; } Owner; /* mark: job * max_rects + number of the rectangle */
typedef struct { int64_t start, option, phase; } Spot;

typedef struct {
    int64_t hyperperiod;
    const int64_t *lane_capacity;
    const int64_t *lane_weight;
    const int64_t *lane_first;
    const int64_t *guide_first;
    const int64_t *guide_shift;
    const int64_t *owner_first;
    const int64_t *task_job;
    const int64_t *task_period;
    const int64_t *task_cyclic;
    const int64_t *task_reach;
    const int64_t *task_option;
    const int64_t *task_coupled;
    const int64_t *task_sets;
    const int64_t *task_let;
    const int64_t *task_first;
    const int64_t *job_task;
    const int64_t *job_entry;
    const int64_t *entry_job;
    const int64_t *entry_offset;
    const int64_t *option_wcet;
    const int64_t *option_late;
    const int64_t *option_present;
    const int64_t *option_set;
    const int64_t *option_recency;
    const int64_t *rect_first;
    const Rect *rect;
    const int64_t *row_first;
    const Row *row;
    const int64_t *event_at;
    const int64_t *consumer_first;
    const int64_t *consumer;
    const int64_t *partner_first;
    const Partner *partner;
    const int64_t *demand_job;
    const int64_t *demand_slot;
    const int64_t *dependent_first;
    const int64_t *dependent;
    const int64_t *chain_first;
    const int64_t *chain_task;
    const Limits *chain_limit;
    const int64_t *chain_latency;
    const Events *chain_event;
    const int64_t *task_chain_first;
    const int64_t *task_chain;
    const int64_t *construction;
    int64_t unit_weight;
    int64_t missing_cost;
    int64_t is_closed;
    /* The lengths that are not in some `_first`; the loader adds them. */
    int64_t lanes;
    int64_t jobs;
    int64_t entries;
    int64_t rows;
    int64_t chains;
} Arrays;

typedef struct {
    int64_t cost;
    int64_t best;
    int64_t inserted;
    int64_t moves;
    int64_t cycle;
    int64_t cycle_length;
    int64_t cycle_left;
    int64_t heat;
    int64_t temperature;
    int64_t hot;
    int64_t frozen;
} Registers;

typedef struct {
    int64_t *start;
    int64_t *option;
    int64_t *phase;
    Step *step;
    int64_t *edges;
    int64_t *guide;
    Owner *owner;
    int64_t *owners;
    int64_t *owner_at; /* [job * max_rects + number] */
    int64_t *hot;
    int64_t *hot_at;
    int64_t *hint;
    int64_t *best_start;
    int64_t *best_option;
    Spot *old;
    Spot *kept;
    int64_t *cluster;
    Registers *registers;
    uint64_t *random;
    int64_t max_rects;
    int64_t heat;
    int64_t enabled;
} State;

/* Parts of the search that can be switched off, to measure what each is worth (bits of State.enabled). */
typedef enum {
    /* Moves other than that of a whole entry. */
    MOVE_JOB = 1 << 4,
    MOVE_CLUSTER = 1 << 5,
    /* Places to try other than anywhere. */
    AIM_AT_WINDOW = 1 << 6,
    AIM_AT_GAP = 1 << 7,
    AIM_AT_STEP = 1 << 8,
    AIM_NEARBY = 1 << 9,
    TRY_HINT = 1 << 10,
    SLIDE = 1 << 11,
    /* Choice of what to move, and how the temperature goes. */
    PICK_CONFLICTS = 1 << 12,
    HOT_CYCLES = 1 << 13,
    RESTARTS = 1 << 14,
    /* One more of the moves other than that of a whole entry. */
    MOVE_SWAP = 1 << 15,
} Part;

static inline bool is_on(const State *s, Part part) { return (s->enabled & part) != 0; }

/* Instants of a job (MODEL 10.1): Row.origin and, for chains, Events. */
typedef enum { AT_START, AT_END, AT_RELEASE, AT_POINT, AT_DATA } Instant;

/* Option of a task that may choose for each job, or of a job that is absent (Arrays.option_set). */
#define ANY_SET (-1)

/* A cost that nothing reaches. */
#define NEVER ((int64_t)1 << 60)

/* Mark of an entry that never moves (State.hint). */
#define FROZEN_HINT (-2)

/* Tasks that may move together, unless they are one body; State.cluster has room for all tasks. */
#define CLUSTER 8

/* Entries of the table of noise, and the fraction bits of one times a temperature: 10 each. */
#define NOISES 4096
#define NOISE_SHIFT 20

static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }

static inline int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }

static inline int64_t quotient(int64_t a, int64_t by) { return a / by - (a % by < 0); }

static inline int64_t modulo(int64_t a, int64_t by) {
    int64_t rest = a % by;
    return rest < 0 ? rest + by : rest;
}

/* A time before twice the hyperperiod, on the circle: a division takes longer than all else in a short loop. */
static inline int64_t wrapped(const Arrays *p, int64_t time) {
    return time >= p->hyperperiod ? time - p->hyperperiod : time;
}

/* A pseudo-random integer in [0, below), from xorshift64. */
static inline int64_t draw(State *s, int64_t below) {
    uint64_t x = *s->random;
    x ^= x << 13;
    x ^= x >> 7;
    x ^= x << 17;
    *s->random = x;
    if (below < 4294967296)
        return (int64_t)(((x >> 32) * (uint64_t)below) >> 32);
    return (int64_t)(x % (uint64_t)below);
}

/* A pseudo-random cost: the temperature times an entry of the table. */
static inline int64_t draw_noise(State *s, const int64_t *noise) {
    return s->registers->temperature * noise[draw(s, NOISES)] >> NOISE_SHIFT;
}

#endif
