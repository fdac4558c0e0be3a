/* What the emulator calls before every basic block: it counts instructions and knows when to stop. In Python, the call
 * would cost a hundred times as much as the block itself.
 *
 * All it knows is in one page of integers per hart (`Page` in block_hook.py), which stands in the same allocation as the
 * memories of the machine, so that it can also look at the instructions that it counts. */

#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

_Static_assert(sizeof(void *) == 8, "an address fills a word of the page");

enum { MAX_WATCHED = 64, MAX_REGIONS = 136, KNOWN = 512 };

typedef struct {
    int64_t count;    /* instructions that were begun */
    int64_t limit;    /* stop before the first block at or beyond this count */
    int64_t block;    /* address of the block that was begun last, -1 for none */
    int64_t size;     /* its size in bytes */
    int64_t skip;     /* a watched address at which not to stop once, -1 for none */
    int64_t hit;      /* the watched address at which it stopped, -1 for none */
    int64_t watching; /* number of watched addresses */
    int64_t memories; /* number of memories */
    int64_t span;     /* bytes from the page to the end of the last memory */
    int64_t full;     /* 1 if it stopped at the limit */
    int (*stop)(void *engine); /* uc_emu_stop */
    int64_t misaligned; /* the address of an access that is not aligned, -1 for none */
    int64_t stores;     /* 1 if that is a store */
    int64_t weight;     /* what a load or store counts beyond one */
    int64_t multiply;   /* what a multiplication or division counts beyond one */
    int64_t unused;
    int64_t watched[MAX_WATCHED];
    struct { int64_t base, end, offset; } region[MAX_REGIONS]; /* offset from the page */
    struct { int64_t address; uint32_t instructions, size; } known[KNOWN]; /* blocks counted before, by address */
} Page;

/* Whether an instruction loads or stores, by its first two bytes. */
static int is_access(uint32_t half) {
    uint32_t opcode = half & 0x7f, quadrant = half & 3, kind = half >> 13 & 7;
    if (quadrant == 3)
        return opcode == 0x03 || opcode == 0x07 || opcode == 0x23 || opcode == 0x27 || opcode == 0x2f;
    return quadrant != 1 && kind != 0 && kind != 4;
}

/* Whether four bytes are an instruction that multiplies or divides: of opcode 0x33, or 0x3b for words. */
static int is_multiply(const uint8_t *code) { return (code[0] & 0x77) == 0x33 && code[3] >> 1 == 1; }

/* The number of instructions in [position, end): of two bytes, or four where the two lowest bits are set. */
static int64_t instructions(const uint8_t *memory, int64_t position, int64_t end, const Page *page) {
    int64_t weight = page->weight;
    int64_t number = 0;
    for (; position < end; number++) {
        if (weight && position + 1 < end && is_access(memory[position] | (uint32_t)memory[position + 1] << 8))
            number += weight;
        if (page->multiply && position + 3 < end && is_multiply(memory + position))
            number += page->multiply;
        position += (memory[position] & 3) == 3 ? 4 : 2;
    }
    return number;
}

EXPORTED void halpipe_before_block(void *engine, uint64_t address, uint32_t size, void *data) {
    Page *page = data;
    int64_t at = (int64_t)address;
    if (page->count >= page->limit) {
        page->full = 1;
        page->stop(engine);
        return;
    }
    if (at != page->skip) {
        for (int64_t i = 0; i < page->watching; i++) {
            if (page->watched[i] == at) {
                page->hit = at;
                page->stop(engine);
                return;
            }
        }
    }
    page->skip = -1;
    page->block = at;
    page->size = size;
    int64_t place = (at >> 1) & (KNOWN - 1);
    if (page->known[place].address == at && page->known[place].size == size) {
        page->count += page->known[place].instructions;
        return;
    }
    for (int64_t i = 0; i < page->memories; i++) {
        if (page->region[i].base <= at && at < page->region[i].end) {
            int64_t position = page->region[i].offset + at - page->region[i].base;
            int64_t end = position + size < page->span ? position + size : page->span;
            int64_t number = instructions(data, position, end, page);
            page->count += number;
            page->known[place].address = at;
            page->known[place].size = size;
            page->known[place].instructions = (uint32_t)number;
            break;
        }
    }
}

/* Before every load and store of an application core: emulators allow what the cores of the board trap on. */
EXPORTED void halpipe_before_access(void *engine, int kind, uint64_t address, int size, int64_t value, void *data) {
    Page *page = data;
    (void)value;
    if ((address & (uint64_t)(size - 1)) != 0 && page->misaligned < 0) {
        page->misaligned = (int64_t)address;
        page->stores = kind == 17; /* UC_MEM_WRITE */
        page->stop(engine);
    }
}

#ifndef FINGERPRINT
#define FINGERPRINT ""
#endif
EXPORTED const char halpipe_fingerprint[] = FINGERPRINT;
