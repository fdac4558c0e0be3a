/* The management core: plays the tables. Every operation has its instant; between them the core sleeps in WFI.
 *
 * A table releases jobs. A job is a program of operations, in progress in the slot of its first unit, from the tick at
 * which it was released. Units are exclusive, so one slot for each is enough, but for tasks whose jobs have gaps: others
 * are in progress in these. Since a program continues by itself, it does not matter whether the table that released it has
 * ended meanwhile.
 *
 * Every loop is bounded: by HP_UNITS, HP_CHANNELS, a number of attempts, or an instant of the timer. The one in play()
 * ends with the run. */
#include "halpipe.h"

#define IDLE NEVER
#define TABLE_SLOT HP_SLOTS
#define SECOND 1UL /* order in a key: after checks, before transfers */
#define LAST 3UL
#define ORDER 3UL
#define ATTEMPTS 1000U

typedef struct {
    const hp_operation *operation;
    const hp_operation *end;
    uint64_t base;    /* mtime of the job's start */
    uint64_t number;  /* of the release: the owner of its transfers */
    uint64_t where;   /* cycle | table << 32, as in a trace record */
    uint64_t who;     /* release | program << 32 */
    uint64_t place;   /* position of the operation */
    uint64_t is_over; /* abandoned */
} slot;

static slot slots[HP_SLOTS];
static uint64_t keys[HP_SLOTS + 1U]; /* next instant of every slot, and of the table: mtime << 2 | order */
static volatile hp_mailbox *boxes[HP_UNITS];
uint64_t hp_monitors[HP_UNITS + 1U] HP_SHARED;

typedef struct {
    uint64_t start; /* mtime */
    uint32_t index;
    uint32_t row;
    uint32_t next;
    uint32_t cycle;
    uint32_t mode;
    uint32_t is_decided;
} progress;

static progress current;

static uint64_t base;
static uint32_t is_suspect; /* a job was abandoned: what it had under way may not be complete */
static hp_record *cursor;

static inline void wait_until(uint64_t instant) {
    if (MTIME < instant) {
        MTIMECMP(0U) = instant;
        while (MTIME < instant) {
            if (dma_work() == 0U) {
                wait_for_interrupt();
            }
        }
    }
}

/* ---- the trace ---- */

static inline uint64_t what(uint64_t place, uint64_t kind, uint64_t flags, uint64_t unit) {
    return place | (kind << 32U) | (flags << 40U) | (unit << 48U);
}

typedef struct {
    uint64_t time;
    uint64_t begin;
    uint64_t end;
} instants;

static inline void record(const instants *at, uint64_t where, uint64_t who, uint64_t which) {
    static uint64_t traced = 0U;
    uint64_t *word = (uint64_t *)cursor; /* whole words: half as many stores */
    word[0] = at->time;
    word[1] = at->begin;
    word[2] = at->end;
    word[3] = where;
    word[4] = who;
    word[5] = which;
    cursor++;
    if (cursor == &TRACE[HP_TRACE_CAPACITY]) {
        cursor = TRACE;
    }
    traced++;
    CONTROL->traced = traced;
}

static void abandon(slot *s, const hp_operation *o, uint64_t flags, uint64_t now) {
    uint64_t count = CONTROL->faults;
    hp_fault *f = &FAULTS[count % HP_FAULT_CAPACITY];
    const volatile hp_mailbox *box = boxes[o->unit];
    uint32_t is_trap = 0U;
    if (((flags & (FLAG_FAULT | FLAG_OVERRUN)) != 0U) && (box->done == box->request)) {
        is_trap = 1U;
    }
    s->is_over = 1U;
    is_suspect = 1U;
    f->time = now - base;
    f->cycle = (uint32_t)s->where;
    f->table = (uint32_t)(s->where >> 32U);
    f->release = (uint32_t)s->who;
    f->program = (uint32_t)(s->who >> 32U);
    f->operation = (uint32_t)s->place;
    f->kind = o->kind;
    f->flags = (uint8_t)flags;
    f->hart = (uint16_t)(o->unit + 1U);
    f->cause = (is_trap != 0U) ? box->cause : 0U;
    f->epc = (is_trap != 0U) ? box->epc : 0U;
    f->tval = (is_trap != 0U) ? box->tval : 0U;
    f->reserved = 0U;
    CONTROL->faults = count + 1U;
}

