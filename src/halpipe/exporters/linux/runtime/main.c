/* Program around the dispatcher: options, rights, signals, requests for modes, and the summary of the run. */
#define _GNU_SOURCE
#include "dispatch.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/timex.h>
#include <time.h>
#include <unistd.h>

#define SECOND INT64_C(1000000000)
#define MOST_SWITCHES 64

typedef struct {
  int64_t after;   /* ns from the first instant on */
  int mode;
} timed_switch;

static struct {
  dispatch_options run;
  const char *record, *control, *memory, *folder, *regulator;
  int degrade_fifo, degrade_memory, degrade_cpus, degrade_regulator;
  double seconds;
  int64_t limit;
  timed_switch switches[MOST_SWITCHES];
  int n_switches;
} cfg = {
  .run = {.priority = PRIORITY, .clock = CLOCK_MONOTONIC, .refuge = DISPATCH_BY_RULES, .lead = 300000, .capacity = 4096},
  .limit = INT64_C(1) << 30,
};

static const char *usage =
  "usage: dispatcher [options]\n"
  "  --mode NAME         begin in this mode (default: the first)\n"
  "  --cycles N          play so many tables;  --seconds S  about so long (default: until SIGINT or SIGTERM)\n"
  "  --switch S=MODE     ask for a mode S seconds after the first instant; may be repeated\n"
  "  --control FIFO      read requests from a named pipe: `mode NAME` or `stop`, a line each\n"
  "  --memory FILE       keep the buffers in this file, for other processes to map\n"
  "  --record FILE       write what ran as CSV, for `halpipe compare`, while it runs\n"
  "  --record-size MIB   at most so much in FILE and FILE.1, the part before it (default 1024)\n"
  "  --events N          room for so many jobs of each thread that wait for the recorder (default 4096)\n"
  "  --stack KIB         of each thread (default: that of the platform, see ulimit -s)\n"
  "  --overrun WHAT      of a job whose slot is over before it starts: log (run it), skip, or switch=MODE (skip, and go there);\n"
  "                      default: run it, and go where a health rule of the model says\n"
  "  --priority N        of SCHED_FIFO for the lowest thread, 1 to 98\n"
  "  --spin US           sleep until so long before each start, then poll\n"
  "  --clock NAME        monotonic, realtime or tai; the first instant is a whole second of it; the tables go on\n"
  "                      as they were when it is set meanwhile, which is reported\n"
  "  --origin NS         the first instant on that clock\n"
  "  --cpus N,N,...      CPU of each unit, in the order of --list\n"
  "  --regulator FILE    UIO device of the regulators of this bundle (default /dev/uio0)\n"
  "  --degrade WHAT      go on without: fifo, memory, cpus, regulator or all\n"
  "  --list              show modes and units\n"
  "exit status: 0 every job ran in its slot; 1 no start, no whole recording, or exit() of a program; 2 wrong options;\n"
  "  3 a fault was noticed: a job late, too long, skipped, failed, without end or data, a table lost, the clock set\n";

static void say(const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  fputs("dispatcher: ", stderr);
  vfprintf(stderr, format, arguments);
  fputc('\n', stderr);
  va_end(arguments);
}

static void die(int code, const char *what, const char *which) {
  say("%s%s%s", what, which ? ": " : "", which ? which : "");
  exit(code);
}

/* -------------------------------------------------------------------------------------------- options */

static int mode_of(const char *name) {
  for (int i = 0; i < plan.n_modes; i++)
    if (strcmp(plan.tables[i].name, name) == 0) return i;
  die(2, "there is no such mode; see --list", name);
  return -1;
}

static int64_t number(const char *text, int64_t low, int64_t high, const char *option) {
  char *end;
  errno = 0;
  const long long value = strtoll(text, &end, 10);
  if (errno || end == text || *end || value < low || value > high) {
    say("%s wants a whole number from %lld to %lld, not %s", option, (long long)low, (long long)high, text);
    exit(2);
  }
  return value;
}

static double seconds(const char *text, const char *option) {
  char *end;
  const double value = strtod(text, &end);
  if (end == text || *end || !(value >= 0) || value > 1e9) die(2, "no number of seconds", option);
  return value;
}

