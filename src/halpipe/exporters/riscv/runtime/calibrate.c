/* Measures the target before the run, for `halpipe deploy calibrate`: transfers, and instructions of cores. Everything is in
 * ticks of the timer; what is measured is long enough for them. */
#include "halpipe.h"

#define REPEATS 3U
#define PAGE 4096U
#define LARGEST 32768UL

typedef uint64_t loop(void);
extern const char hp_loops[1];
extern const char hp_loops_end[1];
extern const uint64_t hp_loop_places[CALIBRATE_LOOPS]; /* offsets in what is copied */

static void note(uint64_t kind, uint64_t amount, uint64_t ticks) {
    volatile hp_calibration *c = &CALIBRATION->entries[CALIBRATION->count];
    c->kind = kind;
    c->amount = amount;
    c->ticks = ticks;
    CALIBRATION->count = CALIBRATION->count + 1U;
}

/* Returns the instant at which a tick begins. */
static uint64_t edge(void) {
    uint64_t before = MTIME;
    uint64_t now = before;
    while (now == before) {
        now = MTIME;
    }
    return now;
}

static void measure_transfer(uint64_t kind, uint64_t source, uint64_t target, uint64_t size) {
    const hp_operation o = {0U, source, target, size, 0U, 0U, 0U, 0U, 0U, 0U, 0U};
    for (uint32_t i = 0U; i < REPEATS; i++) {
        uint64_t begin = edge();
        dma_start(0U, &o, 1U);
        uint32_t state = DMA_BUSY;
        while (state == DMA_BUSY) {
            (void)dma_work();
            state = dma_state(0U, 1U);
        }
        note(kind, (state == DMA_IDLE) ? size : 0U, MTIME - begin);
    }
}

static uint64_t limited(uint64_t size) { return (size < LARGEST) ? size : LARGEST; }

static void measure_transfers(void) {
    const uint64_t main = HP_TRACE; /* not in use yet, and large */
    uint64_t code = hp_units[0].ispm + PAGE;
    uint64_t data = hp_units[0].dspm;
    const uint64_t shares[3] = {64U, 8U, 1U};
    for (uint32_t i = 0U; i < 3U; i++) {
        uint64_t into_code = limited(HP_ISPM_SIZE / 2U) / shares[i];
        uint64_t into_data = limited(HP_DSPM_SIZE / 2U) / shares[i];
        measure_transfer(CALIBRATE_ISPM, main, code, into_code & ~63UL);
        measure_transfer(CALIBRATE_DSPM, main, data, into_data & ~63UL);
        measure_transfer(CALIBRATE_MAIN, data, main, into_data & ~63UL);
    }
}

/* Has the first core execute something as it does jobs; the management core sleeps meanwhile. Returns 0 if it failed. */
static uint64_t executed(uint64_t entry) {
    volatile hp_mailbox *box = (volatile hp_mailbox *)((hp_units[0].dspm + HP_DSPM_SIZE) - MAILBOX_SIZE);
    box->entry = entry; /* the rest of it is zero since the start */
    box->deadline = MTIME + (1000UL * HP_TICKS_PER_MS);
    fence();
    box->request = box->request + 1U;
    fence();
    MSIP(1U) = 1U;
    while (box->done != box->request) {
        MTIMECMP(0U) = MTIME + 1U + (HP_TICKS_PER_MS / 10U);
        wait_for_interrupt();
    }
    fence();
    return (box->status == 0U) ? (box->end - box->begin) : 0U;
}

static void measure_instructions(void) {
    uint64_t at = (hp_units[0].ispm + HP_ISPM_SIZE) - PAGE;
    uint64_t size = (uint64_t)hp_loops_end - (uint64_t)hp_loops;
    for (uint64_t i = 0U; i < size; i += 8U) {
        *(volatile uint64_t *)(at + i) = *(const uint64_t *)((uint64_t)hp_loops + i);
    }
    for (uint32_t i = 0U; i < CALIBRATE_LOOPS; i++) {
        note(CALIBRATE_LOOP + i, CALIBRATE_TURNS, executed(at + hp_loop_places[i]));
    }
    loop *own = (loop *)((uint64_t)hp_loops + hp_loop_places[0]);
    for (uint32_t i = 0U; i < REPEATS; i++) {
        uint64_t begin = edge();
        (void)own();
        note(CALIBRATE_MANAGEMENT, CALIBRATE_TURNS, MTIME - begin);
    }
}

void calibrate(void) {
    CALIBRATION->count = 0U;
    measure_transfers();
    measure_instructions();
}
