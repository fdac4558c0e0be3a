/* Fixed-point arithmetic for all tasks: integers only, no library, the same result on every machine.
 *
 *   q16     Q16.16: 65536 is one metre, one metre per second, one per metre, one second ...
 *   angle   a full turn is 2^32, so that sums wrap by themselves and (int32_t)(a - b) is the signed difference
 *
 * Products are computed in 64 bits and shifted back. Right shifts of negative numbers are arithmetic, as in every
 * compiler for these processors.
 */
#ifndef FIXED_H
#define FIXED_H

#include <stdint.h>

typedef int32_t q16;
typedef uint32_t angle;

#define ONE 65536
#define Q16(value) ((q16)((value) * 65536 + ((value) < 0 ? -0.5 : 0.5)))      /* of a constant; nothing is left at run time */
#define DEGREES(value) ((int32_t)((value) * 4294967296.0 / 360))
#define QUARTER_TURN 0x40000000u

extern const int32_t sine_table[257]; /* sine of a quarter turn, Q16.16 */

static inline q16 multiply(q16 a, q16 b) { return (q16)((int64_t)a * b >> 16); }
static inline q16 divide(q16 a, q16 b) { return (q16)((int64_t)a * ONE / b); }
static inline int32_t absolute(int32_t a) { return a < 0 ? -a : a; }
static inline int32_t smaller(int32_t a, int32_t b) { return a < b ? a : b; }
static inline int32_t larger(int32_t a, int32_t b) { return a > b ? a : b; }
static inline int32_t within(int32_t a, int32_t low, int32_t high) { return a < low ? low : a > high ? high : a; }

/* Sine in Q16.16, interpolated in the table; exact to 2 units of the last place. */
static inline q16 sine(angle a) {
  uint32_t quadrant = a >> 30, part = a & 0x3fffffffu;
  if (quadrant & 1) part = 0x40000000u - part;
  uint32_t index = part >> 22, rest = part & 0x3fffffu;
  int32_t low = sine_table[index], high = sine_table[index + (index < 256)];
  int32_t value = low + (int32_t)((int64_t)(high - low) * rest >> 22);
  return quadrant & 2 ? -value : value;
}

static inline q16 cosine(angle a) { return sine(a + QUARTER_TURN); }

/* The whole square root of n. */
static inline uint32_t square_root(uint64_t n) {
  uint64_t root = 0, bit = (uint64_t)1 << 62;
  while (bit > n) bit >>= 2;
  for (; bit; bit >>= 2) {
    if (n >= root + bit) {
      n -= root + bit;
      root = (root >> 1) + bit;
    } else {
      root >>= 1;
    }
  }
  return (uint32_t)root;
}

static inline q16 square_root_q16(q16 n) { return n <= 0 ? 0 : (q16)square_root((uint64_t)n << 16); }
static inline q16 length(q16 x, q16 y) { return (q16)square_root((uint64_t)((int64_t)x * x + (int64_t)y * y)); }

/* The direction of (x, y), by CORDIC: rotate on to the x axis in ever smaller steps and add them up. */
static inline angle direction(q16 y, q16 x) {
  static const int32_t steps[20] = {536870912, 316933406, 167458907, 85004756, 42667331, 21354465, 10679838,
                                    5340245,   2670163,   1335087,   667544,   333772,   166886,   83443,
                                    41722,     20861,     10430,     5215,     2608,     1304};
  int64_t a = (int64_t)x * 4096, b = (int64_t)y * 4096;
  angle turned = 0;
  if (a < 0) {
    a = -a;
    b = -b;
    turned = 0x80000000u;
  }
  for (int i = 0; i < 20; i++) {
    int64_t c = a >> i, d = b >> i;
    if (b > 0) {
      a += d;
      b -= c;
      turned += (uint32_t)steps[i];
    } else {
      a -= d;
      b += c;
      turned -= (uint32_t)steps[i];
    }
  }
  return turned;
}

/* xorshift32, Marsaglia 2003: a state that is never 0 gives the next. */
static inline uint32_t random_next(uint32_t *state) {
  uint32_t s = *state;
  s ^= s << 13;
  s ^= s >> 17;
  s ^= s << 5;
  return *state = s;
}

/* A sum of four uniform bytes, which is nearly normal: mean 0, standard deviation 148. */
static inline int32_t random_normal(uint32_t *state) {
  uint32_t r = random_next(state);
  return (int32_t)((r & 255) + (r >> 8 & 255) + (r >> 16 & 255) + (r >> 24)) - 510;
}

#endif
