#define _GNU_SOURCE
#include "dispatch.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#define SECOND INT64_C(1000000000)
#define RING 256          /* tables that a thread may lag behind */
#ifndef STACK
#define STACK (256 * 1024)
#endif
#define SWITCHES 4096     /* that are measured */
#define YIELDS 100        /* how often a late thread lets others begin that should have begun before */
#define PATIENCE 20000    /* and how often in all, which is about a second */

typedef struct {          /* a table that is played */
  uint64_t cycle;
  int64_t at;
  int table;              /* -1: the end */
} turn;

typedef struct {
  pthread_t thread;
  dispatch_event *events;
  size_t n_events;
  uint64_t unrecorded, skipped, late_ends, lost_tables;
  atomic_int is_done;
  _Atomic int64_t next;   /* no job that it is about to start has an earlier instant */
  int *peers, n_peers;    /* threads of the same unit and priority, which do not preempt each other */
} worker_state;

typedef struct {
  void (**entries)(void);
  void **in, **out;
} loaded_program;

typedef struct {          /* before each buffer: odd while it is written */
  _Atomic uint32_t sequence;
  uint32_t size;
} buffer_head;

char dispatch_reason[256];
static dispatch_options now_;
static worker_state *workers;
static loaded_program *programs;
static buffer_head **buffers;
static turn ring[RING];
static uint64_t published;        /* turns in the ring so far */
static pthread_mutex_t gate;      /* held for a few instructions, with priority inheritance */
static pthread_cond_t opened = PTHREAD_COND_INITIALIZER;
static atomic_int wanted = -1, stopping, ended;
static _Atomic int64_t requested;
static dispatch_switch switches[SWITCHES];
static size_t n_switches;
static _Atomic uint64_t refused, torn;
static int64_t origin;
static pthread_t conductor;
static void (*hook)(int program);

static int fail(int error, const char *what, const char *which) {
  snprintf(dispatch_reason, sizeof dispatch_reason, "%s%s%s", what, which ? ": " : "", which ? which : "");
  return error ? error : EINVAL;
}

/* ------------------------------------------------------------------------------------------------ time */

static int64_t clock_now(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * SECOND + t.tv_nsec;
}

static void wait_until(int64_t at) {
  const int64_t wake = at - now_.spin;
  if (wake > clock_now(now_.clock)) {
    const struct timespec t = {wake / SECOND, wake % SECOND};
    while (clock_nanosleep(now_.clock, TIMER_ABSTIME, &t, NULL) == EINTR) { }
  }
  if (now_.spin > 0) while (clock_now(now_.clock) < at) { }
}

/* ---------------------------------------------------------------------------------------------- programs */

static size_t room_of(uint32_t size) { return (sizeof(buffer_head) + size + 63) / 64 * 64; }

static int map_buffers(const char *memory) {
  size_t total = 64;
  for (int i = 0; i < plan.n_buffers; i++) total += room_of(plan.buffers[i].size);
  int file = -1;
  if (memory) {
    file = open(memory, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (file < 0 || ftruncate(file, (off_t)total)) return fail(errno, "the file of the buffers cannot be made", memory);
  }
  char *base = mmap(NULL, total, PROT_READ | PROT_WRITE, file < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED, file, 0);
  if (file >= 0) close(file);
  if (base == MAP_FAILED) return fail(errno, "the buffers cannot be mapped", memory);
  buffers = calloc((size_t)plan.n_buffers + 1, sizeof *buffers);
  if (!buffers) return fail(ENOMEM, "no memory for the buffers", NULL);
  for (int i = 0; i < plan.n_buffers; i++) {
    buffers[i] = (buffer_head *)base;
    buffers[i]->size = plan.buffers[i].size;
    base += room_of(plan.buffers[i].size);
  }
  return 0;
}

static int find_symbols(void *library, const dispatch_move *moves, int n, void **found, const char *name) {
  for (int i = 0; i < n; i++)
    if (!(found[i] = dlsym(library, moves[i].symbol))) return fail(ENOENT, name, moves[i].symbol);
  return 0;
}

static int load(const dispatch_program *program, loaded_program *into, const char *folder) {
  char path[4096];
  if (snprintf(path, sizeof path, "%s/%s", folder, program->library) >= (int)sizeof path)
    return fail(ENAMETOOLONG, "the name of the folder is too long", NULL);
  void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!library) return fail(ENOENT, "a program cannot be loaded", dlerror());
  into->entries = calloc(program->n_entries, sizeof *into->entries);
  into->in = calloc((size_t)program->n_in + 1, sizeof *into->in);
  into->out = calloc((size_t)program->n_out + 1, sizeof *into->out);
  if (!into->entries || !into->in || !into->out) return fail(ENOMEM, "no memory for a program", program->name);
  for (int i = 0; i < program->n_entries; i++) {
    void *entry = dlsym(library, program->entries[i]);
    if (!entry) return fail(ENOENT, program->name, program->entries[i]);
    memcpy(&into->entries[i], &entry, sizeof entry);
  }
  const int error = find_symbols(library, program->in, program->n_in, into->in, program->name);
  return error ? error : find_symbols(library, program->out, program->n_out, into->out, program->name);
}

