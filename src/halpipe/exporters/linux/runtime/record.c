/* Writes what ran as CSV, whole or not at all. */
#define _GNU_SOURCE
#include "dispatch.h"

#include <errno.h>
#include <stdio.h>
#include <unistd.h>

static void write_worker(FILE *file, int worker) {
  const dispatch_record record = dispatch_recorded(worker);
  const dispatch_worker *w = &plan.workers[worker];
  const int64_t origin = dispatch_origin();
  for (size_t i = 0; i < record.n_events; i++) {
    const dispatch_event *e = &record.events[i];
    fprintf(file, "%s,%u,%s,%llu,%lld,%lld,%s,%lld,%lld\n", w->task, e->job, plan.tables[e->table].name,
            (unsigned long long)e->cycle, (long long)(e->began - origin), (long long)(e->ended - origin), w->units,
            (long long)e->busy, (long long)(e->planned - origin));
  }
}

int dispatch_write(const char *file) {
  char name[4096];
  if (snprintf(name, sizeof name, "%s.part", file) >= (int)sizeof name) return ENAMETOOLONG;
  FILE *stream = fopen(name, "w");
  if (!stream) return errno;
  fprintf(stream, "task,job,mode,cycle,start,end,units,busy,planned\n");
  for (int worker = 0; worker < plan.n_workers; worker++) write_worker(stream, worker);
  const int error = fflush(stream) || fsync(fileno(stream)) ? errno : 0;
  if (fclose(stream) && !error) return errno;
  return error ? error : rename(name, file) ? errno : 0;
}
