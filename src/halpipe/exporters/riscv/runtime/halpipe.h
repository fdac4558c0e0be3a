/* What the management core, the monitors and the generated tables share. Layouts are part of the bundle's interface:
 * docs/reference/riscv-bundle.md. Deviations from MISRA C:2012: docs/reference/misra.md. */
#ifndef HALPIPE_H
#define HALPIPE_H

#include <stddef.h>
#include <stdint.h>

#include "platform.h" /* generated: addresses and sizes of the target */

/* ---- tables, generated in tables.c ---- */

#define OP_TABLE 0U
#define OP_COPY 1U
#define OP_DONE 2U
#define OP_RUN 3U
#define OP_STOP 4U
#define OP_HEALTH 5U /* in records only */
#define OP_INPUT 6U
#define OP_OUTPUT 7U

/* One operation of a program. Its key is (ticks from the job's start) << 2 | order: at equal ticks, checks come first
 * (0), then executions begin (1), then transfers (2). */
typedef struct {
    uint64_t key;
    uint64_t source; /* COPY: from; RUN: function; INPUT, OUTPUT: number of the driver */
    uint64_t target; /* COPY: to;   RUN: begin of .bss; INPUT, OUTPUT: the buffer */
    uint64_t size;   /* COPY: bytes; RUN: bytes of .bss, 0 if it is not to be cleared; INPUT, OUTPUT: of the buffer */
    uint32_t limit;  /* RUN: ticks until STOP; COPY: until the end of its phase */
    uint8_t kind;
    uint8_t channel;
    uint8_t unit;
    uint8_t reserved;
    uint32_t rank;
    uint32_t ranks; /* RUN: place of the core in its gang, and the gang's size */
} hp_operation;

typedef struct {
    const hp_operation *operations;
    uint32_t count;
    uint32_t slot;  /* where the program is in progress */
    uint32_t rule;  /* the first health rule of its task, */
    uint16_t rules; /* and their number */
    uint16_t slots; /* 2: in the next slot while the job before is still in progress */
} hp_program;

#define HEALTH_SWITCH 1U
#define HEALTH_RESTART 2U
#define HEALTH_STOP 3U

/* What follows when jobs of a task were abandoned with one of the flags: count times, in so many tables in a row. */
typedef struct {
    uint32_t first;    /* of its events in the history */
    uint32_t mode;     /* where a switch leads, or HP_NO_TABLE */
    uint32_t priority; /* of several switches the least counts */
    uint8_t flags;
    uint8_t count;
    uint8_t cycles;
    uint8_t action;
} hp_rule;

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
    uint64_t ispm;
    uint64_t dspm;
    uint64_t code;
    uint64_t code_size;
} hp_unit;

#define HP_NO_TABLE 0xffffffffU

extern const hp_program hp_programs[];
extern const hp_rule hp_rules[HP_RULES];
extern const hp_table hp_tables[];                     /* modes, then transitions */
extern const uint32_t hp_switches[HP_MODES][HP_MODES]; /* index of the transition table, or HP_NO_TABLE */
extern const hp_unit hp_units[HP_UNITS];

#ifdef HP_DRIVERS
/* Fills a buffer before it is read, or takes what was written into it. */
typedef void (*hp_driver)(void *data, uint64_t size);
extern const hp_driver hp_drivers[HP_DRIVERS];
/* The driver of a buffer of one word by which a task asks for a mode: its number + 1; 0: for none. */
void hp_request_mode(void *data, uint64_t size);
#endif

/* ---- memory shared with simulators, debuggers and board software ---- */

#define HP_MAGIC 0x48414c5049504531UL

typedef struct {
    uint64_t magic;
    uint64_t cycles;
    uint64_t execution;
    uint64_t first;
    uint64_t report;
    uint64_t exit;
    uint64_t offset;
    uint64_t unhealthy;
    uint64_t request;
    uint64_t state;
    uint64_t base;
    uint64_t played;
    uint64_t table;
    uint64_t traced;
    uint64_t faults;
    uint64_t refused;
    uint64_t cause;
    uint64_t epc;
} hp_control;

#define STATE_BOOTING 0U
#define STATE_RUNNING 1U
#define STATE_FINISHED 2U
#define STATE_NO_CORE 3U /* 4, trapped, is set in start.S */
#define STATE_STOPPED 5U
#define STATE_NO_REGULATOR 6U

#define FLAG_LATE 1U
#define FLAG_OVERRUN 2U
#define FLAG_FAULT 4U
#define FLAG_SKIPPED 8U
#define FLAG_STUCK 16U
#define FLAG_REFUSED 32U
#define FLAG_ERROR 64U

typedef struct {
    uint64_t time;
    uint64_t begin;
    uint64_t end; /* ticks from the beginning of the run */
    uint32_t cycle;
    uint32_t table;
    uint32_t release;
    uint32_t program;
    uint32_t operation;
    uint8_t kind;
    uint8_t flags;
    uint8_t unit;
    uint8_t reserved;
} hp_record;

