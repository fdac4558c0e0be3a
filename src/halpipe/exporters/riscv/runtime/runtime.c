/* The management core: plays the tables. Every operation has its instant; between them the core sleeps in WFI.
 *
 * A table releases jobs. A job is a program of operations, in progress in the slot of its first unit, from the tick at
 * which it was released. Units are exclusive, so one slot for each is enough; and since a program goes on by itself, it does not
 * matter whether the table that released it has ended meanwhile. */
#include "halpipe.h"

#define IDLE (~0ull)
#define TABLE_SLOT HP_UNITS
#define SECOND 1 /* order in a key: after checks, before transfers */
#define LAST 3

typedef struct {
    const hp_operation *operation, *end;
    uint64_t base;  /* mtime of the job's start */
    uint64_t job;   /* cycle | table << 32 | release << 48, as in a trace record */
    uint64_t place; /* position of the operation | program << 32 */
    uint64_t is_abandoned;
} slot;

static slot slots[HP_UNITS];
static uint64_t keys[HP_UNITS + 1]; /* next instant of every slot, and of the table: mtime << 2 | order */
static hp_mailbox *boxes[HP_UNITS];
uint64_t hp_monitors[HP_UNITS + 1]; /* by hart */

static struct {
    uint64_t start; /* mtime */
    uint32_t index, row, next, cycle, mode;
    uint8_t is_decided;
} current;

static uint64_t base, traced;
static hp_record *cursor;

static inline void wait_until(uint64_t instant) {
    if (MTIME >= instant) return;
    MTIMECMP(0) = instant;
    while (MTIME < instant) {
        if (!dma_work()) WFI();
    }
}

/* ---- the trace ---- */

static inline void record(uint64_t time, uint64_t begin, uint64_t end, uint64_t job, uint64_t what) {
    uint64_t *word = (uint64_t *)cursor;
    word[0] = time;
    word[1] = begin;
    word[2] = end;
    word[3] = job;
    word[4] = what;
    if (++cursor == TRACE + HP_TRACE_CAPACITY) cursor = TRACE;
    CONTROL->traced = ++traced;
}

static inline uint64_t what(uint64_t place, uint64_t kind, uint64_t flags) { return place | kind << 16 | flags << 24; }

static void abandon(slot *s, const hp_operation *o, uint64_t flags, uint64_t now) {
    s->is_abandoned = 1;
    hp_fault *f = &FAULTS[CONTROL->faults % HP_FAULT_CAPACITY];
    hp_mailbox *box = boxes[o->unit];
    f->time = now - base;
    f->cycle = (uint32_t)s->job;
    f->table = (uint16_t)(s->job >> 32);
    f->release = (uint16_t)(s->job >> 48);
    f->program = (uint32_t)(s->place >> 32);
    f->hart = o->unit + 1;
    f->flags = (uint8_t)flags;
    f->kind = o->kind;
    int is_trap = (flags & (FLAG_FAULT | FLAG_OVERRUN)) && box->done == box->request;
    f->cause = is_trap ? box->cause : 0;
    f->epc = is_trap ? box->epc : 0;
    f->tval = is_trap ? box->tval : 0;
    f->reserved[0] = f->reserved[1] = 0;
    CONTROL->faults++;
}

/* ---- operations; each returns its flags ---- */

static inline uint64_t run(const slot *s, const hp_operation *o) {
    hp_mailbox *box = boxes[o->unit];
    if (box->done != box->request) return FLAG_STUCK;
    uint64_t deadline = s->base + (o->key >> 2) + o->limit;
    box->entry = o->source;
    box->bss = o->target;
    box->bss_end = o->target + o->size;
    box->ranks = o->rank | (uint64_t)o->ranks << 32;
    box->deadline = deadline;
    box->finish = CONTROL->execution ? deadline - HP_MARGIN : 0;
    box->request++;
    FENCE();
    MSIP(o->unit + 1) = 1;
    return 0;
}

/* Does what is due in a slot, then writes it down. */
static inline void step(unsigned unit) {
    slot *s = &slots[unit];
    const hp_operation *o = s->operation;
    uint64_t now = MTIME, flags = 0, begin = 0, end = 0;
    if (s->is_abandoned) {
        flags = FLAG_SKIPPED;
    } else if (o->kind == OP_COPY) {
        if (dma_is_complete(o->channel)) {
            dma_start(o->channel, o->source, o->target, o->size);
        } else {
            uint64_t end = s->base + (o->key >> 2) + o->limit;
            if (now < end) { /* the transfer before it is still under way: again at the next tick, the last time as a check */
                keys[unit] = now + 1 < end ? (now + 1) << 2 | (o->key & 3) : end << 2;
                return;
            }
            flags = FLAG_LATE; /* and its phase is over */
        }
    } else if (o->kind == OP_DONE) {
        if (!dma_is_complete(o->channel)) flags = FLAG_LATE;
    } else if (o->kind == OP_RUN) {
        flags = run(s, o);
    } else {
        hp_mailbox *box = boxes[o->unit];
        if (box->done == box->request) {
            begin = box->begin - base;
            end = box->end - base;
            flags = box->status;
        } else {
            flags = FLAG_OVERRUN;
        }
    }
    if (flags & ~FLAG_SKIPPED) abandon(s, o, flags, now);
    s->operation = o + 1;
    keys[unit] = o + 1 == s->end ? IDLE : (s->base << 2) + o[1].key;
    record(now - base, begin, end, s->job, what(s->place++, o->kind, flags));
}

