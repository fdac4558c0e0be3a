/* Regulators of memory bandwidth: loaded before the run, started with its first table, switched and compared with its tables.
 *
 * Instants of CLOCK_MONOTONIC are converted to the time base of the unit by readings of both before the start. */
#define _GNU_SOURCE
#include "dispatch.h"

#include <signal.h>
#include <stdio.h>
#include <time.h>

#include "bw_uio.h"

#define SECOND INT64_C(1000000000)
#define AHEAD INT64_C(250000000)   /* ns before the start, of the second reading: late enough for the rate, early enough for a busy machine */
#define READINGS 10
#define LATEST 2000                /* ns that a request takes to be seen by the unit */
#define MILLION INT64_C(1000000)

typedef __int128 wide;

static const wide span = (wide)BW_WINDOW_CYCLES * BW_WINDOW_OF + BW_WINDOW_EXTRA;   /* of a window, in parts of a cycle */
static const wide parts = (wide)BW_CLOCK_HZ * BW_WINDOW_OF;

typedef struct {          /* of the unit, between two instants */
  int64_t low, high;
  uint64_t now;
} reading;

static reading loaded;
static int64_t origin, bound;   /* bound: ns by which the windows begin before or after their instants, at most */
static struct {           /* the table in force; its first window and that after its last one, from the first table on */
  uint32_t number;
  uint64_t first, end;
  int requested;          /* -1: none */
} table;

static int64_t time_now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * SECOND + t.tv_nsec;
}

static int64_t instant_of(uint64_t window) { return origin + (int64_t)(window * span * SECOND / parts); }

static uint64_t window_at(int64_t at) { return at < origin ? 0 : (uint64_t)((at - origin) * parts / SECOND / span); }

/* The closest of several readings: the others were interrupted. */
static reading look(void) {
  reading best = {.high = INT64_MAX};
  for (int i = 0; i < READINGS; i++) {
    reading seen = {.low = time_now()};
    uint32_t high;
    do {
      high = bw_get(0, BW_NOW_HI);
      seen.now = (uint64_t)high << 32 | bw_get(0, BW_NOW_LO);
    } while (high != bw_get(0, BW_NOW_HI));
    seen.high = time_now();
    if (seen.high - seen.low < best.high - best.low) best = seen;
  }
  return best;
}

static void no_answer(int number) {
  static const char text[] = "dispatcher: the regulators do not answer: bus error\n";
  (void)number;
  _exit(write(STDERR_FILENO, text, sizeof text - 1) < 0 ? 2 : 1);
}

static int load(const char *device) {
  struct sigaction before, action = {.sa_handler = no_answer};
  sigaction(SIGBUS, &action, &before);
  const char *reason = bw_open(device);
  if (!reason) reason = bw_take();
  if (!reason) {
    bw_put(0, BW_CTRL, 0);   /* a run before may have left its tables */
    bw_load();
    loaded = look();
    if (!bw_has_windows()) reason = "the device did not take the windows";
  }
  sigaction(SIGBUS, &before, NULL);
  return reason ? dispatch_fail(ENODEV, reason, device) : 0;
}

static int start(int mode, int64_t first) {
  const int64_t window = (int64_t)(span * SECOND / parts);
  origin = first;
  dispatch_until(first - window - AHEAD);
  const reading seen = look();
  const int64_t least = seen.low - loaded.high, most = seen.high - loaded.low;
  const wide ticks = seen.now - loaded.now, rate = BW_TIMEBASE_HZ, unit = (wide)SECOND * MILLION;
  if (!ticks) return dispatch_fail(ENODEV, "the time base of the regulators does not count; connect their input `now`", NULL);
  if ((ticks + 1) * unit < least * rate * (MILLION - BW_DRIFT_PPM) || (ticks - 1) * unit > most * rate * (MILLION + BW_DRIFT_PPM))
    return dispatch_fail(ERANGE, "the time base of the regulators has another rate than timebase and drift of the platform say", NULL);
  /* From the middles of both readings on: error of the second, and of the rate up to the first table. */
  const int64_t middle = seen.low + (seen.high - seen.low) / 2, since = middle - (loaded.low + (loaded.high - loaded.low) / 2);
  const uint64_t begin = seen.now + (uint64_t)((wide)(first - middle) * ticks / since);
  const wide width = (seen.high - seen.low) + (loaded.high - loaded.low);
  bound = (int64_t)(width * (first - middle) / since + (seen.high - seen.low)) / 2 + 2 * SECOND / BW_TIMEBASE_HZ + SECOND / BW_CLOCK_HZ + 2;
  if (bound > window) return dispatch_fail(ERANGE, "the regulators cannot be started to a window: reading their time base takes too long", NULL);
  for (int i = 0; plan.n_modes > 1 && i < plan.n_modes; i++)   /* a switch is chosen a quarter of its table before the end */
    if (plan.tables[i].length / 4 <= LATEST + bound) return dispatch_fail(ERANGE, "a table is too short for the regulators to be switched in time", plan.tables[i].name);
  table.requested = -1;
  table.number = (uint32_t)mode;
  table.end = bw_units[0].tables[mode].windows;
  bw_put(0, BW_REQ_TABLE, (uint32_t)mode);
  bw_start(begin - (uint64_t)(BW_TIMEBASE_HZ * (span + BW_WINDOW_OF) / parts));
  const int is_armed = (bw_get(0, BW_CTRL) & BW_ARM) != 0;
  if (!is_armed) bw_put(0, BW_CTRL, 0);
  bw_put(0, BW_LOCK, 0);
  if (!is_armed) return dispatch_fail(ETIME, "the regulators are not armed in time; state a later first instant", NULL);
  printf("the first windows of the regulators begin within %.3f us of the first table\n", (double)bound / 1e3);
  return 0;
}

/* Go to the table in force just before an instant. */
static void follow(int64_t at) {
  while (instant_of(table.end) < at) {
    table.number = table.requested >= 0 ? (uint32_t)table.requested : bw_units[0].tables[table.number].successor;
    table.requested = -1;
    table.first = table.end;
    table.end += bw_units[0].tables[table.number].windows;
  }
}

/* The table of a switch may contain the first cycles of its target: until then no other one is taken. */
static int request(int from, int to, int64_t at) {
  follow(at);
  if (instant_of(table.end) != at || time_now() > at - LATEST - bound) return 0;
  table.requested = (int)bw_request_of((uint32_t)from, (uint32_t)to);
  bw_put(0, BW_REQ_TABLE, (uint32_t)table.requested);
  return 1;
}

static int differs(int64_t at) {
  follow(at);
  for (uint32_t n = 1; n <= BW_UNITS; n++) {
    const uint64_t least = window_at(time_now());
    const uint32_t status = bw_get(n, BW_STATUS), window = bw_get(n, BW_WINDOW);
    const uint64_t most = window_at(time_now());
    if (most >= table.end) return 0;   /* too late: the next table is in force */
    if (most + 1 == table.end && !window) continue;   /* it may be, a little early */
    const uint64_t seen = table.first + window;
    if ((status & 0x1ff) != (table.number | 1 << 8) || seen + 1 < least || seen > most + 1) return 1;
  }
  return 0;
}

const dispatch_regulators bw_regulators = {load, start, request, differs};
