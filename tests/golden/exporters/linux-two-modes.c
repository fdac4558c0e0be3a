/* The tables of a schedule of model m, written by halpipe. Times are nanoseconds. */
#include "dispatch.h"

static const char *const entries_0[] = { "piece_0", };
static const char *const entries_1[] = { "piece_0", };
static const dispatch_program programs[] = {
  { .name = "a/v", .library = "program_0.so", .entries = entries_0, .n_entries = 1,
    .in = 0, .n_in = 0, .out = 0, .n_out = 0 },
  { .name = "b/v", .library = "program_1.so", .entries = entries_1, .n_entries = 1,
    .in = 0, .n_in = 0, .out = 0, .n_out = 0 },
};

static const dispatch_buffer buffers[] = {
  {0, 0},
};

static const dispatch_part parts_0[] = { {1000000, 0, 1}, };
static const dispatch_part parts_1[] = { {4000000, 0, 1}, };

static const dispatch_job jobs_0_0[] = {
  {.start = 1000000, .end = 2000000, .parts = parts_0, .n_parts = 1, .program = 0, .job = 0},
};
static const dispatch_job jobs_0_1[] = {
  {.start = 1000000, .end = 2000000, .parts = parts_0, .n_parts = 1, .program = 0, .job = 0},
};
static const dispatch_job jobs_0_3[] = {
  {.start = 1000000, .end = 2000000, .parts = parts_0, .n_parts = 1, .program = 0, .job = 0},
};
static const dispatch_rows rows_0[] = {
  {jobs_0_0, 1},
  {jobs_0_1, 1},
  {0, 0},
  {jobs_0_3, 1},
};
static const dispatch_job jobs_1_0[] = {
  {.start = 4000000, .end = 5000000, .parts = parts_1, .n_parts = 1, .program = 1, .job = 0},
};
static const dispatch_rows rows_1[] = {
  {jobs_1_0, 1},
  {0, 0},
  {0, 0},
  {0, 0},
};

static const dispatch_worker workers[] = {
  {.task = "a", .unit = "u1", .units = "u1", .cpu = 3, .priority = 0, .refuge = -1, .fault = -1, .tables = rows_0},
  {.task = "b", .unit = "u1", .units = "u1", .cpu = 3, .priority = 0, .refuge = -1, .fault = -1, .tables = rows_1},
};

static const dispatch_table tables[] = {
  {.name = "both", .length = 10000000, .rest = 0, .from = 0, .to = 0},
  {.name = "one", .length = 10000000, .rest = 0, .from = 1, .to = 1},
  {.name = "both->one", .length = 0, .rest = 0, .from = 0, .to = 1},
  {.name = "one->both", .length = 5000000, .rest = 0, .from = 1, .to = 0},
};

static const int switches[] = { -1, 2, 3, -1, };

const dispatch_plan plan = {
  .model = "m", .parts = 1,
  .n_tables = 4, .n_modes = 2, .n_workers = 2, .n_programs = 2,
  .n_buffers = 0, .levels = 1,
  .tables = tables, .switches = switches, .workers = workers, .programs = programs, .buffers = buffers,
};
