/* Regulators of memory bandwidth: loaded before the run, started with its first table, and switched with the runtime.
 * The time base of their START is the timer. */
#include "halpipe.h"

#define REGULATOR(block, offset) (*(volatile uint32_t *)(HP_REGULATORS + ((block) * 0x100000UL) + (offset)))

static inline void bw_put(uint64_t block, uint64_t offset, uint32_t value) {
    REGULATOR(block, offset) = value;
}

#include "bw_unit.h"

uint32_t regulators_load(void) {
    uint32_t is_loaded = 0U;
    if (REGULATOR(0UL, BW_ID) == BW_HBWF) {
        bw_put(0U, BW_LOCK, 1U);
        bw_put(0U, BW_CTRL, 0U);
        bw_load();
        if (REGULATOR(0UL, BW_CYCLES) == BW_WINDOW_CYCLES) {
            is_loaded = 1U;
        }
    }
    return is_loaded;
}

void regulators_start(uint32_t mode, uint64_t instant) {
    bw_put(0U, BW_REQ_TABLE, mode);
    bw_start(instant - HP_REGULATORS_LEAD);
    bw_put(0U, BW_LOCK, 0U);
}

void regulators_request(uint32_t from, uint32_t to) {
    bw_put(0U, BW_REQ_TABLE, bw_request_of(from, to));
}
