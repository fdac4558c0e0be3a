/* Recorder: a thread at normal priority writes the jobs that ended as rows of CSV while the tables are played.
 *
 * What was recorded is in the file whatever ends the process: a signal that ends it writes the rest first, with calls that
 * POSIX allows there. The file and the one before it (FILE.1) have half of the stated size each.
 */
#define _GNU_SOURCE
#include "dispatch.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define PAGE (64 * 1024)
#define ROW (PAGE / 4)            /* what is longer is cut: no name that an export writes is */
#define BATCH 64
#define INTERVAL 50000000L        /* ns between two rounds of the recorder */
#define ALTERNATE (64 * 1024)     /* stack for the signal after a stack has overflown */

static const char header[] = "task,job,mode,cycle,start,end,units,busy,planned,data\n";
static const int fatal[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGSYS, SIGTRAP, SIGXCPU};

static struct {
  char name[4096], former[4096], page[PAGE];
  int file, error, is_open;
  uint64_t limit, size;           /* size: of whole rows in the file */
  size_t filled, rows;            /* of the page: its rows are written together or count as not recorded */
} out = {.file = -1};
static atomic_flag busy = ATOMIC_FLAG_INIT;
static atomic_int finishing;
static pthread_t recorder;
static int has_recorder;
static _Atomic uint64_t errors[64 * 59], n_jobs, unwritten;   /* errors: start errors by 64 steps for each power of two */
static _Atomic int64_t worst;

/* ---------------------------------------------------------------------------------------------- rows */

static void put(const char *text) {
  while (*text && out.filled < PAGE) out.page[out.filled++] = *text++;
}

static void put_number(int64_t value, char end) {
  char digits[24];
  size_t n = sizeof digits;
  uint64_t rest = value < 0 ? 0 - (uint64_t)value : (uint64_t)value;
  digits[--n] = 0;
  digits[--n] = end;
  do digits[--n] = (char)('0' + rest % 10);
  while (rest /= 10);
  if (value < 0) digits[--n] = '-';
  put(digits + n);
}

static void give_up(int error) {
  out.error = error;
  if (out.file >= 0 && ftruncate(out.file, (off_t)out.size) == 0) fsync(out.file);   /* no half of a row stays behind */
  if (out.file >= 0) close(out.file);
  out.file = -1;
}

/* A file without a name is written for no one. */
static int is_removed(void) {
  struct stat found;
  return out.file >= 0 && fstat(out.file, &found) == 0 && found.st_nlink == 0;
}

static void flush(void) {
  if (is_removed()) give_up(ENOENT);
  for (size_t done = 0; done < out.filled && out.file >= 0;) {
    const ssize_t n = write(out.file, out.page + done, out.filled - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) give_up(n < 0 ? errno : EIO);
    else done += (size_t)n;
  }
  if (out.file >= 0) out.size += out.filled;
  else atomic_fetch_add(&unwritten, out.rows);
  out.filled = out.rows = 0;
}

static void open_file(void) {
  out.file = open(out.name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NONBLOCK, 0644);
  out.size = 0;
  if (out.file < 0) out.error = errno;
  else put(header);
}

static void turn_over(void) {
  flush();
  if (out.file < 0) return;
  close(out.file);
  out.file = -1;
  if (rename(out.name, out.former)) out.error = errno;
  else open_file();
}

static void write_row(int worker, const dispatch_event *e) {
  const dispatch_worker *w = &plan.workers[worker];
  const int64_t origin = dispatch_origin();
  if (out.file < 0) {
    if (out.is_open) atomic_fetch_add(&unwritten, 1);
    return;
  }
  put(w->task), put(",");
  put_number(e->job, ',');
  put(plan.tables[e->table].name), put(",");
  put_number((int64_t)e->cycle, ',');
  put_number(e->began - origin, ',');
  if (e->ended != INT64_MIN) put_number(e->ended - origin, ',');
  else put(",");
  put(w->units), put(",");
  if (e->ended != INT64_MIN) put_number(e->busy, ',');
  else put(",");
  put_number(e->planned - origin, ',');
  put_number(e->result == DISPATCH_RAN, '\n');
  out.rows++;
  if (out.filled > PAGE - ROW) flush();
  if (out.limit && out.size > out.limit / 2 && out.file >= 0) turn_over();
}

/* -------------------------------------------------------------------------------------------- start errors */

