/* The DMA engine. A start does not wait: the tables say when a transfer must be complete. */
#include "halpipe.h"

#if HP_DMA_KIND == HP_DMA_PDMA /* SiFive PDMA, as in FU540, FU740 and PolarFire SoC */

enum { CLAIM = 1u, RUN = 2u, DONE = 1u << 30, TRANSACTIONS_OF_64 = 6u << 24 | 6u << 28 };

typedef struct {
    uint32_t control, config;
    uint64_t bytes, target, source;
} pdma_channel;

#define CHANNEL(n) ((volatile pdma_channel *)(HP_DMA + (n) * HP_DMA_STRIDE))

static uint8_t busy[HP_CHANNELS];

void dma_start(unsigned channel, uint64_t source, uint64_t target, uint64_t size) {
    volatile pdma_channel *c = CHANNEL(channel);
    c->control = CLAIM; /* resets what was set before */
    c->config = TRANSACTIONS_OF_64;
    c->bytes = size;
    c->target = target;
    c->source = source;
    FENCE();
    c->control = CLAIM | RUN;
    busy[channel] = 1;
}

int dma_is_complete(unsigned channel) {
    if (!busy[channel]) return 1;
    volatile pdma_channel *c = CHANNEL(channel);
    if (!(c->control & DONE)) return 0;
    c->control = 0;
    busy[channel] = 0;
    return 1;
}

int dma_work(void) { return 0; }

#else /* none: the management core copies while it would wait */

enum { PIECE = 64 };

static struct {
    uint64_t source, target, size;
} pending[HP_CHANNELS];

void dma_start(unsigned channel, uint64_t source, uint64_t target, uint64_t size) {
    pending[channel].source = source;
    pending[channel].target = target;
    pending[channel].size = size;
}

int dma_is_complete(unsigned channel) { return pending[channel].size == 0; }

int dma_work(void) {
    for (unsigned channel = 0; channel < HP_CHANNELS; channel++) {
        uint64_t size = pending[channel].size;
        if (!size) continue;
        if (size > PIECE) size = PIECE;
        uint64_t done = 0;
        if (((pending[channel].source | pending[channel].target) & 7) == 0) {
            for (; done + 8 <= size; done += 8) {
                *(volatile uint64_t *)(pending[channel].target + done) =
                    *(volatile uint64_t *)(pending[channel].source + done);
            }
        }
        for (; done < size; done++) {
            *(volatile uint8_t *)(pending[channel].target + done) =
                *(volatile uint8_t *)(pending[channel].source + done);
        }
        pending[channel].source += size;
        pending[channel].target += size;
        pending[channel].size -= size;
        FENCE();
        return 1;
    }
    return 0;
}

#endif