#define MOST_UNITS 1024
static const char *units[MOST_UNITS];
static int n_units, cpu_of[MOST_UNITS], *cpus;   /* CPUs by unit, and by worker */

static int unit_of(const char *name) {
  for (int i = 0; i < n_units; i++)
    if (strcmp(units[i], name) == 0) return i;
  return -1;
}

static void find_units(void) {
  for (int i = 0; i < plan.n_workers && n_units < MOST_UNITS; i++)
    if (unit_of(plan.workers[i].unit) < 0) {
      cpu_of[n_units] = plan.workers[i].cpu;
      units[n_units++] = plan.workers[i].unit;
    }
}

static void take_cpus(char *text) {
  int n = 0;
  for (char *piece; (piece = strsep(&text, ",")) != NULL;) {
    const int cpu = (int)number(piece, 0, CPU_SETSIZE - 1, "--cpus");
    if (n < n_units) cpu_of[n] = cpu;
    n++;
  }
  if (n != n_units) die(2, "--cpus wants one number for each unit of --list", NULL);
}

static void list(void) {
  for (int i = 0; i < plan.n_modes; i++) printf("mode %s: a table of %lld ns\n", plan.tables[i].name, (long long)plan.tables[i].length);
  for (int i = 0; i < n_units; i++) printf("unit %s: CPU %d\n", units[i], cpu_of[i]);
  exit(0);
}

static void take_switch(char *text) {
  char *sign = strchr(text, '=');
  if (!sign || cfg.n_switches == MOST_SWITCHES) die(2, "--switch wants SECONDS=MODE, at most 64 times", text);
  *sign = 0;
  const double after = seconds(text, "--switch");
  cfg.switches[cfg.n_switches++] = (timed_switch){(int64_t)(after * 1e9), mode_of(sign + 1)};
}

static void take_overrun(const char *text) {
  if (strcmp(text, "log") == 0) cfg.run.policy = DISPATCH_LOG, cfg.run.refuge = DISPATCH_NOWHERE;
  else if (strcmp(text, "skip") == 0) cfg.run.policy = DISPATCH_SKIP, cfg.run.refuge = DISPATCH_NOWHERE;
  else if (strncmp(text, "switch=", 7) == 0) cfg.run.policy = DISPATCH_SWITCH, cfg.run.refuge = mode_of(text + 7);
  else die(2, "--overrun is log, skip or switch=MODE", text);
}

static void take_clock(const char *text) {
  if (strcmp(text, "monotonic") == 0) cfg.run.clock = CLOCK_MONOTONIC;
  else if (strcmp(text, "realtime") == 0) cfg.run.clock = CLOCK_REALTIME;
  else if (strcmp(text, "tai") == 0) cfg.run.clock = CLOCK_TAI;
  else die(2, "--clock is monotonic, realtime or tai", text);
  struct timex state = {0};
  if (cfg.run.clock == CLOCK_TAI && adjtimex(&state) >= 0 && state.tai == 0)
    die(1, "the offset of CLOCK_TAI is not set; let ptp4l or chrony set it, or use --clock realtime", NULL);
}

static void take_degrade(const char *text) {
  const int all = strcmp(text, "all") == 0;
  if (!all && strcmp(text, "fifo") && strcmp(text, "memory") && strcmp(text, "cpus") && strcmp(text, "regulator"))
    die(2, "--degrade is fifo, memory, cpus, regulator or all", text);
  cfg.degrade_fifo |= all || strcmp(text, "fifo") == 0;
  cfg.degrade_memory |= all || strcmp(text, "memory") == 0;
  cfg.degrade_cpus |= all || strcmp(text, "cpus") == 0;
  cfg.degrade_regulator |= all || strcmp(text, "regulator") == 0;
}