static void tally(const dispatch_event *e) {
  const uint64_t value = e->began > e->planned ? (uint64_t)(e->began - e->planned) : 0;
  const int shift = value < 64 ? 0 : 63 - __builtin_clzll(value) - 6;
  const uint64_t step = value < 64 ? value : 64 * ((uint64_t)shift + 1) + (value >> shift) - 64;
  atomic_fetch_add_explicit(&errors[step], 1, memory_order_relaxed);
  atomic_fetch_add_explicit(&n_jobs, 1, memory_order_relaxed);
  if ((int64_t)value > atomic_load(&worst)) atomic_store(&worst, (int64_t)value);
}

int64_t dispatch_start_error(int percent) {
  const uint64_t all = atomic_load(&n_jobs);
  uint64_t wanted = (all * (uint64_t)percent + 99) / 100, i = 0;
  if (percent >= 100 || !all) return atomic_load(&worst);
  for (; i < sizeof errors / sizeof *errors - 1; i++) {
    const uint64_t here = atomic_load(&errors[i]);
    if (here >= wanted) break;
    wanted -= here;
  }
  const int shift = i < 64 ? 0 : (int)(i / 64) - 1;
  const int64_t value = i < 64 ? (int64_t)i : (int64_t)(((i % 64 + 65) << shift) - 1);
  return value < atomic_load(&worst) ? value : atomic_load(&worst);
}

uint64_t dispatch_recorded(void) { return atomic_load(&n_jobs); }
uint64_t dispatch_unwritten(void) { return atomic_load(&unwritten); }

/* ---------------------------------------------------------------------------------------------- rounds */

static void collect(void) {
  dispatch_event taken[BATCH];
  for (int worker = 0; worker < plan.n_workers; worker++)
    for (size_t n; (n = dispatch_take(worker, taken, BATCH)) > 0;)
      for (size_t i = 0; i < n; i++) {
        tally(&taken[i]);
        write_row(worker, &taken[i]);
      }
  if (out.filled) flush();
}

static void rest(long ns) {
  const struct timespec t = {0, ns};
  clock_nanosleep(CLOCK_MONOTONIC, 0, &t, NULL);
}

static void *rounds(void *unused) {
  (void)unused;
  while (!atomic_load(&finishing)) {
    while (atomic_flag_test_and_set(&busy)) rest(1000000);
    collect();
    atomic_flag_clear(&busy);
    rest(INTERVAL);
  }
  return NULL;
}

/* The rest of the rows, those of jobs that never ended last. */
static void close_file(void) {
  collect();
  dispatch_event e;
  for (int worker = 0; worker < plan.n_workers; worker++)
    if (dispatch_running(worker, &e)) write_row(worker, &e);
  if (out.filled) flush();
  if (out.file >= 0 && fsync(out.file) && !out.error) out.error = errno;
}

/* -------------------------------------------------------------------------------------------- crashes */

static void say(const char *text) {
  if (write(STDERR_FILENO, text, strlen(text)) < 0) return;
}

static void name_and_close(const char *how) {
  const int worker = dispatch_worker_here();
  say("dispatcher: ");
  say(worker < 0 ? "a thread without a task" : "task ");
  if (worker >= 0) say(plan.workers[worker].task);
  say(" ended the process by "), say(how);
  say(out.file >= 0 ? "; the recording is kept\n" : "\n");
  int waits = 0;
  while (atomic_flag_test_and_set(&busy) && waits++ < 1000) rest(1000000);
  if (waits < 1000) close_file();
}

static void crash(int number) {
  char how[] = {'s', 'i', 'g', 'n', 'a', 'l', ' ', (char)('0' + number / 10), (char)('0' + number % 10), 0};
  name_and_close(how);
  raise(number);   /* its handler was taken away when it came: the process ends by it */
}

/* A program may call exit(), with any status; the tables end by it, which is no success. */
void dispatch_left(void) {
  if (atomic_load(&finishing)) return;
  name_and_close("exit()");
  _exit(1);
}

/* Every thread that runs foreign code has a second stack, since the first may be what overflowed. */
static void watch_here(void) {
  stack_t second = {.ss_sp = malloc(ALTERNATE), .ss_size = ALTERNATE};
  if (second.ss_sp) sigaltstack(&second, NULL);
}

void dispatch_enter(void) { watch_here(); }

/* ----------------------------------------------------------------------------------------- begin and end */

