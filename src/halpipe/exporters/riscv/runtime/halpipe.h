/* What the management core, the monitors and the generated tables share. Layouts are part of the bundle's interface:
 * docs/reference/riscv-bundle.md. */
#ifndef HALPIPE_H
#define HALPIPE_H

#include <stddef.h>
#include <stdint.h>

#include "platform.h" /* generated: addresses and sizes of the target */

/* ---- tables, generated in tables.c ---- */

enum { OP_TABLE, OP_COPY, OP_DONE, OP_RUN, OP_STOP };

/* One operation of a program. Its key is (ticks from the job's start) << 2 | order: at equal ticks, checks come first
 * (0), then executions begin (1), then transfers (2). */
typedef struct {
    uint64_t key;
    uint64_t source; /* COPY: from; RUN: function */
    uint64_t target; /* COPY: to;   RUN: begin of .bss */
    uint64_t size;   /* COPY: bytes; RUN: bytes of .bss, 0 if it is not to be cleared */
    uint32_t limit;  /* RUN: ticks until STOP; COPY: until the end of its phase */
    uint8_t kind, channel, unit, reserved;
    uint32_t rank, ranks; /* RUN: place of the core in its gang, and the gang's size */
} hp_operation;

typedef struct {
    const hp_operation *operations;
    uint32_t count;
    uint32_t unit; /* the first unit of the job: its slot is where the program is in progress */
} hp_program;

typedef struct {
    uint64_t time; /* ticks from the table's start */
    uint32_t program;
    uint32_t reserved;
} hp_release;

typedef struct {
    const hp_release *releases;
    uint64_t length; /* ticks */
    uint32_t count;
    uint32_t next; /* a mode: itself; a transition: the mode it leads to */
} hp_table;

typedef struct {
    uint64_t ispm, dspm, monitor, monitor_size;
} hp_unit;

extern const hp_program hp_programs[];
extern const hp_table hp_tables[]; /* modes, then transitions */
extern const int16_t hp_switches[HP_MODES][HP_MODES]; /* index of the transition table, -1 where there is none */
extern const hp_unit hp_units[HP_UNITS];

/* ---- memory shared with simulators, debuggers and board software ---- */

#define HP_MAGIC 0x48414c5049504531ull

typedef struct {
    uint64_t magic, cycles, execution, first, report, exit, offset, reserved;
    uint64_t request, state, base, played, table, traced, faults, refused, cause, epc;
} hp_control;

enum { STATE_BOOTING, STATE_RUNNING, STATE_FINISHED, STATE_NO_CORE, STATE_TRAPPED };

enum { FLAG_LATE = 1, FLAG_OVERRUN = 2, FLAG_FAULT = 4, FLAG_SKIPPED = 8, FLAG_STUCK = 16, FLAG_REFUSED = 32 };

typedef struct {
    uint64_t time, begin, end; /* ticks from the beginning of the run */
    uint32_t cycle;
    uint16_t table, release, operation;
    uint8_t kind, flags;
    uint32_t program;
} hp_record;

typedef struct {
    uint64_t time, cause, epc, tval;
    uint32_t cycle;
    uint16_t table, release;
    uint32_t program;
    uint16_t hart;
    uint8_t flags, kind;
    uint64_t reserved[2];
} hp_fault;

_Static_assert(sizeof(hp_operation) == 48 && sizeof(hp_record) == 40 && sizeof(hp_fault) == 64, "layouts");

#define CONTROL ((volatile hp_control *)HP_CONTROL)
#define TRACE ((hp_record *)HP_TRACE)
#define FAULTS ((hp_fault *)HP_FAULTS)

/* ---- the mailbox of a core: the top of its data scratchpad ---- */

typedef struct {
    volatile uint64_t request, done; /* equal: the core is idle */
    volatile uint64_t entry, bss, bss_end;
    volatile uint64_t deadline, finish; /* mtime; finish 0: the execution ends when the function returns */
    volatile uint64_t ranks;            /* rank | size << 32 */
    volatile uint64_t begin, end, status, cause, epc, tval, ready;
} hp_mailbox;

#define MAILBOX_SIZE 256

/* ---- clock and interrupts (CLINT) ---- */

#define MTIME (*(volatile uint64_t *)(HP_CLINT + 0xbff8))
#define MTIMECMP(hart) (*(volatile uint64_t *)(HP_CLINT + 0x4000 + 8 * (hart)))
#define MSIP(hart) (*(volatile uint32_t *)(HP_CLINT + 4 * (hart)))

#define MIE_SOFTWARE 0x08
#define MIE_TIMER 0x80
#define READ_CSR(name) ({ uint64_t value_; __asm__ volatile("csrr %0, " #name : "=r"(value_)); value_; })
#define WRITE_CSR(name, value) __asm__ volatile("csrw " #name ", %0" ::"r"((uint64_t)(value)) : "memory")
#define FENCE() __asm__ volatile("fence" ::: "memory")
#define WFI() __asm__ volatile("wfi" ::: "memory")

/* ---- parts of the runtime on the management core ---- */

void dma_start(unsigned channel, uint64_t source, uint64_t target, uint64_t size);
int dma_is_complete(unsigned channel); /* also true where nothing was started */
int dma_work(void);                    /* does a part of what the hardware does not; 0: nothing to do */
void report(void);
void leave(int is_clean) __attribute__((noreturn));

#endif