/* Has the cores of a program begin anew before their next job. */
static void restart(const hp_program *program) {
    for (uint32_t i = 0U; i < program->count; i++) {
        const hp_operation *o = &program->operations[i];
        if (o->kind == OP_RUN) {
            boxes[o->unit]->restart = 1U;
            fence();
            MSIP(o->unit + 1U) = 1U;
        }
    }
}

/* Does what the health rules say of a job that was abandoned. Out of line: what seldom happens must not slow down what
 * always does. */
__attribute__((noinline)) static void react(const slot *s, const hp_operation *o, uint64_t flags, uint64_t now) {
    const hp_program *program = &hp_programs[s->who >> 32U];
    uint32_t end = program->rule + program->rules;
    for (uint32_t index = program->rule; index < end; index++) {
        if (health_fires(index, flags, current.index, current.cycle) != 0U) {
            instants at = {now - base, index, hp_rules[index].action};
            record(&at, s->where, s->who, what(s->place, OP_HEALTH, 0U, o->unit));
            if (hp_rules[index].action == HEALTH_RESTART) {
                restart(program);
            }
        }
    }
}

/* ---- operations; each returns its flags ---- */

/* Whether what an abandoned job has under way would overwrite what a unit is given now, or carry it away. */
static inline uint32_t is_held(const slot *s, const hp_operation *o) {
    uint32_t found = DMA_NONE;
    if (is_suspect != 0U) {
        found = dma_holds(o->unit, s->number);
        is_suspect = found;
    }
    return (found == DMA_THIS) ? 1U : 0U;
}

static inline uint64_t run(const slot *s, const hp_operation *o) {
    volatile hp_mailbox *box = boxes[o->unit];
    uint64_t flags = FLAG_STUCK;
    if (box->done == box->request) {
        uint64_t deadline = s->base + (o->key >> 2U) + o->limit;
        box->entry = o->source;
        box->bss = o->target;
        box->bss_end = o->target + o->size;
        box->ranks = o->rank | ((uint64_t)o->ranks << 32U);
        box->deadline = deadline;
        box->finish = (CONTROL->execution != 0U) ? (deadline - HP_MARGIN) : 0U;
        fence(); /* all of it is there before the request is */
        box->request = box->request + 1U;
        fence();
        MSIP(o->unit + 1U) = 1U;
        flags = 0U;
    }
    return flags;
}

static inline uint64_t stop(const hp_operation *o, instants *at) {
    const volatile hp_mailbox *box = boxes[o->unit];
    uint64_t flags = FLAG_OVERRUN;
    if (box->done == box->request) {
        fence();
        at->begin = box->begin - base;
        at->end = box->end - base;
        flags = box->status;
    }
    return flags;
}

static inline uint64_t failure_of(uint32_t state) {
    return (state == DMA_FAILED) ? FLAG_ERROR : ((state == DMA_BUSY) ? FLAG_LATE : 0U);
}

/* Returns the tick at which a transfer is tried again that has to wait for another one, 0 if it need not. The last
 * try is the check that its phase is not over. */
static inline uint64_t again(const slot *s, const hp_operation *o, uint64_t now) {
    uint64_t end = s->base + (o->key >> 2U) + o->limit;
    uint64_t next = ((now + 1U) < end) ? (((now + 1U) << 2U) | (o->key & ORDER)) : (end << 2U);
    return (now < end) ? next : 0U;
}

#ifdef HP_DRIVERS
void hp_request_mode(void *data, uint64_t size) {
    const volatile uint64_t *wanted = (const volatile uint64_t *)data;
    if ((size == sizeof(uint64_t)) && (*wanted != 0U)) {
        CONTROL->request = *wanted;
    }
}
#endif

/* Does what is due in a slot, then writes it down. */
static inline void step(uint32_t place) {
    slot *s = &slots[place];
    const hp_operation *o = s->operation;
    instants at = {MTIME, 0U, 0U};
    uint64_t now = at.time;
    uint64_t flags = 0U;
    uint64_t retry = 0U;
    if (s->is_over != 0U) {
        flags = FLAG_SKIPPED;
    } else if (o->kind == OP_RUN) {
        flags = (is_held(s, o) != 0U) ? FLAG_LATE : run(s, o);
    } else if (o->kind == OP_STOP) {
        flags = stop(o, &at);
#ifdef HP_DRIVERS
    } else if (o->kind >= OP_INPUT) {
        hp_drivers[o->source]((void *)o->target, o->size);
#endif
    } else {
        uint32_t state = dma_state(o->channel, s->number);
        if ((o->kind == OP_COPY) && (state == DMA_IDLE) && (is_held(s, o) != 0U)) {
            state = DMA_BUSY;
        }
        flags = failure_of(state);
        if (o->kind == OP_COPY) {
            if (state == DMA_IDLE) {
                dma_start(o->channel, o, s->number);
            } else if (state == DMA_BUSY) {
                retry = again(s, o, now);
            } else {
                /* failed: its job is abandoned */
            }
        }
    }
    if (retry != 0U) {
        keys[place] = retry;
    } else {
        if ((flags & ~(uint64_t)FLAG_SKIPPED) != 0U) {
            abandon(s, o, flags, now);
            react(s, o, flags, now);
        }
        s->operation = &o[1];
        keys[place] = (s->operation == s->end) ? IDLE : ((s->base << 2U) + s->operation->key);
        at.time = now - base;
        record(&at, s->where, s->who, what(s->place, o->kind, flags, o->unit));
        s->place++;
    }
}

