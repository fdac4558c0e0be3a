#define _GNU_SOURCE
#include "dispatch.h"

#include <errno.h>
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
#define EARLIEST 30000    /* ns by which a timer is set before its instant, at most */
#define RING 256          /* tables that a thread may lag behind */
#define MILLISECOND INT64_C(1000000)
#define TOUCHED (128 * 1024)   /* bytes of a stack whose pages are there before the first job */
#define YIELDS 100        /* how often a late thread lets others begin that should have begun before */
#define PATIENCE 20000    /* and how often in all, which is about a second */
#define OPEN 64           /* tables of which copies are due at once: those whose last copies lie behind their ends */

typedef struct {          /* a table that is played */
  uint64_t cycle;
  int64_t at, shift;      /* shift: ns by which it begins after its instant of simulated time */
  int table;              /* -1: the end */
} turn;

typedef struct {          /* counters have one writer; others read them while it runs */
  pthread_t thread;
  dispatch_event *events;             /* a ring: the thread adds at `head`, the recorder takes at `tail` */
  _Atomic uint64_t head, tail, unrecorded, skipped, late_ends, overran, lost_tables, no_data, faults;
  atomic_int is_done, is_demoted;
  _Atomic int64_t next;   /* no job that it is about to start has an earlier instant */
  _Atomic int64_t after;  /* while a job runs: the next one has no earlier instant */
  _Atomic int64_t due;    /* the end of the slot of the job that runs, INT64_MAX: none */
  _Atomic int64_t noticed;            /* the `due` of the last job that the conductor found to be over */
  _Atomic int64_t planned, began;     /* of the job that runs */
  _Atomic uint64_t cycle;
  _Atomic uint32_t which;             /* its table and job */
  int *peers, n_peers;    /* threads of the same unit and priority, which do not preempt each other */
} worker_state;

char dispatch_reason[256];
static dispatch_options now_;
static worker_state *workers;
static turn ring[RING];
static uint64_t published;        /* turns in the ring so far */
static pthread_mutex_t gate;      /* held for a few instructions, with priority inheritance */
static pthread_cond_t opened = PTHREAD_COND_INITIALIZER;
static atomic_int wanted = -1, stopping, ended, playing, unlocked;
static _Atomic int64_t requested, stepped;
static atomic_uint steps;
static _Atomic uint64_t in_cycle;
static dispatch_switches switched = {.excess = INT64_MIN};
static _Atomic uint64_t refused, left_out, astray;
static int64_t origin, shift, simulated, simulated_origin;
static pthread_t conductor, copier;
static int (*hook)(const dispatch_job *job, int64_t at);
static void (*hook_copy)(const dispatch_copy *copy);
static _Atomic int64_t copies_from = INT64_MAX, latest_copy;   /* all copies before the first instant are made */
static _Atomic uint64_t n_copied;
static _Thread_local int here = -1;

int dispatch_fail(int error, const char *what, const char *which) {
  snprintf(dispatch_reason, sizeof dispatch_reason, "%s%s%s", what, which ? ": " : "", which ? which : "");
  return error ? error : EINVAL;
}

/* ------------------------------------------------------------------------------------------------ time */

static int64_t clock_now(clockid_t clock) {
  struct timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * SECOND + t.tv_nsec;
}

static int64_t time_now(void) { return clock_now(CLOCK_MONOTONIC); }

static void sleep_until(int64_t at) {
  const struct timespec t = {at / SECOND, at % SECOND};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) { }
}

/* No wake-up of this thread took less than `soonest`, so its timer is set so much earlier; one that is faster polls the rest. */
void dispatch_until(int64_t at) {
  static _Thread_local int64_t soonest = EARLIEST + 1;
  const int64_t early = now_.spin + (soonest > EARLIEST ? 0 : soonest), call = at - early;
  if (call > time_now()) {
    sleep_until(call);
    const int64_t took = time_now() - call;
    if (took < soonest) soonest = took;
  }
  while (time_now() < at) { }
}

/* How far a clock is ahead of CLOCK_MONOTONIC: at least `low` and at most `high`. */
typedef struct {int64_t low, high;} bounds;

static bounds offset_of(clockid_t clock) {
  bounds found = {0, clock == CLOCK_MONOTONIC ? 0 : INT64_MAX};
  for (int i = 0; i < 5 && found.high; i++) {   /* the closest of some readings */
    const int64_t before = time_now(), there = clock_now(clock), after = time_now();
    if (after - before < found.high - found.low) found = (bounds){there - after, there - before};
  }
  return found;
}

