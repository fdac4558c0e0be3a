/* The monitor of an application core. Jobs run in user mode, from the core's own scratchpads only, which the PMP
 * enforces: what a job does wrong ends in a trap here, or at its deadline. */
#include "halpipe.h"

#define HART 0
#define ISPM 1
#define ISPM_END 2
#define DSPM 3
#define DSPM_END 4
#define BOX 5
#define JOB_STACK 6
#define JOB_END 7
extern const uint64_t hp_site[8];
extern const char monitor_trap[1];
extern const char job_return[1];
void start_job(uint64_t entry, uint64_t rank, uint64_t ranks, uint64_t stack) __attribute__((noreturn));
void start_monitor(void) __attribute__((noreturn));
void run_monitor(void) __attribute__((noreturn));
void trapped(void) __attribute__((noreturn));
static void serve(void) __attribute__((noreturn));

#define PMP_R 1UL
#define PMP_W 2UL
#define PMP_X 4UL
#define PMP_TOR 8UL
#define PMP_NAPOT 24UL
#define PMP_LOCKED 128UL
#define CLINT_SIZE 0x10000UL

#define MSTATUS_MPP 0x1800UL
#define CALL_FROM_USER 8UL
#define IS_INTERRUPT 0x8000000000000000UL

static inline volatile hp_mailbox *mailbox(void) { return (volatile hp_mailbox *)hp_site[BOX]; }

/* What a job may do: 0-1: execute and read its code; 2-3: read and write its data. Locked, so that they bind the monitor,
 * too. 4: mailbox and stack of the monitor; 5: clock and interrupts: both are the monitor's alone. 7: the rest, forbidden
 * for both. A store to the configuration arms them all at once. */
static void lock(void) {
    WRITE_CSR(pmpaddr0, hp_site[ISPM] >> 2U);
    WRITE_CSR(pmpaddr1, hp_site[ISPM_END] >> 2U);
    WRITE_CSR(pmpaddr2, hp_site[DSPM] >> 2U);
    WRITE_CSR(pmpaddr3, hp_site[JOB_END] >> 2U);
    WRITE_CSR(pmpaddr4, hp_site[DSPM_END] >> 2U);
    WRITE_CSR(pmpaddr5, (HP_CLINT >> 2U) | ((CLINT_SIZE / 8U) - 1U));
    WRITE_CSR(pmpaddr7, NEVER >> 10U);
    uint64_t entries = (PMP_TOR | PMP_R | PMP_X | PMP_LOCKED) << 8U;
    entries |= (PMP_TOR | PMP_R | PMP_W | PMP_LOCKED) << 24U;
    entries |= PMP_TOR << 32U;
    entries |= PMP_NAPOT << 40U;
    entries |= (PMP_NAPOT | PMP_LOCKED) << 56U;
    WRITE_CSR(pmpcfg0, entries);
    __asm__ volatile("fence\n fence.i" ::: "memory");
}

/* Lets nothing but a software interrupt end the next WFI. */
static void idle(void) {
    __asm__ volatile("csrci mstatus, 8" ::: "memory");
    MTIMECMP(hp_site[HART]) = NEVER;
    WRITE_CSR(mie, MIE_SOFTWARE);
}

/* Bounded by the deadline: its interrupt ends the clearing, too. */
static void execute(const volatile hp_mailbox *box) __attribute__((noreturn));
static void execute(const volatile hp_mailbox *box) {
    WRITE_CSR(mie, MIE_TIMER);
    __asm__ volatile("fence\n fence.i\n csrsi mstatus, 8" ::: "memory");
    uint64_t end = box->bss_end;
    for (uint64_t word = box->bss; word < end; word += 8U) {
        *(volatile uint64_t *)word = 0U;
    }
    uint64_t ranks = box->ranks;
    start_job(box->entry, ranks & 0xffffffffU, ranks >> 32U, hp_site[JOB_STACK]);
}

/* Waits for requests; each ends in a trap. */
static void serve(void) {
    volatile hp_mailbox *box = mailbox();
    while ((box->request == box->done) && (box->restart == 0U)) {
        wait_for_interrupt();
        MSIP(hp_site[HART]) = 0U;
        fence(); /* a request that comes now raises the interrupt again */
    }
    fence(); /* what is asked for was written before */
    if (box->restart != 0U) {
        box->restart = 0U;
        start_monitor();
    }
    box->begin = MTIME;
    MTIMECMP(hp_site[HART]) = box->deadline;
    execute(box);
}

static uint32_t has_user_mode(void) {
    uint64_t status;
    __asm__ volatile("csrc mstatus, %0" ::"r"(MSTATUS_MPP) : "memory");
    READ_CSR(mstatus, status);
    return ((status & MSTATUS_MPP) == 0U) ? 1U : 0U;
}

void run_monitor(void) {
    WRITE_CSR(mtvec, (uint64_t)monitor_trap);
    WRITE_CSR(mcounteren, 0U);
    lock();
    idle();
    mailbox()->ready = has_user_mode();
    serve();
}

/* A job is over, whichever way. */
void trapped(void) {
    volatile hp_mailbox *box = mailbox();
    uint64_t cause;
    uint64_t epc;
    uint64_t value;
    READ_CSR(mcause, cause);
    READ_CSR(mepc, epc);
    READ_CSR(mtval, value);
    box->end = MTIME;
    box->cause = cause;
    box->epc = epc;
    box->tval = value;
    if ((cause & IS_INTERRUPT) != 0U) {
        box->status = FLAG_OVERRUN;
    } else if ((cause != CALL_FROM_USER) || (epc != (uint64_t)job_return)) {
        box->status = FLAG_FAULT;
    } else {
        box->status = 0U;
        uint64_t finish = box->finish; /* of a modelled execution: the core is busy until then */
        MTIMECMP(hp_site[HART]) = finish;
        while (MTIME < finish) {
            wait_for_interrupt();
        }
    }
    idle();
    fence();
    box->done = box->request;
    serve();
}