int dispatch_load(const char *folder, const char *memory) {
  int error = map_buffers(memory);
  programs = calloc((size_t)plan.n_programs, sizeof *programs);
  if (!error && !programs) error = fail(ENOMEM, "no memory for the programs", NULL);
  for (int i = 0; !error && i < plan.n_programs; i++) error = load(&plan.programs[i], &programs[i], folder);
  return error;
}

/* Others may write or read meanwhile: a word is whole, and the sequence tells whether all are of one writer. */
static void copy_from(void *into, const buffer_head *from, size_t size) {
  const _Atomic uint64_t *words = (const _Atomic uint64_t *)(from + 1);
  for (size_t at = 0; at < size; at += sizeof *words) {
    const uint64_t word = atomic_load_explicit(&words[at / sizeof *words], memory_order_relaxed);
    memcpy((char *)into + at, &word, size - at < sizeof word ? size - at : sizeof word);
  }
}

static void copy_to(buffer_head *into, const void *from, size_t size) {
  _Atomic uint64_t *words = (_Atomic uint64_t *)(into + 1);
  for (size_t at = 0; at < size; at += sizeof *words) {
    uint64_t word = size - at < sizeof word ? atomic_load_explicit(&words[at / sizeof *words], memory_order_relaxed) : 0;
    memcpy(&word, (const char *)from + at, size - at < sizeof word ? size - at : sizeof word);
    atomic_store_explicit(&words[at / sizeof *words], word, memory_order_relaxed);
  }
}

/* A copy out of a buffer is whole: it is made again if somebody wrote meanwhile; one that is not in the end is counted. */
static void take(const dispatch_move *move, void *into) {
  const buffer_head *from = buffers[move->buffer];
  for (int attempt = 0; attempt < 100; attempt++) {
    const uint32_t before = atomic_load_explicit(&from->sequence, memory_order_acquire);
    copy_from(into, from, move->size);
    atomic_thread_fence(memory_order_acquire);
    if (!(before & 1) && before == atomic_load_explicit(&from->sequence, memory_order_relaxed)) return;
  }
  atomic_fetch_add(&torn, 1);
}

static void give(const dispatch_move *move, const void *from) {
  buffer_head *into = buffers[move->buffer];
  atomic_fetch_add_explicit(&into->sequence, 1, memory_order_acquire);
  atomic_thread_fence(memory_order_release);
  copy_to(into, from, move->size);
  atomic_fetch_add_explicit(&into->sequence, 1, memory_order_release);
}

/* --------------------------------------------------------------------------------------------- workers */

static void run(const dispatch_job *job, int64_t at) {
  if (hook) {
    hook(job->program);
    return;
  }
  const dispatch_program *program = &plan.programs[job->program];
  const loaded_program *loaded = &programs[job->program];
  for (int i = 0; i < program->n_in; i++) take(&program->in[i], loaded->in[i]);
  for (int k = 0; k < job->n_parts; k++) {
    if (k > 0) wait_until(at + job->parts[k].start);
    for (int i = job->parts[k].first; i < job->parts[k].last; i++) loaded->entries[i]();
  }
  for (int i = 0; i < program->n_out; i++) give(&program->out[i], loaded->out[i]);
}

static int is_ahead(const worker_state *self, int64_t at) {
  for (int i = 0; i < self->n_peers; i++)
    if (atomic_load_explicit(&workers[self->peers[i]].next, memory_order_relaxed) < at) return 1;
  return 0;
}

/* Jobs of a unit start in the order of their instants, also when the machine was away for several of them. */
static void wait_in_order(worker_state *self, int64_t at) {
  atomic_store_explicit(&self->next, at, memory_order_relaxed);
  wait_until(at);
  for (int i = 0; i < PATIENCE && is_ahead(self, at); i++) {
    const struct timespec moment = {0, 50000};
    if (i < YIELDS) sched_yield();
    else clock_nanosleep(CLOCK_MONOTONIC, 0, &moment, NULL);   /* without SCHED_FIFO, yielding lets nobody in particular run */
  }
  atomic_store_explicit(&self->next, INT64_MAX, memory_order_relaxed);
}

/* Asks for the mode to go to after an overrun, as the options say, else as the health rules of the model do. */
static void flee(const worker_state *self) {
  const int refuge = now_.refuge == DISPATCH_BY_RULES ? plan.workers[self - workers].refuge : now_.refuge;
  if (refuge >= 0) dispatch_request(refuge);
}