static int64_t middle(bounds b) { return b.low + (b.high - b.low) / 2; }

/* Tables are played on CLOCK_MONOTONIC, which has the same rate: control is not disturbed when the clock of the origin is set. */
static bounds offset;   /* of the clock of the origin */

static void check_clock(void) {
  const bounds found = offset_of(now_.clock);
  if (found.low <= offset.high + 1000 && found.high + 1000 >= offset.low) return;   /* constant unless one is set; 1 us for rounding */
  atomic_fetch_add(&stepped, middle(found) - middle(offset));
  offset = found;
  atomic_fetch_add(&steps, 1);
}

/* --------------------------------------------------------------------------------------------- workers */

static int lacks_copies(int64_t at) { return atomic_load_explicit(&copies_from, memory_order_acquire) <= at; }

static int is_ahead(const worker_state *self, int64_t at) {
  for (int i = 0; i < self->n_peers; i++)
    if (atomic_load_explicit(&workers[self->peers[i]].next, memory_order_relaxed) < at) return 1;
  return 0;
}

/* A thread that was stopped within a job may be behind, too; one that does not return must not hold up the others. */
static int is_behind(const worker_state *self, int64_t at) {
  for (int i = 0; i < self->n_peers; i++) {
    const worker_state *other = &workers[self->peers[i]];
    const int is_stuck = atomic_load_explicit(&other->noticed, memory_order_relaxed) == atomic_load_explicit(&other->due, memory_order_relaxed);
    if (!is_stuck && atomic_load_explicit(&other->after, memory_order_relaxed) <= at) return 1;
  }
  return 0;
}

/* Jobs of a unit start in the order of their instants, also when the machine was away for several of them. */
static void wait_in_order(worker_state *self, int64_t at, int64_t after) {
  atomic_store_explicit(&self->next, at, memory_order_relaxed);
  dispatch_until(at);
  for (int i = 0; i < 20 * YIELDS && lacks_copies(at); i++) sched_yield();   /* they take some microseconds */
  for (int i = 0; i < PATIENCE && (lacks_copies(at) || is_ahead(self, at) || (i < 2 * YIELDS && is_behind(self, at))); i++) {
    const struct timespec moment = {0, 50000};
    if (i < YIELDS) sched_yield();
    else clock_nanosleep(CLOCK_MONOTONIC, 0, &moment, NULL);   /* without SCHED_FIFO, a yield prefers no thread */
  }
  atomic_store_explicit(&self->after, after, memory_order_relaxed);
  atomic_store_explicit(&self->next, INT64_MAX, memory_order_relaxed);
}

/* Ask for the mode to go to after an overrun, as the options say, else as the health rules of the model do. */
static void flee(const worker_state *self) {
  const int refuge = now_.refuge == DISPATCH_BY_RULES ? plan.workers[self - workers].refuge : now_.refuge;
  if (refuge >= 0) dispatch_request(refuge);
}

/* After a fault: the mode of a health rule, else the end. */
static void fail_safe(worker_state *self) {
  atomic_fetch_add(&self->faults, 1);
  const int refuge = plan.workers[self - workers].fault;
  if (refuge >= 0) dispatch_request(refuge);
  else dispatch_stop();
}

static void keep(worker_state *self, const dispatch_event *event) {
  const uint64_t head = atomic_load_explicit(&self->head, memory_order_relaxed);
  if (head - atomic_load_explicit(&self->tail, memory_order_acquire) >= now_.capacity) {
    atomic_fetch_add(&self->unrecorded, 1);
    return;
  }
  self->events[head % now_.capacity] = *event;
  atomic_store_explicit(&self->head, head + 1, memory_order_release);
}

static int set_priority(worker_state *w, int priority) {
  const struct sched_param parameter = {.sched_priority = priority};
  return pthread_setschedparam(w->thread, priority ? SCHED_FIFO : SCHED_OTHER, &parameter);
}