/* ---- tables ---- */

static inline void release(const hp_release *job) {
    const hp_program *program = &hp_programs[job->program];
    slot *s = &slots[program->unit];
    s->operation = program->operations;
    s->end = program->operations + program->count;
    s->base = current.start + job->time;
    s->job = current.cycle | (uint64_t)current.index << 32 | (uint64_t)current.row << 48;
    s->place = (uint64_t)job->program << 32;
    s->is_abandoned = 0;
    keys[program->unit] = (s->base << 2) + s->operation->key;
}

static void record_table(uint64_t begin, uint64_t end, uint64_t flags) {
    uint64_t now = MTIME; /* the first table is begun a little before the run */
    record(now > base ? now - base : 0, begin, end, current.cycle | (uint64_t)current.index << 32, what(0, OP_TABLE, flags));
}

static uint64_t table_key(void) {
    const hp_table *table = &hp_tables[current.index];
    uint64_t end = current.start + table->length;
    if (current.row < table->count) return (current.start + table->releases[current.row].time) << 2 | SECOND;
    if (!current.is_decided) return (end - HP_DECISION) << 2 | LAST;
    return end << 2 | SECOND;
}

static void begin_table(uint32_t index, uint64_t start) {
    int is_mode = index < HP_MODES;
    current.index = index;
    current.start = start;
    current.row = 0;
    current.next = hp_tables[index].next;
    current.is_decided = !is_mode;
    if (is_mode) current.mode = index;
    CONTROL->table = index;
    keys[TABLE_SLOT] = table_key();
    record_table(start - base, start - base + hp_tables[index].length, 0);
}

/* Takes a request for another mode, if there is one, a little before the end of the hyperperiod. */
static void decide(void) {
    uint64_t wanted = CONTROL->request;
    current.is_decided = 1;
    if (!wanted) return;
    CONTROL->request = 0;
    int index = wanted <= HP_MODES && wanted - 1 != current.mode ? hp_switches[current.mode][wanted - 1] : -1;
    if (index >= 0) {
        current.next = (uint32_t)index;
    } else if (wanted - 1 != current.mode) {
        CONTROL->refused++;
        record_table(wanted, wanted, FLAG_REFUSED);
    }
}

static void advance(void) {
    const hp_table *table = &hp_tables[current.index];
    if (current.row < table->count) {
        release(&table->releases[current.row]);
        current.row++;
    } else if (!current.is_decided) {
        decide();
    } else {
        current.cycle++;
        CONTROL->played = current.cycle;
        if (CONTROL->cycles && current.cycle >= CONTROL->cycles) {
            keys[TABLE_SLOT] = IDLE; /* what is in progress goes on to its end */
            return;
        }
        begin_table(current.next, current.start + table->length);
        return;
    }
    keys[TABLE_SLOT] = table_key();
}

static void play(void) {
    for (;;) {
        unsigned next = 0;
        uint64_t key = keys[0];
#pragma GCC unroll 16
        for (unsigned i = 1; i <= TABLE_SLOT; i++) {
            if (keys[i] < key) key = keys[next = i];
        }
        if (key == IDLE) return;
        wait_until(key >> 2);
        if (next == TABLE_SLOT) {
            advance();
        } else {
            step(next);
        }
    }
}

/* ---- start ---- */

static void prepare_memory(void) {
    if (CONTROL->magic != HP_MAGIC) { /* nobody did */
        for (size_t i = 1; i < offsetof(hp_control, state) / 8; i++) ((volatile uint64_t *)CONTROL)[i] = 0;
        CONTROL->offset = HP_TICKS_PER_MS;
        for (uint64_t at = HP_BUFFERS; at < HP_BUFFERS_END; at += 8) *(volatile uint64_t *)at = 0;
    }
    CONTROL->played = CONTROL->table = CONTROL->traced = CONTROL->faults = CONTROL->refused = 0;
    CONTROL->state = STATE_BOOTING;
}

static int start_core(unsigned unit) {
    const hp_unit *u = &hp_units[unit];
    hp_mailbox *box = boxes[unit] = (hp_mailbox *)(u->dspm + HP_DSPM_SIZE - MAILBOX_SIZE);
    for (unsigned i = 0; i < sizeof *box / 8; i++) ((volatile uint64_t *)box)[i] = 0;
    for (uint64_t i = 0; i < u->monitor_size; i += 8) {
        *(volatile uint64_t *)(u->ispm + i) = *(const uint64_t *)(u->monitor + i);
    }
    hp_monitors[unit + 1] = u->ispm;
    FENCE();
    MSIP(unit + 1) = 1;
    for (int attempts = 0; attempts < 1000; attempts++) {
        if (box->ready) return 1;
        wait_until(MTIME + 1 + HP_TICKS_PER_MS / 100);
    }
    return 0;
}

void runtime(void) {
    prepare_memory();
    WRITE_CSR(mie, MIE_TIMER);
    for (unsigned unit = 0; unit < HP_UNITS; unit++) {
        keys[unit] = IDLE;
        if (!start_core(unit)) {
            CONTROL->state = STATE_NO_CORE;
            leave(0);
        }
    }
    cursor = TRACE;
    base = MTIME + CONTROL->offset;
    CONTROL->base = base;
    CONTROL->state = STATE_RUNNING;
    begin_table(CONTROL->first < HP_MODES ? (uint32_t)CONTROL->first : 0, base);
    play();
    CONTROL->state = STATE_FINISHED;
    if (CONTROL->report) report();
    leave(CONTROL->faults == 0);
}