/* ---- tables ---- */

static inline void release(const hp_release *job) {
    const hp_program *program = &hp_programs[job->program];
    uint32_t place = program->slot;
    if ((program->slots > 1U) && (keys[place] != IDLE)) {
        place++;
    }
    slot *s = &slots[place];
    static uint64_t releases = 0U;
    s->operation = program->operations;
    s->end = &program->operations[program->count];
    s->base = current.start + job->time;
    releases++;
    s->number = releases;
    s->where = current.cycle | ((uint64_t)current.index << 32U);
    s->who = current.row | ((uint64_t)job->program << 32U);
    s->place = 0U;
    s->is_over = 0U;
    keys[place] = (s->base << 2U) + s->operation->key;
}

static void record_table(uint64_t begin, uint64_t end, uint64_t flags) {
    uint64_t now = MTIME; /* the first table is begun a little before the run */
    instants at = {0U, begin, end};
    if (now > base) {
        at.time = now - base;
    }
    record(&at, current.cycle | ((uint64_t)current.index << 32U), 0U, what(0U, OP_TABLE, flags, 0U));
}

static uint64_t table_key(void) {
    const hp_table *table = &hp_tables[current.index];
    uint64_t end = current.start + table->length;
    uint64_t key = (end << 2U) | SECOND;
    if (current.row < table->count) {
        key = ((current.start + table->releases[current.row].time) << 2U) | SECOND;
    } else if (current.is_decided == 0U) {
        key = ((end - HP_DECISION) << 2U) | LAST;
    } else {
        /* the end of the table is next */
    }
    return key;
}

static void begin_table(uint32_t index, uint64_t start) {
    uint32_t is_mode = 0U;
    if (index < HP_MODES) {
        is_mode = 1U;
    }
    current.index = index;
    current.start = start;
    current.row = 0U;
    current.next = hp_tables[index].next;
    current.is_decided = 1U - is_mode;
    if (is_mode != 0U) {
        current.mode = index;
    }
    CONTROL->table = index;
#ifdef HP_WATCHDOG
    *(volatile uint32_t *)HP_WATCHDOG = HP_WATCHDOG_VALUE;
#endif
    keys[TABLE_SLOT] = table_key();
    record_table(start - base, (start - base) + hp_tables[index].length, 0U);
}

__attribute__((noinline)) static void refuse(uint64_t wanted) {
    CONTROL->refused = CONTROL->refused + 1U;
    record_table(wanted, wanted, FLAG_REFUSED);
}

static inline uint32_t is_other(uint64_t wanted) {
    return ((wanted != 0U) && ((wanted - 1U) != current.mode)) ? 1U : 0U;
}

/* Takes a request for another mode, if there is one, a little before the end of the hyperperiod. In one access, so that
 * none is lost that comes between reading and clearing. What health rules want goes first. */
static void decide(void) {
    uint64_t wanted = 0U;
    __asm__ volatile("amoswap.d %0, zero, (%1)" : "=r"(wanted) : "r"(&CONTROL->request) : "memory");
    uint64_t healthy = health_mode();
    current.is_decided = 1U;
    if (is_other(healthy) != 0U) {
        if ((is_other(wanted) != 0U) && (wanted != healthy)) {
            refuse(wanted);
        }
        wanted = healthy;
    }
    if (is_other(wanted) != 0U) {
        uint32_t index = (wanted <= HP_MODES) ? hp_switches[current.mode][wanted - 1U] : HP_NO_TABLE;
        if (index != HP_NO_TABLE) {
            current.next = index;
#ifdef HP_REGULATORS
            regulators_request(current.mode, (uint32_t)wanted - 1U);
#endif
        } else {
            refuse(wanted);
        }
    }
}