typedef struct {
    uint64_t time;
    uint64_t cause;
    uint64_t epc;
    uint64_t tval;
    uint32_t cycle;
    uint32_t table;
    uint32_t release;
    uint32_t program;
    uint32_t operation;
    uint8_t kind;
    uint8_t flags;
    uint16_t hart;
    uint64_t reserved;
} hp_fault;

_Static_assert((sizeof(hp_operation) == 48U) && (sizeof(hp_record) == 48U) && (sizeof(hp_fault) == 64U) &&
               (sizeof(hp_program) == 24U) && (sizeof(hp_rule) == 16U), "layouts");

#define CONTROL ((volatile hp_control *)HP_CONTROL)
#define TRACE ((hp_record *)HP_TRACE)
#define FAULTS ((hp_fault *)HP_FAULTS)

#ifdef HP_CALIBRATE
#define CALIBRATE_ISPM 1U /* bytes from main memory, and ticks */
#define CALIBRATE_DSPM 2U
#define CALIBRATE_MAIN 3U /* bytes to it */
#define CALIBRATE_LOOP 4U /* turns of a loop, and ticks; as in loops.S */
#define CALIBRATE_LOOPS 8U
#define CALIBRATE_MANAGEMENT 12U /* the same additions on the management core */

typedef struct {
    uint64_t kind;
    uint64_t amount; /* 0: it failed */
    uint64_t ticks;
} hp_calibration;

typedef struct {
    uint64_t count;
    hp_calibration entries[100];
} hp_calibrations;

#define CALIBRATION ((volatile hp_calibrations *)(HP_CONTROL + 1024UL))
void calibrate(void);
#endif

/* ---- the mailbox of a core: the top of its data scratchpad ---- */

typedef struct {
    uint64_t request;
    uint64_t done; /* equal: the core is idle */
    uint64_t entry;
    uint64_t bss;
    uint64_t bss_end;
    uint64_t deadline;
    uint64_t finish; /* mtime; finish 0: the execution ends when the function returns */
    uint64_t ranks;            /* rank | size << 32 */
    uint64_t begin;
    uint64_t end;
    uint64_t status;
    uint64_t cause;
    uint64_t epc;
    uint64_t tval;
    uint64_t ready;
    uint64_t restart; /* before the next job */
} hp_mailbox;

#define MAILBOX_SIZE 256U

/* ---- clock and interrupts (CLINT) ---- */

#define MTIME (*(volatile uint64_t *)(HP_CLINT + 0xbff8UL))
#define MTIMECMP(hart) (*(volatile uint64_t *)(HP_CLINT + 0x4000UL + (8UL * (uint64_t)(hart))))
#define MSIP(hart) (*(volatile uint32_t *)(HP_CLINT + (4UL * (uint64_t)(hart))))

#define NEVER 0xffffffffffffffffUL
#define MIE_SOFTWARE 0x08UL
#define MIE_TIMER 0x80UL

#define WRITE_CSR(name, value) __asm__ volatile("csrw " #name ", %0" ::"r"((uint64_t)(value)) : "memory")
#define READ_CSR(name, into) __asm__ volatile("csrr %0, " #name : "=r"(into)::"memory")

static inline void fence(void) { __asm__ volatile("fence" ::: "memory"); }
static inline void wait_for_interrupt(void) { __asm__ volatile("wfi" ::: "memory"); }

/* ---- parts of the runtime on the management core ---- */

#define DMA_IDLE 0U
#define DMA_BUSY 1U
#define DMA_FAILED 2U

/* A transfer has an owner, any number but 0: an error is that of the job whose transfer it was. */
void dma_start(uint32_t channel, const hp_operation *o, uint64_t owner);
/* How the last transfer of a channel stands; an error that is another owner's is forgotten. */
uint32_t dma_state(uint32_t channel, uint64_t owner);
#define DMA_NONE 0U
#define DMA_OTHERS 1U
#define DMA_THIS 2U

/* Whether transfers of other owners are under way from or to the scratchpads of this unit, or of others only. */
uint32_t dma_holds(uint32_t unit, uint64_t owner);
/* Does a part of what the hardware does not; 0: nothing to do. */
uint32_t dma_work(void);
/* Counts an event for a health rule, in a table of the run; returns 1 if the rule fires, whose switch or stop follows. */
uint32_t health_fires(uint32_t index, uint64_t flags, uint32_t table, uint32_t cycle);
/* The mode that health rules want, + 1, and forgets it; 0: none. */
uint32_t health_mode(void);
uint32_t health_stops(void);
/* With HP_REGULATORS: 0 where none take their tables; the first table at an instant; another at the end of that in force. */
uint32_t regulators_load(void);
void regulators_start(uint32_t mode, uint64_t instant);
void regulators_request(uint32_t from, uint32_t to);
void print_report(void);
void leave(uint64_t status) __attribute__((noreturn));
void runtime(void) __attribute__((noreturn));

extern uint64_t hp_monitors[HP_UNITS + 1U]; /* where the cores are sent to, by hart; read by start.S */

#endif