/* A job that is under way is known to the conductor, and to the recorder if it never ends. */
static void begin(worker_state *self, const dispatch_job *job, const turn *turn, int64_t began) {
  const int64_t at = turn->at + job->start;
  atomic_store_explicit(&self->planned, at - turn->shift, memory_order_relaxed);
  atomic_store_explicit(&self->began, began - turn->shift, memory_order_relaxed);
  atomic_store_explicit(&self->cycle, turn->cycle, memory_order_relaxed);
  atomic_store_explicit(&self->which, (uint32_t)turn->table << 16 | job->job, memory_order_relaxed);
  atomic_store_explicit(&self->due, turn->at + job->end, memory_order_release);
}

static void play(worker_state *self, const dispatch_job *job, const turn *turn, int64_t after) {
  const int64_t at = turn->at + job->start, due = turn->at + job->end;
  wait_in_order(self, at, after);
  const int64_t began = time_now();
  if (began >= due) flee(self);
  if (began >= due && now_.policy != DISPATCH_LOG) {
    atomic_fetch_add(&self->skipped, 1);
    return;
  }
  const int64_t used = clock_now(CLOCK_THREAD_CPUTIME_ID);
  begin(self, job, turn, began);
  const int result = hook(job, turn->at);
  const int64_t over = time_now();
  atomic_store_explicit(&self->due, INT64_MAX, memory_order_release);
  if (atomic_exchange(&self->is_demoted, 0)) set_priority(self, now_.priority + plan.workers[self - workers].priority);
  if (result == DISPATCH_FAULT) fail_safe(self);
  if (result == DISPATCH_NO_DATA) atomic_fetch_add(&self->no_data, 1);
  if (over > due) {
    atomic_fetch_add(over - began > due - at ? &self->overran : &self->late_ends, 1);
    if (atomic_load(&self->noticed) != due) flee(self);
  }
  const dispatch_event event = {
    .planned = at - turn->shift, .began = began - turn->shift, .ended = over - turn->shift, .busy = clock_now(CLOCK_THREAD_CPUTIME_ID) - used,
    .cycle = turn->cycle, .table = (uint16_t)turn->table, .job = job->job, .result = (int16_t)result,
  };
  keep(self, &event);
}

/* Wait for a turn; who lags by more than the ring continues with the oldest that is still known. */
static turn turn_of(uint64_t *number, _Atomic uint64_t *lost) {
  pthread_mutex_lock(&gate);
  while (published <= *number) pthread_cond_wait(&opened, &gate);
  if (published - *number > RING) {
    atomic_fetch_add(lost, published - RING - *number);
    *number = published - RING;
  }
  const turn found = ring[*number % RING];
  pthread_mutex_unlock(&gate);
  return found;
}

static int create(pthread_t *thread, void *(*body)(void *), void *argument, const char *name, int cpu, int priority);

static void prefault(void) {
  volatile char page[TOUCHED];
  for (size_t i = 0; i < sizeof page; i += 1024) page[i] = 1;
}

static void *work(void *argument) {
  const int index = (int)(intptr_t)argument;
  worker_state *self = &workers[index];
  here = index;
  dispatch_enter();
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);   /* counts where SCHED_FIFO was refused */
  prefault();
  for (uint64_t number = 0;; number++) {
    const turn turn = turn_of(&number, &self->lost_tables);
    if (turn.table < 0) break;
    const dispatch_rows *rows = &plan.workers[index].tables[turn.table];
    const int64_t length = plan.tables[turn.table].length;
    for (int i = 0; i < rows->n_jobs; i++) {
      const int is_last = i + 1 == rows->n_jobs, crosses = rows->jobs[i].end > length;   /* its gaps may be those of others */
      const int64_t after = turn.at + (is_last ? length : rows->jobs[i + 1].start);
      play(self, &rows->jobs[i], &turn, is_last && crosses ? INT64_MAX : after);
      atomic_store(&self->next, after);
    }
    atomic_store(&self->next, turn.at + length);
    atomic_store(&self->after, INT64_MAX);
  }
  atomic_store(&self->next, INT64_MAX);
  atomic_store(&self->is_done, 1);
  return NULL;
}

/* ---------------------------------------------------------------------------------------------- copies */

static void copy_at(const dispatch_copy *copy, int64_t at) {
  dispatch_until(at);
  hook_copy(copy);
  const int64_t late = time_now() - at;
  if (late > atomic_load(&latest_copy)) atomic_store(&latest_copy, late);
  atomic_fetch_add(&n_copied, 1);
}

