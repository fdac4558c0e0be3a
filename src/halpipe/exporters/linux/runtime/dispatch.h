/* Plays the tables of a schedule on Linux. C17, POSIX and Linux; no dependency.
 *
 * Every task has a thread on each CPU that it uses, under SCHED_FIFO. A thread starts its jobs at absolute instants.
 * A conductor thread decides shortly before a table ends which table follows, so a job may run across that end.
 */
#ifndef DISPATCH_H
#define DISPATCH_H
#include <stddef.h>
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif

typedef struct {          /* a part of a job: it runs the functions [first, last) of its program */
  int64_t start;          /* ns after the beginning of the table */
  uint16_t first, last;
} dispatch_part;

typedef struct {          /* a job of a table, seen from one thread */
  int64_t start, end;     /* ns after the beginning of the table; the end may lie behind that of the table */
  const dispatch_part *parts;
  uint16_t n_parts, program, job;
} dispatch_job;

typedef struct {
  const dispatch_job *jobs;
  int n_jobs;
} dispatch_rows;

typedef struct {          /* a thread: one task on one unit */
  const char *task, *unit, *units;
  int cpu, priority;      /* priority: added to that of the run */
  int refuge;             /* the mode that a health rule goes to after an overrun, -1: none */
  const dispatch_rows *tables;
} dispatch_worker;

typedef struct {          /* data that moves between a buffer and a variable of the program */
  const char *symbol;
  uint32_t buffer, size;
} dispatch_move;

typedef struct {
  const char *name, *library;
  const char *const *entries;
  const dispatch_move *in, *out;
  uint16_t n_entries, n_in, n_out;
} dispatch_program;

typedef struct {
  const char *name;
  uint32_t size;
} dispatch_buffer;

typedef struct {          /* a mode, or a table between two modes */
  const char *name;
  int64_t length;         /* ns, and `rest` / `parts` of one more */
  int64_t rest;
  int from, to;           /* modes; equal for the table of a mode */
} dispatch_table;

typedef struct {
  const char *model;
  int64_t parts;
  int n_tables, n_modes, n_workers, n_programs, n_buffers, levels;
  const dispatch_table *tables;     /* the modes first */
  const int *switches;              /* table by [from * n_modes + to], -1: none */
  const dispatch_worker *workers;
  const dispatch_program *programs;
  const dispatch_buffer *buffers;
} dispatch_plan;

extern const dispatch_plan plan;

enum { DISPATCH_BY_RULES = -1, DISPATCH_NOWHERE = -2 };
enum { DISPATCH_LOG, DISPATCH_SKIP, DISPATCH_SWITCH };  /* a job whose slot is over before it starts */

typedef struct {
  int mode, priority, clock, policy, refuge;  /* refuge: the mode to go to after an overrun */
  int64_t origin, spin, lead;                 /* ns; origin 0: the next whole second but one */
  uint64_t cycles;                            /* tables to play, 0: until stopped */
  size_t capacity;                            /* events for each thread */
  const int *cpus;                            /* by worker */
} dispatch_options;

typedef struct {
  int64_t planned, began, ended, busy;
  uint64_t cycle;
  uint16_t table, job;
} dispatch_event;

typedef struct {
  const dispatch_event *events;
  size_t n_events;
  uint64_t unrecorded, skipped, late_ends, lost_tables;
  int is_stuck;
} dispatch_record;

typedef struct {          /* a request for a mode that was taken */
  int64_t requested, began;                   /* began: the instant of the table that followed, or when it was known, if later */
  int64_t limit;                              /* the length of the table that was played, and the lead of a dispatch */
} dispatch_switch;

/* All return 0, or an errno with the reason in dispatch_reason. */
int dispatch_load(const char *folder, const char *memory);
int dispatch_start(const dispatch_options *options);
int dispatch_wait(int64_t seconds);           /* for all threads to end; ETIMEDOUT if one does not */
void dispatch_request(int mode);              /* taken at the end of the table; any thread, also signal handlers */
void dispatch_stop(void);                     /* at the end of the table */
int dispatch_has_ended(void);
int64_t dispatch_origin(void);
uint64_t dispatch_refused(void);              /* requests without a table between the modes */
uint64_t dispatch_torn(void);                 /* copies out of a buffer that somebody wrote all the time */
const dispatch_switch *dispatch_switches(size_t *n);   /* the first ones, as many as there is room for */
dispatch_record dispatch_recorded(int worker);
extern char dispatch_reason[256];

/* Instead of dispatch_load: what runs a program, for hosts whose tasks are no shared objects. */
void dispatch_hook(void (*run)(int program));
int dispatch_write(const char *file);         /* the recording as CSV; 0, or an errno */
#ifdef __cplusplus
}
#endif
#endif
