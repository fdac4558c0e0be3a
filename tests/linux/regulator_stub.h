/* Registers of regulators as a program sees them, on the clock of the machine: time base, windows, and the table in force.
 *
 * In place of the mapped registers. PPM: by which both clocks are fast; STUCK: the time base stands still;
 * LOST: no request comes through. Each table that begins is a line of REGULATOR_LOG: its number, and the instant in ns. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { STUB_TICK = 10, STUB_ORIGIN = 123456789 };

static uint32_t stub_words[4][1 << 18], stub_request, stub_pending;
static int64_t stub_begin, stub_asked;
static int stub_table = -1, stub_drift, stub_stuck;
static FILE *stub_log;

static int64_t stub_clock(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static int64_t stub_fast(int64_t ns) { return (int64_t)((__int128)ns * (1000000 + stub_drift) / 1000000); }
static int64_t stub_window(void) { return (int64_t)stub_words[0][0x18 / 4] * 10; }
static int64_t stub_end(void) { return stub_begin + (int64_t)stub_words[1][0x800 / 4 + 2 * stub_table] * stub_window(); }

static void stub_enter(int table, int64_t at) {
  stub_table = table;
  stub_begin = at;
  fprintf(stub_log, "%d %lld\n", table, (long long)at);
}

static void stub_advance(int64_t time) {
  const uint64_t ticks = (uint64_t)stub_words[0][0x30 / 4] << 32 | stub_words[0][0x2c / 4];
  const int64_t start = ((int64_t)ticks - STUB_ORIGIN) * STUB_TICK + 10 + stub_window();
  if (stub_words[0][2] == 2 && time >= start - stub_window()) {
    stub_words[0][2] = 1;
    stub_enter((int)stub_request, start);
    stub_pending = 0;
  }
  while (stub_table >= 0 && time >= stub_end()) {
    const int64_t end = stub_end();
    const int follows = stub_pending && stub_asked <= end - 20;
    stub_pending = stub_pending && !follows;
    stub_enter(follows ? (int)stub_request : (int)(stub_words[1][0x804 / 4 + 2 * stub_table] >> 24), end);
  }
}

static uint32_t bw_get(uint32_t block, uint32_t at) {
  if (!stub_log) {
    stub_log = fopen(getenv("REGULATOR_LOG"), "w");
    setvbuf(stub_log, NULL, _IOLBF, 0);
    stub_drift = getenv("PPM") ? atoi(getenv("PPM")) : 0;
    stub_stuck = getenv("STUCK") != NULL;
  }
  const int64_t time = stub_fast(stub_clock());
  const uint64_t now = STUB_ORIGIN + (stub_stuck ? 0 : (uint64_t)time / STUB_TICK);
  stub_advance(time);
  const int is_playing = stub_table >= 0 && time >= stub_begin;
  if (block == 0 && at == 0x00) return 0x48425746;
  if (block == 0 && at == 0x04) return 4 << 24 | 1 << 20 | 1 << 16 | 3 << 8 | 3;
  if (block == 0 && at == 0x10) return (uint32_t)(time / stub_window());
  if (block == 0 && at == 0x3c) return (uint32_t)now;
  if (block == 0 && at == 0x40) return (uint32_t)(now >> 32);
  if (block && at == 0x00) return 0x48425754;
  if (block && at == 0x04) return 4 << 24 | 16 << 16 | 1024;
  if (block && at == 0x0c) return is_playing ? (uint32_t)stub_table | 1 << 8 : 0;
  if (block && at == 0x10) return is_playing ? (uint32_t)((time - stub_begin) / stub_window()) : UINT32_MAX;
  return stub_words[block][at / 4];
}

static void bw_put(uint32_t block, uint32_t at, uint32_t value) {
  if (block == 0 && at == 0x1c && !(stub_table >= 0 && getenv("LOST"))) {
    stub_advance(stub_fast(stub_clock()));
    stub_request = value, stub_pending = 1, stub_asked = stub_fast(stub_clock());
  }
  stub_words[block][at / 4] = value;
}
