/* Stands for a program that does not exist yet: it takes BUSY_NS of processor time. Written by halpipe. */
#include <stdint.h>
#include <time.h>

static int64_t used(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

void dummy(void) {
  const int64_t end = used() + BUSY_NS;
  while (used() < end) { }
}
