/* What the emulator calls before every basic block: it counts cycles and knows when to stop. In Python, the call would cost
 * a hundred times as much as the block itself.
 *
 * All it knows is in one page of integers per hart (`Page` in block_hook.py), which stands in the same allocation as the
 * memories of the machine, so that it can also look at the instructions that it counts.
 *
 * A core issues an instruction in each cycle, in order, when what it uses is there. It multiplies and divides in one
 * unit that does one thing at a time. What a block has begun is over at its end. */

#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

_Static_assert(sizeof(void *) == 8, "an address fills a word of the page");

enum { MAX_WATCHED = 64, MAX_REGIONS = 136, KNOWN = 512, CLASSES = 8 };
enum { LOAD, LOAD_BYTE, MULTIPLY, MULTIPLY_WORD, DIVIDE, TAKEN, MISPREDICTED, OTHER }; /* places in `cycles` */

typedef struct {
    int64_t count;    /* cycles of a simple instruction that were begun */
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
    int64_t weight;     /* what a load or store counts beyond one, */
    int64_t near;       /* but from this address */
    int64_t end;        /* up to this one */
    int64_t cycles[CLASSES]; /* until the result of an instruction can be used; of a branch until the next begins */
    int64_t watched[MAX_WATCHED];
    struct { int64_t base, end, offset; } region[MAX_REGIONS]; /* offset from the page */
    struct { int64_t address; uint32_t count; uint16_t size, returns; } known[KNOWN]; /* blocks counted before, by address */
    struct { int64_t end, next; } branch[KNOWN]; /* what followed a block, by the address behind it */
} Page;

/* An instruction: registers that it uses and sets, 0 for none. */
typedef struct {
    uint32_t kind, size, uses, also, sets, returns;
} Instruction;

static Instruction decoded(const uint8_t *code, int64_t left) {
    uint32_t half = code[0] | (uint32_t)code[1] << 8, kind = half >> 13, low = half >> 2 & 31, high = half >> 7 & 31;
    Instruction i = {OTHER, 2, high, low, high, half == 0x8082};
    if ((half & 3) == 3) {
        uint32_t word = left < 4 ? half : half | (uint32_t)code[2] << 16 | (uint32_t)code[3] << 24;
        uint32_t opcode = word & 0x7f, function = word >> 12 & 7, is_word = opcode == 0x3b;
        i = (Instruction){OTHER, 4, word >> 15 & 31, 0, word >> 7 & 31, word == 0x8067};
        if (opcode == 0x33 || is_word || opcode == 0x63 || opcode == 0x23 || opcode == 0x2f) i.also = word >> 20 & 31;
        if (opcode == 0x63 || opcode == 0x23) i.sets = 0;
        if (opcode == 0x17 || opcode == 0x37 || opcode == 0x6f) i.uses = 0;
        if (opcode == 0x2f || opcode == 0x03) i.kind = (function & 3) < 2 ? LOAD_BYTE : LOAD;
        if ((opcode & 0x77) == 0x33 && word >> 25 == 1)
            i.kind = function >= 4 ? DIVIDE : is_word ? MULTIPLY_WORD : MULTIPLY;
        return i;
    }
    uint32_t shorter = 8 + (high & 7), short_low = 8 + (low & 7), is_load = kind < 4, by_stack = (half & 3) == 2;
    if ((half & 3) == 1) { /* what computes, and branches */
        i.also = kind == 4 && (high >> 3 & 3) == 3 ? short_low : 0;
        if (kind >= 4) i.uses = kind == 5 ? 0 : shorter;
        if (kind >= 4) i.sets = kind == 4 ? shorter : 0;
    } else if (kind & 2) {
        i.kind = is_load ? LOAD : OTHER;
        i.uses = by_stack ? 2 : shorter;
        i.also = is_load ? 0 : by_stack ? low : short_low;
        i.sets = !is_load ? 0 : by_stack ? high : short_low;
    } else if (kind == 0) { /* c.addi4spn, c.slli */
        i.uses = by_stack ? high : 2;
        i.also = 0;
        i.sets = by_stack ? high : short_low;
    }
    return i;
}

/* The cycles of the instructions in [from, to), and whether the last one returns. */
static int64_t cycles(const Page *page, int64_t from, int64_t to, uint32_t *returns) {
    int64_t ready[32] = {0}, unit = 0, now = 0, number = 0;
    *returns = 0;
    while (number < page->memories && !(page->region[number].base <= from && from < page->region[number].end)) number++;
    if (number == page->memories) return 0;
    int64_t position = page->region[number].offset + from - page->region[number].base, end = position + to - from;
    if (end > page->span) end = page->span;
    for (const uint8_t *memory = (const uint8_t *)page; position + 1 < end;) {
        Instruction i = decoded(memory + position, end - position);
        if (ready[i.uses] > now) now = ready[i.uses];
        if (ready[i.also] > now) now = ready[i.also];
        int is_long = i.kind == MULTIPLY || i.kind == MULTIPLY_WORD || i.kind == DIVIDE;
        if (is_long && unit > now) now = unit;
        int64_t known = now + page->cycles[i.kind];
        if (is_long) unit = known;
        if (i.sets) ready[i.sets] = known;
        now += 1;
        position += i.size;
        *returns = i.returns;
    }
    return unit > now ? unit : now;
}

/* What the core waits between the block that was begun last and the one at an address. It expects what followed last
 * time, at first what lies behind, and of a return what it returns to. */
static int64_t branched(Page *page, int64_t at) {
    int64_t end = page->block + page->size, place = end >> 1 & (KNOWN - 1), last = page->block >> 1 & (KNOWN - 1);
    if (page->block < 0) return 0;
    int64_t expected = page->branch[place].end == end ? page->branch[place].next : end;
    if (page->known[last].address == page->block && page->known[last].returns) expected = at;
    page->branch[place].end = end;
    page->branch[place].next = at;
    return (at == end ? 0 : page->cycles[TAKEN] - 1) + (at == expected ? 0 : page->cycles[MISPREDICTED] - 1);
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
    page->count += branched(page, at);
    page->block = at;
    page->size = size;
    int64_t place = at >> 1 & (KNOWN - 1);
    uint32_t returns;
    if (page->known[place].address != at || page->known[place].size != size) {
        page->known[place].address = at;
        page->known[place].size = (uint16_t)size;
        page->known[place].count = (uint32_t)cycles(page, at, at + size, &returns);
        page->known[place].returns = (uint16_t)returns;
    }
    page->count += page->known[place].count;
}

/* The instructions from an address on of the block that was begun last were not executed. */
EXPORTED void halpipe_take_back(Page *page, int64_t from) {
    int64_t end = page->block + page->size;
    uint32_t returns;
    if (page->block < 0 || from < page->block || from >= end) return;
    page->count -= cycles(page, page->block, end, &returns) - cycles(page, page->block, from, &returns);
    page->block = -1;
}

/* Before every load and store: emulators allow what the cores of the board trap on, and know no slow memory. */
EXPORTED void halpipe_before_access(void *engine, int kind, uint64_t address, int size, int64_t value, void *data) {
    Page *page = data;
    (void)value;
    if (!((int64_t)address >= page->near && (int64_t)address < page->end)) page->count += page->weight;
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