static void take_option(const char *name, char *value) {
  if (strcmp(name, "--mode") == 0) cfg.run.mode = mode_of(value);
  else if (strcmp(name, "--cycles") == 0) cfg.run.cycles = (uint64_t)number(value, 1, INT64_MAX, name);
  else if (strcmp(name, "--seconds") == 0) cfg.seconds = seconds(value, name);
  else if (strcmp(name, "--switch") == 0) take_switch(value);
  else if (strcmp(name, "--control") == 0) cfg.control = value;
  else if (strcmp(name, "--memory") == 0) cfg.memory = value;
  else if (strcmp(name, "--record") == 0) cfg.record = value;
  else if (strcmp(name, "--record-size") == 0) cfg.limit = number(value, 1, 1 << 20, name) << 20;
  else if (strcmp(name, "--events") == 0) cfg.run.capacity = (size_t)number(value, 1, 100000000, name);
  else if (strcmp(name, "--stack") == 0) cfg.run.stack = 1024 * (size_t)number(value, 256, 1 << 20, name);
  else if (strcmp(name, "--overrun") == 0) take_overrun(value);
  else if (strcmp(name, "--priority") == 0) cfg.run.priority = (int)number(value, 1, 98, name);
  else if (strcmp(name, "--spin") == 0) cfg.run.spin = 1000 * number(value, 0, 1000000, name);
  else if (strcmp(name, "--clock") == 0) take_clock(value);
  else if (strcmp(name, "--origin") == 0) cfg.run.origin = number(value, 1, INT64_MAX / 2, name);
  else if (strcmp(name, "--cpus") == 0) take_cpus(value);
  else if (strcmp(name, "--regulator") == 0) cfg.regulator = value;
  else if (strcmp(name, "--degrade") == 0) take_degrade(value);
  else die(2, "unknown option; see --help", name);
}

static void take_options(int argc, char **argv) {
  for (int i = 1; i < argc; i += 2) {
    if (strcmp(argv[i], "--help") == 0) {
      fputs(usage, stdout);
      exit(0);
    }
    if (strcmp(argv[i], "--list") == 0) list();
    if (i + 1 == argc) die(2, "unknown option, or its value is missing; see --help", argv[i]);
    take_option(argv[i], argv[i + 1]);
  }
  for (int i = 0; cfg.seconds > 0 && i < cfg.n_switches; i++)
    if (cfg.switches[i].after >= (int64_t)(cfg.seconds * 1e9)) die(2, "a --switch is not before the end of --seconds", NULL);
}

/* --------------------------------------------------------------------------------------------- rights */

/* What is missing ends the start, with its remedy, unless the user asked to go on without it. */
static int missing(int allowed, const char *what, const char *remedy) {
  say("%s%s", allowed ? "degraded: " : "", what);
  if (!allowed) say("  %s", remedy);
  return !allowed;
}

static int check_cpus(void) {
  cpu_set_t usable;
  CPU_ZERO(&usable);
  sched_getaffinity(0, sizeof usable, &usable);
  int found[CPU_SETSIZE], n = 0, errors = 0;
  for (int cpu = 0; cpu < CPU_SETSIZE; cpu++)
    if (CPU_ISSET((size_t)cpu, &usable)) found[n++] = cpu;
  for (int i = 0; i < n_units; i++) {
    if (CPU_ISSET((size_t)cpu_of[i], &usable)) continue;
    char text[256];
    snprintf(text, sizeof text, "unit %.100s wants CPU %d, which this process may not use; it has %d of them", units[i], cpu_of[i], n);
    errors += missing(cfg.degrade_cpus, text, "name other CPUs with --cpus, widen the cpuset, or share CPUs with --degrade cpus");
    if (cfg.degrade_cpus) cpu_of[i] = found[i % n];
  }
  for (int w = 0; w < plan.n_workers; w++) cpus[w] = cpu_of[unit_of(plan.workers[w].unit)];
  return errors;
}