static void play(worker_state *self, const dispatch_job *job, const turn *turn) {
  const int64_t at = turn->at + job->start;
  wait_in_order(self, at);
  const int64_t began = clock_now(now_.clock), slot = job->end - job->start;
  const int is_lost = began >= at + slot;
  if (is_lost) flee(self);
  if (is_lost && now_.policy != DISPATCH_LOG) {
    self->skipped++;
    return;
  }
  const int64_t used = clock_now(CLOCK_THREAD_CPUTIME_ID);
  run(job, turn->at);
  const int64_t over = clock_now(now_.clock);
  self->late_ends += over > at + slot;
  if (over > at + slot) flee(self);
  if (self->n_events == now_.capacity) {
    self->unrecorded++;
    return;
  }
  self->events[self->n_events++] = (dispatch_event){
    .planned = at, .began = began, .ended = over, .busy = clock_now(CLOCK_THREAD_CPUTIME_ID) - used,
    .cycle = turn->cycle, .table = (uint16_t)turn->table, .job = job->job,
  };
}

/* Wait for a turn; one that lags by more than the ring goes on with the oldest that is still known. */
static turn turn_of(uint64_t *number, worker_state *self) {
  pthread_mutex_lock(&gate);
  while (published <= *number) pthread_cond_wait(&opened, &gate);
  if (published - *number > RING) {
    self->lost_tables += published - RING - *number;
    *number = published - RING;
  }
  const turn found = ring[*number % RING];
  pthread_mutex_unlock(&gate);
  return found;
}

static void prefault(void) {
  volatile char page[STACK / 2];
  for (size_t i = 0; i < sizeof page; i += 1024) page[i] = 1;
}

static void *work(void *argument) {
  const int index = (int)(intptr_t)argument;
  worker_state *self = &workers[index];
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);   /* counts where SCHED_FIFO was refused */
  prefault();
  for (uint64_t number = 0;; number++) {
    const turn turn = turn_of(&number, self);
    if (turn.table < 0) break;
    const dispatch_rows *rows = &plan.workers[index].tables[turn.table];
    for (int i = 0; i < rows->n_jobs; i++) play(self, &rows->jobs[i], &turn);
    atomic_store(&self->next, turn.at + plan.tables[turn.table].length);
  }
  atomic_store(&self->next, INT64_MAX);
  atomic_store(&self->is_done, 1);
  return NULL;
}

/* -------------------------------------------------------------------------------------------- conductor */

static void publish(turn next) {
  pthread_mutex_lock(&gate);
  ring[published++ % RING] = next;
  pthread_cond_broadcast(&opened);
  pthread_mutex_unlock(&gate);
}

/* How long the request that ends `table` waited for the next one, which begins at `at`. */
static void measure(int table, int64_t at, int64_t asked) {
  if (n_switches == SWITCHES) return;
  const int64_t time = clock_now(now_.clock);
  switches[n_switches++] = (dispatch_switch){asked, time > at ? time : at, plan.tables[table].length + now_.lead};
}

/* The table after `table`: the target of a switch, the switch that was asked for, or the same mode again. */
static int choose(int table, int64_t at) {
  const dispatch_table *t = &plan.tables[table];
  if (t->from != t->to) return t->to;
  const int64_t asked = atomic_load(&requested);
  const int mode = atomic_exchange(&wanted, -1);
  if (mode < 0 || mode >= plan.n_modes || mode == table) return table;
  const int next = plan.switches[table * plan.n_modes + mode];
  if (next < 0) atomic_fetch_add(&refused, 1);
  else measure(table, at, asked);
  return next < 0 ? table : next;
}

/* The end of a table is its beginning plus its length, and what is no whole nanosecond is kept: nothing drifts. */
static void *conduct(void *unused) {
  (void)unused;
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
  prefault();
  int64_t at = origin, rest = 0;
  int table = now_.mode;
  uint64_t cycle = 0;
  publish((turn){cycle, at, table});
  for (;;) {
    const dispatch_table *t = &plan.tables[table];
    rest += t->rest;
    at += t->length + rest / plan.parts;
    rest %= plan.parts;
    cycle++;
    const int64_t lead = now_.lead < t->length / 4 ? now_.lead : t->length / 4;
    if (t->length > 0) {
      const struct timespec due = {(at - lead) / SECOND, (at - lead) % SECOND};
      while (clock_nanosleep(now_.clock, TIMER_ABSTIME, &due, NULL) == EINTR) { }
    }
    if (atomic_load(&stopping) || (now_.cycles && cycle >= now_.cycles)) break;
    table = choose(table, at);
    const int64_t length = plan.tables[table].length, time = clock_now(now_.clock);
    /* Far too late, whole tables are left out, so that phases stay; what is less is caught up with. */
    const int64_t patience = now_.policy == DISPATCH_LOG ? RING / 8 * length : length;
    while (table < plan.n_modes && length > 0 && at + patience <= time) {
      rest += plan.tables[table].rest;
      at += length + rest / plan.parts;
      rest %= plan.parts;
      cycle++;
    }
    publish((turn){cycle, at, table});
  }
  publish((turn){cycle, at, -1});
  atomic_store(&ended, 1);
  return NULL;
}

