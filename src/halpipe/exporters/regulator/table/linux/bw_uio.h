/* Regulators as a UIO device: their registers, the refusal of a device that was built for less than the tables, and the lock.
 *
 * The functions return NULL, or the reason why they could not. */
#ifndef BW_UIO_H
#define BW_UIO_H
#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static volatile uint32_t *bw_device;

static uint32_t bw_get(uint32_t block, uint32_t at) { return bw_device[(block << 20 | at) / 4]; }
static void bw_put(uint32_t block, uint32_t at, uint32_t value) { bw_device[(block << 20 | at) / 4] = value; }

#include "bw_unit.h"

enum { BW_INTERFACE = 4, BW_MINE = 2 };

static inline const char *bw_refuse(void)
{
  uint32_t params = bw_get(0, BW_PARAMS), banks = (params >> 16 & 0xf) == 2 ? 2 : 1, beat = 0;
  while (1u << beat < BW_BUS_BYTES) beat++;
  if (bw_get(0, BW_ID) != BW_HBWF) return "there is no regulator at this address";
  if (params >> 24 != BW_INTERFACE) return "the regulator has another version of its registers";
  if ((params & 0xff) < BW_UNITS) return "the regulator has fewer units than the tables";
  if ((params >> 8 & 0xff) != beat) return "the regulator is built for another width of the bus";
  if (bw_get(0, BW_BUFFER) && bw_get(0, BW_BUFFER) << beat < BW_BURST_BYTES) return "the write buffers are shorter than the longest burst";
  for (uint32_t n = 0; n < BW_UNITS; n++) {
    uint32_t built = bw_get(n + 1, BW_PARAMS), tables = built >> 16 & 0xff;
    if (bw_get(n + 1, BW_ID) != 0x48425754u || built >> 24 != BW_INTERFACE) return "a unit does not answer as one";
    if ((built & 0xffff) / banks < bw_units[n].entries + 1) return "a unit has too few table entries";
    if ((tables ? tables : 256) / banks < BW_TABLES) return "a unit has too few tables";
  }
  return NULL;
}

static inline const char *bw_open(const char *path)
{
  int file = open(path, O_RDWR | O_SYNC | O_CLOEXEC);
  void *memory = file < 0 ? MAP_FAILED : mmap(NULL, (BW_UNITS + 1) << 20, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (memory == MAP_FAILED) return strerror(errno);
  close(file);
  bw_device = memory;
  return bw_refuse();
}

static inline const char *bw_take(void)
{
  bw_put(0, BW_LOCK, 1);
  return (bw_get(0, BW_PARAMS) >> 20 & 0xf) > 1 && !(bw_get(0, BW_LOCK) & BW_MINE) ? "the other port writes tables; try again" : NULL;
}

static inline int bw_has_windows(void)
{
  return bw_get(0, BW_CYCLES) == BW_WINDOW_CYCLES && bw_get(0, BW_EXTRA) == BW_WINDOW_EXTRA && bw_get(0, BW_OF) == BW_WINDOW_OF && bw_get(0, BW_LONGEST) == BW_BURST_BYTES;
}
#endif
