/* Stands for programs that do not exist yet, in pieces: BUSY_NS lists the processor time of each. Written by halpipe. */
#include <stdint.h>
#include <time.h>

static const int64_t times[{{ pieces }}] = {BUSY_NS};

static int64_t used(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static void take(int64_t time) {
  const int64_t end = used() + time;
  while (used() < end) { }
}

{% for piece in range(pieces) %}
void piece_{{ piece }}(void) { take(times[{{ piece }}]); }
{% endfor %}