/* The copies of all tables in the order of their instants. Those of one may lie behind its end, among those of the next. */
static void *copy_in_time(void *unused) {
  (void)unused;
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
  prefault();
  turn open[OPEN];
  int next[OPEN], n = 0, first;
  uint64_t number = 0;
  for (int64_t known = INT64_MIN;;) {   /* what is due before is known: the next table begins there */
    int64_t at = known;
    first = -1;
    for (int i = 0; i < n; i++) {
      const int64_t due = open[i].at + plan.tables[open[i].table].copies[next[i]].at;
      if (due < at) first = i, at = due;
    }
    atomic_store_explicit(&copies_from, at, memory_order_release);
    if (first >= 0) {
      const dispatch_table *table = &plan.tables[open[first].table];
      copy_at(&table->copies[next[first]++], at);
      if (next[first] < table->n_copies) continue;
      for (int i = first + 1; i < n; i++) open[i - 1] = open[i], next[i - 1] = next[i];
      n--;
    } else if (known == INT64_MAX) return NULL;
    else {
      const turn turn = turn_of(&number, &left_out);
      number++;
      known = turn.table < 0 ? INT64_MAX : turn.at + plan.tables[turn.table].length;
      if (turn.table < 0 || !plan.tables[turn.table].n_copies) continue;
      if (n < OPEN) open[n] = turn, next[n++] = 0;
      else atomic_fetch_add(&left_out, 1);
    }
  }
}

static int make_copier(void) {
  int n = 0;
  for (int i = 0; i < plan.n_tables; i++) n += plan.tables[i].n_copies;
  if (!n) return 0;
  atomic_store(&copies_from, INT64_MIN);
  const int error = create(&copier, copy_in_time, NULL, "copier", -1, now_.priority ? now_.priority + plan.levels : 0);
  if (error) return dispatch_fail(error, "the thread of the copies cannot be started", NULL);
  pthread_detach(copier);
  return 0;
}

/* -------------------------------------------------------------------------------------------- conductor */

static void publish(turn next) {
  pthread_mutex_lock(&gate);
  ring[published++ % RING] = next;
  pthread_cond_broadcast(&opened);
  pthread_mutex_unlock(&gate);
}

/* How long the request that ends `table` waited for the next one, which begins at `at`, or when it was known, if later. */
static void measure(int table, int64_t at, int64_t asked) {
  const int64_t time = time_now(), waited = (time > at ? time : at) - asked;
  const int64_t excess = waited - plan.tables[table].length - now_.lead;
  switched.taken++;
  if (waited > switched.longest) switched.longest = waited;
  if (excess > switched.excess) switched.excess = excess;
}

/* The table after `table`: the target of a switch, the switch that was asked for, or the same mode again. */
static int choose(int table, int64_t at) {
  const dispatch_table *t = &plan.tables[table];
  if (t->from != t->to) return t->to;
  const int64_t asked = atomic_load(&requested);
  const int mode = atomic_exchange(&wanted, -1);
  if (mode < 0 || mode >= plan.n_modes || mode == table) return table;
  const int next = plan.switches[table * plan.n_modes + mode];
  if (next >= 0 && now_.is_regulated && !plan.regulators->request(table, mode, at)) {
    int none = -1;
    atomic_compare_exchange_strong(&wanted, &none, mode);   /* at the end of the next table, unless another is asked for */
    return table;
  }
  if (next < 0) atomic_fetch_add(&refused, 1);
  else measure(table, at, asked);
  return next < 0 ? table : next;
}

/* Find the jobs that still run though their slots are over: a job that never returns cannot tell so itself.
 *
 * One that is late by more than a table loses its priority until it returns, so that the other tasks of its CPU run. */
static void watch(int64_t now, int64_t length) {
  for (int i = 0; i < plan.n_workers; i++) {
    worker_state *w = &workers[i];
    const int64_t due = atomic_load_explicit(&w->due, memory_order_acquire);
    if (now <= due) continue;
    if (atomic_exchange(&w->noticed, due) != due) flee(w);
    else if (now_.priority && now - due > length && !atomic_load(&w->is_demoted)) {
      atomic_store(&w->is_demoted, 1);
      set_priority(w, 0);
    }
  }
}

/* The instant at which a table ends; what is no whole nanosecond is kept, so nothing drifts. */
static int64_t after(int table, int64_t at, int64_t *rest) {
  *rest += plan.tables[table].rest;
  const int64_t end = at + plan.tables[table].length + *rest / plan.parts;
  *rest %= plan.parts;
  return end;
}