static void end_table(void) {
    uint64_t end = current.start + hp_tables[current.index].length;
    current.cycle++;
    CONTROL->played = current.cycle;
    if (((CONTROL->cycles != 0U) && (current.cycle >= CONTROL->cycles)) || (health_stops() != 0U)) {
        keys[TABLE_SLOT] = IDLE; /* what is in progress continues to its end */
    } else {
        begin_table(current.next, end);
    }
}

static void advance(void) {
    const hp_table *table = &hp_tables[current.index];
    if (current.row < table->count) {
        release(&table->releases[current.row]);
        current.row++;
        keys[TABLE_SLOT] = table_key();
    } else if (current.is_decided == 0U) {
        decide();
        keys[TABLE_SLOT] = table_key();
    } else {
        end_table();
    }
}

static void play(void) {
    uint64_t key = 0U;
    while (key != IDLE) {
        uint32_t next = 0U;
        key = keys[0];
#pragma GCC unroll 16
        for (uint32_t i = 1U; i <= TABLE_SLOT; i++) {
            if (keys[i] < key) {
                key = keys[i];
                next = i;
            }
        }
        if (key != IDLE) {
            wait_until(key >> 2U);
            if (next == TABLE_SLOT) {
                advance();
            } else {
                step(next);
            }
        }
    }
}

/* ---- start ---- */

static void clear(uint64_t begin, uint64_t end) {
    for (uint64_t word = begin; word < end; word += 8U) {
        *(volatile uint64_t *)word = 0U;
    }
}

static void prepare_memory(void) {
    if (CONTROL->magic != HP_MAGIC) { /* it was not prepared */
        clear(HP_CONTROL + 8U, HP_CONTROL + (uint64_t)offsetof(hp_control, state));
        CONTROL->offset = HP_TICKS_PER_MS;
        clear(HP_BUFFERS, HP_BUFFERS_END);
    }
    clear(HP_CONTROL + (uint64_t)offsetof(hp_control, base), HP_CONTROL + (uint64_t)sizeof(hp_control));
    CONTROL->state = STATE_BOOTING;
}

static uint32_t start_core(uint32_t unit) {
    const hp_unit *u = &hp_units[unit];
    uint64_t box = (u->dspm + HP_DSPM_SIZE) - MAILBOX_SIZE;
    boxes[unit] = (volatile hp_mailbox *)box;
    clear(box, box + MAILBOX_SIZE);
    for (uint64_t at = 0U; at < u->code_size; at += 8U) {
        *(volatile uint64_t *)(u->ispm + at) = *(const uint64_t *)(u->code + at);
    }
    uint32_t hart = unit + 1U;
    hp_monitors[hart] = u->ispm;
    fence();
    MSIP(hart) = 1U;
    for (uint32_t attempts = 0U; (attempts < ATTEMPTS) && (boxes[unit]->ready == 0U); attempts++) {
        wait_until(MTIME + 1U + (HP_TICKS_PER_MS / 100U));
    }
    return (boxes[unit]->ready != 0U) ? 1U : 0U;
}

void runtime(void) {
    prepare_memory();
    WRITE_CSR(mie, MIE_TIMER);
    for (uint32_t place = 0U; place < HP_SLOTS; place++) {
        keys[place] = IDLE;
    }
    for (uint32_t unit = 0U; unit < HP_UNITS; unit++) {
        if (start_core(unit) == 0U) {
            CONTROL->state = STATE_NO_CORE;
            leave(1U);
        }
    }
#ifdef HP_CALIBRATE
    calibrate();
#endif
    cursor = TRACE;
    uint32_t first = (CONTROL->first < HP_MODES) ? (uint32_t)CONTROL->first : 0U;
#ifdef HP_REGULATORS
    if (regulators_load() == 0U) {
        CONTROL->state = STATE_NO_REGULATOR;
        leave(1U);
    }
#endif
    base = MTIME + CONTROL->offset;
#ifdef HP_REGULATORS
    regulators_start(first, base);
#endif
    CONTROL->base = base;
    CONTROL->state = STATE_RUNNING;
    begin_table(first, base);
    play();
    uint64_t ended = STATE_FINISHED;
    if (health_stops() != 0U) {
        ended = STATE_STOPPED;
    }
    CONTROL->state = ended; /* once: observers take the first state that is not a running one */
    if (CONTROL->report != 0U) {
        print_report();
    }
    leave((CONTROL->faults == 0U) ? 0U : 1U);
}