static int check_priority(void) {
  if (cfg.run.priority + plan.levels > 99)
    return missing(0, "the priorities of the threads and the conductor pass 99", "lower --priority");
  const struct sched_param high = {.sched_priority = cfg.run.priority + plan.levels}, plain = {0};
  if (sched_setscheduler(0, SCHED_FIFO, &high) == 0) {
    sched_setscheduler(0, SCHED_OTHER, &plain);
    return 0;
  }
  const int error = missing(cfg.degrade_fifo, "no right to SCHED_FIFO (CAP_SYS_NICE, or RLIMIT_RTPRIO)",
    "use the systemd unit, or `setcap cap_sys_nice,cap_ipc_lock+ep dispatcher`, or `ulimit -r 98`, in docker --cap-add=SYS_NICE "
    "--ulimit rtprio=98; or go on with --degrade fifo");
  cfg.run.priority = 0;
  return error;
}

static const char *const unlocked = "use the systemd unit, or `ulimit -l unlimited`, in docker --cap-add=IPC_LOCK --ulimit "
  "memlock=-1; or lower --stack and --events; or go on with --degrade memory";

static int lock_memory(void) {
  if (dispatch_lock() == 0) return 0;
  munlockall();
  return missing(cfg.degrade_memory, "no right to lock the memory (CAP_IPC_LOCK, or RLIMIT_MEMLOCK)", unlocked);
}

/* Without them, memory is not regulated: a run that is allowed that plays the tables all the same. */
static int load_regulators(void) {
  if (!plan.regulators && cfg.regulator) die(2, "this bundle has no regulators; export it with --regulator", NULL);
  if (!plan.regulators) return 0;
  cfg.run.is_regulated = plan.regulators->load(cfg.regulator ? cfg.regulator : "/dev/uio0") == 0;
  return cfg.run.is_regulated ? 0 : missing(cfg.degrade_regulator, dispatch_reason,
    "name the UIO device of the regulators with --regulator, or go on with --degrade regulator");
}

/* Threads take their stacks out of the memory that may be locked. */
static void start(void) {
  cfg.run.may_unlock = cfg.degrade_memory;
  cfg.run.may_share = cfg.degrade_cpus;
  const int error = dispatch_start(&cfg.run);
  if (error) {
    say("%s: %s", dispatch_reason, strerror(error));
    if (error == EAGAIN || error == ENOMEM) say("  locked memory may be at its limit: %s", unlocked);
    exit(1);
  }
  if (dispatch_is_unlocked()) missing(1, "RLIMIT_MEMLOCK has no room for the stacks, so the memory is not locked", "");
}

/* ------------------------------------------------------------------------------------------- requests */

static void obey(char *line) {
  if (strcmp(line, "stop") == 0) dispatch_stop();
  else if (strncmp(line, "mode ", 5) == 0) {
    for (int i = 0; i < plan.n_modes; i++)
      if (strcmp(plan.tables[i].name, line + 5) == 0) {
        dispatch_request(i);
        return;
      }
    say("request for an unknown mode: %.100s", line + 5);
  } else if (*line) say("unknown request: %.100s", line);
}

static void read_requests(int control) {
  static char line[256];
  static size_t length;
  char piece[256];
  const ssize_t n = read(control, piece, sizeof piece);
  for (ssize_t i = 0; i < n; i++) {
    if (piece[i] == '\n') {
      line[length] = 0;
      obey(line);
      length = 0;
    } else if (length + 1 < sizeof line) line[length++] = piece[i];
  }
}

static int64_t elapsed(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * SECOND + t.tv_nsec - dispatch_origin();
}

static void report(void) {
  char text[256];
  while (dispatch_news(text, sizeof text)) say("%s", text);
}

/* Until the conductor ends: signals stop, requests switch, and so do the instants of --switch and --seconds. */
static void attend(int signals, int control) {
  int done = 0;
  struct pollfd sources[2] = {{.fd = signals, .events = POLLIN}, {.fd = control, .events = POLLIN}};
  while (!dispatch_has_ended()) {
    report();
    const int64_t now = elapsed();
    int64_t next = now + SECOND / 5;
    for (; done < cfg.n_switches && cfg.switches[done].after <= now; done++) dispatch_request(cfg.switches[done].mode);
    if (done < cfg.n_switches && cfg.switches[done].after < next) next = cfg.switches[done].after;
    const int64_t end = (int64_t)(cfg.seconds * 1e9);
    if (cfg.seconds > 0 && end <= now) dispatch_stop();
    else if (cfg.seconds > 0 && end < next) next = end;
    poll(sources, control >= 0 ? 2 : 1, (int)((next - now) / 1000000) + 1);
    if (sources[0].revents & POLLIN) {
      dispatch_stop();
      sources[0].fd = -1;
    }
    if (control >= 0 && sources[1].revents & POLLIN) read_requests(control);
  }
}