/* Wait until the simulated clock reaches the beginning of a table, and shift the table to a coming instant.
 *
 * A clock that pauses holds the tables, whose jobs are watched meanwhile; one that is set back ends them. */
static void keep_pace(int64_t at, int64_t length) {
  for (; !atomic_load(&stopping); sleep_until(time_now() + MILLISECOND)) {
    const int64_t there = now_.pace();
    if (there < simulated) {
      atomic_fetch_add(&stepped, there - simulated);
      atomic_fetch_add(&steps, 1);
      dispatch_stop();
    }
    simulated = there;
    if (simulated - simulated_origin >= at - origin) break;
    watch(time_now(), length);
  }
  const int64_t earliest = time_now() + now_.lead - at;
  if (shift < earliest) shift = earliest;
}

static void *conduct(void *unused) {
  (void)unused;
  prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
  prefault();
  int64_t at = origin, rest = 0;
  int table = now_.mode;
  uint64_t cycle = 0;
  if (now_.pace) keep_pace(at, plan.tables[table].length);
  if (!atomic_load(&stopping)) publish((turn){cycle, at + shift, shift, table});
  for (;;) {
    const int64_t length = plan.tables[table].length;
    atomic_store(&playing, table);
    atomic_store(&in_cycle, cycle);
    at = after(table, at, &rest);
    cycle++;
    if (length > 0) {
      sleep_until(at + shift - (now_.lead < length / 4 ? now_.lead : length / 4));
      check_clock();
      watch(time_now(), length);
      if (now_.is_regulated && plan.regulators->differs(at)) atomic_fetch_add(&astray, 1);
      if (now_.pace) keep_pace(at, length);
    }
    if (atomic_load(&stopping) || (now_.cycles && cycle >= now_.cycles)) break;
    table = choose(table, at + shift);
    const int64_t next = plan.tables[table].length, begin = at + shift;
    const int64_t time = now_.pace ? origin + simulated - simulated_origin : time_now();
    /* Far too late, whole tables are left out, so that phases stay; what is less is caught up with. */
    const int64_t patience = now_.policy == DISPATCH_LOG && !now_.pace ? RING / 8 * next : next;
    for (; table < plan.n_modes && next > 0 && at + patience <= time; cycle++) {
      at = after(table, at, &rest);
      atomic_fetch_add(&left_out, 1);
    }
    if (now_.pace) shift = begin - at;
    publish((turn){cycle, at + shift, shift, table});
  }
  publish((turn){cycle, at + shift, shift, -1});
  atomic_store(&ended, 1);
  return NULL;
}

/* ------------------------------------------------------------------------------------------ start and end */

/* Whether memory that was locked may be given up for what has no room else, and was until now. */
static int unlock(int error) {
  if (!now_.may_unlock || (error != EAGAIN && error != ENOMEM) || atomic_exchange(&unlocked, 1)) return 0;
  return munlockall() == 0;
}

static void *room(size_t n, size_t size) {
  void *found = calloc(n, size);
  return found || !unlock(ENOMEM) ? found : calloc(n, size);
}

static int create(pthread_t *thread, void *(*body)(void *), void *argument, const char *name, int cpu, int priority) {
  pthread_attr_t attributes;
  int error = pthread_attr_init(&attributes);
  if (error) return error;
  if (now_.stack) error = pthread_attr_setstacksize(&attributes, now_.stack);
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
  if (!error) error = pthread_create(thread, &attributes, body, argument);
  if (error && unlock(error)) error = pthread_create(thread, &attributes, body, argument);
  pthread_attr_destroy(&attributes);
  const size_t length = strlen(name);   /* the last letters tell tasks apart, and a name has room for 15 */
  if (!error) pthread_setname_np(*thread, length > 15 ? name + length - 15 : name);
  return error;
}

int dispatch_thread(void *thread, void *(*body)(void *), void *argument, const char *name) {
  return create(thread, body, argument, name, -1, 0);
}

static int make_gate(void) {
  pthread_mutexattr_t attributes;
  int error = pthread_mutexattr_init(&attributes);
  if (!error) error = pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
  return error ? error : pthread_mutex_init(&gate, &attributes);
}

