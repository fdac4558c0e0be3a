/* The DMA engine. A start does not wait: the tables say when a transfer must be complete. */
#include "halpipe.h"

static uint64_t owners[HP_CHANNELS]; /* of what is under way, << UNIT_BITS, with the unit; 0: nothing */

#define UNIT_BITS 8U

static uint32_t is_busy(uint32_t channel); /* a look only: the answer is that of the owner's own check */

uint32_t dma_holds(uint32_t unit, uint64_t owner) {
    uint32_t found = DMA_NONE;
    for (uint32_t channel = 0U; channel < HP_CHANNELS; channel++) {
        uint64_t held = owners[channel];
        if ((held != 0U) && ((held >> UNIT_BITS) != owner) && (is_busy(channel) != 0U)) {
            found = (((held ^ unit) & 0xffU) == 0U) ? DMA_THIS : ((found == DMA_NONE) ? DMA_OTHERS : found);
        }
    }
    return found;
}

#if HP_DMA_KIND == HP_DMA_PDMA /* SiFive PDMA, as in FU540, FU740 and PolarFire SoC */

#define CLAIM 1U
#define RUN 2U
#define DONE 0x40000000U
#define FAILED 0x80000000U
#define TRANSACTIONS_OF_64 0x66000000U

typedef struct {
    uint32_t control;
    uint32_t config;
    uint64_t bytes;
    uint64_t target;
    uint64_t source;
} pdma_channel;

static inline volatile pdma_channel *registers_of(uint32_t channel) {
    return (volatile pdma_channel *)(HP_DMA + ((uint64_t)channel * HP_DMA_STRIDE));
}

void dma_start(uint32_t channel, const hp_operation *o, uint64_t owner) {
    volatile pdma_channel *c = registers_of(channel);
    c->control = CLAIM; /* resets what was set before */
    c->config = TRANSACTIONS_OF_64;
    c->bytes = o->size;
    c->target = o->target;
    c->source = o->source;
    fence();
    c->control = CLAIM | RUN;
    owners[channel] = (owner << UNIT_BITS) | o->unit;
}

static uint32_t is_busy(uint32_t channel) {
    return ((registers_of(channel)->control & (DONE | FAILED)) == 0U) ? 1U : 0U;
}

uint32_t dma_state(uint32_t channel, uint64_t owner) {
    uint32_t state = DMA_IDLE;
    if (owners[channel] != 0U) {
        volatile pdma_channel *c = registers_of(channel);
        uint32_t control = c->control;
        if ((control & (DONE | FAILED)) == 0U) {
            state = DMA_BUSY;
        } else {
            if (((control & FAILED) != 0U) && ((owners[channel] >> UNIT_BITS) == owner)) {
                state = DMA_FAILED;
            }
            c->control = 0U;
            owners[channel] = 0U;
            fence(); /* the data is visible before its arrival is announced */
        }
    }
    return state;
}

uint32_t dma_work(void) { return 0U; }

#else /* none: the management core copies while it would wait */

#define PIECE 64U
#define WORD 8U

typedef struct {
    uint64_t source;
    uint64_t target;
    uint64_t size;
} transfer;

static transfer pending[HP_CHANNELS];

void dma_start(uint32_t channel, const hp_operation *o, uint64_t owner) {
    owners[channel] = (owner << UNIT_BITS) | o->unit;
    pending[channel].source = o->source;
    pending[channel].target = o->target;
    pending[channel].size = o->size;
}

static uint32_t is_busy(uint32_t channel) { return (pending[channel].size != 0U) ? 1U : 0U; }

uint32_t dma_state(uint32_t channel, uint64_t owner) {
    (void)owner;
    return (is_busy(channel) != 0U) ? DMA_BUSY : DMA_IDLE;
}

/* Copies at most PIECE bytes. */
static void copy(uint64_t source, uint64_t target, uint64_t size) {
    uint64_t done = 0U;
    if (((source | target) & (WORD - 1U)) == 0U) {
        while ((done + WORD) <= size) {
            *(volatile uint64_t *)(target + done) = *(volatile const uint64_t *)(source + done);
            done += WORD;
        }
    }
    while (done < size) {
        *(volatile uint8_t *)(target + done) = *(volatile const uint8_t *)(source + done);
        done++;
    }
    fence();
}

uint32_t dma_work(void) {
    uint32_t worked = 0U;
    for (uint32_t channel = 0U; (channel < HP_CHANNELS) && (worked == 0U); channel++) {
        uint64_t size = pending[channel].size;
        if (size != 0U) {
            size = (size > PIECE) ? PIECE : size;
            copy(pending[channel].source, pending[channel].target, size);
            pending[channel].source += size;
            pending[channel].target += size;
            pending[channel].size -= size;
            worked = 1U;
        }
    }
    return worked;
}

#endif
