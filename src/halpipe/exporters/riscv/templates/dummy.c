/* Stand-in for tasks without sources, made by `halpipe deploy prepare --dummy` (paper, section VI-B): memory phases move
 * a dummy buffer in and out, and executions count up to a maximum. COUNT_n is the maximum of execution n. */
#include <stdint.h>

uint64_t dummy_words[WORDS];

/* In assembler, so that every compiler makes it the same two instructions per count. */
static void count_to(uint64_t maximum) {
    uint64_t count = 0;
    __asm__ volatile("1: addi %0, %0, 1\n bltu %0, %1, 1b" : "+r"(count) : "r"(maximum));
}

static void execute(uint64_t maximum) {
    for (unsigned i = 0; i < 8; i++) dummy_words[i]++; /* shows how often the data came round */
    count_to(maximum);
}
{% for n in range(most) %}
#ifdef COUNT_{{ n }}
void dummy_{{ n }}(void) { execute(COUNT_{{ n }}); }
#endif
{% endfor %}