static int find_peers(int worker) {
  worker_state *self = &workers[worker];
  self->peers = room((size_t)plan.n_workers, sizeof *self->peers);
  if (!self->peers) return ENOMEM;
  const dispatch_worker *own = &plan.workers[worker];
  for (int i = 0; i < plan.n_workers; i++)
    if (i != worker && own->priority == plan.workers[i].priority && strcmp(own->unit, plan.workers[i].unit) == 0)
      self->peers[self->n_peers++] = i;
  return 0;
}

/* Each CPU must be there, of one unit, and this process must be allowed to use it. */
static int check_cpus(void) {
  cpu_set_t usable;
  CPU_ZERO(&usable);
  if (sched_getaffinity(0, sizeof usable, &usable)) return 0;
  for (int i = 0; i < plan.n_workers; i++) {
    const int cpu = now_.cpus[i];
    if (cpu >= 0 && cpu < CPU_SETSIZE && CPU_ISSET((size_t)cpu, &usable)) continue;
    snprintf(dispatch_reason, sizeof dispatch_reason, "unit %.100s is CPU %d, which is not there or not allowed here; %d are",
             plan.workers[i].unit, cpu, CPU_COUNT(&usable));
    return ENODEV;
  }
  for (int i = 1; i < plan.n_workers && !now_.may_share; i++)
    for (int k = 0; k < i; k++) {
      const char *unit = plan.workers[i].unit, *other = plan.workers[k].unit;
      if (now_.cpus[i] != now_.cpus[k] || strcmp(unit, other) == 0) continue;
      snprintf(dispatch_reason, sizeof dispatch_reason, "units %.90s and %.90s are both CPU %d", other, unit, now_.cpus[i]);
      return EINVAL;
    }
  return 0;
}

static int make_worker(int index) {
  worker_state *w = &workers[index];
  atomic_store(&w->due, INT64_MAX);
  atomic_store(&w->after, INT64_MAX);
  w->events = room(now_.capacity + 1, sizeof *w->events);
  if (!w->events || find_peers(index)) return dispatch_fail(ENOMEM, "no memory for the recorder; lower --events", NULL);
  memset(w->events, 0, (now_.capacity + 1) * sizeof *w->events);   /* its pages are there */
  return 0;
}

/* The first instant, or, where it is past as after a restart, a coming one of its phase: no table is played late. */
static int64_t next_of_phase(int64_t at, int64_t now) {
  const dispatch_table *t = &plan.tables[now_.mode];
  const __int128 length = (__int128)t->length * plan.parts + t->rest;
  if (at > now) return at;
  return at + (int64_t)(((__int128)(now + SECOND / 10 - at) * plan.parts / length + 1) * length / plan.parts);
}

int dispatch_start(const dispatch_options *options) {
  now_ = *options;
  int error = check_cpus();
  if (error) return error;
  if (now_.priority && now_.priority + plan.levels > 99) return dispatch_fail(EINVAL, "priorities pass 99; lower the one of the run", NULL);
  if (make_gate()) return dispatch_fail(ENOMEM, "no lock with priority inheritance", NULL);
  workers = room((size_t)plan.n_workers, sizeof *workers);
  if (!workers) return dispatch_fail(ENOMEM, "no memory for the threads", NULL);
  for (int i = 0; i < plan.n_workers && !error; i++) error = make_worker(i);
  for (int i = 0; i < plan.n_workers && !error; i++) {
    const dispatch_worker *w = &plan.workers[i];
    const int priority = now_.priority ? now_.priority + w->priority : 0;
    error = create(&workers[i].thread, work, (void *)(intptr_t)i, w->task, now_.cpus[i], priority);
    if (error) return dispatch_fail(error, "a thread cannot be started for task", w->task);
  }
  if (!error) error = dispatch_recorder_begin();
  if (!error) error = make_copier();
  if (error) return error;
  offset = offset_of(now_.clock);
  const int64_t ahead = middle(offset);
  if (now_.pace) simulated = now_.pace(), simulated_origin = (simulated / SECOND + 1) * SECOND;
  origin = now_.pace ? time_now() : now_.origin ? next_of_phase(now_.origin - ahead, time_now()) : ((time_now() + ahead) / SECOND + 2) * SECOND - ahead;
  if (now_.is_regulated && (error = plan.regulators->start(now_.mode, origin))) return error;
  error = create(&conductor, conduct, NULL, "conductor", -1, now_.priority ? now_.priority + plan.levels : 0);
  if (!error) atexit(dispatch_left);
  return error ? dispatch_fail(error, "the conductor cannot be started", NULL) : 0;
}

