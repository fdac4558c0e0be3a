/* Registers of the regulators (regulator.rdl), and what a program for Linux and the runtime of a board do alike with them. Who
 * includes it defines bw_put and bw_get: the register at an offset of a block, where 0 are the windows and n + 1 is unit n. */
#ifndef BW_UNIT_H
#define BW_UNIT_H
#include "bw_tables.h"

#define BW_ID 0x00U
#define BW_PARAMS 0x04U
#define BW_CTRL 0x08U
#define BW_STATUS 0x0cU
#define BW_WINDOW 0x10U
#define BW_DEF_RD 0x14U
#define BW_DEF_WR 0x18U
#define BW_CYCLES 0x18U
#define BW_REQ_TABLE 0x1cU
#define BW_EXTRA 0x20U
#define BW_OF 0x24U
#define BW_LONGEST 0x28U
#define BW_START_LO 0x2cU
#define BW_START_HI 0x30U
#define BW_LOCK 0x34U
#define BW_BUFFER 0x38U
#define BW_NOW_LO 0x3cU
#define BW_NOW_HI 0x40U
#define BW_HBWF 0x48425746U
#define BW_GO 1U
#define BW_ARM 2U

static const struct bw_entry bw_end = {0xffffffffU, 0U, 0U}; /* of the memory of a unit */

/* Writes all tables of a unit, from a header and an entry on. */
static inline void bw_load_unit(uint32_t number, uint32_t table, uint32_t entry) {
    const struct bw_unit *unit = &bw_units[number];
    for (uint32_t t = 0U; t < BW_TABLES; t++) {
        uint32_t at = 0x800U + (8U * (table + t));
        bw_put(number + 1U, at, unit->tables[t].windows);
        bw_put(number + 1U, at + 4U, ((unit->tables[t].successor + table) << 24U) | (unit->tables[t].base + entry));
    }
    for (uint32_t e = 0U; e <= unit->entries; e++) {
        const struct bw_entry *one = (e < unit->entries) ? &unit->table[e] : &bw_end;
        uint32_t at = 0x1000U + (16U * (entry + e));
        bw_put(number + 1U, at, one->wr_bytes);
        bw_put(number + 1U, at + 4U, one->rd_bytes);
        bw_put(number + 1U, at + 8U, one->start_window); /* last: it stores the entry */
    }
}

/* Writes windows, defaults and tables, while none is played. */
static inline void bw_load(void) {
    bw_put(0U, BW_CYCLES, BW_WINDOW_CYCLES);
    bw_put(0U, BW_EXTRA, BW_WINDOW_EXTRA);
    bw_put(0U, BW_OF, BW_WINDOW_OF);
    bw_put(0U, BW_LONGEST, BW_BURST_BYTES);
    for (uint32_t n = 0U; n < BW_UNITS; n++) {
        bw_put(n + 1U, BW_DEF_RD, bw_units[n].def_rd);
        bw_put(n + 1U, BW_DEF_WR, bw_units[n].def_wr);
        bw_load_unit(n, 0U, 0U);
    }
}

/* Returns the table that leads from a mode to another one: that of a switch, or the mode's own. */
static inline uint32_t bw_request_of(uint32_t from, uint32_t to) {
    uint32_t request = to; /* modes come first, in the same order */
#if BW_SWITCHES > 0
    for (uint32_t i = 0U; i < BW_SWITCHES; i++) {
        if ((bw_switches[i].from == from) && (bw_switches[i].to == to)) {
            request = bw_switches[i].request;
        }
    }
#else
    (void)from;
#endif
    return request;
}

/* Begins with the table requested at an instant of the time base, after a window without budgets. */
static inline void bw_start(uint64_t instant) {
    bw_put(0U, BW_START_LO, (uint32_t)instant);
    bw_put(0U, BW_START_HI, (uint32_t)(instant >> 32U));
    bw_put(0U, BW_CTRL, BW_ARM);
}
#endif
