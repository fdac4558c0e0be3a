/* Dispatcher for the tables of a schedule on Linux. C11, POSIX and Linux; no dependency.
 *
 * Every task has a thread on each CPU that it uses, under SCHED_FIFO. A thread starts its jobs at absolute instants.
 * A conductor thread of higher priority decides shortly before a table ends which table follows, so a job may run across
 * that end; it also finds the jobs that still run though their slots are over. All instants are of CLOCK_MONOTONIC.
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
  int refuge, fault;      /* the modes that health rules go to after an overrun and after a fault, -1: none */
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

typedef struct {          /* of a job with a logical execution time, between its own buffer and that of the model */
  int64_t at;             /* ns after the beginning of the table; may lie behind its end */
  uint32_t from, to, size;
} dispatch_copy;

typedef struct {          /* a mode, or a table between two modes */
  const char *name;
  int64_t length;         /* ns, and `rest` / `parts` of one more */
  int64_t rest;
  int from, to;           /* modes; equal for the table of a mode */
  const dispatch_copy *copies;   /* in the order of their instants */
  int n_copies;
} dispatch_table;

typedef struct {          /* regulators of memory bandwidth, which play tables of their own beside those of the threads */
  int (*load)(const char *device);
  int (*start)(int mode, int64_t first);         /* with a mode at an instant; both: an errno, with the reason */
  int (*request)(int from, int to, int64_t at);  /* of the table from an instant on; whether it is followed there */
  int (*differs)(int64_t at);                    /* whether they play another table than that before an instant */
} dispatch_regulators;

typedef struct {
  const char *model;
  int64_t parts;
  int n_tables, n_modes, n_workers, n_programs, n_buffers, levels;
  const dispatch_table *tables;     /* the modes first */
  const int *switches;              /* table by [from * n_modes + to], -1: none */
  const dispatch_worker *workers;
  const dispatch_program *programs;
  const dispatch_buffer *buffers;
  const dispatch_regulators *regulators;   /* NULL: none */
} dispatch_plan;

extern const dispatch_plan plan;
extern const dispatch_regulators bw_regulators;

enum { DISPATCH_BY_RULES = -1, DISPATCH_NOWHERE = -2 };
enum { DISPATCH_LOG, DISPATCH_SKIP, DISPATCH_SWITCH };  /* a job whose slot is over before it starts */

enum { DISPATCH_OK, DISPATCH_INCOMPLETE, DISPATCH_USAGE, DISPATCH_FAULTS };   /* exit status; INCOMPLETE: no start or no whole recording */

enum { DISPATCH_FAULT = -1, DISPATCH_NO_DATA, DISPATCH_RAN };   /* results of a job */

typedef struct {
  int mode, priority, clock, policy, refuge;  /* clock: of the origin; refuge: the mode to go to after an overrun */
  int is_regulated;                           /* the regulators of the plan were loaded, and take part */
  int may_unlock;                             /* go on with memory that is not locked, where a thread has no room else */
  int may_share;                              /* units that have one CPU: their jobs wait for each other */
  int64_t origin, spin, lead;                 /* ns; origin 0: the next whole second but one */
  uint64_t cycles;                            /* tables to play, 0: until stopped */
  size_t capacity, stack;                     /* events waiting for the recorder, by thread; bytes, 0: the platform's */
  const int *cpus;                            /* by worker */
  int64_t (*pace)(void);                      /* simulated time in ns, at which tables begin; NULL: that of the machine */
} dispatch_options;

typedef struct {
  int64_t planned, began, ended, busy;        /* ended: INT64_MIN while it runs */
  uint64_t cycle;
  uint16_t table, job;
  int16_t result;
} dispatch_event;

typedef struct {          /* counts of a thread, or the sums over all */
  uint64_t unrecorded, skipped, lost_tables, no_data, faults;
  uint64_t late_ends, overran;                /* of jobs that were late, and of jobs that took longer than their slots */
  int is_running, is_stuck;                   /* stuck: a job runs whose slot is over */
  int64_t over;                               /* ns since the end of the slot of the job that is stuck */
  uint64_t refused, copied;                   /* of all: requests without a table between the modes; copies of a LET */
  int64_t latest_copy;                        /* ns that one was late by */
  uint64_t astray;                            /* tables with which the regulators played another one */
} dispatch_counts;

typedef struct {          /* the requests for modes that were taken */
  uint64_t taken;
  int64_t longest, excess;                    /* ns from a request to its table, and beyond the table before and a dispatch */
} dispatch_switches;

/* All return 0, or an errno with the reason in dispatch_reason. */
int dispatch_load(const char *folder, const char *memory);   /* the programs */
int dispatch_lock(void);                      /* all memory, now and later */
int dispatch_record(const char *file, uint64_t limit);   /* before the start: rows go to a file of at most so many bytes */
int dispatch_start(const dispatch_options *options);
int dispatch_wait(int64_t seconds);           /* for all threads to end; ETIMEDOUT if one does not */
int dispatch_finish(void);                    /* the recording; the first errno that it met */
void dispatch_request(int mode);              /* taken at the end of the table; any thread, also signal handlers */
void dispatch_stop(void);                     /* at the end of the table */
int dispatch_is_paced(void);                  /* by simulated time */
int dispatch_has_ended(void);
int dispatch_is_unlocked(void);               /* memory was not locked in the end, see may_unlock */
int dispatch_table_now(void);
uint64_t dispatch_cycle_now(void);
int64_t dispatch_origin(void);                /* on CLOCK_MONOTONIC */
int64_t dispatch_stepped(unsigned *times);    /* ns by which the clock of the origin was set since */
uint64_t dispatch_left_out(void);             /* tables, since the machine was away for longer than one */
uint64_t dispatch_torn(void);                 /* copies out of a buffer during which its writers never paused */
dispatch_switches dispatch_switched(void);
dispatch_counts dispatch_counted(int worker);
dispatch_counts dispatch_total(void);         /* is_running, is_stuck: how many do */
int dispatch_status(void);                    /* of the process, after dispatch_finish() */
int64_t dispatch_start_error(int percent);    /* ns; at most 1/64 above the exact one, 100: exact */
uint64_t dispatch_recorded(void);             /* jobs */
uint64_t dispatch_unwritten(void);            /* jobs, since the file could not take them */
int dispatch_news(char *text, size_t size);   /* whether a fault came up since the last call; its description */
extern char dispatch_reason[256];

/* Between dispatcher, programs and recorder. */
int dispatch_fail(int error, const char *what, const char *which);
size_t dispatch_take(int worker, dispatch_event *into, size_t most);
int dispatch_running(int worker, dispatch_event *into);
int dispatch_worker_here(void);               /* of the calling thread, -1: none */
int dispatch_thread(void *thread, void *(*body)(void *), void *argument, const char *name);   /* at normal priority */
int dispatch_recorder_begin(void);
void dispatch_left(void);                     /* at exit(): the recording is completed unless it was finished */
void dispatch_enter(void);                    /* by each thread that runs foreign code */

/* The function that runs the program of a job in the table that begins at `at`; dispatch_load sets its own. */
void dispatch_hook(int (*run)(const dispatch_job *job, int64_t at), void (*copy)(const dispatch_copy *copy));
void dispatch_until(int64_t at);
#ifdef __cplusplus
}
#endif
#endif
