/* Programs of the tasks: shared objects, and the buffers between which their data moves. */
#define _GNU_SOURCE
#include "dispatch.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

typedef struct {
  void (**entries)(void);
  void **in, **out;
} loaded_program;

typedef struct {          /* before each buffer: odd while it is written */
  _Atomic uint32_t sequence;
  uint32_t size;
} buffer_head;

static loaded_program *programs;
static buffer_head **buffers;
static void *between;     /* has room for the largest buffer */
static _Atomic uint64_t torn;

static size_t room_of(uint32_t size) { return (sizeof(buffer_head) + size + 63) / 64 * 64; }

static int map_buffers(const char *memory) {
  size_t total = 64, largest = 0;
  for (int i = 0; i < plan.n_buffers; i++) {
    const size_t room = room_of(plan.buffers[i].size);
    total += room;
    if (room > largest) largest = room;
  }
  int file = -1;
  if (memory) {
    file = open(memory, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (file < 0 || ftruncate(file, (off_t)total)) return dispatch_fail(errno, "the file of the buffers cannot be made", memory);
  }
  char *base = mmap(NULL, total, PROT_READ | PROT_WRITE, file < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED, file, 0);
  if (file >= 0) close(file);
  if (base == MAP_FAILED) return dispatch_fail(errno, "the buffers cannot be mapped", memory);
  buffers = calloc((size_t)plan.n_buffers + 1, sizeof *buffers);
  between = calloc(1, largest + 1);
  if (!buffers || !between) return dispatch_fail(ENOMEM, "no memory for the buffers", NULL);
  for (int i = 0; i < plan.n_buffers; i++) {
    buffers[i] = (buffer_head *)base;
    buffers[i]->size = plan.buffers[i].size;
    base += room_of(plan.buffers[i].size);
  }
  return 0;
}

static int find_symbols(void *library, const dispatch_move *moves, int n, void **found, const char *name) {
  for (int i = 0; i < n; i++)
    if (!(found[i] = dlsym(library, moves[i].symbol))) return dispatch_fail(ENOENT, name, moves[i].symbol);
  return 0;
}

static int load(const dispatch_program *program, loaded_program *into, const char *folder) {
  char path[4096];
  if (snprintf(path, sizeof path, "%s/%s", folder, program->library) >= (int)sizeof path)
    return dispatch_fail(ENAMETOOLONG, "the name of the folder is too long", NULL);
  void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!library) return dispatch_fail(ENOENT, "a program cannot be loaded", dlerror());
  into->entries = calloc(program->n_entries, sizeof *into->entries);
  into->in = calloc((size_t)program->n_in + 1, sizeof *into->in);
  into->out = calloc((size_t)program->n_out + 1, sizeof *into->out);
  if (!into->entries || !into->in || !into->out) return dispatch_fail(ENOMEM, "no memory for a program", program->name);
  for (int i = 0; i < program->n_entries; i++) {
    void *entry = dlsym(library, program->entries[i]);
    if (!entry) return dispatch_fail(ENOENT, program->name, program->entries[i]);
    memcpy(&into->entries[i], &entry, sizeof entry);
  }
  const int error = find_symbols(library, program->in, program->n_in, into->in, program->name);
  return error ? error : find_symbols(library, program->out, program->n_out, into->out, program->name);
}

/* Other threads may write or read meanwhile: a word is whole, and an equal sequence shows that all words are of one writer. */
static void copy_from(void *into, const buffer_head *from, size_t size) {
  const _Atomic uint64_t *words = (const _Atomic uint64_t *)(from + 1);
  for (size_t at = 0; at < size; at += sizeof *words) {
    const uint64_t word = atomic_load_explicit(&words[at / sizeof *words], memory_order_relaxed);
    memcpy((char *)into + at, &word, size - at < sizeof word ? size - at : sizeof word);
  }
}

static void copy_to(buffer_head *into, const void *from, size_t size) {
  _Atomic uint64_t *words = (_Atomic uint64_t *)(into + 1);
  for (size_t at = 0; at < size; at += sizeof *words) {
    uint64_t word = size - at < sizeof word ? atomic_load_explicit(&words[at / sizeof *words], memory_order_relaxed) : 0;
    memcpy(&word, (const char *)from + at, size - at < sizeof word ? size - at : sizeof word);
    atomic_store_explicit(&words[at / sizeof *words], word, memory_order_relaxed);
  }
}

/* A copy out of a buffer is whole: it is repeated after a write meanwhile; one that is not in the end is counted. */
static void take(uint32_t buffer, size_t size, void *into) {
  const buffer_head *from = buffers[buffer];
  for (int attempt = 0; attempt < 100; attempt++) {
    const uint32_t before = atomic_load_explicit(&from->sequence, memory_order_acquire);
    copy_from(into, from, size);
    atomic_thread_fence(memory_order_acquire);
    if (!(before & 1) && before == atomic_load_explicit(&from->sequence, memory_order_relaxed)) return;
  }
  atomic_fetch_add(&torn, 1);
}

static void give(uint32_t buffer, size_t size, const void *from) {
  buffer_head *into = buffers[buffer];
  atomic_fetch_add_explicit(&into->sequence, 1, memory_order_acquire);
  atomic_thread_fence(memory_order_release);
  copy_to(into, from, size);
  atomic_fetch_add_explicit(&into->sequence, 1, memory_order_release);
}

/* Of the one thread that copies: a whole buffer is read before it is written to another one. */
static void copy(const dispatch_copy *copy) {
  take(copy->from, copy->size, between);
  give(copy->to, copy->size, between);
}

static int run(const dispatch_job *job, int64_t at) {
  const dispatch_program *program = &plan.programs[job->program];
  const loaded_program *loaded = &programs[job->program];
  for (int i = 0; i < program->n_in; i++) take(program->in[i].buffer, program->in[i].size, loaded->in[i]);
  for (int k = 0; k < job->n_parts; k++) {
    if (k > 0) dispatch_until(at + job->parts[k].start);
    for (int i = job->parts[k].first; i < job->parts[k].last; i++) loaded->entries[i]();
  }
  for (int i = 0; i < program->n_out; i++) give(program->out[i].buffer, program->out[i].size, loaded->out[i]);
  return DISPATCH_RAN;
}

int dispatch_load(const char *folder, const char *memory) {
  dispatch_hook(run, copy);
  int error = map_buffers(memory);
  programs = calloc((size_t)plan.n_programs, sizeof *programs);
  if (!error && !programs) error = dispatch_fail(ENOMEM, "no memory for the programs", NULL);
  for (int i = 0; !error && i < plan.n_programs; i++) error = load(&plan.programs[i], &programs[i], folder);
  return error;
}

uint64_t dispatch_torn(void) { return atomic_load(&torn); }