/* ------------------------------------------------------------------------------------------ start and end */

static int create(pthread_t *thread, void *(*body)(void *), void *argument, int cpu, int priority) {
  pthread_attr_t attributes;
  int error = pthread_attr_init(&attributes);
  if (error) return error;
  pthread_attr_setstacksize(&attributes, STACK);
  if (cpu >= 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET((size_t)cpu, &set);
    pthread_attr_setaffinity_np(&attributes, sizeof set, &set);
  }
  if (priority > 0) {
    const struct sched_param parameter = {.sched_priority = priority};
    pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    pthread_attr_setschedpolicy(&attributes, SCHED_FIFO);
    pthread_attr_setschedparam(&attributes, &parameter);
  }
  error = pthread_create(thread, &attributes, body, argument);
  pthread_attr_destroy(&attributes);
  return error;
}

static int make_gate(void) {
  pthread_mutexattr_t attributes;
  int error = pthread_mutexattr_init(&attributes);
  if (!error) error = pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
  return error ? error : pthread_mutex_init(&gate, &attributes);
}

static int find_peers(int worker) {
  worker_state *self = &workers[worker];
  self->peers = calloc((size_t)plan.n_workers, sizeof *self->peers);
  if (!self->peers) return ENOMEM;
  const dispatch_worker *own = &plan.workers[worker];
  for (int i = 0; i < plan.n_workers; i++)
    if (i != worker && own->priority == plan.workers[i].priority && strcmp(own->unit, plan.workers[i].unit) == 0)
      self->peers[self->n_peers++] = i;
  return 0;
}

int dispatch_start(const dispatch_options *options) {
  now_ = *options;
  if (make_gate()) return fail(ENOMEM, "no lock with priority inheritance", NULL);
  workers = calloc((size_t)plan.n_workers, sizeof *workers);
  if (!workers) return fail(ENOMEM, "no memory for the threads", NULL);
  for (int i = 0; i < plan.n_workers; i++) {
    workers[i].events = calloc(now_.capacity + 1, sizeof *workers[i].events);
    if (!workers[i].events || find_peers(i)) return fail(ENOMEM, "no memory for the recorder; lower --events", NULL);
    memset(workers[i].events, 0, (now_.capacity + 1) * sizeof *workers[i].events);   /* its pages are there */
  }
  for (int i = 0; i < plan.n_workers; i++) {
    const int priority = now_.priority ? now_.priority + plan.workers[i].priority : 0;
    const int error = create(&workers[i].thread, work, (void *)(intptr_t)i, now_.cpus[i], priority);
    if (error) return fail(error, "a thread cannot be started for task", plan.workers[i].task);
  }
  origin = now_.origin ? now_.origin : (clock_now(now_.clock) / SECOND + 2) * SECOND;
  const int priority = now_.priority ? now_.priority + plan.levels : 0;
  const int error = create(&conductor, conduct, NULL, -1, priority);
  return error ? fail(error, "the conductor cannot be started", NULL) : 0;
}

int dispatch_wait(int64_t seconds) {
  pthread_join(conductor, NULL);
  struct timespec until;
  clock_gettime(CLOCK_REALTIME, &until);
  until.tv_sec += seconds;
  int error = 0;
  for (int i = 0; i < plan.n_workers; i++)
    if (pthread_timedjoin_np(workers[i].thread, NULL, &until)) error = ETIMEDOUT;
  return error;
}

void dispatch_hook(void (*run)(int program)) { hook = run; }
void dispatch_request(int mode) {
  if (atomic_load(&wanted) != mode) atomic_store(&requested, clock_now(now_.clock));
  atomic_store(&wanted, mode);
}
void dispatch_stop(void) { atomic_store(&stopping, 1); }
int dispatch_has_ended(void) { return atomic_load(&ended); }
int64_t dispatch_origin(void) { return origin; }
uint64_t dispatch_refused(void) { return atomic_load(&refused); }
uint64_t dispatch_torn(void) { return atomic_load(&torn); }

const dispatch_switch *dispatch_switches(size_t *n) {
  *n = n_switches;
  return switches;
}

dispatch_record dispatch_recorded(int worker) {
  const worker_state *w = &workers[worker];
  return (dispatch_record){w->events, w->n_events, w->unrecorded, w->skipped, w->late_ends, w->lost_tables,
                           !atomic_load(&w->is_done)};
}