/* --------------------------------------------------------------------------------------------- results */

static void summarise(void) {
  const dispatch_counts all = dispatch_total();
  unsigned steps;
  for (int w = 0; w < plan.n_workers; w++)
    if (dispatch_counted(w).is_running) say("task %s does not return", plan.workers[w].task);
  if (dispatch_recorded())
    printf("%llu jobs; start error p50 %.1f us, p99 %.1f us, max %.1f us\n", (unsigned long long)dispatch_recorded(),
           dispatch_start_error(50) / 1e3, dispatch_start_error(99) / 1e3, dispatch_start_error(100) / 1e3);
  printf("%llu skipped, %llu ended late, %llu not recorded, %llu tables lost, %llu requests refused, %llu torn copies\n",
         (unsigned long long)all.skipped, (unsigned long long)(all.late_ends + all.overran + (uint64_t)all.is_stuck),
         (unsigned long long)(all.unrecorded + dispatch_unwritten()),
         (unsigned long long)all.lost_tables, (unsigned long long)all.refused, (unsigned long long)dispatch_torn());
  const dispatch_switches switched = dispatch_switched();
  if (switched.taken)
    printf("%llu mode switches; from request to next table at most %.3f ms, which is %.3f ms %s than a table and a dispatch\n",
           (unsigned long long)switched.taken, switched.longest / 1e6, llabs(switched.excess) / 1e6,
           switched.excess <= 0 ? "less" : "more");
  if (all.copied)
    printf("%llu copies at releases and at releases + LET, at most %.1f us late\n", (unsigned long long)all.copied, all.latest_copy / 1e3);
  const int64_t step = dispatch_stepped(&steps);
  if (steps) printf("the clock was set %u times, by %.3f ms in all\n", steps, step / 1e6);
}

int main(int argc, char **argv) {
  find_units();
  cpus = calloc((size_t)plan.n_workers + 1, sizeof *cpus);
  if (!cpus) die(1, "no memory", NULL);
  take_options(argc, argv);
  cfg.run.cpus = cpus;
  char own[4096];
  const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
  own[length > 0 ? length : 0] = 0;
  cfg.folder = length > 0 ? dirname(own) : ".";

  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  struct sigaction before;
  if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN) sigaddset(&set, SIGHUP);   /* unless by nohup */
  pthread_sigmask(SIG_BLOCK, &set, NULL);
  const int signals = signalfd(-1, &set, SFD_CLOEXEC);
  const int control = cfg.control ? open(cfg.control, O_RDWR | O_NONBLOCK | O_CLOEXEC) : -1;
  if (cfg.control && control < 0) die(1, "the control pipe cannot be opened; make it with mkfifo", cfg.control);

  if (check_cpus() + check_priority()) return 1;
  if (dispatch_load(cfg.folder, cfg.memory)) die(1, dispatch_reason, NULL);
  if (load_regulators()) return 1;
  if (lock_memory()) return 1;
  const int latency = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);   /* held open: idle states stay shallow */
  const int32_t none = 0;
  if (latency >= 0 && write(latency, &none, sizeof none) < 0) say("idle states cannot be held off: %s", strerror(errno));
  const int unwritable = cfg.record ? dispatch_record(cfg.record, (uint64_t)cfg.limit) : 0;
  if (unwritable) die(1, dispatch_reason, strerror(unwritable));
  start();
  attend(signals, control);
  dispatch_wait(5);
  dispatch_finish();
  report();
  summarise();
  fflush(stdout);
  const int status = dispatch_status();
  _exit(status == DISPATCH_OK && dispatch_torn() ? DISPATCH_FAULTS : status);   /* a thread that does not return must not hold up the end */
}
