/* The monitor of an application core. It and the jobs it calls run from the core's own scratchpads only, which the PMP
 * enforces: what a job does wrong ends in a trap here, or at its deadline. */
#include "halpipe.h"

enum { HART, ISPM, ISPM_END, DSPM, DSPM_END, BOX, JOB_STACK };
extern const uint64_t hp_site[];
extern char monitor_trap[];
void call_job(uint64_t entry, uint64_t rank, uint64_t ranks, uint64_t stack);

#define MAILBOX ((hp_mailbox *)hp_site[BOX])

enum { R = 1, W = 2, X = 4, TOR = 1 << 3, NA4 = 2 << 3, NAPOT = 3 << 3, LOCKED = 0x80 };
#define EIGHT_BYTES(address) ((uint64_t)(address) >> 2)

/* Locked entries bind machine mode too. 0-1: own code; 2-3: own data; 4: mtime; 5: own msip; 6: own mtimecmp; 7: the rest,
 * forbidden. A store to the configuration arms them all at once. */
static void lock(void) {
    uint64_t hart = hp_site[HART];
    WRITE_CSR(pmpaddr0, hp_site[ISPM] >> 2);
    WRITE_CSR(pmpaddr1, hp_site[ISPM_END] >> 2);
    WRITE_CSR(pmpaddr2, hp_site[DSPM] >> 2);
    WRITE_CSR(pmpaddr3, hp_site[DSPM_END] >> 2);
    WRITE_CSR(pmpaddr4, EIGHT_BYTES(HP_CLINT + 0xbff8));
    WRITE_CSR(pmpaddr5, (HP_CLINT + 4 * hart) >> 2);
    WRITE_CSR(pmpaddr6, EIGHT_BYTES(HP_CLINT + 0x4000 + 8 * hart));
    WRITE_CSR(pmpaddr7, ~0ull >> 10);
    uint64_t entries = 0;
    entries |= (uint64_t)(TOR | R | X | LOCKED) << 8;
    entries |= (uint64_t)(TOR | R | W | LOCKED) << 24;
    entries |= (uint64_t)(NAPOT | R | LOCKED) << 32;
    entries |= (uint64_t)(NA4 | R | W | LOCKED) << 40;
    entries |= (uint64_t)(NAPOT | R | W | LOCKED) << 48;
    entries |= (uint64_t)(NAPOT | LOCKED) << 56;
    WRITE_CSR(pmpcfg0, entries);
    __asm__ volatile("fence\n fence.i" ::: "memory");
}

/* Lets nothing but a software interrupt end the next WFI. */
static void idle(void) {
    __asm__ volatile("csrci mstatus, 8");
    MTIMECMP(hp_site[HART]) = ~0ull;
    WRITE_CSR(mie, MIE_SOFTWARE);
}

static void finish(hp_mailbox *box, uint64_t status) {
    box->end = MTIME;
    box->status = status;
    idle();
    FENCE();
    box->done = box->request;
}

static void execute(hp_mailbox *box) {
    uint64_t hart = hp_site[HART];
    box->begin = MTIME;
    MTIMECMP(hart) = box->deadline;
    WRITE_CSR(mie, MIE_TIMER);
    __asm__ volatile("fence\n fence.i\n csrsi mstatus, 8" ::: "memory");
    for (uint64_t *word = (uint64_t *)box->bss; word < (uint64_t *)box->bss_end; word++) *(volatile uint64_t *)word = 0;
    call_job(box->entry, (uint32_t)box->ranks, box->ranks >> 32, hp_site[JOB_STACK]);
    __asm__ volatile("csrci mstatus, 8" ::: "memory");
    if (box->finish) { /* modelled execution: the core is busy until then */
        MTIMECMP(hart) = box->finish;
        while (MTIME < box->finish) WFI();
    }
    finish(box, 0);
}

static void serve(void) __attribute__((noreturn));
static void serve(void) {
    hp_mailbox *box = MAILBOX;
    for (;;) {
        WRITE_CSR(mtvec, (uint64_t)monitor_trap);
        while (box->request == box->done) {
            WFI();
            MSIP(hp_site[HART]) = 0;
        }
        execute(box);
    }
}

void monitor(void) {
    hp_mailbox *box = MAILBOX;
    WRITE_CSR(mtvec, (uint64_t)monitor_trap);
    lock();
    MSIP(hp_site[HART]) = 0;
    idle();
    box->ready = 1;
    serve();
}

void abandon(void) {
    hp_mailbox *box = MAILBOX;
    uint64_t cause = READ_CSR(mcause);
    box->cause = cause;
    box->epc = READ_CSR(mepc);
    box->tval = READ_CSR(mtval);
    finish(box, (int64_t)cause < 0 ? FLAG_OVERRUN : FLAG_FAULT);
    serve();
}
