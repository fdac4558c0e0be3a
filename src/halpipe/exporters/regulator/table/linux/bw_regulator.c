/* Loads the tables of bw_tables.h into the regulators through UIO, starts them and reads their counters.
 *
 *   cc -std=c99 -O2 -I.. -o bw_regulator bw_regulator.c
 *   bw_regulator /dev/uio0 load | replace N | go | stop | start T | request N | status | counters SECONDS
 *
 * Nothing is written to a device that was built for less than these tables. `replace` writes them into the bank that is not
 * played and requests table N of them. Of two ports, only that of the lock writes tables: `load` and `replace` take it and give
 * it back, `go`, `stop` and `start` too. `counters` prints what `halpipe compare` reads: bytes of each unit and direction, and
 * the windows in which they moved. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bw_uio.h"

enum { RUNNING = 1 << 8, PENDING = 1 << 9, RD_BYTES = 0x28, WR_BYTES = 0x2c };

static int fail(const char *text)
{
  fprintf(stderr, "bw_regulator: %s\n", text);
  return 1;
}

/* Returns the tables of a bank of a unit: half of all where there are two banks. */
static uint32_t bank_tables(void)
{
  uint32_t tables = bw_get(1, BW_PARAMS) >> 16 & 0xff, banks = bw_get(0, BW_PARAMS) >> 16 & 0xf;
  return (tables ? tables : 256) / (banks == 2 ? 2 : 1);
}

/* Returns the bank whose table is played; the lower one where none is. */
static uint32_t played(void) { return (bw_get(1, BW_STATUS) & 0xff) / bank_tables(); }

static int take(void)
{
  const char *reason = bw_take();
  return reason ? fail(reason) : 0;
}

static int control(uint32_t value)
{
  if (take()) return 1;
  bw_put(0, BW_CTRL, value);
  bw_put(0, BW_LOCK, 0);
  return 0;
}

static int load(void)
{
  if (bw_get(0, BW_CTRL) & BW_GO) return fail("tables are being played; stop first, or replace them");
  if (take()) return 1;
  bw_load();
  bw_put(0, BW_LOCK, 0);
  return bw_has_windows() ? 0 : fail("the device did not take the windows");
}

static int replace(uint32_t number)
{
  uint32_t bank = 1 - played();
  if ((bw_get(0, BW_PARAMS) >> 16 & 0xf) != 2) return fail("the regulator has one bank of tables; stop, and load");
  if (!bw_has_windows()) return fail("these tables have other windows; stop, and load");
  if (take()) return 1;
  for (uint32_t n = 0; n < BW_UNITS; n++) {
    uint32_t now = bw_get(n + 1, BW_STATUS);
    if ((now & (RUNNING | PENDING)) != RUNNING || (now & 0xff) / bank_tables() == bank) {
      bw_put(0, BW_LOCK, 0);
      return fail("a table is requested, or none is played; try again");
    }
  }
  for (uint32_t n = 0; n < BW_UNITS; n++) bw_load_unit(n, bank * bank_tables(), bank * ((bw_get(n + 1, BW_PARAMS) & 0xffff) / 2));
  bw_put(0, BW_REQ_TABLE, bank * bank_tables() + number);
  bw_put(0, BW_LOCK, 0);
  return 0;
}

/* Prints the bytes of one table: those between two looks, in the windows from the first look to the second. */
static int counters(double seconds)
{
  struct timespec pause = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
  uint64_t span = (uint64_t)BW_WINDOW_CYCLES * BW_WINDOW_OF + BW_WINDOW_EXTRA;  /* of a window, in parts of a cycle */
  uint64_t parts = (uint64_t)BW_CLOCK_HZ * BW_WINDOW_OF;
  uint32_t before[BW_UNITS][2], tables[BW_UNITS], first[BW_UNITS];
  for (uint32_t n = 0; n < BW_UNITS; n++) {
    tables[n] = bw_get(n + 1, BW_STATUS) & 0x1ff;
    first[n] = bw_get(n + 1, BW_WINDOW);
    before[n][0] = bw_get(n + 1, RD_BYTES);
    before[n][1] = bw_get(n + 1, WR_BYTES);
  }
  while (nanosleep(&pause, &pause) && errno == EINTR) continue;
  printf("unit,direction,bytes,start_s,end_s\n");
  for (uint32_t n = 0; n < BW_UNITS; n++) {
    uint32_t moved[2] = {bw_get(n + 1, RD_BYTES) - before[n][0], bw_get(n + 1, WR_BYTES) - before[n][1]};
    uint32_t last = bw_get(n + 1, BW_WINDOW);
    if (tables[n] != (bw_get(n + 1, BW_STATUS) & 0x1ff) || !(tables[n] & RUNNING) || last < first[n])
      return fail("a table began or ended meanwhile; look for a shorter time, or again");
    for (uint32_t d = 0; d < 2; d++)
      printf("%s,%s,%u,%llu/%llu,%llu/%llu\n", bw_units[n].name, d ? "write" : "read", (unsigned)moved[d],
             (unsigned long long)(span * first[n]), (unsigned long long)parts,
             (unsigned long long)(span * ((uint64_t)last + 1)), (unsigned long long)parts);
  }
  return 0;
}

static int status(void)
{
  for (uint32_t n = 0; n < BW_UNITS; n++) {
    uint32_t now = bw_get(n + 1, BW_STATUS);
    printf("%s: table %u, window %u%s%s%s\n", bw_units[n].name, (unsigned)((now & 0xff) % bank_tables()), (unsigned)bw_get(n + 1, BW_WINDOW),
           now & RUNNING ? "" : ", defaults", now >> 10 & 1 ? ", a read was too long" : "",
           now >> 11 & 1 ? ", a write was too long" : "");
  }
  return 0;
}

static int command(const char *verb, const char *value)
{
  char *end = NULL;
  uint64_t number = value ? strtoull(value, &end, 0) : 0;
  if (!strcmp(verb, "counters")) return counters(value ? strtod(value, NULL) : 0.001);
  if (value && (*end || end == value)) return fail("the value is no number");
  if (!strcmp(verb, "load")) return load();
  if (!strcmp(verb, "status")) return status();
  if (!strcmp(verb, "go")) return control(BW_GO);
  if (!strcmp(verb, "stop")) return control(0);
  if (!strcmp(verb, "start") && value) {
    if (take()) return 1;
    bw_start(number);
    bw_put(0, BW_LOCK, 0);
    return 0;
  }
  if (!strcmp(verb, "replace") && value && number < BW_TABLES) return replace((uint32_t)number);
  if (!strcmp(verb, "request") && value && number < BW_TABLES) return bw_put(0, BW_REQ_TABLE, played() * bank_tables() + (uint32_t)number), 0;
  return fail("usage: bw_regulator DEVICE load | replace N | go | stop | start T | request N | status | counters SECONDS");
}

int main(int count, char **words)
{
  if (count < 3) return command("", NULL);
  const char *reason = bw_open(words[1]);
  return reason ? fail(reason) : command(words[2], count > 3 ? words[3] : NULL);
}