int dispatch_record(const char *file, uint64_t limit) {
  if (snprintf(out.name, sizeof out.name, "%s", file) >= (int)sizeof out.name - 2)
    return dispatch_fail(ENAMETOOLONG, "the name of the recording is too long", NULL);
  snprintf(out.former, sizeof out.former, "%.4090s.1", out.name);
  out.limit = limit;
  open_file();
  if (out.error) return dispatch_fail(out.error, "the recording cannot be written", file);
  flush();
  out.is_open = 1;
  return out.error ? dispatch_fail(out.error, "the recording cannot be written", file) : 0;
}

int dispatch_recorder_begin(void) {
  struct sigaction action = {.sa_handler = crash, .sa_flags = SA_ONSTACK | SA_RESETHAND};
  for (size_t i = 0; i < sizeof fatal / sizeof *fatal; i++) sigaction(fatal[i], &action, NULL);
  signal(SIGXFSZ, SIG_IGN);   /* a file or a log that takes no more is an error of write(), and no end of control */
  signal(SIGPIPE, SIG_IGN);
  const int error = dispatch_thread(&recorder, rounds, NULL, "recorder");
  has_recorder = !error;
  return error ? dispatch_fail(error, "the recorder cannot be started", NULL) : 0;
}

int dispatch_finish(void) {
  atomic_store(&finishing, 1);
  if (has_recorder) pthread_join(recorder, NULL);
  has_recorder = 0;
  if (!atomic_flag_test_and_set(&busy)) close_file();
  if (out.file >= 0 && close(out.file) && !out.error) out.error = errno;
  out.file = -1;
  return out.error;
}

int dispatch_status(void) {
  const dispatch_counts all = dispatch_total();
  unsigned steps;
  dispatch_stepped(&steps);
  if (out.error || all.unrecorded || atomic_load(&unwritten)) return DISPATCH_INCOMPLETE;
  const uint64_t faults = all.skipped + all.late_ends + all.overran + all.lost_tables + all.no_data + all.faults + all.astray + steps;
  return faults || all.is_running || all.is_stuck ? DISPATCH_FAULTS : DISPATCH_OK;
}

/* ---------------------------------------------------------------------------------------------- news */

static int tell(char *text, size_t size, uint64_t *told, uint64_t count, const char *task, const char *what) {
  if (count <= *told) return 0;
  *told = count;
  snprintf(text, size, "%.120s%s", task, what);
  return 1;
}

int dispatch_news(char *text, size_t size) {
  static struct {uint64_t stuck, overran, late, no_data, faults, unrecorded;} *seen;
  static uint64_t steps_told, left_told, error_told, astray_told;
  if (!seen && !(seen = calloc((size_t)plan.n_workers, sizeof *seen))) return 0;
  for (int i = 0; i < plan.n_workers; i++) {
    const dispatch_counts c = dispatch_counted(i);
    const char *task = plan.workers[i].task;
    if (!c.is_stuck) seen[i].stuck = 0;
    else if (!seen[i].stuck) {
      seen[i].stuck = 1;
      snprintf(text, size, "task %.120s still runs %lld us after the end of its slot", task, (long long)(c.over / 1000));
      return 1;
    }
    if (tell(text, size, &seen[i].faults, c.faults, task, ": a job failed")) return 1;
    if (!seen[i].overran && tell(text, size, &seen[i].overran, c.overran, task, ": a job took longer than its slot")) return 1;
    if (!seen[i].late && tell(text, size, &seen[i].late, c.late_ends, task, ": a job ended late")) return 1;
    if (!seen[i].no_data && tell(text, size, &seen[i].no_data, c.no_data, task, ": there was no message for a job")) return 1;
    if (!seen[i].unrecorded && tell(text, size, &seen[i].unrecorded, c.unrecorded, task, ": jobs are not recorded; raise --events"))
      return 1;
  }
  unsigned times;
  const int64_t step = dispatch_stepped(&times);
  if (tell(text, size, &steps_told, times, "", "")) {
    snprintf(text, size, "the clock was set, by %lld us in all; %s", (long long)(step / 1000),
             dispatch_is_paced() ? "the tables end" : "tables go on as they were, no longer at its whole seconds");
    return 1;
  }
  const char *const away = dispatch_is_paced() ? "tables were left out: simulated time ran ahead" : "tables were left out: the machine was away";
  if (!left_told && tell(text, size, &left_told, dispatch_left_out(), "", away)) return 1;
  if (!astray_told && tell(text, size, &astray_told, dispatch_total().astray, "", "the regulators do not play the table of the jobs, or have slipped by a window")) return 1;
  return !error_told && out.error && tell(text, size, &error_told, 1, "the recording ends: ", strerror(out.error));
}