int dispatch_lock(void) { return mlockall(MCL_CURRENT | MCL_FUTURE) ? dispatch_fail(errno, "memory cannot be locked", NULL) : 0; }

int dispatch_wait(int64_t seconds) {
  pthread_join(conductor, NULL);
  const int64_t end = time_now() + seconds * SECOND;
  int error = 0;
  for (int i = 0; i < plan.n_workers; i++) {
    while (!atomic_load(&workers[i].is_done) && time_now() < end) sleep_until(time_now() + MILLISECOND);
    if (!atomic_load(&workers[i].is_done)) error = ETIMEDOUT;
    else pthread_join(workers[i].thread, NULL);
  }
  return error;
}

void dispatch_hook(int (*run)(const dispatch_job *job, int64_t at), void (*copy)(const dispatch_copy *copy)) {
  hook = run;
  hook_copy = copy;
}

void dispatch_request(int mode) {
  if (atomic_load(&wanted) != mode) atomic_store(&requested, time_now());
  atomic_store(&wanted, mode);
}
void dispatch_stop(void) { atomic_store(&stopping, 1); }
int dispatch_is_paced(void) { return now_.pace != NULL; }
int dispatch_has_ended(void) { return atomic_load(&ended); }
int dispatch_is_unlocked(void) { return atomic_load(&unlocked); }
int dispatch_table_now(void) { return atomic_load(&playing); }
uint64_t dispatch_cycle_now(void) { return atomic_load(&in_cycle); }
int dispatch_worker_here(void) { return here; }
int64_t dispatch_origin(void) { return origin; }
uint64_t dispatch_left_out(void) { return atomic_load(&left_out); }

dispatch_switches dispatch_switched(void) { return switched; }

int64_t dispatch_stepped(unsigned *times) {
  *times = atomic_load(&steps);
  return atomic_load(&stepped);
}

size_t dispatch_take(int worker, dispatch_event *into, size_t most) {
  worker_state *w = &workers[worker];
  const uint64_t head = atomic_load_explicit(&w->head, memory_order_acquire);
  uint64_t tail = atomic_load_explicit(&w->tail, memory_order_relaxed);
  size_t n = 0;
  for (; tail < head && n < most; tail++) into[n++] = w->events[tail % now_.capacity];
  atomic_store_explicit(&w->tail, tail, memory_order_release);
  return n;
}

int dispatch_running(int worker, dispatch_event *into) {
  const worker_state *w = &workers[worker];
  const int64_t due = atomic_load_explicit(&w->due, memory_order_acquire);
  const uint32_t which = atomic_load(&w->which);
  *into = (dispatch_event){
    .planned = atomic_load(&w->planned), .began = atomic_load(&w->began), .ended = INT64_MIN, .cycle = atomic_load(&w->cycle),
    .table = (uint16_t)(which >> 16), .job = (uint16_t)which, .result = DISPATCH_RAN,
  };
  return due != INT64_MAX && due == atomic_load_explicit(&w->due, memory_order_acquire);
}

dispatch_counts dispatch_counted(int worker) {
  worker_state *w = &workers[worker];
  const int64_t over = time_now() - atomic_load(&w->due);
  return (dispatch_counts){
    .unrecorded = atomic_load(&w->unrecorded), .skipped = atomic_load(&w->skipped), .late_ends = atomic_load(&w->late_ends), .overran = atomic_load(&w->overran),
    .lost_tables = atomic_load(&w->lost_tables), .no_data = atomic_load(&w->no_data), .faults = atomic_load(&w->faults),
    .is_running = !atomic_load(&w->is_done), .is_stuck = over > 0, .over = over,
  };
}

dispatch_counts dispatch_total(void) {
  dispatch_counts all = {0};
  for (int i = 0; i < plan.n_workers; i++) {
    const dispatch_counts c = dispatch_counted(i);
    all.unrecorded += c.unrecorded, all.skipped += c.skipped, all.lost_tables += c.lost_tables, all.no_data += c.no_data;
    all.faults += c.faults, all.late_ends += c.late_ends, all.overran += c.overran;
    all.is_running += c.is_running, all.is_stuck += c.is_stuck;
  }
  all.lost_tables += atomic_load(&left_out);
  all.refused = atomic_load(&refused), all.copied = atomic_load(&n_copied), all.latest_copy = atomic_load(&latest_copy);
  all.astray = atomic_load(&astray);
  return all;
}
